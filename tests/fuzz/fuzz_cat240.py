"""Look for octets that break the reader of recordings, with atheris, from the corpus of the tests on.

python -m tests.fuzz.fuzz_cat240 SECONDS [FOLDER]

What breaks it is left in FOLDER (the working folder) as crash-*; made small, it belongs into tests/io/corpus.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

try:
    import atheris
except ImportError:
    sys.exit("atheris is not installed: pip install atheris")

with atheris.instrument_imports(include=["maritrack.io", "maritrack.survey"]):
    from tests.fuzz.target import check, corpus


def one(data: bytes) -> None:
    check(data)


def main() -> None:
    seconds, folder = int(sys.argv[1]), sys.argv[2] if len(sys.argv) > 2 else "."
    with tempfile.TemporaryDirectory() as seeds:
        for i, entry in enumerate(corpus()):
            (Path(seeds) / f"{i:03}").write_bytes(entry.octets)
        options = [f"-max_total_time={seconds}", "-max_len=4096", "-timeout=60", f"-artifact_prefix={folder}/", seeds]
        atheris.Setup([sys.argv[0], *options], one)
        atheris.Fuzz()


if __name__ == "__main__":
    main()
