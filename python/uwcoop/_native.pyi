"""The compiled core: what Python may call. `mypy.stubtest` proves this file against the binary."""

from collections.abc import Mapping, Sequence
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "Chart",
    "Estimate",
    "Event",
    "Mission",
    "Navigator",
    "Replay",
    "TeamEstimator",
    "belief_exchange",
    "bilinear_depth",
    "bilinear_gradient",
    "cekf",
    "decode_belief",
    "decode_graph",
    "deif",
    "effective_sample_size",
    "encode_belief",
    "encode_graph",
    "filtered_error_delta",
    "fit_mixture",
    "interleaved",
    "kernel_entropy",
    "liu_west",
    "mdeif",
    "moments",
    "normalize",
    "offset_update",
    "origin_delta",
    "pattern_depths",
    "pose_graph",
    "propagate",
    "range_log_likelihood",
    "reconstruct_graph",
    "residual_resample",
    "roughen",
    "run_all",
    "schur_marginalize",
    "terrain_log_likelihood",
]

_F8 = NDArray[np.float64]
_I8 = NDArray[np.int64]

@final
class Chart:
    """An immutable depth grid: float32 (rows, cols), southernmost row first, positive down, NaN for holes."""

    def __new__(
        cls,
        depth_m: NDArray[np.float32],
        east0_m: float,
        north0_m: float,
        cell_m: float,
        sigma_map_m: float | NDArray[np.float32],
        sigma_map_fallback_m: float,
        correlation_length_m: float,
    ) -> Chart: ...
    def depth_at(self, points_m: _F8) -> _F8: ...
    @property
    def correlation_length_m(self) -> float: ...
    @property
    def mean_depth_m(self) -> float: ...

@final
class Event:
    """One thing that happened to one vehicle."""

    def __new__(cls, t_ns: int, vehicle: int, kind: str, **fields: Any) -> Event: ...
    @property
    def t_ns(self) -> int: ...
    @property
    def vehicle(self) -> int: ...
    @property
    def kind(self) -> str: ...
    @property
    def fields(self) -> dict[str, Any]: ...

@final
class Estimate:
    """Belief of one vehicle about its own pose."""

    @property
    def t_ns(self) -> int: ...
    @property
    def mean_m(self) -> _F8: ...
    @property
    def covariance_m2(self) -> _F8: ...
    @property
    def yaw_rad(self) -> float: ...
    @property
    def ess(self) -> float: ...
    @property
    def rejected(self) -> int: ...
    @property
    def status(self) -> str: ...

@final
class Navigator:
    """A native navigator; empty while a replay holds it."""

    @staticmethod
    def dead_reckoning(vehicle: int, options: dict[str, Any]) -> Navigator: ...
    @staticmethod
    def dmpf(
        vehicle: int,
        vehicles: int,
        options: dict[str, Any],
        chart: Chart | None,
        sound_speed_mps: float,
        seed: int,
    ) -> Navigator: ...
    @staticmethod
    def mpf(
        vehicle: int,
        vehicles: int,
        options: dict[str, Any],
        chart: Chart | None,
        sound_speed_mps: float,
        seed: int,
    ) -> Navigator: ...
    def handle(self, event: Event) -> str: ...
    def transmit(self, tol_ns: int, capacity_bytes: int) -> bytes | None: ...
    def estimate(self, t_ns: int) -> Estimate: ...
    def snapshot(self) -> bytes: ...
    def restore(self, snapshot: bytes) -> None: ...

@final
class Mission:
    """The navigators' half of a mission log."""

    def __new__(
        cls,
        vehicles: int,
        link: tuple[int, int, float, float, float],
        events: Mapping[str, Mapping[str, NDArray[Any]]],
        slots: Mapping[str, NDArray[Any]],
        opportunities: Mapping[str, NDArray[Any]],
        receptions: Mapping[str, NDArray[Any]],
        payloads: Sequence[bytes],
        end_ns: int,
    ) -> Mission: ...
    @property
    def vehicles(self) -> int: ...
    def air_time_s(self, bytes: int) -> float: ...

@final
class Replay:
    """One team replaying one mission."""

    def __new__(
        cls, mission: Mission, navigators: Sequence[Any] | TeamEstimator, sample_ns: _I8, cloud_every: int
    ) -> Replay: ...
    @property
    def seconds(self) -> float: ...
    def run(self, until_ns: int | None = None) -> None: ...
    def snapshot(self) -> bytes: ...
    def restore(self, snapshot: bytes) -> None: ...
    def tracks(self) -> dict[str, Any]: ...

@final
class TeamEstimator:
    """A centralised reference: fed the events of the whole team, transmits nothing. Empty while a replay holds it."""

def belief_exchange(
    vehicle: int, vehicles: int, options: dict[str, Any], ranging: bool, sound_speed_mps: float
) -> Navigator: ...
def cekf(options: dict[str, Any], ranging: Sequence[bool], sound_speed_mps: float) -> TeamEstimator: ...
def interleaved(
    vehicle: int, vehicles: int, options: dict[str, Any], ranging: bool, sound_speed_mps: float
) -> Navigator: ...
def run_all(replays: Sequence[Replay], threads: int) -> None: ...
def bilinear_depth(grid: _F8, east0_m: float, north0_m: float, cell_m: float, points_m: _F8) -> _F8: ...
def bilinear_gradient(grid: _F8, east0_m: float, north0_m: float, cell_m: float, points_m: _F8) -> _F8: ...
def pattern_depths(chart: Chart, positions_m: _F8, offsets_m: _F8) -> NDArray[np.float32]: ...
def propagate(
    positions_m: _F8,
    kalman: _F8,
    covariance: _F8,
    control_mps: Sequence[float] | _F8,
    dt_s: float,
    q_position: _F8,
    q_kalman: _F8,
    normals: _F8,
) -> tuple[_F8, _F8, _F8]: ...
def terrain_log_likelihood(
    grid: _F8,
    east0_m: float,
    north0_m: float,
    cell_m: float,
    positions_m: _F8,
    offsets_m: _F8,
    differences_m: _F8,
    sigma_m: float,
    missing: float,
) -> _F8: ...
def offset_update(
    water_depth_m: float,
    depths_m: _F8,
    offset_m: _F8,
    offset_variance_m2: _F8,
    sigma_m: float,
    q_offset_m: float,
    sigma_map_m: float,
    shared: float,
    student_dof: float,
) -> tuple[_F8, _F8, _F8]: ...
def range_log_likelihood(
    positions_m: _F8,
    mean_m: Sequence[float] | _F8,
    covariance_m2: _F8,
    range_m: float,
    sigma_m: float,
    method: str,
    samples: _F8 | None = None,
) -> _F8: ...
def normalize(log_weights: _F8) -> _F8: ...
def residual_resample(weights: _F8, uniforms: _F8) -> tuple[_I8, _I8]: ...
def roughen(positions_m: _F8, ancestors: _I8, counts: _I8, variance_m2: float, normals: _F8) -> _F8: ...
def liu_west(states: _F8, bandwidth: float, normals: _F8) -> _F8: ...
def moments(weights: _F8, positions_m: _F8) -> tuple[_F8, _F8]: ...
def fit_mixture(weights: _F8, positions_m: _F8, modes: int, iterations: int) -> tuple[_F8, _F8, _F8]: ...
def effective_sample_size(weights: _F8) -> float: ...
def kernel_entropy(weights: _F8, positions_m: _F8, sigma_m: float) -> float: ...
def encode_belief(
    mean_m: Sequence[float] | _F8,
    covariance_m2: _F8,
    *,
    depth_m: float,
    sequence: int,
    heard: int,
    sender: int,
    tol_ns: int,
    packet: str,
) -> bytes: ...
def decode_belief(packet: bytes, sender: int, tol_ns: int) -> dict[str, Any]: ...
def mdeif(
    vehicle: int, ranging: list[bool], options: dict[str, Any], sound_speed_mps: float
) -> Navigator: ...
def deif(
    vehicle: int,
    ranging: list[bool],
    options: dict[str, Any],
    repeats: int | None,
    sound_speed_mps: float,
) -> Navigator: ...
def schur_marginalize(matrix: _F8, vector: _F8, keep: Sequence[int]) -> tuple[_F8, _F8]: ...
def origin_delta(
    client_matrix: _F8, client_vector: _F8, server_matrix: _F8, server_vector: _F8
) -> dict[str, Any]: ...
def filtered_error_delta(
    client_matrix: _F8, client_vector: _F8, server_matrix: _F8, server_vector: _F8
) -> dict[str, Any]: ...
def pose_graph(
    mean0: _F8,
    covariance0: _F8,
    q_m2_per_s3: float,
    times_s: _F8,
    positions_m: _F8,
    sigma_m: float,
    tol_s: _F8,
    origins: Sequence[int],
) -> dict[str, Any]: ...
def reconstruct_graph(
    ids: Sequence[int],
    origins: Sequence[int],
    matrices: _F8,
    vectors: _F8,
    equation_6: bool = True,
    loss_max: float = 1e-4,
) -> dict[str, Any]: ...
def encode_graph(
    mean: _F8,
    covariance: _F8,
    origin_covariance: _F8 | None = None,
    transition: _F8 | None = None,
    *,
    packet: str,
    sequence: int,
    origin: int,
    depth_m: float,
    sender: int,
    tol_ns: int,
) -> bytes: ...
def decode_graph(bytes: bytes, *, packet: str, sender: int, tol_ns: int) -> dict[str, Any]: ...
