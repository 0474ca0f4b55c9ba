"""Logs of earlier versions, whose mutual positionings hold no depth of the peer."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from uwcoop import scenario
from uwcoop.missionlog import MissionLog, topics
from uwcoop.missionlog.mcap import load_log, write_log
from uwcoop.world.simulate import simulate


def test_a_log_without_the_peers_depth_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    log = simulate(scenario.load("seafloor-survey", ["duration_s=200"]), 0)
    kind = topics.EVENT_TOPICS["acoustic_fix"]
    places = {name: place for name, place in kind.places.items() if name != "peer_depth_m"}
    encode = topics.encode

    def without_depth(written: MissionLog) -> Iterator[Any]:
        for stream in encode(written):
            # The bytes of the earlier layout, under the name that it had.
            yield replace(stream, msgtype=kind.msgtype) if stream.msgtype == kind.earlier else stream

    with monkeypatch.context() as patch:
        patch.setitem(topics.EVENT_TOPICS, "acoustic_fix", replace(kind, msgtype=kind.earlier, places=places))
        patch.setattr(topics, "encode", without_depth)
        write_log(log, tmp_path / "earlier.mcap")
    found = load_log(tmp_path / "earlier.mcap").events["acoustic_fix"]
    assert len(found["range_m"]) > 5
    assert np.array_equal(found["range_m"], log.events["acoustic_fix"]["range_m"], equal_nan=True)
    assert np.isnan(found["peer_depth_m"]).all()
