"""From the papers' equations to the code and back.

A numbered equation has one home: the docstring that names it after `Eq:` as paper, dash, number. Where
the code departs from it, the docstring says so after `Deviates:` and the equation. Tests name what they
show with `@pytest.mark.eq("polar-4")`. Read from the sources, so nothing has to be kept in step.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from maritrack.config import preset_names
from maritrack.errors import UsageError

ROOT = Path(__file__).parent

PAPERS = {
    "polar": "Polar Cluster-Based Target Tracking for Maritime Radar Applications (Paes Moreira, Romanovas)",
    "abs": "Unsupervised Adaptive Background Subtraction in Distributed Radar Target Tracking Systems (Fowdur, Eksen,"
    " Paes Moreira, Banys)",
    "engm": "Kernel-Based Ensemble Gaussian Mixture Probability Hypothesis Density Filter (Durant, Zanetti)",
    "extended": "Comparing Multiple Extended Object Tracking with Point Based Multi Object Tracking for LiDAR in a"
    " Maritime Context (Baerveldt, Hem, Brekke)",
    "dataset": "Real-World Marine Radar Datasets for Evaluating Target Tracking Methods (Fowdur, Baum, Heymann)",
}
DONE = ("polar", "engm", "extended", "dataset")  # papers all of whose numbered equations have a home

_MEANING = {
    "polar-1": "a detection at range and azimuth on the plane",
    "polar-2": "a detection on the lateral surface of a cylinder of radius R",
    "polar-3": "that surface unrolled: (R phi, r)",
    "polar-4": "distance on it, the shorter way round, in metres with R = sigma_r / sigma_phi",
    "polar-5": "centroid of a cluster, weighted by intensity",
    "polar-6": "scatter of a cluster, weighted by intensity, n times the weighted mean",
    "polar-7": "extent at the steady state, with which new tracks start",
    "polar-8": "marginal association weights: sums over the joint events",
    "polar-9": "likelihood of a cluster, track against clutter, as one observation",
    "polar-10": "Wishart densities of a cluster's scatter, object and clutter",
    "polar-11": "covariance of the innovation, which shrinks with the size of the cluster",
    "polar-12": "covariance of the gate, with the full extent",
    "abs-1": "measurements of a step: those of all sensors, ashore and aboard",
    "abs-5": "state of a target: position, velocity, orientation and two semi-axes",
    "abs-6": "posterior of several sensors: likelihoods multiplied, one sensor after the other",
    "abs-7": "at the beginning all counts of a pixel are equally likely",
    "abs-8": "stochastic weak estimation of how likely each count is",
    "abs-9": "distance of two distributions, by which the model has converged or not",
    "engm-1": "the integral of the intensity over a region is the number of objects expected there",
    "engm-2": "predicted intensity: survivors and births",
    "engm-3": "intensity of the survivors; spawning is not modelled",
    "engm-4": "updated intensity: missed, and a term for each measurement",
    "engm-5": "GM-PHD: the prior, a mixture of survived and born components",
    "engm-6": "GM-PHD: the posterior mixture",
    "engm-7": "SMC-PHD: the prior, particles",
    "engm-8": "SMC-PHD: the posterior, the same particles with other weights",
    "engm-9": "SMC-PHD: those weights",
    "engm-10": "EnGM-PHD: the prior as particles",
    "engm-11": "EnGM-PHD: each particle a Gaussian component of equal weight",
    "engm-12": "EnGM-PHD: its covariance, beta over the number of objects times that of all particles",
    "engm-13": "Silverman's bandwidth beta",
    "engm-14": "EnGM-PHD: the posterior mixture",
    "engm-15": "EnGM-PHD, update: weight of a component",
    "engm-16": "EnGM-PHD, update: likelihood of a measurement",
    "engm-17": "EnGM-PHD, update: innovation",
    "engm-18": "EnGM-PHD, update: covariance of the innovation",
    "engm-19": "EnGM-PHD, update: Jacobian of the measurement",
    "engm-20": "EnGM-PHD, update: gain",
    "engm-21": "EnGM-PHD, update: mean",
    "engm-22": "EnGM-PHD, update: covariance",
    "engm-23": "a prior of survivors and births, whose weights differ",
    "engm-24": "the same as mixtures",
    "engm-25": "algorithm 2: particles drawn from both, of one weight, as a mixture",
    "engm-26": "algorithm 2: covariance of their kernels",
    "engm-27": "algorithm 2: bandwidth for their number",
    "engm-28": "one object: the prior is a density",
    "engm-29": "one object: its bandwidth",
    "engm-30": "one object, always seen, no clutter: the posterior is a density",
    **{
        f"engm-{number}": f"one object: the update of the ensemble Gaussian mixture filter, as {number - 16}"
        for number in range(31, 39)
    },
    "engm-39": "state: position and velocity in space",
    "engm-40": "experiment: the first object's state",
    "engm-41": "experiment: the second object's state",
    "engm-42": "experiment: the filters begin with one component of hardly any weight",
    "engm-43": "experiment: clutter uniform in a box of space",
    "engm-44": "experiment: mean of the births",
    "engm-45": "experiment: covariance of the births",
    "extended-1": "state of a hull: centre, heading, velocities, radius at equidistant angles",
    "extended-2": "its motion and measurement, all points of a scan stacked",
    "extended-3": "a point on the contour: centre and radius at its angle",
    "extended-4": "the angle of a point in the frame of the hull, which depends on centre and heading",
    "dataset-1": "motion at constant course and speed",
    "dataset-2": "a measurement is the place, with the noise of a converted range and azimuth",
    "dataset-3": "the gate, an ellipse about the predicted place",
    "dataset-4": "covariance of the innovation, with the dispersion of the echoes of the scan before",
    "dataset-5": "dispersion: covariance of the echoes in the gate of a vessel, or of its body alone",
    "dataset-6": "which centroids are in whose gates",
    "dataset-7": "a centroid is in a gate or not",
    "dataset-8": "joint events: each centroid is of one vessel or clutter",
    "dataset-9": "probability of a joint event",
    "dataset-10": "density of a centroid that is a vessel's or clutter",
    "dataset-11": "prior of an event: which vessels were seen",
    "dataset-12": "marginal probability that a centroid is of a vessel",
}

_KEY = r"[a-z]+-[a-z0-9]+"
_EQ = re.compile(rf"\bEq:\s*({_KEY}(?:,\s*{_KEY})*)")
_DEVIATES = re.compile(rf"\bDeviates:\s*({_KEY})\s+(.+?)(?=\n\s*\n|\b(?:Eq|Deviates|Reading):|\Z)", re.DOTALL)
_ASSUMED = re.compile(r"(\S+)\s*=\s*(.*?)\s*#\s*assumed\b:?\s*(.*)")


@dataclass(frozen=True, slots=True)
class Equation:
    """A numbered equation of a paper."""

    key: str
    paper: str
    number: str
    meaning: str


@dataclass(frozen=True, slots=True)
class Place:
    """Where something stands in the sources."""

    file: str  # "maritrack/objects/giw.py"
    line: int
    name: str  # of the function or class, "" for a module

    def __str__(self) -> str:
        return f"{self.file}:{self.line}"


@dataclass(frozen=True, slots=True)
class Deviation:
    """Where the code departs from an equation."""

    key: str
    text: str
    place: Place


@dataclass(frozen=True, slots=True)
class Assumed:
    """A number of a preset that no paper gives."""

    preset: str
    key: str
    value: str
    reason: str


EQUATIONS: Mapping[str, Equation] = {
    key: Equation(key, key.partition("-")[0], key.partition("-")[2], meaning) for key, meaning in _MEANING.items()
}


def select(key: str) -> tuple[Equation, ...]:
    """Equations of a paper ("polar") or one of them ("polar-9"); all of them for ""."""
    found = tuple(e for e in EQUATIONS.values() if key in ("", e.paper, e.key))
    if not found:
        raise UsageError(f"no paper or equation '{key}'", hint="papers: " + ", ".join(PAPERS))
    return found


def homes(root: Path = ROOT) -> dict[str, list[Place]]:
    """Tag -> places whose docstring claims it, in the order of the files."""
    found: dict[str, list[Place]] = {}
    for text, place in _docstrings(root):
        for match in _EQ.finditer(text):
            for key in re.findall(_KEY, match[1]):
                found.setdefault(key, []).append(_at(place, text, match.start()))
    return found


def deviations(root: Path = ROOT) -> list[Deviation]:
    """What docstrings say about departures from the papers."""
    return [
        Deviation(match[1], " ".join(match[2].split()), _at(place, text, match.start()))
        for text, place in _docstrings(root)
        for match in _DEVIATES.finditer(text)
    ]


def marks(root: Path = ROOT) -> dict[str, list[Place]]:
    """Tag -> tests that show it; empty where the package is installed without its tests."""
    found: dict[str, list[Place]] = {}
    if not (root.parent / "pyproject.toml").is_file():
        return found
    for file, tree in _trees(root.parent / "tests"):
        for node in ast.walk(tree):
            if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
                for key in _marked(node):
                    found.setdefault(key, []).append(Place(file, node.lineno, node.name))
    return found


def assumed() -> list[Assumed]:
    """Lines of the presets that carry `# assumed: why`."""
    found = []
    for preset in preset_names():
        table = ""
        for line in (ROOT / "presets" / f"{preset}.toml").read_text("utf-8").splitlines():
            if line.startswith("["):
                table = line.strip("[] ") + "."
            elif match := _ASSUMED.fullmatch(line.strip()):
                found.append(Assumed(preset, table + match[1], match[2], match[3]))
    return found


def files_of_tracker(name: str) -> frozenset[str]:
    """Files of the package that a tracker is made of: its own and all that it imports."""
    from maritrack.trackers import TRACKERS

    if name not in TRACKERS:
        raise UsageError(f"no tracker '{name}'", hint="trackers: " + ", ".join(TRACKERS))
    return imported(TRACKERS[name].__module__)


def imported(module: str, root: Path = ROOT) -> frozenset[str]:
    """Files of the package that a module imports, itself included, however indirectly."""
    modules = {_module(file): (file, tree) for file, tree in _trees(root)}
    seen: dict[str, None] = {}
    ahead = [module]
    while ahead:
        name = ahead.pop()
        if name in modules and name not in seen:
            seen[name] = None
            ahead += imports_of(modules[name][1], modules)
    return frozenset(modules[name][0] for name in seen)


def imports_of(tree: ast.AST, known: Mapping[str, object]) -> list[str]:
    """Full names of all that a module imports; `from package import module` names the module where it is known."""
    names = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            inner = [f"{node.module}.{alias.name}" for alias in node.names]
            names += [name if name in known else node.module for name in inner]
    return names


def _trees(folder: Path) -> Iterator[tuple[str, ast.Module]]:
    """Name and syntax tree of each Python file of a folder, in the order of their names."""
    for path in sorted(folder.rglob("*.py")):
        yield path.relative_to(folder.parent).as_posix(), ast.parse(path.read_text("utf-8"))


def _module(file: str) -> str:
    return file.removesuffix(".py").removesuffix("/__init__").replace("/", ".")


def _docstrings(root: Path) -> Iterator[tuple[str, Place]]:
    """Each docstring as it stands in its file, and the place of its first line."""
    for file, tree in _trees(root):
        yield from _docstrings_of(tree, file, "")


def _docstrings_of(node: ast.AST, file: str, name: str) -> Iterator[tuple[str, Place]]:
    if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef)):
        text = ast.get_docstring(node, clean=False)
        if text is not None:
            yield text, Place(file, node.body[0].lineno, name)
    for child in ast.iter_child_nodes(node):
        if isinstance(child, (ast.ClassDef, ast.FunctionDef)):
            yield from _docstrings_of(child, file, f"{name}.{child.name}".lstrip("."))


def _at(place: Place, text: str, offset: int) -> Place:
    return Place(place.file, place.line + text.count("\n", 0, offset), place.name)


def _marked(node: ast.FunctionDef | ast.ClassDef) -> list[str]:
    """Tags that the decorators of a test name."""
    return [
        argument.value
        for decorator in node.decorator_list
        if isinstance(decorator, ast.Call) and ast.unparse(decorator.func) == "pytest.mark.eq"
        for argument in decorator.args
        if isinstance(argument, ast.Constant) and isinstance(argument.value, str)
    ]
