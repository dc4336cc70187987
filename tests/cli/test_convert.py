"""`maritrack convert`: files, pipes, archives of runs, and what is refused."""

from __future__ import annotations

import gzip
import json
import subprocess
from pathlib import Path

import pytest

from maritrack.io.containers.pcap_writer import PcapWriter
from maritrack.io.datagrams import Stream
from tests.cli.calling import COMMAND, ENVIRONMENT, call, spawn
from tests.io.cat240_blocks import block, packed_video, read, video

FOLDER_IN_USE = ("watch.pcap", "watch.pcap.partial")


def left_in(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_a_recording_goes_into_a_capture_and_back(sample: Path, tmp_path: Path) -> None:
    done = call("convert", sample, tmp_path / "a.pcap.gz", "--date", "2017-11-02")
    assert done.code == 0 and done.err == ""
    assert "21504 of 21504 datagrams" in done.out and "2017-11-02T06:30:00Z" in done.out
    assert call("convert", tmp_path / "a.pcap.gz", tmp_path / "b", "--to", "raw").code == 0
    assert (tmp_path / "b").read_bytes() == sample.read_bytes()
    assert left_in(tmp_path) == ["a.pcap.gz", "b"]


def test_the_summary_is_there_for_programs(sample: Path, tmp_path: Path) -> None:
    document = call("convert", sample, tmp_path / "a.mcap", "--time", "+60..+60.5", "--json").json
    assert document["output"] == str(tmp_path / "a.mcap") and document["container"] == "raw"
    assert document["datagrams_in"] == 21_504
    assert document["datagrams_out"] + document["datagrams_dropped"]["outside-time"] == 21_504
    assert (document["first"], document["last"]) == ("06:31:00", "06:31:00") and document["warnings"] == {}
    assert document["first_ns"] // 10**9 == 6 * 3600 + 31 * 60


def test_cells_are_unpacked_and_packed_again(sample: Path, tmp_path: Path) -> None:
    plain, packed = tmp_path / "plain.cat240", tmp_path / "packed.final"
    done = call("convert", sample, plain, "--no-compress")
    assert "21504 records recoded" in done.out and plain.stat().st_size > 5 * sample.stat().st_size
    assert call("convert", plain, packed, "--compress", "--level", "9").code == 0
    assert packed.stat().st_size < plain.stat().st_size / 5
    assert call("convert", packed, tmp_path / "again.cat240", "--no-compress").code == 0
    assert (tmp_path / "again.cat240").read_bytes() == plain.read_bytes()


def test_standard_input_goes_to_standard_output(sample: Path) -> None:
    piped = subprocess.run(
        [*COMMAND, "convert", "-", "-"], input=gzip.compress(sample.read_bytes(), 1), capture_output=True, check=True,
        env=ENVIRONMENT,
    )  # fmt: skip
    assert piped.stdout == sample.read_bytes()
    assert piped.stderr.startswith(b"standard output: 21504 of 21504 datagrams")


def test_a_reader_that_is_gone_ends_it_quietly(sample: Path) -> None:
    command = f"{' '.join(map(repr, COMMAND))} convert '{sample}' - --no-compress -q | head -c 10 > /dev/null"
    script = f"set -o pipefail; {command}"
    done = subprocess.run(["bash", "-c", script], capture_output=True, check=False, env=ENVIRONMENT)
    assert (done.returncode, done.stderr) == (141, b"")


def test_an_archive_of_a_run_gives_its_recording_back(run: Path, sample: Path, tmp_path: Path) -> None:
    done = call("convert", run / "run.mcap", tmp_path / "back.cat240")
    assert done.code == 0, done.err
    back = (tmp_path / "back.cat240").read_bytes()
    assert len(back) > 100_000 and sample.read_bytes().startswith(back)


def test_an_archive_of_a_run_that_was_killed_gives_what_is_there(sample: Path, tmp_path: Path) -> None:
    often = ("--limit", "4", "--no-rrd", "--set", "output.chunk_scans=1")
    assert call("process", sample, *often, "-o", tmp_path / "run", "-q").code == 0
    archive, whole = tmp_path / "run.mcap.partial", (tmp_path / "run" / "run.mcap").read_bytes()
    archive.write_bytes(whole[: len(whole) * 3 // 4])
    done = call("convert", archive, tmp_path / "back.cat240")
    assert done.code == 0 and "warning: archive-" in done.out
    assert sample.read_bytes().startswith((tmp_path / "back.cat240").read_bytes())
    assert "(archive-" in call("convert", archive, tmp_path / "strict.cat240", "--strict").error
    assert not (tmp_path / "strict.cat240").exists()


def test_of_an_archive_with_several_recordings_one_is_chosen(sample: Path, tmp_path: Path) -> None:
    two = tmp_path / "two.cat240"
    two.write_bytes(sample.read_bytes()[:300_000])
    assert call("process", sample, two, "--limit", "2", "--no-rrd", "-o", tmp_path / "run", "-q").code == 0
    archive, out = tmp_path / "run" / "run.mcap", tmp_path / "out.cat240"
    refused = call("convert", archive, out)
    assert refused.code == 2 and "2 recordings" in refused.err and "--stream /input/cat240-0" in refused.err
    assert call("convert", archive, out, "--stream", "/input/cat240-1").code == 0
    assert two.read_bytes().startswith(out.read_bytes()[:1000])
    assert "it has /input/cat240-0" in call("convert", archive, out, "--force", "--stream", "/input/cat240-7").error
    assert "not an archive" in call("convert", sample, out, "--force", "--stream", "/input/cat240-1").error


def test_an_archive_without_its_recording_is_told(sample: Path, tmp_path: Path) -> None:
    digest = ("--set", "output.archive=hash")
    assert call("process", sample, "--limit", "1", "--no-rrd", "-o", tmp_path / "run", "-q", *digest).code == 0
    assert "only the digest" in call("convert", tmp_path / "run" / "run.mcap", tmp_path / "out.cat240").err


def test_a_file_that_is_there_is_not_written_over(sample: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.cat240"
    out.write_bytes(b"precious")
    assert call("convert", sample, out).error == f"{out}: is there already"
    assert out.read_bytes() == b"precious"
    assert call("convert", sample, out, "--force").code == 0
    assert out.read_bytes() == sample.read_bytes()


@pytest.mark.parametrize("name", FOLDER_IN_USE)
def test_the_recording_that_is_read_is_never_written(sample: Path, tmp_path: Path, name: str) -> None:
    recording, other = tmp_path / name, tmp_path / "link.pcap"
    recording.write_bytes(sample.read_bytes())
    outs = [tmp_path / "watch.pcap"]
    if name == "watch.pcap":
        other.symlink_to(recording)
        outs.append(other)
    for out in outs:
        assert "is the recording that is read" in call("convert", recording, out, "--force", "--to", "raw").error
    assert recording.read_bytes() == sample.read_bytes()


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("--time", "12:00"), "write FROM..TO"),
        (("--time", "+5..+4"), "ends before it begins"),
        (("--time", "+500.."), "nothing in this window"),
        (("--time", "2017-11-02.."), "times of day only"),
        (("--sensor", "7"), "write SAC-SIC"),
        (("--sensor", "9-9"), "it has 7-42"),
        (("--stream", ":8600"), "no streams"),
        (("--date", "yesterday"), "is not a day"),
        (("--level", "11", "--compress"), "compression level 11"),
        (("--to", "avi"), "one of raw, pcap, final, mcap"),
    ],
)  # fmt: skip
def test_what_makes_no_sense_is_told_and_leaves_nothing(
    sample: Path, tmp_path: Path, arguments: tuple[str, ...], told: str
) -> None:
    assert told in call("convert", sample, tmp_path / "out.cat240", *arguments).error
    assert left_in(tmp_path) == []


def test_a_failure_leaves_the_old_file(sample: Path, tmp_path: Path) -> None:
    out, wrong = tmp_path / "out.cat240", tmp_path / "wrong.cat240"
    out.write_bytes(b"precious")
    wrong.write_bytes(sample.read_bytes()[:100_000] + b"junk" * 10 + sample.read_bytes()[:100_000])
    assert "(lost-sync)" in call("convert", wrong, out, "--force", "--strict").error
    assert out.read_bytes() == b"precious" and left_in(tmp_path) == ["out.cat240", "wrong.cat240"]
    done = call("convert", wrong, out, "--force")
    assert done.code == 0 and "warning: lost-sync x 1, first at byte 99986" in done.out


def test_what_the_file_can_not_hold_is_told_by_exit_1(tmp_path: Path) -> None:
    large, out = tmp_path / "large.cat240", tmp_path / "out.pcap"
    large.write_bytes(block(video(1)) + block(packed_video(2, bytes(65_280), items={"SP": bytes([210] * 210)})))
    done = call("convert", large, out, "--no-compress")
    assert done.code == 1 and "1 datagrams left out: too large" in done.out and "first at byte 51" in done.out
    assert call("convert", out, tmp_path / "back.cat240").code == 0
    assert [of.radials.idx.tolist() for of in read((tmp_path / "back.cat240").read_bytes()) if of.radials] == [[1]]


def test_a_block_that_is_there_in_part_is_told_by_exit_1(tmp_path: Path) -> None:
    cut, whole = block(video(1)), block(video(2))
    with (tmp_path / "cut.pcap").open("wb") as file:
        writer = PcapWriter(file)
        for payload in (cut[:-9], whole):
            writer.write(payload, t_ns=10**18, stream=Stream("10.0.0.7:5000", "239.0.1.2:8600"))
    done = call("convert", tmp_path / "cut.pcap", tmp_path / "out.cat240")
    assert done.code == 1 and "1 data blocks left out: only parts of them are there" in done.out
    assert "truncated-block x 1" in done.out and (tmp_path / "out.cat240").read_bytes() == whole
    assert call("convert", tmp_path / "cut.pcap", tmp_path / "out.mcap").code == 0
    command = [*COMMAND, "convert", str(tmp_path / "cut.pcap"), "-"]
    piped = subprocess.run(command, capture_output=True, env=ENVIRONMENT, check=False)
    assert piped.returncode == 1 and b"1 data blocks left out" in piped.stderr and piped.stdout == whole


def test_standard_output_takes_data_blocks_alone(sample: Path) -> None:
    for arguments in (("--to", "pcap"), ("--json",)):
        assert "standard output" in call("convert", sample, "-", *arguments).error


@pytest.mark.parametrize("name", ["", "no/such/folder/out.pcap", "out.doc"])
def test_an_out_that_can_not_be_is_told(sample: Path, tmp_path: Path, name: str) -> None:
    done = call("convert", sample, tmp_path / name)
    assert done.code == 2 and done.error.startswith(str(tmp_path))


@pytest.mark.parametrize(
    ("name", "octets"),
    [("picture.png", b"\x89PNG\r\n\x1a\n" + bytes(64)),
     ("points.json", b'{"format": "maritrack-points/1", "scans": []}'), ("empty.cat240", b"")],
)  # fmt: skip
def test_what_is_no_radar_video_is_told(tmp_path: Path, name: str, octets: bytes) -> None:
    path = tmp_path / name
    path.write_bytes(octets)
    done = call("convert", path, tmp_path / "out.pcap")
    assert done.code == 2 and done.error.startswith(str(path)) and left_in(tmp_path) == [name]


def test_a_recording_that_is_not_there_is_told(tmp_path: Path) -> None:
    assert call("convert", tmp_path / "nowhere.cat240", tmp_path / "out.pcap").error.startswith(str(tmp_path))


def test_help_says_what_a_time_is() -> None:
    done = spawn("convert", "--help")
    assert done.code == 0
    for said in ("FROM <= time < TO", "2017-11-02T07:40:00Z", "+60", "Examples"):
        assert said in done.out


def test_json_stands_alone_on_standard_output(sample: Path, tmp_path: Path) -> None:
    done = spawn("convert", sample, tmp_path / "out.pcap", "--json", "--sensor", "7-42")
    assert json.loads(done.out)["datagrams_out"] == 21_504 and done.err == ""
