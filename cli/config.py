"""`maritrack config`: presets, the resolved configuration, and whether a file is sound."""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import Annotated

import typer

from . import options as opt
from . import render

HELP = """Presets, the resolved configuration, and whether a file is sound.

Later wins: default, preset, `--config FILE`, `--set KEY=VALUE`, named option.

Examples:

    maritrack config list

    maritrack config show radar --set model.p_detect=0.9 > my.toml

    maritrack config check my.toml
"""

app = typer.Typer(help=HELP, no_args_is_help=True)


@app.command(name="list")
def list_(json_: opt.Json = False) -> None:
    """Presets, trackers and scenes by name."""
    from maritrack.config import preset_names
    from maritrack.simulate.scenes import scene_names

    presets = {name: _first_comment("maritrack.presets", name) for name in preset_names()}
    scenes = {name: _first_comment("maritrack.scenes", name) for name in scene_names()}
    trackers = _trackers()
    if json_:
        render.emit_json({"presets": presets, "trackers": trackers, "scenes": scenes})
        return
    for title, names in (("preset", presets), ("tracker", trackers), ("scene", scenes)):
        render.table(f"{title}s", (title, "what it is"), list(names.items()), text_columns=2)


@app.command()
def show(
    preset: Annotated[str, typer.Argument(help="Preset; without one the defaults.", show_default=False)] = "",
    config: opt.ConfigFile = None,
    sets: opt.Sets = None,
    tracker: opt.Tracker = "",
    seed: opt.Seed = None,
) -> None:
    """All settings as TOML, as they go into the archive of a run."""
    from maritrack.config import load_config, to_toml

    given = {"tracker_name": tracker or None, "seed": seed}
    over = {key: value for key, value in given.items() if value is not None}
    print(to_toml(load_config(preset=preset, file=config, sets=sets or (), over=over)), end="")


@app.command()
def check(file: Annotated[Path, typer.Argument(help="TOML as for `--config`.", show_default=False)]) -> None:
    """Whether `--config FILE` would be taken: exit 0, else 2 and what is wrong."""
    from maritrack.config import load_config
    from maritrack.errors import ConfigError

    try:
        name = load_config(preset="", file=file).tracker_name
        known = _trackers()
        if name not in known:
            raise ConfigError(f"tracker_name = '{name}'", hint="trackers: " + ", ".join(known))
    except ConfigError as error:
        told = str(error) if str(file) in str(error) else f"{file}: {error}"
        raise ConfigError(told, hint=error.hint) from None
    print(f"{file}: ok")


def _trackers() -> dict[str, str]:
    """Names of the trackers and the first lines of their modules."""
    import sys

    from maritrack.trackers import TRACKERS

    return {name: (sys.modules[build.__module__].__doc__ or "").partition("\n")[0] for name, build in TRACKERS.items()}


def _first_comment(package: str, name: str) -> str:
    text = resources.files(package).joinpath(f"{name}.toml").read_text("utf-8")
    return text.partition("\n")[0].removeprefix("#").strip()
