"""A grid of float32 as bytes: canonical for its digest, and packed so that it compresses well."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["canonical_bytes", "packed", "unpacked"]


def canonical_bytes(grid: NDArray[np.float32]) -> bytes:
    """Little-endian, row by row; holes and zeros each have one bit pattern."""
    canonical = np.where(np.isnan(grid), np.float32(np.nan), grid + np.float32(0))
    return canonical.astype("<f4").tobytes()


def packed(grid: NDArray[np.float32]) -> bytes:
    """Differences along each row of the bit patterns, byte plane by byte plane: neighbouring depths share their leading
    bits, so that this compresses well."""
    bits = np.ascontiguousarray(grid, dtype="<f4").view("<u4")
    steps = np.diff(bits, axis=1, prepend=np.zeros((bits.shape[0], 1), dtype="<u4"))
    return np.ascontiguousarray(steps).view(np.uint8).reshape(-1, 4).T.tobytes()


def unpacked(content: bytes, shape: tuple[int, int]) -> NDArray[np.float32]:
    """What `packed` was given.

    Raises:
        ValueError: not as many bytes as the shape needs.
    """
    rows, cols = shape
    if len(content) != 4 * rows * cols:
        raise ValueError(f"{len(content)} bytes of depths do not fill {rows} x {cols} nodes")
    planes = np.frombuffer(content, dtype=np.uint8).reshape(4, -1)
    steps = np.ascontiguousarray(planes.T).view("<u4").reshape(shape)
    return np.cumsum(steps, axis=1, dtype=np.uint32).astype("<u4").view("<f4").astype(np.float32)
