"""Options that several commands share, with their help."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

MOST_WORKERS = 64  # processes; each holds memory of its own
METHOD, INPUT, OUTPUT, DISPLAY = "Method", "Input", "Output", "Display"


def method(*names: str) -> Any:
    """An option (names, then its help) in the panel of methods."""
    return typer.Option(*names[:-1], help=names[-1], rich_help_panel=METHOD)


def given(*names: str) -> Any:
    """An option in the panel of inputs."""
    return typer.Option(*names[:-1], help=names[-1], rich_help_panel=INPUT)


def output(*names: str) -> Any:
    """An option in the panel of outputs."""
    return typer.Option(*names[:-1], help=names[-1], rich_help_panel=OUTPUT)


def display(*names: str) -> Any:
    """An option in the panel of display."""
    return typer.Option(*names[:-1], help=names[-1], rich_help_panel=DISPLAY)


Tracker = Annotated[str, method("--tracker", "-t", "Tracker, by default the preset's.")]
Preset = Annotated[str, method("--preset", "-p", "Preset, by default by content (`maritrack config list`).")]
ConfigFile = Annotated[Path | None, method("--config", "-c", "TOML laid over the preset.")]
Sets = Annotated[list[str] | None, method("--set", "One setting: KEY=VALUE, e.g. model.p_detect=0.9.")]
Seed = Annotated[int | None, method("--seed", "Seed of all randomness.")]
Truth = Annotated[Path | None, given("--truth", "AIS (NMEA, CSV, .mat), points document or Autoferry; also gzip, ZIP.")]
TruthMatch = Annotated[str, given("--truth-match", "MMSI,...: these ships of the truth alone.")]
OwnShip = Annotated[Path | None, given("--own-ship", "AIS or NMEA of the ship that carries it.")]
Position = Annotated[str, given("--position", "LAT,LON of a fixed radar, degrees.")]
Date = Annotated[str, given("--date", "Day of recordings that tell the time of day only: YYYY-MM-DD.")]
Stabilised = Annotated[str, given("--stabilised", "Azimuths count from north or from the head.")]
AzimuthEdge = Annotated[str, given("--azimuth-edge", "Edge of the azimuth: start, centre, end.")]
SensorsFile = Annotated[Path | None, given("--sensors", "TOML with these settings for each sensor.")]
Sensor = Annotated[str, given("--sensor", "Only this sensor: SAC-SIC, radar, lidar or radar+lidar.")]
Limit = Annotated[int | None, given("--limit", "At most so many scans; 0 = all.")]
Out = Annotated[Path | None, output("--out", "-o", "Folder for run.rrd, run.mcap, summary.json.")]
Json = Annotated[bool, display("--json", "One JSON document on standard output.")]
Quiet = Annotated[bool, display("--quiet", "-q", "No progress, no notes.")]

Truths = Annotated[list[str] | None, given("--truth", "Truth, one for each input; by default what lies beside it.")]
OwnShips = Annotated[list[str] | None, given("--own-ship", "AIS (CSV) of the ship that carries it, one for each.")]
AllWorkers = Annotated[int, method("--workers", "-w", "Processes; 0 = one for each core.")]
Scheduler = Annotated[str, method("--scheduler", "Of a Dask cluster that does the work: tcp://HOST:PORT.")]
SweepOut = Annotated[Path, typer.Option("--out", "-o", help="Folder.", rich_help_panel=OUTPUT, show_default=False)]
Retry = Annotated[bool, output("--retry-failed", "Run again what failed before.")]


def processes(workers: int) -> int:
    """So many processes, 0 = one for each core. UsageError where they make no sense."""
    from maritrack.fanout import cores

    workers = workers or min(cores(), MOST_WORKERS)
    check_workers(workers)
    return workers


def check_workers(workers: int) -> None:
    """UsageError unless so many processes make sense."""
    from maritrack.errors import UsageError

    if not 1 <= workers <= MOST_WORKERS:
        raise UsageError(f"--workers {workers}: from 1 to {MOST_WORKERS}")


def scored(moving: bool, truth_match: str) -> dict[str, Any]:
    """--moving and --truth-match as settings."""
    score = ({"moving_only": True} if moving else {}) | ({"truth_match": truth_match} if truth_match else {})
    return {"score": score} if score else {}
