"""The protocol of a navigator of one's own in Python, and what one is made from."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from uwcoop._native import Event
    from uwcoop.charts import Chart

__all__ = ["Context", "Custom", "PythonEstimate", "PythonNavigator"]


@dataclass(frozen=True)
class Context:
    """What one vehicle's navigator is made from: what that vehicle carries, and nothing about the others."""

    vehicle: int
    """Its index in the team."""
    vehicles: int
    """Size of the team."""
    sound_speed_mps: float
    """Sound speed that the team agreed on."""
    seed: int
    """Seed of the navigator's random streams; packaged navigators take its lowest 64 bits."""
    chart: Chart | None
    """The chart on board."""
    ranging: tuple[bool, ...] = ()
    """By vehicle, whether it uses ranges, as the team agreed; empty: all do."""


class PythonEstimate(Protocol):
    """What a navigator in Python answers: `mean_m` (2,) metres and `covariance_m2` (2, 2)."""

    @property
    def mean_m(self) -> ArrayLike: ...
    @property
    def covariance_m2(self) -> ArrayLike: ...


class PythonNavigator(Protocol):
    """A navigator of one's own. `handle` may answer "fused", "noted", "gated" or "rejected"; None means fused."""

    def handle(self, event: Event, /) -> str | None: ...
    def transmit(self, tol_ns: int, capacity_bytes: int, /) -> bytes | None: ...
    def estimate(self, t_ns: int, /) -> PythonEstimate: ...


@dataclass(frozen=True)
class Custom:
    """A navigator of one's own under a name, made once for each vehicle."""

    name: str
    make: Callable[[Context], PythonNavigator]
