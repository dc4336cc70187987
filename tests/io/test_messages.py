"""Archived messages give back exactly what went in, and refuse anything else."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from foxglove_schemas_protobuf import PointCloud_pb2
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from maritrack.io import cloud, messages
from maritrack.types import Clusters, Event, Points, Scan, Sensor, Tracks, Truth
from tests import runs

fuzzed = settings(derandomize=True, deadline=None, max_examples=60)
sizes = st.integers(0, 5)
times = st.integers(0, 2**62)


def floats(*shape: int) -> Any:
    return arrays(np.float64, shape, elements=st.floats(width=64))


def integers(*shape: int) -> Any:
    return arrays(np.int64, shape, elements=st.integers(-(2**63), 2**63 - 1))


@st.composite
def some_clusters(draw: Any) -> Clusters:
    c, n = draw(sizes), draw(sizes)
    return Clusters(
        draw(floats(c, 2)), draw(floats(c, 2, 2)), draw(integers(c)), draw(floats(c)), draw(floats(c, 2, 2)),
        draw(integers(c)), draw(floats(c)), draw(floats(c)), draw(floats(c)), draw(integers(n)),
    )  # fmt: skip


def heights(n: int) -> Any:
    """Up and its velocity, or neither; of nothing neither."""
    return st.just((None, None)) | st.tuples(floats(n), floats(n)) if n else st.just((None, None))


@st.composite
def some_tracks(draw: Any) -> Tracks:
    t = draw(sizes)
    contours = tuple(draw(floats(draw(sizes), 2)) for _ in range(t)) if draw(st.booleans()) else ()
    return Tracks(
        draw(integers(t)), draw(integers(t)), draw(floats(t, 2)), draw(floats(t, 2)), draw(floats(t, 4, 4)),
        draw(floats(t, 2, 2)), draw(floats(t)), draw(integers(t)), draw(arrays(np.bool_, t)), draw(integers(t)),
        contours, draw(st.none() | floats(t)) if t else None, *draw(heights(t)),
    )  # fmt: skip


@st.composite
def some_truth(draw: Any) -> Truth:
    n = draw(sizes)
    names = st.tuples(*[st.text(st.characters(codec="utf-8"), max_size=5)] * n)
    return Truth(
        draw(names), draw(names), draw(st.integers(-(2**63), 2**63 - 1)), draw(floats(n, 2)), draw(floats(n, 2)),
        draw(floats(n)), draw(floats(n)), draw(floats(n)), *draw(heights(n)),
    )  # fmt: skip


def repetitive(n: int) -> Any:
    """Columns as they come: anything, whole numbers of a video cell, or one value throughout."""
    octets = arrays(np.uint8, n).map(lambda a: a.astype(np.float64))
    return st.one_of(floats(n), octets, st.floats(width=64).map(lambda v: np.full(n, v)))


@st.composite
def some_points(draw: Any) -> Points:
    n = draw(sizes)
    whole = st.one_of(integers(n), st.integers(-1, 9).map(lambda v: np.full(n, v)))
    return Points(
        draw(repetitive(n)), draw(repetitive(n)), draw(floats(n, 2)), draw(repetitive(n)), draw(whole),
        draw(repetitive(n)), draw(repetitive(n)), draw(st.none() | floats(n, 2, 2)), draw(st.none() | whole),
        *draw(st.just((None, None)) | st.tuples(repetitive(n), floats(n))), draw(st.none() | floats(n, 3)),
    )  # fmt: skip


@fuzzed
@given(some_clusters())
def test_clusters_come_back_to_the_bit(clusters: Clusters) -> None:
    assert runs.differences(clusters, messages.decode_clusters(messages.encode_clusters(clusters))) == []


@fuzzed
@given(some_tracks())
def test_tracks_come_back_to_the_bit(tracks: Tracks) -> None:
    assert runs.differences(tracks, messages.decode_tracks(messages.encode_tracks(tracks))) == []


@fuzzed
@given(some_truth())
def test_truth_comes_back_to_the_bit(truth: Truth) -> None:
    assert runs.differences(truth, messages.decode_truth(messages.encode_truth(truth))) == []


@settings(fuzzed, max_examples=120)
@given(some_points(), times, st.data())
def test_points_come_back_to_the_bit(points: Points, t_ns: int, data: Any) -> None:
    keep = data.draw(arrays(np.bool_, len(points)))
    octets, constants = cloud.encode_points(points, keep=keep, label=np.arange(keep.sum()) - 1, t_ns=t_ns)
    again, kept = cloud.decode_points(octets, constants, t_ns=t_ns)
    assert runs.differences(points, again) == []
    assert np.array_equal(keep, kept)


@fuzzed
@given(
    times, st.floats(width=64), floats(2), st.none() | arrays(np.bool_, st.integers(0, 30)),
    st.dictionaries(st.sampled_from(["range_m", "intensity"]), st.floats(width=64, allow_nan=False)),
)  # fmt: skip
def test_a_scan_comes_back_to_the_bit(t_ns: int, value: float, position_m: Any, swept: Any, floats_: Any) -> None:
    constants = floats_ | {"t_ns": -(2**62)}
    scan = Scan(Sensor("å-1", value, value, value, 16), t_ns, t_ns - 1, position_m, value, segment=-3, swept=swept)
    told = messages.decode_scan(messages.encode_scan(scan, constants=constants, n_messages=5))
    assert runs.differences(scan.sensor, told.scan.sensor) == []
    assert set(runs.differences(scan, told.scan)) <= {"sensor"}
    assert (told.n_spokes, told.n_messages, told.constants) == (0, 5, constants)


def test_scores_come_back_in_the_order_of_their_names() -> None:
    scores = messages.decode_scores(messages.encode_scores({"b": np.inf, "a": -0.0, "c": 1e-300}))
    assert repr(scores) == "{'a': -0.0, 'b': inf, 'c': 1e-300}"


@pytest.mark.parametrize("level", ["info", "warning"])
def test_a_log_line_comes_back(level: str) -> None:
    event = Event(level, "ingest", "gap of 3 spokes at 0°")
    assert messages.decode_log(messages.encode_log(event, t_ns=5)) == event


def test_a_lone_surrogate_does_not_stop_the_archive() -> None:
    event = Event("info", "ingest", "name \ud800")
    assert messages.decode_log(messages.encode_log(event, t_ns=5)).message == "name ?"


def test_columns_of_one_value_are_stored_once() -> None:
    points = runs.result(0, n=200).points
    keep = np.ones(200, bool)
    octets, constants = cloud.encode_points(points, keep=keep, label=np.arange(200), t_ns=runs.T0_NS)
    fields = {f.name: f.type for f in PointCloud_pb2.PointCloud.FromString(octets).fields}
    assert constants == {"range_width_m": 7.5, "azimuth_width_rad": 2 * np.pi / 4096}
    assert list(fields)[:4] == ["x", "y", "z", "intensity"]
    assert (fields["x"], fields["y"], fields["intensity"]) == (8, 8, 1)  # FLOAT64, FLOAT64, UINT8


DECODERS: dict[str, Callable[[bytes], Any]] = {
    "clusters": messages.decode_clusters, "tracks": messages.decode_tracks, "truth": messages.decode_truth,
    "scores": messages.decode_scores, "log": messages.decode_log, "scan": messages.decode_scan,
    "points": lambda data: cloud.decode_points(data, {"range_width_m": 7.5, "azimuth_width_rad": 0.1}, t_ns=0),
}  # fmt: skip


@functools.cache
def encoded() -> dict[str, bytes]:
    result = runs.result(1)
    assert result.frame.truth is not None
    scan = messages.encode_scan(result.frame.scan, constants={"t_ns": 5}, n_messages=3)
    label = result.clusters.label
    return {
        "clusters": messages.encode_clusters(result.clusters), "tracks": messages.encode_tracks(result.tracks),
        "truth": messages.encode_truth(result.frame.truth), "scores": messages.encode_scores(result.scores),
        "log": messages.encode_log(result.events[0], t_ns=5), "scan": scan,
        "points": cloud.encode_points(result.points, keep=result.keep, label=label, t_ns=5)[0],
    }  # fmt: skip


@pytest.mark.parametrize("name", DECODERS)
@settings(fuzzed, max_examples=80)
@given(st.data())
def test_spoiled_octets_are_refused_or_decoded_but_never_crash(name: str, data: Any) -> None:
    octets = bytearray(encoded()[name])
    for _ in range(data.draw(st.integers(1, 3))):
        octets[data.draw(st.integers(0, len(octets) - 1))] = data.draw(st.integers(0, 255))
    try:
        DECODERS[name](bytes(octets[: data.draw(st.integers(0, len(octets)))]))
    except ValueError:
        return


def test_rows_that_do_not_add_up_are_refused() -> None:
    kind = messages.OUTPUTS["/tracks"]
    with pytest.raises(ValueError, match="rows"):
        messages.decode_tracks(kind(id=[1, 2], t_ns=[5]).SerializeToString())
    with pytest.raises(ValueError, match="reshape"):
        messages.decode_tracks(kind(position_m=[1.0, 2.0, 3.0]).SerializeToString())
    with pytest.raises(ValueError, match="contours"):
        messages.decode_tracks(kind(contour_size=[-1, 2]).SerializeToString())


@pytest.mark.parametrize(
    ("stride", "offset", "kind"), [(0, 0, 8), (8, 4, 8), (7, 0, 8), (8, 0, 99), (2**32 - 1, 2**32 - 1, 8)]
)
def test_a_cloud_with_impossible_columns_is_refused(stride: int, offset: int, kind: int) -> None:
    packed = PointCloud_pb2.PointCloud(point_stride=stride, data=bytes(16))
    packed.fields.add(name="x", offset=offset, type=kind)
    with pytest.raises(ValueError, match=r"cloud|column|offset|dtype|too large"):
        cloud.decode_points(packed.SerializeToString(), {}, t_ns=0)
