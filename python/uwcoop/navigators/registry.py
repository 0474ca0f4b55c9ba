"""Packaged navigators by name: options, and how one is made.

A scenario sets options as `[navigator.NAME]`, or as `[navigator.all]` for every navigator that has the option.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any, TypeAlias

from pydantic import ValidationError

from uwcoop import _native
from uwcoop.errors import NavigatorError
from uwcoop.navigators import origin
from uwcoop.navigators import origin_references as references
from uwcoop.navigators.landmark import LANDMARK_NAVIGATORS, ExchangeOptions
from uwcoop.navigators.options import (
    DeadReckoningOptions,
    DmpfOptions,
    DriftOptions,
    MpfOptions,
)
from uwcoop.navigators.origin import (
    OriginOptions,
)
from uwcoop.navigators.protocol import Context
from uwcoop.navigators.team import TeamOptions, team
from uwcoop.scenario.setup import MissionSetup

if TYPE_CHECKING:
    from uwcoop._native import CentralEstimator, Navigator
    from uwcoop.scenario.acoustics import Acoustics

__all__ = ["NAVIGATORS", "Options", "Spec", "build", "build_central", "not_realisable", "options_of"]


Options: TypeAlias = DriftOptions | OriginOptions | ExchangeOptions
"""Options of a packaged navigator."""


@dataclass(frozen=True)
class Spec:
    """A packaged navigator: what it is, its option model, options that make it what its name says, how it is made."""

    summary: str
    options: type[Options]
    fixed: Mapping[str, Any]
    make: Callable[[Context, Mapping[str, Any], _native.Chart | None], Navigator | CentralEstimator]
    needs_bandwidth: bool = False
    """Takes part by default only where the modem carries its packet."""
    listed_only: bool = False
    """Takes part by default only where the scenario's `navigators` names it."""
    central: bool = False
    """Made once for the whole team (with the first vehicle's context): a `CentralEstimator`."""
    realisable: bool = True
    """False: it uses information that no vehicle has, e.g. which of its packets arrived."""


def _dead_reckoning(context: Context, options: Mapping[str, Any], _chart: _native.Chart | None) -> Navigator:
    return _native.Navigator.dead_reckoning(context.vehicle, context.vehicles, dict(options))


def _dmpf(context: Context, options: Mapping[str, Any], chart: _native.Chart | None) -> Navigator:
    return _native.Navigator.dmpf(
        context.vehicle, context.vehicles, dict(options), chart, context.sound_speed_mps, context.seed
    )


def _mpf(context: Context, options: Mapping[str, Any], chart: _native.Chart | None) -> Navigator:
    complete = dict(options)
    if complete["range_temper"] is None:
        complete["range_temper"] = 1 / max(context.vehicles - 1, 1)
    return _native.Navigator.mpf(
        context.vehicle, context.vehicles, complete, chart, context.sound_speed_mps, context.seed
    )


def _team(context: Context, options: Mapping[str, Any], chart: _native.Chart | None) -> Navigator:
    return team(
        context.vehicle, context.vehicles, dict(options), chart, context.sound_speed_mps, context.seed
    )


NAVIGATORS: dict[str, Spec] = {
    "dead-reckoning": Spec(
        "Commanded velocity summed up, with the covariance of what it does not know.",
        DeadReckoningOptions,
        {},
        _dead_reckoning,
    ),
    "dmpf": Spec(
        "D-MPF of Tan, Chitre & Hover (2016): depth differences and ranges to broadcast beliefs.",
        DmpfOptions,
        {},
        _dmpf,
    ),
    "dmpf-unlimited": Spec(
        "dmpf that broadcasts all its particles (section 5.1 of the paper); needs a modem without a limit.",
        DmpfOptions,
        {"packet": "particles"},
        _dmpf,
        needs_bandwidth=True,
    ),
    "terrain-only": Spec("dmpf without ranges.", DmpfOptions, {"use_ranges": False}, _dmpf),
    "ranging-only": Spec("dmpf without soundings.", DmpfOptions, {"use_terrain": False}, _dmpf),
    "mpf": Spec(
        "Consistent marginalised particle filter: datum offset, chart error that is correlated, of ranges what is new.",
        MpfOptions,
        {},
        _mpf,
    ),
    "local-only": Spec(
        "Own sensors alone: DVL, heading and fixes in a filter with white acceleration.",
        references.BeliefOptions,
        {"correlation": "ignored", "use_ranges": False},
        references.belief_exchange,
        listed_only=True,
    ),
    "cekf": Spec(
        "Centralised filter fed all that the team senses and hears, delayed states at launches (Webster et al. 2009).",
        references.CekfOptions,
        {"fed": "everything"},
        references.cekf,
        listed_only=True,
        central=True,
        realisable=False,
    ),
    "cekf-received": Spec(
        "cekf for each vehicle alone, with the raw data of exactly the packets that reached it.",
        references.CekfOptions,
        {"fed": "received"},
        references.cekf,
        listed_only=True,
        central=True,
        realisable=False,
    ),
    "deif": Spec(
        "Delta information between launches, with a delivery oracle (Walls & Eustice 2012, section 3). One-way only.",
        origin.DeifOptions,
        {},
        origin.deif,
        listed_only=True,
        realisable=False,
    ),
    "deif-redundant": Spec(
        "deif that repeats its last deltas in each packet in place of the oracle. One-way only.",
        origin.DeifRedundantOptions,
        {},
        origin.deif_redundant,
        listed_only=True,
    ),
    "mdeif": Spec(
        "Origin-state method: local pose graphs over a lossy channel (Walls & Eustice 2012, section 4).",
        origin.MdeifOptions,
        {},
        origin.mdeif,
        listed_only=True,
    ),
    "nekf": Spec(
        "Packets of mean and covariance, correlation ignored (Walls & Eustice 2012, section 2.1).",
        references.BeliefOptions,
        {"correlation": "ignored"},
        references.belief_exchange,
        listed_only=True,
    ),
    "interleaved": Spec(
        "Interleaved update: a bank of filters with a table of origins (Bahr, Walter & Leonard 2009).",
        references.InterleavedOptions,
        {},
        references.interleaved,
        listed_only=True,
    ),
    "covariance-intersection": Spec(
        "Packets of mean and covariance, correlation taken as unknown.",
        references.BeliefOptions,
        {"correlation": "unknown"},
        references.belief_exchange,
        listed_only=True,
    ),
    "covariance-intersection-inflated": Spec(
        "covariance-intersection with four times the process noise.",
        references.BeliefOptions,
        {"correlation": "unknown", "process_noise_factor": 4.0},
        references.belief_exchange,
        listed_only=True,
    ),
    "mpf-terrain-only": Spec("mpf without ranges.", MpfOptions, {"use_ranges": False}, _mpf),
    "team": Spec(
        "Every particle carries its teammates; only soundings, displacement and ranges are broadcast.",
        TeamOptions,
        {},
        _team,
    ),
}
"""Packaged navigators by name."""

for _name, (_summary, _model, _fixed, _make) in LANDMARK_NAVIGATORS.items():
    NAVIGATORS[_name] = Spec(_summary, _model, _fixed, _make, listed_only=True)


def options_of(name: str, setup: MissionSetup | None = None) -> Options:
    """Options of a packaged navigator: defaults, then `[navigator.all]`, then `[navigator.NAME]`.

    Args:
        name: of `NAVIGATORS`.
        setup: of a mission, whose tables are read; None: the defaults alone.

    Raises:
        NavigatorError: an unknown navigator or option, or a value outside its bound; one line.
    """
    model = _spec(name).options
    setup = MissionSetup() if setup is None else setup
    common = setup.navigator.common
    unknown = sorted(set(setup.navigator.own) - set(NAVIGATORS))
    if unknown:
        raise NavigatorError(f"navigator.{unknown[0]}: no such navigator{_nearest(unknown[0], NAVIGATORS)}")
    every = {field for spec in NAVIGATORS.values() for field in spec.options.model_fields}
    for option in common:
        if option not in every:
            raise NavigatorError(
                f"navigator.all.{option}: no navigator has this option{_nearest(option, every)}"
            )
    fixed = _spec(name).fixed
    # What makes a navigator what its name says is not for `all` to change.
    own = {key: value for key, value in common.items() if key in model.model_fields and key not in fixed}
    own |= setup.navigator.own.get(name, {})
    if setup.diagnostics.entropy == "at_reception" and "entropy_sigma_m" in model.model_fields:
        own.setdefault("entropy_sigma_m", setup.diagnostics.entropy_sigma_m)
    if setup.acoustics is not None and "packet_form" in model.model_fields:
        own.setdefault("packet_form", setup.acoustics.packet)
    # A packet that is laid out for its frame keeps the tag's room.
    tags = setup.authentication.tag_bytes
    if tags and "tag_bytes" in model.model_fields:
        own.setdefault("tag_bytes", tags)
    full = tags and "exact_lags" in model.model_fields and own.get("packet_form") == "32"
    # The exact lag fills its frame: where the slot has no more, it makes way for the tag.
    if full and setup.acoustics and not _slot_holds(setup.acoustics, 32 - CHECKSUM_BYTES + tags):
        own.setdefault("exact_lags", 0)
    for option, value in fixed.items():
        if own.get(option, value) != value:
            raise NavigatorError(
                f"navigator.{name}.{option} is {own[option]}: this navigator has it at {value}"
            )
    try:
        return model(**(own | dict(fixed)))
    except ValidationError as invalid:
        raise NavigatorError(_one_line(name, model, invalid)) from None


CHECKSUM_BYTES = 2
"""What a tag replaces."""


def _slot_holds(plan: Acoustics, packet_bytes: int) -> bool:
    from uwcoop import acoustics
    from uwcoop.errors import ScheduleError

    try:
        acoustics.check_packet(plan, packet_bytes)
    except ScheduleError:
        return False
    return True


def build(name: str, context: Context, options: Options, chart: _native.Chart | None) -> Navigator:
    """One vehicle's packaged navigator.

    Args:
        name: of `NAVIGATORS`; not a centralised one, which `build_central` makes.
        context: what the vehicle carries.
        options: as `options_of` gives them.
        chart: `native_chart(context.chart)`, shared by the team; None: no chart on board.

    Raises:
        NavigatorError: an unknown name, a centralised estimator, or an option outside its bound.
    """
    made = _made(name, context, options, chart)
    if not isinstance(made, _native.Navigator):
        raise NavigatorError(
            f"navigator {name!r} is one estimator for the whole team: build_central makes it, not build"
        )
    return made


def build_central(
    name: str, context: Context, options: Options, chart: _native.Chart | None
) -> CentralEstimator:
    """A centralised estimator: one for the whole team, made with the first vehicle's context. As `build`.

    Raises:
        NavigatorError: an unknown name, a navigator of one vehicle, or an option outside its bound.
    """
    made = _made(name, context, options, chart)
    if isinstance(made, _native.Navigator):
        raise NavigatorError(f"navigator {name!r} is of one vehicle: build makes it, not build_central")
    return made


def _made(
    name: str, context: Context, options: Options, chart: _native.Chart | None
) -> Navigator | CentralEstimator:
    length = 0.0 if context.chart is None else context.chart.correlation_length_m
    return _spec(name).make(context, options.native(length), chart)


def not_realisable(names: Iterable[str]) -> set[str]:
    """Those of the names that are packaged navigators which use information that no vehicle has."""
    return {name for name in names if name in NAVIGATORS and not NAVIGATORS[name].realisable}


def _spec(name: str) -> Spec:
    if name not in NAVIGATORS:
        raise NavigatorError(f"navigator {name!r} is unknown{_nearest(name, NAVIGATORS)}")
    return NAVIGATORS[name]


def _nearest(name: str, known: Any) -> str:
    close = get_close_matches(name, list(known), n=1)
    return f"; did you mean {close[0]!r}?" if close else f"; there are {', '.join(sorted(known))}"


def _one_line(name: str, model: type[Options], invalid: ValidationError) -> str:
    error = invalid.errors()[0]
    option = ".".join(str(part) for part in error["loc"])
    if error["type"] == "extra_forbidden":
        return f"navigator.{name}.{option}: no such option{_nearest(option, model.model_fields)}"
    message = error["msg"][0].lower() + error["msg"][1:]
    return f"navigator.{name}.{option} is {error['input']!r}: {message}"
