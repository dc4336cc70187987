"""Point clouds as they come from LiDARs: several aboard as one, and of each sector of bearing the nearest return."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.testing import assert_allclose

from maritrack.chain import detect
from maritrack.config import load_config
from maritrack.detect.cells import nearest_in_sectors
from maritrack.errors import ConfigError, InputError
from maritrack.geo import polar_to_en
from maritrack.io.fuse import united
from maritrack.settings import InputConfig
from maritrack.types import FloatArray, Frame, Points, Scan, Sensor
from tests.cli.calling import call


def cloud(range_m: FloatArray, azimuth_rad: FloatArray, *, at_m: tuple[float, float] = (0.0, 0.0)) -> Points:
    n, none = len(range_m), np.zeros(len(range_m))
    return Points(
        range_m=range_m, azimuth_rad=azimuth_rad, position_m=np.array(at_m) + polar_to_en(range_m, azimuth_rad),
        intensity=np.ones(n), t_ns=np.zeros(n, np.int64), range_width_m=none, azimuth_width_rad=none,
        truth_label=np.arange(n),
    )  # fmt: skip


def scan_of(points: Points | None, t_ns: int = 0, *, name: str = "a", at_m: tuple[float, float] = (0.0, 0.0)) -> Scan:
    return Scan(Sensor(name, 0.0, 0.0, 50.0), t_ns, t_ns, np.array(at_m), 0.5, points=points)


ranges = hnp.arrays(float, st.integers(0, 60), elements=st.floats(0.0, 100.0))


@given(ranges, st.sampled_from([0.25, 1.0, 7.0, 90.0]), st.integers(0, 99))
@settings(derandomize=True, deadline=None, max_examples=80)
def test_every_sector_keeps_its_nearest_point_and_no_other(range_m: FloatArray, sector_deg: float, seed: int) -> None:
    azimuth_rad = np.random.default_rng(seed).uniform(0.0, 2 * np.pi, len(range_m))
    kept = nearest_in_sectors(cloud(range_m, azimuth_rad), sector_deg)
    nearest: dict[int, int] = {}
    for i, sector in enumerate(np.floor(np.rad2deg(azimuth_rad) / sector_deg + 1e-9).astype(int).tolist()):
        if sector not in nearest or range_m[i] < range_m[nearest[sector]]:
            nearest[sector] = i
    assert np.flatnonzero(kept).tolist() == sorted(nearest.values())


def test_the_settings_choose_sectors_and_the_region_comes_first() -> None:
    points = cloud(np.array([2.0, 5.0, 9.0, 7.0]), np.deg2rad([10.1, 10.2, 10.3, 40.0]))
    config = load_config(preset="points", sets=["input.sector_deg=1.0", "input.roi_min_m=3.0"])
    assert detect(scan_of(points), config).range_m.tolist() == [5.0, 7.0]
    assert len(detect(scan_of(points), load_config(preset="points"))) == 4


def frames(*scans: Scan) -> Iterator[Frame]:
    return iter([Frame(k, scan, inputs=((f"/{k}", b"x"),)) for k, scan in enumerate(scans)])


def test_scans_of_one_instant_are_one_cloud_seen_from_between_the_sensors() -> None:
    fore = scan_of(cloud(np.array([10.0]), np.array([0.0]), at_m=(0.0, 2.0)), name="fore", at_m=(0.0, 2.0))
    aft = scan_of(cloud(np.array([6.0, 3.0]), np.array([0.0, np.pi]), at_m=(0.0, -2.0)), name="aft", at_m=(0.0, -2.0))
    later = replace(fore, t_ns=10)
    one, two = united(frames(fore, aft, later), "cloud")
    assert (one.k, two.k, one.scan.sensor.id, one.scan.heading_rad) == (0, 1, "cloud", 0.5)
    assert one.scan.points is not None and two.scan.points is not None
    assert_allclose(one.scan.position_m, [0.0, 0.0])
    assert_allclose(one.scan.points.position_m, [[0, 12], [0, 4], [0, -5]], atol=1e-12)
    assert_allclose(one.scan.points.range_m, [12.0, 4.0, 5.0])
    assert_allclose(one.scan.points.azimuth_rad, [0.0, 0.0, np.pi], atol=1e-12)
    assert one.inputs == (("/0", b"x"), ("/1", b"x")) and len(two.scan.points) == 1
    assert one.scan.points.truth_label is not None and one.scan.points.truth_label.tolist() == [0, 0, 1]


def test_what_not_all_clouds_tell_is_unknown_in_the_whole() -> None:
    points = cloud(np.array([10.0]), np.array([0.0]))
    (one,) = united(frames(scan_of(points), scan_of(replace(points, truth_label=None))), "x")
    assert one.scan.points is not None and one.scan.points.truth_label is None and len(one.scan.points) == 2


def test_without_a_name_frames_stay_as_they_are_and_video_is_refused() -> None:
    scans = [scan_of(cloud(np.zeros(0), np.zeros(0)), t) for t in (0, 0, 5)]
    assert [frame.scan for frame in united(frames(*scans), "")] == scans
    with pytest.raises(InputError, match="video"):
        list(united(frames(scan_of(None)), "x"))


@pytest.mark.parametrize("change", [{"sector_deg": -1.0}, {"sector_deg": 91.0}, {"unite": "a/b"}])
def test_settings_of_lidar_input_are_checked(change: dict[str, object]) -> None:
    with pytest.raises(ConfigError, match=r"input\.(sector_deg|unite)"):
        InputConfig(**change)  # type: ignore[arg-type]


def test_two_lidars_of_a_ferry_are_one_sensor_from_the_command_line_to_the_replay(tmp_path: Path) -> None:
    rec, out = tmp_path / "rec.json", tmp_path / "run"
    call("simulate", "canal-1", "-o", rec, "--scans", "30")
    unite = ("--set", "input.unite=ferry", "--set", "input.sector_deg=0.3515625")
    done = call("process", rec, "--preset", "points", *unite, "--no-rrd", "-o", out, "--json").json
    apart = call("process", rec, "--preset", "points", "--no-rrd", "-o", tmp_path / "apart", "--json").json
    assert done["counts"]["scans"] == 30 and apart["counts"]["scans"] == 60
    assert 0 < done["counts"]["points"] < apart["counts"]["points"]
    assert call("replay", out / "run.mcap", "--verify", "--no-rrd").code == 0
