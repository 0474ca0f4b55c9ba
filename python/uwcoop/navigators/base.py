"""The base of option models: names, types and texts stand here, defaults and bounds in the core."""

from __future__ import annotations

import json
from typing import Any, ClassVar, Literal

from annotated_types import Ge, Gt, Le, Lt
from pydantic import BaseModel, ConfigDict

from uwcoop import _native

__all__ = ["FROM_CORE", "METHODS", "NavigatorOptions"]

METHODS: dict[str, dict[str, Any]] = json.loads(_native.navigator_options())
"""Options of the core's methods: `defaults`, `bounds`, and what each is `without`, with the reason."""

FROM_CORE: Any = None
"""Stands for a default that the core states."""

_LIMITS: dict[str, Any] = {"gt": Gt, "ge": Ge, "lt": Lt, "le": Le}


class NavigatorOptions(BaseModel):
    """Options of a packaged navigator. A class names the core's `method` from which its defaults and bounds are read."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    method: ClassVar[str] = ""

    late: Literal["refuse", "replay"] = FROM_CORE
    """What becomes of events older than the navigator's time: refused, or put in their place while all that follows is
    done again."""
    lag_s: float = FROM_CORE
    """How old a late event may be; an older one is rejected and counted."""

    def __init_subclass__(cls, method: str = "", **kwargs: Any) -> None:
        """Takes the keyword; the fields are not there yet."""
        super().__init_subclass__(**kwargs)

    @classmethod
    def __pydantic_init_subclass__(cls, method: str = "", **kwargs: Any) -> None:
        super().__pydantic_init_subclass__(**kwargs)
        if not method:
            return
        cls.method = method
        described = METHODS[method]
        for name, field in cls.model_fields.items():
            field.default = described["defaults"][name]
            bound = described["bounds"].get(name, {})
            kept = [one for one in field.metadata if not isinstance(one, Gt | Ge | Lt | Le)]
            field.metadata = [*kept, *(_LIMITS[limit](value) for limit, value in bound.items())]
        cls.model_rebuild(force=True)

    def stated(self) -> str:
        """The options that were stated, as the core takes them."""
        return self.model_dump_json(exclude_unset=True)
