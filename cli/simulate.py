"""`maritrack simulate`: a scene as a CAT240 recording with its truth, AIS and labels."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from . import options as opt
from . import render

HELP = """A simulated radar's recording of a scene: REC.cat240, and beside it what was true.

REC.truth.json holds every object, REC.ais.csv what AIS told of those that have it, REC.labels.parquet whose echo
each cell is (scan, spoke, cell, object; noise and sea have no rows). Equal scene, seed and scans give equal octets.
Of a scene with several radars each has a recording, REC-NAME.cat240, and REC.sensors.toml says where they are.
crossing-3d is one of points in space: REC is maritrack-points/1 with the truth in it.

Examples:

    maritrack simulate harbour -o harbour.cat240

    maritrack simulate far-field -o far.cat240 --scans 240 --no-labels

    maritrack simulate hamburg -o port.cat240 --workers 2 --no-labels
    maritrack process port-*.cat240 --sensors port.sensors.toml --own-ship port.ais.csv --truth port.truth.json \\
        -p abs-port --set subtract.start=empty --set subtract.track_from=start

    maritrack simulate crossing-3d -o crossing.json
    maritrack process crossing.json --preset engm --tracker gm-phd

    maritrack simulate four-ships -o ships.json
    maritrack process ships.json --preset extended

    maritrack simulate darc -o darc.json --images darc-frames
    maritrack process darc-frames --config darc-frames.toml --own-ship darc.ais.csv --truth darc.ais.csv
    maritrack process darc.json --preset dataset --truth darc.ais.csv

    maritrack simulate my-scene.toml -o rec.cat240 --seed 7 --scans 100

    maritrack simulate --list
"""


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command(name="simulate", help=HELP)(simulate)


def simulate(
    scene: Annotated[str, typer.Argument(help="Name of a scene, or a TOML file.", show_default=False)] = "",
    *,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="The recording to write.")] = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of noise and clutter.")] = 1,
    scans: Annotated[int | None, typer.Option("--scans", min=1, help="Rotations; by default the scene's.")] = None,
    ais: Annotated[bool, typer.Option("--ais/--no-ais", help="Write REC.ais.csv.")] = True,
    images: Annotated[Path | None, typer.Option("--images", help="Folder for screenshots of the display.")] = None,
    workers: Annotated[int, typer.Option("--workers", min=1, max=opt.MOST_WORKERS, help="Radars drawn at a time.")] = 1,
    labels: Annotated[bool, typer.Option("--labels/--no-labels", help="Write REC.labels.parquet.")] = True,
    list_: Annotated[bool, typer.Option("--list", help="Names of the scenes.")] = False,
    json_: opt.Json = False,
    quiet: opt.Quiet = False,
) -> None:
    """Parse, simulate, say what was written."""
    from maritrack.errors import UsageError
    from maritrack.simulate.campaign import Campaign
    from maritrack.simulate.campaignwriter import simulate_campaign
    from maritrack.simulate.lidarscene import LidarScene, simulate_lidar
    from maritrack.simulate.pointscene import PointScene, simulate_points
    from maritrack.simulate.record import simulate as write
    from maritrack.simulate.scenes import load_any, scene_names

    if list_:
        render.emit_json({"scenes": list(scene_names())}) if json_ else print("\n".join(scene_names()))
        return
    if not scene or out is None:
        raise UsageError("say which scene and where to: SCENE -o REC", hint="scenes: " + ", ".join(scene_names()))
    loaded = load_any(scene)
    if images is not None and not isinstance(loaded, Campaign):
        raise UsageError("--images is for scenes with a display", hint="daan, darc, manv")
    if isinstance(loaded, (PointScene, LidarScene, Campaign)):
        with render.steps("scan", quiet=quiet) as tick:
            if isinstance(loaded, Campaign):
                told = simulate_campaign(
                    loaded, out, seed=seed, scans=scans, ais=ais, images=images, progress=tick
                )  # fmt: skip
            elif isinstance(loaded, PointScene):
                told = simulate_points(loaded, out, seed=seed, scans=scans, progress=tick)
            else:
                told = simulate_lidar(loaded, out, seed=seed, scans=scans, progress=tick)
        of = f"{told['scans']} scans, {told['points']} points, {told['objects']} objects"
        render.emit_json(told) if json_ else print(f"{told['recording']}: {of}")
        return
    with render.steps("scan", quiet=quiet) as tick:
        written = write(loaded, out, seed=seed, scans=scans, ais=ais, labels=labels, workers=workers, progress=tick)
    if json_:
        render.emit_json(written)
    else:
        recordings = written.get("recordings", [written["recording"]])
        print(f"{', '.join(recordings)}: {written['scans']} scans, {written['octets']} octets")
        print(f"{written['truth']}: {written['objects']} objects, {written['truth_rows']} rows")
        if "sensors" in written:
            print(f"{written['sensors']}: {len(recordings)} sensors")
        if ais:
            print(f"{written['ais']}: {written['ais_reports']} reports")
        if labels:
            print(f"{written['labels']}: {written['labelled_cells']} cells")
