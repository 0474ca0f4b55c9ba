"""The modem and the sensors that the options of `uwcoop node` name."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from uwcoop.cli.terminal import say

if TYPE_CHECKING:
    from uwcoop.onboard.modems import Modem
    from uwcoop.onboard.nmea import NmeaDriver
    from uwcoop.onboard.service import SystemClock
    from uwcoop.onboard.vehicle import VehicleNavigator

__all__ = ["modem_of", "nmea_drivers"]


def modem_of(text: str | None, made: VehicleNavigator, clock: SystemClock | None) -> Modem | None:
    """The modem that `--modem` names; None for the channel's."""
    from uwcoop.onboard.lines import open_line
    from uwcoop.onboard.micromodem import Micromodem

    if text is None:
        return None
    kind, _, device = text.partition(":")
    if kind not in {"micromodem", "unet"} or clock is None:
        raise typer.BadParameter(
            "must be micromodem:DEVICE or unet:HOST:PORT, and needs --epoch", param_hint="--modem"
        )
    if kind == "unet":
        from uwcoop.onboard.transports import address_of
        from uwcoop.onboard.unet import UnetModem

        found = UnetModem(*address_of(device), made.mission, made.index, clock.now_ns)
        error_s = found.clock_error_ns / 1e9
        error_m = error_s * made.mission.link.sound_speed_mps
        say(f"unet: the modem's clock is known to {error_s * 1e3:.3f} ms, ranges to {error_m:.2f} m by it")
        return found
    return Micromodem(open_line(device), made.mission, made.index, clock.now_ns, clock.epoch_ns)


def nmea_drivers(
    devices: list[str] | None, path: Path | None, made: VehicleNavigator, clock: SystemClock | None
) -> tuple[NmeaDriver, ...]:
    """The sensors of `--nmea` and `--nmea-map`; what they assume is said."""
    if not devices and path is None:
        return ()
    if not devices or path is None:
        raise typer.BadParameter("a device and a mapping go together", param_hint="--nmea, --nmea-map")
    if clock is None:
        raise typer.BadParameter("sensors have times of their own: give --epoch", param_hint="--nmea")
    from uwcoop.onboard.lines import open_line
    from uwcoop.onboard.nmea import NmeaDriver
    from uwcoop.onboard.nmea_map import read_map

    mapping, origin = read_map(path), made.mission.origin
    drivers = tuple(
        NmeaDriver(open_line(device), mapping, made.index, origin, clock.now_ns, clock.epoch_ns)
        for device in devices
    )
    for line in drivers[0].said():
        say(line)
    return drivers
