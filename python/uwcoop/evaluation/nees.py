"""Consistency of a covariance: the normalised estimation error squared (NEES), and the χ² interval of its mean."""

from __future__ import annotations

import math
from statistics import NormalDist
from typing import TYPE_CHECKING

import numpy as np

from uwcoop.errors import TracksError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

CHI2_95_2D = -2 * math.log(0.05)
"""95 % quantile of χ² with two degrees of freedom, 5.99: closed form."""


def normalised_square(error: Floats, covariance: Floats) -> Floats:
    """eᵀ P⁻¹ e of a stack of errors (..., d) under covariances (..., d, d); shape (...), never an exception.

    A singular P: infinite if e has a part that P rules out, otherwise the value in P's range. NaN where e
    or P holds a NaN or P has a negative variance in some direction. Units cancel: P is scaled to unit
    diagonal before its eigenvalues are compared with rounding (1e-12), so metres and radians can be mixed.
    """
    P = (covariance + np.swapaxes(covariance, -1, -2)) / 2
    defined = np.asarray(np.isfinite(P).all((-1, -2)) & ~np.isnan(error).any(-1))
    dimension = error.shape[-1]
    P = np.where(defined[..., None, None], P, np.eye(dimension))
    e = np.where(defined[..., None] & np.isfinite(error), error, 0.0)
    variance = np.diagonal(P, axis1=-2, axis2=-1)
    scale = np.where(variance > 0, np.sqrt(np.abs(variance)), 1.0)
    eigenvalues, vectors = np.linalg.eigh(P / (scale[..., :, None] * scale[..., None, :]))
    along = np.einsum("...ij,...i->...j", vectors, e / scale)
    tolerance = 1e-12 * np.maximum(eigenvalues[..., -1:], 0.0)
    ruled_out = np.abs(along) > 1e-9 * np.linalg.norm(e / scale, axis=-1, keepdims=True)
    spanned = eigenvalues > tolerance
    term = np.where(spanned, along**2 / np.where(spanned, eigenvalues, 1.0), np.where(ruled_out, np.inf, 0.0))
    square = term.sum(-1)
    square[np.isinf(error).any(-1)] = np.inf
    square[~defined | (eigenvalues < -tolerance - 1e-300).any(-1)] = np.nan
    return np.asarray(square, dtype=np.float64)


def anees_bounds(dof: int, samples: int, confidence: float = 0.95) -> tuple[float, float]:
    """Interval that holds the mean of `samples` independent NEES values with this confidence.

    The sum of n such values is χ² with n·dof degrees of freedom (Bar-Shalom, Li and Kirubarajan 2001,
    5.4.2). Instants of one run are correlated: count runs and vehicles as samples, not seconds. Relative
    accuracy 1e-9 against `scipy.stats.chi2.ppf` up to 1e5 degrees of freedom and confidence 0.999.
    """
    if dof < 1 or samples < 1:
        raise TracksError(
            f"anees_bounds needs dof >= 1 and samples >= 1, got dof {dof} and samples {samples}"
        )
    if not 0 < confidence < 1:
        raise TracksError(f"confidence {confidence} is outside the open interval 0 to 1")
    tail = (1 - confidence) / 2
    degrees = dof * samples
    return _chi2_quantile(tail, degrees) / samples, _chi2_quantile(1 - tail, degrees) / samples


def _chi2_quantile(probability: float, degrees: int) -> float:
    """Wilson-Hilferty's start (1931; up to 50 % off at 2 degrees), then Newton steps kept in a bracket."""
    a = degrees / 2
    spread = 2 / (9 * degrees)
    start = 1 - spread + NormalDist().inv_cdf(probability) * math.sqrt(spread)
    x = max(degrees * start**3 / 2, 1e-3 * a)
    low, high = 0.0, math.inf
    for _ in range(200):
        excess = _gamma_p(a, x) - probability
        low, high = (x, high) if excess < 0 else (low, x)
        step = excess / math.exp((a - 1) * math.log(x) - x - math.lgamma(a))
        following = x - step
        if not low < following < high:
            following = 2 * x if math.isinf(high) else (low + high) / 2
        if abs(following - x) <= 1e-14 * x:
            break
        x = following
    return 2 * x


def _gamma_p(a: float, x: float) -> float:
    """Regularised lower incomplete gamma function, by its series (DLMF 8.7.1): all terms are positive."""
    term = total = 1 / a
    n = a
    while term > total * 1e-17:
        n += 1
        term *= x / n
        total += term
    return total * math.exp(a * math.log(x) - x - math.lgamma(a))
