"""`[acoustics.authentication]`: tags that show a packet to be a teammate's, and where the team's key comes from."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, SecretStr, model_validator

from uwcoop.scenario.base import Table
from uwcoop.scenario.secrets import HIDDEN, is_key_material

_VARIABLE = re.compile(r"[A-Za-z_][A-Za-z0-9_]{0,254}")
KEY_DIGITS = (32, 128)
"""Fewest and most hexadecimal digits of a key: 16 to 64 bytes."""


def _key(value: Any) -> Any:
    # An error never repeats the value: it ends in terminals and logs.
    least, most = KEY_DIGITS
    text = value.get_secret_value() if isinstance(value, SecretStr) else value
    if text is None or text == HIDDEN:
        return value
    digits = isinstance(text, str) and len(text) % 2 == 0 and least <= len(text) <= most
    if not digits or any(c not in "0123456789abcdefABCDEF" for c in text):
        raise ValueError(f"must be a text of {least} to {most} hexadecimal digits, an even number of them")
    return value


def _variable(value: Any) -> Any:
    # A key in its place would end in the message that there is no such variable.
    if isinstance(value, str) and (is_key_material(value) or not _VARIABLE.fullmatch(value)):
        raise ValueError("must be the name of an environment variable: letters, digits and _, no digit first")
    return value


def _file(value: Any) -> Any:
    if isinstance(value, str) and is_key_material(Path(value).name):
        raise ValueError("must be the name of a file, it looks like a key")
    return value


class Authentication(Table):
    """Off, or a tag on every packet, whatever the navigator: HMAC-SHA-256 with the team's key, truncated."""

    tag_bytes: Literal[0, 4, 8] = 0
    """0: no tags. A forged packet passes with probability 2^-32 or 2^-64 at each try, of which a slot has four."""
    key_hex: Annotated[SecretStr | None, BeforeValidator(_key)] = None
    """The key, for simulations; never printed and never written to a log or a resolved scenario."""
    key_env: Annotated[str | None, BeforeValidator(_variable)] = None
    """Name of the environment variable that holds the key's hexadecimal digits."""
    key_file: Annotated[Annotated[str, Field(min_length=1)] | None, BeforeValidator(_file)] = None
    """A file that holds them (relative to the scenario file)."""
    mission: Annotated[int, Field(ge=0, le=2**63 - 1)] | None = None
    """Another number for each mission that uses the same key, or a packet of one mission could be replayed in the same
    slot of the next. A key needs it; without a key, missions are simulated and their seed takes its place."""

    @model_validator(mode="after")
    def _one_key(self) -> Authentication:
        given = [name for name in ("key_hex", "key_env", "key_file") if getattr(self, name) is not None]
        if len(given) > 1:
            raise ValueError(f"has {' and '.join(given)}: the key has one place")
        if given and self.mission is None:
            raise ValueError(
                f"has {given[0]} and no mission: must have another number for each mission that uses the key, "
                "or yesterday's packets are good today"
            )
        return self

    @property
    def key(self) -> bytes | None:
        """The key that the scenario itself holds; None if it names another place, or hides it."""
        text = None if self.key_hex is None else self.key_hex.get_secret_value()
        return None if text is None or text == HIDDEN else bytes.fromhex(text)
