"""Recordings from container to container: nothing gets lost, times make sense, parts are the parts asked for."""

from __future__ import annotations

import gzip
import io
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from maritrack.convert import Counts, convert, parse_sensor
from maritrack.errors import InputError, UsageError
from maritrack.io.containers.capture import open_cat240
from maritrack.io.containers.kinds import open_container
from maritrack.io.containers.writers import ENCODERS, RawWriter, open_writer
from maritrack.io.datagrams import NO_TIME, Datagrams, DatagramWriter, Stream
from maritrack.io.dump import dump_recording
from maritrack.io.octets import octets_from_bytes, octets_from_file
from maritrack.io.rewrite.datagram_times import Clock, Span, as_text, parse_window, resolve
from maritrack.io.times import DAY_NS, iso_to_s
from tests.io.cat240_blocks import block, codes, indices, packed_video, read, record, rows, video
from tests.io.test_cat240_equal import streams
from tests.shared import ROOT, shared

S = 10**9
TICKS = 128
SAMPLE = ROOT / "data" / "samples" / "harbour.cat240"
SOLENT = "data/marce_solent/run_01_005/solent_01_005.cat240"
CHAIN = ("one.pcap", "two.final", "three.mcap", "four.cat240")
BROKEN = ("truncated-block", "lost-sync", "block-length<3")
PACKED = ("one.pcap.gz", "two.mcap", "three.final.gz", "four.pcap", "five.cat240.gz", "six.cat240")


@dataclass
class Collected:
    """A writer that keeps what it is given, and holds no more than `largest` octets at once."""

    largest: int = 1 << 30
    payloads: list[bytes] = field(default_factory=list)
    t_ns: list[int] = field(default_factory=list)
    streams: list[Stream] = field(default_factory=list)

    def write(self, payload: bytes, *, t_ns: int, stream: Stream) -> bool:
        if len(payload) > self.largest:
            return False
        self.payloads.append(payload)
        self.t_ns.append(t_ns)
        self.streams.append(stream)
        return True

    def flush(self) -> None:
        pass

    def close(self) -> None:
        pass

    def abort(self) -> None:
        pass


def done(octets: bytes, **how: Any) -> tuple[Collected, Counts]:
    writer = Collected(how.pop("largest", 1 << 30))
    return writer, convert(octets_from_bytes(octets, name="rec", channel=""), writer, **how)


def raw(octets: bytes, **how: Any) -> bytes:
    return b"".join(done(octets, **how)[0].payloads)


def encoding(encoder: Any) -> DatagramWriter:
    """A writer out of what writes a container."""
    encoder.close = encoder.abort = encoder.flush
    return cast(DatagramWriter, encoder)


def dumped(octets: bytes) -> list[dict[str, Any]]:
    return list(dump_recording(octets_from_bytes(octets, name="rec", channel=""), cells=True))


def records_of(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """What the records say, wherever they stand, whenever they came and however their cells are coded."""
    where = ("offset", "received_s", "stream", "compressed", "nbvb", "block", "rep")
    return [{key: value for key, value in row.items() if key not in where} for row in rows if "warning" not in row]


def packed_as(kind: str, datagrams: Sequence[tuple[bytes, int, Stream]]) -> bytes:
    """A container with these datagrams."""
    file = io.BytesIO()
    encoder = ENCODERS[kind](file)
    for payload, t_ns, stream in datagrams:
        assert encoder.write(payload, t_ns=t_ns, stream=stream)
    encoder.finish()
    return file.getvalue()


def through(path: Path, names: Sequence[str], folder: Path, **how: Any) -> Path:
    """A recording from file to file."""
    for name in names:
        writer: DatagramWriter = open_writer(folder / name)
        convert(octets_from_file(path, ""), writer, **how)
        writer.close()
        path = folder / name
    return path


@pytest.fixture(params=["sample", "Solent"])
def recording(request: pytest.FixtureRequest) -> Path:
    return SAMPLE if request.param == "sample" else shared(SOLENT)


@pytest.mark.parametrize("names", [CHAIN, PACKED], ids=["plain", "gzipped"])
def test_a_recording_comes_back_byte_for_byte_through_all_containers(
    recording: Path, names: Sequence[str], tmp_path: Path
) -> None:
    last = through(recording, names, tmp_path, date="2017-11-02")
    assert last.read_bytes() == recording.read_bytes()


def test_containers_are_what_their_names_say(tmp_path: Path) -> None:
    through(SAMPLE, PACKED, tmp_path)
    names = [open_container(octets_from_file(tmp_path / name, "")) for name in PACKED]
    assert [one.name for one in names] == ["pcap", "MCAP", "FINAL", "pcap", "raw", "raw"]
    assert [one.gzipped for one in names] == [True, False, True, False, True, False]


def test_packing_and_unpacking_comes_back_to_the_same_cells(recording: Path) -> None:
    before = recording.read_bytes()
    plain = raw(before, compress=False)
    packed = raw(plain, compress=True, level=1)
    assert len(plain) > 2 * len(packed)
    assert raw(packed, compress=False) == plain
    for one, two in zip(read(before), read(packed), strict=False):
        assert (one.radials is None) == (two.radials is None)
    assert [row[1:10] + row[11:] for row in rows(read(before)[:1])] == [
        row[1:10] + row[11:] for row in rows(read(packed)[:1])
    ][: len(rows(read(before)[:1]))]


def test_what_is_read_out_of_any_container_is_the_same(tmp_path: Path) -> None:
    first = through(SAMPLE, ["a.pcap"], tmp_path, compress=False)
    second = through(first, ["b.mcap", "c.cat240"], tmp_path, compress=True)
    found, expected = read(second.read_bytes()), read(SAMPLE.read_bytes())
    for name in ("idx", "start_az", "tod", "n_cells"):
        columns = [np.concatenate([getattr(b.radials, name) for b in of if b.radials]) for of in (found, expected)]
        np.testing.assert_array_equal(*columns)


def at(seconds: float, idx: int = 1, **how: Any) -> bytes:
    """A data block at a time of day."""
    return block(video(idx, tod=round(seconds * TICKS) % (86_400 * TICKS), **how))


def test_raw_recordings_have_the_time_of_day_of_their_records() -> None:
    octets = at(10) + block(video(2, tod=None)) + at(20.5)
    assert done(octets)[0].t_ns == [10 * S, 10 * S, 20 * S + S // 2]
    day = round(iso_to_s("2017-11-02") * S)
    assert done(octets, date="2017-11-02")[0].t_ns == [day + 10 * S, day + 10 * S, day + 20 * S + S // 2]


def test_what_comes_before_the_first_time_has_that_time() -> None:
    assert done(block(video(1, tod=None)) + at(7))[0].t_ns == [7 * S, 7 * S]
    assert done(block(video(1, tod=None)), date="1970-01-02")[0].t_ns == [DAY_NS]


def test_times_that_are_no_time_of_day_are_passed_over() -> None:
    wrong = block(video(1, tod=86_400 * TICKS))
    assert done(at(5) + wrong + at(6))[0].t_ns == [5 * S, 5 * S, 6 * S]


def test_days_are_counted_at_midnight() -> None:
    seconds = [86_399, 86_400, 86_401, 86_399.5, 86_402, 2 * 86_400 - 50_000, 2 * 86_400 - 1, 2 * 86_400]
    octets = b"".join(at(one, i) for i, one in enumerate(seconds))
    assert done(octets)[0].t_ns == [round(one * S) for one in seconds]


def test_each_sensor_has_its_own_midnight() -> None:
    one, two = {"sac_sic": (1, 1)}, {"sac_sic": (1, 2)}  # the second clock is 13 hours behind
    octets = b"".join(at(86_390 + i, i, **one) + at(86_390 - 13 * 3600 + i, i, **two) for i in range(20))
    found = done(octets)[0].t_ns
    assert found[::2] == [(86_390 + i) * S for i in range(20)]
    assert found[1::2] == [(86_390 + 11 * 3600 + i) * S for i in range(20)]  # the day that brings it nearest


def test_a_sensor_that_joins_after_midnight_is_on_that_day() -> None:
    octets = at(86_399, 1, sac_sic=(1, 1)) + at(86_401, 2, sac_sic=(1, 2))
    assert done(octets)[0].t_ns == [86_399 * S, 86_401 * S]


def test_a_block_of_several_records_has_the_time_of_the_first() -> None:
    octets = block(video(1, tod=9 * TICKS, items={"RE": b"\2a", "SP": b"\3ab"}), video(2, tod=12 * TICKS))
    assert done(octets + at(13))[0].t_ns == [9 * S, 13 * S]
    summary = block(record({"010": b"\1\2", "000": b"\1", "030": b"\3abc", "140": (640).to_bytes(3, "big")}))
    assert done(summary + octets)[0].t_ns == [5 * S, 9 * S]


@given(st.lists(st.tuples(st.integers(0, 2), st.none() | st.integers(0, 86_399)), min_size=1, max_size=30),
       st.integers(1, 9))  # fmt: skip
@settings(derandomize=True, deadline=None, max_examples=100)
def test_times_do_not_depend_on_how_the_recording_is_cut(told: list[tuple[int, int | None]], n: int) -> None:
    blocks = [
        block(video(i, tod=None if s is None else s * TICKS, sac_sic=(1, sic))) for i, (sic, s) in enumerate(told)
    ]
    blocks.insert(0, at(40_000, 99))
    whole, cut = Clock(), Clock()
    t_ns = whole.times(datagrams(blocks)).tolist()
    assert [t for i in range(0, len(blocks), n) for t in cut.times(datagrams(blocks[i : i + n])).tolist()] == t_ns


def datagrams(payloads: Sequence[bytes]) -> Datagrams:
    bounds, n = np.cumsum([0, *map(len, payloads)]), len(payloads)
    return Datagrams(0, b"".join(payloads), bounds, bounds[:-1], np.full(n, NO_TIME), np.zeros(n, dtype=np.int64))


NOON = round(iso_to_s("2017-11-02T12:00:00") * S)
ENDS = Stream("192.0.2.7:4378", "239.192.43.78:4378")


@pytest.mark.parametrize("kind", ["pcap", "mcap"])
def test_receive_times_and_addresses_are_kept(kind: str) -> None:
    sent = [(at(10, i), NOON + i * 1_000_001, ENDS) for i in range(5)]
    found, _ = done(packed_as(kind, sent), date="1999-01-01")
    assert [*zip(found.payloads, found.t_ns, found.streams, strict=True)] == sent


def test_times_without_a_day_get_the_day_that_is_told() -> None:
    sent = packed_as("final", [(at(10, i), NOON + i * S, ENDS) for i in range(5)])
    assert done(sent)[0].t_ns == [43_200 * S + i * S for i in range(5)]
    assert done(sent, date="2017-11-02")[0].t_ns == [NOON + i * S for i in range(5)]


def test_a_datagram_without_receive_time_among_others_has_the_last() -> None:
    times = [NO_TIME, NOON, NO_TIME, NOON + S]
    sent = packed_as("mcap", [(at(10, i), t_ns, ENDS) for i, t_ns in enumerate(times)])
    assert sorted(done(sent)[0].t_ns) == [NOON, NOON, NOON, NOON + S]


DAY, H = 86_400 * S, 3600 * S
EVENING = NOON + 11 * H + H // 2  # 23:30


@pytest.mark.parametrize(
    ("window", "first", "span"),
    [
        ("2017-11-02T12:10:00Z..2017-11-02T12:20", NOON, (NOON + H // 6, NOON + H // 3)),
        ("2017-11-02T13:10:00+01:00..", NOON, (NOON + H // 6, None)),
        ("2017-11-03..", NOON, (NOON + 12 * H, None)),
        ("..2017-11-02T12:00:00.5Z", NOON, (None, NOON + S // 2)),
        ("+60..+120.5", NOON, (NOON + 60 * S, NOON + 120 * S + S // 2)),
        ("+0..", 5 * S, (5 * S, None)),
        ("12:10:00..12:20:00", NOON, (NOON + H // 6, NOON + H // 3)),
        ("12:10..12:20Z", NOON % DAY, (NOON % DAY + H // 6, NOON % DAY + H // 3)),
        ("..12:20", NOON, (None, NOON + H // 3)),
        ("02:30..", NOON, (NOON - 9 * H - H // 2, None)),
        ("00:00..", NOON, (NOON - 12 * H, None)),
        ("00:00..", NOON + H, (NOON + 12 * H, None)),
        ("..11:00", NOON, (None, NOON + 23 * H)),
        ("11:00..", NOON, (NOON - H, None)),
        ("00:00:00..12:20", NOON, (NOON - 12 * H, NOON + H // 3)),
        ("00:10..", EVENING, (EVENING + 2 * H // 3, None)),
        ("00:10..00:20", EVENING, (EVENING + 2 * H // 3, EVENING + 5 * H // 6)),
        ("23:40..00:10", EVENING, (EVENING + H // 6, EVENING + 2 * H // 3)),
        ("2017-11-05T23:00..01:00", NOON, (NOON + 83 * H, NOON + 85 * H)),
        ("+3600..12:30", NOON, (NOON + H, NOON + 24 * H + H // 2)),
        ("..", NOON, (None, None)),
    ],
)  # fmt: skip
def test_a_window_is_where_it_is_said_to_be(window: str, first: int, span: tuple[int | None, int | None]) -> None:
    found = resolve(parse_window(window), first, name="rec")
    assert isinstance(found, Span)
    assert [None if abs(t) == 2**62 else t for t in found] == list(span)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "12:00",
        "12:00-13:00",
        "x..y",
        "+..",
        "+nan..",
        "+-5..",
        "25:00..",
        "12:00+01:00..",
        "2017-13-01..",
        "+1e99x..",
    ],
)
def test_what_is_no_window_is_told(text: str) -> None:
    with pytest.raises(UsageError):
        parse_window(text)


def test_a_window_that_ends_before_it_begins_is_told() -> None:
    with pytest.raises(UsageError):
        resolve(parse_window("2017-11-03..2017-11-02"), NOON, name="rec")


def test_a_day_that_nobody_told_is_asked_for() -> None:
    with pytest.raises(InputError) as caught:
        done(at(10), time_window="2017-11-02T07:00:00..")
    assert "--date" in caught.value.hint
    assert len(done(at(10), time_window="2017-11-02..", date="2017-11-02")[0].payloads) == 1


def test_a_window_begins_with_its_first_moment_and_ends_before_its_last() -> None:
    octets = b"".join(at(100 + i, i) for i in range(10))
    found, counts = done(octets, time_window="+2..+5")
    assert found.t_ns == [102 * S, 103 * S, 104 * S]
    assert (counts.datagrams_in, counts.datagrams_out, counts.dropped["outside-time"]) == (10, 3, 7)
    assert (counts.first_ns, counts.last_ns) == (102 * S, 104 * S)
    assert done(octets, time_window="00:01:42..00:01:45")[0].t_ns == found.t_ns


def test_windows_that_touch_share_nothing_and_miss_nothing() -> None:
    octets = SAMPLE.read_bytes()
    parts = [raw(octets, time_window=window) for window in ("..06:30:40", "06:30:40..+70", "+70..")]
    assert b"".join(parts) == octets and all(parts)


def test_an_empty_window_is_told_with_the_times_of_the_recording() -> None:
    with pytest.raises(InputError, match="from 00:00:10 to 00:00:20"):
        done(at(10) + at(20, 2), time_window="+60..")


def test_records_of_one_sensor_are_taken_out() -> None:
    one, two = {"sac_sic": (1, 2)}, {"sac_sic": (3, 4)}
    octets = b"".join(at(i, i, **(two if i % 2 else one)) for i in range(6)) + block(video(7, **one), video(8, **two))
    found, counts = done(octets, sensor="3-4")
    assert found.payloads == [at(1, 1, **two), at(3, 3, **two), at(5, 5, **two), block(video(8, **two))]
    assert (counts.cut, counts.dropped["other-sensor"], counts.datagrams_out) == (4, 3, 4)
    with pytest.raises(InputError, match=r"no record of sensor 9-9; it has 1-2, 3-4"):
        done(octets, sensor="9-9")


@pytest.mark.parametrize("text", ["", "7", "7-", "7-256", "7-42-1", "a-b", "-1-2", "7 - 42"])
def test_what_is_no_sensor_is_told(text: str) -> None:
    with pytest.raises(UsageError):
        parse_sensor(text)


def test_blocks_of_other_categories_stay_unless_a_sensor_is_asked_for() -> None:
    foreign = bytes.fromhex("30000a00000000000000")
    octets = at(1) + foreign + at(2, 2)
    assert raw(octets) == raw(octets, compress=False) == octets
    assert raw(octets, sensor="1-2") == at(1) + at(2, 2)


def test_one_of_several_streams_is_taken() -> None:
    other = Stream("192.0.2.8:4378", "239.192.43.79:4378")
    sent = [(at(i, i), NOON + i * S, (ENDS, other)[i % 2]) for i in range(6)]
    octets = packed_as("pcap", sent)
    assert len(done(octets)[0].payloads) == 6
    for wanted in (other.source, other.destination, "239.192.43.79", "192.0.2.8"):
        assert done(octets, stream=wanted)[0].streams == [other] * 3
    assert len(done(octets, stream=":4378")[0].payloads) == 6
    with pytest.raises(InputError, match=r"no CAT240 of 10.0.0.1; it has .*239.192.43.78:4378"):
        done(octets, stream="10.0.0.1")


def test_datagrams_of_other_traffic_are_left_out() -> None:
    gps = Stream("192.0.2.9:4000", "239.192.43.78:4000")
    sent = [(b"$GPRMC,1*00\r\n", NOON, gps), (at(1), NOON, ENDS), (b"$GPRMC,2*00\r\n", NOON, gps)]
    assert done(packed_as("pcap", sent))[0].payloads == [at(1)]


def test_a_datagram_that_is_too_large_is_cut_into_its_blocks() -> None:
    blocks = [at(1, i) for i in range(4)]
    sent = packed_as("mcap", [(b"".join(blocks), NOON, ENDS), (at(2), NOON + S, ENDS)])
    found, counts = done(sent, largest=len(blocks[0]))
    assert found.payloads == [*blocks, at(2)] and found.t_ns == [NOON] * 4 + [NOON + S]
    assert (counts.datagrams_out, counts.payload_out, counts.dropped["too-large"]) == (5, 5 * len(blocks[0]), 0)


def test_a_block_that_is_too_large_is_counted_with_its_place() -> None:
    large = block(video(1, cells=bytes(1020)))
    found, counts = done(at(1) + large + at(2, 2), largest=1000)
    assert found.payloads == [at(1), at(2, 2)]
    assert counts.dropped["too-large"] == 1 and counts.warnings["too-large"].first.offset == len(at(1))


def test_unpacked_cells_that_no_udp_datagram_holds_are_counted(tmp_path: Path) -> None:
    octets = at(1) + block(packed_video(2, bytes(65_280), items={"SP": bytes([210] * 210)}))
    writer = open_writer(tmp_path / "out.pcap")
    counts = convert(octets_from_bytes(octets, name="rec", channel=""), writer, compress=False)
    writer.close()
    assert (counts.recoded, counts.dropped["too-large"]) == (1, 1)
    assert raw((tmp_path / "out.pcap").read_bytes()) == at(1)


def test_damage_is_counted_by_code_with_its_first_place() -> None:
    sound, wrong = at(1), block(video(9, cells=b"\x78\x9cnonsense", compressed=True, nbcells=40))
    found, counts = done(sound + wrong + b"junk" + sound + wrong, compress=False)
    assert found.payloads == [sound, wrong, sound, wrong]
    warned = counts.warnings["zlib-error"]
    assert (warned.count, warned.first.offset, warned.sensors) == (2, len(sound) + 3, {"1-2": 2})
    assert counts.warnings["lost-sync"].first.offset == len(sound + wrong)
    assert counts.document()["warnings"]["zlib-error"]["count"] == 2


def test_strict_ends_at_the_first_damage() -> None:
    wrong = block(video(9, cells=b"\x78\x9cnonsense", compressed=True, nbcells=40))
    for how in ({}, {"compress": False}, {"sensor": "1-2"}):
        with pytest.raises(InputError, match=r"rec: .* at byte 3 \(zlib-error\)"):
            done(wrong, strict=True, **how)
    with pytest.raises(InputError, match=rf"at byte {len(at(1))} \(lost-sync\)"):
        done(at(1) + b"junk" + at(2, 2), strict=True)
    assert raw(SAMPLE.read_bytes(), strict=True) == SAMPLE.read_bytes()


@pytest.mark.parametrize("kind", ["raw", "pcap", "mcap"])
@pytest.mark.parametrize(
    "wrong",
    [block(video(9, cells=b"\x78\x9cnonsense", compressed=True, nbcells=40)), block(video(9, res=7)),
     block(video(9, tod=400)), block(video(9, without=["020"])), block(video(8))],
    ids=["cells", "resolution", "time", "item", "again"],
)  # fmt: skip
def test_strict_stops_where_a_strict_run_stops(kind: str, wrong: bytes) -> None:
    made = [(payload, NOON + i, ENDS) for i, payload in enumerate([block(video(8)), wrong, block(video(10))])]
    octets = packed_as(kind, made)
    recording = open_cat240(octets_from_bytes(octets, name="rec", channel=""), strict=True)
    with pytest.raises(InputError) as run:
        list(recording.batches())
    with pytest.raises(InputError) as copy:
        done(octets, strict=True)
    assert str(copy.value) == str(run.value)


def test_strict_looks_at_scans_too() -> None:
    octets = SAMPLE.read_bytes()
    spokes = done(octets)[0].payloads
    lost = b"".join(spokes[:3000] + spokes[3100:])
    with pytest.raises(InputError, match=r"\(lost-records\)"):
        done(lost, strict=True)
    assert raw(lost) == lost


@pytest.mark.parametrize("octets", [b"", b"\0" * 100, gzip.compress(b"nothing", mtime=0)])
def test_what_holds_no_cat240_is_told(octets: bytes) -> None:
    with pytest.raises(InputError, match=r"empty|no CAT240"):
        done(octets)


def test_progress_comes_to_the_end_of_the_input() -> None:
    octets, seen = gzip.compress(SAMPLE.read_bytes()), list[int]()
    done(octets, progress=seen.append)
    assert seen == sorted(seen) and seen[-1] == len(octets)


@given(streams(), st.sampled_from([{}, {"compress": True}, {"compress": False}, {"sensor": "1-2"}]))
@settings(derandomize=True, deadline=None, max_examples=100)
def test_converting_again_changes_nothing_whatever_the_octets_are(octets: bytes, how: dict[str, Any]) -> None:
    try:
        once = raw(octets, **how)
    except InputError:
        return
    assert raw(once, **how) == once


def test_a_hostile_recording_does_not_grow_without_bound() -> None:
    bombs = b"".join(block(packed_video(i, bytes(65_000))) for i in range(2000))
    writer = encoding(RawWriter(io.BytesIO()))
    counts = convert(octets_from_bytes(bombs, name="rec", channel=""), writer, compress=False)
    assert counts.payload_out < 256 * len(bombs) + (5 << 20) and counts.warnings["inflation-budget"].count > 500


def test_times_are_shown_without_a_day_that_is_unknown() -> None:
    assert (as_text(61 * S), as_text(NOON)) == ("00:01:01", "2017-11-02T12:00:00Z")


@pytest.mark.parametrize("kind", ["pcap", "mcap"])
@given(
    st.lists(st.tuples(st.integers(1, 3), st.integers(0, 60), st.binary(max_size=9)), min_size=1, max_size=12),
    st.sampled_from([None, True, False]),
)
@settings(derandomize=True, deadline=None, max_examples=60)
def test_blocks_that_are_there_in_part_do_not_hide_the_next_ones(
    kind: str, sent: list[tuple[int, int, bytes]], compress: bool | None
) -> None:
    """Datagrams of some blocks, the end cut off, and octets that are no block: what is read stays the same."""
    made, idx = list[tuple[bytes, int, Stream]](), 0
    for n, cut, behind in sent:
        blocks = b"".join(at(1, idx + i, cells=bytes([idx]) * 40) for i in range(n))
        made.append((blocks[: len(blocks) - cut] + behind, NOON + idx * S, ENDS))
        idx += n
    octets = packed_as(kind, made)
    before, file = dumped(octets), io.BytesIO()
    try:
        counts = convert(
            octets_from_bytes(octets, name="rec", channel=""), encoding(RawWriter(file)), compress=compress
        )
    except InputError:
        assert records_of(before) == []
        return
    broken = [row for row in before if row.get("warning") in BROKEN]
    assert counts.dropped["incomplete"] == len(broken)
    assert sum(told.count for code, told in counts.warnings.items() if code in BROKEN) == len(broken)
    assert records_of(dumped(file.getvalue())) == records_of(before)


def test_a_recording_of_parts_alone_is_told() -> None:
    octets = packed_as("pcap", [(at(1, i)[:-9], NOON, ENDS) for i in range(3)])
    with pytest.raises(InputError, match="rec: not one data block is whole"):
        convert(octets_from_bytes(octets, name="rec", channel=""), encoding(RawWriter(io.BytesIO())))


def test_a_record_of_one_sensor_does_not_come_out_of_a_part_of_a_block() -> None:
    sent = [(at(1, 1) + at(1, 2)[:30], NOON, ENDS), (at(1, 3), NOON, ENDS)]
    found, counts = done(packed_as("pcap", sent), sensor="1-2")
    assert found.payloads == [at(1, 1), at(1, 3)]
    assert counts.warnings["truncated-block"].count == 1 and counts.dropped["incomplete"] == 0


@given(streams())
@settings(derandomize=True, deadline=None, max_examples=400)
def test_of_a_damaged_recording_all_that_can_be_read_goes_over(octets: bytes) -> None:
    before = records_of(dumped(octets))
    try:
        assert records_of(dumped(raw(octets))) == before
    except InputError:
        assert before == []


@pytest.mark.parametrize("how", ["junk", "cut", "long", "short"])
def test_a_broken_chain_of_blocks_costs_no_record_that_can_be_read(how: str) -> None:
    """Over several windows of the reader; of a block with a wrong LEN the part that was read comes with a right one."""
    good = [block(video(i, cells=bytes([i % 256]) * 400)) for i in range(26_000)]
    broken = {
        "junk": lambda one: bytes(7) + one[5:60], "cut": lambda one: one[:-90],
        "long": lambda one: one[:1] + (len(one) + 70).to_bytes(2, "big") + one[3:],
        "short": lambda one: one[:1] + (len(one) - 70).to_bytes(2, "big") + one[3:],
    }[how]  # fmt: skip
    octets = b"".join(broken(one) if i % 50 == 7 else one for i, one in enumerate(good))
    found, counts = done(octets)
    out, before = b"".join(found.payloads), indices(read(octets))
    assert indices(read(out)) == before and len(before) >= 25_400
    assert "lost-sync" in counts.warnings or "truncated-block" in counts.warnings
    assert how in ("cut", "short") or codes(read(out)) == []
