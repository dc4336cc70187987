"""The program `maritrack`: its commands, and how errors become exit codes.

0 done or equal; 1 compared and different; 2 wrong usage, configuration or input; 70 a bug of ours;
130 interrupted; 141 broken pipe.
"""

from __future__ import annotations

import os
import sys
import tempfile
import traceback
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from maritrack import __version__
from maritrack.errors import MaritrackError

from . import (
    batch,
    calibrate,
    config,
    convert,
    diff,
    dump,
    export,
    inspect_images,
    papers,
    play,
    process,
    record,
    replay,
    reproduce,
    score,
    show,
    simulate,
    smooth,
    sweep,
    table,
    tune,
    verify_ais,
)

EXIT_BUG, EXIT_INTERRUPTED, EXIT_PIPE = 70, 130, 141
WrongUsage: Any = typer.BadParameter.__bases__[0]  # of all errors in arguments; Typer gives it no public name


class _Commands(TyperGroup):
    """The commands. Flags that are not given are False, not None, which Typer would check with the help of pydantic:
    a tenth of a second that each `--help` need not pay."""

    def get_params(self, ctx: Any) -> list[Any]:
        params: list[Any] = super().get_params(ctx)
        for param in params:
            if getattr(param, "is_flag", False) and param.default is None:
                param.default = False
        return params


app = typer.Typer(
    name="maritrack",
    cls=_Commands,
    help="Maritime radar recordings through detection, clustering, multi-target tracking and metrics.",
    no_args_is_help=True,
    rich_markup_mode="markdown",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog="Start with: `maritrack simulate harbour -o harbour.cat240 && maritrack process harbour.cat240 --view`",
)
for module in (
    calibrate,
    process,
    replay,
    smooth,
    diff,
    score,
    verify_ais,
    simulate,
    show,
    export,
    dump,
    convert,
    inspect_images,
    record,
    play,
    papers,
    reproduce,
    sweep,
    batch,
    table,
):
    module.register(app)
app.add_typer(config.app, name="config")
app.add_typer(tune.app, name="tune")


def _version(wanted: bool) -> None:
    if wanted:
        print(f"maritrack {__version__}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    pass


def _run() -> int:
    """Run the program and write out what it said. Typer turns a broken pipe into exit 1: told apart by its cause."""
    try:
        code = app(standalone_mode=False)
    except SystemExit as ended:
        if isinstance(ended.__context__, BrokenPipeError):
            raise ended.__context__ from None
        raise
    if sys.stdout is not None:
        sys.stdout.flush()  # not at the interpreter's end, where nobody could answer
    return int(code or 0)


def _tell_usage(error: Any) -> None:
    """One line, and where help is; the program alone gets its help."""
    if not error.format_message():
        error.show()
        return
    told = error.format_message()
    print(f"error: {told[:1].lower()}{told[1:].rstrip('.')}", file=sys.stderr)
    if error.ctx is not None:
        print(f"hint: {error.ctx.command_path} --help", file=sys.stderr)


def _forget_output() -> str:
    """Where standard output can't be written to, drop what is left of it: not an error of its own. Then its name."""
    try:
        print(end="", flush=True)
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        return "standard output: "
    return ""


def main() -> None:
    """Run the program; the only place that catches."""
    try:
        sys.exit(_run())
    except WrongUsage as error:
        _tell_usage(error)
        sys.exit(2)
    except MaritrackError as error:
        print(f"error: {error}", file=sys.stderr)
        if error.hint:
            print(f"hint: {error.hint}", file=sys.stderr)
        sys.exit(2)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # the rest has no reader
        sys.exit(EXIT_PIPE)
    except (KeyboardInterrupt, typer.Abort):
        sys.exit(EXIT_INTERRUPTED)
    except OSError as error:
        output = _forget_output()
        place = f"{error.filename}: " if error.filename else output
        print(f"error: {place}{error.strerror or error}", file=sys.stderr)
        sys.exit(2)
    except Exception as error:  # a bug: keep its traceback, tell in one line
        print(f"internal error: {type(error).__name__}: {error}", file=sys.stderr)
        try:
            descriptor, log = tempfile.mkstemp(prefix="maritrack-", suffix=".log")
            with os.fdopen(descriptor, "w", encoding="utf-8") as file:
                file.write(traceback.format_exc())
            print(f"hint: this is a bug in maritrack; the traceback is in {log}", file=sys.stderr)
        except OSError:
            traceback.print_exc()
        sys.exit(EXIT_BUG)
