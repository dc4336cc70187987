"""`maritrack papers`: equations of the papers and where they live."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from . import options as opt
from . import render

HELP = """Equations of the papers: what they say, where they live in the code, which tests show them.

Examples:

    maritrack papers

    maritrack papers polar-9

    maritrack papers --assumed --json
"""


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command(name="papers", help=HELP)(papers)


def papers(
    key: Annotated[str, typer.Argument(help="A paper (polar) or an equation (polar-9).", show_default=False)] = "",
    *,
    tracker: Annotated[str, opt.method("--tracker", "-t", "Only what this tracker is made of.")] = "",
    deviations: Annotated[bool, opt.display("--deviations", "Where the code departs from the papers.")] = False,
    assumed: Annotated[bool, opt.display("--assumed", "Numbers of the presets that no paper gives.")] = False,
    json_: opt.Json = False,
) -> None:
    """Look up, render."""
    from maritrack import papers as lib

    chosen = lib.select(key)
    if assumed:
        rows = [{"preset": a.preset, "key": a.key, "value": a.value, "reason": a.reason} for a in lib.assumed()]
        _show("assumed", rows, json_)
    elif deviations:
        keys = {equation.key for equation in chosen}
        _show("deviations", [_deviation(d) for d in lib.deviations() if d.key in keys], json_)
    else:
        files = lib.files_of_tracker(tracker) if tracker else None
        homes, marks = lib.homes(), lib.marks()
        rows = [_equation(e, homes.get(e.key, []), marks.get(e.key, []), brief=not json_) for e in chosen]
        if files is not None:
            within = [any(place.file in files for place in homes.get(e.key, [])) for e in chosen]
            rows = [row for row, wanted in zip(rows, within, strict=True) if wanted]
        _show("equations", rows, json_)


def _equation(equation: Any, homes: list[Any], tests: list[Any], *, brief: bool) -> dict[str, Any]:
    """A row: for people the places in one line, for programs as lists."""
    row = {"equation": equation.key, "meaning": equation.meaning}
    if brief:
        places = {"home": " ".join(map(str, homes)), "tests": " ".join(map(str, tests))}
        return row | {name: places[name] or "-" for name in places}
    return row | {"paper": equation.paper, "number": equation.number, "homes": _places(homes), "tests": _places(tests)}


def _places(places: list[Any]) -> list[dict[str, Any]]:
    return [{"file": place.file, "line": place.line, "name": place.name} for place in places]


def _deviation(deviation: Any) -> dict[str, Any]:
    return {"equation": deviation.key, "place": str(deviation.place), "text": deviation.text}


def _show(name: str, rows: list[dict[str, Any]], as_json: bool) -> None:
    if as_json:
        render.emit_json({name: rows})
    elif rows:
        header = tuple(rows[0])
        render.table(name, header, [tuple(row.values()) for row in rows], text_columns=len(header))
    else:
        render.note(f"no {name}")
