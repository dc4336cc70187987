"""What has to hold for any octets that are read as a recording."""

from __future__ import annotations

import json
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from maritrack.chain import detect
from maritrack.errors import InputError
from maritrack.io import sniff
from maritrack.io.cat240_source import Cat240Source
from maritrack.io.containers.capture import open_cat240
from maritrack.io.octets import octets_from_bytes
from maritrack.settings import Config
from maritrack.survey import survey
from maritrack.types import Frame

CORPUS = Path(__file__).parents[1] / "io" / "corpus" / "inputs.json"
CONFIG = Config()
OF_CELLS = (  # not seen by who reads headers alone
    "zlib-error", "inflation-budget", "cells-short", "cells-long", "cells-capped", "inflates-beyond-declared",
)  # fmt: skip


class Entry(NamedTuple):
    """An input that is kept."""

    name: str
    origin: str  # what it was made for or what found it
    octets: bytes


def corpus() -> list[Entry]:
    rows = json.loads(CORPUS.read_text())
    return [Entry(row["name"], row["origin"], bytes.fromhex(row["octets"])) for row in rows]


def check(data: bytes) -> list[Frame]:
    """Sniff, show and read octets in every way; the frames. Nothing but InputError is raised on the way."""
    octets = octets_from_bytes(data, name="x", channel="/input/cat240")
    with suppress(InputError):  # it may be anything, and is read as if it were radar video
        sniff(data, "x")
    try:
        batches = list(open_cat240(octets).batches())
    except InputError:
        return []
    assert [one.start for one in batches] == [0, *(one.end for one in batches)][: len(batches)]
    assert len(batches) <= 1 + len(data)
    assert sum(len(one.damage) for one in batches) <= 1 + len(data)
    shown = survey(octets)
    frames = list(Cat240Source(octets, CONFIG.input).frames())
    assert len(frames) <= len(data)
    if not any(one.code in OF_CELLS for batch in batches for one in batch.damage):
        assert shown["scans"] == len(frames)
    for frame in frames:
        detect(frame.scan, CONFIG)
    return frames
