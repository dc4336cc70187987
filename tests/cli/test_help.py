"""Help of every command, and wrong use of any."""

from __future__ import annotations

import subprocess
import sys

import pytest
from maritrack_cli.main import app
from typer.testing import CliRunner

from tests.cli.calling import call, spawn

COMMANDS = (
    "process", "replay", "diff", "score", "simulate", "show", "export", "dump", "convert", "record", "play", "papers",
    "reproduce", "sweep", "batch", "table",
)  # fmt: skip
HEAVY = ("numpy", "scipy", "sklearn", "rerun", "mcap", "google.protobuf", "pymap3d")


@pytest.mark.parametrize("command", COMMANDS)
def test_help_says_what_the_command_does_and_gives_examples(command: str) -> None:
    done = CliRunner().invoke(app, [command, "--help"], env={"COLUMNS": "200"})
    assert done.exit_code == 0
    assert f"maritrack {command}" in done.output and "Examples" in done.output


@pytest.mark.parametrize("command", ["list", "show", "check"])
def test_help_of_config_names_its_parts(command: str) -> None:
    assert command in CliRunner().invoke(app, ["config", "--help"]).output
    assert CliRunner().invoke(app, ["config", command, "--help"]).exit_code == 0


def test_help_of_simulate_tracks_the_port_with_the_preset_that_holds_its_ships() -> None:
    """Pixels of 100 m, as of preset `radar`, fill a river of 500 m; those of `abs-port` do not."""
    said = CliRunner().invoke(app, ["simulate", "--help"], env={"COLUMNS": "200"}).output
    port = said[said.index("process port-*.cat240") :]
    assert "-p abs-port --set subtract.start=empty --set subtract.track_from=start" in port


def test_help_lists_every_command() -> None:
    output = CliRunner().invoke(app, ["--help"]).output
    assert all(command in output for command in (*COMMANDS, "config", "tune"))


def test_help_loads_nothing_heavy() -> None:
    code = "import sys, maritrack_cli.main; print([m for m in sys.argv[1:] if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code, *HEAVY], capture_output=True, check=True)
    assert done.stdout.strip() == b"[]"


def test_version_is_that_of_the_package() -> None:
    from maritrack import __version__

    assert call("--version").out == f"maritrack {__version__}\n"


@pytest.mark.parametrize("command", COMMANDS)
def test_an_unknown_option_is_wrong_use(command: str) -> None:
    done = call(command, "--no-such-option")
    assert done.code == 2 and done.out == "" and "--no-such-option" in done.err


def test_an_unknown_command_is_wrong_use() -> None:
    assert spawn("no-such-command").code == 2


def test_no_command_shows_the_help() -> None:
    done = spawn()
    assert done.code == 2 and "process" in done.out + done.err
