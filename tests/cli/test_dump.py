"""`maritrack dump`: lines, tables, pipes."""

from __future__ import annotations

import csv
import gzip
import json
import subprocess
from pathlib import Path

import pytest

from tests.cli.calling import COMMAND, call, spawn, start


@pytest.fixture
def short(sample: Path, tmp_path: Path) -> Path:
    """The first half megabyte, cut within a record."""
    path = tmp_path / "short.cat240"
    path.write_bytes(sample.read_bytes()[:50_000])
    return path


def test_a_line_is_a_record_or_a_problem_in_its_place(short: Path) -> None:
    done = spawn("dump", short)
    rows = [json.loads(line) for line in done.out.splitlines()]
    assert done.code == 0 and done.err == ""
    assert {row["type"] for row in rows[:-1]} == {2} and [row["idx"] for row in rows[:3]] == [0, 1, 2]
    assert rows[0]["nbcells"] == 600 and "cells" not in rows[0]
    assert "warning" in rows[-1] and rows[-1]["offset"] > rows[-2]["offset"]


def test_cells_come_where_they_are_asked_for(short: Path) -> None:
    first = json.loads(call("dump", short, "--cells").out.splitlines()[0])
    assert len(first["cells"]) == first["nbcells"] and max(first["cells"]) > 0


def test_csv_has_the_same_records(short: Path) -> None:
    lines = [json.loads(line) for line in call("dump", short).out.splitlines()]
    rows = list(csv.DictReader(call("dump", short, "--csv").out.splitlines()))
    assert [row["start_az"] for row in rows] == [str(line.get("start_az", "")) for line in lines]
    assert rows[-1]["warning"] == lines[-1]["warning"]


def test_standard_input_is_read(short: Path) -> None:
    piped = subprocess.run([*COMMAND, "dump", "-"], input=short.read_bytes(), capture_output=True, check=True)
    assert piped.stdout.decode() == call("dump", short).out


def test_a_reader_that_has_enough_ends_it_quietly(sample: Path) -> None:
    with start("dump", sample, "--cells") as process:
        assert process.stdout is not None and process.stderr is not None
        assert json.loads(process.stdout.readline())["type"] == 2
        process.stdout.close()
        assert process.wait(timeout=60) == 141
        assert process.stderr.read() == b""


@pytest.mark.parametrize("command", [("papers",), ("config", "show", "radar"), ("--help",)])
def test_a_reader_that_is_gone_already_is_no_error_of_ours(command: tuple[str, ...]) -> None:
    with start(*command) as process:
        assert process.stdout is not None and process.stderr is not None
        process.stdout.close()
        assert process.wait(timeout=60) == 141
        assert process.stderr.read() == b""


def test_a_disk_that_is_full_is_told_in_one_line(short: Path) -> None:
    with Path("/dev/full").open("wb") as full:
        done = subprocess.run([*COMMAND, "dump", str(short)], stdout=full, stderr=subprocess.PIPE, check=False)
    assert done.returncode == 2 and done.stderr.count(b"\n") == 1 and b"standard output: No space left" in done.stderr


@pytest.mark.parametrize(
    ("octets", "told"),
    [
        (b"", "empty"),
        (gzip.compress(b"", mtime=0), "empty"),
        (b"\x89PNG\r\n\x1a\n" + bytes(64), "a PNG image"),
        (bytes(64), "no CAT240"),
    ],
)
def test_what_is_no_cat240_is_told(tmp_path: Path, octets: bytes, told: str) -> None:
    path = tmp_path / "rec.cat240"
    path.write_bytes(octets)
    done = call("dump", path)
    assert done.code == 2 and f"error: {path}: " in done.err and told in done.err


def test_a_path_that_can_not_be_read_is_told_in_one_line(tmp_path: Path) -> None:
    for path in (tmp_path, tmp_path / "nowhere.cat240"):
        done = call("dump", path)
        assert done.code == 2 and done.error.startswith(f"{path}: ")
