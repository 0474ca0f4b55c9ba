"""The papers whose methods are packaged, each by one command, beside what they say.

* `papers/*.toml`: for each figure and table what the paper states, the missions that show it, and our tolerance.
* `manifest`: their model. `runner`: flies what is needed. `measures`, `pictures`: numbers and figures by name.
* `scope`: how much is flown. `tables`, `report`: `report.md` and `report.html`. `page`: the same in a documentation.
"""

from uwcoop.reproduce.manifest import PAPERS, load_paper
from uwcoop.reproduce.runner import reproduce

__all__ = ["PAPERS", "load_paper", "reproduce"]
