"""Turns to scans: azimuth, range, place."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from maritrack.geo import wrap
from maritrack.io.cat240.radials import Radials
from maritrack.io.pose import PoseTrack
from maritrack.io.turns.assemble import Assembler
from maritrack.io.turns.scans import scan_of, swept_bins
from maritrack.settings import InputConfig
from maritrack.types import Scan, take
from tests.io.spins import TURN, radials, spin


def scans_of(of: Radials, pose: PoseTrack | None = None, *, midnight_ns: int = 0, **config: Any) -> list[Scan]:
    assembler = Assembler()
    cuts = [*assembler.push(of), *assembler.finish()]
    settings_ = InputConfig(**config)
    pose = pose or PoseTrack.fixed()
    return [scan_of(cut.turn, settings_, pose, midnight_ns=midnight_ns) for cut in cuts if cut.turn is not None]


def azimuth_deg(scan: Scan) -> np.ndarray[Any, Any]:
    assert scan.video is not None
    return np.rad2deg(scan.video.azimuth_rad)


@pytest.mark.parametrize(("edge", "share"), [("start", 0.0), ("centre", 0.5), ("end", 1.0)])
def test_the_azimuth_is_taken_at_the_edge_that_is_asked_for(edge: Any, share: float) -> None:
    (scan,) = scans_of(radials(np.arange(60) * 1024, width=1024), azimuth_edge=edge)
    assert_allclose(azimuth_deg(scan), (np.arange(60) + share) * 360 / 64)


def test_a_spoke_across_north_has_its_centre_there() -> None:
    (scan,) = scans_of(radials(65_520 + np.arange(60) * 1024, width=32))
    assert azimuth_deg(scan)[0] == pytest.approx(0.0)


@pytest.mark.parametrize("width", [0, 40_000, 65_535])
def test_a_spoke_without_a_plausible_width_is_as_wide_as_a_step(width: int) -> None:
    (scan,) = scans_of(radials(np.arange(60) * 1024, width=width))
    assert scan.video is not None
    assert_allclose(azimuth_deg(scan), np.arange(60) * 360 / 64)
    assert_allclose(np.rad2deg(scan.video.width_rad), 360 / 64)
    assert np.rad2deg(scan.sensor.azimuth_res_rad) == pytest.approx(360 / 64)


@given(offset=st.floats(-360, 360), begin=st.integers(0, TURN - 1))
@settings(derandomize=True, deadline=None, max_examples=40)
def test_an_offset_turns_all_azimuths(offset: float, begin: int) -> None:
    of = spin(1.0, begin=begin)
    (plain,), (turned,) = scans_of(of), scans_of(of, azimuth_offset_deg=offset)
    assert plain.video is not None
    assert turned.video is not None
    difference = wrap(turned.video.azimuth_rad - plain.video.azimuth_rad - np.deg2rad(offset))
    assert_allclose(difference, 0.0, atol=1e-9)
    assert turned.video.azimuth_rad.min() >= 0.0
    assert turned.video.azimuth_rad.max() < 2 * np.pi


def test_range_is_that_of_the_centre_of_a_cell() -> None:
    of = spin(1.0, n_cells=8)
    of.start_rg[:] = 3
    (scan,) = scans_of(of, range_offset_m=2.0)
    assert scan.video is not None
    assert scan.video.first_range_m == 37.0
    assert scan.sensor.max_range_m == 110.0
    assert (scan.sensor.range_res_m, scan.sensor.bits, scan.sensor.id) == (10.0, 16, "7-42")


def test_times_have_the_date() -> None:
    (scan,) = scans_of(spin(1.0, tod=0), midnight_ns=10**18)
    assert scan.video is not None
    assert (scan.t_start_ns, scan.t_ns) == (10**18, int(scan.video.t_ns[-1]))
    assert 2.4 < (scan.t_ns - scan.t_start_ns) * 1e-9 < 2.5


def test_a_whole_turn_sweeps_all_directions() -> None:
    for per_turn in (40, 64, 720, 2048):
        (scan,) = scans_of(spin(1.0, per_turn=per_turn, begin=123))
        assert scan.swept is not None
        assert scan.swept.all()


def test_a_blanked_sector_is_not_swept() -> None:
    of = spin(1.0, per_turn=720)
    (scan,) = scans_of(take(of, np.r_[0:100, 300:720]), azimuth_offset_deg=90.0)
    assert scan.swept is not None
    assert_array_equal(np.flatnonzero(~scan.swept), np.arange(280, 480))


@given(st.lists(st.tuples(st.floats(0, 6.28), st.floats(0, 3.0)), min_size=1, max_size=20))
@settings(derandomize=True, deadline=None, max_examples=60)
def test_swept_half_degrees_are_those_that_a_spoke_touches(spokes: list[tuple[float, float]]) -> None:
    azimuth, width = np.array(spokes).T
    middle = np.deg2rad((np.arange(720) + 0.5) / 2)
    apart = np.abs(wrap(middle[:, None] - azimuth)) - width / 2
    half_bin = np.deg2rad(0.25)
    swept = swept_bins(azimuth, width)
    assert swept[(apart < half_bin * 0.89).any(axis=1)].all()
    assert not swept[(apart > half_bin + 1e-6).all(axis=1)].any()


def test_head_up_video_is_turned_by_the_heading_at_the_spoke() -> None:
    of = spin(1.0, tod=0)
    report_ns = np.array([0, 2_500_000_000])
    pose = PoseTrack.from_reports(report_ns, np.array([[0.0, 0.0], [50.0, 20.0]]), np.deg2rad([350.0, 20.0]))
    (north,), (head,) = scans_of(of), scans_of(of, pose, stabilised="head")
    assert north.video is not None
    expected = azimuth_deg(north) + 350.0 + 30.0 * north.video.t_ns / 2.5e9
    assert_allclose(wrap(np.deg2rad(azimuth_deg(head) - expected)), 0.0, atol=1e-9)
    assert_allclose(head.position_m, [25.0, 10.0], rtol=0.02)
    assert np.rad2deg(head.heading_rad) == pytest.approx(5.0, abs=0.3)


def test_without_a_heading_the_platform_has_none() -> None:
    (scan,) = scans_of(spin(1.0))
    assert np.isnan(scan.heading_rad)
    assert_array_equal(scan.position_m, [0.0, 0.0])
