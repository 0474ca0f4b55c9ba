"""`[acoustics.modem]`: a packaged modem by name, or one's own as a table."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import AfterValidator, Discriminator, Field, Tag, model_validator

from uwcoop.acoustics.modem_profiles import MODEMS, NO_LIMIT_BYTES, ModemFigures
from uwcoop.scenario.base import NAME, NonNegative, Positive, Table

_FIGURES = ("frame_bytes", "max_frames", "bits_per_s", "preamble_s", "turnaround_s")


class ModemTable(Table):
    """`[acoustics.modem]` as a table: a modem of one's own. Bit rate or time of a frame, one of the two."""

    name: Annotated[str, Field(min_length=1, pattern=NAME)] = "own"
    """In tables and logs; with `profile` and nothing else, the profile's."""
    profile: str | None = None
    """A packaged modem; what is given beside it wins."""
    frame_bytes: Annotated[int, Field(ge=1, le=NO_LIMIT_BYTES)]
    """Bytes of a frame."""
    max_frames: Annotated[int, Field(ge=1, le=1024)] = 1
    """Frames of a packet, behind one preamble."""
    bits_per_s: Positive | None = None
    """Of the bytes of a frame."""
    frame_s: Positive | None = None
    """Air time of a whole frame, in place of the bit rate."""
    preamble_s: NonNegative = 0.0
    """Air time of everything but the frames: synchronisation, header, silence."""
    turnaround_s: NonNegative = 0.0
    """From the end of a signal, sent or received, to the earliest start of the other kind (half duplex)."""

    @model_validator(mode="before")
    @classmethod
    def _fill_from_profile(cls, data: Any) -> Any:
        if not isinstance(data, dict) or not isinstance(data.get("profile"), str):
            return data
        base = MODEMS[_packaged(data["profile"])]
        if base.bits_per_s == 0:
            raise ValueError(f"profile is {data['profile']!r}: it has no air time to change")
        filled = {key: getattr(base, key) for key in _FIGURES}
        if data.get("frame_s") is not None:
            del filled["bits_per_s"]
        return {"name": data["profile"], **filled, **data}

    @model_validator(mode="after")
    def _one_rate(self) -> ModemTable:
        if (self.bits_per_s is None) == (self.frame_s is None):
            raise ValueError("needs bits_per_s or frame_s, one of the two")
        return self

    @property
    def figures(self) -> ModemFigures:
        """The modem as the packaged ones are written."""
        rate = self.bits_per_s or 8 * self.frame_bytes / (self.frame_s or 1.0)
        return ModemFigures(
            self.frame_bytes, self.max_frames, rate, self.preamble_s, self.turnaround_s, "the scenario's own"
        )


def _packaged(name: str) -> str:
    if name not in MODEMS:
        raise ValueError(f"is {name!r}: must be one of {', '.join(map(repr, MODEMS))}, or a table")
    return name


def _shape(value: Any) -> str:
    return "table" if isinstance(value, dict | ModemTable) else "name"


PackagedModem = Annotated[
    str, AfterValidator(_packaged), Field(json_schema_extra={"enum": list(MODEMS)}), Tag("name")
]
Modem = Annotated[PackagedModem | Annotated[ModemTable, Tag("table")], Discriminator(_shape)]
