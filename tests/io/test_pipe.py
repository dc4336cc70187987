"""What comes through a pipe is looked at when it comes."""

from __future__ import annotations

import os
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

from maritrack.io.cat240.encode import encode_video
from maritrack.io.cat240_source import Cat240Source
from maritrack.io.octets import octets_from_file
from maritrack.settings import InputConfig

WAIT_S, SPOKES, CELLS = 20.0, 128, 100


def turn(k: int) -> bytes:
    az = np.rint(np.arange(SPOKES + 1) * 65_536 / SPOKES).astype(int) % 65_536
    return b"".join(
        encode_video(
            sac=7, sic=43, idx=SPOKES * k + i, start_az=int(az[i]), end_az=int(az[i + 1]), start_rg=0,
            cell_dur=66_712_819, cells=np.zeros(CELLS, np.uint8), compress=False,
            tod=1000 + (SPOKES * k + i) * 320 // SPOKES,
        )
        for i in range(SPOKES)
    )  # fmt: skip


@pytest.mark.skipif(sys.platform == "win32", reason="needs named pipes")
def test_a_turn_is_there_before_the_next_but_one_has_come(tmp_path: Path) -> None:
    pipe, told, waited = tmp_path / "pipe", threading.Event(), list[bool]()
    turns = [turn(k) for k in range(12)]
    os.mkfifo(pipe)

    def write() -> None:
        with pipe.open("wb", buffering=0) as file:
            file.write(b"".join(turns[:8]))
            waited.append(told.wait(WAIT_S))
            file.write(b"".join(turns[8:]))

    writer = threading.Thread(target=write)
    writer.start()
    frames = Cat240Source(octets_from_file(pipe, "/input/cat240"), InputConfig()).frames()
    found = [next(frames) for _ in range(6)]
    told.set()
    found += frames
    writer.join()
    assert waited == [True]
    assert len(found) == 12
