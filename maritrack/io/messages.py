"""Archived messages: arrays to Protobuf octets and back, bit for bit.

Own messages are described by the tables below and built at run time, so that no generated code is
needed; `schema()` gives the description that goes into the archive. Points are in `io/cloud.py`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from foxglove_schemas_protobuf import Log_pb2, PointCloud_pb2
from google.protobuf import descriptor_pb2, descriptor_pool, message, message_factory

from maritrack.io.cloud import INT_COLUMNS, Constants
from maritrack.types import Clusters, Event, Scan, Sensor, Tracks, Truth

_FIELD = descriptor_pb2.FieldDescriptorProto
_KIND = {
    "double": (_FIELD.TYPE_DOUBLE, np.float64),
    "sint64": (_FIELD.TYPE_SINT64, np.int64),
    "sfixed64": (_FIELD.TYPE_SFIXED64, np.int64),
    "bool": (_FIELD.TYPE_BOOL, np.bool_),
    "string": (_FIELD.TYPE_STRING, np.str_),
    "bytes": (_FIELD.TYPE_BYTES, np.bytes_),
}  # fmt: skip


class _Column(NamedTuple):
    """A field of a message: packed rows of `shape`, or one value where `shape` is None."""

    name: str
    kind: str
    shape: tuple[int, ...] | None = ()


_CLUSTERS = (
    _Column("mean_m", "double", (2,)), _Column("scatter_m2", "double", (2, 2)), _Column("count", "sint64"),
    _Column("weight_sq", "double"), _Column("noise_m2", "double", (2, 2)), _Column("t_ns", "sfixed64"),
    _Column("range_m", "double"), _Column("azimuth_rad", "double"), _Column("intensity", "double"),
    _Column("label", "sint64"),
)  # fmt: skip
_TRACKS = (
    _Column("id", "sint64"), _Column("t_ns", "sfixed64"), _Column("position_m", "double", (2,)),
    _Column("velocity_mps", "double", (2,)), _Column("cov", "double", (4, 4)), _Column("extent_m2", "double", (2, 2)),
    _Column("existence", "double"), _Column("status", "sint64"), _Column("moving", "bool"),
    _Column("cluster", "sint64"),
)  # fmt: skip
_CONTOURS = (_Column("contour_size", "sint64"), _Column("contour_m", "double", (2,)))
_EXTENT_DOF = (_Column("extent_dof", "double"),)  # none = the tracker has no such
_UP = (_Column("up_m", "double"), _Column("vel_up_mps", "double"))  # none = in the plane
_TRUTH = (
    _Column("position_m", "double", (2,)), _Column("velocity_mps", "double", (2,)), _Column("heading_rad", "double"),
    _Column("length_m", "double"), _Column("width_m", "double"),
)  # fmt: skip
_TRUTH_NAMES = (_Column("t_ns", "sfixed64", None), _Column("id", "string"), _Column("name", "string"))
_SCORES = (_Column("name", "string"), _Column("value", "double"))
_SCAN = (
    _Column("t_ns", "sfixed64", None), _Column("t_start_ns", "sfixed64", None), _Column("sensor", "string", None),
    _Column("range_res_m", "double", None), _Column("azimuth_res_rad", "double", None),
    _Column("max_range_m", "double", None), _Column("bits", "sint64", None), _Column("position_m", "double", (2,)),
    _Column("heading_rad", "double", None), _Column("segment", "sint64", None), _Column("n_spokes", "sint64", None),
    _Column("swept_bins", "sint64", None), _Column("swept", "bytes", None), _Column("constant_name", "string"),
    _Column("constant_float", "double"), _Column("constant_int", "sint64"), _Column("n_messages", "sint64", None),
    _Column("up_m", "double", None),
)  # fmt: skip
_MESSAGES = {
    "Scan": _SCAN, "Clusters": _CLUSTERS, "Tracks": _TRACKS + _CONTOURS + _EXTENT_DOF + _UP,
    "Truth": _TRUTH_NAMES + _TRUTH + _UP, "Scores": _SCORES,
}  # fmt: skip


def _build_classes() -> dict[str, Any]:
    file = descriptor_pb2.FileDescriptorProto(name="maritrack/archive.proto", package="maritrack", syntax="proto3")
    for name, columns in _MESSAGES.items():
        kind = file.message_type.add(name=name)
        for number, column in enumerate(columns, start=1):
            label = _FIELD.LABEL_OPTIONAL if column.shape is None else _FIELD.LABEL_REPEATED
            kind.field.add(name=column.name, number=number, type=_KIND[column.kind][0], label=label)
    pool = descriptor_pool.DescriptorPool()
    pool.AddSerializedFile(file.SerializeToString(deterministic=True))
    return {n: message_factory.GetMessageClass(pool.FindMessageTypeByName(f"maritrack.{n}")) for n in _MESSAGES}


_CLASS = _build_classes()
OUTPUTS = {  # topic -> message, in the order in which a scan is written
    "/scan": _CLASS["Scan"],
    "/truth": _CLASS["Truth"],
    "/points": PointCloud_pb2.PointCloud,
    "/clusters": _CLASS["Clusters"],
    "/tracks": _CLASS["Tracks"],
    "/scores": _CLASS["Scores"],
    "/log": Log_pb2.Log,
}


def schema(topic: str) -> tuple[str, bytes]:
    """Name and serialised FileDescriptorSet of the messages of an output topic."""
    files, seen = descriptor_pb2.FileDescriptorSet(), []

    def add(file: Any) -> None:
        if file.name not in seen:
            seen.append(file.name)
            for other in file.dependencies:
                add(other)
            file.CopyToProto(files.file.add())

    descriptor = OUTPUTS[topic].DESCRIPTOR
    add(descriptor.file)
    return descriptor.full_name, files.SerializeToString(deterministic=True)


def encode_clusters(clusters: Clusters) -> bytes:
    """`maritrack.Clusters` of all fields."""
    return _octets(_filled("Clusters", _CLUSTERS, clusters))


def decode_clusters(data: bytes) -> Clusters:
    """The clusters that `encode_clusters` got. ValueError where the octets are not such a message."""
    return Clusters(**_arrays(_parse(_CLASS["Clusters"], data), _CLUSTERS))


def encode_tracks(tracks: Tracks) -> bytes:
    """`maritrack.Tracks` of all fields; contours one after the other, and how long each is."""
    packed = _filled("Tracks", _TRACKS, tracks)
    for contour in tracks.contour_m:
        packed.contour_size.append(len(contour))
        packed.contour_m.extend(contour.ravel().tolist())
    if tracks.extent_dof is not None:
        packed.extent_dof.extend(tracks.extent_dof.tolist())
    _fill_up(packed, tracks)
    return _octets(packed)


def decode_tracks(data: bytes) -> Tracks:
    """The tracks that `encode_tracks` got. ValueError where the octets are not such a message."""
    packed = _parse(_CLASS["Tracks"], data)
    size, vertices = _arrays(packed, _CONTOURS).values()
    if size.min(initial=0) < 0 or sum(size.tolist()) != len(vertices):
        raise ValueError("the contours of the tracks do not add up")
    contours = tuple(np.split(vertices, np.cumsum(size)[:-1])) if len(size) else ()
    rows = _arrays(packed, _TRACKS) | (_arrays(packed, _EXTENT_DOF) if len(packed.extent_dof) else {})
    return Tracks(**rows, **_up_of(packed), contour_m=contours)


def encode_truth(truth: Truth) -> bytes:
    """`maritrack.Truth` of all fields."""
    packed = _filled("Truth", _TRUTH, truth)
    packed.t_ns = truth.t_ns
    packed.id.extend(map(_text, truth.id))
    packed.name.extend(map(_text, truth.name))
    _fill_up(packed, truth)
    return _octets(packed)


def decode_truth(data: bytes) -> Truth:
    """The truth that `encode_truth` got. ValueError where the octets are not such a message."""
    packed = _parse(_CLASS["Truth"], data)
    rows = _arrays(packed, _TRUTH) | _up_of(packed)
    return Truth(id=tuple(packed.id), name=tuple(packed.name), t_ns=packed.t_ns, **rows)


def encode_scores(scores: Mapping[str, float]) -> bytes:
    """`maritrack.Scores`, ordered by name."""
    names = sorted(scores)
    return _octets(_CLASS["Scores"](name=names, value=[float(scores[name]) for name in names]))


def decode_scores(data: bytes) -> dict[str, float]:
    """The scores that `encode_scores` got, ordered by name."""
    packed = _parse(_CLASS["Scores"], data)
    return dict(zip(packed.name, packed.value, strict=True))


def encode_log(event: Event, *, t_ns: int) -> bytes:
    """`foxglove.Log` of a line of the log."""
    packed = Log_pb2.Log(message=_text(event.message), name=_text(event.stage))
    packed.level = Log_pb2.Log.Level.Value(event.level.upper())
    packed.timestamp.FromNanoseconds(t_ns)
    return _octets(packed)


def decode_log(data: bytes) -> Event:
    """The line that `encode_log` got."""
    packed = _parse(Log_pb2.Log, data)
    return Event(Log_pb2.Log.Level.Name(packed.level).lower(), packed.name, packed.message)


@dataclass(frozen=True, slots=True, eq=False)
class ScanRecord:
    """What `maritrack.Scan` says: the scan without its video and points."""

    scan: Scan
    n_spokes: int
    n_messages: int  # of the scan in the archive's output topics, this one too
    constants: Constants


def encode_scan(scan: Scan, *, constants: Constants, n_messages: int) -> bytes:
    """`maritrack.Scan` of everything but video and points, with the points' constant columns."""
    packed = _CLASS["Scan"](
        t_ns=scan.t_ns, t_start_ns=scan.t_start_ns, sensor=_text(scan.sensor.id), range_res_m=scan.sensor.range_res_m,
        azimuth_res_rad=scan.sensor.azimuth_res_rad, max_range_m=scan.sensor.max_range_m, bits=scan.sensor.bits,
        position_m=scan.position_m.tolist(), heading_rad=scan.heading_rad, segment=scan.segment,
        n_spokes=scan.n_spokes, n_messages=n_messages, swept_bins=-1 if scan.swept is None else len(scan.swept),
        swept=b"" if scan.swept is None else np.packbits(scan.swept).tobytes(), up_m=scan.up_m,
    )  # fmt: skip
    for name, value in constants.items():
        packed.constant_name.append(name)
        packed.constant_float.append(value if isinstance(value, float) else 0.0)
        packed.constant_int.append(0 if isinstance(value, float) else value)
    return _octets(packed)


def decode_scan(data: bytes) -> ScanRecord:
    """What `encode_scan` got. ValueError where the octets are not such a message."""
    packed = _parse(_CLASS["Scan"], data)
    sensor = Sensor(packed.sensor, packed.range_res_m, packed.azimuth_res_rad, packed.max_range_m, packed.bits)
    bins, position_m = packed.swept_bins, np.array(packed.position_m)
    if len(position_m) != 2 or (bins + 7) // 8 != len(packed.swept):
        raise ValueError("the scan's position or swept bins are not of their size")
    bits = np.unpackbits(np.frombuffer(packed.swept, np.uint8), count=max(bins, 0)).astype(bool)
    scan = Scan(
        sensor, packed.t_ns, packed.t_start_ns, position_m, packed.heading_rad, segment=packed.segment,
        swept=None if bins < 0 else bits, up_m=packed.up_m,
    )  # fmt: skip
    rows = zip(packed.constant_name, packed.constant_float, packed.constant_int, strict=True)
    return ScanRecord(scan, packed.n_spokes, packed.n_messages, {n: i if n in INT_COLUMNS else f for n, f, i in rows})


def _filled(name: str, columns: tuple[_Column, ...], value: Any) -> Any:
    packed = _CLASS[name]()
    for column in columns:
        getattr(packed, column.name).extend(getattr(value, column.name).ravel().tolist())
    return packed


def _fill_up(packed: Any, value: Tracks | Truth) -> None:
    if value.up_m is not None and value.vel_up_mps is not None:
        packed.up_m.extend(value.up_m.tolist())
        packed.vel_up_mps.extend(value.vel_up_mps.tolist())


def _up_of(packed: Any) -> dict[str, Any]:
    """Up and its velocity; nothing where there is none."""
    return _arrays(packed, _UP) if len(packed.up_m) else {}


def _arrays(packed: Any, columns: tuple[_Column, ...]) -> dict[str, Any]:
    arrays: dict[str, Any] = {}
    for name, kind, shape in columns:
        values = getattr(packed, name)
        arrays[name] = np.fromiter(values, _KIND[kind][1], len(values)).reshape(-1, *(shape or ()))
    return arrays


def _octets(packed: Any) -> bytes:
    return bytes(packed.SerializeToString(deterministic=True))


def _parse(kind: Any, data: bytes) -> Any:
    try:
        return kind.FromString(data)
    except message.DecodeError as error:
        raise ValueError(f"not a {kind.DESCRIPTOR.full_name}: {error}") from None


def _text(text: str) -> str:
    """The text without lone surrogates, which Protobuf refuses."""
    return text if text.isascii() else text.encode("utf-8", "replace").decode("utf-8")
