"""The Autoferry benchmark: MATLAB's JSON with its quirks, and the same in .mat files."""

from __future__ import annotations

import io
import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.io import savemat

from maritrack.errors import ConfigError, InputError
from maritrack.io.autoferry import ORIGIN, AutoferrySource, autoferry_truth
from maritrack.io.octets import octets_from_bytes, octets_from_file
from maritrack.io.reference import truth_at
from maritrack.settings import InputConfig
from tests.bench.bench_trackers import by_sensor
from tests.cli.calling import call
from tests.shared import ROOT, shared

RADAR = InputConfig(sensor="radar")
SAMPLE = ROOT / "data" / "samples" / "autoferry13_detections.json"
SAMPLE_TRUTH = ROOT / "data" / "samples" / "autoferry13_groundTruth.json"


def entry(time_s, measurement, *, sensor=2, own=(-10.0, 20.0)):
    return {
        "sensorID": sensor,
        "measurements": [],
        "ownshipPosition": list(own),
        "time": time_s,
        "measurement": measurement,
    }


def source(entries, config=RADAR, *, data=None, strict=False):
    data = json.dumps(entries).encode() if data is None else data
    return AutoferrySource(octets_from_bytes(data, name="rec", channel="/input/autoferry"), config, strict=strict)


def positions(entries, config=RADAR):
    return [f.scan.points.position_m.tolist() for f in source(entries, config).frames()]


@pytest.mark.parametrize(
    ("measurement", "expected"),
    [
        ([], []),
        ([3.0, 4.0], [[24.0, -7.0]]),
        ([[3.0, 5.0], [4.0, 6.0]], [[24.0, -7.0], [26.0, -5.0]]),
        ([[3.0, 5.0, 0.0], [4.0, 6.0, 0.0]], [[24.0, -7.0], [26.0, -5.0], [20.0, -10.0]]),
        ([[3.0], [4.0]], [[24.0, -7.0]]),
        ([[], []], []),
    ],
)
def test_none_one_and_many_points_are_north_then_east_from_own_ship(measurement, expected):
    assert positions([entry(1.0, measurement)]) == [expected]


def test_scans_of_one_sensor_come_in_order_of_time():
    entries = [entry(t, [t, 0.0], sensor=s) for t, s in ((3.0, 2), (1.0, 1), (2.0, 4), (1.5, 2), (0.5, 3), (1.2, 1))]
    entries += [entry(9.0, 0.25, sensor=4)]  # one bearing of a camera is a bare number
    assert [f.t_ns / 1e9 for f in source(entries).frames()] == [1.5, 3.0]
    assert [f.t_ns / 1e9 for f in source(entries, InputConfig()).frames()] == [1.5, 3.0]
    assert [f.t_ns / 1e9 for f in source(entries, InputConfig(sensor="lidar")).frames()] == [1.0, 1.2]


def test_radar_and_lidar_in_one_run_have_settings_of_their_own():
    entries = [entry(t, [t, 0.0], sensor=s) for t, s in ((3.0, 2), (1.0, 1), (2.0, 4), (1.5, 2))]
    both = InputConfig(sensor="radar+lidar", sigma_m=1.0)
    data = octets_from_bytes(json.dumps(entries).encode(), name="rec", channel="/input/autoferry")
    lidar = InputConfig(sigma_m=3.0, latency_s=0.5, roi_max_m=80.0)
    frames = list(AutoferrySource(data, both, sensors={"lidar": lidar}).frames())
    assert [(f.scan.sensor.id, f.t_ns / 1e9) for f in frames] == [("lidar", 1.0), ("radar", 1.5), ("radar", 3.0)]
    assert [f.scan.sensor.max_range_m for f in frames] == [80.0, math.inf, math.inf]
    assert [f.scan.points.t_ns[0] / 1e9 for f in frames] == [0.5, 1.5, 3.0]
    assert [f.scan.points.cov_m2[0, 0, 0] for f in frames] == pytest.approx([9.0, 1.0, 1.0])
    with pytest.raises(ConfigError, match="radar and lidar") as caught:
        AutoferrySource(data, InputConfig(sensor="radar+sonar"))
    assert caught.value.hint == "input.sensor = radar, lidar or radar+lidar"


def test_the_sample_with_both_sensors_is_processed_and_replayed(tmp_path):
    out, sensors = tmp_path / "run", SAMPLE.with_name("autoferry.sensors.toml")
    done = call(
        "process", SAMPLE, "-p", "autoferry-fused", "--sensors", sensors, "--truth", SAMPLE_TRUTH, "--no-rrd",
        "-o", out, "--json",
    ).json  # fmt: skip
    assert done["counts"]["scans"] == 232 + 69 and done["metrics"]["gospa"] < 9.0
    assert call("replay", out / "run.mcap", "--verify", "--no-rrd").code == 0


@pytest.mark.parametrize("tracker", ["jipda", "giw-pmbm"])
def test_the_sample_with_both_sensors_is_tracked_better_than_with_either(tracker):
    radar, at_radar = by_sensor(SAMPLE, SAMPLE_TRUTH, tracker, "radar")
    both, both_at_radar = by_sensor(SAMPLE, SAMPLE_TRUTH, tracker, "radar+lidar")
    lidar, never = by_sensor(SAMPLE, SAMPLE_TRUTH, tracker, "lidar")
    assert radar == pytest.approx(at_radar) and math.isnan(never)
    assert both < radar < lidar
    assert both_at_radar < radar - 0.3


def test_the_first_frame_carries_the_octets():
    data = json.dumps([entry(t, []) for t in (2.0, 1.0)], indent=3).encode()
    frames = list(source(None, data=data).frames())
    assert [f.inputs for f in frames] == [(("/input/autoferry", data),), ()]
    assert [f.scan.sensor.id for f in frames] == ["radar", "radar"]


def test_points_are_older_than_the_stamp_and_noise_comes_from_the_settings():
    config = InputConfig(
        sensor="radar", latency_s=1.7, sigma_range_m=4.0, sigma_m=4.0, sigma_azimuth_deg=2.0, roi_max_m=350.0
    )
    (frame,) = source([entry(10.0, [[300.0, 400.0], [0.0, 0.0]])], config).frames()
    assert frame.t_ns == 10 * 10**9
    assert frame.scan.points.t_ns.tolist() == [8_300_000_000]
    np.testing.assert_allclose(frame.scan.points.cov_m2, [np.diag([(300.0 * np.deg2rad(2.0)) ** 2, 16.0])], atol=1e-9)
    assert frame.scan.position_m.tolist() == [20.0, -10.0]


def test_points_that_are_no_places_are_left_out_and_counted():
    entries = [entry(1.0, [[1.0, None, float("nan"), 1e300], [2.0, 3.0, 4.0, 5.0]])]
    (frame,) = source(entries).frames()
    assert frame.scan.points.position_m.tolist() == [[22.0, -9.0]]
    assert [(d.code, d.count) for d in frame.damage] == [("bad-point", 3)]
    with pytest.raises(InputError, match="bad-point"):
        list(source(entries, strict=True).frames())


TRUTH = [
    [
        {"targetID": 1, "position": [1.0, 2.0, 0], "time": 10.0},
        {"targetID": 2, "position": [5.0, 6.0, 0], "time": 10.5},
    ],
    [{"targetID": 1, "position": [1.0, 2.0, 0], "time": 10.0}, {"targetID": 2, "position": [7.0, 8.0, 0], "time": 9.5}],
    {"targetID": 1, "position": [3.0, 4.0, 0], "time": 11.0},
]


def test_truth_is_all_positions_once_in_order_of_time():
    reference = autoferry_truth(json.dumps(TRUTH).encode(), name="x")
    assert reference.ids == ("1", "2")
    assert reference.names == ("", "")
    assert reference.complete
    assert reference.start.tolist() == [0, 2, 4]
    assert (reference.t_ns / 1e9).tolist() == [10.0, 11.0, 9.5, 10.5]
    assert reference.position_m.tolist() == [[2.0, 1.0], [4.0, 3.0], [8.0, 7.0], [6.0, 5.0]]


def matlab(entries, truth):
    """A .mat file as MATLAB writes it: cells of structs."""
    rows = np.empty((1, len(entries)), dtype=object)
    for i, value in enumerate(entries):
        rows[0, i] = {**value, "measurement": np.array(value["measurement"], dtype=float)}
    cells = np.empty((1, len(truth)), dtype=object)
    for i, targets in enumerate(truth):
        cells[0, i] = np.array(targets, dtype=object)
    file = io.BytesIO()
    savemat(file, {"detectionList": rows, "groundTruth": cells}, do_compression=True)
    return file.getvalue()


def test_a_mat_file_holds_detections_and_truth():
    entries = [
        entry(1.0, [[3.0, 5.0], [4.0, 6.0]]),
        entry(0.5, []),
        entry(2.0, [[3.0], [4.0]]),
        entry(3.0, [[0.1, 0.2]], sensor=4),
    ]
    data = matlab(entries, TRUTH[:2])
    reader = source(None, data=data)
    assert [f.scan.points.position_m.tolist() for f in reader.frames()] == positions(entries)
    assert reader.reference is not None
    assert reader.reference.position_m.tolist() == [[2.0, 1.0], [8.0, 7.0], [6.0, 5.0]]
    assert autoferry_truth(data, name="x").t_ns.tolist() == reader.reference.t_ns.tolist()


def test_a_mat_file_of_something_else_is_an_error():
    file = io.BytesIO()
    savemat(file, {"x": 1.0})
    with pytest.raises(InputError, match="rec: a MATLAB file of neither detectionList, groundTruth nor AIS"):
        source(None, data=file.getvalue())


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "line 1 column 1"),
        (b"[" * 100_000, "nested too deeply"),
        (b'[{"sensorID": 2]', "line 1 column 16"),
        (b"{}", "document: a list was expected"),
        (json.dumps([entry(1.0, []), 7]).encode(), r"detections\[1\]: an object was expected"),
        (json.dumps([entry("x", [])]).encode(), r"detections\[0\]: 'time' is a number"),
        (json.dumps([entry(1e300, [])]).encode(), r"'time' = 1e\+300"),
        (json.dumps([entry(1.0, [], own=(1.0,))]).encode(), "ownshipPosition is"),
        (json.dumps([entry(1.0, [], own=(1.0, None))]).encode(), "ownshipPosition is"),
        (json.dumps([entry(1.0, [1.0, 2.0, 3.0])]).encode(), "two rows, north and east"),
        (json.dumps([entry(1.0, [[1.0, 2.0], [3.0]])]).encode(), "numbers were expected"),
        (json.dumps([entry(1.0, ["1", "2"])]).encode(), "numbers were expected"),
        (json.dumps([entry(1.0, [{}, 2])]).encode(), "numbers were expected"),
        (json.dumps(TRUTH).encode(), "ground truth alone"),
    ],
)
def test_what_is_no_such_file_is_an_error_of_one_line_with_the_place(data, message):
    with pytest.raises(InputError, match=message) as caught:
        source(None, data=data)
    assert str(caught.value).startswith("rec: ")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (json.dumps([entry(1.0, [])]).encode(), "detections alone"),
        (b'[[{"targetID": 1, "position": [1], "time": 1}]]', "position is"),
        (b'[[{"targetID": null, "position": [1, 2], "time": 1}]]', "'targetID' is missing"),
        (b'[[{"targetID": 1, "position": [1, 2]}]]', "'time' is missing"),
        (b"[[3]]", "an object was expected"),
    ],
)
def test_what_is_no_truth_is_an_error_of_one_line_with_the_place(data, message):
    with pytest.raises(InputError, match=message):
        autoferry_truth(data, name="rec")


def test_a_sensor_that_the_data_set_lacks_is_an_error():
    with pytest.raises(ConfigError, match="radar and lidar"):
        source([], InputConfig(sensor="sonar"))


MAT = matlab([entry(1.0, [[3.0, 5.0], [4.0, 6.0]]), entry(2.0, [])], TRUTH[:2])
JSON = json.dumps([entry(1.0, [[3.0, 5.0], [4.0, 6.0]]), entry(2.0, [])]).encode()


@settings(derandomize=True, deadline=None, max_examples=300)
@given(st.sampled_from([MAT, JSON]), st.floats(0.0, 1.0), st.binary(max_size=5), st.integers(0, 5))
def test_a_damaged_file_is_read_or_refused(data, share, octets, removed):
    at = round(share * len(data))
    try:
        frames = list(source(None, data=data[:at] + octets + data[at + removed :]).frames())
    except InputError as error:
        assert "\n" not in str(error)
    else:
        assert all(np.isfinite(f.scan.points.position_m).all() for f in frames)


def test_the_sample_has_its_scans_and_its_boats():
    reader = AutoferrySource(octets_from_file(SAMPLE, "/input/autoferry"), RADAR)
    frames = list(reader.frames())
    assert reader.origin == ORIGIN
    assert len(frames) == 69
    assert np.all(np.diff([f.t_ns for f in frames]) > 1_500_000_000)
    reference = autoferry_truth(SAMPLE_TRUTH.read_bytes(), name="x")
    near = []
    for frame in frames:
        truth = truth_at(reference, frame.t_ns)
        assert truth.id == ("1", "2")
        away = np.linalg.norm(frame.scan.points.position_m[:, None] - truth.position_m, axis=2)
        near += (away.min(axis=0, initial=np.inf) < 20.0).tolist()
    assert 0.7 < np.mean(near) < 0.85  # plots within 20 m of a boat: 0.78 to 0.99 in all scenarios, this is the least


@pytest.mark.parametrize("scenario", [2, 3, 4, 13, 17])
def test_real_json_and_mat_say_the_same(scenario):
    folder = shared(f"data/autoferry/scenario{scenario}")
    readers = [
        AutoferrySource(octets_from_file(folder / f"scenario{scenario}{ending}", "/input/autoferry"), RADAR)
        for ending in ("_detections.json", ".mat")
    ]
    for one, other in zip(readers[0].frames(), readers[1].frames(), strict=True):
        assert one.t_ns == other.t_ns
        assert np.array_equal(one.scan.points.position_m, other.scan.points.position_m)
    truth = autoferry_truth((folder / f"scenario{scenario}_groundTruth.json").read_bytes(), name="x")
    inside = readers[1].reference
    assert inside is not None
    assert np.array_equal(truth.t_ns, inside.t_ns)
    assert np.array_equal(truth.position_m, inside.position_m)
