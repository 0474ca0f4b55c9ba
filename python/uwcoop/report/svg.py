"""Pictures of a study's report as inline SVG: no library, no other file, readable in a browser of any year."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING

import numpy as np

from uwcoop.figures.boxes import box_statistics
from uwcoop.figures.style import OKABE_ITO

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

__all__ = ["bars", "boxes", "lines", "points"]

_LEFT, _RIGHT, _TOP, _BOTTOM = 62.0, 14.0, 12.0, 40.0
_LOG_ABOVE = 12.0
"""A vertical axis whose values differ by more than this factor is logarithmic."""
_MOST_POINTS = 1500


@dataclass(frozen=True)
class _Axis:
    """A range of numbers on a stretch of the picture."""

    low: float
    high: float
    start: float
    end: float
    log: bool = False

    def at(self, value: float) -> float:
        low, high, value = (
            (math.log(self.low), math.log(self.high), math.log(max(value, self.low)))
            if self.log
            else (self.low, self.high, value)
        )
        share = min(max((value - low) / (high - low), 0.0), 1.0)
        return self.start + share * (self.end - self.start)

    def ticks(self) -> list[float]:
        if not self.log:
            step = 10 ** math.floor(math.log10((self.high - self.low) / 4))
            step *= next(m for m in (1, 2, 5, 10) if (self.high - self.low) / (step * m) <= 6)
            first = math.ceil(self.low / step)
            return [k * step for k in range(first, math.floor(self.high / step + 1e-9) + 1)]
        decades = range(math.floor(math.log10(self.low)), math.ceil(math.log10(self.high)) + 1)
        every = [m * 10.0**k for k in decades for m in ((1, 2, 5) if len(decades) < 5 else (1,))]
        return [tick for tick in every if self.low <= tick <= self.high]


def colour(k: int) -> str:
    """Of the k-th navigator."""
    return OKABE_ITO[k % len(OKABE_ITO)]


def boxes(groups: Mapping[str, Mapping[str, Floats]], label: str) -> str:
    """Boxes of values: a group for each variant, in it a box for each navigator; quartiles, median, whiskers to the last
    value within 1.5 box heights, circles beyond, the median as a number."""
    names = list(dict.fromkeys(name for group in groups.values() for name in group))
    every = [values for group in groups.values() for values in group.values() if values.size]
    width = max(420.0, _LEFT + _RIGHT + len(groups) * (len(names) * 46.0 + 26.0))
    height = 300.0
    y = _vertical(every, height)
    parts = _frame(width, height, y, label)
    share = (width - _LEFT - _RIGHT) / len(groups)
    for g, (title, group) in enumerate(groups.items()):
        start = _LEFT + g * share
        step = share / (len(names) + 0.6)
        for k, name in enumerate(names):
            values = group.get(name)
            if values is not None and values.size:
                parts += _box(
                    values, start + (k + 0.8) * step, min(30.0, 0.62 * step), y, k, f"{title} {name}"
                )
        parts.append(
            _text(
                start + share / 2,
                height - 22,
                title if len(title) < 2 + share / 6 else f"{title[: int(share / 6)]}…",
            )
        )
        if g:
            parts.append(
                f'<line x1="{start:.1f}" x2="{start:.1f}" y1="{_TOP}" y2="{height - _BOTTOM}" class="grid"/>'
            )
    return _svg(width, height, parts)


def _box(values: Floats, x: float, width: float, y: _Axis, k: int, title: str) -> list[str]:
    found = box_statistics(values)
    low, q1, middle, q3, high = (
        y.at(min(found[key], y.high)) for key in ("whislo", "q1", "med", "q3", "whishi")
    )
    half = width / 2
    parts = [
        f"<g><title>{escape(title)}: median {number(found['med'])}, quartiles {number(found['q1'])} to "
        f"{number(found['q3'])}, {values.size} values</title>",
        f'<path d="M{x:.1f} {low:.1f}V{q1:.1f}M{x:.1f} {q3:.1f}V{high:.1f}M{x - half / 2:.1f} {low:.1f}h{half:.1f}'
        f'M{x - half / 2:.1f} {high:.1f}h{half:.1f}" class="ink"/>',
        f'<rect x="{x - half:.1f}" y="{q3:.1f}" width="{width:.1f}" height="{max(q1 - q3, 0.5):.1f}" '
        f'fill="{colour(k)}" fill-opacity="0.5" class="ink"/>',
        f'<path d="M{x - half:.1f} {middle:.1f}h{width:.1f}" class="ink" stroke-width="2"/>',
    ]
    for value in found["fliers"][:200]:
        at = y.at(min(float(value), y.high))
        parts.append(f'<circle cx="{x:.1f}" cy="{at:.1f}" r="2.2" fill="none" stroke="{colour(k)}"/>')
    parts.append(_text(x, y.end - 2, number(found["med"]), size=10))
    return [*parts, "</g>"]


def bars(
    shares: Sequence[float], expected: float, band: tuple[float, float], edges: Sequence[str], k: int
) -> str:
    """A histogram with the height that is expected, and the band that holds 95 % of the bars of samples as large."""
    width, height = 320.0, 190.0
    y = _Axis(0.0, 1.15 * max(*shares, band[1]), height - _BOTTOM, _TOP)
    parts = _frame(width, height, y, "share of samples")
    step = (width - _LEFT - _RIGHT) / len(shares)
    top, bottom = y.at(band[1]), y.at(band[0])
    parts.append(
        f'<rect x="{_LEFT}" y="{top:.1f}" width="{width - _LEFT - _RIGHT:.1f}" height="{bottom - top:.1f}" class="band"/>'
    )
    for i, share in enumerate(shares):
        x, at = _LEFT + i * step, y.at(share)
        parts.append(
            f'<rect x="{x + 1:.1f}" y="{at:.1f}" width="{step - 2:.1f}" height="{y.start - at:.1f}" fill="{colour(k)}" '
            f'fill-opacity="0.75"><title>NEES {escape(edges[i])} to {escape(edges[i + 1])}: {share:.1%}</title></rect>'
        )
    for i, edge in enumerate(edges):
        if i % 2 == 0 or len(edges) < 8:
            parts.append(_text(_LEFT + i * step, height - 24, edge, size=10))
    at = y.at(expected)
    parts.append(
        f'<line x1="{_LEFT}" x2="{width - _RIGHT}" y1="{at:.1f}" y2="{at:.1f}" class="ink" stroke-dasharray="5 3"/>'
    )
    parts.append(_text((width + _LEFT) / 2, height - 6, "NEES, at equal shares of χ² (2)", size=10))
    return _svg(width, height, parts)


def lines(series: Mapping[str, tuple[Floats, Floats, Floats]], x_label: str, y_label: str) -> str:
    """Lines over 1, 2, 3 …, each with the band between a lower and an upper one."""
    width, height = 640.0, 260.0
    size = max(len(middle) for middle, _, _ in series.values())
    x = _Axis(1.0, max(2.0, float(size)), _LEFT, width - _RIGHT)
    # The first few means scatter widely: the axis is that of the later ones.
    y = _vertical([part[min(4, len(part) - 1) :] for three in series.values() for part in three], height)
    parts = [*_frame(width, height, y, y_label), *_x_ticks(x, height, x_label)]
    for k, (name, (middle, low, high)) in enumerate(series.items()):
        known = [i for i in range(len(middle)) if math.isfinite(low[i] + high[i])]
        edge = [f"{x.at(i + 1):.1f},{y.at(high[i]):.1f}" for i in known]
        edge += [f"{x.at(i + 1):.1f},{y.at(low[i]):.1f}" for i in reversed(known)]
        path = " ".join(f"{x.at(i + 1):.1f},{y.at(v):.1f}" for i, v in enumerate(middle) if math.isfinite(v))
        parts.append(f'<polygon points="{" ".join(edge)}" fill="{colour(k)}" fill-opacity="0.15"/>')
        parts.append(
            f'<polyline points="{path}" fill="none" stroke="{colour(k)}" stroke-width="2">'
            f"<title>{escape(name)}</title></polyline>"
        )
    return _svg(width, height, parts)


def points(series: Mapping[str, tuple[Floats, Floats]], x_label: str, y_label: str) -> str:
    """Points of each navigator; with more than 1,500 every n-th is drawn."""
    width, height = 640.0, 260.0
    every_x = np.concatenate([x for x, _ in series.values()])
    low, high = float(every_x.min()), float(every_x.max())
    x = _Axis(low, high if high > low else low + 1, _LEFT + 8, width - _RIGHT - 8)
    y = _vertical([values for _, values in series.values()], height)
    parts = [*_frame(width, height, y, y_label), *_x_ticks(x, height, x_label)]
    every = max(1, math.ceil(every_x.size / _MOST_POINTS))
    for k, (xs, ys) in enumerate(series.values()):
        for at, value in list(zip(xs, ys, strict=True))[::every]:
            if math.isfinite(value):
                shift = (k - (len(series) - 1) / 2) * 4
                parts.append(
                    f'<circle cx="{x.at(float(at)) + shift:.1f}" cy="{y.at(float(value)):.1f}" r="2.4" '
                    f'fill="{colour(k)}" fill-opacity="0.6"/>'
                )
    return _svg(width, height, parts)


def number(value: float) -> str:
    """Three digits."""
    if not math.isfinite(value):
        return "∞" if value > 0 else "–"
    digits = 0 if abs(value) >= 99.95 else 1 if abs(value) >= 9.995 else 2
    text = f"{value:.{digits}f}" if abs(value) >= 0.0995 or value == 0 else f"{value:.2g}"
    return text.replace("-", "−", 1) if text.startswith("-") else text


def _vertical(columns: Sequence[Floats], height: float) -> _Axis:
    finite = np.concatenate([values[np.isfinite(values)] for values in columns] or [np.zeros(0)])
    positive = finite[finite > 0]
    if not positive.size:
        return _Axis(0.0, 1.0, height - _BOTTOM, _TOP + 14)
    middles = [
        float(np.median(v[np.isfinite(v) & (v > 0)])) for v in columns if (np.isfinite(v) & (v > 0)).any()
    ]
    if max(middles) > _LOG_ABOVE * min(middles) or float(positive.max()) > _LOG_ABOVE * float(
        np.median(positive)
    ):
        low = max(float(positive.min()) / 1.3, float(positive.max()) / 1e6)
        return _Axis(low, 1.3 * float(positive.max()), height - _BOTTOM, _TOP + 14, log=True)
    return _Axis(0.0, 1.05 * float(positive.max()), height - _BOTTOM, _TOP + 14)


def _frame(width: float, height: float, y: _Axis, label: str) -> list[str]:
    parts = []
    for tick in y.ticks():
        at = y.at(tick)
        parts.append(f'<line x1="{_LEFT}" x2="{width - _RIGHT}" y1="{at:.1f}" y2="{at:.1f}" class="grid"/>')
        parts.append(_text(_LEFT - 6, at + 4, f"{tick:.6g}", anchor="end", size=10))
    middle = (y.start + y.end) / 2
    parts.append(
        f'<text transform="translate(14 {middle:.1f}) rotate(-90)" text-anchor="middle" font-size="11">'
        f"{escape(label)}</text>"
    )
    parts.append(f'<path d="M{_LEFT} {y.end:.1f}V{y.start:.1f}H{width - _RIGHT}" class="ink"/>')
    return parts


def _x_ticks(x: _Axis, height: float, label: str) -> list[str]:
    parts = [_text(x.at(tick), height - 24, f"{tick:.6g}".replace("-", "−"), size=10) for tick in x.ticks()]
    return [*parts, _text((x.start + x.end) / 2, height - 6, label)]


def _text(x: float, y: float, text: str, *, anchor: str = "middle", size: int = 11) -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" font-size="{size}">{escape(text)}</text>'


def _svg(width: float, height: float, parts: Sequence[str]) -> str:
    return (
        f'<svg viewBox="0 0 {width:.0f} {height:.0f}" width="{width:.0f}" height="{height:.0f}" role="img">'
        + "".join(parts)
        + "</svg>"
    )
