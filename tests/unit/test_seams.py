"""Segments of a recording and their seams: who is who, and what a joined run holds."""

from __future__ import annotations

import itertools
import json
import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from maritrack.diff import diff
from maritrack.io.archive import ArchivedScan, iter_results, read_archive
from maritrack.job import Job, execute
from maritrack.score import score
from maritrack.sweep import batch as batches
from maritrack.sweep.batch import Cut, batch
from maritrack.sweep.joining import renamed
from maritrack.sweep.places import Index, index
from maritrack.sweep.plan import Run, Settings, plan
from maritrack.sweep.seams import Names, Tail, match
from maritrack.sweep.segments import overlap_of, split
from maritrack.sweep.sources import named, opened
from maritrack.sweep.store import read_row
from maritrack.types import CONFIRMED, Tracks
from tests import runs

SCANS, CUT = 48, Cut(segment_s=45.0, overlap_s=37.5, run_on_s=0.0)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The harbour with few spokes, two minutes long."""
    return runs.harbour(tmp_path_factory.mktemp("rec"), spokes=256, cells=300, scans=SCANS)


def planned(path: Path | str) -> list[Run]:
    """The run of the recording, with short memories."""
    sets = ("subtract.method='none'", "tracker.moving_time_constant_s=10.0", "clutter_map.memory_s=10.0",
            "output.archive='hash'")  # fmt: skip
    return plan(named([str(path)]), axes={}, seeds=(), settings=Settings(sets=sets, over={}))


@pytest.fixture(scope="module")
def whole(recording: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The run in one piece."""
    (run,), folder = planned(recording), tmp_path_factory.mktemp("whole")
    assert run.config is not None
    with opened(run.source, seed=0) as found:
        execute(Job(octets=[found.octets], kinds=[found.kind], input_sha256=[run.input_sha256], side=found.side,
                    config=run.config, name="harbour", out=folder, rrd=False))  # fmt: skip
    return folder


@pytest.fixture(scope="module")
def joined(recording: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The run in three segments; the folder of the batch."""
    folder = tmp_path_factory.mktemp("joined")
    batch(planned(recording), folder, CUT, sizes={str(recording): 1 << 30})
    return folder


def archive(folder: Path) -> Path:
    (path,) = folder.glob("runs/*/run.mcap")
    return path


def test_tracks_keep_their_ids_over_the_seams(joined: Path, whole: Path) -> None:
    told = json.loads((archive(joined).parent / "summary.json").read_text())["segments"]
    assert len(told["seams"]) == 2 and told["tracks_at_seams"] > 20
    assert told["tracks_kept"] >= told["tracks_at_seams"] - 1  # an echo of land; the overlap is short here
    ours, theirs = ({s.k: s for s in iter_results(path)} for path in (archive(joined), whole / "run.mcap"))
    for seam in told["seams"]:
        at = seam["scan"]
        both = np.intersect1d(held(theirs[at - 1]), held(theirs[at]))
        assert len(both) >= 4
        before, behind = (nearest(both, theirs[k].tracks, ours[k].tracks) for k in (at - 1, at))
        assert np.array_equal(before, behind)


def held(scan: ArchivedScan) -> np.ndarray:
    """Ids of confirmed tracks of the true objects."""
    assert scan.truth is not None
    gap = np.linalg.norm(scan.tracks.position_m[:, None] - scan.truth.position_m[None], axis=2)
    return scan.tracks.id[(scan.tracks.status >= CONFIRMED) & (gap.min(axis=1) < 60.0)]


def nearest(ids: np.ndarray, a: Tracks, b: Tracks) -> np.ndarray:
    """Ids in b of the tracks of a that are called so, by their places."""
    places = a.position_m[np.searchsorted(a.id, ids)]
    return b.id[np.linalg.norm(places[:, None] - b.position_m[None], axis=2).argmin(axis=1)]


def test_before_the_first_seam_nothing_differs(joined: Path, whole: Path) -> None:
    found = diff(whole / "run.mcap", archive(joined), limit=1)
    first = json.loads((archive(joined).parent / "summary.json").read_text())["segments"]["seams"][0]["scan"]
    assert found.n_scans == SCANS and (found.equal or found.differences[0].k >= first)


def test_scans_points_and_truth_are_those_of_the_whole_run_everywhere(joined: Path, whole: Path) -> None:
    found = diff(whole / "run.mcap", archive(joined), limit=1)
    assert found.parts["scan"].n == found.parts["truth"].n == found.parts["archive"].n == 0
    for a, b in zip(iter_results(whole / "run.mcap"), iter_results(archive(joined)), strict=True):
        assert a.points is not None and b.points is not None and runs.differences(a.points, b.points) == []


def test_the_summary_is_made_of_the_scans_that_count(joined: Path, whole: Path) -> None:
    ours, theirs = (json.loads((f / "summary.json").read_text()) for f in (archive(joined).parent, whole))
    assert ours["counts"]["scans"] == SCANS and ours["counts"]["points"] == theirs["counts"]["points"]
    assert ours["counts"]["warnings"] == theirs["counts"]["warnings"]
    assert ours["metrics"]["gospa"] == pytest.approx(theirs["metrics"]["gospa"], rel=0.05)
    assert ours["run_id"] != theirs["run_id"] and "3 segments" in read_archive(archive(joined)).manifest.joined
    row = read_row(joined, ours["run_id"])
    assert row is not None and row["counts"]["segments"] == 3 and row["metrics"]["gospa"] == ours["metrics"]["gospa"]


def test_workers_and_interruptions_change_no_octet_of_a_joined_run(
    recording: Path, joined: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cut, sizes = CUT, {str(recording): 1 << 30}
    monkeypatch.setattr(batches, "join", lambda _: (_ for _ in ()).throw(KeyboardInterrupt()))
    with pytest.raises(KeyboardInterrupt):
        batch(planned(recording), tmp_path, cut, sizes=sizes, workers=2)
    monkeypatch.undo()
    monkeypatch.setattr(batches, "run_segment", lambda _: pytest.fail("a finished segment runs again"))
    outcome = batch(planned(recording), tmp_path, cut, sizes=sizes)
    assert archive(tmp_path).read_bytes() == archive(joined).read_bytes() and not outcome.failed
    assert batch(planned(recording), tmp_path, cut, sizes=sizes).reused == 1
    assert not any((tmp_path / "segments").iterdir())


def test_recordings_that_can_not_be_read_from_the_middle_give_the_same(
    recording: Path, joined: Path, tmp_path: Path
) -> None:
    """Of what is compressed all before a segment is read again."""
    import gzip

    packed = tmp_path / "harbour.cat240.gz"
    packed.write_bytes(gzip.compress(recording.read_bytes(), mtime=0))
    recording.with_name("harbour.truth.json").rename(tmp_path / "harbour.truth.json")
    try:
        batch(planned(packed), tmp_path / "out", CUT, sizes={str(packed): 1 << 30})
    finally:
        (tmp_path / "harbour.truth.json").rename(recording.with_name("harbour.truth.json"))
    found = diff(archive(joined), archive(tmp_path / "out"))
    assert found.equal


def test_short_recordings_are_runs_of_a_sweep(recording: Path, tmp_path: Path) -> None:
    found = batch(planned(recording), tmp_path, CUT, sizes={})
    assert [row["run_id"] for row in found.rows] == [planned(recording)[0].run_id]
    longer = batch(planned(recording), tmp_path, Cut(segment_s=1e6), sizes={str(recording): 1 << 30})
    assert longer.reused == 1


def test_a_window_of_a_recording_is_not_split(recording: Path) -> None:
    (run,) = planned(recording)
    assert run.config is not None
    part = replace(run, config=replace(run.config, input=replace(run.config.input, limit=3)))
    assert isinstance(index(part), str)


@pytest.mark.parametrize("where", ["index", "segment", "join"])
def test_whatever_a_recording_fails_with_is_a_row(
    where: str, recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object, **__: object) -> None:
        raise zlib.error("as of a library")

    name = {"index": "places.open_recording", "segment": "segments.run", "join": "joining.seams"}[where]
    monkeypatch.setattr(f"maritrack.sweep.{name}", broken)
    found = batch(planned(recording), tmp_path, CUT, sizes={str(recording): 1 << 30})
    if where == "index":  # and so it is run in one piece
        assert [row["error"] for row in found.rows] == [""]
    else:
        assert [row["error"] for row in found.rows] == ["error: as of a library"] and len(found.failed) == 1


def test_segments_cover_all_scans_once_and_begin_before_they_count() -> None:
    t = np.arange(0, 7200, 2.5)
    n = np.arange(len(t))
    segments = split(Index((t * 1e9).astype(np.int64), 100 * n, 0 * n), segment_s=1800.0, overlap_s=600.0)
    assert [(s.begin, s.end) for s in segments] == [(0, 720), (720, 1440), (1440, 2160), (2160, 2880)]
    assert [s.first for s in segments] == [0, 480, 1200, 1920]
    assert all(a.end == b.begin for a, b in itertools.pairwise(segments))
    assert (segments[1].start.octet, segments[1].seam.octet, segments[0].start.octet) == (47900, 71900, 0)
    tiny = split(Index((t * 1e9).astype(np.int64), 100 * n, 0 * n), segment_s=1e-300, overlap_s=1e300)
    assert [(s.begin, s.end) for s in tiny] == list(
        itertools.pairwise(range(len(t) + 1))
    )  # no more than there are scans
    assert all(s.first == 0 for s in tiny)
    none = np.zeros(0, np.int64)
    assert len(split(Index(none, none, none), segment_s=1.0, overlap_s=0.0)) == 0


def tracks(ids: list[int], east_m: list[float]) -> Tracks:
    """Confirmed tracks on a line."""
    some = runs.tracks(0, np.random.default_rng(0), len(ids))
    position = np.stack([np.array(east_m, float), np.zeros(len(ids))], axis=1)
    status = np.full(len(ids), CONFIRMED)
    return replace(some, id=np.array(ids, np.int64), position_m=position, status=status)


def test_the_same_places_are_the_same_track_whoever_is_near() -> None:
    before = Tail({8: tracks([3, 7, 9], [0, 30, 500]), 9: tracks([3, 7, 9], [10, 40, 500])}, 9)
    behind = Tail({8: tracks([1, 2, 4], [29, 1, 900]), 9: tracks([1, 2, 4], [39, 11, 900])}, 4)
    seam = match(before, behind, 10)
    assert seam.pairs == {1: 7, 2: 3}  # 3 is nearer to 1 than the limit, but both have a partner that is nearer
    assert (seam.before, seam.joined, seam.ended, seam.begun) == (3, 2, 1, 1) and seam.apart_m == pytest.approx(1.0)


def test_a_track_that_was_only_passed_is_not_taken() -> None:
    before = Tail({k: tracks([1], [30.0 * k]) for k in range(10)}, 1)
    behind = Tail({k: tracks([5], [30.0 * (18 - k)]) for k in range(10)}, 5)  # meets it in the last scan, going back
    assert match(before, behind, 10).pairs == {}


def test_names_go_on_from_the_seam() -> None:
    names = Names({2: 17, 5: 40}, frozenset(), top=6, shift=100)
    assert [names.of(i) for i in (2, 5, 7, 9)] == [17, 40, 107, 109] and names.of(6) == 0


def test_a_track_that_was_confirmed_stays_so() -> None:
    behind = replace(tracks([2, 5, 7], [0, 1, 2]), status=np.array([0, 0, 0]), cluster=np.array([3, 4, 5]))
    found = renamed(behind, Names({2: 40, 5: 17}, frozenset({17}), top=6, shift=100))
    assert found.id.tolist() == [17, 40, 107] and found.status.tolist() == [CONFIRMED, 0, 0]
    assert found.position_m[:, 0].tolist() == [1.0, 0.0, 2.0]


def test_scores_of_a_joined_run_are_those_of_its_tracks(joined: Path) -> None:
    again, _ = score(archive(joined))
    told = json.loads((archive(joined).parent / "summary.json").read_text())
    assert again["metrics"] == pytest.approx(told["metrics"])
    rows = [[(o["id"], o["held"], o["switches"]) for o in document["objects"]] for document in (again, told)]
    assert rows[0] == rows[1] and rows[0]


def test_the_overlap_follows_from_the_memories() -> None:
    run = plan(named(["harbour"]), axes={}, seeds=(), settings=Settings(over={}))[0]
    assert overlap_of(run) == pytest.approx(3 * 69 * 2.5 + 300.0)
    plain = plan(named(["harbour"]), axes={}, seeds=(), settings=Settings(preset="polar", over={}))[0]
    assert overlap_of(plain) == 3 * 50.0
