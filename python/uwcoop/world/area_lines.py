"""Lawn mowers over a polygon: parallel lines, joined into paths that stay inside, shared among vehicles.

Lines are cut by the polygon into pieces. Pieces of neighbouring lines that face only each other form a cell, which is
driven back and forth; cells follow each other by distance (boustrophedon decomposition, Choset 2000, doi
10.1023/A:1008958800904). Between pieces a path takes the shortest way inside the polygon.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop.errors import MissingDependencyError, ScenarioError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Points = NDArray[np.float64]

MOST_LINES = 5000
MOST_CORNERS = 400
"""Of the polygon in which ways are searched: their cost grows with the square of it."""
_TOUCH_M = 1e-6
_PIECE_M = 1e-3
"""A shorter piece of a line is none."""


def survey_paths(
    polygon: Any, spacing_m: float, yaw_rad: float | None, margin_m: float, shares: Sequence[float]
) -> list[Points]:
    """Corners of one path for each share, (N, 2) east and north in metres.

    Args:
        polygon: shapely Polygon in local metres; holes are kept out of.
        spacing_m: between lines.
        yaw_rad: of the lines, counter-clockwise from east; None: along the longest side.
        margin_m: kept from the edge.
        shares: how the length of all lines is to be shared, in any unit.

    Raises:
        ScenarioError: a polygon that is not valid, has no room, or too few lines for so many shares.
    """
    shapely = _shapely()
    if not polygon.is_valid:
        from shapely.validation import explain_validity

        raise ScenarioError(f"area: the polygon is not valid: {explain_validity(polygon)}")
    yaw = _longest_side(polygon) if yaw_rad is None else yaw_rad
    inside = polygon.buffer(-margin_m, join_style="mitre") if margin_m else polygon
    inside = _turned(inside, -yaw)
    corners = shapely.get_num_coordinates(inside)
    if corners > MOST_CORNERS:
        inside = inside.simplify(spacing_m / 10)
        corners = shapely.get_num_coordinates(inside)
    if inside.is_empty or inside.geom_type != "Polygon":
        what = "nothing" if inside.is_empty else f"{len(inside.geoms)} pieces"
        raise ScenarioError(
            f"area: {what} left of the polygon at margin_m = {margin_m:g} m: must be one piece"
        )
    if corners > MOST_CORNERS:
        raise ScenarioError(f"area: the polygon has {corners} corners: simplify it to at most {MOST_CORNERS}")
    pieces = _in_order(_cells(_rows(inside, spacing_m)))
    parts = _shared(pieces, shares)
    ways = _Ways(inside)
    return [_rotated(_joined(part, ways), yaw) for part in parts]


def _shapely() -> Any:
    try:
        import shapely
    except ImportError as error:
        raise MissingDependencyError("shapely", "maps") from error
    return shapely


def _longest_side(polygon: Any) -> float:
    ring = np.asarray(polygon.exterior.coords)
    sides = np.diff(ring, axis=0)
    east, north = sides[np.argmax(np.hypot(*sides.T))]
    return math.atan2(north, east)


def _rotated(points: Points, angle_rad: float) -> Points:
    cosine, sine = math.cos(angle_rad), math.sin(angle_rad)
    return np.asarray(points @ np.array([[cosine, sine], [-sine, cosine]]))


def _turned(polygon: Any, angle_rad: float) -> Any:
    return _shapely().transform(polygon, lambda points: _rotated(points, angle_rad))


def _rows(polygon: Any, spacing_m: float) -> list[list[Points]]:
    """Pieces of each line, (2, 2) each from left to right, line by line."""
    shapely = _shapely()
    left, low, right, high = polygon.bounds
    count = max(1, math.ceil((high - low) / spacing_m - 1e-9))
    if count > MOST_LINES:
        raise ScenarioError(
            f"area: {count} lines of line_spacing_m = {spacing_m:g} over {high - low:,.0f} m: at most {MOST_LINES} fit"
        )
    first = low + (high - low - (count - 1) * spacing_m) / 2
    rows = []
    for k in range(count):
        y = first + k * spacing_m
        cut = shapely.intersection(polygon, shapely.linestrings([[left - 1.0, y], [right + 1.0, y]]))
        lines = [
            np.sort(np.asarray(part.coords)[:, 0])
            for part in shapely.get_parts(cut)
            if part.length > _PIECE_M
        ]
        rows.append([np.array([[xs[0], y], [xs[-1], y]]) for xs in sorted(lines, key=lambda xs: xs[0])])
    return rows


def _cells(rows: list[list[Points]]) -> list[list[Points]]:
    """Pieces that face only each other, one cell after another."""
    cells: list[list[Points]] = []
    last: list[tuple[Points, int]] = []
    for row in rows:
        faces = {
            k: [j for j, (piece, _) in enumerate(last) if _overlap(piece, row[k])] for k in range(len(row))
        }
        taken = [j for found in faces.values() for j in found]
        now: list[tuple[Points, int]] = []
        for k, piece in enumerate(row):
            alone = len(faces[k]) == 1 and taken.count(faces[k][0]) == 1
            if alone:
                cell = last[faces[k][0]][1]
                cells[cell].append(piece)
            else:
                cell = len(cells)
                cells.append([piece])
            now.append((piece, cell))
        last = now
    return cells


def _overlap(a: Points, b: Points) -> bool:
    return bool(a[0, 0] < b[1, 0] and b[0, 0] < a[1, 0])


def _in_order(cells: list[list[Points]]) -> list[Points]:
    """All pieces in driving order and direction: from the end of each cell to the nearest of the next."""
    left = list(cells)
    ordered: list[Points] = []
    while left:
        starts = [(k, cell if ahead else cell[::-1], flip) for k, cell in enumerate(left) for ahead in (True, False)
                  for flip in (False, True)]  # fmt: skip
        here = ordered[-1][1] if ordered else None

        def distance(start: tuple[int, list[Points], bool], here: Points | None = here) -> float:
            begin = start[1][0][1 if start[2] else 0]
            return 0.0 if here is None else float(np.hypot(*(begin - here)))

        k, cell, flip = min(starts, key=distance)
        for piece in cell:
            ordered.append(piece[::-1] if flip else piece)
            flip = not flip
        del left[k]
    return ordered


def _shared(pieces: list[Points], shares: Sequence[float]) -> list[list[Points]]:
    """Runs of pieces whose lengths are as the shares; a piece belongs to the run in which its middle lies."""
    lengths = np.array([np.hypot(*(piece[1] - piece[0])) for piece in pieces])
    middle = np.cumsum(lengths) - lengths / 2
    bounds = np.cumsum(shares) / np.sum(shares) * lengths.sum()
    owner = np.searchsorted(bounds, middle)
    parts = [
        [piece for piece, k in zip(pieces, owner, strict=True) if k == share] for share in range(len(shares))
    ]
    if any(not part for part in parts):
        raise ScenarioError(
            f"area: {len(pieces)} lines for {len(shares)} vehicles leave one without: give a smaller line_spacing_m"
        )
    return parts


def _joined(pieces: list[Points], ways: _Ways) -> Points:
    corners = [pieces[0][0], pieces[0][1]]
    for piece in pieces[1:]:
        corners += [*ways.between(corners[-1], piece[0])[1:], piece[1]]
    path = np.array(corners)
    far = np.concatenate([[True], np.hypot(*np.diff(path, axis=0).T) > _PIECE_M])
    return np.asarray(path[far])


class _Ways:
    """Shortest ways inside a polygon: straight, or along its corners."""

    def __init__(self, polygon: Any) -> None:
        self._shapely = _shapely()
        self._room = polygon.buffer(_TOUCH_M)
        self._shapely.prepare(self._room)
        rings = [polygon.exterior, *polygon.interiors]
        self._corners = np.concatenate([np.asarray(ring.coords)[:-1] for ring in rings])
        self._lengths: Points | None = None

    def between(self, start: Points, end: Points) -> list[Points]:
        """Points from start to end, both included."""
        if self._free(start[None], end[None])[0]:
            return [start, end]
        from scipy.sparse.csgraph import dijkstra

        nodes = np.vstack([self._corners, start, end])
        count = len(self._corners)
        if self._lengths is None:
            self._lengths = self._visible(self._corners, self._corners)
        lengths = np.zeros((count + 2, count + 2))
        lengths[:count, :count] = self._lengths
        lengths[count:, :count] = self._visible(nodes[count:], self._corners)
        _, found = dijkstra(lengths, directed=False, indices=[count], return_predecessors=True)
        before = found[0]
        path = [count + 1]
        while path[-1] != count and before[path[-1]] >= 0:
            path.append(int(before[path[-1]]))
        if path[-1] != count:
            raise ScenarioError("area: two lines have no way to each other inside the polygon: simplify it")
        return [nodes[k] for k in reversed(path)]

    def _visible(self, a: Points, b: Points) -> Points:
        """Lengths of the straight ways inside, (A, B); 0 where there is none."""
        i, j = (index.ravel() for index in np.meshgrid(np.arange(len(a)), np.arange(len(b)), indexing="ij"))
        distance = np.hypot(*(a[i] - b[j]).T)
        free = self._free(a[i], b[j]) & (distance > 0)
        return np.where(free, distance, 0.0).reshape(len(a), len(b))

    def _free(self, a: Points, b: Points) -> NDArray[np.bool_]:
        return np.asarray(
            self._shapely.covers(self._room, self._shapely.linestrings(np.stack([a, b], axis=1)))
        )


def path_length_m(corners: Points) -> float:
    """Length of a path, metres."""
    return float(sum(math.dist(a, b) for a, b in pairwise(corners.tolist())))
