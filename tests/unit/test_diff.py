"""Two runs are compared frame by frame, or by their summaries."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from maritrack.diff import diff
from maritrack.errors import InputError, UsageError
from maritrack.sinks.summary import write_summary
from maritrack.types import Result, Tracks, take
from tests import runs

N_SCANS = 4


def archived(path: Path, change: Callable[[Result], Result] | None = None, **options: Any) -> Path:
    """An archive whose scan 2 went through `change`."""
    results = [runs.result(k) for k in range(N_SCANS)]
    return runs.archive(path, [change(r) if change and r.frame.k == 2 else r for r in results], **options)


@pytest.fixture(scope="module")
def base(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return archived(tmp_path_factory.mktemp("base") / "run.mcap")


def with_tracks(**columns: Any) -> Callable[[Result], Result]:
    return lambda result: replace(result, tracks=replace(result.tracks, **columns))


def moved(by_m: float) -> Callable[[Result], Result]:
    """The first track's east position changed."""
    shift = np.zeros((4, 2))
    shift[0, 0] = by_m
    return lambda result: with_tracks(position_m=result.tracks.position_m + shift)(result)


def test_equal_runs_do_not_differ(base: Path, tmp_path: Path) -> None:
    found = diff(base, archived(tmp_path / "run.mcap"))
    assert (found.equal, found.differences, found.metrics, found.manifest, found.n_scans) == (True, (), {}, (), N_SCANS)


def test_a_moved_track_is_named_with_its_scan(base: Path, tmp_path: Path) -> None:
    (only,) = diff(base, archived(tmp_path / "run.mcap", moved(1e-9))).differences
    assert (only.where, only.k, only.what) == ("tracks", 2, "id 5: position_m")
    assert only.b[0] - only.a[0] == pytest.approx(1e-9, abs=1e-12)


def test_a_tolerance_forgives_small_numbers_and_no_more(base: Path, tmp_path: Path) -> None:
    other = archived(tmp_path / "run.mcap", moved(1e-3))
    assert diff(base, other, atol=2e-3).equal
    assert not diff(base, other, atol=5e-4).equal
    assert diff(base, other, rtol=1e-2).equal


@pytest.mark.parametrize("column", ["status", "moving", "cluster", "t_ns"])
def test_what_is_no_measurement_has_no_tolerance(base: Path, tmp_path: Path, column: str) -> None:
    def change(result: Result) -> Result:
        values = getattr(result.tracks, column).copy()
        values[1] = not values[1] if column == "moving" else values[1] + 1
        return with_tracks(**{column: values})(result)

    (only,) = diff(base, archived(tmp_path / "run.mcap", change), rtol=1.0, atol=1e9).differences
    assert only.what == f"id 7: {column}"


def test_tracks_are_matched_by_id_not_by_row(base: Path, tmp_path: Path) -> None:
    def without_the_first(result: Result) -> Result:
        return replace(result, tracks=take(result.tracks, np.array([1, 2, 3])))

    found = diff(base, archived(tmp_path / "run.mcap", without_the_first))
    assert [(d.what, d.a, d.b) for d in found.differences] == [("count", 4, 3), ("id 5", "present", None)]


def test_contours_are_compared(tmp_path: Path) -> None:
    contours = tuple(np.full((n, 2), 1.0) for n in (3, 3, 0, 4))
    other = (contours[0] + 1e-6, *contours[1:])
    a = archived(tmp_path / "a.mcap", with_tracks(contour_m=contours))
    b = archived(tmp_path / "b.mcap", with_tracks(contour_m=other))
    assert [d.what for d in diff(a, b).differences] == ["id 5: contour_m"]
    assert diff(a, b, atol=1e-5).equal


def in_points(result: Result) -> Result:
    return replace(result, points=replace(result.points, intensity=result.points.intensity + np.eye(12)[3]))


def in_clusters(result: Result) -> Result:
    return replace(result, clusters=replace(result.clusters, count=result.clusters.count + np.array([0, 1, 0])))


def in_labels(result: Result) -> Result:
    label = result.clusters.label.copy()
    label[0] += 1
    return replace(result, clusters=replace(result.clusters, label=label))


def in_truth(result: Result) -> Result:
    truth = replace(result.frame.truth, name=("ÆRØ", "x")) if result.frame.truth else None
    return replace(result, frame=replace(result.frame, truth=truth))


def in_scan(result: Result) -> Result:
    return replace(result, frame=replace(result.frame, scan=replace(result.frame.scan, segment=9)))


def in_scores(result: Result) -> Result:
    return replace(result, scores={**result.scores, "gospa": 1.0})


@pytest.mark.parametrize(
    ("change", "where", "what"),
    [
        (in_points, "points", "intensity[3]"), (in_clusters, "clusters", "count[1]"),
        (in_labels, "clusters", "label[0]"), (in_truth, "truth", "id 219000002: name"),
        (in_scan, "scan", "segment"), (in_scores, "scores", "gospa"),
    ],
)  # fmt: skip
def test_a_change_is_found_where_it_is(
    base: Path, tmp_path: Path, change: Callable[[Result], Result], where: str, what: str
) -> None:
    found = diff(base, archived(tmp_path / "run.mcap", change))
    assert [(d.where, d.k, d.what) for d in found.differences] == [(where, 2, what)]
    assert diff(base, archived(tmp_path / "run.mcap", change), only="tracks").equal


def test_the_first_frame_comes_first_and_the_list_ends(base: Path, tmp_path: Path) -> None:
    other = runs.archive(tmp_path / "run.mcap", [runs.result(k, seed=int(k > 0)) for k in range(N_SCANS)])
    found = diff(base, other, limit=5)
    assert (len(found.differences), found.differences[0].k) == (5, 1)
    assert found.count > 20


def test_scans_of_one_run_only_are_named(base: Path, tmp_path: Path) -> None:
    shorter = runs.archive(tmp_path / "run.mcap", [runs.result(k) for k in (0, 1, 3)])
    found = diff(base, shorter)
    assert [tuple(d) for d in found.differences] == [("scan", 2, "present", True, False)]


def test_changed_metrics_and_counts_are_told_and_timings_are_not(base: Path, tmp_path: Path) -> None:
    summary = {
        "metrics": {"gospa": 12.75, "ospa": None}, "counts": {"scans": 3, "warnings": {"gap": 1}},
        "timing": {"total_s": 9.0}, "outputs": {},
    }  # fmt: skip
    found = diff(base, archived(tmp_path / "run.mcap", summary=summary))
    assert found.metrics == {"gospa": (12.5, 12.75)}
    assert {d.what: (d.a, d.b) for d in found.differences if d.where == "counts"} == {
        "warnings.gap": (None, 1), "warnings.zlib-error": (1, None),
    }  # fmt: skip
    assert diff(base, archived(tmp_path / "run.mcap", summary=summary), only="metrics", rtol=0.1).equal


def test_a_summary_is_compared_with_an_archive_by_its_metrics(base: Path, tmp_path: Path) -> None:
    write_summary(tmp_path / "summary.json", runs.SUMMARY | {"metrics": {"gospa": 12.5}})
    assert diff(base, tmp_path / "summary.json").equal
    write_summary(tmp_path / "summary.json", runs.SUMMARY | {"metrics": {"gospa": 12.6}})
    assert diff(tmp_path / "summary.json", base).metrics == {"gospa": (12.6, 12.5)}
    with pytest.raises(UsageError, match="no tracks"):
        diff(tmp_path / "summary.json", base, only="tracks")


def test_a_folder_stands_for_the_run_in_it(base: Path, tmp_path: Path) -> None:
    archived(tmp_path / "run.mcap", moved(1.0))
    assert diff(base.parent, tmp_path).count == 1
    (tmp_path / "run.mcap").rename(tmp_path / "other")
    with pytest.raises(InputError, match="no run"):
        diff(base, tmp_path)


def test_the_manifest_says_why_and_does_not_count(base: Path, tmp_path: Path) -> None:
    manifest = replace(runs.MANIFEST, tracker="ipda", config_toml='seed = 4\nname = "æ"\n', seed=4)
    found = diff(base, archived(tmp_path / "run.mcap", manifest=manifest))
    assert found.equal
    assert {d.what: (d.a, d.b) for d in found.manifest} == {
        "config.seed": (3, 4), "seed": ("3", "4"), "tracker": ("jipda", "ipda"),
    }  # fmt: skip


def test_damage_is_a_difference(base: Path, tmp_path: Path) -> None:
    octets = bytearray(base.read_bytes())
    octets[len(octets) // 2] ^= 1
    (tmp_path / "run.mcap").write_bytes(octets)
    assert "archive" in {d.where for d in diff(base, tmp_path / "run.mcap").differences}


@pytest.mark.parametrize("text", ["", "[]", "{}", "[" * 100_000, "\x00"], ids=len)
def test_what_is_neither_archive_nor_summary_is_an_input_error(base: Path, tmp_path: Path, text: str) -> None:
    (tmp_path / "x.json").write_text(text)
    with pytest.raises(InputError, match=r"x\.json"):
        diff(base, tmp_path / "x.json")


def test_a_summary_is_the_same_octets_for_the_same_numbers(tmp_path: Path) -> None:
    write_summary(tmp_path / "a.json", {"metrics": {"b": np.float64(0.1), "a": np.nan}, "counts": {"n": np.int64(2)}})
    write_summary(tmp_path / "b.json", {"counts": {"n": 2}, "metrics": {"a": float("inf"), "b": 0.1}})
    assert (tmp_path / "a.json").read_bytes() == (tmp_path / "b.json").read_bytes()
    assert json.loads((tmp_path / "a.json").read_text()) == {"counts": {"n": 2}, "metrics": {"a": None, "b": 0.1}}
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.json", "b.json"]


def test_tracks_without_rows_are_equal(tmp_path: Path) -> None:
    def none(result: Result) -> Result:
        tracks: Tracks = take(result.tracks, np.zeros(0, np.int64))
        return replace(result, tracks=tracks)

    assert diff(archived(tmp_path / "a.mcap", none), archived(tmp_path / "b.mcap", none)).equal
