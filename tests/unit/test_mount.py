"""Sensors aboard a platform: where they are, and where what they see is."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from maritrack.errors import InputError
from maritrack.io.mount import Mount, aboard
from maritrack.io.pointdoc import header_of, scan_of
from maritrack.settings import InputConfig


def test_a_mount_turns_with_its_platform() -> None:
    assert_allclose(aboard(np.array([10.0, 0.0]), np.pi / 2, Mount(3.0, 1.0)), [13.0, -1.0], atol=1e-12)
    place = np.array([1.0, 2.0])
    assert aboard(place, np.nan, Mount(turn_rad=1.0)) is place
    with pytest.raises(InputError, match="no heading"):
        aboard(place, np.nan, Mount(forward_m=1.0))


@pytest.mark.parametrize("turn_deg", [0.0, 90.0])
def test_a_sensor_aboard_is_where_its_mount_is_and_turned_by_it(turn_deg: float) -> None:
    """Pose of the platform, place and turn of the sensor aboard, azimuths from the bow."""
    entry = {"forward_m": 2.0, "starboard_m": 1.0, "turn_deg": turn_deg}
    scan = {"time_s": 0.0, "pose": {"east_m": 100.0, "north_m": 0.0, "heading_deg": 90.0}, "points": [[10.0, 0.0]]}
    document = {"format": "maritrack-points/1", "frame": "polar", "sensors": {"a": entry}, "scans": [scan]}
    config = InputConfig(stabilised="head")
    found, _ = scan_of(scan, header_of(document, config=config), where="scan")
    assert_allclose(found.position_m, [102.0, -1.0], atol=1e-9)
    ahead = [112.0, -1.0] if turn_deg == 0.0 else [102.0, -11.0]
    assert found.points is not None
    assert_allclose(found.points.position_m, [ahead], atol=1e-9)
    north, _ = scan_of(scan, header_of(document, config=InputConfig()), where="scan")  # azimuths are true: no turn
    assert north.points is not None
    assert_allclose(north.points.position_m, [[102.0, 9.0]], atol=1e-9)


def test_a_mount_without_a_heading_is_an_error_that_names_the_scan() -> None:
    scan = {"time_s": 0.0, "pose": {"east_m": 100.0, "north_m": 0.0}, "points": []}
    document = {"format": "maritrack-points/1", "sensors": {"a": {"forward_m": 2.0}}, "scans": [scan]}
    with pytest.raises(InputError, match=r"scans.3.: .*no heading"):
        scan_of(scan, header_of(document, config=InputConfig()), where="scans[3]")
