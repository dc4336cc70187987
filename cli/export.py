"""`maritrack export`: tables and maps of a run."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from . import render

HELP = """Tracks, points and clusters of a run as CSV, tracks and their outlines as GeoJSON. "-" is standard output.

Examples:

    maritrack export run.mcap --tracks tracks.csv --geojson tracks.geojson

    maritrack export run.mcap --outlines hulls.geojson --moving

    maritrack export run.mcap --tracks - --moving | column -s, -t | less -S
"""


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command(name="export", help=HELP)(export)


def export(
    run: Annotated[Path, typer.Argument(help="Archive of a run, or its folder.", show_default=False)],
    *,
    tracks: Annotated[Path | None, typer.Option("--tracks", help="CSV, a row a track and scan.")] = None,
    points: Annotated[Path | None, typer.Option("--points", help="CSV, a row a detected point.")] = None,
    clusters: Annotated[Path | None, typer.Option("--clusters", help="CSV, a row a cluster.")] = None,
    geojson: Annotated[Path | None, typer.Option("--geojson", help="A line a track, in degrees.")] = None,
    outlines: Annotated[
        Path | None, typer.Option("--outlines", help="A polygon a track and scan: GeoJSON, or WKT in a .csv.")
    ] = None,
    moving: Annotated[bool, typer.Option("--moving", help="Only tracks under way.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="No notes.")] = False,
) -> None:
    """Parse, export, say how much it was."""
    from maritrack.export import export as write
    from maritrack.replay import archive_path

    path = archive_path(run)
    done = write(
        path, tracks=tracks, points=points, clusters=clusters, geojson=geojson, outlines=outlines, moving=moving
    )
    for damage in done.damage:
        render.note(f"warning: {path}: {damage.message}")
    targets = {"tracks": tracks, "points": points, "clusters": clusters, "geojson": geojson, "outlines": outlines}
    for name, count in done.rows.items():
        if str(targets[name]) != "-":
            render.note(f"{targets[name]}: {count} {name if name != 'geojson' else 'tracks'}", quiet=quiet)
