"""What `--vary` says: values of a key one by one, evenly spaced, or drawn from a range together with other keys."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from uwcoop.errors import ScenarioError
from uwcoop.scenario.loading import alternatives

__all__ = ["Range", "Sweep", "latin_hypercube", "sweep_of"]

_CALL = re.compile(r"(uniform|loguniform|integers|linspace)\s*\(([^()]*)\)\s*(?:\|\s*lhs\s*\(\s*(\d+)\s*\))?")
_DIGITS = 6
"""Of a drawn value: enough for a sweep, and short enough for a table."""
_MOST = 100_000


@dataclass(frozen=True)
class Range:
    """The numbers that a key is drawn from."""

    low: float
    high: float
    kind: str = "uniform"
    """uniform, loguniform (uniform in the logarithm), or integers (both ends included)."""

    def __post_init__(self) -> None:
        if not (math.isfinite(self.low) and math.isfinite(self.high) and self.low < self.high):
            raise ScenarioError(
                f"{self.kind}({self.low:g}, {self.high:g}): must be from a lower to a higher number"
            )
        if self.kind == "loguniform" and self.low <= 0:
            raise ScenarioError(f"loguniform({self.low:g}, {self.high:g}): must be above 0")
        if self.kind == "integers" and not (self.low == int(self.low) and self.high == int(self.high)):
            raise ScenarioError(f"integers({self.low:g}, {self.high:g}): must be whole numbers")

    def at(self, share: float) -> float | int:
        """The value below which this share of the range lies."""
        if self.kind == "integers":
            return min(int(self.high), int(self.low) + int(share * (self.high - self.low + 1)))
        if self.kind == "loguniform":
            value = math.exp(math.log(self.low) + share * (math.log(self.high) - math.log(self.low)))
        else:
            value = self.low + share * (self.high - self.low)
        return min(max(float(f"{value:.{_DIGITS}g}"), self.low), self.high)


@dataclass(frozen=True)
class Sweep:
    """What a study varies: every combination of `grid`, each with every one of `samples`."""

    grid: Mapping[str, list[Any]]
    """Values by dotted key."""
    samples: list[dict[str, Any]]
    """Values of keys that are drawn together; empty: none are."""


def latin_hypercube(ranges: Mapping[str, Range], count: int) -> list[dict[str, Any]]:
    """Samples of several keys: of each key's range cut into `count` parts of the same probability, each part is hit once
    (McKay, Beckman and Conover 1979). The same for the same number of keys and samples.

    Raises:
        ScenarioError: fewer than 2 samples, more than 100,000, or more than there are different ones.
    """
    if not 2 <= count <= _MOST:
        raise ScenarioError(f"lhs({count}): must be 2 to {_MOST} samples")
    rng = np.random.default_rng([count, len(ranges)])
    shares = [(rng.permutation(count) + rng.random(count)) / count for _ in ranges]
    samples = [
        {key: each.at(float(share[k])) for (key, each), share in zip(ranges.items(), shares, strict=True)}
        for k in range(count)
    ]
    if len({tuple(sample.values()) for sample in samples}) < count:
        raise ScenarioError(
            f"lhs({count}): two samples are the same, {', '.join(ranges)} take too few values for so many"
        )
    return samples


def sweep_of(texts: Iterable[str]) -> Sweep:
    """The sweep of several "dotted.key=…": "v1,v2", "linspace(a, b, n)", or "uniform(a, b)|lhs(n)", which draws n values;
    also "loguniform(a, b)|lhs(n)" and "integers(a, b)|lhs(n)". All keys that are drawn are drawn together.

    Raises:
        ScenarioError: not of this form; a key twice; numbers of samples that differ.
    """
    grid: dict[str, list[Any]] = {}
    ranges: dict[str, Range] = {}
    counts: dict[str, int] = {}
    for text in texts:
        key, _, stated = (part.strip() for part in text.partition("="))
        if key in grid or key in ranges:
            raise ScenarioError(f"{key} is varied twice: must be once")
        call = _CALL.fullmatch(stated)
        if call is None:
            dotted, grid_values = alternatives(text)
            grid[dotted] = grid_values
        elif call[1] == "linspace":
            grid[key] = _spaced(text, call)
        else:
            low, high = _numbers(text, call[2], 2)
            ranges[key] = Range(low, high, call[1])
            if call[3] is None:
                raise ScenarioError(f"{text!r}: must say how many values are drawn: {stated}|lhs(20)")
            counts[key] = int(call[3])
    if len(set(counts.values())) > 1:
        said = ", ".join(f"{key} {count}" for key, count in counts.items())
        raise ScenarioError(f"keys are drawn together, with as many samples each: {said}")
    return Sweep(grid, latin_hypercube(ranges, next(iter(counts.values()))) if counts else [])


def _spaced(text: str, call: re.Match[str]) -> list[Any]:
    low, high, count = _numbers(text, call[2], 3)
    if call[3] is not None or count != int(count) or not 2 <= count <= _MOST:
        raise ScenarioError(f"{text!r}: linspace(a, b, n) takes 2 to {_MOST} values and no lhs")
    return [float(f"{value:.{_DIGITS}g}") for value in np.linspace(low, high, int(count))]


def _numbers(text: str, listed: str, count: int) -> list[float]:
    try:
        numbers = [float(part) for part in listed.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != count or not all(map(math.isfinite, numbers)):
        raise ScenarioError(f"{text!r}: needs {count} numbers in the brackets")
    return numbers
