"""Inputs that are made to cost much: the work that they cause is bounded, and what is sound in them is read."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np
import pytest

from maritrack.io.cat240 import cutting, reader, scan
from maritrack.io.cat240.exact import parse_block
from maritrack.io.cat240_source import MAX_TOLD, Cat240Source, _Told
from maritrack.io.octets import octets_from_bytes
from maritrack.io.turns import turnbounds
from maritrack.io.turns.assemble import Assembler
from maritrack.settings import InputConfig
from maritrack.survey import survey
from maritrack.types import Damage, Frame
from tests.io.cat240_blocks import SENTINEL, damage, indices, radials, read, rows
from tests.io.hostile import CASES
from tests.io.hostile_turns import TURNS

SIZE = 150_000
TINY = (
    "summaries, one a block", "summaries, thousands a block", "videos that lack all they can",
    "bad records, two kinds, one a block", "bad records of many sensors", "unknown types, four a block",
    "other and empty blocks in turn", "decoys with a short LEN", "blocks and an octet", "blocks that are one too long",
)  # fmt: skip
SCANS = (
    "another depth of cells each time", "another resolution every fiftieth time", "a turn every second spoke",
    "a turn every ninth spoke", "azimuths without order", "a silence before every second spoke", "days",
    "two wide radials in a hundred", "sixty sensors in turn",
)  # fmt: skip


def frames(octets: bytes) -> list[Frame]:
    source = Cat240Source(octets_from_bytes(octets, name="x", channel="/input/cat240"), InputConfig())
    return list(source.frames())


def told(some: list[Frame]) -> Counter[str]:
    counts = Counter[str]()
    for frame in some:
        for one in frame.damage:
            counts[one.code] += one.count
    return counts


@pytest.mark.parametrize("kind", TINY)
def test_few_records_are_read_one_by_one_and_the_sound_one_at_the_end(
    kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(scan, "EFFORT_FLOOR", 100)
    read_exactly = 0

    def counted(*place: Any) -> Any:
        nonlocal read_exactly
        block = parse_block(*place)
        read_exactly += len(block.videos) + len(block.summaries) + len(block.damage)
        return block

    monkeypatch.setattr(scan, "parse_block", counted)
    octets = CASES[kind](SIZE)
    batches = read(octets)
    most_of_a_block = 65_532 // 4  # that is begun while there is effort left is read to its end
    assert read_exactly <= 100 + SIZE // scan.EFFORT_OCTETS + most_of_a_block
    assert indices(batches)[-1:] == [999]
    assert "effort-budget" in [one[0] for one in damage(batches)]
    assert sum(len(batch.octets) for batch in batches) == len(octets)


@pytest.mark.parametrize("kind", ["blocks and an octet", "bad records at the beginning of each block", "octets"])
def test_without_effort_left_the_usual_radials_are_read_wherever_they_stand(
    kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    usual = TURNS["spokes of four octets"](20_000)
    octets = b"".join(CASES[kind](n) + usual for n in (3000, 40_000, 70_000, 300_000))
    exact = read(octets)
    monkeypatch.setattr(scan, "EFFORT_FLOOR", 10)
    quick, in_pieces = read(octets), read(octets, chunk=100_000)
    assert {row[3] for row in rows(exact)} == {row[3] for row in rows(quick)}
    assert len(rows(quick)) > 4 * 500
    assert rows(in_pieces) == rows(quick)
    assert sum(one[4] for one in damage(in_pieces)) == sum(one[4] for one in damage(quick))


def test_radials_of_changing_resolution_share_batches() -> None:
    found = radials(read(TURNS["another resolution every second time"](SIZE)))
    assert sum(map(len, found)) > 3000
    assert len(found) <= 3


def test_wide_radials_among_narrow_ones_are_not_filled_up_to_many_times_their_size() -> None:
    found = radials(read(TURNS["one wide radial in fifty"](20_000)))
    sent = sum(int((of.n_cells * (of.bits >> 3)).sum()) for of in found)
    assert sum(of.cells.nbytes for of in found) <= 4 * sent + len(found) * (4 << 20)


@pytest.mark.parametrize("kind", ["another depth of cells each time", "a silence before each spoke"])
def test_turns_cut_off_again_and_again_are_told_together(kind: str) -> None:
    assembler = Assembler()
    cuts = [cut for of in radials(read(TURNS[kind](SIZE))) for cut in assembler.push(of)]
    spokes = sum(one.count for cut in cuts for one in cut.damage if one.code == "short-scan")
    assert spokes > 3000
    assert len(cuts) < 20


@pytest.mark.parametrize("kind", SCANS)
def test_turns_of_a_few_spokes_are_few_and_show_counts_the_same(kind: str) -> None:
    octets = TURNS[kind](SIZE)
    spokes = sum(map(len, radials(read(octets))))
    scans = len(frames(octets))
    sensors = 60 if "sixty" in kind else 1
    free = sum(turnbounds.FREE_SCANS // k for k in range(1, sensors + 1))
    assert scans <= free + spokes // turnbounds.LEAST_SPOKES + sensors
    assert survey(octets_from_bytes(octets, name="x", channel="/input/cat240"))["scans"] == scans


def test_the_cells_of_turns_are_bounded_by_the_size_of_the_input(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(turnbounds, "BUDGET_FLOOR", 1 << 20)
    octets = TURNS["two wide radials in a turn of nine"](100_000)
    some = frames(octets)
    held = sum(frame.scan.video.intensity.nbytes for frame in some if frame.scan.video is not None)
    assert 0 < held <= (1 << 20) + 256 * len(octets)
    assert told(some)["turn-budget"] > 0


def test_streams_that_fail_are_inflated_once(monkeypatch: pytest.MonkeyPatch) -> None:
    tried, start_cells, exact_cells = 0, reader.start_cells, reader.exact_cells

    def started(w: Any, some: Any, *place: Any, **how: Any) -> Any:
        nonlocal tried
        tried += int(np.count_nonzero(some["compressed"]))
        return start_cells(w, some, *place, **how)

    def exactly(*place: Any) -> Any:
        nonlocal tried
        tried += 1
        return exact_cells(*place)

    monkeypatch.setattr(cutting, "INFLATION_RATIO", 2000)
    monkeypatch.setattr(reader, "start_cells", started)
    monkeypatch.setattr(reader, "exact_cells", exactly)
    bad = CASES["zlib, wrong checksums"](SIZE)
    found = damage(read(bad))
    assert found[0][0] == "zlib-error"
    assert found[0][4] >= 250
    assert tried <= found[0][4] + 64  # the first batch twice
    sound = CASES["zlib, 524288 cells of 8 bit"](30_000)
    assert len(rows(read(bad[: -len(SENTINEL)] + sound))) == len(rows(read(sound)))


def test_damage_that_waits_for_its_frame_is_gone_over_once() -> None:
    told = _Told()
    told.add(Damage(f"code {i % 3}", i, "") for i in range(5000))
    taken = [told.take(before=place) for place in range(0, 6000, 100)]
    assert sum(one.count for some in taken for one in some) == 5000
    assert [one.offset for some in taken for one in some] == list(range(3000))
    told.add([Damage("code 0", 9000, "")] * (MAX_TOLD + 5))
    assert [one.count for one in told.take()] == [1] * (MAX_TOLD - 1) + [6]
