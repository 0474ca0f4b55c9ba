"""Tables of numbers from a MATLAB file, read in a process of their own.

SciPy's reader of MATLAB files is compiled code that a damaged file can crash, and a crash cannot be caught. So it runs
in a child process, which hands the tables back as NumPy's own format; where the child dies, the file is refused.
"""

from __future__ import annotations

import io
import subprocess
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["tables_of"]

NUMBERS = ("double", "single", "int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64")
"""MATLAB's classes that a table may have; of others the header alone can ask for any amount of memory."""
_LONGEST_S = 60.0


def tables_of(content: bytes, names: Sequence[str]) -> dict[str, NDArray[Any]]:
    """The tables with these names that a MATLAB file (version 5 to 7.2, inflated) holds.

    Raises:
        ValueError: no such file, a table that holds no numbers, or content that crashes its reader; one line.
    """
    child = [sys.executable, "-m", __name__, *names]
    try:
        ended = subprocess.run(child, input=content, capture_output=True, timeout=_LONGEST_S, check=False)
    except subprocess.TimeoutExpired:
        raise ValueError(f"its tables were not read within {_LONGEST_S:g} s") from None
    if ended.returncode:
        lines = ended.stderr.decode(errors="replace").strip().splitlines()
        raise ValueError(
            lines[-1] if ended.returncode == 2 and lines else "it is damaged: its reader crashed"
        )
    with np.load(io.BytesIO(ended.stdout), allow_pickle=False) as archive:
        return {name: archive[name] for name in archive.files}


def _read(content: bytes, names: Sequence[str]) -> bytes:
    from scipy.io import loadmat, whosmat

    from uwcoop.importers.bounded import refuse_array

    # From memory: asked for a stated length, a stream of bytes gives no more than it holds, a file allocates it.
    file: Any = io.BytesIO(content)
    kinds: dict[str, str] = {}
    for name, shape, kind in whosmat(file):
        refuse_array(f"table {name}", shape, 8)
        kinds[name] = kind
    for name in names:
        if kinds.get(name, "double") not in NUMBERS:
            raise ValueError(f"table {name} holds {kinds[name]}: must hold numbers")
    file.seek(0)
    found = loadmat(file, variable_names=list(names))
    told = io.BytesIO()
    arrays: dict[str, Any] = {
        name: found[name]
        for name in names
        if isinstance(found.get(name), np.ndarray) and found[name].dtype.kind in "iuf"
    }
    np.savez(told, **arrays)
    return told.getvalue()


def _main() -> None:
    try:
        told = _read(sys.stdin.buffer.read(), sys.argv[1:])
    except Exception as error:  # the parent makes one line of whatever a library throws
        print(" ".join(str(error).split()) or type(error).__name__, file=sys.stderr)
        sys.exit(2)
    sys.stdout.buffer.write(told)


if __name__ == "__main__":
    _main()
