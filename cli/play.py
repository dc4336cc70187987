"""`maritrack play`: a recording, onto the network."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from . import live, render
from . import options as opt

if TYPE_CHECKING:
    from maritrack.live.pace import Pace
    from maritrack.live.play import Player, Sent

HELP = """Send the datagrams of a recording that hold radar video, at the pace at which they came.

The pace is that of the receive times, of recordings without them that of the time of day in the records, or of the
antenna. Each data block of a raw recording is a datagram. Of the archive of a run its recording is sent.

Ends with 0 where all was sent, or was sent again and again until interrupted; 130 where it was interrupted before.

Examples:

    maritrack play harbour.cat240 --to 127.0.0.1:8600

    maritrack play watch.pcap --to 239.0.1.2:8600 --interface eth1 --ttl 4 --speed 4x

    maritrack convert watch.pcap --time 07:40..07:45 - | maritrack play - --to 127.0.0.1:8600 --speed max
"""


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command(name="play", help=HELP)(play)


def play(
    recording: Annotated[
        Path, typer.Argument(help="Recording in any container, - for standard input.", show_default=False)
    ],
    *,
    to: Annotated[str, opt.output("--to", "HOST:PORT, of one receiver or of a multicast group.")],
    speed: Annotated[str, opt.given("--speed", "4x, 0.5x, or max: as fast as it can.")] = "1x",
    loop: Annotated[bool, opt.given("--loop", "Again and again, until interrupted.")] = False,
    max_gap: Annotated[float, opt.given("--max-gap", "Longest pause in seconds; longer ones are cut to it.")] = 10.0,
    stream: Annotated[str, opt.given("--stream", "Of a capture: ADDRESS, ADDRESS:PORT or :PORT, of either end.")] = "",
    ttl: Annotated[int | None, opt.output("--ttl", "Hops of multicast (else 1) or of unicast.")] = None,
    interface: Annotated[str, opt.output("--interface", "Network interface, by its address or its name.")] = "",
    json_: opt.Json = False,
    quiet: opt.Quiet = False,
) -> None:
    """Read, wait, send, tell."""
    from maritrack.errors import UsageError
    from maritrack.io.containers.kinds import open_container
    from maritrack.io.rewrite.recorded import open_recorded
    from maritrack.live.pace import Pace
    from maritrack.live.play import Player
    from maritrack.live.sockets import refused, sending_socket

    factor = _factor(speed)
    _check(max_gap, ttl)
    if loop and not recording.is_file():
        raise UsageError(f"{recording}: --loop wants a file, which can be read again")
    source = open_recorded(recording, stream=stream)
    pace = Pace(max_gap_ns=int(min(max_gap, 1e9) * 1e9))
    sock, address = sending_socket(to, interface=interface, ttl=ttl)
    with sock, live.interruption() as stopped, live.line(_progress, quiet=quiet) as show:
        player = Player(sock, address, pace, speed=factor, stopped=stopped, tick=show)
        try:
            while (
                player.play(open_container(source.octets, stream=source.stream).datagrams())
                and loop
                and player.sent.datagrams
            ):
                pace.again()
        except OSError as error:
            raise refused(to, error) from None
    for damage in source.damage:
        player.note(damage)
    _finish(recording, to, player, pace, json_=json_, quiet=quiet)
    if stopped() and not loop:
        raise typer.Exit(130)


def _factor(speed: str) -> float:
    """How much faster than recorded; 0 = as fast as it can."""
    from maritrack.errors import UsageError

    if speed == "max":
        return 0.0
    try:
        factor = float(speed.removesuffix("x"))
    except ValueError:
        factor = math.nan
    if not 1e-6 <= factor <= 1e6:
        raise UsageError(f"--speed '{speed}': write 4x, 0.5x or max")
    return factor


def _check(max_gap: float, ttl: int | None) -> None:
    from maritrack.errors import UsageError

    if not max_gap >= 0:
        raise UsageError(f"--max-gap {max_gap:g}: seconds, at least 0")
    if ttl is not None and not 0 <= ttl <= 255:
        raise UsageError(f"--ttl {ttl}: from 0 to 255")


def _progress(sent: Sent) -> str:
    rate = sent.datagrams / sent.seconds if sent.seconds > 0 else 0.0
    late = f"  {sent.lag_ns / 1e6:.0f} ms late" if sent.lag_ns > 10_000_000 else ""
    return (
        f"{sent.seconds:.0f} s  {sent.datagrams} datagrams  {live.size(sent.octets)}  {rate:.0f}/s  "
        f"{sent.recorded_ns / 1e9:.0f} s of the recording{late}"
    )


def _finish(recording: Path, to: str, player: Player, pace: Pace, *, json_: bool, quiet: bool) -> None:
    """The summary. InputError where there was nothing to send."""
    from maritrack.errors import InputError

    sent = player.sent
    if sent.too_large:
        render.note(f"warning: {sent.too_large} datagrams left out: too large for UDP", quiet=quiet)
    elif sent.datagrams == 0 and sent.passes:
        raise InputError(f"{recording}: no CAT240 to send")
    if pace.assumed and not json_:
        render.note("note: no times in it: the antenna is taken to turn 24 times a minute", quiet=quiet)
    document = {
        "input": str(recording), "to": to, "pace": pace.kind, "passes": sent.passes, "datagrams": sent.datagrams,
        "octets": sent.octets, "seconds": round(sent.seconds, 6), "recorded_seconds": sent.recorded_ns / 1e9,
        "late_ms": {"last": sent.lag_ns / 1e6, "most": sent.most_lag_ns / 1e6, "put_off": sent.slipped_ns / 1e6},
        "pauses_cut": pace.cuts, "pauses_cut_seconds": pace.cut_ns / 1e9, "too_large": sent.too_large,
        "waited_for_room": sent.waited, "warnings": dict(sorted(sent.damage.items())),
    }  # fmt: skip
    render.emit_json(document) if json_ else _tell(document)


def _tell(document: dict[str, Any]) -> None:
    late, cut = document["late_ms"], document["pauses_cut"]
    print(
        f"{document['input']}: {document['datagrams']} datagrams, {live.size(document['octets'])} to {document['to']} "
        f"in {document['seconds']:.1f} s" + (f", up to {late['most']:.1f} ms late" if document["pace"] else "")
    )
    if cut:
        print(f"{cut} pauses cut by {document['pauses_cut_seconds']:.1f} s in all (--max-gap)")
    if late["put_off"]:
        print(f"the schedule was missed and put off by {late['put_off'] / 1000:.1f} s")
    render.table("warnings", ("code", "count"), [(code, str(n)) for code, n in document["warnings"].items()])
