"""ESRI ASCII grids in the dialects that programs write: keys in any order, blanks before them, decimal commas.

GDAL wants the keys in one order at the very start of the file; GIS programs do not.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop.charts.grid_source import GridSource, Reading, check_axes, stated_crs
from uwcoop.charts.vertical import Stated
from uwcoop.errors import ChartError
from uwcoop.frames import crs_of

if TYPE_CHECKING:
    from io import BufferedReader
    from pathlib import Path

    from numpy.typing import NDArray

_KEYS = {
    "ncols", "nrows", "xllcorner", "xllcenter", "yllcorner", "yllcenter", "cellsize", "dx", "dy", "nodata_value",
}  # fmt: skip
_BLOCK = 1 << 20
_LONGEST_NUMBER = 64
_HEADER_BYTES = 4096


@contextmanager
def open_esri_ascii(path: Path, reading: Reading) -> Iterator[GridSource]:
    """A grid of text: rows from the north, values in any number of lines.

    Raises:
        ChartError: a key that is missing or impossible, values that are no numbers or not as many as declared.
    """
    with path.open("rb") as stream:
        keys, start = _header(stream.read(_HEADER_BYTES), path.name)
        cols, rows = (_count(keys, name, path.name) for name in ("ncols", "nrows"))
        check_axes(path.name, rows, cols)
        dx, dy = (_size(keys, name, path.name) for name in ("dx", "dy"))
        west, south = (_corner(keys, axis, size, path.name) for axis, size in (("x", dx), ("y", dy)))
        nodata = keys.get("nodata_value")

        def read(wanted_rows: slice, wanted_cols: slice) -> tuple[NDArray[np.float64], None]:
            stream.seek(start)
            values = _values(stream, path.name, (rows, cols), wanted_rows, wanted_cols)
            return np.where(values == nodata, np.nan, values) if nodata is not None else values, None

        crs, notes = stated_crs(reading.crs, lambda: _sidecar(path), path.name)
        yield GridSource(
            name=path.name,
            x=west + dx * np.arange(cols),
            y=south + dy * np.arange(rows)[::-1],
            crs=crs,
            stated=Stated(),
            read=read,
            notes=notes,
        )


def _header(content: bytes, name: str) -> tuple[dict[str, float], int]:
    """The keys with their values, and where the numbers begin."""
    keys: dict[str, float] = {}
    start = 3 if content.startswith(b"\xef\xbb\xbf") else 0
    while True:
        end = content.find(b"\n", start)
        line = content[start : end if end >= 0 else len(content)].decode("ascii", "replace").split()
        key = line[0].lower() if line else ""
        if line and key not in _KEYS:
            return keys, start
        if end < 0:
            raise ChartError(f"{name} has no values below its header")
        if line:
            text = line[1].replace(",", ".") if len(line) == 2 else ""
            try:
                keys[key] = float(text)
            except ValueError as error:
                raise ChartError(f"{name}: {key} is {' '.join(line[1:])[:40]!r}, not a number") from error
            if key != "nodata_value" and not np.isfinite(keys[key]):
                raise ChartError(f"{name}: {key} {text} must be finite")
        start = end + 1


def _count(keys: dict[str, float], key: str, name: str) -> int:
    count = keys.get(key)
    if count is None:
        raise ChartError(f"{name} has no {key}")
    if count != int(count) or count < 1:
        raise ChartError(f"{name}: {key} {count:g} must be a whole number above 0")
    return int(count)


def _size(keys: dict[str, float], key: str, name: str) -> float:
    size = keys.get(key, keys.get("cellsize"))
    if size is None:
        raise ChartError(f"{name} has no cellsize")
    if not size > 0:
        raise ChartError(f"{name}: cellsize {size:g} must be above 0")
    return size


def _corner(keys: dict[str, float], axis: str, size: float, name: str) -> float:
    """The position of the south-western node, which lies in the middle of its cell."""
    if f"{axis}llcenter" in keys:
        return keys[f"{axis}llcenter"]
    if f"{axis}llcorner" in keys:
        return keys[f"{axis}llcorner"] + size / 2
    raise ChartError(f"{name} has neither {axis}llcorner nor {axis}llcenter")


def _values(
    stream: BufferedReader, name: str, shape: tuple[int, int], rows: slice, cols: slice
) -> NDArray[np.float64]:
    """The values of a part of the grid; the file is read once, block by block, and only that part kept."""
    wanted = np.full((rows.stop - rows.start, cols.stop - cols.start), np.nan)
    width = shape[1]
    first, last = rows.start * width, rows.stop * width
    at = 0
    for block in _blocks(stream, name):
        low, high = max(at, first), min(at + block.size, last)
        if low < high:
            node = np.arange(low, high)
            row, col = node // width - rows.start, node % width
            inside = (col >= cols.start) & (col < cols.stop)
            wanted[row[inside], col[inside] - cols.start] = block[low - at : high - at][inside]
        at += block.size
        if at > shape[0] * width:
            break
    if at != shape[0] * width:
        found = "more" if at > shape[0] * width else f"{at:,}"
        raise ChartError(f"{name} declares {shape[0]:,} x {width:,} values and holds {found}: it is damaged")
    return wanted


def _blocks(stream: BufferedReader, name: str) -> Iterator[NDArray[np.float64]]:
    rest = b""
    while True:
        block = stream.read(_BLOCK)
        words = (rest + block).split()
        # The last word may go on in the next block.
        rest = words.pop() if block and words and not block[-1:].isspace() else b""
        if len(rest) > _LONGEST_NUMBER:
            raise ChartError(f"{name} holds {rest[:20]!r}, not a number")
        try:
            yield np.array(words, dtype="S").astype(np.float64) if words else np.zeros(0)
        except ValueError:
            yield _with_commas(words, name)
        if not block:
            return


def _with_commas(words: list[bytes], name: str) -> NDArray[np.float64]:
    """Numbers with decimal commas."""
    numbers = np.empty(len(words))
    for k, word in enumerate(words):
        try:
            numbers[k] = float(word.replace(b",", b"."))
        except ValueError as error:
            raise ChartError(
                f"{name} holds {word[:40].decode('ascii', 'replace')!r}, not a number"
            ) from error
    return numbers


def _sidecar(path: Path) -> Any:
    """The projection in the .prj file beside the grid; None where there is none."""
    beside = next((p for p in (path.with_suffix(".prj"), path.with_suffix(".PRJ")) if p.is_file()), None)
    if beside is None:
        return None
    with beside.open("rb") as stream:
        return crs_of(stream.read(1 << 16).decode("utf-8", "replace").strip())
