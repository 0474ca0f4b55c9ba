"""Pictures by name, as the manifests ask for them; each from what was flown, for the navigators that it shows."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from uwcoop.errors import ScenarioError
from uwcoop.missionlog.labelled import Labelled, Variable

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["PICTURES", "draw"]


def draw(name: str, flown: Any, shows: tuple[str, ...]) -> Figure:
    """The picture.

    Raises:
        ScenarioError: no such picture.
        TracksError: the missions do not hold what it shows.
    """
    if name not in PICTURES:
        raise ScenarioError(f"picture {name!r} is unknown: there are {', '.join(sorted(PICTURES))}")
    return PICTURES[name](_only(flown, shows) if shows else flown)


def _only(flown: Any, shows: tuple[str, ...]) -> Any:
    """What was flown with these navigators alone."""
    if not hasattr(flown, "tracks"):
        errors = None if flown.errors is None else flown.errors.sel(navigator=list(shows))
        return replace(flown, rows=[row for row in flown.rows if row["navigator"] in shows], errors=errors)
    names = [str(name) for name in flown.tracks["navigator"].values]
    kept = [names.index(name) for name in shows]
    packets = flown.packets
    if "navigator" in packets:
        own = [packets["navigator"] == k for k in kept]
        rows = {
            key: _joined([column[at] for at in own]) for key, column in packets.items() if key != "navigator"
        }
        rows["navigator"] = _joined([0 * packets["navigator"][at] + place for place, at in enumerate(own)])
        packets = rows
    clouds = flown.clouds
    if clouds is not None:
        held = [str(name) for name in clouds["navigator"].values]
        clouds = clouds.sel(navigator=[name for name in shows if name in held])
    return replace(flown, recorded=_kept(flown.recorded, kept), packets=packets, clouds=clouds)


def _kept(recorded: Labelled, places: list[int]) -> Labelled:
    """Of the tracks, these navigators."""
    import numpy as np

    def part(variables: Mapping[str, Variable]) -> dict[str, Any]:
        return {
            name: (
                v.dims,
                np.take(v.values, places, v.dims.index("navigator")) if "navigator" in v.dims else v.values,
                v.attrs,
            )
            for name, v in variables.items()
        }

    return Labelled(part(recorded.data_vars), part(recorded.coords), recorded.attrs)


def _joined(columns: list[Any]) -> Any:
    import numpy as np

    return np.concatenate(columns)


def _map(run: Any) -> Figure:
    from uwcoop.figures.map import map_figure

    return map_figure(run.tracks, run.log.chart)


def _errors(run: Any) -> Figure:
    from uwcoop.figures.errors import errors_figure

    return errors_figure(run.tracks, run.packets)


def _covariance(run: Any, parts: tuple[str, ...] = ("map", "time")) -> Figure:
    from uwcoop.figures.covariance import covariance_figure

    return covariance_figure(run.tracks, run.packets, run.log.chart, parts=parts)


def _ellipses(run: Any) -> Figure:
    return _covariance(run, ("map",))


def _aspects(run: Any) -> Figure:
    return _covariance(run, ("time",))


def _traffic(run: Any) -> Figure:
    from uwcoop.figures.traffic import traffic_figure

    return traffic_figure(run.tracks, run.packets, run.log.chart, run.log.events.get("motion"))


def _information(run: Any) -> Figure:
    from uwcoop.figures.information import information_figure

    return information_figure(
        run.tracks, title=f"{run.tracks.attrs['mission']}, seed {run.tracks.attrs['seed']}"
    )


def _setup(run: Any) -> Figure:
    from uwcoop.figures.setup import setup_figure

    return setup_figure(run.log, run.tracks)


def _uncertainty(run: Any) -> Figure:
    from uwcoop.figures.uncertainty import uncertainty_figure

    return uncertainty_figure(run.tracks, run.packets)


def _origin(run: Any) -> Figure:
    from uwcoop.figures.origin import origin_figure

    return origin_figure(run.tracks)


def _trajectories(run: Any) -> Figure:
    from uwcoop.figures.landmark import trajectories_figure

    return trajectories_figure(run.log, run.tracks, run.clouds)


def _velocities(run: Any) -> Figure:
    from uwcoop.figures.landmark import velocities_figure

    return velocities_figure(run.log)


def _offsets(run: Any) -> Figure:
    from uwcoop.figures.landmark_fixes import offsets_figure

    return offsets_figure(run.log, run.tracks)


def _reconstruction(run: Any) -> Figure:
    from uwcoop.experiment.particles_at_fixes import around_fixes
    from uwcoop.figures.landmark_fixes import reconstruction_figure

    navigator = str(run.tracks["navigator"].values[0])
    return reconstruction_figure(run.log, around_fixes(run.log, navigator), navigator)


def _particles(run: Any) -> Figure:
    from uwcoop.experiment.particles_at_fixes import around_fixes
    from uwcoop.figures.landmark_map import particles_figure

    navigator = str(run.tracks["navigator"].values[0])
    return particles_figure(run.log, around_fixes(run.log, navigator), navigator)


def _roles(run: Any) -> Figure:
    from uwcoop.figures.landmark_map import roles_figure

    return roles_figure(run.log, run.tracks)


def _likelihoods(run: Any) -> Figure:
    from uwcoop.figures.landmark_likelihood import likelihoods_figure

    return likelihoods_figure(run.log, run.tracks)


def _boxes(study: Any) -> Figure:
    from uwcoop.figures.boxes import boxes_figure

    keys = list(study.summary["variants"][0]["set"])
    return boxes_figure(study.rows, keys, title=study.summary["scenario"], settle_s=study.settle_s)


def _averages(study: Any) -> Figure:
    from uwcoop.figures.averages import errors_over_time_figure

    return errors_over_time_figure(study.errors, title=study.summary["scenario"])


def _cost(costs: Any) -> Figure:
    from uwcoop.figures.landmark_study import cost_figure

    return cost_figure(costs, parts=("time",))


def _rate(costs: Any) -> Figure:
    from uwcoop.figures.landmark_study import cost_figure

    return cost_figure(costs, parts=("rate",))


PICTURES: dict[str, Callable[[Any], Figure]] = {
    "map": _map, "errors": _errors, "covariance": _covariance, "traffic": _traffic, "information": _information,
    "setup": _setup, "uncertainty": _uncertainty, "origin": _origin, "trajectories": _trajectories,
    "velocities": _velocities, "offsets": _offsets, "reconstruction": _reconstruction, "particles": _particles,
    "roles": _roles, "likelihoods": _likelihoods, "boxes": _boxes,
    "averages": _averages, "cost": _cost, "rate": _rate, "ellipses": _ellipses, "aspects": _aspects,
}  # fmt: skip
"""By name."""
