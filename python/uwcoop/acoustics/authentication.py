"""The team's key and the tags made with it, from a mission's scenario."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path
from typing import TYPE_CHECKING

from uwcoop import _native
from uwcoop.errors import ScenarioError
from uwcoop.scenario.authentication import HIDDEN, KEY_DIGITS, Authentication

if TYPE_CHECKING:
    from uwcoop.missionlog import MissionLog

__all__ = ["authenticator_of"]


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


def _key_of(log: MissionLog, plan: Authentication) -> bytes:
    if log.team_key is not None:
        return log.team_key
    if plan.key_env is not None:
        text = os.environ.get(plan.key_env)
        if text is None:
            raise ScenarioError(f"the team's key: environment variable {plan.key_env} is not set")
        return _digits(text, f"environment variable {plan.key_env}")
    if plan.key_file is not None:
        try:
            text = Path(plan.key_file).read_text(encoding="ascii")
        except (OSError, UnicodeDecodeError) as error:
            raise ScenarioError(f"the team's key: {plan.key_file} cannot be read: {error}") from error
        return _digits(text, plan.key_file)
    if log.payloads:
        hidden = plan.key_hex is not None and plan.key_hex.get_secret_value() == HIDDEN
        raise ScenarioError(
            f"mission {log.name!r} holds packets with tags, and its key is {'hidden' if hidden else 'not given'}: "
            "name a place for it in acoustics.authentication, key_env or key_file"
        )
    return hashlib.sha256(f"uwcoop simulated team {log.name}".encode()).digest()


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
