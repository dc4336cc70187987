"""Adaptive background subtraction against its dense definition, its closed forms, and in situations."""

from __future__ import annotations

import math
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from maritrack import geo
from maritrack.chain import covered
from maritrack.config import load_config
from maritrack.detect.background import Background, judged, learn, mask_of, no_background, psi_of, rate_of, take_counts
from maritrack.settings import SubtractConfig
from maritrack.types import FloatArray, IntArray, Points, Scan, Sensor
from tests import runs
from tests.unit.scans import scan_of

PAPER = SubtractConfig(method="abs")
SIDE = 5  # pixels of the small region, along an axis
REGION = np.sort(geo.pixel_key((np.stack(np.divmod(np.arange(SIDE**2), SIDE), axis=-1) + 0.5) * 50.0, 50.0))


def feed(
    model: Background, counts: IntArray, rules: SubtractConfig, *, rate: float = 0.0, seen: Any = True
) -> Background:
    """One more scan with counts (p,) in the pixels of the region, of which only those `seen` (p,) were looked at."""
    seen = np.broadcast_to(np.asarray(seen, bool), len(REGION))
    hit = (counts > 0) & seen
    rows = seen[np.searchsorted(REGION, model.key)]
    model = replace(model, scans=model.scans + 1)
    return take_counts(model, REGION[hit], counts[hit], rows, rules, rate=rate or rules.learning_rate)


def dense_background(psi: FloatArray, rules: SubtractConfig) -> FloatArray:
    """Margin (p,) by which each pixel is background: the definition."""
    above = psi[:, rules.threshold + 1 :]
    if rules.decision == "tail":
        return np.asarray(above.sum(axis=1) - 0.5)
    return np.asarray(above.max(axis=1) - psi[:, : rules.threshold + 1].max(axis=1))


def test_a_scan_comes_with_the_background_of_its_sensor_and_those_of_the_others() -> None:
    config = load_config(preset="abs-port")
    scan, _ = scan_of(np.zeros((0, 2)), 0.0)
    models = {name: no_background((east, 0.0)) for name, east in ((scan.sensor.id, 1.0), ("q", 2.0), ("r", 3.0))}
    mask = mask_of(models[scan.sensor.id], config.subtract)
    told = covered(scan, mask, models, config)
    assert told.covered is mask
    assert [m.corner_m for m in told.also_covered] == [(2.0, 0.0), (3.0, 0.0)]
    joint = replace(config, subtract=replace(config.subtract, masks="joint"))
    assert covered(scan, mask, {"": models["q"]}, joint).also_covered == ()
    assert covered(scan, None, {}, config) is scan


def test_the_shortest_memory_that_settings_allow_is_still_a_distribution() -> None:
    rules, model = SubtractConfig(method="abs", half_life_scans=0.1), no_background()
    rate = rate_of(model, Scan(Sensor("a", 1.0, 0.1, 1e4), 0, 0, np.zeros(2), 0.0), rules)
    for k in range(30):
        model = feed(model, np.arange(SIDE**2) * (k % 3), rules, rate=rate)
    assert_allclose(psi_of(model, model.key, rules).sum(axis=1), 1.0, atol=1e-12)


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_active_pixels_are_the_dense_model(data: st.DataObject) -> None:
    start = data.draw(st.sampled_from(["uniform", "empty"]))
    v = data.draw(st.integers(3, 12))
    rules = SubtractConfig(
        method="abs", categories=v, start=start, decision=data.draw(st.sampled_from(["map", "tail"])),
        threshold=data.draw(st.integers(0, v - 2)),
    )  # fmt: skip
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32)))
    partial = start == "empty" and data.draw(st.booleans())  # a pixel without a row counts as looked at from the start
    psi = np.full((len(REGION), v), 1 / v) if start == "uniform" else np.eye(v)[np.zeros(len(REGION), int)]
    model, level = no_background(), rng.choice([0.0, 0.1, 1.0, 6.0], len(REGION))
    ever = np.zeros(len(REGION), bool)
    for _ in range(data.draw(st.integers(1, 40))):
        a = float(rng.uniform(0.6, 0.99))
        counts, seen = rng.poisson(level), rng.random(len(REGION)) < (0.7 if partial else 2.0)
        after = a * psi + (1 - a) * np.eye(v)[np.minimum(counts, v - 1)]
        after[~seen] = psi[~seen]
        ever |= (counts > 0) & seen
        model = feed(model, counts, rules, rate=a, seen=seen)
        active = ever & seen
        d = np.linalg.norm(after - psi, axis=1)[active]
        assert model.change[-1] == pytest.approx(d.sum(), rel=1e-9, abs=1e-12)
        psi = after
    assert_allclose(psi_of(model, REGION, rules), psi, rtol=1e-9, atol=1e-13)
    margin = dense_background(psi, rules)
    sure = np.abs(margin) > 1e-9
    assert (np.isin(REGION, mask_of(model, rules).key) == (margin > 0))[sure & ever].all()
    anew = judged(model, rules)
    for name in ("drift", "high", "low"):
        assert_allclose(getattr(model, name), getattr(anew, name), rtol=1e-9, atol=1e-13)


def test_a_scan_leaves_the_model_before_it_as_it_was() -> None:
    rng, model = np.random.default_rng(0), no_background()
    for _ in range(12):
        counts, seen = rng.poisson(0.3, len(REGION)), rng.random(len(REGION)) < 0.9
        before = model
        held = {name: array.copy() for name, array in arrays_of(before).items()}
        model = feed(model, counts, PAPER, seen=seen)
        assert all(np.array_equal(array, held[name]) for name, array in arrays_of(before).items())


def arrays_of(model: Background) -> dict[str, Any]:
    """All arrays that a model holds, by name."""
    named = {f.name: getattr(part, f.name) for part in (model, model.pairs) for f in fields(part)}
    return {name: value for name, value in named.items() if isinstance(value, np.ndarray)}


@pytest.mark.parametrize("decision", ["map", "tail"])
def test_counts_that_are_long_gone_take_no_room_and_are_not_missed(decision: Any) -> None:
    rng, rules, model = np.random.default_rng(3), replace(PAPER, decision=decision, threshold=40), no_background()
    psi = np.full((len(REGION), rules.categories), 1 / rules.categories)
    for k in range(1200):
        counts = (rng.random(len(REGION)) < 0.5) * (1 + k // 10 + rng.integers(0, 3, len(REGION)))
        psi = 0.9 * psi + 0.1 * np.eye(rules.categories)[counts]
        model = feed(model, counts, rules)
    assert len(model.pairs) < 70 * len(
        REGION
    )  # of 120 in each pixel: those of the last 55 e-folds, 522 scans, and less
    assert_allclose(psi_of(model, REGION, rules), psi, rtol=1e-9, atol=1e-16)
    assert np.array_equal(mask_of(model, rules).key, REGION[dense_background(psi, rules) > 0])


def test_what_was_empty_for_very_long_is_zero_and_no_number_too_small_to_reckon_with() -> None:
    rules, model = replace(PAPER, learning_rate=0.5), no_background()
    for k in range(1500):
        model = feed(model, np.where(np.arange(SIDE**2) == 7, k < 3, k == 0).astype(int), rules)
        values = np.concatenate([model.rest, model.drift, model.high, model.low])
        assert not ((values > 0) & (values < 1e-300)).any()
    assert (values == 0).all() and len(model) == len(REGION)
    full = feed(model, np.full(SIDE**2, 9), rules)
    assert psi_of(full, REGION[:1], rules)[0, [0, 9]] == pytest.approx(0.5, rel=1e-12)


@pytest.mark.eq("abs-7", "abs-8", "abs-9")
@pytest.mark.parametrize("looks", [1, 3])
def test_a_constant_count_follows_the_closed_form_also_if_it_is_not_looked_at_each_scan(looks: int) -> None:
    a, v, c = PAPER.learning_rate, PAPER.categories, 9
    model = no_background()
    for n in range(150):
        for k in range(looks):
            model = feed(model, np.full(len(REGION), c), PAPER, seen=k == 0)
            d = len(REGION) * (1 - a) * a**n * math.sqrt((1 - 1 / v) ** 2 + (v - 1) / v**2)
            assert model.change[-1] == pytest.approx(d if k == 0 else 0.0, rel=1e-12, abs=0.0)
        assert psi_of(model, REGION[:1], PAPER)[0, c] == pytest.approx(1 - (1 - 1 / v) * a ** (n + 1), rel=1e-12)


@pytest.mark.parametrize(("rate", "scans"), [(0.9, 7), (0.97, 23)])
def test_what_stops_is_background_after_a_half_life_and_not_as_long_after_it_left(rate: float, scans: int) -> None:
    assert scans == math.ceil(math.log(0.5) / math.log(rate))
    rules, long = replace(PAPER, learning_rate=rate), math.ceil(12 / (1 - rate))
    full, none = np.where(np.arange(SIDE**2) == 7, 20, 0), np.zeros(SIDE**2, int)
    model, masked = no_background(), []
    for counts in [none] * long + [full] * long + [none] * long:
        model = feed(model, counts, rules)
        masked.append(len(mask_of(model, rules).key))
    assert masked.index(1) == long + scans - 1
    assert long + masked[long:].index(0, scans) == 2 * long + scans - 1


def test_counts_that_fluctuate_are_background_by_the_tail_where_the_likeliest_count_may_be_none() -> None:
    both = np.zeros((180, SIDE**2), int)
    both[:, [3, 4]] = np.array([[0, 9], [7, 9], [8, 9], [0, 9], [10, 8], [11, 9]] * 30)
    found = {}
    for decision in ("map", "tail"):
        rules, model = replace(PAPER, decision=decision, learning_rate=0.97), no_background()
        for row in both:
            model = feed(model, row, rules)
        found[decision] = np.isin(REGION[[3, 4]], mask_of(model, rules).key).tolist()
    assert found == {"map": [False, True], "tail": [True, True]}


@pytest.mark.parametrize(("kind", "scans"), [("constant", 17), ("poisson", 20)])
def test_the_model_converges_when_its_change_no_longer_does(kind: str, scans: int) -> None:
    rng = np.random.default_rng(1)
    level = rng.choice([6.0, 9.0, 12.0], SIDE**2)
    model = no_background()
    while not model.converged:  # 0.9^16 < 0.2 is the first
        model = feed(model, level.astype(int) if kind == "constant" else rng.poisson(level), PAPER)
    assert abs(model.scans - scans) <= (0 if kind == "constant" else 6)
    assert feed(model, np.zeros(SIDE**2, int), PAPER).converged


def test_it_converges_at_the_latest_after_ten_times_its_memory() -> None:
    rng, model = np.random.default_rng(2), no_background()
    for k in range(200):
        growing = np.where(rng.random(SIDE**2) < 0.5, rng.integers(0, 200, SIDE**2), 0) * (k % 7 < 1 + k % 5)
        model = feed(model, growing, PAPER)
        if model.converged:
            break
    assert model.converged and model.scans <= 100


def points_at(position_m: FloatArray) -> Points:
    n = len(position_m)
    r, azimuth = geo.en_to_polar(position_m)
    return Points(r, azimuth, position_m, np.ones(n), np.zeros(n, np.int64), np.zeros(n), np.zeros(n))


def scan_at(
    east_m: float = 0.0, *, t_s: float = 0.0, turn_s: float = 2.5, reach_m: float = 1e4, swept: Any = None
) -> Scan:
    t_ns = round(t_s * 1e9)
    return Scan(Sensor("r", 10.0, 0.01, reach_m), t_ns, t_ns - round(turn_s * 1e9), np.array([east_m, 0.0]), math.nan,
                swept=swept)  # fmt: skip


def test_the_grid_stays_with_the_land_when_the_radar_moves() -> None:
    land, rules, model = (
        points_at(np.array([[3000.0, 10.0], [3010.0, 20.0]])),
        replace(PAPER, threshold=0),
        no_background(),
    )
    for k in range(20):
        model = learn(model, scan_at(10.0 * k, t_s=2.5 * k), land, rules)
    assert geo.in_mask(mask_of(model, rules), land.position_m).all()
    assert len(model) == 1


def test_what_a_scan_does_not_look_at_is_not_forgotten() -> None:
    rules = replace(PAPER, threshold=0)
    near, far = np.array([[500.0, 0.0]]), np.array([[5000.0, 0.0]])
    model = no_background()
    for _ in range(20):
        model = learn(model, scan_at(), points_at(np.concatenate([near, far])), rules)
    west = np.arange(720) >= 360
    for short in (scan_at(reach_m=2000.0), scan_at(swept=west)):
        after = model
        for _ in range(20):
            after = learn(after, short, points_at(np.zeros((0, 2))), rules)
        mask = mask_of(after, rules)
        assert geo.in_mask(mask, far).all()
        assert geo.in_mask(mask, near).any() == (short.swept is not None)


def test_a_half_life_in_seconds_is_that_whatever_the_antenna_does() -> None:
    at = points_at(np.array([[500.0, 0.0]]))
    for turn_s in (1.0, 2.5):
        rules = replace(PAPER, half_life_s=60.0, threshold=0, start="empty")
        model = no_background()
        for k in range(round(60.0 / turn_s)):
            model = learn(model, scan_at(t_s=turn_s * k, turn_s=turn_s), at, rules)
        assert psi_of(model, model.key, rules)[0, 0] == pytest.approx(0.5, rel=1e-9)


def test_a_half_life_in_scans_is_one_of_the_learning_rate() -> None:
    at = points_at(np.array([[500.0, 0.0]]))
    models = []
    for rules in (replace(PAPER, half_life_scans=10.0), replace(PAPER, learning_rate=0.5**0.1)):
        model = no_background()
        for _ in range(5):
            model = learn(model, scan_at(), at, rules)
        models.append(psi_of(model, model.key, rules))
    assert_allclose(*models, rtol=1e-12)


def test_memory_is_bounded_and_what_is_nearest_to_empty_goes_first() -> None:
    rules = replace(PAPER, threshold=0, max_pixels=40)
    land = np.array([[500.0 + 50 * i, 0.0] for i in range(20)])
    rng, model, whole = np.random.default_rng(0), no_background(), no_background()
    for _ in range(60):
        points = points_at(np.concatenate([land, land[rng.random(20) < 0.5], rng.uniform(-8000, 8000, (5, 2))]))
        model = learn(model, scan_at(), points, rules)
        whole = learn(whole, scan_at(), points, replace(rules, max_pixels=1000))
        assert len(model) <= 40
    assert geo.in_mask(mask_of(model, rules), land).all()
    key = np.unique(geo.pixel_key(land, rules.pixel_m))
    assert np.array_equal(psi_of(model, key, rules), psi_of(whole, key, rules))
    assert len(whole) > 200 and len(model.pairs) < 100


def test_pixels_are_named_by_their_place_wherever_that_is() -> None:
    rng = np.random.default_rng(0)
    at = np.concatenate([rng.uniform(-1e5, 1e5, (500, 2)), [[0.0, 0.0], [-1e-9, 0.0], [1e300, -1e300]]])
    key = geo.pixel_key(at, 25.0, (3.0, -4.0))
    centre = geo.pixel_centre(key, 25.0, (3.0, -4.0))
    assert (np.abs(at - centre)[:-1] <= 12.5 + 1e-9).all()
    assert (geo.pixel_key(centre, 25.0, (3.0, -4.0)) == key).all()


def test_points_out_of_the_region_of_interest_are_not_learned() -> None:
    rules = replace(PAPER, threshold=0)
    near, far = np.array([[500.0, 0.0]]), np.array([[5000.0, 0.0]])
    model = learn(no_background(), scan_at(), points_at(np.concatenate([near, far])), rules, roi_max_m=2000.0)
    assert np.array_equal(model.key, geo.pixel_key(near, rules.pixel_m))


def test_what_lies_under_a_spared_track_is_neither_learned_nor_forgotten() -> None:
    rules, at = replace(PAPER, threshold=0, start="empty"), np.array([[500.0, 0.0], [900.0, 0.0]])
    model = no_background()
    for _ in range(10):
        model = learn(model, scan_at(), points_at(at), rules)
    ship = replace(runs.tracks(0, np.random.default_rng(0), 1), position_m=at[:1], velocity_mps=np.zeros((1, 2)))
    key, spared = geo.pixel_key(at, rules.pixel_m), model
    for _ in range(10):
        spared = learn(spared, scan_at(), points_at(np.zeros((0, 2))), rules, spared=ship)
    before, after = psi_of(model, key, rules)[:, 0], psi_of(spared, key, rules)[:, 0]
    assert after[0] == pytest.approx(before[0], rel=1e-12) and after[1] > before[1] + 0.2


def test_a_gap_in_the_recording_counts_as_half_a_half_life_at_most() -> None:
    rules = replace(PAPER, half_life_s=60.0)
    model = replace(no_background(), scans=1)
    for gap_s, share in ((30.0, 0.5), (45.0, 0.5), (7200.0, 0.5), (6.0, 0.1)):
        assert rate_of(model, scan_at(t_s=gap_s, turn_s=0.0), rules) == pytest.approx(0.5**share, rel=1e-12)


def fed_with(history: FloatArray, scans: int) -> Background:
    """The model after one more scan, of which the changes of the scans before it are known."""
    model = replace(no_background(), scans=scans - 1, change=tuple(history.tolist()))
    return feed(model, np.full(len(REGION), 9), PAPER)


def test_land_that_comes_in_sight_and_noise_do_not_keep_a_model_from_settling() -> None:
    """150 pixels have a point in half of the scans; in each scan another one has one that never had one."""
    rng, rules, model = np.random.default_rng(3), replace(PAPER, learning_rate=0.95), no_background()
    while not model.converged:
        key = np.append(np.flatnonzero(rng.integers(0, 2, 150)), 1000 + model.scans)
        seen, model = np.ones(len(model), bool), replace(model, scans=model.scans + 1)
        model = take_counts(model, key, np.full(len(key), 20), seen, rules, rate=0.95)
    assert model.settled and model.scans <= 60


def test_a_change_that_grows_on_converges_at_ten_times_the_memory_and_not_before() -> None:
    growing = np.linspace(0.03, 0.1, 19)  # a memory is 10 scans
    assert not fed_with(growing, 99).converged
    late = fed_with(growing, 100)
    assert late.converged and not late.settled


@pytest.mark.parametrize(("apart", "steady"), [(0.03, True), (0.045, True), (0.055, False), (0.08, False)])
def test_a_change_is_steady_within_five_percent(apart: float, steady: bool) -> None:
    last = fed_with(np.zeros(0), 1).change[0]
    model = fed_with(np.repeat([last / (1 + apart), last], [10, 9]), 30)
    assert model.converged == model.settled == steady
