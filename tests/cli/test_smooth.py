"""`maritrack smooth`: offline tracks as an archive like any other."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from maritrack.io.archive import iter_inputs, iter_results, read_archive
from maritrack.sinks.mcap import McapSink
from tests.cli.calling import call
from tests.io.test_archive_damage import chunks_of
from tests.shared import shared

SCANS = 30
AUTOFERRY = (2, 3, 4, 13, 17)


@pytest.fixture(scope="module")
def causal(sample: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a run that is long enough for tracks to be judged. Not to be written to."""
    folder = tmp_path_factory.mktemp("causal") / "run"
    assert call("process", sample, "--limit", str(SCANS), "--no-rrd", "-o", folder, "-q").code == 0
    return folder


@pytest.fixture(scope="module")
def offline(causal: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Its offline tracks. Not to be written to."""
    folder = tmp_path_factory.mktemp("offline") / "run"
    done = call("smooth", causal, "-o", folder)
    assert done.code == 0 and "jipda (radar), offline: " in done.out, done.err
    return folder


def test_the_archive_says_that_its_tracks_are_offline_and_of_which_run(causal: Path, offline: Path) -> None:
    old, new = (read_archive(folder / "run.mcap").manifest for folder in (causal, offline))
    assert new.smoothed_from == old.run_id and old.smoothed_from == "" and new.run_id != old.run_id
    summary = json.loads((offline / "summary.json").read_text())
    assert summary["offline"] and summary["smoothed_from"] == old.run_id and summary["metrics"]["gospa"] > 0
    assert not json.loads((causal / "summary.json").read_text())["offline"]
    shown = call("show", offline, "--json").json
    assert shown["offline"] and shown["smoothed_from"] == old.run_id and shown["complete"]
    assert call("show", causal, "--json").json["smoothed_from"] is None


def test_all_but_the_tracks_is_what_it_was(causal: Path, offline: Path) -> None:
    for a, b in zip(*(iter_results(folder / "run.mcap") for folder in (causal, offline)), strict=True):
        assert a.points is not None and b.points is not None
        assert (a.k, a.t_ns, a.n_spokes) == (b.k, b.t_ns, b.n_spokes)
        assert np.array_equal(a.points.position_m, b.points.position_m) and np.array_equal(a.keep, b.keep)
        assert np.array_equal(a.clusters.mean_m, b.clusters.mean_m)
        assert a.truth is not None and b.truth is not None
        assert np.array_equal(a.truth.position_m, b.truth.position_m)
    octets = [b"".join(iter_inputs(folder / "run.mcap", "/input/cat240")) for folder in (causal, offline)]
    assert octets[0] == octets[1] and len(octets[0]) > 100_000


def test_tracks_begin_with_their_first_hit_and_end_with_their_last(causal: Path, offline: Path) -> None:
    hits: dict[int, list[int]] = {}
    for scan in iter_results(causal / "run.mcap"):
        for i in scan.tracks.id[scan.tracks.cluster >= 0].tolist():
            hits.setdefault(i, []).append(scan.k)
    lives: dict[int, list[int]] = {}
    for scan in iter_results(offline / "run.mcap"):
        assert (np.diff(scan.tracks.id) > 0).all()
        for i in scan.tracks.id.tolist():
            lives.setdefault(i, []).append(scan.k)
    assert len(lives) > 5
    for i, life in lives.items():
        assert life == list(range(hits[i][0], hits[i][-1] + 1))


def test_it_is_scored_exported_and_compared_like_any_run(causal: Path, offline: Path, tmp_path: Path) -> None:
    summary = json.loads((offline / "summary.json").read_text())
    assert call("score", offline, "--json").json["metrics"] == summary["metrics"]
    was = json.loads((causal / "summary.json").read_text())["metrics"]
    assert was["npv"] > 0 and {name: summary["metrics"][name] for name in ("fpr", "npv")}.items() <= was.items()
    assert call("diff", offline, offline).code == 0
    different = call("diff", causal, offline, "--only", "metrics", "--json")
    assert different.code == 1 and different.json["metrics"]["gospa"]["b"] == summary["metrics"]["gospa"]
    table = tmp_path / "tracks.csv"
    assert call("export", offline / "run.mcap", "--tracks", table).code == 0
    rows = table.read_text().splitlines()
    assert len(rows) - 1 == summary["counts"]["tracks"] > 0
    assert (offline / "run.rrd").stat().st_size > 100_000


def test_smoothed_again_it_is_the_same_octet_by_octet(causal: Path, offline: Path, tmp_path: Path) -> None:
    assert call("smooth", causal, "-o", tmp_path, "--no-rrd", "-q").code == 0
    assert (tmp_path / "run.mcap").read_bytes() == (offline / "run.mcap").read_bytes()
    again = call("smooth", causal, "-o", tmp_path, "--no-rrd")
    assert "equal tracks are here already" in again.err


def test_it_is_no_run_to_replay_or_to_smooth(offline: Path, causal: Path, tmp_path: Path) -> None:
    id_ = read_archive(causal / "run.mcap").manifest.run_id[:8]
    for command in ("replay", "smooth"):
        done = call(command, offline, "-o", tmp_path / "x")
        assert done.code == 2 and done.error.endswith(
            f"offline tracks, smoothed from run {id_}, not a run of their own"
        )


def test_settings_of_the_judgement_may_change_and_others_may_not(causal: Path, tmp_path: Path) -> None:
    quiet = ("-q", "--no-rrd", "--no-mcap", "--json", "-o", tmp_path)
    few = call("smooth", causal, "--set", "smooth.min_hits=25", *quiet).json
    many = call("smooth", causal, "--set", "smooth.min_hits=4", *quiet).json
    assert 0 < few["counts"]["track_ids_confirmed"] < many["counts"]["track_ids_confirmed"]
    near = call("smooth", causal, "--set", "score.c_m=20.0", *quiet).json
    assert near["score"]["c_m"] == 20.0
    done = call("smooth", causal, "--set", "model.p_detect=0.5", *quiet)
    assert done.code == 2 and "only smooth.* and score.* can change" in done.error
    done = call("smooth", causal, "--set", "smooth.min_hits=0", *quiet)
    assert done.code == 2 and done.error == "smooth.min_hits starts at 1"
    done = call("smooth", causal, "-o", causal)
    assert done.code == 2 and "the archive that is read lies there" in done.error


def test_an_archive_of_digests_takes_the_recording_beside_it(sample: Path, tmp_path: Path) -> None:
    run, out = tmp_path / "run", tmp_path / "out"
    hashed = ("--set", 'output.archive="hash"', "--set", "output.archive_points=false")
    call("process", sample, "--limit", "8", "--no-rrd", "-q", "-o", run, *hashed)
    done = call("smooth", run, "-o", out, "--no-rrd")
    assert done.code == 2 and "only the digest of the recording is archived" in done.error
    done = call("smooth", run, "--input", sample, "-o", out, "--set", "smooth.min_hits=3", "--json", "-q")
    assert done.code == 0 and done.json["counts"]["tracks"] > 0
    archive = read_archive(out / "run.mcap")
    assert not archive.full and not archive.points and archive.complete


def test_a_run_that_broke_off_is_smoothed_as_far_as_it_goes(
    sample: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write = McapSink.write

    def breaks_off(self: McapSink, result: object) -> None:
        if getattr(result, "frame").k == 9:  # noqa: B009
            raise OSError(28, "No space left on device")
        write(self, result)  # type: ignore[arg-type]

    with monkeypatch.context() as patch:
        patch.setattr(McapSink, "write", breaks_off)
        assert call("process", sample, "--no-rrd", "-q", "-o", tmp_path / "run").code == 2
    out = tmp_path / "out"
    done = call("smooth", tmp_path / "run", "-o", out, "--no-rrd", "--set", "smooth.min_hits=3", "--json")
    assert done.code == 0 and "9 scans are archived" in done.err, done.err
    assert done.json["counts"]["scans"] == 9 and done.json["counts"]["tracks"] > 0
    assert read_archive(out / "run.mcap").complete


def test_a_run_that_was_killed_is_smoothed_up_to_its_last_whole_chunk(sample: Path, tmp_path: Path) -> None:
    whole, killed, out = (tmp_path / name for name in ("whole", "killed", "out"))
    chunks = ("--set", "output.chunk_scans=6")
    assert call("process", sample, "--limit", "20", "--no-rrd", "-q", "-o", whole, *chunks).code == 0
    octets = (whole / "run.mcap").read_bytes()
    begin, end = chunks_of(octets)[2]
    killed.mkdir()
    (killed / "run.mcap.partial").write_bytes(octets[: (begin + end) // 2])
    done = call("smooth", killed, "-o", out, "--no-rrd", "--set", "smooth.min_hits=3", "--json")
    assert done.code == 0 and "12 scans are archived, at most 6 after them are lost" in done.err, done.err
    assert done.json["counts"]["scans"] == 12 and done.json["counts"]["tracks"] > 0
    assert read_archive(out / "run.mcap").complete and not list(out.glob("*.partial"))


def test_autoferry_offline_tracks_of_one_set_of_parameters(tmp_path: Path) -> None:
    gospa = []
    for scenario in AUTOFERRY:
        recording = shared(f"data/autoferry/scenario{scenario}/scenario{scenario}_detections.json")
        call("process", recording, "--no-rrd", "-q", "-o", tmp_path / f"{scenario}")
        done = call("smooth", tmp_path / f"{scenario}", "--no-rrd", "--json", "-q", "-o", tmp_path / f"off{scenario}")
        gospa.append(done.json["metrics"]["gospa"])
    assert np.mean(gospa) <= 11.5 and max(gospa) < 17.0, gospa
