"""Records of every kind that the category has, for tests of what writes and recodes them."""

from __future__ import annotations

import zlib
from typing import Any

import numpy as np
from hypothesis import strategies as st

from maritrack.io.cat240.cells import unpack
from maritrack.io.cat240.encode import COMPRESSED, RES_OF_BITS, SUMMARY, VIDEO, VIDEO_ITEMS, Header, Record

U16, U24, U32 = 2**16 - 1, 2**24 - 1, 2**32 - 1
OCTETS = {"low": 4, "medium": 64, "high": 256}
ITEM_OF_FIELD = {
    "source": "010", "kind": "000", "idx": "020", "text": "030", "nano": "040", "femto": "041", "form": "048",
    "counts": "049", "low": "050", "medium": "051", "high": "052", "tod": "140", "re": "RE", "sp": "SP",
}  # fmt: skip


def maybe(values: st.SearchStrategy[Any]) -> st.SearchStrategy[Any]:
    return st.none() | values


def repeated(size: int) -> st.SearchStrategy[bytes]:
    return st.integers(0, 3).map(lambda rep: (bytes(range(256)) * 3)[: rep * size])


HEADERS = st.builds(Header, *(st.integers(0, U16),) * 2, *(st.integers(0, U32),) * 2)
ANY_RECORDS = st.builds(
    Record,
    source=maybe(st.tuples(st.integers(0, 255), st.integers(0, 255))), kind=maybe(st.integers(0, 255)),
    idx=maybe(st.integers(0, U32)), text=maybe(st.binary(max_size=255)), nano=maybe(HEADERS), femto=maybe(HEADERS),
    form=maybe(st.tuples(st.integers(0, 255), st.integers(0, 255))),
    counts=maybe(st.tuples(st.integers(0, U16), st.integers(0, U24))),
    **{name: maybe(repeated(size)) for name, size in OCTETS.items()},
    tod=maybe(st.integers(0, U24)), re=maybe(st.binary(max_size=254)), sp=maybe(st.binary(max_size=254)),
).filter(lambda record: record != Record())  # fmt: skip


@st.composite
def videos(draw: st.DrawFn, idx: int = 0, tod: int | None = None) -> Record:
    """A video record that a reader has nothing to say about, with spare bits and padding that it has to pass over."""
    bits, compress = draw(st.sampled_from([1, 2, 4, 8, 16, 32])), draw(st.booleans())
    octets = draw(st.sampled_from([0, 1, 7, 60, 1000, 1020, 1021, 4000]))
    n = max(0, octets * 8 // bits - draw(st.integers(0, 3)))
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    packed = rng.integers(0, draw(st.sampled_from([2, 256])), n * bits + 7 >> 3, dtype=np.uint8).tobytes()
    body = zlib.compress(packed, draw(st.sampled_from([0, 6, 9]))) if compress else packed
    roomy = [name for name, size in OCTETS.items() if len(body) <= 255 * size]
    name = draw(st.sampled_from(roomy))
    spare = draw(st.integers(0, min(3, 255 - -(-len(body) // OCTETS[name]))))
    room = (-(-len(body) // OCTETS[name]) + spare) * OCTETS[name]
    start_az = draw(st.integers(0, U16))
    header = Header(
        start_az, (start_az + draw(st.integers(0, 32_768))) & U16, draw(st.integers(0, U32)), draw(st.integers(1, U32))
    )
    femto = draw(st.booleans())
    return Record(
        source=draw(st.tuples(st.integers(0, 2), st.integers(0, 255))), kind=VIDEO, idx=idx,
        nano=None if femto else header, femto=header if femto else None,
        form=(COMPRESSED * compress | draw(st.integers(0, 127)), RES_OF_BITS[bits]), counts=(len(body), n),
        **{name: body + rng.bytes(room - len(body))}, tod=tod, re=draw(maybe(st.binary(max_size=20))),
        sp=draw(maybe(st.binary(max_size=20))),
    )  # fmt: skip


@st.composite
def summaries(draw: st.DrawFn, tod: int | None = None) -> Record:
    text = bytes(octet & 0x7F for octet in draw(st.binary(max_size=255)))
    source = draw(st.tuples(st.integers(0, 2), st.integers(0, 255)))
    return Record(source=source, kind=SUMMARY, text=text, tod=tod, sp=draw(maybe(st.binary(max_size=5))))


@st.composite
def sound_blocks(draw: st.DrawFn) -> list[list[Record]]:
    """Records of data blocks that follow each other, without anything to warn of."""
    blocks, idx, tod = [], 0, draw(st.integers(0, 1000))
    for _ in range(draw(st.integers(1, 6))):
        records = []
        for _ in range(draw(st.sampled_from([1, 1, 1, 2, 3]))):
            tod += draw(st.integers(0, 300))
            idx += 1
            when = draw(maybe(st.just(tod)))
            records.append(draw(st.one_of(videos(idx=idx, tod=when), videos(idx=idx, tod=when), summaries(tod=when))))
        blocks.append(records)
    return blocks


def cells_of(record: Record) -> list[int]:
    """The cells that the record stands for."""
    assert record.form is not None and record.counts is not None
    bits, n = 1 << record.form[1] - 1, record.counts[1]
    body = next(octets for octets in (record.low, record.medium, record.high) if octets is not None)
    packed = body[: record.counts[0]]
    packed = zlib.decompress(packed) if record.form[0] & COMPRESSED else packed
    cells: list[int] = unpack(np.frombuffer(packed, dtype=np.uint8)[None, :], bits=bits, n=n)[0].tolist()
    return cells


def row_of(record: Record) -> dict[str, Any]:
    """What `dump` has to show of a sound record, apart from what it computes and its place."""
    assert record.source is not None
    row: dict[str, Any] = {"type": record.kind, "sac": record.source[0], "sic": record.source[1]}
    if record.kind == VIDEO:
        header = record.nano or record.femto
        assert header is not None and record.form is not None and record.counts is not None
        item, body = next(
            (ITEM_OF_FIELD[name], getattr(record, name)) for name in OCTETS if getattr(record, name) is not None
        )
        row |= {
            "idx": record.idx, "header": "nano" if record.nano else "femto", **header._asdict(),
            "compressed": record.form[0] >= COMPRESSED, "res": record.form[1], "nbvb": record.counts[0],
            "nbcells": record.counts[1], "block": item, "rep": len(body) // VIDEO_ITEMS[item].octets,
            "cells": cells_of(record),
        }  # fmt: skip
    vendor = {
        name: None if octets is None else octets.hex()
        for name, octets in (("re_hex", record.re), ("sp_hex", record.sp))
    }
    tail = {"tod": record.tod, **vendor}
    return row | {name: value for name, value in tail.items() if value is not None}
