"""Several recordings as one: their frames merged in order of time."""

from __future__ import annotations

import heapq
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from maritrack.errors import UsageError
from maritrack.io.source import Source
from maritrack.types import Frame, Origin


@dataclass(frozen=True, slots=True)
class MergedSource:
    """Frames of several sources by time, at equal times in the order of the sources. Make it with `merge_sources`.

    One frame of each source is read ahead. A source whose own frames step back in time keeps its order.
    """

    kind: str  # "cat240", or "cat240+points" where they differ
    origin: Origin | None
    sources: tuple[Source, ...]

    def frames(self) -> Iterator[Frame]:
        """Frames numbered anew from 0."""
        merged = heapq.merge(*(source.frames() for source in self.sources), key=lambda frame: frame.t_ns)
        for k, frame in enumerate(merged):
            yield replace(frame, k=k)


def merge_sources(sources: Sequence[Source]) -> MergedSource:
    """Sources read side by side. They have one origin; UsageError where there is no source or two origins."""
    if not sources:
        raise UsageError("no input")
    origins = list(dict.fromkeys(source.origin for source in sources if source.origin is not None))
    if len(origins) > 1:
        raise UsageError("inputs have different origins: give one for all")
    kind = "+".join(dict.fromkeys(source.kind for source in sources))
    return MergedSource(kind, origins[0] if origins else None, tuple(sources))
