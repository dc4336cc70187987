"""The architecture as tests: who imports whom, what is never called, and what is packaged."""

from __future__ import annotations

import ast
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.shared import ROOT

SETTINGS = {
    "tracksettings", "intensitysettings", "contoursettings", "centroidsettings", "imagesettings", "rwmrsettings",
}  # fmt: skip
BASE = {"errors", "types", "settings"} | SETTINGS
DENSITY = BASE | {"geo", "objects", "associate"}
LINE = DENSITY | {"cluster", "detect", "metrics", "trackers"}
BELOW = {  # what each part of the package may import besides itself
    "errors": set[str](),
    "types": {"errors"},
    "presets": set[str](),
    "scenes": set[str](),
    "geo": BASE,
    "limits": {"errors"},
    "tracksettings": {"errors", "limits"},
    "intensitysettings": {"errors", "limits"},
    "contoursettings": {"errors", "limits"},
    "centroidsettings": {"errors", "limits"},
    "imagesettings": {"errors", "limits"},
    "rwmrsettings": {"errors", "limits"},
    "settings": {"errors", "limits"} | SETTINGS,
    "config": {"errors", "settings"},
    "objects": BASE | {"geo"},
    "associate": BASE,
    "cluster": DENSITY,
    "detect": DENSITY,
    "metrics": DENSITY,
    "trackers": DENSITY | {"cluster"},
    "chain": LINE,
    "io": BASE | {"config", "geo"},  # knows nothing of what is made of the points
    "sinks": BASE | {"geo", "io", "detect"},
    "simulate": BASE | {"config", "geo", "io", "fanout", "objects"},
    "manifest": BASE | {"config", "io"},
    "recording": BASE | {"geo", "io"},
    "tolerances": {"errors"},
    "sides": {"errors", "io"},
    "diff": BASE | {"io", "sides", "tolerances"},
    "junit": {"diff"},
    "verify": BASE | {"io", "diff", "tolerances"},
    "outlines": BASE | {"geo", "io", "metrics"},
    "export": BASE | {"geo", "io", "outlines"},
    "remarks": LINE | {"chain"},
    "run": LINE | {"chain", "io", "remarks"},
    "job": LINE | {"chain", "io", "manifest", "recording", "run", "sinks"},
    "replay": BASE | {"config", "io", "manifest", "recording", "job", "run", "sinks", "verify"},
    "score": LINE | {"chain", "io", "recording", "replay", "run"},
    "retrospect": BASE | {"objects"},
    "smooth": LINE | {"chain", "io", "job", "replay", "retrospect", "run"},
    "aischeck": LINE | {"config", "io", "retrospect", "sinks"},
    "calibrate": LINE | {"chain", "io", "recording", "retrospect"},
    "convert": BASE | {"io"},
    "imageguess": BASE | {"io"},
    "live": BASE | {"io"},
    "survey": BASE | {"geo", "io"},
    "show": BASE | {"config", "io", "recording", "survey"},
    "papers": BASE | {"config", "trackers"},
    "fanout": {"errors"},
    "reproduce": LINE
    | {"chain", "config", "fanout", "io", "job", "manifest", "recording", "run", "simulate", "sinks", "tune"},
    "tune": LINE | {"chain", "config", "fanout", "io", "job", "recording", "run", "simulate"},
    "sweep": LINE
    | {"chain", "config", "fanout", "io", "job", "manifest", "recording", "run", "simulate", "sinks", "tune"},
}
READING = {  # the packages of `maritrack.io`, and which of the others each may import
    "cat240": set[str](),
    "turns": {"cat240"},
    "containers": {"cat240"},
    "rewrite": {"cat240", "containers"},
    "images": set[str](),
    "rwmr": {"images"},
}
ONLY_IN = {  # libraries that stay where they are
    "typer": ("cli/",),
    "rich": ("cli/",),
    "rerun": (
        "maritrack/sinks/rerun.py",
        "maritrack/sinks/batch.py",
        "maritrack/sinks/blueprint.py",
        "maritrack/sinks/curves.py",
        "maritrack/sinks/aismap.py",
    ),
    "mcap": ("maritrack/io/archive.py", "maritrack/io/containers/mcap_writer.py", "maritrack/sinks/mcap.py"),
    "sklearn": ("maritrack/cluster/", "maritrack/metrics/clusters.py"),
    "maritrack_cli": (),
    "pickle": (),
    "shelve": (),
    "marshal": (),
    "random": (),
    "uuid": (),
    "secrets": (),
}
LATE = ("rerun", "sklearn", "skimage", "pymap3d")  # slow to load: inside of functions, but for the picture's own files
DRAWS = ("default_rng", "SeedSequence", "Generator", "Philox", "PCG64")  # of numpy.random: seeded, without memory
NEVER_CALLED = ("eval", "exec", "compile", "__import__", "input", "breakpoint")
CLOCKS = ("time.time", "time.time_ns", "datetime.now", "datetime.utcnow", "datetime.today", "date.today",
          "time.localtime", "time.gmtime", "datetime.datetime.now", "time.strftime", "time.ctime")  # fmt: skip
CPU_TIME_IN = ("maritrack/chain.py", "maritrack/run.py")  # for the summary's timing alone

FILES = [path for folder in ("maritrack", "cli") for path in sorted((ROOT / folder).rglob("*.py"))]
LIBRARY = [path for path in FILES if path.is_relative_to(ROOT / "maritrack")]
each_file = pytest.mark.parametrize("path", FILES, ids=lambda path: path.relative_to(ROOT).as_posix())
each_library_file = pytest.mark.parametrize("path", LIBRARY, ids=lambda path: path.relative_to(ROOT).as_posix())


def tree_of(path: Path) -> ast.Module:
    return ast.parse(path.read_text("utf-8"))


def imported(tree: ast.AST) -> Iterator[str]:
    """Full names of imported modules; of `from package import name` both readings."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def called(tree: ast.AST) -> Iterator[str]:
    yield from (ast.unparse(node.func) for node in ast.walk(tree) if isinstance(node, ast.Call))


def parts(tree: ast.AST) -> set[str]:
    """Parts of the package that a module imports."""
    names = {name.split(".")[1] for name in imported(tree) if name.startswith("maritrack.")}
    return names - {"__version__"}


@each_library_file
def test_imports_go_one_way(path: Path) -> None:
    inner = path.relative_to(ROOT / "maritrack")
    part = inner.parts[0].removesuffix(".py")
    if part == "__init__":
        return
    assert part in BELOW, f"tell in BELOW what {part} may import"
    assert parts(tree_of(path)) - {part} <= BELOW[part]


def test_the_parts_that_may_be_imported_make_no_ring() -> None:
    done: set[str] = set()
    while left := {part for part in BELOW if part not in done}:
        free = {part for part in left if BELOW[part] <= done}
        assert free, f"ring among {sorted(left)}"
        done |= free


@each_library_file
def test_the_packages_of_reading_import_one_way(path: Path) -> None:
    inner = path.relative_to(ROOT / "maritrack").parts
    if len(inner) == 3 and inner[0] == "io":
        names = {name.split(".")[2] for name in imported(tree_of(path)) if name.startswith("maritrack.io.")}
        assert (names & set(READING)) - {inner[1]} <= READING[inner[1]]


@each_file
def test_libraries_stay_where_they_are(path: Path) -> None:
    name = path.relative_to(ROOT).as_posix()
    for module in {full.split(".")[0] for full in imported(tree_of(path))} & set(ONLY_IN):
        assert name.startswith(ONLY_IN[module]) if ONLY_IN[module] else False, f"{name} imports {module}"


@each_file
def test_what_is_slow_to_load_is_loaded_inside_of_functions(path: Path) -> None:
    if path.relative_to(ROOT).as_posix() in ONLY_IN["rerun"]:
        return
    top = [node for node in tree_of(path).body if isinstance(node, ast.Import | ast.ImportFrom)]
    names = {name.split(".")[0] for node in top for name in imported(ast.Module([node], []))}
    assert not names & set(LATE)


@each_library_file
def test_nothing_depends_on_clock_chance_or_text_that_runs(path: Path) -> None:
    name, calls = path.relative_to(ROOT).as_posix(), list(called(tree_of(path)))
    for call in calls:
        assert call not in NEVER_CALLED and call not in CLOCKS, f"{name} calls {call}"
        assert not call.startswith(("time.perf_counter", "time.monotonic")), f"{name} calls {call}"
        assert not call.startswith("time.process_time") or name in CPU_TIME_IN, f"{name} calls {call}"
        if "np.random." in call or "numpy.random." in call:
            assert call.rpartition(".")[2] in DRAWS, f"{name} calls {call}, which has a memory"


@each_library_file
def test_no_generator_without_a_seed(path: Path) -> None:
    for node in ast.walk(tree_of(path)):
        if isinstance(node, ast.Call) and ast.unparse(node.func).endswith("default_rng"):
            assert node.args or node.keywords, f"{path.name}:{node.lineno}"


@each_file
def test_no_exception_is_swallowed_whole(path: Path) -> None:
    for node in ast.walk(tree_of(path)):
        if isinstance(node, ast.ExceptHandler):
            caught = "" if node.type is None else ast.unparse(node.type)
            again = any(isinstance(inner, ast.Raise) and inner.exc is None for inner in ast.walk(node))
            last_resort = caught == "Exception" and (path == ROOT / "cli" / "main.py" or "told" in called(node))
            assert caught not in ("", "Exception", "BaseException") or again or last_resort, f"{path}:{node.lineno}"


@each_library_file
def test_the_library_neither_prints_nor_exits(path: Path) -> None:
    assert not {"print", "exit", "quit", "sys.exit", "os._exit"} & set(called(tree_of(path)))


def test_the_packages_that_are_installed_are_those_of_the_tree() -> None:
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["setuptools"]
    tree = {path.parent.relative_to(ROOT).as_posix().replace("/", ".") for path in LIBRARY}
    assert set(settings["packages"]) == tree | {"maritrack_cli"}
    assert all((path.parent / "__init__.py").is_file() for path in FILES)
    data = {path.parent for path in (ROOT / "maritrack").rglob("*.toml")}
    assert {package.replace(".", "/") for package in settings["package-data"]} == {
        path.relative_to(ROOT).as_posix() for path in data
    }


def test_what_is_imported_is_a_dependency() -> None:
    import sys

    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    names = {"rerun-sdk": "rerun", "scikit-learn": "sklearn", "foxglove-schemas-protobuf": "foxglove_schemas_protobuf",
             "protobuf": "google", "pillow": "PIL", "scikit-image": "skimage", "python-deflate": "deflate"}  # fmt: skip
    told = {text.split(">")[0].split("[")[0].strip() for text in project["dependencies"]}
    extras = project["optional-dependencies"]
    told |= {text.split(">")[0] for text in extras["fast"] + extras["dask"]}
    known = {names.get(name, name) for name in told} | set(sys.stdlib_module_names) | {"maritrack", "maritrack_cli"}
    foreign = {name.split(".")[0] for path in FILES for name in imported(tree_of(path))} - known
    assert not foreign, f"imported but no dependency: {sorted(foreign)}"
