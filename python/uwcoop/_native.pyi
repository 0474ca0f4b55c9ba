"""The compiled core: what Python may call. `mypy.stubtest` proves this file against the binary."""

from collections.abc import Mapping, Sequence
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "Authenticator",
    "CentralEstimator",
    "Chart",
    "Estimate",
    "Event",
    "Mission",
    "Navigator",
    "Replay",
    "bilinear_depth",
    "bilinear_gradient",
    "bound",
    "decode_belief",
    "decode_exchange",
    "decode_graph",
    "drift_presets",
    "effective_sample_size",
    "encode_belief",
    "encode_exchange",
    "encode_graph",
    "event_bounds",
    "expand_exchange",
    "filtered_error_delta",
    "fit_gaussian_mixture",
    "fit_mixture",
    "kernel_entropy",
    "landmark_from_polar",
    "landmark_log_likelihood",
    "landmark_monitor",
    "landmark_new_particles",
    "landmark_offsets",
    "landmark_polar",
    "landmark_predict",
    "landmark_reconstruct",
    "late_range",
    "liu_west",
    "make_central",
    "make_navigator",
    "moments",
    "navigator_options",
    "normalize",
    "offset_update",
    "origin_delta",
    "packaged_navigators",
    "pattern_depths",
    "pose_graph",
    "propagate",
    "range_log_likelihood",
    "reconstruct_graph",
    "residual_resample",
    "roughen",
    "run_all",
    "schur_marginalize",
    "systematic_resample",
    "terrain_log_likelihood",
    "unread_options",
]

_F8 = NDArray[np.float64]
_I8 = NDArray[np.int64]

@final
class Authenticator:
    """Tags of a team's packets: HMAC-SHA-256 over packet, sender and launch time, cut to `tag_bytes`."""

    def __new__(cls, key: bytes, tag_bytes: int, mission: int) -> Authenticator: ...
    @property
    def tag_bytes(self) -> int: ...
    def append_tag(self, packet: bytes, sender: int, tol_ns: int) -> bytes: ...
    def check_tag(self, tagged: bytes, sender: int, tol_ns: int) -> bytes | None: ...

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

def event_bounds() -> list[tuple[str, str, float, float, bool]]: ...

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

    def handle(self, event: Event) -> str: ...
    def transmit(self, tol_ns: int, capacity_bytes: int) -> bytes | None: ...
    def transmit_described(
        self, tol_ns: int, capacity_bytes: int
    ) -> tuple[
        bytes | None, list[tuple[str, int, int, tuple[str, float, float, str, float, str] | None]]
    ]: ...
    def authenticated(self, vehicle: int, vehicles: int, authenticator: Authenticator) -> Navigator: ...
    def estimate(self, t_ns: int) -> Estimate: ...
    def snapshot(self) -> bytes: ...
    def restore(self, snapshot: bytes) -> None: ...
    def diagnostics(self) -> dict[str, float]: ...
    def particles(self) -> tuple[_F8, _F8] | None: ...

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
        polls: Mapping[str, NDArray[Any]] | None = None,
    ) -> Mission: ...
    @property
    def vehicles(self) -> int: ...
    def air_time_s(self, bytes: int) -> float: ...

@final
class Replay:
    """One team replaying one mission."""

    def __new__(
        cls, mission: Mission, navigators: Sequence[Any] | CentralEstimator, sample_ns: _I8, cloud_every: int
    ) -> Replay: ...
    @property
    def seconds(self) -> float: ...
    def authenticate(self, authenticator: Authenticator) -> None: ...
    def run(self, until_ns: int | None = None) -> None: ...
    def snapshot(self) -> bytes: ...
    def restore(self, snapshot: bytes) -> None: ...
    def tracks(self) -> dict[str, Any]: ...

@final
class CentralEstimator:
    """A centralised reference: fed the events of the whole team, transmits nothing. Empty while a replay holds it."""

def bound(
    chart: Chart | None,
    truth_ns: _I8,
    truth_m: _F8,
    events: Mapping[str, Mapping[str, Any]],
    ranges: Mapping[str, _I8],
    options: tuple[str, str],
    counted: tuple[bool, bool, bool],
    sample_ns: _I8,
) -> _F8: ...
def packaged_navigators() -> str: ...
def navigator_options() -> str: ...
def drift_presets() -> str: ...
def unread_options(name: str, stated: str) -> list[tuple[str, str]]: ...
def make_navigator(
    name: str,
    vehicle: int,
    vehicles: int,
    sound_speed_mps: float,
    seed: int,
    ranging: Sequence[bool],
    stated: str,
    chart: Chart | None,
) -> Navigator: ...
def make_central(
    name: str, vehicles: int, sound_speed_mps: float, ranging: Sequence[bool], stated: str
) -> CentralEstimator: ...
def run_all(replays: Sequence[Replay], threads: int) -> None: ...
def bilinear_depth(grid: _F8, east0_m: float, north0_m: float, cell_m: float, points_m: _F8) -> _F8: ...
def bilinear_gradient(grid: _F8, east0_m: float, north0_m: float, cell_m: float, points_m: _F8) -> _F8: ...
def pattern_depths(
    chart: Chart, positions_m: _F8, offsets_m: _F8, out: NDArray[np.float32] | None = None
) -> NDArray[np.float32]: ...
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
def late_range(
    innovation_m: _F8,
    variance_m2: _F8,
    gain_m2: _F8,
    late_share: float,
    lateness_m: float,
    floor_per_m: float,
) -> tuple[_F8, _F8, _F8]: ...
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
def landmark_predict(
    particles: _F8,
    velocity_mps: Sequence[float] | _F8,
    yaw_rate_radps: float,
    dt_s: float,
    sigma_mps: float,
    sigma_radps: float,
    normals: _F8,
) -> _F8: ...
def landmark_offsets(particles: _F8, at_transmit: _F8, measured: Sequence[float] | _F8) -> _F8: ...
def landmark_log_likelihood(
    offsets: _F8,
    sigma: Sequence[float] | _F8,
    threshold: Sequence[float] | _F8,
    gate_name: str,
    outlier_share: float = 0.05,
    widths: Sequence[float] | _F8 = ...,
) -> tuple[_F8, _F8, float]: ...
def systematic_resample(weights: _F8, u0: float, count: int) -> _I8: ...
def landmark_monitor(
    log_mean: _F8, log_max: _F8, ratio: float, trials: int, monitor_reading: str
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]: ...
def landmark_new_particles(count: int, share: float, log_mean: float, log_max: float) -> int: ...
def landmark_reconstruct(
    particles: _F8,
    at_transmit: _F8,
    log_likelihood: _F8,
    measured: Sequence[float] | _F8,
    sigma: Sequence[float] | _F8,
    new: int,
    normals: _F8,
    u0: float,
) -> tuple[_F8, _I8, _I8]: ...
def landmark_polar(particles: _F8) -> _F8: ...
def landmark_from_polar(polar: _F8) -> _F8: ...
def fit_gaussian_mixture(
    weights: _F8,
    points: _F8,
    circular: Sequence[bool],
    modes: int,
    *,
    choose_by: str | None = None,
    starts: int = 3,
    iterations: int = 200,
    tolerance: float = 1e-9,
    ridge_one: float = 1e-9,
    ridge_many: float = 1e-3,
    seed: int = 0,
    first: tuple[_F8, _F8, _F8] | None = None,
) -> dict[str, Any]: ...
def expand_exchange(weights: _F8, means: _F8, covariances: _F8, normals: _F8) -> _F8: ...
def encode_exchange(
    weights: _F8,
    means: _F8,
    covariances: _F8,
    *,
    packet_bytes: int,
    packet_format: int,
    sequence: int,
    sender: int,
    tol_ns: int,
) -> bytes: ...
def decode_exchange(
    packet: bytes,
    *,
    packet_format: int,
    landmark_m: Sequence[float] | _F8,
    sender: int,
    tol_ns: int,
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
