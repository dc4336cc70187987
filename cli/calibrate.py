"""`maritrack calibrate`: how a radar is out of true, and how late AIS tells it."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from . import options as opt
from . import render

if TYPE_CHECKING:
    from maritrack.calibrate.estimate import Calibration

HELP = """Azimuth offset, range offset and latency of each sensor, and the lag of single AIS transponders.

Clusters are compared with ships of the truth that are under way, in robust least squares; land, moorings and wrong
pairs have little say. All come with standard deviations (1 sigma) and how many associations they rest on. A latency
and a lag look alike: most transponders are taken to be punctual, and the latency to be within some 5 s. Without a
truth the first recording's own moving tracks stand for it, those of three ships at least that are long and steady
(pieces of one ship's track count as one), and the other recordings are calibrated against that. Two radars see two
ends of a hull, and how much of each changes as it passes: deviations are larger then, and slow ships tell a latency
hardly better than the 5 s that it is taken to be within, of what the sensor's settings say.

-o FILE is for `maritrack process --calibration FILE`: a file of sensors (settings and offsets together), and lags
for the metrics.

Examples:

    maritrack calibrate rec.cat240 --truth ais.csv --date 2017-11-02 -o calibration.toml

    maritrack process rec.cat240 --truth ais.csv --calibration calibration.toml

    maritrack calibrate north.cat240 south.cat240 --position 53.54,9.97 --sensors places.toml --json
"""


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command(name="calibrate", help=HELP)(calibrate)


def calibrate(
    inputs: Annotated[list[Path], typer.Argument(help="Recordings, several are several sensors.", show_default=False)],
    *,
    preset: opt.Preset = "",
    config: opt.ConfigFile = None,
    sets: opt.Sets = None,
    truth: opt.Truth = None,
    truth_match: opt.TruthMatch = "",
    own_ship: opt.OwnShip = None,
    position: opt.Position = "",
    date: opt.Date = "",
    stabilised: opt.Stabilised = "",
    azimuth_edge: opt.AzimuthEdge = "",
    sensors: opt.SensorsFile = None,
    sensor: opt.Sensor = "",
    limit: opt.Limit = None,
    azimuth: Annotated[float, opt.method("--search-azimuth", "Degrees to either side.")] = 10.0,
    range_: Annotated[float, opt.method("--search-range", "Metres to either side.")] = 200.0,
    time: Annotated[float, opt.method("--search-time", "Seconds to either side.")] = 60.0,
    out: Annotated[Path | None, opt.output("--out", "-o", "File for `process --calibration`.")] = None,
    json_: opt.Json = False,
    quiet: opt.Quiet = False,
) -> None:
    """Parse, calibrate, render."""
    import math

    from maritrack.calibrate.document import to_toml
    from maritrack.calibrate.estimate import calibrate as estimate
    from maritrack.calibrate.search import Span
    from maritrack.config import load_config
    from maritrack.errors import UsageError
    from maritrack.recording import default_preset, kinds_of, open_inputs, side_documents

    from .process import overrides

    if not (0 < azimuth <= 180 and 0 <= range_ <= 5000 and 0 <= time <= 600):
        raise UsageError("--search-azimuth is within 0..180 degrees, -range within 0..5000 m, -time within 0..600 s")
    octets = open_inputs(inputs)
    kinds = kinds_of(octets)
    over = overrides("", None, position, date, stabilised, azimuth_edge, None, sensor, "", None, None, limit, False)
    over |= {"score": {"truth_match": truth_match}} if truth_match else {}
    settings = load_config(preset=preset or default_preset(kinds), file=config, sets=sets or (), over=over)
    side = side_documents(inputs, truth=truth, own_ship=own_ship, sensors=sensors)
    render.note(f"{', '.join(kinds)}: preset {settings.preset}; reading and comparing", quiet=quiet)
    found = estimate(octets, kinds, side, settings, Span(math.radians(azimuth), range_, time))
    if out is not None:
        out.write_text(to_toml(found), "utf-8")
    if json_:
        render.emit_json(asdict(found) | {"file": None if out is None else str(out)})
        return
    _tell(found)
    if out is not None:
        print(f"calibration: {out}")


def _tell(found: Calibration) -> None:
    """For people: the sensors, then the ships."""
    header = ("sensor", "azimuth deg", "+-", "range m", "+-", "latency s", "+-", "ships", "associations", "rms m")
    rows = [
        (
            s.key, f"{s.azimuth_offset_deg:.2f}", f"{s.azimuth_sigma_deg:.2f}", f"{s.range_offset_m:.1f}",
            f"{s.range_sigma_m:.1f}", f"{s.latency_s:.1f}", f"{s.latency_sigma_s:.1f}", str(s.ships),
            str(s.associations), f"{s.rms_m:.0f}",
        )
        for s in found.sensors
    ]  # fmt: skip
    render.table(f"offsets to add, against {found.against} (1 sigma)", header, rows)
    render.table(
        "reports are late by (1 sigma)",
        ("ship", "name", "lag s", "+-", "late", "associations"),
        [
            (
                s.id, s.name[:24], f"{s.lag_s:.1f}", f"{s.lag_sigma_s:.1f}", "yes" if s.late else "no",
                str(s.associations),
            )
            for s in found.ships
        ],
        text_columns=2,
    )  # fmt: skip
