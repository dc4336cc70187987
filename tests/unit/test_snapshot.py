"""Snapshots of a background: what is read is what was written, and nothing else is believed."""

from __future__ import annotations

import io
import json
import zipfile
from dataclasses import replace
from typing import Any, Literal

import numpy as np
import pytest
from numpy.testing import assert_allclose

from maritrack import geo
from maritrack.detect import snapshot
from maritrack.detect.background import Background, mask_of, no_background, psi_of, take_counts
from maritrack.detect.snapshot import read_snapshot, snapshot_octets
from maritrack.errors import InputError
from maritrack.settings import SubtractConfig
from maritrack.types import Origin

RULES = SubtractConfig(method="abs", threshold=0, pixel_m=100.0)
PLACE = Origin(50.75, -1.25)


def model(seed: int = 0, scans: int = 30, start: Literal["uniform", "empty"] = "uniform") -> Background:
    rng, learned = np.random.default_rng(seed), no_background()
    pixels = np.unique(geo.pixel_key(rng.uniform(-5000, 5000, (200, 2)), 100.0))
    for _ in range(scans):
        counts = rng.poisson(rng.choice([0.1, 3.0], len(pixels)))
        hit, seen = counts > 0, np.ones(len(learned), bool)
        learned = take_counts(learned, pixels[hit], counts[hit], seen, replace(RULES, start=start), rate=0.9)
    return learned


def test_a_snapshot_comes_back_as_it_was() -> None:
    models = {"7-42": model(), "": model(1)}
    data = snapshot_octets(models, RULES, PLACE)
    assert data == snapshot_octets(models, RULES, PLACE)
    back = read_snapshot(data, RULES, PLACE, name="x")
    assert set(back) == set(models)
    for name, m in models.items():
        assert np.array_equal(psi_of(back[name], m.key, RULES), psi_of(m, m.key, RULES))
        assert np.array_equal(mask_of(back[name], RULES).key, mask_of(m, RULES).key)
        assert (back[name].scans, back[name].converged) == (m.scans, m.converged)


def test_it_may_be_judged_otherwise_than_it_was_learned() -> None:
    other, m = replace(RULES, threshold=2, decision="tail"), model()
    back = read_snapshot(snapshot_octets({"a": m}, RULES, None), other, None, name="x")["a"]
    tail = psi_of(m, m.key, RULES)[:, 3:].sum(axis=1)
    assert np.array_equal(mask_of(back, other).key, m.key[tail > 0.5])


def test_the_grid_stays_on_the_globe_when_the_origin_is_another() -> None:
    m, there = model(), Origin(50.80, -1.20)
    back = read_snapshot(snapshot_octets({"a": m}, RULES, PLACE), RULES, there, name="x")["a"]
    centre = geo.pixel_centre(m.key, 100.0)
    moved = geo.geodetic_to_en(there, *geo.en_to_geodetic(PLACE, centre))
    assert np.hypot(*(geo.pixel_centre(back.key, 100.0, back.corner_m) - moved).T).max() < 12.0  # two planes, 7 km


def rewritten(data: bytes, change: Any) -> bytes:
    """The snapshot with its members changed by a function of (name, octets); None leaves one out."""
    out = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(data)) as old, zipfile.ZipFile(out, "w") as new:
        for name in old.namelist():
            octets = change(name, old.read(name))
            if octets is not None:
                new.writestr(name, octets)
    return out.getvalue()


def with_array(name: str, change: Any) -> Any:
    def apply(member: str, octets: bytes) -> bytes:
        if member != f"0.{name}.npy":
            return octets
        out = io.BytesIO()
        np.save(out, change(np.load(io.BytesIO(octets))), allow_pickle=True)
        return out.getvalue()

    return apply


def with_header(**values: Any) -> Any:
    def apply(member: str, octets: bytes) -> bytes:
        if member != "header.npy":
            return octets
        header = json.loads(np.load(io.BytesIO(octets)).tobytes()) | values
        out = io.BytesIO()
        np.save(out, np.frombuffer(json.dumps(header).encode(), np.uint8))
        return out.getvalue()

    return apply


def with_model(**values: Any) -> Any:
    told = json.loads(np.load(io.BytesIO(zipfile.ZipFile(io.BytesIO(GOOD)).read("header.npy"))).tobytes())["models"][0]
    return with_header(models=[told | values])


def in_slots(m: Background) -> bytes:
    """The model as a snapshot of the format before: a row is as of its last point, here as of when psi_0 was 0."""
    psi = psi_of(m, m.key, RULES)
    left = psi[:, 1:].sum(axis=1)
    psi = np.where(np.arange(psi.shape[1]) > 0, psi / left[:, None], 0.0)
    floor = psi[:, 1:].min(axis=1)
    had = psi > floor[:, None] * (1 + 1e-9)
    count = np.argsort(~had[:, 1:], axis=1, kind="stable")[:, : had.sum(axis=1).max()] + 1
    kept, none = np.take_along_axis(had, count, axis=1), np.zeros((len(m), 1))
    count, weight = np.where(kept, count, -1), np.where(kept, np.take_along_axis(psi, count, axis=1), 0.0)
    arrays = {
        "key": m.key, "at": m.now + np.log(left), "floor": floor,
        "count": np.hstack([none, count]).astype(np.int16), "weight": np.hstack([none, weight]),
    }  # fmt: skip
    header = {
        "format": "maritrack-background/1", "pixel_m": RULES.pixel_m, "categories": RULES.categories, "origin": None,
        "models": [{"sensor": "a", "corner_m": [0, 0], "now": m.now, "scans": m.scans, "converged": m.converged}],
    }  # fmt: skip
    text = np.frombuffer(json.dumps(header).encode(), np.uint8)
    out = io.BytesIO()
    np.savez(out, **{"header": text}, **{f"0.{name}": array for name, array in arrays.items()})
    return out.getvalue()


@pytest.mark.parametrize("start", ["uniform", "empty"])
def test_the_format_before_is_read(start: Any) -> None:
    m = model(start=start)
    back = read_snapshot(in_slots(m), RULES, None, name="x")["a"]
    assert_allclose(psi_of(back, m.key, RULES), psi_of(m, m.key, RULES), rtol=1e-12, atol=1e-15)
    assert np.array_equal(mask_of(back, RULES).key, mask_of(m, RULES).key)
    seen = np.ones(len(m), bool)
    after, learned = (take_counts(x, m.key[:3], np.array([1, 2, 300]), seen, RULES, rate=0.9) for x in (back, m))
    assert_allclose(psi_of(after, m.key, RULES), psi_of(learned, m.key, RULES), rtol=1e-12, atol=1e-15)
    assert_allclose(after.change[-1], learned.change[-1], rtol=1e-9)


GOOD = snapshot_octets({"a": model()}, RULES, None)
OLD = in_slots(model())
LONG_HEAD = b"\x93NUMPY\x01\x00" + (60_000).to_bytes(2, "little") + b"(" * 59_999 + b"\n"


@pytest.mark.parametrize(
    "data",
    [
        b"", b"PK", GOOD[:-40], GOOD[:200], b"\x93NUMPY\x01\x00", b"[1, 2]",
        rewritten(GOOD, lambda n, o: None if n == "0.level.npy" else o),
        rewritten(GOOD, lambda n, o: None if n == "header.npy" else o),
        rewritten(GOOD, lambda n, o: o[:-8] if n == "0.late.npy" else o),
        rewritten(GOOD, lambda n, o: b"" if n == "0.key.npy" else o),
        rewritten(GOOD, with_array("key", lambda a: a[::-1].copy())),
        rewritten(GOOD, with_array("key", lambda a: a.astype(object))),
        rewritten(GOOD, with_array("key", lambda a: a.astype(np.float64))),
        rewritten(GOOD, with_array("late", lambda a: a + 1e9)), rewritten(GOOD, with_array("late", lambda a: a - 1.0)),
        rewritten(GOOD, with_array("base", lambda a: a + np.nan)),
        rewritten(GOOD, with_array("base", lambda a: a + np.inf)),
        rewritten(GOOD, with_array("base", lambda a: a[1:])),
        rewritten(GOOD, with_array("rest", lambda a: -a)), rewritten(GOOD, with_array("rest", lambda a: a * np.nan)),
        rewritten(GOOD, with_array("rest", lambda a: 0.9 * a)),
        rewritten(GOOD, with_array("level", lambda a: a * np.nan)),
        rewritten(GOOD, with_array("level", lambda a: a + 0.1)), rewritten(GOOD, with_array("level", lambda a: a[1:])),
        rewritten(GOOD, with_array("name", lambda a: a[::-1].copy())),
        rewritten(GOOD, with_array("name", lambda a: a + (1 << 40))),
        rewritten(GOOD, with_array("name", lambda a: a - (1 << 40))),
        rewritten(GOOD, with_array("name", lambda a: a & ~np.int64(1))),
        rewritten(GOOD, with_array("name", lambda a: np.where(np.arange(len(a)) == 1, a[0] | 32767, a))),
        rewritten(OLD, lambda n, o: None if n == "0.weight.npy" else o),
        rewritten(OLD, lambda n, o: o[:-8] if n == "0.at.npy" else o),
        rewritten(OLD, with_array("key", lambda a: a[::-1].copy())),
        rewritten(OLD, with_array("weight", lambda a: a * np.nan)),
        rewritten(OLD, with_array("weight", lambda a: 2 * a)),
        rewritten(OLD, with_array("weight", lambda a: -a)),
        rewritten(OLD, with_array("weight", lambda a: a[:, :1])),
        rewritten(OLD, with_array("count", lambda a: a + 300)),
        rewritten(OLD, with_array("count", lambda a: 0 * a)),
        rewritten(OLD, with_array("floor", lambda a: a - 1.0)),
        rewritten(OLD, with_array("at", lambda a: a + 1e9)),
        rewritten(GOOD, with_header(format="maritrack-background/9")),
        rewritten(GOOD, with_header(pixel_m="wide")), rewritten(GOOD, with_header(pixel_m=float("nan"))),
        rewritten(GOOD, with_header(models=[{}])), rewritten(GOOD, with_header(models={"a": 1})),
        rewritten(GOOD, with_header(models=[{"sensor": "a", "corner_m": [0, 0], "now": -1, "scans": 3}])),
        rewritten(GOOD, with_header(origin=[500, 2])), rewritten(GOOD, with_header(origin="here")),
        rewritten(GOOD, with_header(categories=10**9)), rewritten(GOOD, with_header(categories=256.7)),
        rewritten(GOOD, with_header(origin="ab")), rewritten(GOOD, with_header(origin=[1])),
        rewritten(GOOD, with_header(origin={"a": 1, "b": 2})), rewritten(GOOD, with_header(origin=["1", "2"])),
        rewritten(GOOD, with_header(origin=[float("nan"), 2])), rewritten(GOOD, with_header(models=[])),
        rewritten(GOOD, with_model(converged="no")), rewritten(GOOD, with_model(corner_m=[1e15, 0])),
        rewritten(GOOD, with_model(corner_m=[0, float("nan")])),
        rewritten(GOOD, lambda n, o: LONG_HEAD if n == "0.key.npy" else o),
    ],
)  # fmt: skip
def test_what_is_no_snapshot_is_told_in_one_line(data: bytes) -> None:
    with pytest.raises(InputError) as error:
        read_snapshot(data, RULES, None, name="harbour.npz")
    assert str(error.value).startswith("harbour.npz: ") and "\n" not in str(error.value)
    assert "other way round" not in str(error.value) and "pickle" not in str(error.value)


def test_damage_anywhere_is_told_or_harmless() -> None:
    rng = np.random.default_rng(0)
    for _ in range(150):
        data = bytearray(GOOD)
        data[int(rng.integers(len(data)))] ^= int(rng.integers(1, 256))
        try:
            back = read_snapshot(bytes(data), RULES, None, name="x")
        except InputError as error:
            assert "\n" not in str(error)
        else:
            assert all(len(mask_of(m, RULES).key) <= len(m) for m in back.values())


def test_what_would_inflate_beyond_all_measure_is_not_inflated(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(snapshot, "MOST_OCTETS", len(GOOD))
    with pytest.raises(InputError, match="inflates to more than"):
        read_snapshot(rewritten(GOOD, lambda n, o: bytes(len(GOOD)) if n == "0.key.npy" else o), RULES, None, name="x")


def test_a_grid_of_another_size_and_a_run_without_a_place_are_refused() -> None:
    with pytest.raises(InputError, match="pixels of 100"):
        read_snapshot(GOOD, replace(RULES, pixel_m=50.0), None, name="x")
    with pytest.raises(InputError, match="other way round"):
        read_snapshot(GOOD, RULES, PLACE, name="x")
