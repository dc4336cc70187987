"""Plots as a table: columns, turns of the antenna, noise and moving platforms."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from maritrack.errors import InputError
from maritrack.geo import polar_to_en
from maritrack.io.octets import octets_from_bytes, octets_from_file
from maritrack.io.plots import PlotSource
from maritrack.io.plotturns import ASSUMED_S, group_turns, turn_period_s
from maritrack.io.pose import PoseTrack
from maritrack.settings import InputConfig
from maritrack.types import Origin
from tests.shared import shared

S = 1_000_000_000
PLAIN = InputConfig()


def frames(text, config=PLAIN, **more):
    data = text if isinstance(text, bytes) else text.encode()
    return list(PlotSource(octets_from_bytes(data, name="rec", channel="/input/plots"), config, **more).frames())


def antenna(seed, *, period_s=2.5, turns=40, per_turn=8, jitter_rad=0.0):
    """Times and azimuths of plots at random azimuths of an antenna that begins at north; by time, with true turns."""
    generator = np.random.default_rng(seed)
    turn = np.repeat(np.arange(turns), generator.integers(0, 2 * per_turn + 1, turns))
    azimuth = generator.uniform(0.0, 2 * np.pi, len(turn))
    t_s = (turn + azimuth / (2 * np.pi)) * period_s
    order = np.argsort(t_s)
    return t_s[order], (azimuth + generator.normal(0.0, jitter_rad, len(turn)))[order], turn[order]


@settings(derandomize=True, deadline=None, max_examples=40)
@given(st.integers(0, 10**6), st.floats(0.8, 12.0), st.integers(3, 20))
def test_each_plot_is_in_the_turn_that_saw_it(seed, period_s, per_turn):
    t_s, azimuth, turn = antenna(seed, period_s=period_s, per_turn=per_turn)
    turns = group_turns(np.rint(t_s * 1e9).astype(np.int64), azimuth)
    number = np.repeat(np.arange(len(turns)), np.diff(turns.first))
    assert np.array_equal(number, turn - turn[0])
    assert turn_period_s(t_s, azimuth) == pytest.approx(period_s, rel=2e-3)


def test_turns_without_plots_are_empty_turns_and_many_of_them_are_a_gap():
    t_s, azimuth, turn = antenna(3, turns=60)
    few, many = (turn < 10) | (turn >= 13), (turn < 10) | (turn >= 40)
    t_ns = np.rint(t_s * 1e9).astype(np.int64)
    turns = group_turns(t_ns[few], azimuth[few])
    assert np.diff(turns.first)[10:13].tolist() == [0, 0, 0]
    assert set(turns.segment.tolist()) == {0}
    np.testing.assert_allclose(turns.end_ns[:-1] / S, (np.arange(len(turns) - 1) + 1 + turn[0]) * 2.5, atol=0.02)
    gap = group_turns(t_ns[many], azimuth[many])
    assert gap.segment.tolist() == [0] * 10 + [1] * (len(gap) - 10)


def test_a_single_ship_in_one_direction_tells_the_period_too():
    t_s = np.arange(40) * 2.5
    assert turn_period_s(t_s, np.full(40, 1.0)) == pytest.approx(2.5, rel=1e-3)
    assert len(group_turns(np.rint(t_s * 1e9).astype(np.int64), np.full(40, 1.0))) == 40


def test_plots_a_little_out_of_order_over_north_do_not_make_a_turn():
    t_ns = np.array([0.0, 0.6, 1.2, 1.8, 2.49, 2.51, 2.52, 3.1, 3.7, 4.3], dtype=float) * S
    azimuth = np.array([0.0, 1.508, 3.016, 4.524, 6.27, 0.03, 6.28, 1.508, 3.016, 4.524])
    turns = group_turns(t_ns.astype(np.int64), azimuth)
    assert np.diff(turns.first).tolist() == [5, 5]


def test_too_few_plots_to_measure_the_antenna_are_still_plots():
    assert turn_period_s(np.array([0.0, 1.0]), np.array([0.0, 1.0])) == ASSUMED_S
    (frame,) = frames("time_s,azimuth_deg,range_m\n5,90,100\n")
    assert frame.t_ns == 5 * S
    np.testing.assert_allclose(frame.scan.points.position_m, [[100.0, 0.0]], atol=1e-9)


def test_plots_with_the_time_of_their_scan_are_a_scan_each_time():
    rows = [f"{t},{a},100" for t in (10.0, 12.5, 15.0) for a in (200, 30, 300, 100)]
    found = frames("time_s,azimuth_deg,range_m\n" + "\n".join(rows))
    assert [(f.t_ns / S, len(f.scan.points)) for f in found] == [(10.0, 4), (12.5, 4), (15.0, 4)]


def table(t_s, azimuth, columns=("time_s", "azimuth_deg", "range_m"), separator=","):
    cells = {"time_s": t_s, "azimuth_deg": np.rad2deg(azimuth), "azimuth_rad": azimuth, "range_m": 1000.0 + t_s,
             "range_km": 1.0 + t_s / 1000, "cov_aa": t_s * 0 + 1e-4, "cov_ar": t_s * 0 + 0.01, "cov_ra": t_s * 0 + 0.01,
             "cov_rr": t_s * 0 + 400.0, "intensity": t_s}  # fmt: skip
    rows = [separator.join(columns)]
    rows += [separator.join(repr(float(cells[c][i])) for c in columns) for i in range(len(t_s))]
    return "\n".join(rows) + "\n"


FULL = ("time_s", "azimuth_rad", "range_m", "cov_aa", "cov_ar", "cov_ra", "cov_rr", "intensity")


@settings(derandomize=True, deadline=None, max_examples=20)
@given(st.permutations(range(len(FULL))), st.permutations(range(20)), st.sampled_from(",;\t"))
def test_neither_order_of_columns_nor_of_rows_matters(columns, rows, separator):
    t_s, azimuth, _ = antenna(5, turns=4, per_turn=8)
    t_s, azimuth = t_s[:20], azimuth[:20]
    one = frames(table(t_s, azimuth, FULL))
    other = frames(table(t_s[rows], azimuth[rows], tuple(FULL[i] for i in columns), separator))
    assert [f.t_ns for f in one] == [f.t_ns for f in other]
    for a, b in zip(one, other, strict=True):
        for name in ("position_m", "t_ns", "cov_m2", "intensity"):
            assert np.array_equal(getattr(a.scan.points, name), getattr(b.scan.points, name))


def test_degrees_and_kilometres_are_radians_and_metres():
    t_s, azimuth, _ = antenna(6, turns=5)
    one, other = (frames(table(t_s, azimuth, c)) for c in (FULL[:3], ("range_km", "azimuth_deg", "time_s")))
    for a, b in zip(one, other, strict=True):
        np.testing.assert_allclose(a.scan.points.position_m, b.scan.points.position_m, atol=1e-6)


def test_a_point_keeps_its_own_time_less_the_latency():
    t_s, azimuth, _ = antenna(7, turns=6)
    found = frames(table(t_s, azimuth), InputConfig(latency_s=0.5))
    times = np.concatenate([f.scan.points.t_ns for f in found])
    np.testing.assert_allclose(times / S, t_s - 0.5, atol=2e-6)
    for frame in found:
        assert frame.scan.t_start_ns <= frame.scan.points.t_ns.min() + S // 2
        assert frame.scan.points.t_ns.max() + S // 2 <= frame.t_ns


def test_the_covariance_with_its_cross_term_is_turned_into_the_plane():
    text = "time_s,azimuth_deg,range_m,cov_aa,cov_ar,cov_ra,cov_rr\n1,0,1000,4,1,1,25\n"
    (frame,) = frames(text)
    degree = np.deg2rad(1.0)
    expected = [[(1000 * degree) ** 2 * 4, 1000 * degree], [1000 * degree, 25.0]]
    np.testing.assert_allclose(frame.scan.points.cov_m2, [expected], rtol=1e-9)


def test_without_covariances_the_settings_say_the_noise():
    (frame,) = frames("time_s,azimuth_deg,range_m\n1,0,100\n", InputConfig(sigma_range_m=3.0, sigma_m=2.0))
    np.testing.assert_allclose(frame.scan.points.cov_m2, [np.diag([4.0, 9.0])], atol=1e-12)
    (frame,) = frames("time_s,azimuth_deg,range_m\n1,0,100\n")
    assert frame.scan.points.cov_m2 is None


def test_each_plot_is_seen_from_where_the_ship_was_at_its_time():
    t_s, azimuth, _ = antenna(8, turns=8)
    ends = np.array([0.0, 100.0])
    pose = PoseTrack.from_reports(
        (ends * S).astype(np.int64), np.stack([ends * 10.0, -ends], axis=1), np.array([0.2, 0.2])
    )
    found = frames(table(t_s, azimuth), InputConfig(stabilised="head"), pose=pose, origin=Origin(50.0, -1.0))
    position = np.concatenate([f.scan.points.position_m for f in found])
    platform = np.stack([t_s * 10.0, -t_s], axis=1)
    np.testing.assert_allclose(position, platform + polar_to_en(1000.0 + t_s, azimuth + 0.2), atol=1e-4)
    middle = np.array([(f.scan.t_start_ns + f.t_ns) / 2e9 for f in found])
    np.testing.assert_allclose([f.scan.position_m[0] for f in found], middle * 10.0, atol=1e-6)
    with pytest.raises(InputError, match="no heading"):
        frames(table(t_s, azimuth), InputConfig(stabilised="head"))


def test_rows_that_are_no_plots_are_left_out_and_counted():
    rows = "1,0,100\nx,0,100\n1.1,,100\n1.2,5,-3\n1.3,5,1e99\n1.4,nan,5\n1.5,30,200\n"
    (frame,) = frames("time_s,azimuth_deg,range_m\n" + rows)
    assert frame.scan.points.range_m.tolist() == [100.0, 200.0]
    assert [(d.code, d.count) for d in frame.damage] == [("bad-point", 5)]


def test_a_table_without_a_plot_leaves_its_damage_to_the_caller():
    reader = PlotSource(octets_from_bytes(b"time_s,azimuth_deg,range_m\nx,y,z\n", name="rec", channel="/"), PLAIN)
    assert list(reader.frames()) == []
    assert [d.code for d in reader.unclaimed] == ["bad-point"]


def test_the_first_frame_carries_the_octets():
    t_s, azimuth, _ = antenna(9, turns=5)
    data = table(t_s, azimuth).encode()
    assert [f.inputs for f in frames(data)] == [(("/input/plots", data),)] + [()] * (len(frames(data)) - 1)


def test_a_recording_goes_on_past_midnight_from_its_date():
    rows = [f"{(86390 + 2.5 * i) % 86400},10,100" for i in range(8)]
    found = frames("time_s,azimuth_deg,range_m\n" + "\n".join(rows), InputConfig(date="2016-01-12"))
    start = 1_452_556_800 + 86390
    assert [f.scan.points.t_ns[0] / S - start for f in found] == [2.5 * i for i in range(8)]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "rec: empty"),
        ("azimuth_deg,range_m\n1,2\n", "rec: no column of times"),
        ("time_s,range_m\n1,2\n", "rec: no column of azimuth"),
        ("time_s,azimuth_deg\n1,2\n", "rec: no column of range"),
        ("time_s,azimuth,range_m\n1,2,3\n", "rec: column 'azimuth' has no unit"),
    ],
)
def test_a_table_that_is_none_is_an_error_of_one_line(text, message):
    with pytest.raises(InputError, match=message):
        frames(text)


SAMPLE = table(*antenna(10, turns=3)[:2], FULL).encode()


@settings(derandomize=True, deadline=None, max_examples=200)
@given(st.integers(0, len(SAMPLE) - 1), st.binary(min_size=1, max_size=6))
def test_a_damaged_table_is_read_or_refused(at, octets):
    damaged = SAMPLE[:at] + octets + SAMPLE[at + len(octets) :]
    try:
        found = frames(damaged)
    except InputError as error:
        assert "\n" not in str(error)
    else:
        assert all(np.isfinite(f.scan.points.position_m).all() for f in found)
        assert np.all(np.diff([f.t_ns for f in found]) >= 0)


@pytest.mark.parametrize(("run", "minutes"), [("run_01_004", 6.37), ("run_01_005", 10.04), ("run_01_009", 6.37)])
def test_real_plots_are_grouped_into_the_turns_of_the_antenna(run, minutes):
    path = shared(f"data/marce_solent/{run}/detections.csv")
    found = list(PlotSource(octets_from_file(path, "/input/plots"), PLAIN).frames())
    assert abs(len(found) - minutes * 60 / 2.5) <= 2
    steps = np.diff([f.t_ns for f in found])[1:-1] / 1e9
    assert np.all(np.abs(steps - 2.5) < 0.06)
    for frame in found:
        azimuth = frame.scan.points.azimuth_rad
        assert np.all(np.diff(azimuth) > -0.2) or len(azimuth) < 2
    rows = np.genfromtxt(path, delimiter=",", skip_header=1)
    rows = rows[np.argsort(rows[:, 0], kind="stable")]
    trace = np.concatenate([np.trace(f.scan.points.cov_m2, axis1=1, axis2=2) for f in found])
    np.testing.assert_allclose(trace, rows[:, 6] + rows[:, 2] ** 2 * rows[:, 3], rtol=1e-9)
