"""What `record` and `play` share: being interrupted, and a line that tells how far it is."""

from __future__ import annotations

import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

BETWEEN_LINES_S = 0.2
ENDINGS = ("SIGINT", "SIGTERM", "SIGHUP")  # where the system has them


@contextmanager
def interruption() -> Iterator[Callable[[], bool]]:
    """Whether someone wants it to end: Ctrl-C, a signal to end, a terminal that was closed.

    The first time lets it come to its end; the second time works as ever. A signal that is ignored stays so.
    """
    wanted = False
    numbers = [getattr(signal, name) for name in ENDINGS if hasattr(signal, name)]
    before = {number: was for number in numbers if (was := signal.getsignal(number)) is not signal.SIG_IGN}

    def restore() -> None:
        for number, handler in before.items():
            signal.signal(number, handler)

    def end(_number: int, _frame: FrameType | None) -> None:
        nonlocal wanted
        wanted = True
        restore()

    for number in before:
        signal.signal(number, end)
    try:
        yield lambda: wanted
    finally:
        restore()


@contextmanager
def line(text: Callable[[Any], str], *, quiet: bool) -> Iterator[Callable[[Any], None]]:
    """A function that shows the state it is given as one line on the terminal, some times a second."""
    if quiet or not sys.stderr.isatty():
        yield lambda _: None
        return
    drawn = 0.0

    def show(state: Any) -> None:
        nonlocal drawn
        now = time.monotonic()
        if now - drawn >= BETWEEN_LINES_S:
            drawn = now
            print("\r\x1b[2K" + text(state), end="", file=sys.stderr, flush=True)

    try:
        yield show
    finally:
        print("\r\x1b[2K", end="", file=sys.stderr, flush=True)


def size(octets: float) -> str:
    """So many octets as people read them."""
    for unit in ("octets", "kB", "MB"):
        if octets < 1000:
            return f"{octets:.0f} {unit}" if unit == "octets" else f"{octets:.3g} {unit}"
        octets /= 1000
    return f"{octets:.4g} GB"
