"""Which quantities a sensor gives, and where the common message types and tables hold them.

A type that means one thing needs no line in `import.toml`. One that may mean several is not in these lists: it is asked
for by name.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

__all__ = ["COLUMN_NAMES", "DIMENSIONS", "NEEDS", "RANGE_NAMES", "Meaning", "meanings_of"]

NEEDS: dict[str, tuple[tuple[str, ...], ...]] = {
    "fix": (("latitude", "longitude"), ("east", "north")),
    "usbl": (("latitude", "longitude"), ("east", "north"), ("bearing", "range")),
    "heading": (("qx", "qy", "qz", "qw"), ("yaw",), ("heading",), ("mag_x", "mag_y")),
    "turn_rate": (("turn_rate",),),
    "ground_velocity": (("forward", "left"), ("forward", "right")),
    "water_velocity": (("forward", "left"), ("forward", "right"), ("forward",)),
    "command": (("east_velocity", "north_velocity"), ("speed",)),
    "odometry": (("x", "y", "qx", "qy", "qz", "qw"), ("x", "y", "yaw")),
    "depth": (("depth",), ("up",)),
    "pressure": (("pressure",),),
    "altimeter": (("altitude",), ("beam_0", "beam_1", "beam_2")),
    "water_depth": (("water_depth",),),
    "truth": (("latitude", "longitude"), ("east", "north")),
    "range": (("range",), ("travel",)),
}
"""By role: sets of quantities, one of which it takes."""
DIMENSIONS: dict[str, str] = {
    **dict.fromkeys(
        ("latitude", "longitude", "heading", "yaw", "roll", "pitch", "bearing", "elevation"), "angle"
    ),
    **dict.fromkeys(
        ("east", "north", "x", "y", "depth", "up", "altitude", "water_depth", "range", "least", "most"), "length"
    ),
    **{f"beam_{k}": "length" for k in range(8)},
    **dict.fromkeys(("forward", "left", "right", "speed", "east_velocity", "north_velocity"), "speed"),
    "turn_rate": "rate", "pressure": "pressure", "mag_x": "field", "mag_y": "field", "mag_z": "field", "age": "time",
    "travel": "time",
    "sigma": "number", "variance": "number",
}  # fmt: skip
"""Of quantities; one that is not here has no unit."""

_QUATERNION = {
    "qx": "orientation.x", "qy": "orientation.y", "qz": "orientation.z", "qw": "orientation.w",
}  # fmt: skip


@dataclass(frozen=True)
class Meaning:
    """What a channel of a type is."""

    role: str
    columns: Mapping[str, str]
    """Quantity to column. Those the role does not need may be absent."""
    units: Mapping[str, str] = field(default_factory=dict)
    """Of quantities that are not in metres, degrees, m/s, °/s or Pa."""
    frame: str = "enu"
    valid: str = ""
    """Condition of rows that count, where its column is there."""


def _prefixed(prefix: str, columns: Mapping[str, str]) -> dict[str, str]:
    return {quantity: prefix + column for quantity, column in columns.items()}


_RAD = {"yaw": "rad", "roll": "rad", "pitch": "rad", "turn_rate": "rad/s"}
_IMU = (
    Meaning(
        "heading",
        {**_QUATERNION, "variance": "orientation_covariance[8]", "unknown": "orientation_covariance[0]"},
    ),
    Meaning(
        "turn_rate", {"turn_rate": "angular_velocity.z", "variance": "angular_velocity_covariance[8]"}, _RAD
    ),
)
_TWIST = Meaning(
    "ground_velocity",
    {"forward": "twist.twist.linear.x", "left": "twist.twist.linear.y", "variance": "twist.covariance[0]"},
    frame="flu",
)
_POSITION = {
    "east": "pose.pose.position.x", "north": "pose.pose.position.y", "cov_ee": "pose.covariance[0]",
    "cov_en": "pose.covariance[1]", "cov_nn": "pose.covariance[7]",
}  # fmt: skip
_POSE = {"x": "pose.pose.position.x", "y": "pose.pose.position.y", **_prefixed("pose.pose.", _QUATERNION)}
_FIX = {
    "latitude": "latitude", "longitude": "longitude", "cov_ee": "position_covariance[0]",
    "cov_en": "position_covariance[1]", "cov_nn": "position_covariance[4]", "known": "position_covariance_type",
}  # fmt: skip

TYPES: dict[str, tuple[Meaning, ...]] = {
    "sensor_msgs/msg/NavSatFix": (Meaning("fix", _FIX, valid="status.status >= 0"),),
    "sensor_msgs/msg/Imu": _IMU,
    "sensor_msgs/msg/MagneticField": (
        Meaning("heading", {f"mag_{axis}": f"magnetic_field.{axis}" for axis in "xyz"}, frame="flu"),
    ),
    "geometry_msgs/msg/QuaternionStamped": (
        Meaning("heading", {quantity: f"quaternion.{column[-1]}" for quantity, column in _QUATERNION.items()}),
    ),
    "geometry_msgs/msg/TwistWithCovarianceStamped": (_TWIST,),
    "geometry_msgs/msg/PoseWithCovarianceStamped": (Meaning("usbl", _POSITION),),
    "nav_msgs/msg/Odometry": (Meaning("odometry", _POSE),),
    "sensor_msgs/msg/Range": (
        Meaning("altimeter", {"altitude": "range", "least": "min_range", "most": "max_range", "variance": "variance"}),
    ),
    "sensor_msgs/msg/FluidPressure": (Meaning("pressure", {"pressure": "fluid_pressure", "variance": "variance"}),),
    "mavlink/GPS_RAW_INT": (
        Meaning(
            "fix", {"latitude": "lat", "longitude": "lon"}, {"latitude": "dege7", "longitude": "dege7"},
            valid="fix_type >= 3",
        ),
    ),
    "mavlink/ATTITUDE": (
        Meaning("heading", {"yaw": "yaw", "roll": "roll", "pitch": "pitch"}, _RAD, "ned"),
        Meaning("turn_rate", {"turn_rate": "yawspeed"}, _RAD, "frd"),
    ),
    "mavlink/SCALED_PRESSURE2": (Meaning("pressure", {"pressure": "press_abs"}, {"pressure": "hpa"}),),
    "mavlink/DISTANCE_SENSOR": (
        Meaning(
            "altimeter", {"altitude": "current_distance", "least": "min_distance", "most": "max_distance"},
            dict.fromkeys(("altitude", "least", "most"), "cm"), valid="orientation == 25",
        ),
    ),
    "dataflash/GPS": (Meaning("fix", {"latitude": "Lat", "longitude": "Lng"}, valid="Status >= 3"),),
    "dataflash/ATT": (Meaning("heading", {"yaw": "Yaw", "roll": "Roll", "pitch": "Pitch"}, frame="ned"),),
    "dataflash/CTUN": (Meaning("depth", {"up": "Alt"}),),
    "dataflash/RFND": (Meaning("altimeter", {"altitude": "Dist"}),),
    "imc/GpsFix": (
        Meaning(
            "fix", {"latitude": "lat", "longitude": "lon", "sigma": "hacc"}, {"latitude": "rad", "longitude": "rad"},
            valid="validity_pos == 1",
        ),
    ),
    "imc/EulerAngles": (
        Meaning("heading", {"yaw": "psi", "roll": "phi", "pitch": "theta"}, _RAD, "ned"),
    ),
    "imc/AngularVelocity": (Meaning("turn_rate", {"turn_rate": "z"}, _RAD, "frd"),),
    "imc/GroundVelocity": (
        Meaning("ground_velocity", {"forward": "x", "left": "y"}, frame="frd", valid="valid_xy == 1"),
    ),
    "imc/WaterVelocity": (Meaning("water_velocity", {"forward": "x", "left": "y"}, frame="frd", valid="valid_xy == 1"),),
    "imc/Depth": (Meaning("depth", {"depth": "value"}),),
    "imc/Pressure": (Meaning("pressure", {"pressure": "value"}, {"pressure": "hpa"}),),
    "imc/Distance": (Meaning("altimeter", {"altitude": "value"}, valid="validity == 1"),),
}  # fmt: skip
"""By type as readers name it."""

_DVL_VARIANCES = ("velocity_covar[0]", "velocity_covariance[0]", "covariance[0]")
_DVL_VALID = ("velocity_valid == 1", "beam_velocities_valid == 1")
_FRD_DRIVERS = ("dvl_msgs/", "waterlinked")
"""Drivers that pass on what the instrument says, whose z axis points down."""
_MOOS: dict[str, dict[str, tuple[str, ...]]] = {
    "heading": {"heading": ("NAV_HEADING", "INS_HEADING", "COMPASS_HEADING")},
    "depth": {"depth": ("NAV_DEPTH", "DEPTH")},
    "altimeter": {"altitude": ("NAV_ALTITUDE", "ALTIMETER", "DVL_ALTITUDE")},
    "fix": {"latitude": ("GPS_LATITUDE", "GPS_LAT"), "longitude": ("GPS_LONGITUDE", "GPS_LONG", "GPS_LON")},
    "command": {"speed": ("NAV_SPEED",)},
}


def meanings_of(kind: str, labels: frozenset[str]) -> list[Meaning]:
    """What a channel of this type with these columns is, as far as the type alone tells."""
    if kind in TYPES:
        return [m for m in TYPES[kind] if _needs_met(m, labels)]
    if {"velocity.x", "velocity.y"} <= labels and ("dvl" in kind.lower() or "altitude" in labels):
        return _of_dvl(kind, labels)
    if kind.startswith("moos/"):
        return _of_moos(labels)
    return []


def _needs_met(meaning: Meaning, labels: frozenset[str]) -> bool:
    return any(
        all(q in meaning.columns and meaning.columns[q] in labels for q in need)
        for need in NEEDS[meaning.role]
    )


def _of_dvl(kind: str, labels: frozenset[str]) -> list[Meaning]:
    """A DVL's report: velocity over ground, and the distance to the seabed or of its beams."""
    frame = "frd" if kind.lower().startswith(_FRD_DRIVERS) else "flu"
    velocity = {"forward": "velocity.x", "left": "velocity.y"}
    if variance := next((name for name in _DVL_VARIANCES if name in labels), None):
        velocity["variance"] = variance
    valid = next((text for text in _DVL_VALID if text.split()[0] in labels), "")
    found = [Meaning("ground_velocity", velocity, frame=frame, valid=valid)]
    beams: dict[str, str] = next(
        (
            {f"beam_{k}": form.format(k) for k in range(8) if form.format(k) in labels}
            for form in ("beams[{}].distance", "beams[{}].range", "range[{}]", "ranges[{}]")
            if form.format(0) in labels
        ),
        {},
    )
    distance = {"altitude": "altitude"} if "altitude" in labels else {}
    if distance or beams:
        found.append(Meaning("altimeter", {**distance, **beams}))
    return found


def _of_moos(labels: frozenset[str]) -> list[Meaning]:
    found = []
    for role, quantities in _MOOS.items():
        columns = {q: name for q, names in quantities.items() for name in names[::-1] if name in labels}
        if len(columns) == len(quantities):
            found.append(Meaning(role, columns))
    return found


COLUMN_NAMES: dict[str, set[str]] = {
    "latitude": {"latitude", "lat", "gps lat", "gps latitude", "fix lat"},
    "longitude": {"longitude", "lon", "long", "lng", "gps lon", "gps long", "gps longitude", "fix lon"},
    "heading": {"heading", "hdg", "compass", "true heading", "compass heading"},
    "yaw": {"yaw"},
    "roll": {"roll", "roll angle"},
    "pitch": {"pitch", "pitch angle"},
    "turn_rate": {"turn rate", "yaw rate", "gyro z", "r"},
    "forward": {
        "vel fwd",
        "vel forward",
        "forward",
        "forward velocity",
        "dvl x",
        "dvl vx",
        "vx",
        "u",
        "surge",
    },
    "left": {"vel left", "left", "left velocity", "vel port", "port velocity"},
    "right": {"vel right", "vel starboard", "vel stbd", "starboard velocity", "right velocity"},
    "speed": {"speed", "water speed", "vehicle speed", "speed through water"},
    "depth": {"depth", "vehicle depth", "own depth", "dfs depth", "depth from surface"},
    "pressure": {"pressure", "press"},
    "altitude": {
        "altitude",
        "height",
        "dtb height",
        "alt",
        "altimeter",
        "height above bottom",
        "dvl altitude",
    },
    "water_depth": {
        "water depth",
        "total water column",
        "sounding",
        "seabed depth",
        "bottom depth",
        "bathymetry",
    },
    "sigma": set(),
}
"""What columns of tables are called, their unit aside."""
TABLE_ROLES: tuple[tuple[str, str], ...] = (
    ("fix", "latitude"), ("heading", "heading"), ("heading", "yaw"), ("turn_rate", "turn_rate"),
    ("ground_velocity", "forward"), ("command", "speed"), ("depth", "depth"), ("pressure", "pressure"),
    ("altimeter", "altitude"), ("water_depth", "water_depth"),
)  # fmt: skip
"""Roles that a table plays by a quantity's column."""
RANGE_NAMES: dict[str, set[str]] = {
    "from": {"from", "sender", "source", "vehicle", "own", "poller", "interrogator"},
    "to": {"to", "receiver", "target", "peer", "beacon", "transponder"},
    "range": {"range", "distance", "slant range"},
    "travel": {"travel time", "owtt", "twtt", "tof", "time of flight"},
    "kind": {"kind", "type", "mode"},
    "sigma": {"sigma", "std", "range sigma"},
}
"""Columns of a table of acoustic ranges."""
