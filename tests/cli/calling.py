"""The program called as from a shell: in this process where that will do, in one of its own where it won't."""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest.mock import patch

from maritrack_cli.main import main

COMMAND = (sys.executable, "-c", "from maritrack_cli.main import main; main()")
ENVIRONMENT = os.environ | {"COLUMNS": "200", "NO_COLOR": "1", "TERM": "dumb"}


@dataclass(frozen=True)
class Done:
    """What a call left behind."""

    code: int
    out: str
    err: str

    @property
    def json(self) -> Any:
        """Standard output as the one JSON document that it has to be."""
        return json.loads(self.out)

    @property
    def error(self) -> str:
        """The error, which has to be one line, a hint apart, with nothing on standard output."""
        lines = [line for line in self.err.splitlines() if not line.startswith(("hint: ", "note: "))]
        assert len(lines) == 1 and lines[0].startswith("error: ") and self.out == "", (self.out, self.err)
        return lines[0].removeprefix("error: ")


def call(*arguments: str | Path) -> Done:
    """The program with these arguments, all of `main` included, in this process."""
    out, err = io.StringIO(), io.StringIO()
    with patch.object(sys, "argv", ["maritrack", *map(str, arguments)]), redirect_stdout(out), redirect_stderr(err):
        code: Any = 0
        try:
            main()
        except SystemExit as ended:
            code = ended.code or 0
    return Done(int(code), out.getvalue(), err.getvalue())


def spawn(*arguments: str | Path, **options: Any) -> Done:
    """The program in a process of its own."""
    done = subprocess.run(
        [*COMMAND, *map(str, arguments)], capture_output=True, env=ENVIRONMENT, timeout=120, check=False, **options
    )
    return Done(done.returncode, done.stdout.decode(), done.stderr.decode())


@contextmanager
def start(*arguments: str | Path, **options: Any) -> Iterator[subprocess.Popen[bytes]]:
    """The program in a process of its own that goes on beside the test, and ends with it."""
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen([*COMMAND, *map(str, arguments)], env=ENVIRONMENT, **pipes, **options) as process:
        try:
            yield process
        finally:
            process.kill()
