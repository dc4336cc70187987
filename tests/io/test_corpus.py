"""Inputs that are kept, and octets made up on the way, in every container: read without an exception and in bounds."""

from __future__ import annotations

import gzip
import io
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from maritrack.io.cat240 import scan
from maritrack.io.containers.final import FinalWriter
from maritrack.io.containers.mcap_writer import McapWriter
from maritrack.io.containers.pcap_writer import PcapWriter
from tests.fuzz.target import Entry, check, corpus
from tests.io.grams import Gram, write
from tests.io.test_cat240_equal import streams

WRITERS: dict[str, Any] = {"pcap": PcapWriter, "FINAL": FinalWriter, "MCAP": McapWriter}
KEPT = corpus()


@pytest.mark.parametrize("entry", KEPT, ids=[entry.name for entry in KEPT])
def test_what_is_kept_is_read_in_bounds(entry: Entry, monkeypatch: pytest.MonkeyPatch) -> None:
    blocks, parse_block = 0, scan.parse_block

    def counted(*place: Any) -> Any:
        nonlocal blocks
        blocks += 1
        return parse_block(*place)

    monkeypatch.setattr(scan, "parse_block", counted)
    check(entry.octets)
    assert blocks <= 4 * (1 + len(entry.octets) // 3)  # a header each, in a few passes


def test_entries_are_small_and_have_names_and_origins() -> None:
    assert len(KEPT) >= 24
    assert len({entry.name for entry in KEPT}) == len({entry.octets for entry in KEPT}) == len(KEPT)
    assert all(entry.origin and 0 < len(entry.octets) <= 4096 for entry in KEPT)


@st.composite
def recordings(draw: st.DrawFn) -> bytes:
    """Sound and broken records in a container of which some octets are changed, maybe gzipped, maybe cut."""
    file = io.BytesIO()
    kind = draw(st.sampled_from(["raw", *sorted(WRITERS)]))
    grams = [Gram(octets) for octets in draw(st.lists(streams(), min_size=1, max_size=4)) if octets]
    if kind == "raw":
        file.write(b"".join(gram.payload for gram in grams))
    else:
        writer = WRITERS[kind](file)
        write(writer, [gram for gram in grams if len(gram.payload) < 60_000])
        writer.finish()
    octets = bytearray(file.getvalue())
    for _ in range(draw(st.integers(0, 3))):
        if octets:
            octets[draw(st.integers(0, len(octets) - 1))] = draw(st.integers(0, 255))
    packed = gzip.compress(octets, mtime=0) if draw(st.booleans()) else bytes(octets)
    return packed[: len(packed) - draw(st.sampled_from([0, 0, 1, 30]))]


@given(recordings())
@settings(derandomize=True, deadline=None, max_examples=60)
def test_records_in_containers_with_wrong_octets_are_read(octets: bytes) -> None:
    check(octets)
