"""`maritrack convert`: a recording into another container, whole or in part."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from . import live, render
from . import options as opt

if TYPE_CHECKING:
    from maritrack.convert import Counts
    from maritrack.io.containers.writers import RawWriter
    from maritrack.io.datagrams import DatagramWriter
    from maritrack.io.rewrite.recorded import Recorded

HELP = """A CAT240 recording into another container, whole or in part, without loss.

IN is told by its content: data blocks as they are, pcap, pcapng, FINAL or MCAP, each also gzipped, or the archive
of a run, whose recording is taken out again. OUT is told by its extension: .pcap, .final, .mcap,
.cat240 (data blocks as they are), or by --to; .gz on top compresses it. "-" is standard input and standard output
(data blocks as they are).

--compress and --no-compress recode the cells of each video record, all else stays octet for octet. A record whose
cells are damaged or don't fit stays as it is and is counted.

--time FROM..TO keeps the datagrams with FROM <= time < TO; one side may be empty. A time is

- 2017-11-02T07:40:00Z, in UTC unless it says otherwise,

- 07:40:00, in UTC: as FROM on the day of the first datagram, as TO the next one after FROM. A window that would end
  before the first datagram is a day later, and so is a FROM without TO more than 12 hours before it,

- +60, seconds after the first datagram.

The time of a datagram is that of its reception; in data blocks as they are it is the time of day of its records, on
the day --date (else 1970-01-01), and goes on after midnight.

Data blocks as they are hold whole ones alone: what is left of a block that the recording has only in part (a fragment
is missing, a packet was cut off) is left out, told and counted. The other containers keep it.

--strict reads the whole recording (of --stream) on the way as `process --strict` does, records, cells and scans, and
leaves no OUT where anything is wrong with it.

Ends with 0 where all that was wanted is written, 1 where OUT can't hold some of it, 2 where there is nothing to write.

Examples:

    maritrack convert harbour.cat240 harbour.pcap --date 2017-11-02

    maritrack convert watch.pcap.gz part.cat240 --time 07:40..07:45 --sensor 7-42 --compress

    maritrack convert watch.pcap --stream 239.0.1.2:8600 - | maritrack process -
"""
KINDS = ("raw", "pcap", "final", "mcap")
WHY = {
    "outside-time": "datagrams left out: outside the time", "other-sensor": "datagrams left out: of other sensors",
    "too-large": "datagrams left out: too large for this file",
    "incomplete": "data blocks left out: only parts of them are there, which this file can't hold",
}  # fmt: skip


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command(name="convert", help=HELP)(convert)


def convert(
    recording: Annotated[
        Path, typer.Argument(metavar="IN", help="Recording, - for standard input.", show_default=False)
    ],
    out: Annotated[Path, typer.Argument(metavar="OUT", help="File, - for standard output.", show_default=False)],
    *,
    to: Annotated[str, opt.output("--to", f"Container: {', '.join(KINDS)}; by default by the extension.")] = "",
    compress: Annotated[
        bool | None, opt.output("--compress/--no-compress", "Cells by zlib, or as they are; by default as they come.")
    ] = None,
    level: Annotated[int, opt.output("--level", "Of zlib, 0 to 9.")] = 6,
    time: Annotated[str, opt.given("--time", "FROM..TO, see above.")] = "",
    sensor: Annotated[str, opt.given("--sensor", "Only the records of SAC-SIC.")] = "",
    stream: Annotated[
        str, opt.given("--stream", "Only ADDRESS, ADDRESS:PORT or :PORT, of either end; of an archive /input/NAME.")
    ] = "",
    date: Annotated[str, opt.given("--date", "Day of a recording that tells times of day only: YYYY-MM-DD.")] = "",
    force: Annotated[bool, opt.output("--force", "Write over a file that is there.")] = False,
    strict: Annotated[bool, opt.given("--strict", "Stop at the first damage that process --strict stops at.")] = False,
    json_: opt.Json = False,
    quiet: opt.Quiet = False,
) -> None:  # fmt: skip
    """Open both, convert, tell."""
    from maritrack.convert import UNFIT
    from maritrack.convert import convert as run
    from maritrack.io.cat240.reader import refuse
    from maritrack.io.rewrite.recorded import open_recorded

    _check(recording, out, to, json_=json_, force=force)
    source = open_recorded(recording, stream=stream)
    writer = _open(out, to)
    try:
        with live.line(_progress(source), quiet=quiet) as show:
            counts = run(
                source.octets, writer, compress=compress, level=level, time_window=time, sensor=sensor,
                stream=source.stream, date=date, strict=strict, progress=show,
            )  # fmt: skip
        for damage in source.damage:
            if strict:
                refuse(damage, source.octets.name)
            counts.warn(damage)
    except BaseException:
        _give_up(writer, out)
        raise
    writer.close() if counts.datagrams_out else _give_up(writer, out)
    _tell(counts, str(out), json_=json_, quiet=quiet)
    if any(counts.dropped[why] for why in UNFIT):
        raise typer.Exit(1)


def _check(recording: Path, out: Path, to: str, *, json_: bool, force: bool) -> None:
    """UsageError where the call would destroy something, or makes no sense."""
    from maritrack.errors import UsageError

    if to and to not in KINDS:
        raise UsageError(f"--to {to}: one of {', '.join(KINDS)}")
    if str(out) == "-":
        if json_ or to not in ("", "raw"):
            raise UsageError("standard output gets data blocks as they are, and nothing else", hint="name a file")
        return
    for path in (out, _partial(out)):
        if not path.exists():
            continue
        if not path.is_file():
            raise UsageError(f"{path}: is no file", hint="- is standard output")
        if recording.exists() and path.samefile(recording):
            raise UsageError(f"{path}: is the recording that is read", hint="choose another name")
        if not force:
            raise UsageError(f"{path}: is there already", hint="another name, or --force to write over it")


def _partial(out: Path) -> Path:
    """What the file is called until it is whole."""
    return out.with_name(out.name + ".partial")


def _open(out: Path, kind: str) -> DatagramWriter:
    from maritrack.io.containers.writers import RawWriter, open_writer

    if str(out) != "-":
        return open_writer(out, kind=kind)
    return _StandardOutput(RawWriter(sys.stdout.buffer))


def _give_up(writer: DatagramWriter, out: Path) -> None:
    """Leave nothing behind."""
    if str(out) != "-":
        _partial(out).unlink(missing_ok=True)  # while no other can have it
    writer.abort()


class _StandardOutput:
    """Standard output as the end of a conversion."""

    def __init__(self, encoder: RawWriter) -> None:
        self.write, self.flush, self.close = encoder.write, encoder.flush, encoder.flush

    def abort(self) -> None:
        """What was written is with the reader."""


def _progress(source: Recorded) -> Any:
    """Text of the line, for the octets read so far."""
    size = source.octets.size

    def text(done: int) -> str:
        return live.size(done) + (f" of {live.size(size)}  {min(done / size, 1.0):.0%}" if size > 0 else "")

    return text


def _tell(counts: Counts, out: str, *, json_: bool, quiet: bool) -> None:
    """What was written: on standard output, unless the recording went there."""
    document = {"output": out, **counts.document()}
    if json_:
        render.emit_json(document)
        return
    say = (lambda line: render.note(line, quiet=quiet)) if out == "-" else print
    for line in _lines(document):
        say(line)


def _lines(document: dict[str, Any]) -> list[str]:
    name = "standard output" if document["output"] == "-" else document["output"]
    packed = f"{document['container']}, gzipped" if document["gzipped"] else document["container"]
    lines = [
        f"{name}: {document['datagrams_out']} of {document['datagrams_in']} datagrams, "
        f"{live.size(document['payload_out'])} of {live.size(document['payload_in'])} ({packed}), "
        f"{document['first'] or '-'} to {document['last'] or '-'}"
    ]
    done = {"recoded": document["records_recoded"], "of other sensors left out": document["records_cut"]}
    lines += [f"{n} records {what}" for what, n in done.items() if n]
    lines += [f"{n} {WHY[why]}" for why, n in document["datagrams_dropped"].items() if n]
    for code, told in document["warnings"].items():
        sensors = f" ({', '.join(told['sensors'])})" if told["sensors"] else ""
        lines.append(f"warning: {code} x {told['count']}{sensors}, first at byte {told['offset']}: {told['message']}")
    return lines
