"""The team's key and the tags made with it, from a mission's scenario."""

from __future__ import annotations

import hashlib
import os
import warnings
from pathlib import Path
from typing import TYPE_CHECKING

from uwcoop import _native
from uwcoop.errors import ScenarioError
from uwcoop.importers.bounded import read_text, refused
from uwcoop.scenario.authentication import KEY_DIGITS, Authentication
from uwcoop.scenario.secrets import HIDDEN

if TYPE_CHECKING:
    from uwcoop.missionlog import MissionLog

__all__ = ["KeyFileWarning", "authenticator_of", "check_key"]

_KEY_FILE_LIMIT_BYTES = 4096


class KeyFileWarning(UserWarning):
    """A key that others can read."""


def authenticator_of(log: MissionLog) -> _native.Authenticator | None:
    """Adds and checks the tags of the packets of a mission's team; None where packets carry no tags.

    A mission that is simulated without a key gets one made of its name: both ends of its link are in this process, and
    what a tag accepts does not depend on the key.

    Raises:
        ScenarioError: a key that is not where the scenario says, or a log of real packets whose key is not known.
    """
    plan = log.setup.authentication
    if plan.tag_bytes == 0:
        return None
    mission = log.seed if plan.mission is None else plan.mission
    return _native.Authenticator(_key_of(log, plan), plan.tag_bytes, mission)


def check_key(plan: Authentication) -> None:
    """Read the key of a team that carries tags where a place is named for it, so that a wrong place shows at once.

    Raises:
        ScenarioError: it is not there, or is none.
    """
    if plan.tag_bytes:
        _key_from_place(plan)


def _key_of(log: MissionLog, plan: Authentication) -> bytes:
    if log.team_key is not None:
        return log.team_key
    key = _key_from_place(plan)
    if key is not None:
        return key
    if log.payloads:
        hidden = plan.key_hex is not None and plan.key_hex.get_secret_value() == HIDDEN
        raise ScenarioError(
            f"mission {log.name!r} holds packets with tags, and its key is {'hidden' if hidden else 'not given'}: "
            "name a place for it in acoustics.authentication, key_env or key_file"
        )
    return hashlib.sha256(f"uwcoop simulated team {log.name}".encode()).digest()


def _key_from_place(plan: Authentication) -> bytes | None:
    """The key from the environment or a file; None where the scenario names neither."""
    if plan.key_env is not None:
        text = os.environ.get(plan.key_env)
        if text is None:
            raise ScenarioError(f"the team's key: environment variable {plan.key_env} is not set")
        return _digits(text, f"environment variable {plan.key_env}")
    if plan.key_file is None:
        return None
    path = Path(plan.key_file)
    with refused(ScenarioError, f"the team's key: {path}"):
        text = read_text(path, _KEY_FILE_LIMIT_BYTES, "ascii")
        open_to_others = os.name == "posix" and path.stat().st_mode & 0o077
    if open_to_others:
        line = f"key file {path} can be read by other users of this machine: chmod 600 {path}"
        warnings.warn(line, KeyFileWarning, stacklevel=2)
    return _digits(text, plan.key_file)


def _digits(text: str, where: str) -> bytes:
    least, most = KEY_DIGITS
    text = text.strip()
    try:
        if not least <= len(text) <= most:
            raise ValueError
        return bytes.fromhex(text)
    except ValueError:
        raise ScenarioError(
            f"the team's key: {where} does not hold {least} to {most} hexadecimal digits"
        ) from None
