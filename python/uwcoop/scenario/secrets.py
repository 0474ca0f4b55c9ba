"""What must not be repeated: the one place that knows which keys of a scenario are secret, and hides them.

Whatever a user wrote may come back in an error, a table or a file only by way of `redact` or `is_secret`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

__all__ = ["HIDDEN", "holds_secret", "is_key_material", "redact", "sets_secret"]

HIDDEN = "**********"
"""What stands for a secret: there was one."""
SECRET_KEYS = frozenset({"key_hex"})
"""Last names of scenario keys whose values are secret."""
_DIGITS = re.compile(r"[0-9A-Fa-f]{24,}")
_AFTER_SECRET = re.compile(rf"((?:{'|'.join(sorted(SECRET_KEYS))})[\"']?\s*[=:]\s*).*", re.DOTALL)


def redact(text: str) -> str:
    """A user's text with what may be a key hidden: the value of a secret key, and long runs of hexadecimal digits."""
    return _DIGITS.sub(HIDDEN, _AFTER_SECRET.sub(rf"\g<1>{HIDDEN}", text))


def is_key_material(text: str) -> bool:
    """Whether a text that should be a name is a key itself, by mistake."""
    return _DIGITS.fullmatch(text) is not None


def holds_secret(dotted: str, value: Any) -> bool:
    """Whether setting a dotted key to a value sets a secret, in a table of its own too."""
    if dotted.rpartition(".")[2].strip() in SECRET_KEYS:
        return True
    if isinstance(value, Mapping):
        return any(holds_secret(str(key), inner) for key, inner in value.items())
    return isinstance(value, list | tuple) and any(holds_secret("", inner) for inner in value)


def sets_secret(override: str) -> bool:
    """Whether "dotted.key=value" sets a secret; its value need not be well formed."""
    return any(key in override for key in SECRET_KEYS)
