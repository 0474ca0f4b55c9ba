"""The `[chart]` table: which seabed, how to read it, and how the chart that navigators get differs from it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field, model_validator

from uwcoop.scenario.base import NonNegative, Positive, Table

if TYPE_CHECKING:
    from uwcoop.charts.survey import SurveyPlan

SYNTHETIC = "synthetic:"


Seed = Annotated[int, Field(ge=0, le=2**63 - 1)]


class _Drawn(Table):
    """What is drawn once for all missions, or anew for each."""

    seed: Seed = 0
    """Of its own: missions vary over one draw."""
    each_mission: bool = False
    """Draw anew for each mission, by this seed and the mission's."""


class Survey(_Drawn):
    """`[chart.survey]`: vehicles sound the source's seabed; navigators get a chart made by surveying it."""

    surveys: Annotated[int, Field(ge=1, le=20)] = 3
    """Lawn mowers over the whole seabed, each with a datum of its own; they judge each other."""
    line_spacing_m: Positive = 40.0
    """Between the lines of one survey."""
    heading_deg: float = 20.0
    """Of the first survey's lines, clockwise from north."""
    turn_deg: float = 90.0
    """How much further each next survey's lines are turned: crossing lines can be aligned."""
    speed_mps: Positive = 2.0
    interval_s: Positive = 1.0
    """Between soundings."""
    position_sigma_m: NonNegative = 3.0
    """Horizontal error on each axis, slowly varying along the track."""
    position_time_s: Positive = 120.0
    """After this time that error's correlation is 1/e."""
    segment_s: Positive = 900.0
    """So long does a shift of the positions hold."""
    segment_sigma_m: NonNegative = 4.0
    """Of that shift, on each axis."""
    segment_max_m: NonNegative = 15.0
    """No shift is longer."""
    sounding_sigma_m: NonNegative = 0.1
    """White, each sounding."""
    datum_sigma_m: NonNegative = 0.2
    """Of each survey's datum: tide and draught not quite removed."""
    cell_m: Positive | None = 2.0
    """Of the chart."""
    max_gap_m: Positive | None = None
    """Holes of the chart are farther than this from every sounding; default 10 m, or two cells."""
    align: bool = False
    """Shift segments of 900 s until crossing soundings agree, before gridding."""
    error_by_slope: bool = False
    """The chart's stated error grows with its slope, as the residuals do; else it is one sigma everywhere."""

    def plan(self) -> SurveyPlan:
        """The plan without its seeds."""
        from uwcoop.charts.survey import SurveyPlan

        return SurveyPlan(**self.model_dump(exclude={"seed", "each_mission"}))


class Seabed(_Drawn):
    """`[chart.seabed]`: navigators get the source's chart; vehicles sound a seabed drawn from the error that
    the chart states (`sigma_map_m`, per node or one, and `correlation_length_m`)."""


class ChartSpec(Table):
    """A synthetic seabed by name, or a chart file with the options of `load_chart`.

    The seed of a synthetic chart is its own: missions vary over one seabed. Without `survey` or `seabed`, what
    vehicles sound and what navigators get are the same.
    """

    source: str
    """"synthetic:NAME", or a path (relative to the scenario file)."""
    seed: Seed | None = None
    """Seed of a synthetic seabed."""
    relief: NonNegative | None = None
    """Factor on every depth's deviation from the mean depth of a synthetic seabed."""
    crs: str | None = None
    positive: Literal["up", "down"] | None = None
    depth_unit: Literal["m", "ft", "fathom"] | None = None
    nodata: float | None = None
    """A number of the file that means "no data", where it does not say so."""
    area: str | Annotated[tuple[float, float, float, float], Field(strict=False)] | None = None
    """Latitude and longitude of two opposite corners, degrees: only this part of the file is read."""
    margin_m: NonNegative | None = None
    """Around the mission's paths and tracks, where the file is read for these alone because it is too large to be
    read whole; default 500 m."""
    columns: str | Annotated[tuple[str, ...], Field(strict=False)] | None = None
    cell_m: Positive | None = None
    max_gap_m: Positive | None = None
    sigma_map_m: NonNegative | None = None
    correlation_length_m: NonNegative | None = None
    align: bool | None = None
    error_by_slope: bool | None = None
    survey: Survey | None = None
    seabed: Seabed | None = None

    @property
    def synthetic(self) -> str | None:
        """Name of the synthetic seabed, or None for a file."""
        return self.source.removeprefix(SYNTHETIC) if self.source.startswith(SYNTHETIC) else None

    def options(self) -> dict[str, Any]:
        """What the author set, beside the source: keyword arguments for the maker of the chart."""
        given = self.model_dump(exclude={"source", "survey", "seabed", "margin_m"})
        return {key: value for key, value in given.items() if value is not None}

    @model_validator(mode="after")
    def _one_difference(self) -> ChartSpec:
        if self.survey is not None and self.seabed is not None:
            raise ValueError(
                "has both survey and seabed: the chart is made from the seabed, or the other way"
            )
        return self

    @model_validator(mode="after")
    def _keys_fit_the_source(self) -> ChartSpec:
        of_synthetic = {"seed", "relief"}
        wrong = (
            {key for key in self.options() if key not in of_synthetic}
            if self.synthetic is not None
            else of_synthetic & self.options().keys()
        )
        if self.synthetic is not None and self.margin_m is not None:
            wrong = wrong | {"margin_m"}
        if wrong:
            kind = "a chart file" if self.synthetic is not None else "a synthetic chart"
            raise ValueError(
                f"{', '.join(sorted(wrong))} can only be given for {kind}, not for {self.source!r}"
            )
        return self
