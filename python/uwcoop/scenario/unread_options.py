"""Navigator options that an override leaves without effect.

A file that states an option against its own reading is refused when the navigator is made. Where an override is the
cause (`navigator.mpf.use_ranges=false` on a scenario that states `mpf.range_temper`), the user has not stated the option:
it is dropped, and a warning says so.
"""

from __future__ import annotations

import json
import warnings
from collections.abc import Collection, Mapping
from typing import Any

from uwcoop import _native
from uwcoop.errors import NavigatorError

__all__ = ["UnreadOptionWarning", "without_unread"]

_PACKAGED: dict[str, dict[str, Any]] = {one["name"]: one for one in json.loads(_native.packaged_navigators())}
_METHODS: dict[str, dict[str, Any]] = json.loads(_native.navigator_options())


class UnreadOptionWarning(UserWarning):
    """An override leaves an option of the scenario without effect; it is dropped."""


def without_unread(
    before: Mapping[str, Any], after: Mapping[str, Any], overridden: Collection[str]
) -> dict[str, Any]:
    """The tables `[navigator.*]` after overrides, without options that were read before them and now are not.

    Args:
        before: tables by navigator, `all` among them.
        after: the same with the overrides.
        overridden: dotted keys of the overrides; an option that one of them sets stays, and is refused later.

    Warns:
        UnreadOptionWarning: for each navigator and reason, which options are dropped.
    """
    kept = dict(after)
    for name in _PACKAGED:
        own = after.get(name)
        if not isinstance(own, Mapping):
            continue
        unread, unread_before = _unread(name, after), _unread(name, before)
        dropped = {
            option: unread[option]
            for option in own
            if option in unread
            and option not in unread_before
            and not _is_set(f"navigator.{name}.{option}", overridden)
        }
        kept[name] = {option: value for option, value in own.items() if option not in dropped}
        for reason in dict.fromkeys(dropped.values()):
            options = ", ".join(option for option in dropped if dropped[option] == reason)
            line = f"navigator.{name}: {options} of the scenario dropped, because {reason}"
            warnings.warn(line, UnreadOptionWarning, stacklevel=2)
    return kept


def _is_set(key: str, overridden: Collection[str]) -> bool:
    return any(key == one or key.startswith(f"{one}.") for one in overridden)


def _unread(name: str, tables: Mapping[str, Any]) -> dict[str, str]:
    """Options without effect, by reason; none where the tables are refused later for what they hold."""
    packaged = _PACKAGED[name]
    known, fixed = _METHODS[packaged["method"]]["defaults"], packaged["fixed"]
    common, own = tables.get("all", {}), tables.get(name, {})
    if not isinstance(common, Mapping) or not isinstance(own, Mapping):
        return {}
    implied = {key: value for key, value in common.items() if key in known and key not in fixed}
    try:
        return dict(_native.unread_options(name, json.dumps({**implied, **own}, default=str)))
    except (NavigatorError, ValueError):
        return {}
