"""A survey of headers: what it tells of an antenna, and that the quick ways tell what the thorough ones do."""

from __future__ import annotations

import io
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from maritrack.errors import InputError
from maritrack.io.cat240 import blockstarts, headers
from maritrack.io.cat240.encode import encode_summary, encode_video
from maritrack.io.cat240.headers import HeaderWalk, RawMake
from maritrack.io.cat240.radials import Radials
from maritrack.io.containers.final import FinalWriter
from maritrack.io.containers.final_heads import FinalMake
from maritrack.io.containers.kinds import FINAL, container_of
from maritrack.io.containers.packetwalk import packet_make
from maritrack.io.datagrams import NO_TIME, Stream
from maritrack.io.octets import octets_from_bytes, octets_from_file
from maritrack.io.turns.spokes import DayCount
from maritrack.io.turns.turncount import TurnCount
from maritrack.survey import survey
from maritrack.types import take
from tests.io import pcap_build as build
from tests.io.cat240_blocks import block, packed_video, record, video
from tests.io.spins import CELL_FS, batches, cuts_of, radials, spin
from tests.io.test_cat240_equal import streams
from tests.shared import ROOT, shared

TURN = 65_536
EASY = settings(derandomize=True, deadline=None, max_examples=100, suppress_health_check=list(HealthCheck))


def recording(
    turns: float = 3.0, *, per_turn: int = 360, period_s: float = 2.5, sac: int = 7, sic: int = 42, n_cells: int = 20,
    first: int = 0, tod_s: float = 3600.0, **how: Any,
) -> list[bytes]:  # fmt: skip
    """The data blocks of an antenna that turns evenly."""
    blocks = []
    for i in range(round(turns * per_turn)):
        az, end = (TURN * (j % per_turn) // per_turn for j in (i, i + 1))
        tod = int((tod_s + i * period_s / per_turn) * 128) % (86_400 * 128)
        cells = np.full(n_cells, i % 7, dtype=np.uint8)
        blocks.append(encode_video(
            sac=sac, sic=sic, idx=first + i, start_az=az, end_az=end, start_rg=0, cells=cells,
            **{"tod": tod, "cell_dur": CELL_FS, **how},
        ))  # fmt: skip
    return blocks


def of_bytes(octets: bytes) -> dict[str, Any]:
    return survey(octets_from_bytes(octets, name="test", channel=""))


def sensor_of(blocks: list[bytes]) -> dict[str, Any]:
    (sensor,) = of_bytes(b"".join(blocks))["sensors"]
    return dict(sensor)


def both_ways(path: Path) -> list[dict[str, Any] | str]:
    """The survey of a file by walking from header to header, and by the general reader."""
    found: list[dict[str, Any] | str] = []
    for quick in (True, False):
        try:
            found.append(survey(octets_from_file(path, ""), quick=quick))
        except InputError as error:
            found.append(str(error))
    return found


# What it tells


def test_an_even_antenna_is_told_as_it_is() -> None:
    s = sensor_of(recording(5.0))
    assert (s["id"], s["sac"], s["sic"], s["records"], s["spokes"], s["scans"]) == ("7-42", 7, 42, 1800, 1800, 5)
    assert s["first_time"] == "01:00:00.000" and s["last_time"] == "01:00:12.492" and s["clock"] == "time of day"
    assert s["period_s"] == pytest.approx(2.5, abs=1e-3) and s["rotation_rpm"] == pytest.approx(24.0, abs=0.01)
    assert s["period_jitter_s"] < 0.005 and s["period_spread_s"] < 0.005  # a tick is 8 ms
    assert (s["spokes_per_turn"], s["spokes_least"], s["spokes_most"]) == (360, 360, 360)
    assert (s["cells"], s["bits"], s["header"], s["compression"]) == (20, 8, "femto", "none")
    assert s["cell_m"] == pytest.approx(10.0) and s["range_first_m"] == 0.0 and s["range_m"] == pytest.approx(200.0)
    for none in ("lost_records", "gaps", "range_changes", "repeated_spokes", "backward_spokes", "stray_azimuths"):
        assert s[none] == 0
    assert s["missing_sectors"] == [] and s["summaries"] == [] and s["compression_ratio"] is None


def test_the_period_is_finer_than_the_clock() -> None:
    s = sensor_of(recording(9.0, period_s=2.417))
    assert s["period_s"] == pytest.approx(2.417, abs=0.001)


def test_jitter_of_the_rotation_is_told() -> None:
    blocks: list[bytes] = []
    t = 3600.0
    for k in range(20):
        period = 2.5 + (0.1 if k % 2 else -0.1)
        blocks += recording(1.0, period_s=period, tod_s=t, first=360 * k)
        t += period
    s = sensor_of(blocks)
    assert s["period_s"] == pytest.approx(2.5, abs=0.11)
    assert s["period_jitter_s"] == pytest.approx(0.1, abs=0.01)
    assert s["period_least_s"] == pytest.approx(2.4, abs=0.01) and s["period_most_s"] == pytest.approx(2.6, abs=0.01)


def test_spread_of_the_rotation_is_that_of_a_normal_distribution() -> None:
    """1.4826 times the median deviation."""
    blocks: list[bytes] = []
    t = 3600.0
    for k in range(25):
        period = 2.5 + (-0.2, 0.1, 0.0, -0.1, 0.2)[k % 5]
        blocks += recording(1.0, period_s=period, tod_s=t, first=360 * k)
        t += period
    assert sensor_of(blocks)["period_spread_s"] == pytest.approx(0.148, abs=0.012)


def test_lost_records_are_told_with_place_and_time() -> None:
    blocks = recording(4.0)
    whole = blocks[:500] + blocks[510:900] + blocks[901:]
    s = sensor_of(whole)
    assert (s["lost_records"], s["losses"]) == (11, 2)
    assert [row["records"] for row in s["loss_list"]] == [10, 1]
    assert s["loss_list"][0]["offset"] == sum(map(len, blocks[:500]))
    assert s["loss_list"][0]["at"] == "01:00:03.539"


def test_a_long_silence_is_a_gap() -> None:
    blocks = recording(12.0)
    s = sensor_of(blocks[: 4 * 360] + blocks[8 * 360 :])
    assert s["gaps"] == 1 and s["gap_list"][0]["seconds"] == pytest.approx(10.0, abs=0.02)
    assert s["gap_list"][0]["at"] == "01:00:09.992" and s["gap_list"][0]["offset"] == sum(map(len, blocks[: 4 * 360]))


def test_a_sector_that_is_blanked_in_every_turn_is_missing_and_no_gap() -> None:
    blocks = [one for i, one in enumerate(recording(6.0)) if not 100 <= i % 360 < 310]
    s = sensor_of(blocks)
    assert s["gaps"] == 0 and s["scans"] == 6
    assert s["missing_sectors"] == [{"from_deg": 100.0, "to_deg": 310.0, "empty_share": 1.0}]


def test_a_missing_sector_over_north_is_one() -> None:
    blocks = [one for i, one in enumerate(recording(6.0)) if 20 <= i % 360 < 350]
    assert sensor_of(blocks)["missing_sectors"] == [{"from_deg": 350.0, "to_deg": 20.0, "empty_share": 1.0}]


def test_a_missing_sector_up_to_north_ends_at_360() -> None:
    blocks = [one for i, one in enumerate(recording(6.0)) if i % 360 < 350]
    assert sensor_of(blocks)["missing_sectors"] == [{"from_deg": 350.0, "to_deg": 360.0, "empty_share": 1.0}]


def test_bearings_without_width_leave_no_sector_missing() -> None:
    rng = np.random.default_rng(0)
    az = (np.arange(7 * 90) * TURN // 90 + rng.integers(-90, 90, 7 * 90)) % TURN
    blocks = [
        encode_video(sac=1, sic=2, idx=i, start_az=int(a), end_az=int(a), start_rg=0, cell_dur=CELL_FS,
                     cells=np.zeros(8, np.uint8), tod=i) for i, a in enumerate(az.tolist())
    ]  # fmt: skip
    s = sensor_of(blocks)
    assert s["missing_sectors"] == [] and s["spoke_width_deg"] == 0.0


def test_range_changes_are_told_with_old_and_new() -> None:
    t = 3600.0
    blocks = recording(3.0, tod_s=t) + recording(3.0, tod_s=t + 7.5, first=1080, cell_dur=2 * CELL_FS, n_cells=30)
    blocks += recording(3.0, tod_s=t + 15, first=2160, cell_dur=2 * CELL_FS, n_cells=60)
    s = sensor_of(blocks)
    assert s["range_changes"] == 2 and s["scans"] == 9
    old, new = s["range_change_list"][0]["old"], s["range_change_list"][0]["new"]
    assert (old["range_m"], new["range_m"]) == (pytest.approx(200), pytest.approx(600))
    assert s["range_change_list"][0]["at"] == "01:00:07.500"
    assert s["range_change_list"][1]["new"]["cells"] == 60


def test_a_twentieth_more_cells_are_no_other_range() -> None:
    blocks, first = list[bytes](), 0
    for n_cells in (100, 104, 120, 115):
        blocks += recording(3.0, tod_s=3600.0 + first / 144, first=first, n_cells=n_cells)
        first += 1080
    s = sensor_of(blocks)
    assert s["range_changes"] == 1 and s["scans"] == 12
    change = s["range_change_list"][0]
    assert (change["old"]["cells"], change["new"]["cells"]) == (104, 120)


def test_two_sensors_are_told_apart_and_neither_disturbs_the_other() -> None:
    a, b = recording(4.0), recording(4.0, sic=43, per_turn=300, period_s=2.0, n_cells=9, compress=True)
    mixed = [one for pair in zip(a, b, strict=False) for one in pair]
    document = of_bytes(b"".join(mixed))
    first, second = document["sensors"]
    assert (first["id"], second["id"]) == ("7-42", "7-43") and document["records"] == 2400
    assert (first["spokes_per_turn"], second["spokes_per_turn"]) == (360, 300)
    assert second["period_s"] == pytest.approx(2.0, abs=2e-3) and second["compression"] == "zlib"
    sent = sum(int.from_bytes(one[26:28], "big") for one in b)
    assert second["compression_ratio"] == pytest.approx(sent / (9 * len(b)))


def test_a_spoke_in_parts_is_one_spoke() -> None:
    blocks = []
    for i, one in enumerate(recording(3.0)):
        head = bytearray(one)
        for part in range(2):
            head[8:12] = (2 * i + part).to_bytes(4, "big")
            head[16:20] = (20 * part).to_bytes(4, "big")
            blocks.append(bytes(head))
    s = sensor_of(blocks)
    assert (s["records"], s["spokes"], s["spokes_per_turn"], s["cells"]) == (2160, 1080, 360, 40)
    assert s["repeated_spokes"] == s["range_changes"] == s["odd_ranges"] == 0


def test_spokes_that_come_again_or_go_back_are_counted() -> None:
    of = spin(3.0)
    of.start_az[100:104], of.end_az[100:104] = of.start_az[96:100], of.end_az[96:100]
    count = counted([of])
    assert count.repeated == 4 and min(count.forward, count.backward) == 1


def test_texts_of_summaries_are_told() -> None:
    said = encode_summary(sac=7, sic=42, text=b"RADAR 1", tod=1)
    blocks = recording(2.0)
    s = sensor_of([said, *blocks[:50], said, *blocks[50:], encode_summary(sac=7, sic=42, text=b"x")])
    assert s["summaries"] == [{"text": "RADAR 1", "count": 2}, {"text": "x", "count": 1}]
    other = of_bytes(encode_summary(sac=1, sic=1, text=b"y") + b"".join(blocks))["summaries"]
    assert other == [{"sensor": "1-1", "text": "y", "count": 1}]


def test_damage_is_told_by_code_with_the_first_place() -> None:
    blocks = recording(2.0)
    document = of_bytes(b"".join([*blocks[:10], b"junk", *blocks[10:20], b"junk", *blocks[20:-1], blocks[-1][:-5]]))
    found = {row["code"]: (row["count"], row["offset"]) for row in document["damage"]}
    at = sum(map(len, blocks[:10]))
    assert found == {"lost-sync": (2, at), "truncated-block": (1, sum(map(len, blocks[:-1])) + 8)}
    assert document["warnings"] == {"lost-sync": 2, "truncated-block": 1}


def test_a_capture_tells_addresses_dates_and_the_streams_without_video(tmp_path: Path) -> None:
    packets = [build.ethernet(build.ipv4(build.udp(one))) for one in recording(2.0, tod_s=22 * 3600 + 13 * 60 + 20)]
    nmea = build.ethernet(build.ipv4(build.udp(b"$GPGGA,1*00\r\n", ports=(4000, 4000)), addresses=(build.B, build.A)))
    path = tmp_path / "x.pcap"
    path.write_bytes(build.pcap([*packets[:300], nmea, *packets[300:], nmea, nmea]))
    document = survey(octets_from_file(path, ""))
    (sensor,) = document["sensors"]
    assert document["container"] == "pcap" and not document["gzipped"]
    assert (sensor["source"], sensor["destination"]) == ("10.0.0.1:4000", "239.0.1.2:8600")
    assert sensor["first_time"] == "2023-11-14T22:13:20.000Z"
    assert document["other_streams"] == [{"source": "10.0.0.2:4000", "destination": "10.0.0.1:4000", "datagrams": 3}]


def test_receive_times_are_the_clock_where_no_time_of_day_is_sent(tmp_path: Path) -> None:
    packets = [build.ethernet(build.ipv4(build.udp(one))) for one in recording(4.0, tod=None)]
    path = tmp_path / "x.pcap"
    path.write_bytes(build.pcap(packets))
    (sensor,) = survey(octets_from_file(path, ""))["sensors"]
    assert sensor["clock"] == "receive time" and sensor["period_s"] == pytest.approx(0.36)  # a millisecond a packet
    assert sensor["first_time"] == "2023-11-14T22:13:20.000Z"


def test_a_recording_without_any_time_has_turns_and_no_period() -> None:
    s = sensor_of(recording(4.0, tod=None))
    assert (s["scans"], s["period_s"], s["first_time"], s["clock"]) == (4, None, None, "none")


def test_nothing_at_all_is_told_as_nothing() -> None:
    document = of_bytes(bytes(1000))
    assert document["sensors"] == [] and document["records"] == 0 and document["from"] is None
    assert list(document["warnings"]) == ["not-asterix"]


# Turns are those of a run


def counted(parts: list[Radials]) -> TurnCount:
    count = TurnCount(DayCount())
    for of in parts:
        count.push(of)
    count.finish()
    return count


@st.composite
def spoiled_spins(draw: st.DrawFn) -> tuple[Radials, list[int]]:
    """An antenna that turns, with some of what goes wrong in recordings, and where it is cut into batches."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    faults = set(draw(st.lists(st.sampled_from([
        "jitter", "back", "again", "anticlockwise", "jump", "stray", "pause", "midnight", "clock", "no time", "lost",
        "scale", "odd", "cells", "parts", "received",
    ]), max_size=4)))  # fmt: skip
    per_turn = draw(st.sampled_from([8, 36, 64, 180]))
    n = max(int(per_turn * draw(st.floats(0.3, 8.0))), 1)
    step = np.full(n, TURN // per_turn)

    def few(share: float) -> Any:
        return rng.random(n) < share

    if "jitter" in faults:
        step = step + rng.integers(-(step[0] // 3), step[0] // 3 + 1, n)
    if "back" in faults:
        step[few(0.03)] *= -1
    if "again" in faults:
        step[few(0.03)] = 0
    if "jump" in faults:
        step[few(0.02)] += int(rng.integers(2000, 30_000))
    az = int(rng.integers(TURN)) + np.cumsum(-step if "anticlockwise" in faults else step)
    az = np.where(few(0.02), rng.integers(0, TURN, n), az) if "stray" in faults else az
    period_s = draw(st.sampled_from([0.5, 2.5, 3.0, 40.0]))
    t = 1000.0 + np.arange(n) * period_s * 128 / per_turn + (86_400 * 128 - 2000) * ("midnight" in faults)
    for at in rng.integers(0, n, 2).tolist() if "pause" in faults else ():
        t[at:] += float(rng.choice([64, 500, 1300, 5000, 20_000]))
    tod = np.floor(t).astype(np.int64) % (86_400 * 128)
    tod = np.where(few(0.02), rng.integers(0, 86_400 * 128, n), tod) if "clock" in faults else tod
    if "no time" in faults:
        tod[few(draw(st.sampled_from([0.02, 1.0])))] = -1
    idx = np.cumsum(1 + few(0.03) * rng.integers(0, 50, n)) if "lost" in faults else np.arange(n)
    cell_dur, start_rg, n_cells = np.full(n, CELL_FS), np.zeros(n, np.int64), np.full(n, 4)
    for at in rng.integers(0, n, 2).tolist() if "scale" in faults else ():
        cell_dur[at:] = CELL_FS * int(rng.integers(1, 4))
    if "odd" in faults:
        cell_dur[few(0.02)] = 2 * CELL_FS
    if "cells" in faults:
        n_cells = rng.integers(1, 5, n)
    if "parts" in faults:
        n_cells[:], start_rg[1::2] = 2, 2
        az[1::2] = az[: n // 2 * 2 : 2]
    of = radials(az, width=draw(st.sampled_from([0, TURN // per_turn])), tod=tod, idx=idx, cell_dur=cell_dur,
                 start_rg=start_rg, cell_m=cell_dur * 1.5e-7)  # fmt: skip
    t_ns = (t / 128 * 1e9 + rng.uniform(0, 1e6, n)).astype(np.int64) if "received" in faults else np.full(n, NO_TIME)
    cuts = draw(st.lists(st.integers(1, n), max_size=5, unique=True))
    return replace(of, n_cells=n_cells, t_ns=t_ns), sorted(cut for cut in cuts if cut < n)


@given(spoiled_spins())
@EASY
def test_turns_and_findings_are_those_of_a_run(spoiled: tuple[Radials, list[int]]) -> None:
    of, cuts = spoiled
    told: dict[str, int] = {}
    scans = 0
    for cut in cuts_of(of, cuts):
        scans += cut.turn is not None
        for damage in cut.damage:
            told[damage.code] = told.get(damage.code, 0) + damage.count
    count = counted([batch.radials for batch in batches(of, cuts) if batch.radials is not None])
    assert (count.scans, count.lost, count.odd, count.stray, count.set_back) == (
        scans, *(told.get(code, 0) for code in ("lost-records", "odd-range", "stray-azimuth", "clock-back")),
    )  # fmt: skip


@given(spoiled_spins())
@EASY
def test_where_a_recording_is_cut_changes_nothing(spoiled: tuple[Radials, list[int]]) -> None:
    of, cuts = spoiled
    whole, cut = counted([of]), counted([take(of, rows) for rows in np.split(np.arange(len(of)), cuts)])
    for name in ("scans", "spokes", "repeated", "forward", "backward", "lost", "n_losses", "first_ns", "last_ns",
                 "losses", "changes", "grids", "full_turns", "width"):  # fmt: skip
        assert getattr(whole, name) == getattr(cut, name), name
    assert whole.pauses() == cut.pauses()
    np.testing.assert_array_equal(whole.clock.periods_s(), cut.clock.periods_s())
    np.testing.assert_array_equal(whole.sectors.empty, cut.sectors.empty)


# The quick ways tell what the general reader tells


def walked(path: Path) -> HeaderWalk:
    octets = octets_from_file(path, "")
    final = container_of(octets.head) == FINAL
    make, start = (FinalMake(octets.head), 0) if final else packet_make(octets.head) or (RawMake(), 0)
    walk = HeaderWalk(path, make, start=start)
    assert all(batch.octets == b"" for batch in walk)
    return walk


@pytest.fixture(params=[400, 5000, 1 << 20])
def pieces(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """Files are read in pieces of so many octets."""
    monkeypatch.setattr(blockstarts, "SPAN", request.param)
    monkeypatch.setattr(headers, "MANY_FRAMES", max(request.param // 1000, 1))
    yield request.param


@given(st.data())
@settings(EASY, max_examples=60)
def test_damaged_blocks_are_told_alike(tmp_path: Path, pieces: int, data: st.DataObject) -> None:
    make = data.draw(st.sampled_from([
        lambda i: block(packed_video(i, bytes(range(40)) * 3, tod=500 + i // 4)),
        lambda i: block(video(i, tod=500 + i // 4, azimuth=(i * 1000 % TURN, (i + 1) * 1000 % TURN))),
    ]))  # fmt: skip
    sound = [make(100 + i) for i in range(data.draw(st.integers(0, 100)))]
    path = tmp_path / "x.cat240"
    path.write_bytes(b"".join(sound) + b"".join(data.draw(st.lists(streams(), min_size=1, max_size=3))))
    quick, general = both_ways(path)
    several = isinstance(general, dict) and len(general["sensors"]) > 1 and "23:59:" in str(general)
    assert quick == general or several  # which sensor is first over midnight decides which day is the first


@st.composite
def captures(draw: st.DrawFn) -> bytes:
    """Captures with radar video and whatever else may be in them, whole or damaged."""
    link = draw(st.sampled_from([1, 1, 1, 113, 276, 101, 0]))
    packets: list[bytes | build.Packet] = []
    i = draw(st.integers(0, 100))
    kinds = draw(st.lists(st.sampled_from(KINDS), max_size=3))
    for _ in range(draw(st.integers(1, 12))):
        kind, many = draw(st.sampled_from([*kinds, "video", "video"])), draw(st.integers(1, 20))
        made = packets_of(draw, kind, i, many)
        packets += [one if kind in ("tag", "arp") else build.framed(link, one) for one in made]
        i += many + 2
    order = draw(st.sampled_from("<<>"))
    timed = [replaced(draw, one, at) for at, one in enumerate(packets)]
    if draw(st.booleans()):
        octets = build.pcap(timed, link, order=order, magic=draw(st.sampled_from([0xA1B2C3D4, 0xA1B23C4D, 0xA1B2CD34])))
    else:
        resolution = draw(st.sampled_from([-1, 6, 9]))
        octets = build.section(order=order) + build.interface(link, order=order, resolution=resolution)
        unit_ns = 1 if resolution == 9 else 1000
        octets += b"".join(
            build.enhanced(one.octets, units=one.t_ns // unit_ns, full=one.full, order=order) for one in timed
        )
        octets += draw(st.sampled_from([b"", build.block(5, bytes(8), order=order)]))
    damaged = bytearray(octets)
    for _ in range(draw(st.sampled_from([0, 0, 0, 1, 3]))):
        damaged[draw(st.integers(0, len(octets) - 1))] = draw(st.integers(0, 255))
    return bytes(damaged[: len(octets) - draw(st.sampled_from([0, 0, 0, 1, 5, 20]))])


KINDS = ("zlib", "sensor", "nmea", "several", "summary", "arp", "tcp", "fragments", "source", "odd", "tag", "any")
ODD = (
    b"",
    b"\xf0",
    b"\xf0\0\x10abc",
    block(video(1))[:-3],
    block(video(1)) + b"xyz",
    bytes.fromhex("30000a" + 14 * "0"),
)


def packets_of(draw: st.DrawFn, kind: str, i: int, many: int) -> list[bytes]:
    """IP packets, but for those of Ethernet alone."""

    def made(j: int, sic: int = 2) -> bytes:
        how: dict[str, Any] = {"tod": 500 + j // 4, "sac_sic": (1, sic)}
        return block(video(j, azimuth=(j * 1000 % TURN, (j + 1) * 1000 % TURN), **how))

    if kind in ("video", "sensor", "source"):
        ends = (build.B, build.GROUP) if kind == "source" else (build.A, build.GROUP)
        return [build.ipv4(build.udp(made(i + j, 3 if kind == "sensor" else 2)), addresses=ends) for j in range(many)]
    if kind == "zlib":
        return [build.ipv4(build.udp(block(packed_video(i + j, bytes(99), tod=500)))) for j in range(many)]
    one: dict[str, Any] = {
        "nmea": lambda: build.ipv4(build.udp(b"$GPGGA,123*00\r\n", ports=(4000, 4000))),
        "several": lambda: build.ipv4(build.udp(made(i) + made(i + 1) + made(i + 2))),
        "summary": lambda: build.ipv4(build.udp(block(record({"010": b"\1\2", "000": b"\1", "030": b"\3abc"})))),
        "arp": lambda: build.ethernet(bytes(28), ethertype=0x0806, padded=60),
        "tcp": lambda: build.ipv4(bytes(20), protocol=6),
        "odd": lambda: build.ipv4(build.udp(draw(st.sampled_from(ODD)))),
        "tag": lambda: build.ethernet(build.ipv4(build.udp(made(i))), tags=[0x8100]),
        "any": lambda: build.ipv4(build.udp(draw(st.binary(max_size=12)), ports=(1, draw(st.integers(1, 3))))),
    }
    return build.fragments4(build.udp(made(i)), 24) if kind == "fragments" else [one[kind]()]


def replaced(draw: st.DrawFn, one: bytes | build.Packet, at: int) -> build.Packet:
    octets = one if isinstance(one, bytes) else one.octets
    full = draw(st.sampled_from([-1] * 30 + [2000]))
    return build.Packet(octets, build.T0_NS + at * 10**6, full)


@given(st.data())
@settings(EASY, max_examples=60)
def test_captures_are_told_alike(tmp_path: Path, pieces: int, data: st.DataObject) -> None:
    path = tmp_path / "x.pcap"
    path.write_bytes(data.draw(captures()))
    quick, general = both_ways(path)
    assert quick == general


def final_file(payloads: list[bytes]) -> bytes:
    """Records of two lines that go on for three days."""
    file = io.BytesIO()
    writer = FinalWriter(file)
    step_ns = 3 * 86_400 * 10**9 // max(len(payloads), 1)
    for i, payload in enumerate(payloads):
        line = Stream(f"board-1-line-{1 + i // 50 % 2}")
        writer.write(payload, t_ns=NO_TIME if i % 97 == 96 else 36_000 * 10**9 + i * step_ns, stream=line)
    return file.getvalue()


@given(st.data())
@settings(EASY, max_examples=60)
def test_final_files_are_told_alike(tmp_path: Path, pieces: int, data: st.DataObject) -> None:
    payloads = recording(data.draw(st.floats(0.02, 0.3)))
    for _ in range(data.draw(st.integers(0, 3))):
        place = data.draw(st.integers(0, len(payloads)))
        payloads[place:place] = [data.draw(st.sampled_from([b"", payloads[0] * 2, b"\x30\0\4a", b"\xf0\0\3"]))]
    octets = bytearray(final_file(payloads))
    for _ in range(data.draw(st.integers(0, 2))):
        octets[data.draw(st.integers(200, len(octets) - 1))] = data.draw(st.integers(0, 255))
    path = tmp_path / "x.final"
    path.write_bytes(octets[: len(octets) - data.draw(st.sampled_from([0, 0, 7]))])
    quick, general = both_ways(path)
    assert quick == general


@pytest.mark.parametrize("make", ["raw", "zlib", "pcap", "pcapng", "FINAL"])
def test_a_sound_file_is_walked_through_to_its_end(tmp_path: Path, make: str, pieces: int) -> None:
    blocks = recording(2.0, compress=make == "zlib")
    blocks.insert(100, encode_summary(sac=7, sic=42, text=b"SUM"))
    packets = [build.ethernet(build.ipv4(build.udp(one))) for one in blocks]
    octets = {"raw": b"".join(blocks), "zlib": b"".join(blocks), "pcap": build.pcap(packets),
              "pcapng": build.pcapng(packets), "FINAL": final_file(blocks)}[make]  # fmt: skip
    path = tmp_path / "x"
    path.write_bytes(octets)
    assert walked(path).whole
    quick, general = both_ways(path)
    assert quick == general and isinstance(quick, dict) and quick["records"] == 720


def test_the_sample_is_told_alike() -> None:
    path = ROOT / "data" / "samples" / "harbour.cat240"
    quick, general = both_ways(path)
    assert quick == general and walked(path).whole


@pytest.mark.parametrize("run", ["run_01_005", "run_01_009"])
def test_a_real_recording_is_told_alike_and_its_turns_are_those_of_a_run(run: str) -> None:
    from maritrack.io.containers.capture import open_cat240
    from maritrack.io.turns.assemble import Assembler

    path = next(shared(f"data/marce_solent/{run}").glob("*.cat240"))
    quick, general = both_ways(path)
    assert quick == general and isinstance(quick, dict) and walked(path).whole
    assembler, scans, spokes = Assembler(), 0, []
    recorded = open_cat240(octets_from_file(path, ""), cells=False)
    parts = [batch.radials for batch in recorded.batches() if batch.radials is not None]
    for cut in [*(cut for of in parts for cut in assembler.push(of)), *assembler.finish()]:
        scans += cut.turn is not None
        spokes += [len(cut.turn.t_ns)] if cut.turn is not None else []
    (sensor,) = quick["sensors"]
    assert sensor["scans"] == scans and sensor["period_s"] == pytest.approx(2.5, abs=0.01)
    assert sensor["spokes_per_turn"] == int(np.median(spokes[:-1])) == 720
