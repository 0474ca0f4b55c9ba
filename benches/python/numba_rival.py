"""The step of `dmpf` compiled by numba: one function for a whole second, loops over particles, nothing allocated.

Particles are fused as far as that pays: draw and propagate in one loop; cell and fraction once for each particle, all
its lookups, its likelihood and the greatest log-weight in one loop; then weights; then resampling into second columns.
"""

from __future__ import annotations

import copy
import math

import numba
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@numba.njit(fastmath=True, error_model="numpy", cache=False)
def propagate(rng, e, n, c, command, sigma, gain):  # type: ignore[no-untyped-def]
    """(5)-(8) for one second; S and P are multiples of the identity here."""
    for i in range(e.size):
        ze, zn = sigma * rng.standard_normal(), sigma * rng.standard_normal()
        e[i] += command[0] + c[0, i] + ze
        n[i] += command[1] + c[1, i] + zn
        c[0, i] += gain * ze
        c[1, i] += gain * zn


@numba.njit(fastmath=True, error_model="numpy", cache=False)
def weigh(e, n, log_w, w, flat, geometry, shifts, fractions, differences, scale):  # type: ignore[no-untyped-def]
    """(15), (9): Gaussian depth differences along the segment; the effective sample size."""
    east0, north0, inverse, cols = geometry
    stride = int(cols)
    top = -np.inf
    one = np.float32(1.0)
    for i in range(e.size):
        x, y = (e[i] - east0) * inverse, (n[i] - north0) * inverse
        column, row = int(x), int(y)
        fe0, fn0 = np.float32(x - column), np.float32(y - row)
        first = row * stride + column
        total = np.float32(0.0)
        before = np.float32(0.0)
        for k in range(shifts.size):
            at = first + shifts[k]
            fe, fn = fe0 + fractions[k, 0], fn0 + fractions[k, 1]
            # No branches: carries cannot be predicted.
            carry_e, carry_n = int(fe >= one), int(fn >= one)
            fe -= np.float32(carry_e)
            fn -= np.float32(carry_n)
            at += carry_e + carry_n * stride
            sw, nw = flat[at], flat[at + stride]
            south = sw + fe * (flat[at + 1] - sw)
            north = nw + fe * (flat[at + stride + 1] - nw)
            depth = south + fn * (north - south)
            if k > 0:
                residual = differences[k - 1] - (depth - before)
                total += residual * residual
            before = depth
        log_w[i] += scale * total
        top = max(top, log_w[i])
    total_w = 0.0
    squares = 0.0
    for i in range(e.size):
        w[i] = math.exp(log_w[i] - top)
        total_w += w[i]
        squares += w[i] * w[i]
    inverse_w, log_total = 1.0 / total_w, top + math.log(total_w)
    for i in range(e.size):
        w[i] *= inverse_w
        log_w[i] -= log_total
    return total_w * total_w / squares


@numba.njit(fastmath=True, error_model="numpy", cache=False)
def resample(rng, e, n, c, log_w, w, e2, n2, c2, cdf, sums, copies, sigma):  # type: ignore[no-untyped-def]
    """(14): residual, with roughening of duplicates, into the second columns."""
    size = e.size
    total = 0.0
    left = size
    for i in range(size):
        expected = w[i] * size
        copies[i] = int(expected)
        left -= copies[i]
        total += expected - copies[i]
        cdf[i] = total
    # Sorted uniforms are sums of exponential spacings over the sum with one more: the search becomes a walk.
    sums[0] = rng.standard_exponential()
    for j in range(1, left + 1):
        sums[j] = sums[j - 1] + rng.standard_exponential()
    scale = total / sums[left]
    i = 0
    for j in range(left):
        while i < size - 1 and cdf[i] <= sums[j] * scale:
            i += 1
        copies[i] += 1
    at = 0
    for i in range(size):
        count = copies[i]
        rough = sigma if count > 1 else 0.0
        for _ in range(count):
            e2[at], n2[at] = e[i], n[i]
            if count > 1:
                e2[at] += rough * rng.standard_normal()
                n2[at] += rough * rng.standard_normal()
            c2[0, at], c2[1, at] = c[0, i], c[1, i]
            at += 1
    w[:] = 1.0 / size
    log_w[:] = -math.log(size)


@numba.njit(fastmath=True, error_model="numpy", cache=False)
def moments(e, n, w):  # type: ignore[no-untyped-def]
    """(10), (11)."""
    me, mn = 0.0, 0.0
    for i in range(e.size):
        me += w[i] * e[i]
        mn += w[i] * n[i]
    ee, en, nn = 0.0, 0.0, 0.0
    for i in range(e.size):
        de, dn = e[i] - me, n[i] - mn
        ee += w[i] * de * de
        en += w[i] * de * dn
        nn += w[i] * dn * dn
    return me, mn, ee, en, nn


@numba.njit(fastmath=True, error_model="numpy", cache=False)
def step(
    rng, now, later, c, c_later, log_w, w, scratch, copies, track, flat, geometry, model, command, sounding
):  # type: ignore[no-untyped-def]
    """One second: propagate, weigh, resample, estimate. True where the particles are in the second columns."""
    sigma, gain, sigma_like, roughening, size_of_track = model
    e, n = now[0], now[1]
    ce, cn = 0.0, 0.0
    for i in range(e.size):
        ce += w[i] * c[0, i]
        cn += w[i] * c[1, i]
    propagate(rng, e, n, c, command, sigma, gain)
    kept = int(size_of_track)
    track[:-1] = track[1:]
    track[-1, 0] = track[-2, 0] + command[0] + ce
    track[-1, 1] = track[-2, 1] + command[1] + cn
    track[-1, 2] = sounding
    shifts = np.empty(kept, np.int64)
    fractions = np.empty((kept, 2), np.float32)
    differences = np.empty(kept - 1, np.float32)
    for k in range(kept):
        row = track.shape[0] - kept + k
        x = (track[row, 0] - track[-1, 0]) * geometry[2]
        y = (track[row, 1] - track[-1, 1]) * geometry[2]
        shifts[k] = math.floor(y) * int(geometry[3]) + math.floor(x)
        fractions[k, 0], fractions[k, 1] = x - math.floor(x), y - math.floor(y)
        if k > 0:
            differences[k - 1] = track[row, 2] - track[row - 1, 2]
    resampled = False
    if kept > 1:
        scale = np.float32(-0.5 / (sigma_like * sigma_like))
        ess = weigh(e, n, log_w, w, flat, geometry, shifts, fractions, differences, scale)
        if ess <= 2.0 / 3.0 * e.size:
            resampled = True
            resample(
                rng,
                e,
                n,
                c,
                log_w,
                w,
                later[0],
                later[1],
                c_later,
                scratch[0],
                scratch[1],
                copies,
                roughening,
            )
    if resampled:
        return resampled, moments(later[0], later[1], w)
    return resampled, moments(e, n, w)


class NumbaFilter:
    """`dmpf` on numba, with the interface of `NumpyFilter`."""

    def __init__(
        self,
        positions_m: Array,
        depth_m: NDArray[np.float32],
        command_mps: Array,
        water_depth_m: Array,
        *,
        window: int,
        sigma_like_m: float,
        roughening_m2: float,
    ) -> None:
        size = len(positions_m)
        self.now, self.later = positions_m.T.copy(), np.empty((2, size))
        self.c, self.c_later = np.zeros((2, size)), np.empty((2, size))
        self.log_w, self.w = np.full(size, -math.log(size)), np.full(size, 1.0 / size)
        self.scratch, self.copies = np.empty((2, size + 1)), np.empty(size, np.int64)
        self.track = np.zeros((window + 1, 3))
        self.flat = depth_m.ravel()
        self.geometry = (0.0, 0.0, 1.0, float(depth_m.shape[1]))
        self.command_mps, self.water_depth_m = command_mps, water_depth_m
        self.sigma_like_m, self.roughening_m = sigma_like_m, math.sqrt(roughening_m2)
        self.p = 0.09
        self.rng = np.random.default_rng(3)
        self.second = self.resampled = 0

    def copy(self) -> NumbaFilter:
        """The same state, apart; chart and mission are shared."""
        twin = object.__new__(NumbaFilter)
        twin.__dict__.update(self.__dict__)
        for name in ("now", "later", "c", "c_later", "log_w", "w", "scratch", "copies", "track"):
            setattr(twin, name, getattr(self, name).copy())
        twin.rng = copy.deepcopy(self.rng)
        return twin

    def step(self) -> tuple[float, ...]:
        """One second; mean and covariance."""
        self.second += 1
        s = self.p + 0.05**2
        gain = self.p / s
        self.p += 0.01**2 - gain * self.p
        kept = float(min(self.second, len(self.track)))
        model = (math.sqrt(s), gain, self.sigma_like_m, self.roughening_m, kept)
        resampled, estimate = step(
            self.rng, self.now, self.later, self.c, self.c_later, self.log_w, self.w, self.scratch, self.copies,
            self.track, self.flat, self.geometry, model, self.command_mps[self.second - 1],
            self.water_depth_m[self.second],
        )  # fmt: skip
        if resampled:
            self.resampled += 1
            self.now, self.later = self.later, self.now
            self.c, self.c_later = self.c_later, self.c
        return estimate
