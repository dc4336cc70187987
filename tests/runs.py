"""Small made-up runs: results of every shape, and archives of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from maritrack.io.archive import ArchivedScan
from maritrack.simulate.record import simulate
from maritrack.simulate.scenes import load_scene
from maritrack.sinks.mcap import McapSink
from maritrack.types import Clusters, Event, Frame, Origin, Points, Result, RunManifest, Scan, Sensor, Tracks, Truth

TURN_NS = 2_500_000_000
T0_NS = 1_700_000_000_123_456_789
MANIFEST = RunManifest(
    run_id="r" * 64, tracker="jipda", preset="radar", code_sha256="c" * 64, config_toml='seed = 3\nname = "æ"\n',
    input_sha256=("d" * 64,), input_kind=("cat240",), seed=3, versions={"numpy": "2", "mcap": "1"},
    origin=Origin(50.75, -1.25), recording="harbour",
)  # fmt: skip
SUMMARY = {
    "metrics": {"gospa": 12.5, "ospa": float("nan")}, "counts": {"scans": 3, "warnings": {"zlib-error": 1}},
    "timing": {"total_s": 1.5}, "outputs": {"mcap": "somewhere"},
}  # fmt: skip


def harbour(folder: Path, *, spokes: int, cells: int, scans: int) -> Path:
    """A recording of the harbour with few spokes and cells."""
    scene = load_scene("harbour")
    path = folder / "harbour.cat240"
    small = replace(scene, radar=replace(scene.radar, spokes=spokes, cells=cells))
    simulate(small, path, seed=3, scans=scans, ais=False, labels=False)
    return path


def result(k: int, *, n: int = 12, c: int = 3, t: int = 4, seed: int = 0, octets: int = 50) -> Result:
    """A result of scan k; the same arguments give the same values."""
    rng = np.random.default_rng([seed, k])
    t_ns = T0_NS + k * TURN_NS
    keep = rng.random(n) < 0.8
    scan = Scan(
        Sensor("7-42", 7.5, 2 * np.pi / 4096, 9000.0), t_ns, t_ns - TURN_NS, np.array([1.5, -2.0 * k]), float("nan"),
        segment=k // 10, swept=None if k % 2 else rng.random(720) < 0.9,
    )  # fmt: skip
    frame = Frame(k, scan, truth(t_ns, rng) if k % 3 else None, (("/input/cat240", rng.bytes(octets)),))
    return Result(
        frame, points(t_ns, rng, n), keep, clusters(t_ns, rng, c, int(keep.sum())), tracks(t_ns, rng, t),
        {"ospa": rng.random(), "gospa": float("nan") if k == 1 else rng.random()},
        (Event("info", "track", f"scan {k}"), Event("warning", "ingest", "a gap"))[: k % 3], {"detect": rng.random()},
    )  # fmt: skip


def points(t_ns: int, rng: np.random.Generator, n: int) -> Points:
    azimuth = np.sort(rng.integers(0, 4096, n))
    azimuth_rad = np.asarray((azimuth + 0.5) * 2 * np.pi / 4096, np.float64)
    range_m = np.asarray(3.0 + 7.5 * rng.integers(0, 1000, n), np.float64)
    position_m = np.stack([range_m * np.sin(azimuth_rad), range_m * np.cos(azimuth_rad)], axis=-1)
    return Points(
        range_m, azimuth_rad, position_m, rng.integers(128, 256, n).astype(float),
        t_ns - TURN_NS + azimuth * 610_351, np.full(n, 7.5), np.full(n, 2 * np.pi / 4096),
    )  # fmt: skip


def clusters(t_ns: int, rng: np.random.Generator, c: int, n: int) -> Clusters:
    scatter = rng.normal(size=(c, 2, 2))
    return Clusters(
        1e3 * rng.normal(size=(c, 2)), 100 * scatter @ scatter.transpose(0, 2, 1), rng.integers(1, 50, c),
        rng.random(c), rng.normal(size=(c, 2, 2)), t_ns - rng.integers(0, TURN_NS, c),
        1e3 * rng.random(c), rng.random(c), rng.random(c), rng.integers(-1, max(c, 1), n),
    )  # fmt: skip


def tracks(t_ns: int, rng: np.random.Generator, t: int) -> Tracks:
    cov = rng.normal(size=(t, 4, 4))
    return Tracks(
        np.arange(t) * 2 + 5, t_ns - rng.integers(0, TURN_NS, t), 1e3 * rng.normal(size=(t, 2)),
        3 * rng.normal(size=(t, 2)), cov @ cov.transpose(0, 2, 1), np.tile(np.diag([900.0, 100.0]), (t, 1, 1)),
        rng.random(t), rng.integers(0, 4, t), rng.random(t) < 0.5, rng.integers(-1, 3, t),
    )  # fmt: skip


def truth(t_ns: int, rng: np.random.Generator) -> Truth:
    unknown = np.full(2, np.nan)
    return Truth(
        ("219000001", "219000002"), ("ÆRØ", ""), t_ns, rng.normal(size=(2, 2)), rng.normal(size=(2, 2)), unknown,
        unknown, np.array([120.0, np.nan]),
    )  # fmt: skip


def archive(
    path: Path,
    results: list[Result],
    *,
    manifest: RunManifest = MANIFEST,
    summary: Mapping[str, Any] = SUMMARY,
    **options: Any,
) -> Path:
    """The archive of a run that has ended."""
    sink = McapSink(path, **options)
    sink.open(manifest)
    for item in results:
        sink.write(item)
    sink.close(summary)
    return path


def differences(a: Any, b: Any) -> list[str]:
    """Fields in which two values are not the same to the bit, in type or in shape."""
    return [f.name for f in fields(a) if not _same(getattr(a, f.name), getattr(b, f.name))]


def _same(x: Any, y: Any) -> bool:
    if isinstance(x, np.ndarray):
        return isinstance(y, np.ndarray) and (x.dtype, x.shape, x.tobytes()) == (y.dtype, y.shape, y.tobytes())
    if isinstance(x, tuple) and x and isinstance(x[0], np.ndarray):
        return len(x) == len(y) and all(map(_same, x, y))
    if isinstance(x, float):
        return type(y) is float and np.float64(x).tobytes() == np.float64(y).tobytes()
    return type(x) is type(y) and x == y


def unlike(archived: ArchivedScan, result: Result) -> list[str]:
    """Parts in which an archived scan is not the result to the bit."""
    assert archived.points is not None and archived.keep is not None
    found = differences(result.points, archived.points)
    found += differences(result.clusters, archived.clusters) + differences(result.tracks, archived.tracks)
    found += [f for f in differences(result.frame.scan, archived.scan) if f != "sensor"]
    found += differences(result.frame.scan.sensor, archived.scan.sensor)
    if result.frame.truth is None or archived.truth is None:
        found += ["truth"] * (result.frame.truth is not archived.truth)
    else:
        found += differences(result.frame.truth, archived.truth)
    rest = (archived.k, archived.t_ns, archived.events, repr(archived.scores))
    same = rest == (result.frame.k, result.frame.t_ns, result.events, repr(dict(sorted(result.scores.items()))))
    return found + ["keep"] * (not np.array_equal(result.keep, archived.keep)) + ["rest"] * (not same)
