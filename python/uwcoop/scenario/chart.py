"""The `[chart]` table: which seabed, and how to read it."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from uwcoop.scenario.base import NonNegative, Positive, Table

SYNTHETIC = "synthetic:"


class ChartSpec(Table):
    """A synthetic seabed by name, or a chart file with the options of `load_chart`.

    The seed of a synthetic chart is its own: missions vary over one seabed.
    """

    source: str
    """"synthetic:NAME", or a path (relative to the scenario file)."""
    seed: Annotated[int, Field(ge=0)] | None = None
    """Seed of a synthetic seabed."""
    relief: NonNegative | None = None
    """Factor on every depth's deviation from the mean depth of a synthetic seabed."""
    crs: str | None = None
    positive: Literal["up", "down"] | None = None
    depth_unit: Literal["m", "ft", "fathom"] | None = None
    columns: str | Annotated[tuple[str, ...], Field(strict=False)] | None = None
    cell_m: Positive | None = None
    max_gap_m: Positive | None = None
    sigma_map_m: NonNegative | None = None
    correlation_length_m: NonNegative | None = None

    @property
    def synthetic(self) -> str | None:
        """Name of the synthetic seabed, or None for a file."""
        return self.source.removeprefix(SYNTHETIC) if self.source.startswith(SYNTHETIC) else None

    def options(self) -> dict[str, Any]:
        """What the author set, beside the source: keyword arguments for the maker of the chart."""
        given = self.model_dump(exclude={"source"})
        return {key: value for key, value in given.items() if value is not None}

    @model_validator(mode="after")
    def _keys_fit_the_source(self) -> ChartSpec:
        of_synthetic = {"seed", "relief"}
        wrong = (
            {key for key in self.options() if key not in of_synthetic}
            if self.synthetic is not None
            else of_synthetic & self.options().keys()
        )
        if wrong:
            kind = "a chart file" if self.synthetic is not None else "a synthetic chart"
            raise ValueError(
                f"{', '.join(sorted(wrong))} can only be given for {kind}, not for {self.source!r}"
            )
        return self
