"""`maritrack inspect-images`: a proposal for the settings of a folder of radar images."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from . import options as opt
from . import render

HELP = """Propose the settings of a folder (or ZIP) of radar images: centre, disc, rings, lines, panels and colours.

Prints a TOML file for `maritrack process -c`; what it is not sure of is said in its comments. Metres a pixel need
the range scale, which stands in the images as text: tell it with --range or --ring.

Examples:

    maritrack inspect-images frames/ --range 3NM -o proposal.png > images.toml

    maritrack process frames/ -c images.toml

    maritrack inspect-images frames.zip --ring 0.5NM --json
"""


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command(name="inspect-images", help=HELP)(inspect_images)


def inspect_images(
    images: Annotated[Path, typer.Argument(help="Folder, ZIP or TAR of images.", show_default=False)],
    range_: Annotated[str, opt.given("--range", "From the centre to the edge of the disc: 3NM, 5.5km, 800m.")] = "",
    ring: Annotated[str, opt.given("--ring", "From one range ring to the next.")] = "",
    out: Annotated[Path | None, opt.output("--out", "-o", "PNG with the proposal drawn over a frame.")] = None,
    json_: opt.Json = False,
) -> None:
    """Look, propose, draw."""
    from maritrack.errors import InputError, UsageError
    from maritrack.imageguess.draw import as_toml, overlay
    from maritrack.imageguess.proposal import parse_distance, propose
    from maritrack.imageguess.sample import sample
    from maritrack.io import sniff
    from maritrack.io.octets import octets_from_file

    ring_m, range_m = parse_distance(ring, "--ring"), parse_distance(range_, "--range")
    if ring_m and range_m:
        raise UsageError("--range or --ring, not both")
    octets = octets_from_file(images, "")
    if sniff(octets.head, octets.name) != "images":
        raise InputError(f"{images}: no folder and no archive of images", hint="name the folder of the images itself")
    of = sample(octets)
    proposal = propose(of, ring_m=ring_m, range_m=range_m)
    if out is not None:
        overlay(of, proposal).save(out, "PNG")
    if json_:
        notes = [{"about": n.about, "sure": n.sure, "text": n.text} for n in proposal.notes]
        document = {"images": proposal.settings, "notes": notes, "frames": of.count, "looked_at": len(of.frames)}
        render.emit_json(document | {"rings_px": proposal.rings_px, "spacing_px": proposal.spacing_px})
    else:
        print(as_toml(proposal), end="")
