"""Packaged navigators by name, their options out of a scenario, and how one is built.

What there is, what each navigator fixes, and what it would not read is the core's to say. `[navigator.all]` sets an
option of every navigator that reads it, `[navigator.NAME]` one of its own; options that a navigator does not have or
would not read are refused there.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any, TypeAlias

from pydantic import ValidationError

from uwcoop import _native
from uwcoop.errors import NavigatorError
from uwcoop.navigators import landmark, options, origin, team
from uwcoop.navigators.base import METHODS, NavigatorOptions
from uwcoop.navigators.clock import clock_of
from uwcoop.navigators.protocol import Context
from uwcoop.scenario.setup import MissionSetup

if TYPE_CHECKING:
    from uwcoop._native import CentralEstimator, Navigator
    from uwcoop.scenario.acoustics import Acoustics

__all__ = [
    "MODELS",
    "NAVIGATORS",
    "Options",
    "Spec",
    "base_name",
    "build",
    "build_central",
    "is_packaged",
    "not_realisable",
    "options_of",
    "read_options",
    "spec_of",
]

Options: TypeAlias = NavigatorOptions
"""Options of a packaged navigator."""

MODELS: dict[str, type[NavigatorOptions]] = {
    model.method: model
    for model in (
        options.DeadReckoningOptions,
        options.DmpfOptions,
        options.MpfOptions,
        team.TeamOptions,
        landmark.LandmarkOptions,
        landmark.LandmarkPaperOptions,
        origin.MdeifOptions,
        origin.DeifOptions,
        origin.DeifRedundantOptions,
        origin.CekfOptions,
        origin.BeliefOptions,
        origin.InterleavedOptions,
    )
}
"""Option model of each of the core's methods."""


@dataclass(frozen=True)
class Spec:
    """A packaged navigator: what it is, its option model, options that make it what its name says."""

    summary: str
    options: type[NavigatorOptions]
    fixed: Mapping[str, Any]
    needs_bandwidth: bool = False
    """Takes part by default only where the modem carries its packet."""
    listed_only: bool = False
    """Takes part by default only where the scenario's `navigators` names it."""
    central: bool = False
    """Made once for the whole team (with the first vehicle's context): a `CentralEstimator`."""
    realisable: bool = True
    """False: it uses information that no vehicle has, e.g. which of its packets arrived."""


NAVIGATORS: dict[str, Spec] = {
    one["name"]: Spec(
        one["summary"],
        MODELS[one["method"]],
        one["fixed"],
        needs_bandwidth=one["takes_part"] == "with bandwidth",
        listed_only=one["takes_part"] == "listed",
        central=one["central"],
        realisable=one["realisable"],
    )
    for one in json.loads(_native.packaged_navigators())
}
"""Packaged navigators by name."""


def options_of(name: str, setup: MissionSetup | None = None) -> Options:
    """Options of a packaged navigator: defaults, then `[navigator.all]`, then `[navigator.NAME]`.

    Args:
        name: of `NAVIGATORS`.
        setup: of a mission, whose tables are read; None: the defaults alone.

    Raises:
        NavigatorError: an unknown navigator or option, a value outside its bound, or an option of `[navigator.NAME]`
            that would not be read; one line.
    """
    spec = _spec(name)
    known = spec.options.model_fields
    setup = MissionSetup() if setup is None else setup
    common = setup.navigator.common
    unknown = sorted(each for each in setup.navigator.own if base_name(each) not in NAVIGATORS)
    if unknown:
        raise NavigatorError(f"navigator.{unknown[0]}: no such navigator{_nearest(unknown[0], NAVIGATORS)}")
    every = {field for each in NAVIGATORS.values() for field in each.options.model_fields}
    for option in common:
        if option not in every:
            raise NavigatorError(
                f"navigator.all.{option}: no navigator has this option{_nearest(option, every)}"
            )
    # What makes a navigator what its name says is not for `all` to change.
    implied = {key: value for key, value in common.items() if key in known and key not in spec.fixed}
    own = {**setup.navigator.own.get(base_name(name), {}), **setup.navigator.own.get(name, {})}
    own = _of_variant(name, known, own, stated=name in setup.navigator.own)
    implied = _implied_by_setup(spec, setup, {**implied, **own}) | implied
    if "clock" in known and "clock" in own and setup.acoustics is not None:
        own["clock"] = clock_of(setup.acoustics) | dict(own["clock"])
    for option, value in spec.fixed.items():
        if own.get(option, value) != value:
            raise NavigatorError(
                f"navigator.{name}.{option} is {own[option]}: this navigator has it at {value}"
            )
    chosen = _validated(name, {**implied, **own, **spec.fixed})
    unread = dict(_native.unread_options(base_name(name), chosen.stated()))
    for option in own:
        if option in unread and option not in spec.fixed:
            raise NavigatorError(f"navigator.{name}.{option}: not read, because {unread[option]}")
    read = {key: value for key, value in implied.items() if key not in unread}
    return _validated(name, {**read, **own, **spec.fixed})


def _of_variant(
    name: str, known: Mapping[str, Any], own: Mapping[str, Any], *, stated: bool
) -> dict[str, Any]:
    """Options of a variant by its name: `mpf@dvl` has the drift preset `dvl`, unless it states another.

    Raises:
        NavigatorError: a variant without options of its own would be its navigator under another name.
    """
    base, at, told = name.partition("@")
    if at and told in options.DRIFT_PRESETS and "drift" in known:
        return {**own, "drift": own.get("drift", told) if stated else told}
    if at and not stated:
        presets = ", ".join(f"{base}@{preset}" for preset in options.DRIFT_PRESETS)
        raise NavigatorError(
            f"navigator {name!r} has no options of its own: state them, navigator.{name}.OPTION=…, or take {presets}"
        )
    return dict(own)


def _implied_by_setup(spec: Spec, setup: MissionSetup, stated: Mapping[str, Any]) -> dict[str, Any]:
    """Options that follow the mission's other tables unless they are stated."""
    known = spec.options.model_fields
    found: dict[str, Any] = {}
    if setup.diagnostics.entropy == "at_reception" and "entropy_sigma_m" in known:
        found["entropy_sigma_m"] = setup.diagnostics.entropy_sigma_m
    if setup.diagnostics.entropy == "at_updates" and "update_entropy_sigma_m" in known:
        found["update_entropy_sigma_m"] = setup.diagnostics.entropy_sigma_m
    if setup.acoustics is not None and "packet_form" in known:
        found["packet_form"] = setup.acoustics.packet
    if setup.acoustics is not None and "clock" in known:
        found["clock"] = clock_of(setup.acoustics) | dict(stated.get("clock", {}))
    # A packet that is laid out for its frame keeps the tag's room.
    tags = setup.authentication.tag_bytes
    if tags and "tag_bytes" in known:
        found["tag_bytes"] = tags
    full = tags and "exact_lags" in known and {**found, **stated}.get("packet_form") == "32"
    # The exact lag fills its frame: where the slot has no more, it makes way for the tag.
    if full and setup.acoustics and not _slot_holds(setup.acoustics, 32 - CHECKSUM_BYTES + tags):
        found["exact_lags"] = 0
    return found


def _validated(name: str, stated: Mapping[str, Any]) -> Options:
    model = _spec(name).options
    try:
        return model(**stated)
    except ValidationError as invalid:
        raise NavigatorError(_one_line(name, model, invalid)) from None


def read_options(name: str, chosen: Options) -> dict[str, Any]:
    """Every option that the navigator reads, with its value; what is None, and follows sensor, chart or preset, is left
    out."""
    unread = dict(_native.unread_options(base_name(name), chosen.stated()))
    values = chosen.model_dump(exclude_none=True)
    fixed = _spec(name).fixed
    return {key: value for key, value in values.items() if key in fixed or key not in unread}


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
        NavigatorError: an unknown name, a centralised estimator, an option outside its bound or that would not be read.
    """
    if _spec(name).central:
        raise NavigatorError(
            f"navigator {name!r} is one estimator for the whole team: build_central makes it, not build"
        )
    return _native.make_navigator(
        base_name(name),
        context.vehicle,
        context.vehicles,
        context.sound_speed_mps,
        context.seed % 2**64,  # the counter-based streams have a key of 64 bits
        list(context.ranging),
        options.stated(),
        chart,
    )


def build_central(name: str, context: Context, options: Options) -> CentralEstimator:
    """A centralised estimator: one for the whole team, made with the first vehicle's context. As `build`.

    Raises:
        NavigatorError: an unknown name, a navigator of one vehicle, an option outside its bound or that would not be
            read.
    """
    if not _spec(name).central:
        raise NavigatorError(f"navigator {name!r} is of one vehicle: build makes it, not build_central")
    ranging, stated = list(context.ranging), options.stated()
    return _native.make_central(base_name(name), context.vehicles, context.sound_speed_mps, ranging, stated)


def not_realisable(names: Iterable[str]) -> set[str]:
    """Those of the names that are packaged navigators which use information that no vehicle has."""
    return {name for name in names if is_packaged(name) and not _spec(name).realisable}


def base_name(name: str) -> str:
    """The packaged navigator of a variant: `dmpf@2000` is `dmpf` with the options of `[navigator."dmpf@2000"]` over
    those of `[navigator.dmpf]`, beside it in one run or study; `mpf@dvl` is `mpf` with the drift preset `dvl`."""
    return name.partition("@")[0]


def is_packaged(name: str) -> bool:
    """Whether it is a packaged navigator or a variant of one."""
    return base_name(name) in NAVIGATORS


def spec_of(name: str) -> Spec:
    """What a packaged navigator, or a variant of one, is.

    Raises:
        NavigatorError: there is none of this name.
    """
    return _spec(name)


def _spec(name: str) -> Spec:
    if not is_packaged(name):
        raise NavigatorError(f"navigator {name!r} is unknown{_nearest(base_name(name), NAVIGATORS)}")
    return NAVIGATORS[base_name(name)]


def _nearest(name: str, known: Any) -> str:
    close = get_close_matches(name, list(known), n=1)
    return f"; did you mean {close[0]!r}?" if close else f"; there are {', '.join(sorted(known))}"


def _one_line(name: str, model: type[Options], invalid: ValidationError) -> str:
    error = invalid.errors()[0]
    option = ".".join(str(part) for part in error["loc"])
    if error["type"] == "extra_forbidden":
        reason = METHODS[model.method]["without"].get(option)
        return f"navigator.{name}.{option}: " + (
            reason or f"no such option{_nearest(option, model.model_fields)}"
        )
    message = error["msg"][0].lower() + error["msg"][1:]
    return f"navigator.{name}.{option} is {error['input']!r}: {message}"
