"""An archive gives back what was written, and equal runs give equal archives."""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
import tracemalloc
from dataclasses import replace
from pathlib import Path

import pytest
from mcap.reader import make_reader

from maritrack.io.archive import input_channels, iter_inputs, iter_messages, iter_results, read_archive
from maritrack.io.messages import OUTPUTS
from maritrack.sinks.mcap import McapSink
from tests import runs

N_SCANS = 7
CHUNK_SCANS = 3


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return runs.archive(
        tmp_path_factory.mktemp("archive") / "run.mcap", [runs.result(k) for k in range(N_SCANS)],
        side={"truth": b"<truth>", "own-ship": b""}, chunk_scans=CHUNK_SCANS,
    )  # fmt: skip


def test_results_come_back_to_the_bit(written: Path) -> None:
    scans = list(iter_results(written))
    assert [scan.k for scan in scans] == list(range(N_SCANS))
    assert [runs.unlike(scan, runs.result(scan.k)) for scan in scans] == [[]] * N_SCANS


def test_a_run_without_anything_in_it_comes_back(tmp_path: Path) -> None:
    empty = runs.result(0, n=0, c=0, t=0, octets=0)
    scans = list(iter_results(runs.archive(tmp_path / "run.mcap", [empty])))
    assert [runs.unlike(scan, empty) for scan in scans] == [[]]


def test_a_run_without_scans_is_a_run(tmp_path: Path) -> None:
    path = runs.archive(tmp_path / "run.mcap", [])
    assert read_archive(path).complete
    assert list(iter_results(path)) == []


def test_inputs_put_together_are_the_input(written: Path) -> None:
    octets = b"".join(octets for k in range(N_SCANS) for _, octets in runs.result(k).frame.inputs)
    assert b"".join(iter_inputs(written, "/input/cat240")) == octets


def test_a_large_input_is_cut_into_messages(tmp_path: Path) -> None:
    octets = bytes(9 << 20)
    item = runs.result(0)
    item = replace(item, frame=replace(item.frame, inputs=(("/input/cat240", octets),)))
    pieces = list(iter_inputs(runs.archive(tmp_path / "run.mcap", [item]), "/input/cat240"))
    assert len(pieces) == 3
    assert b"".join(pieces) == octets


def test_several_inputs_have_channels_of_their_own(tmp_path: Path) -> None:
    manifest = replace(runs.MANIFEST, input_kind=("points", "cat240"), input_sha256=("a", "b"))
    item = runs.result(0)
    inputs = (("/input/points-0", b"{"), ("/input/cat240-1", b"\xf0"), ("/input/points-0", b"}"))
    item = replace(item, frame=replace(item.frame, inputs=inputs))
    path = runs.archive(tmp_path / "run.mcap", [item], manifest=manifest)
    assert input_channels(path) == ("/input/points-0", "/input/cat240-1")
    assert b"".join(iter_inputs(path, "/input/points-0")) == b"{}"
    assert b"".join(iter_inputs(path, "/input/cat240-1")) == b"\xf0"


def test_manifest_configuration_and_documents_come_back(written: Path) -> None:
    read = read_archive(written)
    assert read.manifest == replace(runs.MANIFEST, recording="")
    assert (read.config_toml, read.side) == (runs.MANIFEST.config_toml, {"own-ship": b"", "truth": b"<truth>"})
    assert (read.inputs, read.full, read.points, read.n_scans) == (("/input/cat240",), True, True, N_SCANS)
    assert (read.complete, read.damage) == (True, ())


def test_the_archive_holds_metrics_and_counts_but_no_timings(written: Path) -> None:
    assert read_archive(written).summary == {
        "metrics": {"gospa": 12.5, "ospa": None}, "counts": {"scans": 3, "warnings": {"zlib-error": 1}},
    }  # fmt: skip
    assert b"total_s" not in written.read_bytes()


def test_equal_runs_give_equal_octets(written: Path, tmp_path: Path) -> None:
    manifest = replace(runs.MANIFEST, recording="other name", versions={"mcap": "1", "numpy": "2"})
    again = runs.archive(
        tmp_path / "again.mcap", [runs.result(k) for k in range(N_SCANS)], manifest=manifest,
        side={"own-ship": b"", "truth": b"<truth>"}, chunk_scans=CHUNK_SCANS,
        summary=dict(reversed(runs.SUMMARY.items())) | {"timing": {"total_s": 99.0}},
    )  # fmt: skip
    assert again.read_bytes() == written.read_bytes()


def test_without_the_inputs_their_digests_are_archived(tmp_path: Path) -> None:
    results = [runs.result(k) for k in range(3)]
    path = runs.archive(tmp_path / "run.mcap", results, full=False)
    octets = b"".join(octets for item in results for _, octets in item.frame.inputs)
    read = read_archive(path)
    assert (read.full, read.digests) == (False, {"/input/cat240": (150, hashlib.sha256(octets).hexdigest())})
    assert list(iter_inputs(path, "/input/cat240")) == []


def test_points_can_be_left_out(tmp_path: Path) -> None:
    path = runs.archive(tmp_path / "run.mcap", [runs.result(0)], points=False)
    (scan,) = iter_results(path)
    assert (scan.points, scan.keep, read_archive(path).points) == (None, None, False)
    assert runs.differences(scan.clusters, runs.result(0).clusters) == []


def test_the_clock_of_the_file_never_goes_back(tmp_path: Path) -> None:
    results = [runs.result(1), replace(runs.result(0), frame=replace(runs.result(0).frame, k=2))]
    path = runs.archive(tmp_path / "run.mcap", results)
    assert {message.t_ns for message in iter_messages(path, OUTPUTS)} == {results[0].frame.t_ns}
    assert [scan.t_ns for scan in iter_results(path)] == [item.frame.t_ns for item in results]


def test_the_name_is_given_at_the_end(tmp_path: Path) -> None:
    sink = McapSink(tmp_path / "run.mcap")
    sink.open(runs.MANIFEST)
    sink.write(runs.result(0))
    assert [p.name for p in tmp_path.iterdir()] == ["run.mcap.partial"]
    sink.close(runs.SUMMARY)
    assert [p.name for p in tmp_path.iterdir()] == ["run.mcap"]


def test_an_aborted_run_is_readable_and_not_complete(tmp_path: Path) -> None:
    sink = McapSink(tmp_path / "run.mcap")
    sink.open(runs.MANIFEST)
    sink.write(runs.result(0))
    sink.abort()
    sink.abort()
    read = read_archive(tmp_path / "run.mcap.partial")
    assert (read.complete, read.damage, read.n_scans) == (False, (), 1)
    assert [runs.unlike(scan, runs.result(0)) for scan in iter_results(read.path)] == [[]]


def test_an_interrupted_run_is_not_complete(tmp_path: Path) -> None:
    path = runs.archive(tmp_path / "run.mcap", [], summary=runs.SUMMARY | {"interrupted": True})
    assert not read_archive(path).complete


def test_memory_does_not_grow_with_the_length_of_the_run(tmp_path: Path) -> None:
    def peak(n_scans: int) -> int:
        path = tmp_path / f"{n_scans}.mcap"
        tracemalloc.start()
        runs.archive(path, [], points=True)  # imports and tables
        sink = McapSink(path, chunk_scans=5)
        sink.open(runs.MANIFEST)
        for k in range(n_scans):
            sink.write(runs.result(k, octets=100_000))
        sink.close(runs.SUMMARY)
        for _ in iter_results(path):
            pass
        _, most = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        return most

    assert peak(60) < peak(15) + 400_000


def test_rerun_reads_the_archive(written: Path) -> None:
    rerun = shutil.which("rerun", path=f"{Path(sys.executable).parent}{os.pathsep}{os.environ.get('PATH', '')}")
    if rerun is None:
        pytest.skip("needs the rerun command")
    for verb in ("check", "info"):
        done = subprocess.run([rerun, "mcap", verb, str(written)], capture_output=True, check=False, timeout=60)
        assert done.returncode == 0, done.stderr.decode()


def test_the_mcap_library_reads_the_archive_with_all_checks(written: Path) -> None:
    with written.open("rb") as file:
        topics = [c.topic for _, c, _ in make_reader(file, validate_crcs=True).iter_messages()]
    assert topics.count("/tracks") == N_SCANS
    assert topics[:3] == ["/input/cat240", "/scan", "/points"]
