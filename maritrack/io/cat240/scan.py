"""One stretch of a CAT240 stream: its blocks in order, its records as rows, and where the chain breaks.

Blocks of the usual make are turned into rows many at a time; all others go one by one to the exact reader. That takes
its time, which a hostile input can ask for every few octets: where it asks for more than its size allows, the octets
that follow are looked through for radials of the usual make alone (`effort-budget`).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from maritrack.io.cat240.cells import ROW, Rows, common_rows, row_of, take_rows
from maritrack.io.cat240.exact import Block, Summary, Video, parse_block
from maritrack.io.cat240.framing import CAT240, HEADER, Window, chain, lookalikes, other_blocks
from maritrack.io.cat240.items import MANY, next_block
from maritrack.types import Damage, IntArray

MOST = 12_288  # blocks, and things found, in a stretch
FEW_BLOCKS = 8  # that are taken at once where the chain broke
EFFORT_FLOOR, EFFORT_OCTETS = 8192, 96  # an exact record, some 30 us, for so many octets; so many at the beginning
BREAK = 12  # what a break of the chain takes, in exact records
FOREIGN = 3  # a few blocks of other categories
ALONE = 2  # blocks that are read the exact way as quickly as any other
HURRY = 1 << 18  # octets that are looked through when there is no effort left


@dataclass(slots=True)
class Chain:
    """What is known of the chain of blocks so far."""

    fast: bool
    run: int = MOST  # blocks to take at once: few after the chain broke
    lost: int = -1  # octet of the input where the chain broke, -1 = in step
    told: bool = False  # why it broke was said
    effort: int = 0  # exact records so far, and what takes as long

    def left(self, place: int) -> int:
        """Exact records that the input up to an octet still allows."""
        return EFFORT_FLOOR + place // EFFORT_OCTETS - self.effort if self.fast else MANY


@dataclass(slots=True)
class Found:
    """What a stretch of the window holds, in file order."""

    end: int
    rows: list[Rows] = field(default_factory=list)
    pending: list[tuple[int, ...]] = field(default_factory=list)  # rows of exact records, not yet in `rows`
    videos: list[Video] = field(default_factory=list)
    summaries: list[Summary] = field(default_factory=list)
    damage: list[Damage] = field(default_factory=list)
    size: int = 0  # of all of these together
    calm_end: int = -1  # where the last run of empty or foreign blocks ended

    def add_rows(self, rows: Rows) -> None:
        if len(rows):
            self.settle()
            self.rows.append(rows)
            self.size += len(rows)

    def settle(self) -> None:
        if self.pending:
            self.rows.append(np.array(self.pending, dtype=ROW))
            self.pending = []

    def add_run(self, code: str, offset: int, message: str, span: tuple[int, int], count: int) -> None:
        """Blocks of no interest: told once for as many as follow each other."""
        last = self.damage[-1] if self.damage and self.calm_end == span[0] else None
        if last is not None and last.code == code:
            self.damage[-1] = Damage(code, last.offset, last.message, count=last.count + count)
        else:
            self.damage.append(Damage(code, offset, message, count=count))
            self.size += 1
        self.calm_end = span[1]


def scan(w: Window, at: int, state: Chain) -> Found:
    """Everything from `at` on that can be judged in this window, or as much as makes a batch."""
    found = Found(at)
    while found.size < MOST and at < len(w.data):
        if state.lost >= 0:
            at, tried = next_block(w, at, state.left(w.base + at))
            state.effort += tried
            if at >= w.limit:
                break
            if state.left(w.base + at) <= 0:
                at = _hurry(w, at, found, state)
                continue
            _tell_lost(state, found.damage, f"the next one {w.base + at - state.lost} octets on")
        starts = chain(w, at, min(state.run, MOST - found.size))
        if len(starts) > 1:
            before, at = at, _take_blocks(w, starts, found, state)
            if at == before:
                break
        elif at < w.limit and state.left(w.base + at) <= 0:
            at = _hurry(w, at, found, state)
        elif at < w.limit:
            at = _take_other(w, at, found, state)
        else:
            break
    if w.final and at >= len(w.data) and state.lost >= 0:
        _tell_lost(state, found.damage, "")
    found.end = at
    found.settle()
    return found


def _tell_lost(state: Chain, damage: list[Damage], after: str) -> None:
    """Say that the chain broke, now that it is known what follows ("" = nothing)."""
    if not state.told and state.lost == 0 and not after:
        damage.append(Damage("not-asterix", 0, "not ASTERIX radar video: nowhere a CAT240 data block"))
    elif not state.told:
        message = after or "none follows"
        damage.append(Damage("lost-sync", state.lost, f"no data block begins here, {message}"))
    state.lost, state.told = -1, False


def _take_blocks(w: Window, starts: IntArray, found: Found, state: Chain) -> int:
    """Put the records of the blocks between `starts` into `found`; where to go on, maybe with more input."""
    n = len(starts) - 1
    usual, rows = np.zeros(n, dtype=np.bool_), np.zeros(0, dtype=ROW)
    if state.fast and n > ALONE:
        usual, rows = common_rows(w, starts[:-1], starts[1:])
    done, unusual = 0, np.flatnonzero(~usual).tolist()
    places = starts.tolist() if unusual else []
    for i in unusual:
        if i < done:
            continue
        found.add_rows(rows[done:i])
        done = i + 1
        if places[i] >= w.limit:
            return int(places[i])
        if places[done] - places[i] == HEADER:
            while done < n and places[done + 1] - places[done] == HEADER:
                done += 1
            message = "a data block without records"
            found.add_run("empty-block", w.base + places[i], message, (places[i], places[done]), done - i)
            continue
        hurry = state.left(w.base + places[i]) <= 0
        end = _hurry(w, places[i], found, state) if hurry else _take_block(w, places[i], places[done], found, state)
        if end >= 0:
            state.run = FEW_BLOCKS
            return end
    found.add_rows(rows[done:])
    state.run = min(4 * state.run, MOST)
    return int(starts[-1])


def _take_block(w: Window, start: int, end: int, found: Found, state: Chain) -> int:
    """Read one block the exact way; where to go on if not at its end, else -1."""
    block = parse_block(w, start, end)
    found.pending += [row_of(video, len(found.videos) + i) for i, video in enumerate(block.videos)]
    found.videos += block.videos
    found.summaries += block.summaries
    found.damage += block.damage
    found.size += len(block.videos) + len(block.summaries) + len(block.damage)
    state.effort += _effort(block)
    if block.lost:
        state.lost = w.base + block.resume
    return block.resume if block.lost or block.resume != end else -1


def _effort(block: Block) -> int:
    """What the records of a block took, and what is wrong with them will take."""
    told = sum(len(video.troubles) + _is_odd(video) for video in block.videos)
    return 2 * len(block.videos) + len(block.summaries) + len(block.damage) + told + BREAK * block.lost


def _is_odd(video: Video) -> bool:
    """Whether the octets of cells are not what the number of cells needs."""
    if video.compressed or video.nbcells is None:
        return False
    return video.stop - video.first != video.nbcells * video.bits + 7 >> 3


def _hurry(w: Window, at: int, found: Found, state: Chain) -> int:
    """Take the blocks of the usual make that stand anywhere in the octets that follow; where to go on."""
    stop = min(at + HURRY, len(w.data))
    begin = lookalikes(w, at, stop)
    end = begin + (w.u8[begin + 1].astype(np.int64) << 8 | w.u8[begin + 2])
    usual, rows = common_rows(w, begin, end)
    kept, upto, gaps, unread = list[int](), at, 0, 0
    state.lost = -1
    for i in np.flatnonzero(usual).tolist():
        if begin[i] >= upto:
            gaps, unread = gaps + int(begin[i] > upto), unread + int(begin[i]) - upto
            kept.append(i)
            upto = int(end[i])
    if upto < stop:
        gaps, unread = gaps + 1, unread + stop - upto
        state.lost, state.told = w.base + stop, True  # nothing is known of what stands there
    found.add_rows(take_rows(rows, np.array(kept, dtype=np.int64)))
    if gaps:
        message = f"too many records that are broken or tiny: {unread} octets looked through for usual radials alone"
        found.damage.append(Damage("effort-budget", w.base + at, message, count=gaps))
    return max(stop, upto)


def _take_other(w: Window, at: int, found: Found, state: Chain) -> int:
    """Go over what isn't a whole CAT240 block: other categories, a cut end, a broken chain."""
    ends = other_blocks(w, at) if w.data[at] != CAT240 else []
    if ends:
        state.effort += FOREIGN
        message = f"data block of category {w.data[at]} skipped"
        found.add_run("other-category", w.base + at, message, (at, ends[-1]), len(ends))
        return ends[-1]
    place, left, length = w.base + at, len(w.data) - at, w.length(at)
    state.effort += BREAK
    state.lost, state.told = place, w.data[at] == CAT240
    if not state.told:
        return at
    if left >= HEADER and length < HEADER:
        found.damage.append(Damage("block-length<3", place, f"a data block of {length} octets"))
    else:
        claim = f"a data block of {length} octets" if left >= HEADER else "the header of a data block"
        found.damage.append(Damage("truncated-block", place, f"{claim}, of which the input has {left}"))
    return at + 1
