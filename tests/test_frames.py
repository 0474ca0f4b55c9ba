"""Conventions are converted in one place: headings, yaw angles, and places on Earth."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from uwcoop.errors import ChartError
from uwcoop.frames import LocalFrame, Origin, crs_of, heading_from_yaw, wrap_angle, yaw_from_heading


@pytest.mark.parametrize(
    ("heading_deg", "yaw_deg"), [(0, 90), (90, 0), (180, -90), (270, 180), (45, 45), (360, 90), (-90, 180)]
)
def test_heading_is_clockwise_from_north_and_yaw_counterclockwise_from_east(
    heading_deg: float, yaw_deg: float
) -> None:
    assert np.rad2deg(yaw_from_heading(heading_deg)) == pytest.approx(yaw_deg)
    assert heading_from_yaw(np.deg2rad(yaw_deg)) == pytest.approx(heading_deg % 360)


@given(st.floats(-1e6, 1e6))
def test_heading_survives_the_way_there_and_back(heading_deg: float) -> None:
    back = float(heading_from_yaw(yaw_from_heading(heading_deg)))
    assert 0 <= back < 360
    assert abs((back - heading_deg + 180) % 360 - 180) < 1e-7


@given(st.floats(-1e4, 1e4))
def test_wrapped_angle_is_the_same_angle_within_half_a_turn(angle: float) -> None:
    wrapped = float(wrap_angle(angle))
    assert -np.pi < wrapped <= np.pi
    assert np.cos(wrapped - angle) == pytest.approx(1.0)


def test_angles_convert_element_by_element() -> None:
    np.testing.assert_allclose(yaw_from_heading([0.0, 90.0]), [np.pi / 2, 0.0], atol=1e-15)
    assert heading_from_yaw(np.zeros((2, 3))).shape == (2, 3)


@given(st.floats(-79, 79), st.floats(-179, 179), st.floats(-3000, 3000), st.floats(-3000, 3000))
def test_local_metres_survive_the_way_over_latitude_and_longitude(
    latitude: float, longitude: float, east: float, north: float
) -> None:
    frame = LocalFrame.at(latitude, longitude)
    geographic = frame.to_geographic([[east, north]])
    np.testing.assert_allclose(frame.to_local(geographic[:, 0], geographic[:, 1]), [[east, north]], atol=1e-6)


def test_local_metres_are_distances_on_the_ellipsoid() -> None:
    from pyproj import Geod

    frame = LocalFrame.at(35.16, 139.61)
    places = frame.to_geographic([[0.0, 0.0], [1200.0, -900.0]])
    azimuth, _, distance = Geod(ellps="WGS84").inv(places[0, 1], places[0, 0], places[1, 1], places[1, 0])
    assert distance == pytest.approx(1500.0, abs=1e-3)
    assert azimuth == pytest.approx(np.rad2deg(np.arctan2(1200, -900)), abs=1e-3)
    assert "true north" in frame.description


def test_grid_frame_keeps_grid_metres_and_says_how_its_north_is_turned() -> None:
    frame = LocalFrame.at(35.16, 139.61, "EPSG:32654")
    local = frame.to_local(35.17, 139.62)[0]
    from pyproj import Transformer

    east, north = Transformer.from_crs("EPSG:4326", "EPSG:32654", always_xy=True).transform(139.62, 35.17)
    np.testing.assert_allclose(local, np.subtract((east, north), frame.offset_m), atol=1e-9)
    # West of the zone's meridian (141 E) grid north lies west of true north.
    assert frame.convergence_deg == pytest.approx(-0.80, abs=0.01)
    assert "0.80 deg west of true north" in frame.description


def test_positions_in_another_projection_become_local() -> None:
    frame = LocalFrame.at(35.16, 139.61)
    from pyproj import Transformer

    x, y = Transformer.from_crs("EPSG:4326", "EPSG:32654", always_xy=True).transform(139.62, 35.17)
    np.testing.assert_allclose(
        frame.local_from(crs_of("EPSG:32654"), [x], [y]), frame.to_local(35.17, 139.62), atol=1e-4
    )


def test_a_frame_needs_a_place_and_a_known_projection() -> None:
    with pytest.raises(ChartError, match="no geographic origin"):
        LocalFrame(Origin())
    with pytest.raises(ChartError, match="latitude 95 deg is outside -90 to 90"):
        LocalFrame.at(95, 0)
    with pytest.raises(ChartError, match="longitude 400 deg"):
        LocalFrame.at(5, 400)
    with pytest.raises(ChartError, match=r"'EPSG:0' is unknown"):
        LocalFrame.at(5, 5, "EPSG:0").to_local(5, 5)
