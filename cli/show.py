"""`maritrack show`: what an archive or a recording holds."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperCommand

from . import options as opt
from . import render

HELP = """What an archive or a recording holds: manifest, counts and channels; sensors, turns, ranges, losses and gaps.

An archive is read as a whole, so that damage is found; of radar video the headers alone.

Examples:

    maritrack show harbour.cat240

    maritrack show lan.pcapng.gz --json

    maritrack show runs/harbour-jipda-1a2b3c4d --view
"""


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command(name="show", help=HELP, cls=_Show)(show)


class _Show(TyperCommand):
    """The command. Its path and flags need no check by Typer, which would load pydantic: a tenth of a second."""

    def get_params(self, ctx: Any) -> list[Any]:
        params: list[Any] = super().get_params(ctx)
        for param in params:
            if param.name == "what":
                param._runtime_param = _AsPath()
            elif getattr(param, "is_flag", False) and param.default is None:
                param.default = False
        return params


class _AsPath:
    """What Typer asks to turn an argument into its value."""

    def coerce(self, value: Any, **_: Any) -> Path | None:
        return None if value is None else Path(value)


def show(
    what: Annotated[Path, typer.Argument(help="Archive, folder of a run, or recording.", show_default=False)],
    *,
    view: Annotated[bool, typer.Option("--view", help="Open the run's picture in the Rerun viewer.")] = False,
    json_: opt.Json = False,
) -> None:
    """Look, render."""
    from maritrack.errors import UsageError
    from maritrack.show import is_archive, show_archive, show_recording

    path = _in_folder(what) if what.is_dir() else what
    archived = not path.is_dir() and is_archive(path)
    if view:
        picture = path.with_name("run.rrd")
        if not archived or not picture.is_file():
            raise UsageError(f"{what}: no picture beside it", hint="maritrack process or replay writes run.rrd")
        render.view(picture)
        return
    document = show_archive(path) if archived else show_recording(path)
    if json_:
        render.emit_json(document)
    elif document.get("kind") == "cat240":
        from . import radarpage

        radarpage.tell(document)
    else:
        _tell(document)


def _in_folder(folder: Path) -> Path:
    """The archive in the folder of a run; the folder itself where it is a recording."""
    from maritrack.io.images.pack import pack_folder
    from maritrack.replay import archive_path

    return folder if pack_folder(folder) is not None else archive_path(folder)


def _tell(document: dict[str, Any]) -> None:
    """For people: lines of what is single, tables of what is many."""
    for name, value in document.items():
        if isinstance(value, (str, int, float)):
            print(f"{name}: {_text(value)}")
        elif name == "origin" and value:
            print(f"origin: {value['lat_deg']:.6f}, {value['lon_deg']:.6f}")
    for name in ("inputs", "channels", "sensors", "damage"):
        _table(name, [{k: v for k, v in row.items() if not isinstance(v, list)} for row in document.get(name, [])])
    for sensor in document.get("sensors", []):
        _table(f"gaps of {sensor['id']}", sensor["gap_list"])
    single = document | {"warnings": document.get("warnings") or document.get("counts", {}).get("warnings", {})}
    for name in ("side", "counts", "metrics", "warnings", "versions"):
        rows = {key: value for key, value in single.get(name, {}).items() if isinstance(value, (str, int, float))}
        _table(name, [{"what": key, "value": value} for key, value in rows.items()])


def _table(title: str, rows: list[dict[str, Any]]) -> None:
    if rows:
        header = tuple(rows[0])
        render.table(title, header, [tuple(_text(row.get(name)) for name in header) for row in rows])


def _text(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return render.number(value)
