"""A study's rows as a Parquet table, beside the CSV: typed columns for pandas, Polars, DuckDB."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from uwcoop.errors import MissingDependencyError
from uwcoop.report.atomic_files import atomic_write

__all__ = ["write_rows"]


def write_rows(rows: Sequence[Mapping[str, Any]], columns: Mapping[str, type], path: Path) -> None:
    """Write rows with these columns; None becomes null. Columns of type str hold what is varied as text.

    Raises:
        MissingDependencyError: pyarrow is not installed.
        OSError: the file cannot be written.
    """
    try:
        import pyarrow as pa
        from pyarrow import parquet
    except ImportError:
        raise MissingDependencyError("pyarrow", "parquet") from None
    kinds = {int: pa.int64(), float: pa.float64(), str: pa.string()}
    schema = pa.schema([(name, kinds[kind]) for name, kind in columns.items()])
    table = pa.table({name: [row[name] for row in rows] for name in columns}, schema=schema)
    with atomic_write(path) as partial:
        parquet.write_table(table, partial, compression="zstd")
