"""What we write as a capture is read the same by tshark: addresses, times, checksums, and each item of each record."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from maritrack.convert import convert
from maritrack.io.cat240.encode import Record, encode_block
from maritrack.io.cat240.items import read_items
from maritrack.io.containers.writers import open_writer
from maritrack.io.datagrams import Stream
from maritrack.io.octets import octets_from_bytes
from maritrack.io.rewrite.recode import data_blocks
from tests.io.cat240_records import sound_blocks
from tests.io.test_convert import SAMPLE, SOLENT, packed_as, raw
from tests.shared import shared

TSHARK = shutil.which("tshark")
pytestmark = pytest.mark.skipif(TSHARK is None, reason="needs tshark")
OPTIONS = ("-n", "-d", "udp.port==8600,asterix", "-o", "ip.check_checksum:TRUE", "-o", "udp.check_checksum:TRUE")
EASY = settings(
    derandomize=True, deadline=None, max_examples=8, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
PAYLOAD = 42  # octets of Ethernet, IPv4 and UDP before it


class Packet(NamedTuple):
    """What tshark makes of a packet."""

    t_ns: int
    source: str
    destination: str
    records: list[list[tuple[str, int, int, bytes]]]  # items: name, place in the payload, octets, contents


def read_by_tshark(path: Path) -> list[Packet]:
    assert TSHARK is not None
    done = subprocess.run([TSHARK, *OPTIONS, "-r", str(path), "-T", "pdml"], capture_output=True, check=True)
    return [packet_of(one) for one in ElementTree.fromstring(done.stdout).iter("packet")]


def packet_of(packet: Any) -> Packet:
    shown = {field.get("name"): field.get("show") for field in packet.iter("field")}
    assert shown["ip.checksum.status"] == shown["udp.checksum.status"] == "1"
    seconds, _, fraction = shown["frame.time_epoch"].partition(".")
    ends = [f"{shown[f'ip.{end}']}:{shown[f'udp.{end}port']}" for end in ("src", "dst")]
    messages = [one for one in packet.iter("field") if one.get("name") == "asterix.message"]
    return Packet(int(seconds) * 10**9 + int(fraction), *ends, [[*map(item_of, items_in(one))] for one in messages])


def items_in(message: Any) -> list[Any]:
    return [field for field in message if field.get("name") != "asterix.fspec"]


def item_of(field: Any) -> tuple[str, int, int, bytes]:
    """An item; where it is taken apart, its contents are those of its parts that are whole octets."""
    values = [one.get("value", "") for one in field.iter("field") if one.get("unmaskedvalue") is None]
    return (
        field.get("name").removeprefix("asterix.240_"), int(field.get("pos")) - PAYLOAD, int(field.get("size")),
        bytes.fromhex("".join(values)),
    )  # fmt: skip


def expected(payload: bytes) -> list[list[tuple[str, int, int, bytes]]]:
    """The same by our reader of items."""
    records, start = [], 0
    for block in data_blocks(payload):
        at = start + 3
        while at < start + len(block):
            items = read_items(payload, at, start + len(block))
            assert items.trouble is None
            records.append([
                (name, first, last - first, contents(name, payload[first:last]))
                for name, (first, last) in items.span.items()
            ])  # fmt: skip
            at = items.stop
        start += len(block)
    return records


def contents(name: str, octets: bytes) -> bytes:
    """What tshark shows of an item: of 048 only RES is a whole octet, of long items there is the count alone."""
    return {"RE": b"", "SP": b"", "048": octets[1:], "051": octets[:1], "052": octets[:1]}.get(name, octets)


@given(sound_blocks(), st.sampled_from([None, True, False]))
@EASY
def test_records_are_read_item_by_item(tmp_path: Path, blocks: list[list[Record]], compress: bool | None) -> None:
    octets = raw(b"".join(encode_block(records) for records in blocks), compress=compress)
    path = tmp_path / "rec.pcap"
    path.write_bytes(packed_as("pcap", [(one, i, Stream()) for i, one in enumerate(data_blocks(octets))]))
    assert [packet.records for packet in read_by_tshark(path)] == [expected(one) for one in data_blocks(octets)]


def test_a_datagram_of_several_blocks_is_read_with_its_time_and_addresses(tmp_path: Path) -> None:
    blocks = data_blocks(SAMPLE.read_bytes()[:5000])[:-1]
    ends, t_ns = Stream("10.1.2.3:5000", "239.192.43.78:8600"), 1_509_624_000_123_456_789
    path = tmp_path / "rec.pcap"
    path.write_bytes(packed_as("pcap", [(b"".join(blocks[:3]), t_ns, ends), (blocks[3], t_ns + 1, ends)]))
    one, two = read_by_tshark(path)
    assert (one.t_ns, two.t_ns) == (t_ns, t_ns + 1)
    assert (one.source, one.destination) == ends
    assert one.records == expected(b"".join(blocks[:3])) and two.records == expected(blocks[3])


@pytest.mark.parametrize("compress", [None, True, False])
@pytest.mark.parametrize("name", ["sample", "Solent"])
def test_converted_recordings_are_read_the_same(tmp_path: Path, name: str, compress: bool | None) -> None:
    whole = (SAMPLE if name == "sample" else shared(SOLENT)).read_bytes()
    octets = b"".join(data_blocks(whole[:20_000])[:-1])
    path = tmp_path / "rec.pcap"
    writer = open_writer(path)
    convert(octets_from_bytes(octets, name="rec", channel=""), writer, compress=compress, date="2017-11-02")
    writer.close()
    packets, blocks = read_by_tshark(path), data_blocks(raw(octets, compress=compress))
    assert [packet.records for packet in packets] == [expected(one) for one in blocks]
    tod = [next(one for one in packet.records[0] if one[0] == "140")[3] for packet in packets]
    midnight = 1_509_580_800 * 10**9
    assert [packet.t_ns for packet in packets] == [midnight + int.from_bytes(one, "big") * 7_812_500 for one in tod]
