"""`maritrack process`: run the chain on a recording."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from . import options as opt
from . import render

HELP = """Run detection, clustering, a tracker and the metrics on a recording.

Reads ASTERIX CAT240 video (blocks, pcap, pcapng, FINAL, MCAP recordings, each also gzipped) and points
(maritrack-points/1, Autoferry, plots as CSV), told apart by content. Captures tell the date by themselves.
Writes run.rrd (open it with `rerun run.rrd`), run.mcap (`maritrack replay`), summary.json.

Examples:

    maritrack process harbour.cat240

    maritrack process rec.cat240 --truth ais.csv --own-ship ais.csv --date 2017-11-02 -o out

    maritrack process radar.pcap --stream :8600

    maritrack process rec.cat240 --truth ais.csv --calibration calibration.toml

    nc -lu 8600 | maritrack process - -o live

    maritrack process detections.json --set model.p_detect=0.9 --json | python -m json.tool

    maritrack process monday.cat240 --save-background harbour.npz

    maritrack process tuesday.cat240 --background harbour.npz
"""


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command(name="process", help=HELP)(process)


def process(
    inputs: Annotated[list[Path], typer.Argument(help="Recordings, several are several sensors; - is standard input.",
                                                 show_default=False)],
    tracker: opt.Tracker = "",
    preset: opt.Preset = "",
    config: opt.ConfigFile = None,
    sets: opt.Sets = None,
    seed: opt.Seed = None,
    truth: opt.Truth = None,
    truth_match: opt.TruthMatch = "",
    own_ship: opt.OwnShip = None,
    position: opt.Position = "",
    date: opt.Date = "",
    stabilised: opt.Stabilised = "",
    azimuth_edge: opt.AzimuthEdge = "",
    azimuth_offset: Annotated[float | None, opt.given("--azimuth-offset", "Degrees added to each azimuth.")] = None,
    sensors: opt.SensorsFile = None,
    calibration: Annotated[Path | None, opt.given("--calibration", "What `maritrack calibrate` wrote.")] = None,
    sensor: opt.Sensor = "",
    stream: Annotated[str, opt.given("--stream", "Only this stream of a capture: ADDR, ADDR:PORT, :PORT.")] = "",
    from_s: Annotated[float | None, opt.given("--from", "Begin so many seconds after the first scan.")] = None,
    to_s: Annotated[float | None, opt.given("--to", "End so many seconds after the first scan.")] = None,
    limit: opt.Limit = None,
    background: Annotated[Path | None, opt.given("--background", "Background learned before (npz).")] = None,
    moving: Annotated[bool, opt.method("--moving", "Score moving tracks only.")] = False,
    strict: Annotated[bool, opt.given("--strict", "Stop at the first damage in the input.")] = False,
    workers: Annotated[int, opt.given("--workers", "Processes that inflate compressed video.")] = 1,
    out: opt.Out = None,
    no_rrd: Annotated[bool, opt.output("--no-rrd", "No picture.")] = False,
    no_mcap: Annotated[bool, opt.output("--no-mcap", "No archive.")] = False,
    save_background: Annotated[Path | None, opt.output("--save-background", "Write the background learned.")] = None,
    force: Annotated[bool, opt.output("--force", "Run even if an equal run is there.")] = False,
    view: Annotated[bool, opt.display("--view", "Open the picture in the Rerun viewer.")] = False,
    json_: opt.Json = False,
    quiet: opt.Quiet = False,
) -> None:  # fmt: skip
    """Parse, run, render."""
    from maritrack.config import load_config
    from maritrack.job import Job, execute
    from maritrack.manifest import input_digest
    from maritrack.recording import default_preset, kinds_of, open_inputs, side_documents

    opt.check_workers(workers)
    octets = open_inputs(inputs)
    kinds = kinds_of(octets)
    chosen = preset or default_preset(kinds)
    over = overrides(
        tracker,
        seed,
        position,
        date,
        stabilised,
        azimuth_edge,
        azimuth_offset,
        sensor,
        stream,
        from_s,
        to_s,
        limit,
        moving,
    )
    if truth_match:
        over["score"] = over.get("score", {}) | {"truth_match": truth_match}
    if calibration is not None:
        over |= lags_over(calibration, over)
    settings = load_config(preset=chosen, file=config, sets=sets or (), over=over)
    side = side_documents(
        inputs, truth=truth, own_ship=own_ship, sensors=sensors, calibration=calibration, background=background
    )
    job = Job(
        octets=octets, kinds=kinds, side=side, config=settings,
        input_sha256=[input_digest(o, p) for o, p in zip(octets, inputs, strict=True)],
        name="stdin" if str(inputs[0]) == "-" else inputs[0].stem, out=out, rrd=not no_rrd, mcap=not no_mcap,
        strict=strict, force=force, workers=workers, save_background=save_background,
        background_name="background" if background is None else str(background),
    )  # fmt: skip
    render.note(f"{', '.join(kinds)}: preset {chosen}, tracker {settings.tracker_name}", quiet=quiet)
    scans = settings.input.limit
    with render.progress(quiet=quiet, total_octets=sum(max(o.size, 0) for o in octets), total_scans=scans) as tick:
        summary, reused = execute(job, progress=tick)
    if reused:
        render.note("an equal run is here already (--force runs it again)", quiet=quiet)
    render.emit_json(summary) if json_ else render.summary(summary)
    if view and "rrd" in summary["outputs"]:
        render.view(Path(summary["outputs"]["rrd"]))
    if "truth" in side and not summary["metrics"].get("n_truth"):
        render.note("warning: the truth covers no scan: another day or another place?", quiet=quiet)
    if summary.get("interrupted"):
        render.note(f"interrupted after {summary['counts']['scans']} scans")
        raise typer.Exit(130)


def lags_over(calibration: Path, over: dict[str, Any]) -> dict[str, Any]:
    """The lags of a calibration as settings of the metrics; none where it has none."""
    from maritrack.errors import InputError
    from maritrack.io.sensors import check_calibration

    try:
        octets = calibration.read_bytes()
    except OSError as error:
        raise InputError(f"{calibration}: {error.strerror or error}") from None
    lags = check_calibration(octets, name=str(calibration))
    return {"score": over.get("score", {}) | {"truth_lag_s": lags}} if lags else {}


def overrides(
    tracker: str, seed: int | None, position: str, date: str, stabilised: str, azimuth_edge: str,
    azimuth_offset: float | None, sensor: str, stream: str, from_s: float | None, to_s: float | None, limit: int | None,
    moving: bool,
) -> dict[str, Any]:  # fmt: skip
    """What named options say, as a table over the configuration."""
    from maritrack.errors import UsageError

    table: dict[str, Any] = {}
    values: dict[str, Any] = {
        "date": date, "stabilised": stabilised, "azimuth_edge": azimuth_edge, "azimuth_offset_deg": azimuth_offset,
        "sensor": sensor, "stream": stream, "from_s": from_s, "to_s": to_s, "limit": limit,
    }  # fmt: skip
    given = {key: value for key, value in values.items() if value not in ("", None)}
    if position:
        try:
            given["lat_deg"], given["lon_deg"] = (float(part) for part in position.split(","))
            if not (abs(given["lat_deg"]) <= 90 and abs(given["lon_deg"]) <= 180):
                raise ValueError
        except ValueError:
            raise UsageError(f"--position '{position}': write LAT,LON in degrees, as in 50.73,-1.08") from None
    if given:
        table["input"] = given
    if tracker:
        table["tracker_name"] = tracker
    if seed is not None:
        table["seed"] = seed
    if moving:
        table["score"] = {"moving_only": True}
    return table
