"""Whether a replay made the same as the run: message by message, octet by octet."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from maritrack.diff import LIMIT, Difference, compare_scans, paired
from maritrack.io.archive import Stored, assemble_scan, iter_messages
from maritrack.io.messages import OUTPUTS, decode_log
from maritrack.tolerances import Tolerances
from maritrack.types import Damage


@dataclass(frozen=True, slots=True)
class Verification:
    """What a replay made differently; nothing, where all is well."""

    differences: tuple[Difference, ...]  # the first of them: where = topic, "archive" where octets are damaged
    count: int  # of all
    n_scans: int  # compared
    n_messages: int

    @property
    def equal(self) -> bool:
        return self.count == 0


def verify(archived: Path, replayed: Path, *, first_scan: int = 0, limit: int = LIMIT) -> Verification:
    """Compare the output messages of two archives, from a scan on. InputError where one can't be read.

    Damage to either archive is a difference: what can't be read can't be called equal.
    """
    lost: tuple[list[Damage], list[Damage]] = ([], [])
    scans = [_scans(path, damage, first_scan) for path, damage in zip((archived, replayed), lost, strict=True)]
    differences: list[Difference] = []
    count = n_scans = n_messages = 0
    for a, b in paired(scans[0], scans[1], lambda messages: messages[0].k):
        n_scans, n_messages = n_scans + 1, n_messages + len(a or ())
        if a is None or b is None or [m[:4] for m in a] != [m[:4] for m in b]:
            found = list(_named(a, b))
            count += len(found)
            differences += found[: limit - len(differences)]
    damage = [Difference("archive", -1, "damage", d.message, None) for d in lost[0]]
    damage += [Difference("archive", -1, "damage", None, d.message) for d in lost[1]]
    return Verification((*damage, *differences)[:limit], count + len(damage), n_scans, n_messages)


def _scans(path: Path, damage: list[Damage], first_scan: int) -> Iterator[tuple[Stored, ...]]:
    messages = iter_messages(path, OUTPUTS, on_damage=damage.append)
    for k, group in itertools.groupby(messages, key=lambda message: message.k):
        if k >= first_scan:
            yield tuple(group)


def _named(a: tuple[Stored, ...] | None, b: tuple[Stored, ...] | None) -> Iterator[Difference]:
    """What differs in a scan: its fields where they can be told, else the first message."""
    if a is None or b is None:
        yield Difference("/scan", (a or b or ())[0].k, "present", a is not None, b is not None)
        return
    x, y = (next(assemble_scan(messages, lambda _: None), None) for messages in (a, b))
    found = False
    if x is not None and y is not None:
        for difference in compare_scans(x, y, Tolerances(), tracks_only=False):
            found = True
            yield difference._replace(where=f"/{difference.where}")
    if not found:
        m, n = next((m, n) for m, n in itertools.zip_longest(a, b) if m is None or n is None or m[:4] != n[:4])
        yield Difference((m or n).topic, a[0].k, "message", _shown(m), _shown(n))


def _shown(message: Stored | None) -> str | None:
    """A message in a few words."""
    if message is None:
        return None
    try:
        return decode_log(message.data).message if message.topic == "/log" else f"{len(message.data)} octets"
    except ValueError:
        return f"{len(message.data)} octets"
