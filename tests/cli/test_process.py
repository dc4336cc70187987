"""`maritrack process`: outputs, reuse, and what is wrong with an input in one line."""

from __future__ import annotations

import json
import os
import resource
import shutil
import signal
import subprocess
import threading
import time
from functools import partial
from pathlib import Path

import pytest

from maritrack.errors import InputError
from maritrack.io.archive import read_archive
from tests.cli.calling import COMMAND, ENVIRONMENT, call, spawn, start
from tests.cli.conftest import SCANS
from tests.io.cat240_blocks import block, video

PNG = b"\x89PNG\r\n\x1a\n" + bytes(64)


def test_a_run_leaves_picture_archive_and_summary(finished_run: Path) -> None:
    names = sorted(p.name for p in finished_run.iterdir() if not p.name.startswith("."))
    assert names == ["run.mcap", "run.rrd", "summary.json"]
    summary = json.loads((finished_run / "summary.json").read_text())
    assert summary["counts"]["scans"] == SCANS and summary["metrics"]["gospa"] > 0


def test_json_is_one_document_equal_to_the_summary(sample: Path, tmp_path: Path) -> None:
    done = spawn("process", sample, "--limit", "2", "-o", tmp_path / "run", "--no-rrd", "--json")
    assert done.code == 0
    assert done.json == json.loads((tmp_path / "run" / "summary.json").read_text())


def test_progress_is_shown_on_a_terminal_and_leaves_the_answer_alone(sample: Path, tmp_path: Path) -> None:
    reader, writer = os.openpty()
    arguments = ("process", sample, "--limit", "12", "-o", tmp_path, "--no-rrd", "--json")
    done = subprocess.run([*COMMAND, *map(str, arguments)], stdout=subprocess.PIPE, stderr=writer, check=True)
    os.close(writer)
    shown = os.read(reader, 1 << 16).decode()
    os.close(reader)
    assert json.loads(done.stdout)["counts"]["scans"] == 12
    assert "ms/scan" in shown and "s left" in shown


def test_no_picture_and_no_archive_where_they_are_not_wanted(sample: Path, tmp_path: Path) -> None:
    assert call("process", sample, "--limit", "2", "-o", tmp_path, "--no-rrd", "--no-mcap").code == 0
    assert [p.name for p in tmp_path.iterdir()] == ["summary.json"]


def test_an_equal_run_is_not_run_again(sample: Path, tmp_path: Path) -> None:
    arguments = ("process", sample, "--limit", "2", "-o", tmp_path, "--no-rrd")
    first, archive = call(*arguments, "--json"), tmp_path / "run.mcap"
    before = archive.stat().st_mtime_ns
    again = call(*arguments, "--json")
    assert "--force" in again.err and again.json == first.json and archive.stat().st_mtime_ns == before
    call(*arguments, "--force")
    assert archive.stat().st_mtime_ns != before


def test_another_run_takes_the_place_of_an_older_one_in_its_folder(sample: Path, tmp_path: Path) -> None:
    arguments = ("process", sample, "-o", tmp_path, "--no-rrd", "--json")
    assert call(*arguments, "--limit", "2").json["counts"]["scans"] == 2
    assert call(*arguments, "--limit", "3").json["counts"]["scans"] == 3
    assert json.loads((tmp_path / "summary.json").read_text())["counts"]["scans"] == 3


@pytest.mark.parametrize(
    ("name", "octets", "told"),
    [("empty.cat240", b"", "empty"), ("picture.cat240", PNG, "PNG"), ("zeros.cat240", bytes(4096), "not")],
)
def test_what_is_no_recording_is_told_in_one_line(tmp_path: Path, name: str, octets: bytes, told: str) -> None:
    path = tmp_path / name
    path.write_bytes(octets)
    done = call("process", path, "-o", tmp_path / "out")
    assert done.code == 2 and done.error.startswith(f"{path}: ") and told in done.error
    assert not (tmp_path / "out").exists()


def test_a_path_that_is_not_there_is_told_in_one_line(tmp_path: Path) -> None:
    done = spawn("process", tmp_path / "nowhere.cat240")
    assert done.code == 2 and "nowhere.cat240" in done.error


def test_a_folder_is_no_recording(tmp_path: Path) -> None:
    done = call("process", tmp_path)
    assert done.code == 2 and str(tmp_path) in done.error


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_a_file_that_may_not_be_read_is_told_in_one_line(sample: Path, tmp_path: Path) -> None:
    path = Path(shutil.copy(sample, tmp_path / "secret.cat240"))
    path.chmod(0)
    done = call("process", path)
    assert done.code == 2 and "ermission denied" in done.error


def test_a_folder_that_can_not_be_made_is_told_in_one_line(sample: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")
    done = call("process", sample, "--limit", "2", "-q", "-o", tmp_path / "file" / "out")
    assert done.code == 2 and str(tmp_path / "file") in done.error


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("--set", "model.p_detct=0.9"), "p_detect"),
        (("--set", "model.p_detect=2"), "model.p_detect"),
        (("--set", "nonsense"), "KEY=VALUE"),
        (("-p", "no-such-preset"), "no-such-preset"),
        (("-t", "no-such-tracker"), "no-such-tracker"),
        (("--position", "north"), "LAT,LON"),
        (("--from", "9", "--to", "3"), "from_s"),
        (("--truth", "no-such-truth.csv"), "no-such-truth.csv"),
    ],
)
def test_wrong_settings_are_told_in_one_line(
    sample: Path, tmp_path: Path, arguments: tuple[str, ...], told: str
) -> None:
    done = call("process", sample, *arguments, "-q", "-o", tmp_path / "out")
    assert done.code == 2 and told in done.error
    assert not (tmp_path / "out" / "summary.json").exists()


def test_a_disk_that_is_full_is_told_in_one_line_and_leaves_no_run(sample: Path, tmp_path: Path) -> None:
    limit = partial(resource.setrlimit, resource.RLIMIT_FSIZE, (50_000, 50_000))
    done = spawn("process", sample, "-o", tmp_path, "--no-rrd", "-q", preexec_fn=limit)
    assert done.code == 2 and "too large" in done.error
    assert not (tmp_path / "run.mcap").exists() and not (tmp_path / "summary.json").exists()


def test_two_runs_do_not_write_into_one_folder_at_once(sample: Path, tmp_path: Path) -> None:
    with start("process", sample, "-o", tmp_path, "--no-rrd", "-q") as first:
        _wait_for(tmp_path / "run.mcap.partial", first)
        second = call("process", sample, "-o", tmp_path, "--no-rrd", "-q")
        assert second.code == 2 and "another run" in second.error
        first.communicate(timeout=120)
    assert first.returncode == 0 and (tmp_path / "run.mcap").is_file()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_run_is_closed_and_says_so(sample: Path, tmp_path: Path, number: int) -> None:
    with start("process", sample, "-o", tmp_path, "--no-rrd", "-q") as process:
        _wait_for(tmp_path / "run.mcap.partial", process, scans=20)
        process.send_signal(number)
        process.communicate(timeout=60)
    assert process.returncode == 130
    assert not list(tmp_path.glob("*.partial"))
    assert json.loads((tmp_path / "summary.json").read_text())["interrupted"] is True
    shown = call("show", tmp_path / "run.mcap", "--json").json
    assert shown["interrupted"] and not shown["damage"] and 0 < shown["scans"] < 42


def test_a_killed_run_replays_all_but_the_last_scans(sample: Path, tmp_path: Path) -> None:
    with start("process", sample, "-o", tmp_path / "killed", "--no-rrd", "-q") as process:
        _wait_for(tmp_path / "killed" / "run.mcap.partial", process, scans=20)
        process.kill()
        process.communicate(timeout=60)
    assert not (tmp_path / "killed" / "run.mcap").exists() and not (tmp_path / "killed" / "summary.json").exists()
    done = call("replay", tmp_path / "killed", "-o", tmp_path / "replayed", "--no-rrd", "--json")
    assert done.code == 0 and "at most 20" in done.err
    assert done.json["counts"]["scans"] in (20, 40)
    compared = call("diff", tmp_path / "killed", tmp_path / "replayed", "--json").json
    assert compared["scans"] >= 20
    assert {d["where"] for d in compared["differences"]} <= {"archive", "metrics", "counts"}


def _wait_for(path: Path, process: subprocess.Popen[bytes], *, scans: int = 0) -> None:
    """Until the archive is there with so many scans written."""
    deadline = time.monotonic() + 60
    while not path.exists() or _scans(path) < scans:
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < deadline
        time.sleep(0.02)


def _scans(path: Path) -> int:
    """Scans in an archive that is being written; none where not even its beginning is there."""
    try:
        return read_archive(path).n_scans
    except InputError:
        return 0


def test_standard_input_and_pipes_are_read_as_the_file_is(sample: Path, tmp_path: Path) -> None:
    head = sample.read_bytes()[:400_000]
    file, pipe = tmp_path / "part.cat240", tmp_path / "pipe"
    file.write_bytes(head)
    os.mkfifo(pipe)
    command = [*COMMAND, "process", "-", "--no-rrd", "-o", str(tmp_path / "stdin"), "-q", "--json"]
    piped = subprocess.run(command, input=head, capture_output=True, check=True, env=ENVIRONMENT)
    writer = threading.Thread(target=pipe.write_bytes, args=(head,))
    writer.start()
    from_pipe = call("process", pipe, "--no-rrd", "-o", tmp_path / "piped", "-q", "--json").json
    writer.join()
    from_file = call("process", file, "--no-rrd", "-o", tmp_path / "file", "-q", "--json").json
    assert json.loads(piped.stdout)["counts"] == from_file["counts"] == from_pipe["counts"]
    assert call("diff", tmp_path / "stdin", tmp_path / "file").code == 0
    assert call("replay", tmp_path / "stdin", "--verify").code == 0


def test_a_damage_code_comes_with_its_first_place(sample: Path, tmp_path: Path) -> None:
    octets = sample.read_bytes()[:400_000]
    (tmp_path / "cut.cat240").write_bytes(octets + b"\xf0\x00\x01")
    done = call("process", tmp_path / "cut.cat240", "--no-rrd", "-o", tmp_path / "out", "-q", "--json").json
    first = done["warnings"]
    assert {code: one["count"] for code, one in first.items()} == done["counts"]["warnings"] != {}
    assert all(0 <= one["offset"] <= len(octets) + 3 for one in first.values())


def test_a_damage_code_tells_how_often_each_sensor_has_it(tmp_path: Path) -> None:
    octets = b"".join(
        block(video(i, azimuth=(i % 128 * 512, (i + 1) % 128 * 512), tod=i, sac_sic=(1, sic), res=7 if i in bad else 4))
        for i in range(400) for sic, bad in ((2, (150, 160, 170)), (3, (155,)))
    )  # fmt: skip
    (tmp_path / "two.cat240").write_bytes(octets)
    done = call("process", tmp_path / "two.cat240", "--no-rrd", "-o", tmp_path / "out", "-q", "--json").json
    told = done["warnings"]["bad-res"]
    assert (told["count"], told["sensor"], told["sensors"]) == (4, "1-2", {"1-2": 3, "1-3": 1})


def test_damage_of_the_truth_is_told_beside_that_of_the_recording(sample: Path, tmp_path: Path) -> None:
    octets = sample.read_bytes()[:400_000]
    (tmp_path / "cut.cat240").write_bytes(octets + b"\xf0\x00\x01")
    table = "mmsi,time,lat,lon\n1,2026-03-18T05:00:00Z,54.68,13.43\n1,2026-03-18T05:00:00Z,91.0,13.43\n"
    (tmp_path / "ais.csv").write_text(table)
    done = call("process", tmp_path / "cut.cat240", "--truth", tmp_path / "ais.csv", "--no-rrd", "-o", tmp_path / "out")
    assert done.code == 0 and "truth-bad-position" in done.out
    document = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert document["warnings"]["truth-bad-position"]["count"] == 1


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("process",), "error: missing argument 'inputs'"),
        (("process", "x", "--bogus"), "error: no such option: --bogus"),
        (("process", "x", "--limit", "many"), "error: invalid value for '--limit'"),
        (("frob",), "error: no such command 'frob'"),
    ],
)
def test_wrong_arguments_are_told_in_one_line_with_the_way_to_help(arguments: tuple[str, ...], told: str) -> None:
    done = call(*arguments)
    lines = done.err.splitlines()
    assert done.code == 2 and done.out == "" and lines[0].startswith(told)
    assert len(lines) == 2 and lines[1].startswith("hint: ") and lines[1].endswith(" --help")


@pytest.mark.parametrize("option", ["--sensors", "--calibration"])
@pytest.mark.parametrize(
    ("octets", "told"), [(b"", "says nothing"), (b"\xf0\x00", "not a text, at byte 0"), (b"[", "Invalid")]
)
def test_a_file_of_sensors_that_says_nothing_is_named(
    sample: Path, tmp_path: Path, option: str, octets: bytes, told: str
) -> None:
    (tmp_path / "own.toml").write_bytes(octets)
    done = call("process", sample, option, tmp_path / "own.toml")
    assert done.code == 2 and done.error.startswith(f"{tmp_path / 'own.toml'}: {told}")


@pytest.mark.parametrize("workers", ["0", "100000"])
def test_no_more_processes_than_a_machine_can_bear(sample: Path, workers: str) -> None:
    done = call("process", sample, "--workers", workers)
    assert done.code == 2 and done.error == f"--workers {workers}: from 1 to 64"


def test_a_wrong_key_in_a_configuration_file_names_the_file(sample: Path, tmp_path: Path) -> None:
    file = tmp_path / "own.toml"
    file.write_text("[model]\np_detekt = 0.5\n")
    done = call("process", sample, "--config", file)
    assert done.code == 2 and done.error.startswith(f"{file}: unknown key 'model.p_detekt'")
