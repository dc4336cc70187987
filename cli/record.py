"""`maritrack record`: the radar video on the network, into a file."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from . import live, render
from . import options as opt

if TYPE_CHECKING:
    from maritrack.errors import MaritrackError
    from maritrack.io.datagrams import DatagramWriter
    from maritrack.live.record import Tally

HELP = """The radar video that comes to a UDP port, into a recording, until interrupted.

What comes is written as it is, with the time at which the kernel received it. The file grows under the name
OUT.partial, readable even after a kill, and gets its name at the end. One process at a time writes an OUT.

Ends with 0 where all was recorded; 1 where datagrams were lost, or were none that the file can hold; 2 where none came.

Examples:

    maritrack record --port 8600 --group 239.0.1.2 -o watch.pcap

    maritrack record --port 4378 --group 239.192.43.78 --interface eth1 --duration 600 -o watch.mcap

    maritrack record --port 8600 -o watch.pcap.gz --json
"""
SILENCE_S = 5.0
SMALL_BUFFER = 4 << 20


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command(name="record", help=HELP)(record)


def record(
    *,
    port: Annotated[int, opt.given("--port", "UDP port.")],
    out: Annotated[Path, opt.output("--out", "-o", "File: .pcap, .mcap, .final or .cat240, with .gz compressed.")],
    group: Annotated[str, opt.given("--group", "Multicast group to join; without: what is sent to this machine.")] = "",
    interface: Annotated[str, opt.given("--interface", "Network interface, by its address or its name.")] = "",
    duration: Annotated[float | None, opt.given("--duration", "Seconds after which to end.")] = None,
    max_octets: Annotated[int | None, opt.given("--max-octets", "Octets of payload after which to end.")] = None,
    force: Annotated[bool, opt.output("--force", "Write over a file that is there.")] = False,
    json_: opt.Json = False,
    quiet: opt.Quiet = False,
) -> None:
    """Listen, write, tell."""
    from maritrack.errors import InputError
    from maritrack.io.containers.writers import open_writer
    from maritrack.live.record import Tally
    from maritrack.live.record import record as receive
    from maritrack.live.sockets import endpoint, granted_octets, receiving_socket

    _check(port, out, duration, max_octets, force=force)
    where, tally = endpoint(group or interface or "any address", port), Tally()
    with receiving_socket(port=port, group=group, interface=interface) as sock, live.interruption() as stopped:
        granted, writer = granted_octets(sock), open_writer(out)
        with live.line(_progress(), quiet=quiet) as show:
            try:
                receive(
                    sock, writer, tally, stopped=stopped, duration_s=duration, max_octets=max_octets,
                    blocks_only=_is_raw(out), ready=lambda: _begin(where, granted, quiet=quiet),
                    tick=_silence(show, where, quiet=quiet),
                )  # fmt: skip
            except (OSError, InputError) as error:
                raise _broken(error, writer, out, tally) from None
    if tally.datagrams == 0:
        _drop(writer, out)
        raise _nothing(where, tally)
    writer.close()
    document = _document(out, tally, granted)
    render.emit_json(document) if json_ else _tell(document, where)
    if document["lost"] or document["unfit"]:
        raise typer.Exit(1)


def _check(port: int, out: Path, duration: float | None, max_octets: int | None, *, force: bool) -> None:
    """UsageError where the options can't be meant, or would write over a recording."""
    from maritrack.errors import UsageError

    if not 0 < port < 65_536:
        raise UsageError(f"--port {port}: from 1 to 65535")
    if duration is not None and not 0 < duration < float("inf"):
        raise UsageError(f"--duration {duration:g}: seconds, more than 0")
    if max_octets is not None and max_octets <= 0:
        raise UsageError(f"--max-octets {max_octets}: more than 0")
    for path in (out, _partial(out)):
        if path.exists() and not force:
            raise UsageError(f"{path}: is there already", hint="another name, or --force to write over it")


def _is_raw(out: Path) -> bool:
    """Whether the name asks for data blocks without a container."""
    from maritrack.io.containers.writers import KINDS

    suffixes = [suffix.lower() for suffix in out.suffixes if suffix.lower() != ".gz"]
    return bool(suffixes) and suffixes[-1] in KINDS["raw"]


def _begin(where: str, granted: int, *, quiet: bool) -> None:
    render.note(f"listening to {where}, the kernel holds up to {live.size(granted)}", quiet=quiet)
    if granted < SMALL_BUFFER:
        render.note("note: it could hold more: sysctl -w net.core.rmem_max=33554432", quiet=quiet)


def _progress() -> Callable[[Tally], str]:
    """Text of the line; the rate is that of the time since the last line."""
    before = (0.0, 0, 0)

    def text(tally: Tally) -> str:
        nonlocal before
        spent = max(tally.seconds - before[0], 1e-9)
        rate, flow = (tally.datagrams - before[1]) / spent, (tally.octets - before[2]) / spent
        before = (tally.seconds, tally.datagrams, tally.octets)
        waiting = f"  {live.size(tally.waiting)} waiting" if tally.waiting > 1_000_000 else ""
        return (
            f"{tally.seconds:.0f} s  {tally.datagrams} datagrams  {live.size(tally.octets)}  {rate:.0f}/s  "
            f"{live.size(flow)}/s  {_lost(tally.lost)}{waiting}  {' '.join(list(tally.sensors)[:8])}"
        )

    return text


def _silence(show: Callable[[Tally], None], where: str, *, quiet: bool) -> Callable[[Tally], None]:
    """Shows the line, and says it once where nothing comes for some seconds."""
    told = False

    def tick(tally: Tally) -> None:
        nonlocal told
        show(tally)
        if not told and tally.datagrams + tally.unfit == 0 and tally.seconds > SILENCE_S:
            told = True
            below = "\n" if sys.stderr.isatty() else ""  # of the line
            render.note(f"{below}nothing yet from {where}: {HINT}", quiet=quiet)

    return tick


HINT = "is it the right group and port? The right interface (--interface)? Does a firewall keep it away?"


def _nothing(where: str, tally: Tally) -> Exception:
    """Why there is no recording."""
    from maritrack.errors import InputError

    if tally.unfit:
        return InputError(
            f"{where}: {tally.unfit} datagrams, none that this file can hold", hint="-o NAME.pcap takes all"
        )
    return InputError(f"{where}: no datagram in {tally.seconds:.1f} s", hint=HINT)


def _broken(error: OSError | MaritrackError, writer: DatagramWriter, out: Path, tally: Tally) -> Exception:
    """The network or the disk failed; what was recorded so far is kept."""
    from maritrack.errors import InputError

    kept = ""
    if tally.datagrams:
        kept = f"what was written is in {_partial(out)}"
        writer.abort()
    else:
        _drop(writer, out)
    reason = getattr(error, "strerror", None) or error
    return InputError(f"after {tally.seconds:.0f} s: {reason}", hint=kept)


def _drop(writer: DatagramWriter, out: Path) -> None:
    """Nothing was recorded: leave nothing."""
    _partial(out).unlink(missing_ok=True)  # while no other can have it
    writer.abort()


def _partial(out: Path) -> Path:
    return out.with_name(out.name + ".partial")


def _document(out: Path, tally: Tally, granted: int) -> dict[str, Any]:
    return {
        "output": str(out), "ended": tally.ended, "seconds": round(tally.seconds, 3),
        "datagrams": tally.datagrams, "octets": tally.octets, "lost": tally.lost, "unfit": tally.unfit,
        "without_cat240": tally.other, "first_ns": tally.first_ns, "last_ns": tally.last_ns,
        "receive_buffer_octets": granted,
        "sensors": [{"id": name, "datagrams": n} for name, n in sorted(tally.sensors.items())],
        "streams": [
            {"source": s.source, "destination": s.destination, "datagrams": n} for s, n in sorted(tally.streams.items())
        ],
    }  # fmt: skip


def _tell(document: dict[str, Any], where: str) -> None:
    n = document["datagrams"]
    print(
        f"{document['output']}: {n} datagrams, {live.size(document['octets'])} in {document['seconds']:.1f} s from "
        f"{where}, {_lost(document['lost'])}"
    )
    rows = [(s["source"], s["destination"], str(s["datagrams"])) for s in document["streams"]]
    render.table("streams", ("from", "to", "datagrams"), rows, text_columns=2)
    render.table("sensors", ("SAC-SIC", "datagrams"), [(s["id"], str(s["datagrams"])) for s in document["sensors"]])
    if document["unfit"]:
        print(f"{document['unfit']} datagrams not written: this file can't hold them (.pcap takes all)")
    if document["without_cat240"]:
        print(f"{document['without_cat240']} of the datagrams hold no CAT240")


def _lost(lost: int | None) -> str:
    return "losses unknown" if lost is None else f"{lost} lost"
