"""Folders laid out like DLR's data set: the certain form, each variant, what is guessed, and damage.

The folders are generated here; none of this is DLR's data, which is given out on request only.
"""

from __future__ import annotations

import io
import json
import math
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from PIL import Image
from scipy.io import savemat

from maritrack.errors import ConfigError, InputError
from maritrack.io import sniff
from maritrack.io.octets import octets_from_file
from maritrack.io.rwmr.entries import read_steps
from maritrack.io.rwmr.source import RwmrSource
from maritrack.io.rwmr.truth import read_truth
from maritrack.io.truth import document_origin, read_reference
from maritrack.rwmrsettings import RwmrConfig
from maritrack.settings import InputConfig
from maritrack.types import Frame
from tests.cli.calling import call

STEPS = (1, 2, 3, 5, 8, 9, 10, 11)  # some are missing
KNOT_MPS = 1852.0 / 3600.0


def own_at(step: int) -> tuple[np.ndarray, float]:
    """Own ship's place and heading."""
    return np.array([100.0 + 4.0 * step, -50.0 + 3.0 * step]), 0.4 + 0.02 * step


def points_at(step: int) -> np.ndarray:
    """East and north (n, 2) of the points of a step; none at the third."""
    if step == 3:
        return np.zeros((0, 2))
    ships = np.array([[1500.0 + 5 * step, 900.0], [-700.0, 2100.0 - 4 * step], [300.0, -1800.0]])
    cloud = np.array([[0, 0], [12, 0], [0, 12], [-12, 0], [0, -12]], float)
    return (ships[:, None, :] + cloud[None]).reshape(-1, 2)


def polar_at(step: int, *, from_bow: bool = False) -> np.ndarray:
    """Range and bearing (n, 2) of the points."""
    own, heading = own_at(step)
    d = points_at(step) - own
    bearing = np.arctan2(d[:, 0], d[:, 1]) - (heading if from_bow else 0.0)
    return np.stack([np.hypot(*d.T), bearing % (2 * math.pi)], axis=-1)


def flat(step: int, rows: np.ndarray) -> Any:
    """The certain form: two numbers, then pairs; null where there is none."""
    return [1, own_at(step)[1], *rows.tolist()] if len(rows) else None


def document(rows: Callable[[int], np.ndarray], form: Callable[[int, np.ndarray], Any] = flat) -> bytes:
    return json.dumps({str(step): form(step, rows(step)) for step in STEPS}).encode()


def folder(path: Path, **files: bytes) -> Path:
    path.mkdir(exist_ok=True)
    for name, data in files.items():
        (path / name.replace("_", ".")).write_bytes(data)
    return path


def source(path: Path, *, config: InputConfig | None = None, **rwmr: Any) -> RwmrSource:
    return RwmrSource(octets_from_file(path, "/input/rwmr"), config or InputConfig(), RwmrConfig(**rwmr))


def check(frames: list[Frame], *, shift: bool = True, atol: float = 1e-6) -> None:
    """Each step is there with its points; `shift`: where they really are, else seen from 0, 0."""
    assert [frame.t_ns for frame in frames] == [step * 10**9 for step in STEPS]
    for step, frame in zip(STEPS, frames, strict=True):
        points = frame.scan.points
        assert points is not None
        own = own_at(step)[0]
        assert_allclose(points.position_m, points_at(step) - (0 if shift else own), atol=atol)


def remarks(of: RwmrSource) -> dict[str, str]:
    return {damage.code: damage.message for damage in of.remarks}


def test_the_certain_form_is_read_step_by_step(tmp_path: Path) -> None:
    of = source(folder(tmp_path / "DAAN_", polarMeas_json=document(polar_at)))
    check(list(of.frames()), shift=False)
    assert set(remarks(of)) == {"rwmr-own-ship"}
    assert sniff(octets_from_file(tmp_path / "DAAN_", "").head, "x") == "rwmr"


def test_polar_and_cartesian_points_together_tell_where_own_ship_is(tmp_path: Path) -> None:
    path = folder(tmp_path / "f", polarMeas_json=document(polar_at), cartesianMeas_json=document(points_at))
    of = source(path)
    frames = list(of.frames())
    check(frames)
    for step, frame in zip(STEPS, frames, strict=True):  # in between as well, where there are no points
        assert_allclose(frame.scan.position_m, own_at(step)[0], atol=1e-6)
    assert "7 of 8 steps" in remarks(of)["rwmr-own-ship"] and "from north" in remarks(of)["rwmr-own-ship"]


def test_bearings_from_the_bow_are_turned_by_what_the_cartesian_points_say(tmp_path: Path) -> None:
    bow = document(lambda step: polar_at(step, from_bow=True))
    of = source(folder(tmp_path / "f", polarMeas_json=bow, cartesianMeas_json=document(points_at)))
    check(list(of.frames()))
    assert "turned by own heading" in remarks(of)["rwmr-own-ship"]


def test_bearings_from_the_bow_are_turned_by_the_heading_in_the_header(tmp_path: Path) -> None:
    bow = document(lambda step: polar_at(step, from_bow=True))
    head_up = InputConfig(stabilised="head")
    path = folder(tmp_path / "f", polarMeas_json=bow)
    check(list(source(path, config=head_up, heading_at=1).frames()), shift=False)
    with pytest.raises(InputError, match="no heading"):
        list(source(path, config=head_up).frames())


def by_columns(step: int, rows: np.ndarray) -> Any:
    return {"id": 7, "r": rows[:, 0].tolist(), "theta": rows[:, 1].tolist()}


VARIANTS: dict[str, Callable[[int, np.ndarray], Any]] = {
    "without a header": lambda step, rows: rows.tolist(),
    "with intensity": lambda step, rows: [0.0, 1.5, *([*row, 9.0] for row in rows.tolist())],
    "empty lists": lambda step, rows: [] if not len(rows) else flat(step, rows),
    "two rows": lambda step, rows: [1, 2, rows[:, 0].tolist(), rows[:, 1].tolist()] if len(rows) else None,
    "groups": lambda step, rows: [1, 2, *rows[:5].tolist(), 2, 0.5, *rows[5:].tolist()],
    "named points": lambda step, rows: [1, 2, *({"range": r, "bearing": b} for r, b in rows.tolist())],
    "points in objects": lambda step, rows: {"heading": 1.0, "points": rows.tolist()},
    "columns in objects": by_columns,
}


@pytest.mark.parametrize("name", VARIANTS)
def test_variants_of_an_entry_are_the_same_points(tmp_path: Path, name: str) -> None:
    of = source(folder(tmp_path / "f", polarMeas_json=document(polar_at, VARIANTS[name])))
    frames = list(of.frames())
    check(frames, shift=False)
    assert all(not frame.damage for frame in frames)
    said = name not in ("without a header", "with intensity", "empty lists")
    assert ("rwmr-form" in remarks(of)) == said


def test_a_list_of_steps_counts_from_0(tmp_path: Path) -> None:
    steps = json.dumps([flat(step, polar_at(step)) for step in STEPS]).encode()
    of = source(folder(tmp_path / "f", polarMeas_json=steps))
    assert [frame.t_ns for frame in of.frames()] == [k * 10**9 for k in range(len(STEPS))]
    assert "counted from 0" in remarks(of)["rwmr-form"]


def test_steps_within_another_object_are_found(tmp_path: Path) -> None:
    inner = b'{"data": ' + document(polar_at) + b"}"
    check(list(source(folder(tmp_path / "f", polarMeas_json=inner)).frames()), shift=False)


def test_degrees_and_swapped_columns_are_guessed_said_and_overridden(tmp_path: Path) -> None:
    def odd(step: int) -> np.ndarray:
        rows = polar_at(step)
        return np.stack([rows[:, 0], np.degrees(rows[:, 1])], axis=-1)

    of = source(folder(tmp_path / "deg", polarMeas_json=document(odd)))
    check(list(of.frames()), shift=False)
    assert "degrees" in remarks(of)["rwmr-angles"]
    swapped = folder(tmp_path / "swap", polarMeas_json=document(lambda step: polar_at(step)[:, ::-1]))
    of = source(swapped)
    check(list(of.frames()), shift=False)
    assert "bearings come before" in remarks(of)["rwmr-columns"]
    of = source(swapped, columns="bearing-range")
    check(list(of.frames()), shift=False)
    assert "rwmr-columns" not in remarks(of)
    wrong = list(source(folder(tmp_path / "deg", polarMeas_json=document(odd)), angles="rad").frames())
    with pytest.raises(AssertionError):
        check(wrong, shift=False)


def test_cartesian_points_alone_are_read(tmp_path: Path) -> None:
    path = folder(tmp_path / "f", cartesianMeas_json=document(points_at))
    check(list(source(path).frames()))
    north = folder(tmp_path / "n", cartesianMeas_json=document(lambda step: points_at(step)[:, ::-1]))
    check(list(source(north, axes="north-east").frames()))


def test_documents_that_contradict_each_other_leave_own_ship_at_the_origin(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    other = document(lambda step: points_at(step) + rng.normal(0, 500, points_at(step).shape))
    of = source(folder(tmp_path / "f", polarMeas_json=document(polar_at), cartesianMeas_json=other))
    check(list(of.frames()), shift=False)
    assert "do not agree" in remarks(of)["rwmr-own-ship"]


def test_what_is_no_point_is_counted(tmp_path: Path) -> None:
    entries = {
        "1": [0, 0, [100.0, 1.0], [float("nan"), 1.0], "x", [5.0], [-3.0, 1.0], [1e300, 0], None],
        "b": [],
        "2": 7,
    }
    path = folder(tmp_path / "f", polarMeas_json=json.dumps(entries).encode())
    frames = list(source(path).frames())
    assert [len(frame.scan.points or ()) for frame in frames] == [1, 0]
    assert sum(damage.count for damage in frames[0].damage if damage.code == "bad-point") == 8


@pytest.mark.parametrize("data", [b"", b"{", b"7", b'"x"', b"[" * 100_000, b'{"a": 1, "b": 2}', b"\xff\xfe\x00"])
def test_a_document_that_is_none_is_an_error(tmp_path: Path, data: bytes) -> None:
    with pytest.raises(InputError, match=r"neither .*: polarmeas\.json: "):
        source(folder(tmp_path / "f", polarMeas_json=data))
    path = folder(tmp_path / "g", polarMeas_json=data, cartesianMeas_json=document(points_at))
    frames = list(source(path).frames())
    check(frames)
    assert [damage.code for damage in frames[0].damage] == ["rwmr-file"]


def test_every_cut_of_a_document_is_an_error_or_read() -> None:
    data = document(polar_at)
    for n in range(0, len(data), 37):
        with pytest.raises(InputError):
            read_steps(data[:n])


def mat(**variables: Any) -> bytes:
    out = io.BytesIO()
    savemat(out, variables)
    return out.getvalue()


T = np.arange(0.0, 12.0)
EAST, NORTH = 1500.0 + 5 * T, 900.0 + 0 * T


def ship(**more: Any) -> dict[str, Any]:
    return {"x": EAST, "y": NORTH, "COG": np.full(12, 90.0), "SOG": np.full(12, 5.0 / KNOT_MPS), "L": 129.0, "W": 23.0,
            **more}  # fmt: skip


MATS: dict[str, dict[str, Any]] = {
    "a struct a vessel": {"target2": ship(), "target3": ship(x=EAST + 100)},
    "a struct of structs": {"ref": {"a": ship(), "b": ship(x=EAST + 100)}},
    "a cell a vessel": {"targets": np.array([ship(), ship(x=EAST + 100)], dtype=object)},
    "columns of vessels": {"ref": {"east_m": np.stack([EAST, EAST + 100], 1), "north_m": np.stack([NORTH, NORTH], 1),
                                   "cog": np.full((12, 2), 90.0), "sog": np.full((12, 2), 5.0 / KNOT_MPS),
                                   "len": np.array([129.0]), "wid": np.array([23.0])}},
    "positions of two columns": {"a": {"pos": np.stack([EAST, NORTH], 1), "course": np.full(12, math.pi / 2),
                                       "speed": np.full(12, 5.0), "length": 129.0, "beam": 23.0, "time": T},
                                 "b": {"position": np.stack([EAST + 100, NORTH], 1), "cog": np.full(12, math.pi / 2),
                                       "speed": np.full(12, 5.0), "length": 129.0, "beam": 23.0, "t": T}},
}  # fmt: skip


@pytest.mark.parametrize("name", MATS)
def test_the_reference_is_told_by_the_names_of_its_fields(tmp_path: Path, name: str) -> None:
    of = source(folder(tmp_path / "f", polarMeas_json=document(polar_at), referenceMeas_mat=mat(**MATS[name])))
    found = of.reference
    assert found is not None and len(found) == 2 and not found.complete
    for k in range(2):
        rows = slice(int(found.start[k]), int(found.start[k + 1]))
        assert_allclose(found.t_ns[rows] / 1e9, T)
        assert_allclose(found.position_m[rows], np.stack([EAST + 100 * k, NORTH], 1))
        assert_allclose(found.velocity_mps[rows], np.tile([5.0, 0.0], (12, 1)), atol=1e-6)
    assert_allclose(found.length_m, 129.0)
    assert_allclose(found.width_m, 23.0)
    said = " ".join(damage.message for damage in of.remarks if damage.code == "rwmr-reference")
    assert ("knots" in said) == ("two columns" not in name) and "2 vessels" in said


def test_a_reference_without_names_is_none_until_a_map_tells_its_columns(tmp_path: Path) -> None:
    data = mat(vessel=np.stack([T, EAST, NORTH], axis=1))
    path = folder(tmp_path / "f", polarMeas_json=document(polar_at), referenceMeas_mat=data)
    of = source(path)
    assert of.reference is None
    assert "vessel (12x3)" in remarks(of)["rwmr-reference"] and "reference_map" in remarks(of)["rwmr-reference"]
    told = source(path, reference_map="time=0,east=1,north=2").reference
    assert told is not None
    assert_allclose(told.position_m, np.stack([EAST, NORTH], 1))
    with pytest.raises(InputError, match="no positions"):
        source(path, reference_map="east=11,north=12")
    assert source(path, reference="none").remarks[-1].code != "rwmr-reference"


@pytest.mark.parametrize("data", [b"", b"MATLAB 5.0 MAT-file", b"MATLAB 7.3 MAT-file" + bytes(200), mat(a="text")])
def test_a_reference_that_can_not_be_read_is_said_and_costs_nothing_else(tmp_path: Path, data: bytes) -> None:
    of = source(folder(tmp_path / "f", polarMeas_json=document(polar_at), referenceMeas_mat=data))
    assert of.reference is None and "no truth" in remarks(of)["rwmr-reference"]
    check(list(of.frames()), shift=False)


def test_fields_of_any_shapes_are_told_or_passed_over() -> None:
    rng = np.random.default_rng(5)
    shapes = [(), (0, 0), (1, 5), (5, 1), (3, 5), (5, 3), (2, 3, 4)]
    read = 0
    for _ in range(200):
        names = rng.choice(["x", "y", "cog", "sog", "t", "pos", "L", "heading"], 5, replace=False)
        fields = {str(n): rng.normal(0, 9, shapes[rng.integers(len(shapes))]) for n in names}
        for value in fields.values():
            value[rng.random(value.shape) < 0.1] = rng.choice([np.nan, np.inf, 1e300])
        try:
            found, _ = read_truth(mat(a=fields), RwmrConfig(), steps=5, start_ns=0)
        except InputError:
            continue
        read += 1
        assert np.isfinite(found.position_m).all()
    assert read > 20


def test_a_folder_becomes_a_run_with_truth_and_remarks_and_replays(tmp_path: Path) -> None:
    files = {"polarMeas_json": document(polar_at), "cartesianMeas_json": document(points_at),
             "referenceMeas_mat": mat(**MATS["a struct a vessel"])}  # fmt: skip
    path = folder(tmp_path / "DARC_", **files)
    (path / "radarImages").mkdir()
    done = call("process", path, "-o", tmp_path / "run", "--no-rrd", "--json", "--set", "cluster.eps_m=40")
    assert done.code == 0, done.err
    assert done.json["counts"]["scans"] == 8 and done.json["metrics"]["n_truth"] > 1
    assert "rwmr-own-ship" in done.json["counts"]["warnings"]
    assert call("replay", tmp_path / "run", "--verify").code == 0
    zipped = tmp_path / "DARC.zip"
    with zipfile.ZipFile(zipped, "w") as archive:
        for file in sorted(path.glob("*.*")):
            archive.write(file, f"DARC_/{file.name}")
    assert len(list(source(zipped).frames())) == 8


def test_the_reference_by_name_says_what_it_says_by_itself_and_scores_the_images_too(tmp_path: Path) -> None:
    files = {"polarMeas_json": document(polar_at), "referenceMeas_mat": mat(**MATS["a struct a vessel"])}
    path = folder(tmp_path / "DARC_", **files)
    alone = ("--no-rrd", "--no-mcap", "--json", "--set", "cluster.eps_m=40")
    by_itself, named = (
        call("process", path, *alone),
        call("process", path, *alone, "--truth", path / "referenceMeas.mat"),
    )
    assert named.code == 0 and named.json["metrics"] == by_itself.json["metrics"], named.err
    assert named.json["counts"]["warnings"]["truth-guess"] > 0
    images = path / "radarImages"
    images.mkdir()
    for k in range(3):
        picture = Image.new("RGB", (64, 64))
        picture.paste((255, 255, 255), (40, 20 + k, 46, 26 + k))
        picture.save(images / f"{k:03d}.png")
    sets = ("--set", "images.centre_px=[32,32]", "--set", "images.pixel_m=80", "--set", "images.blob_max_m=600")
    seen = call("process", images, *alone, *sets, "--truth", path / "referenceMeas.mat", "--truth-match", "target3")
    assert seen.code == 0 and seen.json["metrics"]["n_truth"] == 1.0, seen.err
    data = mat(vessel=np.zeros((3, 4)))
    with pytest.raises(InputError, match=r"x: no positions by name in vessel \(3x4\)"):
        read_reference(data, name="x", origin=None)
    told = read_reference(data, name="x", origin=None, rwmr=RwmrConfig(reference_map="east=1,north=2"))
    assert len(told) == 1 and document_origin(data) is None


@pytest.mark.parametrize("wrong", [{"rate_hz": 0.0}, {"heading_at": -2}, {"reference_map": "east"},
                                   {"reference_map": "up=z"}])  # fmt: skip
def test_settings_that_make_no_sense_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ConfigError, match="rwmr"):
        RwmrConfig(**wrong)
