"""What a file is, by its content: names, and their suffixes, say what somebody meant."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from os import PathLike

__all__ = ["FileKind", "file_kind"]


@dataclass(frozen=True)
class FileKind:
    """A format, and what to do with a file of it where it is not read."""

    key: str
    """Short name for comparisons: "tiff", "bag", "s102", "netcdf4", "netcdf3", "esri-ascii", "text", …"""
    name: str
    """As a sentence names it: "a ROS 1 bag"."""
    advice: str = ""


_IMPORT = "`uwcoop import` makes a mission of it"
_EXPORT = "export its grid as GeoTIFF, or its soundings as CSV"
_STARTS: tuple[tuple[bytes, FileKind], ...] = (
    (b"II*\x00", FileKind("tiff", "a TIFF")),
    (b"MM\x00*", FileKind("tiff", "a TIFF")),
    (b"II+\x00", FileKind("tiff", "a BigTIFF")),
    (b"MM\x00+", FileKind("tiff", "a BigTIFF")),
    (b"CDF\x01", FileKind("netcdf3", "a NetCDF file")),
    (b"CDF\x02", FileKind("netcdf3", "a NetCDF file")),
    (b"CDF\x05", FileKind("cdf5", "a NetCDF file of 64-bit data (CDF-5)", "copy it with `nccopy -k nc4`")),
    (b"#ROSBAG V", FileKind("ros1-bag", "a ROS 1 bag", _IMPORT)),
    (b"\x89MCAP0\r\n", FileKind("mcap", "an MCAP recording", "`uwcoop run` or `uwcoop import` reads it")),
    (b"SQLite format 3\x00", FileKind("sqlite", "an SQLite database (a ROS 2 bag or a GeoPackage)", _IMPORT)),
    (
        b"PK\x03\x04",
        FileKind("zip", "a ZIP archive (or an Excel sheet)", "unpack it, or save the sheet as CSV"),
    ),
    (b"%PDF", FileKind("pdf", "a PDF", "it holds pictures of a chart, no depths")),
    (b"\x89PNG", FileKind("png", "a PNG picture", "it holds colours, no depths")),
    (b"\xff\xd8\xff", FileKind("jpeg", "a JPEG picture", "it holds colours, no depths")),
    (b"GIF8", FileKind("gif", "a GIF picture", "it holds colours, no depths")),
    (b"\x00\x00\x00\x0cjP  ", FileKind("jp2", "a JPEG 2000 picture", _EXPORT)),
    (b"LASF", FileKind("las", "a LAS point cloud", "export its points as CSV")),
    (b"\x00\x00\x27\x0a", FileKind("shapefile", "a Shapefile", "export its soundings as CSV")),
    (b"GRIB", FileKind("grib", "a GRIB file", _EXPORT)),
    (b"DSBB", FileKind("surfer", "a Surfer grid", _EXPORT)),
    (b"DSRB", FileKind("surfer", "a Surfer grid", _EXPORT)),
    (b"DSAA", FileKind("surfer", "a Surfer grid", _EXPORT)),
    (b"MATLAB 5.0 MAT-file", FileKind("matlab", "a MATLAB file", _EXPORT)),
    (b"\x1f\x9d", FileKind("compress", "a file packed by compress", "unpack it")),
    (b"BZh", FileKind("bzip2", "a file packed by bzip2", "unpack it")),
    (b"\xfd7zXZ\x00", FileKind("xz", "a file packed by xz", "unpack it")),
    (b"7z\xbc\xaf", FileKind("7z", "a 7-Zip archive", "unpack it")),
    (b"(\xb5/\xfd", FileKind("zstd", "a file packed by Zstandard", "unpack it")),
)
_HDF5 = b"\x89HDF\r\n\x1a\n"
_TEXT = FileKind("text", "a text file")
_ASCII_KEYS = (
    "ncols",
    "nrows",
    "xllcorner",
    "xllcenter",
    "yllcorner",
    "yllcenter",
    "cellsize",
    "dx",
    "dy",
    "nodata_value",
)


def file_kind(path: str | PathLike[str]) -> FileKind:
    """The kind of a file by its first bytes; HDF5 files by the groups in them; "text" for all else.

    Raises:
        OSError: the file cannot be opened.
    """
    with Path(path).open("rb") as stream:
        start = stream.read(512)
    for mark, kind in _STARTS:
        if start.startswith(mark):
            return kind
    if start.startswith(_HDF5):
        return _hdf5_kind(path)
    if start.startswith(b"\x1f\x8b"):
        return _gzip_kind(path)
    return _text_kind(start)


def _hdf5_kind(path: str | PathLike[str]) -> FileKind:
    import h5py

    damaged = FileKind("hdf5", "an HDF5 file that is cut off or damaged")
    try:
        with h5py.File(path, "r") as file:
            groups = set(file)
    except (OSError, RuntimeError, ValueError, KeyError, MemoryError):
        return damaged
    if "BAG_root" in groups:
        return FileKind("bag", "a BAG")
    if "BathymetryCoverage" in groups:
        return FileKind("s102", "an S-102 file")
    for coverage in ("WaterLevel", "SurfaceCurrent", "QualityOfBathymetryCoverage"):
        if coverage in groups:
            return FileKind("s100", f"an S-100 file of {coverage}", "it holds no depths")
    return FileKind("netcdf4", "a NetCDF file")


def _gzip_kind(path: str | PathLike[str]) -> FileKind:
    import gzip
    import zlib

    try:
        with gzip.open(path) as stream:
            start = stream.read(512)
    except (OSError, EOFError, zlib.error):
        return _TEXT  # the reader of text tables says what is wrong with it
    kinds = [kind for mark, kind in _STARTS if start.startswith(mark)]
    if start.startswith(_HDF5):
        kinds = [FileKind("hdf5", "an HDF5 file")]
    if not kinds and _text_kind(start).key == "text":
        return _TEXT
    inside = kinds[0] if kinds else _text_kind(start)
    return FileKind("gzip", f"a gzip archive of {inside.name}", "unpack it")


def _text_kind(start: bytes) -> FileKind:
    head = start.removeprefix(b"\xef\xbb\xbf").lstrip()
    words = head.split(None, 2)
    if len(words) > 1 and words[0].lower().decode("ascii", "replace") in _ASCII_KEYS:
        return FileKind("esri-ascii", "an ESRI ASCII grid")
    if head.lower().startswith(b"<vrtdataset"):
        return FileKind(
            "vrt", "a GDAL virtual raster, which names other files", "give the files that it names"
        )
    if head.startswith(b"<"):
        return FileKind(
            "xml", "an XML or HTML document", "it holds no table; was a web page saved in place of the file?"
        )
    if head.startswith((b"{", b"[")):
        return FileKind("json", "a JSON document", "export its soundings as CSV")
    if head.startswith((b"AUTO", b"!LSF", b"%% LOG FILE:")):
        return FileKind("alog", "a MOOS log", _IMPORT)
    if head.startswith(b"version https://git-lfs"):
        return FileKind("git-lfs", "a Git LFS pointer, not the file itself", "fetch it with `git lfs pull`")
    return _TEXT
