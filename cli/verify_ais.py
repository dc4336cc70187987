"""`maritrack verify-ais`: AIS checked by radar."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from . import options as opt
from . import render

HELP = """AIS checked by radar: which ships a run confirms, which it should see and does not, and who tells no AIS.

Tracks and AIS are matched over time (each scan's best assignment of costs that are means over the scans around it,
by covariances; transponders may be late). A ship is then

- confirmed: a moving track goes with it, or there are echoes all along its way, and few beside it;
- echo: it lies at rest where an echo is: a quay or a buoy would look the same;
- displaced: a track goes as it does, but elsewhere;
- unseen: as few echoes, of a ship that is there, have a probability below --p-unseen. It is that of a ship like those
  that are seen at its range, which differ from each other;
- undecided, and why: too few looks, land or clutter beside it, land before it (--coast), no ship to compare with.

Findings are ships that are unseen or displaced, moving tracks that no ship of AIS explains (those that keep the
range of a confirmed ship are its side lobes, and are listed apart), positions or courses
beyond 3 sigma of their track's, leaps in AIS, and reports that are 10 s late or more (along a straight course late
is the same as displaced). Calibrate the radar first: --azimuth-sigma is what is left of its offset.

Examples:

    maritrack verify-ais run-a/run.mcap --ais ais.nmea.gz -o check

    maritrack verify-ais run-a --ais ais.csv --coast shore.geojson --json

    maritrack verify-ais run-a --ais ais.csv --match 235001841,319541000 --lag 210574000=37
"""


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command(name="verify-ais", help=HELP)(verify_ais)


def verify_ais(
    run: Annotated[Path, typer.Argument(help="Archive of a run, or its folder.", show_default=False)],
    *,
    ais: Annotated[Path, typer.Option("--ais", help="AIS: NMEA, CSV or .mat, also gzip or ZIP.", show_default=False)],
    own_ship: Annotated[str, opt.given("--own-ship", "MMSI of the ship that carries the radar.")] = "",
    match: Annotated[str, opt.given("--match", "MMSI,...: check these ships alone.")] = "",
    lag: Annotated[list[str] | None, opt.given("--lag", "ID=SECONDS: reports of that ship are late.")] = None,
    date: opt.Date = "",
    coast: Annotated[Path | None, opt.given("--coast", "GeoJSON of shores that hide what is behind.")] = None,
    azimuth_sigma: Annotated[float, opt.method("--azimuth-sigma", "Degrees left of the radar's offset.")] = 0.5,
    max_lag: Annotated[float, opt.method("--max-lag", "Seconds that transponders may be late.")] = 60.0,
    max_offset: Annotated[float, opt.method("--max-offset", "Metres that a ship may be displaced.")] = 2000.0,
    p_unseen: Annotated[float, opt.method("--p-unseen", "Probability below which it is unseen.")] = 0.001,
    p_echo: Annotated[float, opt.method("--p-echo", "Probability by chance below which echoes are its own.")] = 0.0001,
    out: Annotated[Path | None, opt.output("--out", "-o", "Folder for verify-ais.json, .geojson, .rrd.")] = None,
    no_rrd: Annotated[bool, opt.output("--no-rrd", "No picture.")] = False,
    view: Annotated[bool, opt.display("--view", "Open the picture in the Rerun viewer.")] = False,
    json_: opt.Json = False,
    quiet: opt.Quiet = False,
) -> None:
    """Parse, check, render."""
    from maritrack.aischeck.check import Options, check_ais
    from maritrack.aischeck.files import write_files
    from maritrack.aischeck.judge import Rules
    from maritrack.aischeck.report import document, hints
    from maritrack.errors import UsageError
    from maritrack.replay import archive_path

    if not (0 <= azimuth_sigma <= 10 and 0 <= max_lag <= 300 and 0 <= max_offset <= 50_000):
        raise UsageError("--azimuth-sigma is within 0..10 degrees, --max-lag within 0..300 s, --max-offset 0..50000 m")
    if not (0 < p_unseen < 1 and 0 < p_echo < 1):
        raise UsageError("--p-unseen and --p-echo are between 0 and 1")
    if view and (out is None or no_rrd):
        raise UsageError("--view needs a picture", hint="name a folder with -o")
    options = Options(azimuth_sigma, max_lag, max_offset, match, own_ship, Rules(p_unseen, p_echo))
    path = archive_path(run)
    check = check_ais(path, ais, options, coast=coast, lags=lag or (), date=date)
    told = render.finite(document(check, run=str(run), ais=str(ais)))
    outputs = {} if out is None else write_files(check, told, out, rrd=not no_rrd)
    if json_:
        render.emit_json(told | {"outputs": outputs})
    else:
        _tell(told, outputs)
    for hint in hints(check):
        render.note(f"note: {hint}", quiet=quiet)
    if view:
        render.view(Path(outputs["rrd"]))


def _tell(told: dict[str, Any], outputs: dict[str, str]) -> None:
    """For people: findings, ships, how well the radar sees."""
    counts = ", ".join(f"{n} {verdict}" for verdict, n in told["counts"].items())
    print(f"{len(told['ships'])} ships of AIS looked at in {told['scans']} scans: {counts or 'none'}")
    if not told["findings"]:
        print("findings: none")
    who = [str(row.get("name") or row.get("ship") or f"track {row['track']}") for row in told["findings"]]
    found = [(row["kind"], name[:24], row["what"]) for row, name in zip(told["findings"], who, strict=True)]
    render.table("findings", ("kind", "ship or track", "what"), found, text_columns=3)
    rows = [
        (
            (s["name"] or s["id"])[:24], s["verdict"], s["why"],
            f"{s['range_min_m'] / 1e3:.1f}-{s['range_max_m'] / 1e3:.1f}", f"{s['hits']}/{s['looks']}",
            render.number(s["p_if_there"]), render.number(s["p_by_chance"]), str(s["matched_scans"]),
            _sigmas(s["offset_sigmas"]), f"{s['lag_s']:.0f}",
        )
        for s in told["ships"]
    ]  # fmt: skip
    header = ("ship", "verdict", "why", "km", "echoes", "P if there", "P by chance", "matched", "sigmas off", "lag s")
    render.table("ships", header, rows, text_columns=3)
    lobes = [
        (f"track {t['track']}", t["side_lobe_of"], str(t["scans"]))
        for t in told["tracks_without_ais"] if t["side_lobe_of"]
    ]  # fmt: skip
    render.table(
        "at the range of a ship all the time: its side lobes?", ("track", "ship", "scans"), lobes, text_columns=2
    )
    rings = [
        (f"{r['from_m'] / 1e3:g}-{r['to_m'] / 1e3:g}", str(r["ships"]), f"{r['hits']}/{r['looks']}",
         render.number(r["p_detect"]), f"{r['low']:.2f}-{r['high']:.2f}")
        for r in told["seeing"]["rings"]
    ]  # fmt: skip
    render.table("echoes of ships that are seen, by range", ("km", "ships", "looks", "P of another", "95 %"), rings)
    render.table("left out", ("code", "count"), [(code, str(n)) for code, n in told["warnings"].items()])
    for kind, path in outputs.items():
        print(f"{kind}: {path}")


def _sigmas(value: float | None) -> str:
    return "-" if value is None else f"{value:.1f}"
