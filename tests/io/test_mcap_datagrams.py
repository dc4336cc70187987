"""Datagrams in MCAP: other programs read what is written, what other programs write is read, damage costs its chunk."""

from __future__ import annotations

import io
import random
import struct
import sys
import zlib
from collections.abc import Sequence
from pathlib import Path

import lz4.frame
import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from maritrack.io.containers import mcap_datagrams, mcap_writer
from maritrack.io.containers.mcap_datagrams import McapReader
from maritrack.io.containers.mcap_writer import McapWriter
from maritrack.io.datagrams import NO_TIME, Stream
from tests.io.grams import START_NS, STREAMS, Gram, Read, cuts, grown_mb, pieces, read, videos, write
from tests.io.grams import payloads as payload_strategy

MAGIC = b"\x89MCAP0\r\n"
gram_lists = st.lists(
    st.builds(
        Gram, payload_strategy, st.one_of(st.just(NO_TIME), st.integers(NO_TIME + 1, 2**63 - 1)),
        st.sampled_from([*STREAMS, Stream(), Stream("", "239.0.1.2:8600"), Stream("board-1-line-2", "")]),
    ),
    max_size=25,
)  # fmt: skip


def written(grams: Sequence[Gram], *, flush_every: int = 0, finish: bool = True) -> bytes:
    file = io.BytesIO()
    writer = McapWriter(file)
    for i, gram in enumerate(grams):
        write(writer, [gram])
        if flush_every and (i + 1) % flush_every == 0:
            writer.flush()
    if finish:
        writer.finish()
    return file.getvalue()


def read_mcap(octets: bytes, sizes: Sequence[int] = ()) -> Read:
    got = read(McapReader(pieces(octets, sizes)))
    assert got.end == len(octets)
    return got


@settings(derandomize=True, deadline=None, max_examples=100)
@given(gram_lists, st.integers(0, 5), cuts)
def test_what_is_written_is_read(grams: list[Gram], flush_every: int, sizes: list[int]) -> None:
    got = read_mcap(written(grams, flush_every=flush_every), sizes)
    assert (got.grams, got.damage) == (grams, [])


def test_equal_datagrams_make_equal_octets() -> None:
    grams = [Gram(payload, START_NS + i, STREAMS[i % 4]) for i, payload in enumerate(videos(100))]
    assert written(grams) == written(grams)


def test_the_mcap_library_reads_what_is_written() -> None:
    streams = [*STREAMS, Stream(), Stream("", "239.0.1.2:8600")]
    grams = [Gram(payload, START_NS + i // 2, streams[i % 6]) for i, payload in enumerate(videos(90))]
    grams.append(Gram(b"late", NO_TIME, STREAMS[0]))
    reader = make_reader(io.BytesIO(written(grams)), validate_crcs=True)
    got = list(reader.iter_messages(log_time_order=False))
    assert [(message.data, message.log_time, message.publish_time) for _, _, message in got] == [
        (gram.payload, t_ns, t_ns)
        for gram, t_ns in zip(grams, [START_NS + min(i, 89) // 2 for i in range(91)], strict=True)
    ]
    assert {(schema, channel.message_encoding) for schema, channel, _ in got} == {(None, "x-asterix-cat240")}
    assert [message.sequence for _, channel, message in got if channel.id == 1] == list(range(15))
    topics = {channel.topic: channel.metadata for _, channel, _ in got}
    assert topics == {
        "/asterix/239.0.1.2:8600": {"source": "10.0.0.7:5000", "destination": "239.0.1.2:8600"},
        "/asterix/239.0.1.2:8600/2": {"source": "10.0.0.8:5000", "destination": "239.0.1.2:8600"},
        "/asterix/[ff02::5]:65535": {"source": "[fe80::1]:1", "destination": "[ff02::5]:65535"},
        "/asterix/10.1.2.3:4378": {"source": "192.168.1.255:0", "destination": "10.1.2.3:4378"},
        "/asterix/cat240": {"source": "", "destination": ""},
        "/asterix/239.0.1.2:8600/3": {"source": "", "destination": "239.0.1.2:8600"},
        "/asterix/239.0.1.2:8600/4": {"source": "10.0.0.7:5000", "destination": "239.0.1.2:8600", "time": "none"},
    }
    records = {record.name: record.metadata for record in reader.iter_metadata()}
    assert records["maritrack.recording"] == {"format": "maritrack-datagrams/1"}


@pytest.mark.parametrize("packing", [CompressionType.NONE, CompressionType.LZ4, CompressionType.ZSTD, None])
def test_what_other_programs_write_is_read(packing: CompressionType | None) -> None:
    file = io.BytesIO()
    how, chunked = packing or CompressionType.NONE, packing is not None
    writer = Writer(file, chunk_size=2000, compression=how, use_chunking=chunked, enable_data_crcs=True)
    writer.start()
    schema = writer.register_schema("text", "jsonschema", b"{}")
    other, mine = writer.register_channel("/text", "json", schema), writer.register_channel("/radar", "", 0)
    for i, payload in enumerate(videos(100)):
        writer.add_message(other, i, b"{}", i)
        writer.add_message(mine, START_NS + i, payload, START_NS)
        if i == 50:
            writer.add_attachment(0, 0, "film", "video/mp4", random.Random(1).randbytes(3_000_000))
    writer.finish()  # type: ignore[no-untyped-call]
    octets = file.getvalue()
    got = read_mcap(octets)
    assert (got.grams, got.damage) == (
        [Gram(payload, START_NS + i, Stream("", "/radar")) for i, payload in enumerate(videos(100))], []
    )  # fmt: skip
    if packing in (CompressionType.NONE, None):
        assert [octets[at : at + len(p)] for at, p in zip(got.offsets, got.payloads, strict=True)] == got.payloads
    else:
        assert {octets[at] for at in got.offsets} == {6}


def test_a_recording_that_was_killed_gives_what_was_flushed() -> None:
    grams = [Gram(payload, START_NS + i, STREAMS[i % 2]) for i, payload in enumerate(videos(25))]
    octets = written(grams, flush_every=10, finish=False)
    got = read_mcap(octets)
    assert (got.grams, got.codes) == (grams[:20], ["archive-truncated"])


def chunks_of(octets: bytes) -> list[tuple[int, int]]:
    """Begin and end of each chunk record."""
    found, at = [], 8
    while octets[at] != 2:  # the footer
        end = at + 9 + struct.unpack_from("<Q", octets, at + 1)[0]
        found += [(at, end)] * (octets[at] == 6)
        at = end
    return found


GRAMS = [Gram(payload, START_NS + i if i % 5 else NO_TIME, STREAMS[i % 3]) for i, payload in enumerate(videos(60))]


@settings(derandomize=True, deadline=None, max_examples=60)
@given(st.integers(9, len(written(GRAMS, flush_every=10)) - 1))
def test_a_file_cut_anywhere_gives_the_datagrams_of_its_whole_chunks(size: int) -> None:
    octets = written(GRAMS, flush_every=10)
    got = read_mcap(octets[:size])
    assert got.grams == GRAMS[: 10 * sum(end <= size for _, end in chunks_of(octets))]
    assert set(got.codes) == {"archive-truncated"}


@settings(derandomize=True, deadline=None, max_examples=150)
@given(st.integers(0, 2**32), cuts)
def test_a_changed_octet_costs_at_most_its_chunk_and_is_never_believed(seed: int, sizes: list[int]) -> None:
    rng, octets = random.Random(seed), bytearray(written(GRAMS, flush_every=10))
    at = rng.randrange(8, chunks_of(octets)[-1][1])
    octets[at] ^= 1 << rng.randrange(8)
    got = read_mcap(bytes(octets), sizes)
    assert got.damage
    assert [gram for gram in GRAMS if gram in got.grams] == got.grams
    assert len(got.grams) >= len(GRAMS) - 10


@pytest.mark.parametrize("chunk", [0, 2, 5])
@pytest.mark.parametrize("place", [0, 1, 4, 8, 9 + 24, 9 + 30, 9 + 33, 9 + 38, 60], ids=str)
def test_a_spoiled_chunk_costs_its_own_datagrams_only(chunk: int, place: int) -> None:
    octets = bytearray(written(GRAMS, flush_every=10))
    octets[chunks_of(octets)[chunk][0] + place] ^= 0x55
    got = read_mcap(bytes(octets))
    assert got.grams == GRAMS[: 10 * chunk] + GRAMS[10 * chunk + 10 :]
    assert got.codes[0] in ("archive-chunk", "archive-truncated" if chunk == 5 else "archive-record")


def test_a_channel_that_is_nowhere_described_is_read_and_told() -> None:
    octets = MAGIC + message(7, b"x") * 3
    got = read_mcap(octets)
    assert got.grams == [Gram(b"x", 0, Stream("", "channel-7"))] * 3
    assert got.codes == ["archive-record", "archive-truncated"]


def record(opcode: int, content: bytes, *, length: int | None = None) -> bytes:
    return bytes([opcode]) + struct.pack("<Q", len(content) if length is None else length) + content


def chunk_record(data: bytes, *, size: int | None = None, packed: bytes | None = None, how: bytes = b"zstd") -> bytes:
    if packed is None:
        packed = {b"zstd": zstandard.compress, b"lz4": lz4.frame.compress, b"": bytes}[how](data)
    head = struct.pack("<QQQI", 0, 0, len(data) if size is None else size, zlib.crc32(data))
    return record(6, head + struct.pack("<I", len(how)) + how + struct.pack("<Q", len(packed)) + packed)


def message(channel: int, data: bytes, *, length: int | None = None) -> bytes:
    return record(5, struct.pack("<HIQQ", channel, 0, 0, 0) + data, length=length)


def channel(id_: int, topic: bytes) -> bytes:
    return record(4, struct.pack("<HHI", id_, 0, len(topic)) + topic + bytes(8))


HOSTILE = {
    "record longer than the file": record(5, b"", length=2**63),
    "small record longer than the file": record(7, b"", length=2**24),
    "record of no kind": record(0, b"x"),
    "private record": record(200, b"x" * 100),
    "chunk that promises a terabyte": chunk_record(b"x", size=2**40),
    "zstd that promises more than the chunk": chunk_record(b"x", size=1, packed=zstandard.compress(bytes(10**7))),
    "lz4 that promises less than it holds": chunk_record(b"x", packed=lz4.frame.compress(bytes(10**7)), how=b"lz4"),
    "zstd of noise": chunk_record(b"x", packed=b"\x28\xb5\x2f\xfd" + bytes(range(200))),
    "lz4 of noise": chunk_record(b"x", packed=b"\x04\x22\x4d\x18" + bytes(range(200)), how=b"lz4"),
    "lz4 of nothing": chunk_record(b"x", packed=b"", how=b"lz4"),
    "chunk that ends in a record": chunk_record(channel(9, b"/x") + b"\5\5"),
    "message longer than its chunk": chunk_record(message(1, b"", length=2**63)),
    "message shorter than its head": chunk_record(record(5, b"\x01\x00")),
    "channel with a name of four gigabytes": chunk_record(record(4, struct.pack("<HHI", 9, 0, 2**32 - 1))),
    "channel with a name that is no text": chunk_record(channel(9, b"\xff\xff")),
    "channel of a megabyte": chunk_record(channel(9, bytes(10**6))),
    "metadata that are no table": record(12, struct.pack("<I", 2**31) + b"x"),
    "metadata of a channel without number": record(12, struct.pack("<I", 17) + b"maritrack.channel" + bytes(4)),
    "octets that are no record": random.Random(1).randbytes(500),
}  # fmt: skip


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_record_is_damage_and_costs_nothing_else(name: str) -> None:
    octets = written(GRAMS, flush_every=10)
    for place in (8, chunks_of(octets)[2][0]):
        hostile = octets[:place] + HOSTILE[name] + octets[place:]
        got = read_mcap(hostile)
        assert got.grams == GRAMS
        assert got.damage
        for sizes in ([1000], [7, 40_000]):
            assert read_mcap(hostile, sizes) == got


def untimed(id_: int) -> bytes:
    table = b"".join(struct.pack("<I", len(text)) + text for text in (b"time", b"none"))
    return record(4, struct.pack("<HHI", id_, 0, 2) + b"/u" + bytes(4) + struct.pack("<I", len(table)) + table)


def foreign(id_: int) -> bytes:
    return record(4, struct.pack("<HHI", id_, 1, 2) + b"/f" + bytes(8))


PARTS = st.one_of(
    st.tuples(st.integers(1, 6), st.binary(max_size=40), st.integers(1, 30)).map(lambda a: message(a[0], a[1]) * a[2]),
    st.integers(1, 6).map(lambda id_: channel(id_, b"/%d" % id_)), st.integers(1, 6).map(untimed),
    st.integers(1, 6).map(foreign),
    st.sampled_from([record(7, b"xy"), record(5, b"\1\0"), b"\5\5", message(1, b"", length=99)]),
)  # fmt: skip


@given(st.lists(st.lists(PARTS, max_size=12).map(b"".join), max_size=4), st.integers(2, 50), st.integers(20, 2000))
@settings(derandomize=True, deadline=None)
def test_messages_taken_together_are_those_taken_one_by_one(chunks: list[bytes], batch: int, octets: int) -> None:
    file = MAGIC + b"".join(chunk_record(data, how=(b"zstd", b"")[i % 2]) for i, data in enumerate(chunks))
    found = []
    for few in (1, 10**9):
        with pytest.MonkeyPatch.context() as patch:
            for name, value in (("FEW", few), ("BATCH", batch), ("BATCH_OCTETS", octets)):
                patch.setattr(mcap_datagrams, name, value)
            reader = McapReader([file])
            grams = [
                (one.end, one.data, *(column.tolist() for column in (one.bounds, one.offset, one.t_ns, one.stream)),
                 one.damage) for one in reader.datagrams()
            ]  # fmt: skip
            found.append((grams, reader.streams))
    assert found[0] == found[1]


def test_without_chunks_a_broken_record_costs_a_few_messages() -> None:
    file, payloads = io.BytesIO(), videos(400)
    writer = Writer(file, use_chunking=False)
    writer.start()
    radar = writer.register_channel("/radar", "", 0)
    for i, payload in enumerate(payloads):
        writer.add_message(radar, START_NS + i, payload, START_NS + i)
    writer.finish()  # type: ignore[no-untyped-call]
    octets = bytearray(file.getvalue())
    place = octets.index(payloads[100]) - 22 - 9
    octets[place : place + 9] = b"\xee" * 9
    got = read_mcap(bytes(octets))
    assert got.codes == ["archive-record"]
    assert got.payloads[:99] == payloads[:99] and got.payloads[-290:] == payloads[-290:]
    for sizes in ([1000], [7, 40_000]):
        assert read_mcap(bytes(octets), sizes) == got


def test_octets_behind_the_end_are_told() -> None:
    octets = written(GRAMS)
    got = read_mcap(octets + b"more")
    assert (got.grams, [(one.code, one.offset) for one in got.damage]) == (GRAMS, [("archive-record", len(octets))])


def test_a_stream_that_is_no_mcap_gives_nothing() -> None:
    for octets in (b"", MAGIC[:5], MAGIC, bytes(3_000_000), random.Random(2).randbytes(100_000)):
        got = read_mcap(octets)
        assert (got.grams, len(got.damage) > 0) == ([], True)


def test_a_large_datagram_and_many_small_ones_come_in_bounded_portions() -> None:
    grams = [Gram(bytes(9_000_000)), *[Gram(b"x")] * 40_000, Gram(bytes(3_000_000)), Gram(bytes(3_000_000))]
    octets, portions = written(grams), []
    for d in McapReader([octets]).datagrams():
        portions.append((len(d), len(d.data)))
    assert sum(n for n, _ in portions) == len(grams)
    assert max(n for n, _ in portions) <= 16_384
    assert max(size for _, size in portions) < 9_000_000 + 16_384


def test_more_streams_than_channels_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mcap_writer, "MAX_CHANNEL", 300)  # as with 65,535, but sooner
    file = io.BytesIO()
    writer = McapWriter(file)
    fits = [writer.write(b"", t_ns=0, stream=Stream(str(i))) for i in range(302)]
    assert fits == [True] * 300 + [False] * 2
    writer.finish()
    assert len(read_mcap(file.getvalue()).grams) == 300


def cycle(part: bytes) -> bytes:
    """About four megabytes of it."""
    return MAGIC + part * (4_000_000 // len(part))


NAME = "\U0001f600".encode() * 100
HOSTILE_FILES = {
    "tiny chunks": lambda: cycle(chunk_record(b"")),
    "broken chunks": lambda: cycle(chunk_record(b"", packed=b"x")),
    "broken records": lambda: cycle(b"\xff" + chunk_record(b"")),
    "messages outside chunks": lambda: cycle(message(1, b"")),
    "one large message a chunk": lambda: cycle(chunk_record(message(1, bytes(33_000_000)))),
    "many messages a chunk": lambda: cycle(chunk_record(message(1, b"") * 1_000_000)),
    "many records a chunk": lambda: cycle(chunk_record(record(7, b"") * 3_000_000)),
    "channels": lambda: cycle(chunk_record(b"".join(channel(i, NAME) + message(i, b"") for i in range(65_536)))),
    "one large chunk": lambda: MAGIC + chunk_record(random.Random(1).randbytes(9_900_000), how=b""),
    "private records": lambda: cycle(record(200, b"")),
}  # fmt: skip
PROGRAM = """
import sys
from pathlib import Path
from maritrack.io.containers.mcap_datagrams import McapReader
from maritrack.io.octets import FileChunks
from tests.io.grams import peak_mb
before = peak_mb()
for d in McapReader(FileChunks(Path(sys.argv[1]))).datagrams():
    end = d.end
print(end, peak_mb() - before)
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="peak memory is read from /proc")
@pytest.mark.parametrize("kind", HOSTILE_FILES)
def test_hostile_mcap_takes_little_memory(kind: str, tmp_path: Path) -> None:
    file = tmp_path / "hostile.mcap"
    file.write_bytes(HOSTILE_FILES[kind]())
    octets, grown = grown_mb(PROGRAM, str(file))
    assert octets == file.stat().st_size
    assert grown < 190
