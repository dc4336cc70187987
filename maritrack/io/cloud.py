"""Points of a scan as `foxglove.PointCloud`, which viewers draw, and back, bit for bit.

x and y are FLOAT64; z is a column of zeros in the plane, since Rerun draws nothing without it. What else `Points`
holds are further columns; a column that is the same for all points of a scan is left out and told
once, in `maritrack.Scan`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from foxglove_schemas_protobuf import PointCloud_pb2
from google.protobuf import message

from maritrack.types import BoolArray, IntArray, Points

REMOVED = -2  # "cluster" of a point that background subtraction took away; -1 = noise
Constants = Mapping[str, float | int]  # columns of a scan's points that have one value

INT_COLUMNS = ("t_ns", "cluster", "truth_label")
_COV_COLUMNS = ("cov_ee", "cov_en", "cov_ne", "cov_nn")
_NOISE_COLUMNS = ("var_range", "var_azimuth", "var_elevation")
_PACKED = {"u1": 1, "i1": 2, "u2": 3, "i2": 4, "u4": 5, "i4": 6, "f4": 7, "f8": 8}  # PackedElementField
_NUMPY = {number: f"<{code}" for code, number in _PACKED.items()}


def encode_points(points: Points, *, keep: BoolArray, label: IntArray, t_ns: int) -> tuple[bytes, Constants]:
    """`foxglove.PointCloud` of a scan at `t_ns`, and the columns that have one value.

    `label` (keep.sum(),) is the cluster of each kept point. Column "t_ns" counts from the scan's
    time. Integers beyond 32 bits take two columns, "_lo" and "_hi".
    """
    up_m = np.zeros(len(points), np.uint8) if points.up_m is None else points.up_m
    varying: list[tuple[str, Any]] = [
        ("x", points.position_m[:, 0]), ("y", points.position_m[:, 1]), ("z", up_m),
    ]  # fmt: skip
    constants: dict[str, float | int] = {}
    for name, values in _point_columns(points, keep=keep, label=label, t_ns=t_ns):
        bits = np.ascontiguousarray(values).view(np.int64)
        if len(bits) and (bits == bits[0]).all():
            constants[name] = values[0].item()
        else:
            varying.extend(_narrowed(name, values))
    rows = np.empty(len(points), np.dtype([(name, values.dtype.newbyteorder("<")) for name, values in varying]))
    for name, values in varying:
        rows[name] = values
    cloud = PointCloud_pb2.PointCloud(frame_id="enu", point_stride=rows.dtype.itemsize, data=rows.tobytes())
    cloud.timestamp.FromNanoseconds(t_ns)
    cloud.pose.orientation.w = 1.0
    offset = 0
    for name, values in varying:
        cloud.fields.add(name=name, offset=offset, type=_PACKED[values.dtype.str[1:]])
        offset += values.dtype.itemsize
    return bytes(cloud.SerializeToString(deterministic=True)), constants


def decode_points(data: bytes, constants: Constants, *, t_ns: int) -> tuple[Points, BoolArray]:
    """The points and `keep` that `encode_points` got. ValueError where the octets are not such a message."""
    rows = _rows(data)
    names = set(rows.dtype.names or ()) | set(constants)

    def floats(name: str) -> Any:
        return np.array(rows[name], np.float64) if name in rows.dtype.names else np.full(len(rows), constants[name])

    def integers(name: str) -> Any:
        if f"{name}_lo" in names:
            return rows[f"{name}_hi"].astype(np.int64) << 32 | rows[f"{name}_lo"].astype(np.int64)
        return np.array(rows[name], np.int64) if name in rows.dtype.names else np.full(len(rows), constants[name])

    try:
        points = Points(
            floats("range_m"), floats("azimuth_rad"), np.stack([floats("x"), floats("y")], axis=-1),
            floats("intensity"), integers("t_ns") + np.int64(t_ns), floats("range_width_m"),
            floats("azimuth_width_rad"),
            np.stack([floats(c) for c in _COV_COLUMNS], axis=-1).reshape(-1, 2, 2) if "cov_ee" in names else None,
            integers("truth_label") if names & {"truth_label", "truth_label_lo"} else None,
            floats("elevation_rad") if "elevation_rad" in names else None,
            floats("z") if "elevation_rad" in names else None,
            np.stack([floats(c) for c in _NOISE_COLUMNS], axis=-1) if "var_range" in names else None,
        )  # fmt: skip
        return points, integers("cluster") != REMOVED
    except KeyError as error:
        raise ValueError(f"the points have no column {error}") from None


def _point_columns(points: Points, *, keep: BoolArray, label: IntArray, t_ns: int) -> list[tuple[str, Any]]:
    cluster = np.full(len(points), REMOVED, np.int64)
    cluster[keep] = label
    columns = [
        ("intensity", points.intensity), ("range_m", points.range_m), ("azimuth_rad", points.azimuth_rad),
        ("t_ns", points.t_ns - np.int64(t_ns)), ("cluster", cluster), ("range_width_m", points.range_width_m),
        ("azimuth_width_rad", points.azimuth_width_rad),
    ]  # fmt: skip
    if points.cov_m2 is not None:
        columns += zip(_COV_COLUMNS, points.cov_m2.reshape(-1, 4).T, strict=True)
    if points.elevation_rad is not None:
        columns.append(("elevation_rad", points.elevation_rad))
    if points.noise is not None:
        columns += zip(_NOISE_COLUMNS, points.noise.T, strict=True)
    return columns if points.truth_label is None else [*columns, ("truth_label", points.truth_label)]


def _narrowed(name: str, values: Any) -> list[tuple[str, Any]]:
    """The column in the smallest of a few types that holds its values exactly."""
    if values.dtype == np.float64:
        whole = ((values >= 0) & (values <= 255) & (values == np.floor(values)) & ~np.signbit(values)).all()
        return [(name, values.astype(np.uint8) if whole else values)]
    low, high = values.min(initial=0), values.max(initial=0)
    if low >= -(2**31) and high < 2**31:
        return [(name, values.astype(np.int32))]
    return [(f"{name}_lo", values.astype(np.uint32)), (f"{name}_hi", (values >> 32).astype(np.int32))]


def _rows(octets: bytes) -> Any:
    """Structured array of a cloud's fields; every bound checked, since the octets may be anything."""
    try:
        cloud = PointCloud_pb2.PointCloud.FromString(octets)
    except message.DecodeError as error:
        raise ValueError(f"not a foxglove.PointCloud: {error}") from None
    kinds = [_NUMPY.get(field.type) for field in cloud.fields]
    stride, data = cloud.point_stride, cloud.data
    if None in kinds or stride == 0 or len(data) % stride:
        raise ValueError("the cloud's stride or types make no sense")
    layout: Any = {
        "names": [f.name for f in cloud.fields], "formats": kinds, "offsets": [f.offset for f in cloud.fields],
        "itemsize": stride,
    }  # fmt: skip
    return np.frombuffer(data, np.dtype(layout))  # ValueError where names repeat or an offset is outside
