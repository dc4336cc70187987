"""Labelled cells of a recording, as a Parquet table beside it: scan, spoke, cell, object.

Every cell that is shown and whose mean power a vessel (its id) or land (`land`) dominates has a row; what noise
or the sea did has none. Rows are in order of scan, spoke and cell.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow as pa  # type: ignore[import-untyped]
import pyarrow.parquet as pq  # type: ignore[import-untyped]
from numpy.typing import NDArray

from maritrack.errors import InputError
from maritrack.simulate.radar import Turn
from maritrack.simulate.scenes import LAND_ID, Scene
from maritrack.types import IntArray

ROWS = 1 << 18  # of a row group, about
SCHEMA = pa.schema([("scan", pa.int32()), ("spoke", pa.int32()), ("cell", pa.int32()), ("object", pa.string())])


class Labels(NamedTuple):
    """A table read back."""

    scan: IntArray  # (n,) from 0
    spoke: IntArray  # (n,) from North, in the turn
    cell: IntArray  # (n,) from the first that is sent
    object: tuple[str, ...]  # (n,)


def labels_path(recording: Path) -> Path:
    """Where the labels of a recording lie: rec.cat240 -> rec.labels.parquet."""
    return recording.with_name(recording.stem + ".labels.parquet")


class LabelFile:
    """Rows on their way to the table, at most one row group of them in memory."""

    def __init__(self, writer: pq.ParquetWriter, scene: Scene) -> None:
        self._writer = writer
        self._cells = scene.radar.cells
        self._ids = pa.array([*(v.id for v in scene.vessel), LAND_ID], pa.string())
        self._waiting: list[pa.RecordBatch] = []

    def add(self, k: int, turn: Turn) -> None:
        """The labelled cells of turn k."""
        scan = np.full(len(turn.cells), k, dtype=np.int32)
        spoke, cell = (part.astype(np.int32) for part in np.divmod(turn.cells, self._cells))
        columns = [pa.array(scan), pa.array(spoke), pa.array(cell), self._ids.take(pa.array(turn.owners))]
        self._waiting.append(pa.RecordBatch.from_arrays(columns, schema=SCHEMA))
        if sum(batch.num_rows for batch in self._waiting) >= ROWS:
            self.flush()

    def flush(self) -> None:
        """Write what waits."""
        if self._waiting:
            self._writer.write_table(pa.Table.from_batches(self._waiting, SCHEMA).combine_chunks())
            self._waiting = []


class Owners(NamedTuple):
    """A table read back for work on it: whose echo each cell is, as a number."""

    scan: NDArray[np.int32]  # (n,) ascending
    spoke: NDArray[np.int32]  # (n,)
    cell: NDArray[np.int32]  # (n,)
    owner: NDArray[np.int32]  # (n,) index into ids
    ids: tuple[str, ...]


@contextmanager
def label_file(path: Path, scene: Scene) -> Iterator[LabelFile]:
    """A table to add turns to; complete when the context ends."""
    with pq.ParquetWriter(path, SCHEMA, compression="zstd") as writer:
        table = LabelFile(writer, scene)
        yield table
        table.flush()


def read_labels(path: Path) -> Labels:
    """The labels beside a recording, from their own path."""
    table = pq.read_table(path, schema=SCHEMA)
    scan, spoke, cell = (np.asarray(table[name], dtype=np.int64) for name in ("scan", "spoke", "cell"))
    return Labels(scan, spoke, cell, tuple(table["object"].to_pylist()))


def read_owners(path: Path) -> Owners:
    """The labels beside a recording, from their own path. InputError where it is no such table."""
    try:
        table = pq.read_table(path)
        if not table.schema.equals(SCHEMA):
            raise InputError(f"{path}: a table of {', '.join(table.schema.names)}, not of scan, spoke, cell, object")
    except (OSError, pa.ArrowInvalid) as error:
        raise InputError(f"{path}: no table of labelled cells ({str(error).splitlines()[0]})") from None
    scan, spoke, cell = (table[name].to_numpy() for name in ("scan", "spoke", "cell"))
    coded = table["object"].combine_chunks().dictionary_encode()
    return Owners(scan, spoke, cell, coded.indices.to_numpy(), tuple(coded.dictionary.to_pylist()))
