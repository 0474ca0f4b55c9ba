"""Speed of sound in sea water by its temperature, salinity and depth."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from uwcoop.errors import ScenarioError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

__all__ = ["DEPTH_M", "SALINITY_PSU", "TEMPERATURE_C", "mackenzie_mps"]

TEMPERATURE_C = (2.0, 30.0)
SALINITY_PSU = (25.0, 40.0)
DEPTH_M = (0.0, 8000.0)
"""Where Mackenzie's fit holds."""


def mackenzie_mps(
    temperature_c: ArrayLike, salinity_psu: ArrayLike, depth_m: ArrayLike
) -> NDArray[np.float64]:
    """Speed of sound in sea water, m/s, of the broadcast shape of the arguments.

    Nine terms, standard error 0.07 m/s: Mackenzie, "Nine-term equation for sound speed in the oceans", J.
    Acoust. Soc. Am. 70, 807-812 (1981). His check value: 25 °C, 35, 1000 m give 1550.744 m/s.

    Args:
        temperature_c: 2 to 30 °C.
        salinity_psu: 25 to 40.
        depth_m: 0 to 8000 m, positive down.

    Raises:
        ScenarioError: a value outside the range of the fit (or NaN); fresh water is.
    """
    t, s, d = (np.asarray(a, dtype=np.float64) for a in (temperature_c, salinity_psu, depth_m))
    for quantity, values, (low, high), unit in [
        ("temperature", t, TEMPERATURE_C, " °C"),
        ("salinity", s, SALINITY_PSU, " psu"),
        ("depth", d, DEPTH_M, " m"),
    ]:
        outside = ~((values >= low) & (values <= high))
        if outside.any():
            found = values[outside].flat[0]
            raise ScenarioError(
                f"{quantity} {found:g}{unit} is outside Mackenzie's {low:g} to {high:g}{unit}"
            )
    return np.asarray(
        1448.96 + 4.591 * t - 5.304e-2 * t**2 + 2.374e-4 * t**3
        + 1.340 * (s - 35) + 1.630e-2 * d + 1.675e-7 * d**2
        - 1.025e-2 * t * (s - 35) - 7.139e-13 * t * d**3
    )  # fmt: skip
