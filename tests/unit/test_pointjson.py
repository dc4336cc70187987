"""Points as JSON: what is written is read, whole or line by line, and nothing else passes as points."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from maritrack.errors import InputError, UsageError
from maritrack.geo import en_to_polar
from maritrack.io.octets import octets_from_bytes
from maritrack.io.pointjson import PointSource, point_truth, split_lines
from maritrack.io.pointwriter import write_points
from maritrack.io.reference import Reports, build_reference, truth_at
from maritrack.io.source import Octets
from maritrack.settings import InputConfig
from maritrack.types import Origin, Points, Scan, Sensor

S = 1_000_000_000
PLAIN = InputConfig()
HEAD = {"format": "maritrack-points/1", "frame": "enu"}


def source(data, config=PLAIN, *, strict=False):
    return PointSource(octets_from_bytes(data, name="rec.json", channel="/input/points"), config, strict=strict)


def frames(data, config=PLAIN):
    return list(source(data, config).frames())


def document(scans, **more):
    return json.dumps({**HEAD, **more, "scans": scans}).encode()


def lines(*entries, head=HEAD):
    return b"".join(json.dumps(entry).encode() + b"\n" for entry in (head, *entries))


def scan(t_s, positions, *, sensor="radar", at=(0.0, 0.0), heading_rad=math.nan, intensity=None, cov=None, label=None):
    position = np.array(positions, dtype=float).reshape(-1, 2)
    range_m, azimuth_rad = en_to_polar(position - np.array(at))
    n = len(position)
    points = Points(
        range_m=range_m,
        azimuth_rad=azimuth_rad,
        position_m=position,
        intensity=np.ones(n) if intensity is None else np.array(intensity, float),
        t_ns=np.full(n, round(t_s * 1e6) * 1000, dtype=np.int64),
        range_width_m=np.zeros(n),
        azimuth_width_rad=np.zeros(n),
        cov_m2=cov,
        truth_label=label,
    )
    t_ns = round(t_s * 1e6) * 1000
    return Scan(Sensor(sensor, 0.0, 0.0, math.inf), t_ns, t_ns, np.array(at), heading_rad, points=points)


coordinates = st.floats(-20_000.0, 20_000.0)


@st.composite
def scans(draw):
    n = draw(st.integers(0, 5))
    at = (draw(coordinates), draw(coordinates))
    offset = [(draw(st.floats(1.0, 5000.0)), draw(coordinates)) for _ in range(n)]
    cov = np.array([[[9.0, 1.5], [1.5, 4.0]]] * n).reshape(-1, 2, 2) if draw(st.booleans()) else None
    label = np.arange(n) - 1 if draw(st.booleans()) else None
    return scan(
        1_620_000_000 + draw(st.integers(0, 10**6)) / 1000,
        [(at[0] + e, at[1] + n) for e, n in offset],
        sensor=draw(st.sampled_from(["a", "b"])),
        at=at,
        heading_rad=draw(st.sampled_from([math.nan, 0.0, 1.0])),
        intensity=[draw(st.floats(0.0, 255.0)) for _ in range(n)] if draw(st.booleans()) else None,
        cov=cov,
        label=label,
    )


@settings(derandomize=True, deadline=None, max_examples=60)
@given(st.lists(scans(), max_size=6), st.sampled_from(["enu", "polar"]), st.booleans())
def test_what_is_written_is_read_back_in_order_of_time(written, frame, as_lines):
    data = write_points(written, frame=frame, origin=Origin(50.0, -1.0), lines=as_lines)
    read = frames(data)
    assert [f.k for f in read] == list(range(len(written)))
    for f, w in zip(read, sorted(written, key=lambda s: s.t_ns), strict=True):
        got, points, expected = f.scan, f.scan.points, w.points
        assert (got.t_ns, got.t_start_ns, got.sensor.id) == (w.t_ns, w.t_ns, w.sensor.id)
        np.testing.assert_allclose(got.position_m, w.position_m, atol=1e-9)
        np.testing.assert_allclose(got.heading_rad, w.heading_rad, atol=1e-12)
        np.testing.assert_allclose(points.position_m, expected.position_m, rtol=0, atol=0.0 if frame == "enu" else 1e-6)
        np.testing.assert_allclose(points.intensity, expected.intensity)
        assert np.array_equal(points.t_ns, expected.t_ns)
        assert (points.cov_m2 is None) == (expected.cov_m2 is None)
        if expected.cov_m2 is not None:
            np.testing.assert_allclose(points.cov_m2, expected.cov_m2, rtol=1e-9, atol=1e-9)
        if expected.truth_label is not None:
            assert np.array_equal(points.truth_label, expected.truth_label)


@settings(derandomize=True, deadline=None, max_examples=40)
@given(st.permutations(range(7)), st.booleans(), st.integers(1, 50))
def test_order_and_cutting_of_the_input_change_nothing_but_who_carries_its_octets(order, as_lines, cut):
    written = [scan(float(t // 2), [(t * 10.0, 0.0)] * (t % 3)) for t in range(7)]  # some times are equal
    data = write_points([written[i] for i in order], lines=as_lines)
    pieces = tuple(data[i : i + cut] for i in range(0, len(data), cut))
    read = list(PointSource(Octets("x", "/input/points-1", pieces, data, len(data)), InputConfig()).frames())
    assert [f.t_ns // S for f in read] == [0, 0, 1, 1, 2, 2, 3]
    stable = sorted(order, key=lambda i: i // 2)
    assert [len(f.scan.points) for f in read] == [i % 3 for i in stable]
    assert b"".join(octets for f in read for _, octets in f.inputs) == data
    assert {channel for f in read for channel, _ in f.inputs} == {"/input/points-1"}


def test_lines_are_delivered_before_the_input_ends():
    def endless():
        yield lines()
        t = 0
        while True:
            t += 1
            yield json.dumps({"time_s": t, "points": []}).encode() + b"\n"

    stream = PointSource(Octets("x", "/input/points", endless(), b"", -1), InputConfig()).frames()
    assert [next(stream).t_ns for _ in range(200)] == [t * S for t in range(1, 201)]


def test_a_scan_that_comes_far_too_late_is_left_out_and_reported():
    entries = [{"time_s": t, "points": []} for t in range(100)] + [{"time_s": 3, "points": []}]
    read = frames(lines(*entries))
    assert len(read) == 100
    assert [d.code for f in read for d in f.damage] == ["late-scan"]


def test_an_empty_scan_is_a_scan():
    read = frames(document([{"time_s": 1, "points": []}]))
    assert [len(f.scan.points) for f in read] == [0]


def test_polar_points_lie_about_the_pose_clockwise_from_north():
    pose = {"east_m": 100.0, "north_m": 50.0, "heading_deg": 30.0}
    (frame,) = frames(
        document([{"time_s": 1, "pose": pose, "points": [[10.0, 90.0], [20.0, 180.0, 7]]}], frame="polar")
    )
    np.testing.assert_allclose(frame.scan.points.position_m, [[110.0, 50.0], [100.0, 30.0]], atol=1e-9)
    assert frame.scan.points.intensity.tolist() == [1.0, 7.0]
    assert frame.scan.heading_rad == pytest.approx(np.deg2rad(30.0))
    assert frame.scan.position_m.tolist() == [100.0, 50.0]


def test_azimuths_relative_to_the_bow_are_turned_by_the_heading():
    pose = {"east_m": 0.0, "north_m": 0.0, "heading_deg": 30.0}
    one = {"time_s": 1, "pose": pose, "points": [[10.0, 60.0]], "cov": [[4.0, 0.0, 1.0]]}
    config = InputConfig(stabilised="head")
    (frame,) = frames(document([one], frame="polar"), config)
    np.testing.assert_allclose(frame.scan.points.position_m, [[10.0, 0.0]], atol=1e-9)
    np.testing.assert_allclose(frame.scan.points.cov_m2, [[[4.0, 0.0], [0.0, (10 * np.deg2rad(1.0)) ** 2]]], atol=1e-9)
    with pytest.raises(InputError, match="no heading"):
        frames(document([{"time_s": 1, "points": [[1, 1]]}], frame="polar"), config)


def test_a_covariance_in_polar_units_is_metres_and_degrees():
    one = {"time_s": 1, "points": [[1000.0, 0.0]], "cov": [[25.0, 1.0, 4.0]]}
    (frame,) = frames(document([one], frame="polar"))
    degree = np.deg2rad(1.0)
    expected = [[(1000 * degree) ** 2 * 4.0, 1000 * degree], [1000 * degree, 25.0]]
    np.testing.assert_allclose(frame.scan.points.cov_m2, [expected], rtol=1e-12)


def test_noise_is_that_of_the_scan_else_of_the_sensor_else_of_the_settings():
    sensors = {"a": {"sigma_m": 3.0}, "b": {"east_m": 5.0, "north_m": 6.0}}
    point = {"points": [[0.0, 100.0]]}
    entries = [
        {"time_s": 1, "sensor": "a", "cov": [[2.0, 0.0, 1.0]], **point},
        {"time_s": 2, "sensor": "a", **point},
        {"time_s": 3, "sensor": "b", **point},
        {"time_s": 4, "sensor": "c", **point},
    ]
    read = frames(document(entries, sensors=sensors), InputConfig(sigma_range_m=7.0, sigma_m=1.0))
    cov = [f.scan.points.cov_m2[0] for f in read]
    np.testing.assert_allclose(cov[0], np.diag([2.0, 1.0]))
    np.testing.assert_allclose(cov[1], np.diag([9.0, 9.0]), atol=1e-12)
    assert cov[2][1, 1] == pytest.approx(49.0, rel=0.1)
    np.testing.assert_allclose(cov[3], np.diag([1.0, 49.0]), atol=1e-12)
    assert [f.scan.position_m.tolist() for f in read] == [[0.0, 0.0], [0.0, 0.0], [5.0, 6.0], [0.0, 0.0]]
    assert frames(document([{"time_s": 1, **point}]))[0].scan.points.cov_m2 is None


def test_the_only_sensor_of_the_table_is_that_of_a_scan_that_names_none():
    (frame,) = frames(document([{"time_s": 1, "points": []}], sensors={"north/mast": {"east_m": 1.0}}))
    assert frame.scan.sensor.id == "north-mast"
    assert frame.scan.position_m.tolist() == [1.0, 0.0]


def test_settings_choose_a_sensor_a_region_and_the_age_of_points():
    entries = [{"time_s": t, "sensor": "ab"[t % 2], "points": [[0, 10], [0, 50], [0, 90]]} for t in range(4)]
    config = InputConfig(sensor="b", roi_min_m=20.0, roi_max_m=60.0, latency_s=1.5)
    read = frames(document(entries), config)
    assert [f.t_ns / S for f in read] == [1.0, 3.0]
    assert [f.k for f in read] == [0, 1]
    assert [f.scan.points.range_m.tolist() for f in read] == [[50.0], [50.0]]
    assert [f.scan.points.t_ns.tolist() for f in read] == [[-S // 2], [3 * S // 2]]
    assert read[0].scan.sensor.max_range_m == 60.0
    with pytest.raises(InputError, match="no sensor 'c'"):
        frames(document(entries), InputConfig(sensor="c"))


def test_offsets_of_the_settings_turn_and_shift_every_point():
    one = {"time_s": 1, "points": [[0.0, 100.0]], "cov": [[1.0, 0.0, 4.0]]}
    (frame,) = frames(document([one]), InputConfig(azimuth_offset_deg=90.0, range_offset_m=-10.0))
    np.testing.assert_allclose(frame.scan.points.position_m, [[90.0, 0.0]], atol=1e-9)
    np.testing.assert_allclose(frame.scan.points.cov_m2, [np.diag([4.0, 1.0])], atol=1e-9)


def test_points_that_are_no_places_are_left_out_and_counted():
    text = "[[1, 2], [NaN, 2], [null, 3], [1e999, 0], [1e30, 0], [5, 6], [7, 8, NaN], [1" + "0" * 400 + ", 2]]"
    data = document([{"time_s": 1, "points": "POINTS", "labels": list(range(8))}]).replace(b'"POINTS"', text.encode())
    (frame,) = frames(data)
    assert frame.scan.points.position_m.tolist() == [[1.0, 2.0], [5.0, 6.0]]
    assert frame.scan.points.truth_label.tolist() == [0, 5]
    assert [(d.code, d.count, d.sensor) for d in frame.damage] == [("bad-point", 6, "radar")]


def test_points_without_a_sound_covariance_are_left_out_and_counted():
    one = {"time_s": 1, "points": [[1, 2], [3, 4], [5, 6]], "cov": [[1, 0, 1], [1, 2, 1], [None, 0, 1]]}
    (frame,) = frames(document([one]))
    assert frame.scan.points.position_m.tolist() == [[1.0, 2.0]]
    assert [d.count for d in frame.damage] == [2]


def test_negative_ranges_are_left_out():
    (frame,) = frames(document([{"time_s": 1, "points": [[-1, 0], [1, 0]]}], frame="polar"))
    assert frame.scan.points.range_m.tolist() == [1.0]


GOOD = {"time_s": 1, "points": [[1, 2]]}


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "line 1 column 1"),
        (b'{"format": "maritrack-points/1",\n "scans": [}', "line 2 column 12"),
        (b'{"format": "maritrack-points/1", "scans": [\xff]}', "not UTF-8 at byte 43"),
        (b'{"scans":' + b"[" * 200_000, "nested too deeply"),
        (b'{"format": "maritrack-points/1", "scans": [' + b"1" * 5000 + b"]}", "thousands of digits"),
        (b"[1]", "document: an object was expected, not a list"),
        (b'{"format": "maritrack-points/2", "scans": []}', '"format" is'),
        (document([], frame="enu4"), "not one of enu, polar, enu3, polar3"),
        (document([GOOD], frame="enu3"), "each is a list of 3 or 4 numbers"),
        (document([{"time_s": 1, "points": [[1, 2, 3]], "cov": [[1, 0, 1]]}], frame="polar3"), "no 'cov'"),
        (document([], frame="ned"), '"frame" is'),
        (document([], origin={"lat_deg": 91, "lon_deg": 0}), "origin: 'lat_deg' = 91"),
        (document([], origin={"lat_deg": 1}), "origin: 'lon_deg' is missing"),
        (document([], sensors={"a": 1}), "sensors.a: an object was expected"),
        (document([], sensors={"a": {"sigma_m": -1}}), "sensors.a: a sigma is negative"),
        (document([], sensors={"a": {"sigma_m": "3"}}), "sensors.a: 'sigma_m' is a number, not a text"),
        (document({}), "scans: a list was expected, not an object"),
        (document([GOOD, 7]), r"scans\[1\]: an object was expected, not a number"),
        (document([{**GOOD, "time_s": "now"}]), r"scans\[0\]: 'time_s' is a number, not a text"),
        (document([{**GOOD, "time_s": True}]), "not true or false"),
        (document([{**GOOD, "time_s": math.nan}]), r"'time_s' = nan is not within"),
        (document([{**GOOD, "time_s": 1e300}]), r"'time_s' = 1e\+300 is not within"),
        (document([{"points": []}]), "'time_s' is missing"),
        (document([{"time_s": 1}]), r"scans\[0\]: points: a list was expected, not null"),
        (document([{**GOOD, "points": [1, 2]}]), "each is a list of 2 or 3 numbers"),
        (document([{**GOOD, "points": [[1, 2, 3, 4]]}]), "each is a list of 2 or 3 numbers"),
        (document([{**GOOD, "points": [["1", "2"]]}]), "each is a list of 2 or 3 numbers"),
        (document([{**GOOD, "points": [[1, 2], [3]]}]), r"points\[1\]: a list of 2 or 3 numbers"),
        (document([{**GOOD, "points": [[1, 2], [3, [4]]]}]), r"points\[1\]: a list of 2 or 3 numbers"),
        (document([{**GOOD, "points": [{"a": 1}]}]), r"points\[0\]: a list was expected, not an object"),
        (document([{**GOOD, "cov": [[1, 0]]}]), "each is a list of 3 numbers"),
        (document([{**GOOD, "cov": []}]), "0 covariances for 1 points"),
        (document([{**GOOD, "labels": [1.5]}]), "each is a whole number"),
        (document([{**GOOD, "labels": [1, 2]}]), "2 labels for 1 points"),
        (document([{**GOOD, "sensor": {}}]), "the id of a sensor is a text"),
        (document([{**GOOD, "pose": 3}]), "pose: an object was expected"),
        (document([{**GOOD, "pose": {"east_m": 1}}]), "pose: 'north_m' is missing"),
        (document([], truth=[{"id": 1}]), r"truth\[0\]: 'time_s' is missing"),
        (document([], truth=[{"time_s": 1}]), r"truth\[0\]: 'id' is a text or a number"),
    ],
)
def test_a_document_that_is_none_is_an_error_of_one_line_with_the_place(data, message):
    with pytest.raises(InputError, match=message) as caught:
        source(data)
    assert str(caught.value).startswith("rec.json: ")
    assert "\n" not in str(caught.value)


def test_bad_lines_are_left_out_and_reported_with_their_place():
    data = (
        lines(GOOD, {**GOOD, "time_s": "x"})
        + b"{broken\n\n[]\n"
        + lines(GOOD, head={"time_s": 2})
        + b'{"time_s": 3, "po'
    )
    read = frames(data)
    assert len(read) == 2
    damage = [d for f in read for d in f.damage]
    assert [d.code for d in damage] == ["bad-line"] * 5
    assert [d.message.split(":")[0] for d in damage] == [
        "line 3",
        "line 4 column 2",
        "line 6",
        "line 7",
        "line 9 column 15",
    ]
    assert [data[d.offset : d.offset + 3] for d in damage] == [b'{"t', b"{br", b"[]\n", b'{"t', b'{"t']
    assert b"".join(octets for f in read for _, octets in f.inputs) == data


def test_strict_reading_stops_at_the_first_bad_line():
    with pytest.raises(InputError, match=r"rec\.json: bad-line: line 3"):
        list(source(lines(GOOD, 7), strict=True).frames())


def test_lines_without_a_single_scan_leave_their_damage_to_the_caller():
    reader = source(lines(7, 8))
    assert list(reader.frames()) == []
    assert [d.code for d in reader.unclaimed] == ["bad-line", "bad-line"]


def test_names_and_ids_can_not_reach_a_terminal():
    data = document(
        [{**GOOD, "sensor": "a\x1b[31m\ud800"}], truth=[{"id": "x\n", "time_s": 0, "east_m": 0, "north_m": 0}]
    )
    reader = source(data)
    assert next(reader.frames()).scan.sensor.id == "a?[31m?"
    assert reader.reference.ids == ("x",)


TRUTH = [
    {"id": 7, "name": "SEVEN", "time_s": 2, "east_m": 3, "north_m": 4, "heading_deg": 90, "length_m": 20},
    {"id": 7, "time_s": 1, "east_m": 1, "north_m": 2, "vel_east_mps": 5, "vel_north_mps": 6, "width_m": 4},
    {"id": "a", "time_s": 1, "east_m": 0, "north_m": 0},
]


@pytest.mark.parametrize(
    "data",
    [
        document([], truth=TRUTH),
        lines(head={**HEAD, "truth": TRUTH}),
        lines({"truth": TRUTH[:1]}, {"truth": TRUTH[1:]}),
        lines(*TRUTH),
        json.dumps({**HEAD, "truth": TRUTH}, indent=1).encode(),
    ],
)
def test_truth_in_any_form_is_the_same_reference(data):
    for reference in (source(data).reference, point_truth(data, name="x")[0]):
        assert reference.ids == ("7", "a")
        assert reference.names == ("SEVEN", "")
        assert reference.complete
        assert reference.start.tolist() == [0, 2, 3]
        assert reference.t_ns.tolist() == [S, 2 * S, S]
        assert reference.position_m.tolist() == [[1.0, 2.0], [3.0, 4.0], [0.0, 0.0]]
        assert reference.velocity_mps[0].tolist() == [5.0, 6.0]
        assert np.isnan(reference.velocity_mps[1:]).all()
        np.testing.assert_allclose(reference.heading_rad, [np.nan, np.pi / 2, np.nan])
        np.testing.assert_array_equal(reference.length_m, [20.0, np.nan])
        np.testing.assert_array_equal(reference.width_m, [4.0, np.nan])


def test_truth_after_the_first_scan_is_reported_by_the_source_and_read_as_a_document():
    data = lines(TRUTH[0], GOOD, TRUTH[1])
    reader = source(data)
    assert len(reader.reference.t_ns) == 1
    assert [d.code for f in reader.frames() for d in f.damage] == ["late-truth"]
    assert len(point_truth(data, name="x")[0].t_ns) == 2


def test_a_document_without_truth_has_no_reference():
    assert source(document([GOOD])).reference is None
    assert len(point_truth(document([GOOD]), name="x")[0]) == 0


@settings(derandomize=True, deadline=None, max_examples=40)
@given(
    st.lists(st.tuples(st.sampled_from("abc"), st.integers(0, 9), coordinates, coordinates), max_size=8), st.booleans()
)
def test_written_truth_is_read_back(rows, as_lines):
    n = len(rows)
    velocity = np.where(np.arange(2 * n).reshape(n, 2) % 4 < 2, 1.5, np.nan)
    reference = build_reference(
        Reports(
            ship=np.array(["abc".index(r[0]) for r in rows], dtype=np.int64),
            t_ns=np.array([r[1] * S for r in rows], dtype=np.int64),
            position_m=np.array([r[2:] for r in rows], dtype=float).reshape(-1, 2),
            velocity_mps=velocity,
            heading_rad=np.full(n, 0.25),
        ),
        ids="abc",
        names=["", "Bé", ""],
        length_m=np.array([10.0, np.nan, 30.0]),
        width_m=np.full(3, np.nan),
        complete=True,
    )
    back, origin = point_truth(write_points([], origin=Origin(1.0, 2.0), reference=reference, lines=as_lines), name="x")
    assert origin == Origin(1.0, 2.0)
    told = [i for i in range(3) if reference.start[i] < reference.start[i + 1]]
    assert back.ids == tuple("abc"[i] for i in told)
    assert np.array_equal(back.t_ns, reference.t_ns)
    assert np.array_equal(back.position_m, reference.position_m)
    assert np.array_equal(back.velocity_mps, reference.velocity_mps, equal_nan=True)
    np.testing.assert_allclose(back.heading_rad, reference.heading_rad)
    np.testing.assert_array_equal(back.length_m, reference.length_m[told])


def test_the_origin_is_that_of_the_document_else_of_the_settings():
    config = InputConfig(lat_deg=1.0, lon_deg=2.0)
    assert source(document([], origin={"lat_deg": 3, "lon_deg": 4}), config).origin == Origin(3.0, 4.0)
    assert source(document([]), config).origin == Origin(1.0, 2.0)
    assert source(document([])).origin is None


@settings(derandomize=True, deadline=None)
@given(st.lists(st.binary(max_size=20).map(lambda b: b.replace(b"\x00", b"\n"))))
def test_lines_are_the_input_cut_after_each_end(chunks):
    found = list(split_lines(chunks))
    assert found == b"".join(chunks).splitlines(keepends=True) or b"\r" in b"".join(chunks)
    assert b"".join(found) == b"".join(chunks)


SAMPLES = [
    write_points([scan(t, [(t, 2.0), (3.0, 4.0)], label=np.array([0, 1])) for t in (1.0, 2.0)], lines=as_lines)
    + (lines(*TRUTH, head={"time_s": 3, "points": []}) if as_lines else b"")
    for as_lines in (True, False)
]


@settings(derandomize=True, deadline=None, max_examples=300)
@given(st.sampled_from(SAMPLES), st.integers(0, 300), st.binary(max_size=5), st.integers(0, 5))
def test_a_damaged_document_is_read_or_refused(data, at, octets, removed):
    damaged = data[:at] + octets + data[at + removed :]
    try:
        read = frames(damaged)
    except InputError as error:
        assert "\n" not in str(error)
        return
    assert b"".join(octets for f in read for _, octets in f.inputs) in (damaged, b"")
    for frame in read:
        assert np.isfinite(frame.scan.points.position_m).all()


def test_a_scan_of_video_or_of_another_frame_is_not_written():
    with pytest.raises(UsageError, match="video"):
        write_points([replace(scan(1.0, []), points=None)])
    with pytest.raises(UsageError, match="ned"):
        write_points([], frame="ned")


@pytest.mark.parametrize("frame", ["enu3", "polar3"])
def test_points_in_space_have_elevation_height_and_slant_range(frame):
    points = [[30.0, 40.0, 122.0, 7.0]] if frame == "enu3" else [[130.0, 36.8698976, 67.3801350, 7.0]]
    sensors = {"radar": {"up_m": 2.0, "sigma_range_m": 1.0, "sigma_azimuth_deg": 2.0, "sigma_elevation_deg": 3.0}}
    truth = [{"id": 1, "time_s": t, "east_m": 0, "north_m": 0, "up_m": 10.0 * t, "vel_up_mps": 10.0} for t in (0, 2)]
    data = document([{"time_s": 1.0, "points": points}], frame=frame, sensors=sensors, truth=truth)
    got = frames(data)[0].scan
    assert got.up_m == 2.0
    np.testing.assert_allclose(got.points.position_m, [[30.0, 40.0]], atol=1e-4)
    np.testing.assert_allclose(got.points.up_m, [122.0], atol=1e-4)
    np.testing.assert_allclose(got.points.range_m, [130.0], atol=1e-4)
    np.testing.assert_allclose(np.rad2deg(got.points.elevation_rad), [67.380135], atol=1e-4)
    np.testing.assert_allclose(got.points.noise, [np.square([1.0, *np.deg2rad([2.0, 3.0])])])
    assert got.points.intensity.tolist() == [7.0]
    known = truth_at(point_truth(data, name="x")[0], S)
    assert known.up_m.tolist() == [10.0] and known.vel_up_mps.tolist() == [10.0]


def test_points_beyond_the_zenith_are_no_places():
    (frame,) = frames(document([{"time_s": 1.0, "points": [[5, 0, 91.0], [5, 0, 89.0]]}], frame="polar3"))
    assert len(frame.scan.points) == 1 and frame.damage[0].code == "bad-point"


def test_points_of_the_plane_are_not_written_as_points_of_space():
    with pytest.raises(UsageError, match="no elevation"):
        write_points([scan(0.0, [(1.0, 2.0)])], frame="enu3")
