"""`maritrack show`: archives, folders, recordings, and what is neither."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.cli.calling import call, spawn
from tests.cli.conftest import SCANS


def test_an_archive_shows_manifest_counts_channels_and_time(finished_run: Path) -> None:
    shown = spawn("show", finished_run, "--json").json
    assert shown["what"] == "archive" and shown["complete"] and shown["damage"] == []
    assert shown["tracker"] == "jipda" and shown["preset"] == "radar" and shown["scans"] == SCANS
    channels = {row["topic"]: row["messages"] for row in shown["channels"]}
    assert channels["/input/cat240"] >= SCANS and channels["/tracks"] == SCANS
    assert shown["from"].startswith("2026-05-12T06:30:0") and shown["duration_s"] == pytest.approx(2.5 * (SCANS - 1))
    assert call("show", finished_run / "run.mcap", "--json").json["run_id"] == shown["run_id"]


def test_a_recording_shows_sensor_period_and_cells(sample: Path) -> None:
    shown = call("show", sample, "--json").json
    assert shown["what"] == "recording" and shown["kind"] == "cat240" and shown["scans"] == 42 and shown["truth"] == 10
    (sensor,) = shown["sensors"]
    assert sensor["id"] == "7-42" and sensor["period_s"] == pytest.approx(2.5) and sensor["gaps"] == 0
    assert sensor["spokes_per_turn"] == 512 and sensor["cell_m"] == pytest.approx(10.0)
    assert sensor["range_m"] == pytest.approx(6000.0)


def test_a_gap_is_shown_where_turns_are_missing(sample: Path, tmp_path: Path) -> None:
    from maritrack.io.dump import dump_records

    starts = [row["offset"] - 3 for row in dump_records([sample.read_bytes()]) if row.get("type") == 2]
    octets = sample.read_bytes()
    cut = tmp_path / "cut.cat240"
    cut.write_bytes(octets[: starts[10 * 512]] + octets[starts[14 * 512] :])
    (sensor,) = call("show", cut, "--json").json["sensors"]
    assert sensor["scans"] == 38 and sensor["gaps"] == 1
    assert sensor["gap_list"][0]["seconds"] == pytest.approx(10.0, abs=0.1)  # without a spoke


def test_points_are_shown_by_sensor(tmp_path: Path) -> None:
    path = tmp_path / "points.json"
    scans = ", ".join(f'{{"time_s": {t}, "points": [[1.0, 2.0], [3.0, 4.0]]}}' for t in (100, 102, 104, 111))
    path.write_text(f'{{"format": "maritrack-points/1", "frame": "enu", "scans": [{scans}]}}')
    shown = call("show", path, "--json").json
    (sensor,) = shown["sensors"]
    assert shown["kind"] == "points" and sensor["points"] == 8 and sensor["gaps"] == 1
    assert shown["from"] == "00:01:40.000"


def test_people_get_tables(finished_run: Path, sample: Path) -> None:
    assert "/input/cat240" in call("show", finished_run).out
    assert "7-42" in call("show", sample).out


def test_damage_of_an_archive_is_shown(run: Path) -> None:
    archive = run / "run.mcap"
    octets = bytearray(archive.read_bytes())
    octets[len(octets) // 2] ^= 0xFF
    archive.write_bytes(octets)
    done = call("show", archive, "--json")
    assert done.code == 0 and done.json["damage"] and done.json["scans"] < SCANS


def test_no_picture_is_told_in_one_line(run: Path, sample: Path) -> None:
    (run / "run.rrd").unlink()
    for path in (run, sample):
        done = call("show", path, "--view")
        assert done.code == 2 and str(path) in done.error


def test_what_can_not_be_shown_is_told_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "empty").write_bytes(b"")
    (tmp_path / "picture.mcap").write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(64))
    for path in (tmp_path / "empty", tmp_path / "picture.mcap", tmp_path / "nowhere", tmp_path):
        done = call("show", path)
        assert done.code == 2 and str(path) in done.error


KEYS = {  # of a sensor, as they are documented
    "id", "sac", "sic", "source", "destination", "records", "spokes", "first_time", "last_time", "duration_s", "clock",
    "scans", "period_s", "period_jitter_s", "period_spread_s", "period_least_s", "period_most_s", "rotation_rpm",
    "spokes_per_turn", "spokes_least", "spokes_most", "spoke_width_deg", "cell_m", "cells", "range_first_m", "range_m",
    "bits", "header", "range_scales", "compression", "compression_ratio", "lost_records", "losses", "loss_list", "gaps",
    "gap_over_s", "gap_list", "range_changes", "range_change_list", "missing_sectors", "repeated_spokes",
    "backward_spokes", "stray_azimuths", "odd_ranges", "clock_steps_back", "summaries",
}  # fmt: skip


def test_a_capture_of_nothing_is_told_in_one_line(sample: Path, tmp_path: Path) -> None:
    assert call("convert", sample, tmp_path / "all.pcap", "--time", "+0..+0.01").code == 0
    (tmp_path / "none.pcap").write_bytes((tmp_path / "all.pcap").read_bytes()[:24])
    done = call("show", tmp_path / "none.pcap")
    assert done.code == 2 and done.error == f"{tmp_path / 'none.pcap'}: pcap without datagrams"
    assert call("show", tmp_path / "all.pcap").code == 0


def test_the_document_has_the_keys_that_are_documented(sample: Path) -> None:
    from maritrack import survey

    shown = call("show", sample, "--json").json
    (sensor,) = shown["sensors"]
    assert set(sensor) == KEYS
    assert set(shown) == {
        "what", "path", "kind", "octets", "container", "gzipped", "from", "to", "duration_s", "records", "scans",
        "sensors", "other_streams", "summaries", "damage", "warnings", "origin", "truth",
    }  # fmt: skip
    assert all(key in (survey.__doc__ or "") for key in KEYS)


@pytest.mark.parametrize("name", ["a.pcap", "a.final", "a.mcap", "a.cat240.gz", "a.pcap.gz"])
def test_a_recording_shows_the_same_in_every_container(sample: Path, tmp_path: Path, name: str) -> None:
    from maritrack.io.containers.kinds import open_container
    from maritrack.io.containers.writers import open_writer
    from maritrack.io.datagrams import Stream
    from maritrack.io.octets import octets_from_file

    path = tmp_path / name
    writer, n = open_writer(path), 0
    for d in open_container(octets_from_file(sample, "")).datagrams():
        for begin, end in zip(d.bounds[:-1].tolist(), d.bounds[1:].tolist(), strict=True):
            t_ns = 1_700_000_000 * 10**9 + n * 5_000_000
            assert writer.write(d.data[begin:end], t_ns=t_ns, stream=Stream("10.0.0.5:50000", "239.0.1.2:8600"))
            n += 1
    writer.close()
    raw, packed = call("show", sample, "--json").json, call("show", path, "--json").json
    assert packed["container"] == {"a.pcap": "pcap", "a.final": "FINAL", "a.mcap": "MCAP"}.get(
        name.removesuffix(".gz"), "raw"
    )
    assert packed["gzipped"] == name.endswith(".gz") and packed["octets"] == path.stat().st_size
    (of_raw,), (of_packed,) = raw["sensors"], packed["sensors"]
    apart = {"source", "destination", "first_time", "last_time"}
    assert {k: v for k, v in of_raw.items() if k not in apart} == {k: v for k, v in of_packed.items() if k not in apart}
    if "pcap" in name:
        assert (of_packed["source"], of_packed["destination"]) == ("10.0.0.5:50000", "239.0.1.2:8600")
        assert of_packed["first_time"].endswith("T06:30:00.000Z")


def test_the_page_says_what_a_radar_engineer_asks_for(sample: Path, tmp_path: Path) -> None:
    from maritrack.io.dump import dump_records

    octets = sample.read_bytes()
    starts = [row["offset"] - 3 for row in dump_records([octets]) if row.get("type") == 2]
    cut = tmp_path / "cut.cat240"
    cut.write_bytes(
        octets[: starts[10 * 512]] + octets[starts[14 * 512] : starts[30 * 512]] + octets[starts[30 * 512 + 3] :]
    )
    page = call("show", cut).out
    for line in (
        "sensor 7-42", "turns        38", "period       2.5000 s (24.00 rpm)", "range        0 m to 6000 m",
        "cells        600 of 10.000 m, 8 bit, femto header", "spokes       512 a turn", "compression  zlib, 0.05",
        "gaps         1 longer than 1.25 s", "lost         2051 records, 2 times", "no video in  no sector",
        "gaps of 7-42", "lost records of 7-42",
    ):  # fmt: skip
        assert line in page, (line, page)
    assert not any(len(word.partition(".")[2]) > 6 for word in page.split() if word.replace(".", "").isdigit())


def test_standard_input_is_shown(sample: Path) -> None:
    with sample.open("rb") as file:
        done = spawn("show", "-", "--json", stdin=file)
    assert done.code == 0 and done.json["records"] == 21_504 and done.json["path"] == "-"


def test_the_page_names_damage_and_streams_without_video(tmp_path: Path) -> None:
    from tests.io import pcap_build as build
    from tests.io.cat240_blocks import block, video

    blocks = [block(video(i, tod=i // 8, azimuth=(i * 1024 % 65_536, (i + 1) * 1024 % 65_536))) for i in range(130)]
    packets = [build.ethernet(build.ipv4(build.udp(one))) for one in blocks]
    nmea = build.ethernet(build.ipv4(build.udp(b"$GPGGA,1*00\r\n", ports=(4000, 4000)), addresses=(build.B, build.A)))
    path = tmp_path / "x.pcap"
    path.write_bytes(build.pcap([*packets, nmea])[:-3])
    page = call("show", path).out
    assert "10.0.0.1:4000 -> 239.0.1.2:8600" in page and "streams without radar video" in page
    assert "10.0.0.2:4000 -> 10.0.0.1:4000" in page and "pcap-cut" in page


def test_text_in_a_recording_can_not_drive_the_terminal(tmp_path: Path) -> None:
    from maritrack.io.cat240.encode import encode_summary

    path = tmp_path / "x.cat240"
    path.write_bytes(encode_summary(sac=1, sic=2, text=b"\x1b[2Jhello\n") * 3)
    page = call("show", path).out
    assert "hello" in page and "\x1b" not in page
