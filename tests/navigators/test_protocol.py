"""What a navigator in Python says of itself, and what becomes of a packet that does not fit its slot."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import uwcoop
from uwcoop.experiment.run import RunResult
from uwcoop.navigators import Custom


class Talker:
    """Stands at the origin and sends as many bytes as it is told."""

    bytes_sent = 10_000

    def __init__(self, _context: Any) -> None:
        pass

    def handle(self, _event: Any) -> str:
        return "noted"

    def transmit(self, _tol_ns: int, _capacity_bytes: int) -> bytes:
        return bytes(self.bytes_sent)

    def estimate(self, _t_ns: int) -> SimpleNamespace:
        return SimpleNamespace(mean_m=np.zeros(2), covariance_m2=np.eye(2))


class Short(Talker):
    bytes_sent = 8


def _run(make: type[Talker]) -> RunResult:
    return uwcoop.run("flat-bay", [Custom("talker", make)], seed=3)


def test_a_packet_that_does_not_fit_is_silence_and_counted() -> None:
    long, short = _run(Talker), _run(Short)
    unsent = long.tracks["unsent"].sel(navigator="talker")
    assert (unsent.isel(time=-1) > 0).all()
    assert (np.diff(unsent.to_numpy(), axis=-1) >= 0).all()
    assert long.tracks["packet_bytes"].max() == 0
    vehicles = long.summary["navigators"]["talker"]["vehicles"]
    assert all(values["unsent"] > 0 for values in vehicles.values())
    assert short.tracks["unsent"].max() == 0
    assert short.tracks["packet_bytes"].max() > 0


@pytest.mark.parametrize(
    ("attribute", "value", "says"),
    [
        ("takes_ranges", "yes", "takes_ranges of a navigator is yes, not True or False"),
        ("needs_delivery_oracle", 3.5, "needs_delivery_oracle of a navigator is 3.5"),
        ("uses", 7, "uses of a navigator is 7, not names of event kinds"),
        ("uses", ["fix", "smell"], 'names "smell", no kind of event'),
    ],
)
def test_a_profile_that_is_none_is_refused(attribute: str, value: Any, says: str) -> None:
    spoilt = type("Spoilt", (Short,), {attribute: value})
    with pytest.raises(ValueError, match=says):
        _run(spoilt)
