"""Units and texts of what navigators state beside their estimate: a variable each in the tracks."""

from __future__ import annotations

__all__ = ["TEXTS", "attributes_of"]

TEXTS = {
    "current_east_mps": "estimated current, east",
    "current_north_mps": "estimated current, north",
    "sigma_current_east_mps": "standard deviation of the estimated current, east",
    "sigma_current_north_mps": "standard deviation of the estimated current, north",
    "heading_bias_rad": "estimated compass bias, clockwise",
    "sigma_heading_bias_rad": "standard deviation of the estimated compass bias",
    "thrust_bias_mps": "estimated thrust bias",
    "sigma_thrust_bias_mps": "standard deviation of the estimated thrust bias",
    "datum_offset_m": "estimated datum offset (tide), positive = deeper than the chart",
    "sigma_datum_offset_m": "standard deviation of the estimated datum offset",
    "alarms": "alarms of the health monitor so far",
    "restarts": "restarts at repeated fixes that contradicted the belief so far",
    "gated_fixes": "fixes gated so far",
    "gated_soundings": "soundings gated so far",
    "gated_ranges": "ranges gated so far",
    "rejected_packets": "packets rejected so far",
    "teammates_heard": "teammates heard so far",
    "teammate_longest_unheard_s": "time since the last packet of the teammate that was silent longest",
    "teammate_largest_sigma_m": "largest position sigma of a teammate, at the launch of its last packet",
    "origin_age_s": "age of the origin of the newest node",
    "origin_correlation": "correlation of the newest node with its origin, of the axis where it is larger",
    "updates_information_nat": "mutual information of the position and all measurement updates so far",
    "graph_nodes": "nodes of the pose graph",
}
"""Text of each diagnostic of the packaged navigators that has one; the name says the others."""

_UNITS = {
    "_radps": "rad/s",
    "_mps": "m/s",
    "_rad": "rad",
    "_m": "m",
    "_s": "s",
    "_ns": "ns",
    "_nat": "nat",
    "_m2": "m2",
}


def attributes_of(name: str) -> dict[str, str]:
    """Attributes of a diagnostic's variable: its unit is the end of its name, 1 for a count or a share."""
    units = next((unit for end, unit in _UNITS.items() if name.endswith(end)), "1")
    text = TEXTS.get(name, name.replace("_", " "))
    return {"role": "diagnostic", "units": units, "long_name": text}
