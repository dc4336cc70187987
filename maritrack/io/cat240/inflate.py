"""Inflate many zlib streams at once, with libdeflate where it is installed (the wheel `deflate`).

What comes out is the same with and without it: whatever it refuses is tried again by zlib. Nothing but the standard
library is imported, because this file is also the program of the worker processes of `maritrack.io.cat240.parallel`.
"""

from __future__ import annotations

import os
import struct
import sys
import zlib
from mmap import mmap

if __name__ == "__main__":
    sys.path += sys.argv[3:]  # a worker starts faster without looking for it
try:
    from deflate import DeflateError, zlib_decompress
except ImportError:
    LIBDEFLATE = False
else:
    LIBDEFLATE = True

Places = list[int] | tuple[int, ...]

ROOM = 320  # octets beyond the last that zlib needs to be quick up to it
ORDER = struct.Struct("<7q")  # where a worker finds places and octets and puts its own, streams, octets of each, freely
DONE = struct.Struct("<q")  # how many failed; their indices stand where the places stood


def inflate(source: memoryview, first: Places, stop: Places, target: memoryview, *, freely: bool) -> list[int]:
    """Inflate the streams source[first:stop] into equal parts of `target`, one behind the other; which ones failed.

    A stream fails unless it ends well and fills its part; what stands there then is without meaning. `freely`:
    as long as all goes well, without a bound but deflate's own (1032 times its length), which is faster.
    """
    if not first:
        return []
    n = len(target) // len(first)
    spans = zip(range(0, len(target), n), first, stop, strict=True)
    failed = []
    while (to := _quickly(source, spans, target, n, freely=freely)) >= 0:
        judged, freely = freely and not LIBDEFLATE, False  # zlib itself refuses it
        octets = None if judged else _bounded(source[first[to // n] : stop[to // n]], n)
        if octets is None:
            failed.append(to // n)
        else:
            target[to : to + n] = octets
    return failed


def _quickly(source: memoryview, spans: zip[tuple[int, int, int]], target: memoryview, n: int, *, freely: bool) -> int:
    """Inflate the next streams as fast as allowed; the place of the first that has to be tried again, -1 = none.

    `spans` are place in the target, first and stop of each.
    """
    if LIBDEFLATE:
        return _by_libdeflate(source, spans, target, n)
    return _by_zlib(source, spans, target, n) if freely else next(spans, (-1,))[0]


def _by_libdeflate(source: memoryview, spans: zip[tuple[int, int, int]], target: memoryview, n: int) -> int:
    to = -1
    try:
        for to, a, b in spans:
            target[to : to + n] = zlib_decompress(source[a:b], n)
    except (DeflateError, ValueError):  # ValueError: not n octets
        return to
    return -1


def _by_zlib(source: memoryview, spans: zip[tuple[int, int, int]], target: memoryview, n: int) -> int:
    to, decompress, size = -1, zlib.decompress, n + ROOM
    try:
        for to, a, b in spans:
            target[to : to + n] = decompress(source[a:b], 15, size)
    except (zlib.error, ValueError):  # ValueError: not n octets
        return to
    return -1


def _bounded(packed: memoryview, n: int) -> bytes | None:
    """The n octets of a stream, never inflated to more than n + 1; None where it doesn't end well with them."""
    stream = zlib.decompressobj()
    try:
        octets = stream.decompress(packed, n + 1)
    except zlib.error:
        return None
    return octets if len(octets) == n and stream.eof else None


def serve(shared: int, size: int) -> None:
    """Do the orders that come in on standard input, in shared memory (a file descriptor), until there are no more."""
    memory = memoryview(mmap(shared, size))
    while len(order := sys.stdin.buffer.read(ORDER.size)) == ORDER.size:
        places, source, octets, target, streams, n, freely = ORDER.unpack(order)
        spans = struct.unpack_from(f"<{2 * streams}q", memory, places)
        packed, cells = memory[source : source + octets], memory[target : target + n * streams]
        failed = inflate(packed, spans[:streams], spans[streams:], cells, freely=freely > 0)
        struct.pack_into(f"<{len(failed)}q", memory, places, *failed)
        try:
            os.write(sys.stdout.fileno(), DONE.pack(len(failed)))
        except BrokenPipeError:  # nobody waits any more
            return


if __name__ == "__main__":
    serve(int(sys.argv[1]), int(sys.argv[2]))
