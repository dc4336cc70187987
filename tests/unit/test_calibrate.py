"""Calibration against known offsets: scenes of ships, moorings and clutter put together from numbers."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from maritrack import geo
from maritrack.calibrate.document import to_toml
from maritrack.calibrate.estimate import Calibration, SensorResult, ShipResult, fitted
from maritrack.calibrate.fit import Fit
from maritrack.calibrate.search import Span
from maritrack.calibrate.sightings import Sightings, Way, ways_of
from maritrack.errors import ConfigError, UsageError
from maritrack.io.reference import Reports, build_reference
from maritrack.io.sensors import calibrated, check_calibration, lags_of
from maritrack.settings import InputConfig

TURN_S, SCANS = 2.5, 60
SPAN = Span(math.radians(10.0), 200.0, 60.0)


def ways(n: int, seed: int, *, length_m: float = 30.0) -> list[Way]:
    """Ships on straight ways at 3 to 9 m/s that report every 10 s."""
    rng, t_s, out = np.random.default_rng(seed), np.arange(-80.0, TURN_S * SCANS + 80, 10.0), []
    for i in range(n):
        course, speed = rng.uniform(0, geo.TWO_PI), rng.uniform(3.0, 9.0)
        at = geo.polar_to_en(np.array([rng.uniform(700, 3500)]), np.array([rng.uniform(0, geo.TWO_PI)]))
        velocity = speed * np.array([math.sin(course), math.cos(course)])
        out.append(Way(f"{i}", f"S{i}", length_m, 6.0, 7.5, t_s, at + np.outer(t_s, velocity), 30.0))
    return out


def sightings(
    ships: list[Way], seed: int, *, azimuth_deg: float, range_m: float, latency_s: float, lag_s: dict[str, float],
    clutter: int = 30, moored: int = 20, p_detect: float = 0.8,
) -> Sightings:  # fmt: skip
    """What a radar at the origin with these errors sees; ships in `lag_s` told their places too late."""
    rng = np.random.default_rng(seed)
    piers = geo.polar_to_en(rng.uniform(400, 4000, moored), rng.uniform(0, geo.TWO_PI, moored))
    scan, t_s, place = [], [], []
    for k in range(SCANS):
        stamp = TURN_S * k + rng.uniform(0, TURN_S, len(ships))
        seen = rng.random(len(ships)) < p_detect
        for i in np.flatnonzero(seen):
            when = np.array([stamp[i] - latency_s + lag_s.get(ships[i].id, 0.0)])
            place.append(ships[i].at(when)[0][0] + rng.normal(0, 8.0, 2))
            t_s.append(stamp[i])
        drawn = geo.polar_to_en(rng.uniform(200, 4000, clutter), rng.uniform(0, geo.TWO_PI, clutter))
        place += list(drawn) + list(piers + rng.normal(0, 8.0, piers.shape))
        t_s += list(TURN_S * k + rng.uniform(0, TURN_S, clutter + moored))
        scan += [k] * (int(seen.sum()) + clutter + moored)
    r, a = geo.en_to_polar(np.array(place))
    pose_s = TURN_S * np.arange(SCANS)
    return Sightings(
        np.array(scan), np.array(t_s), r - range_m, geo.wrap_positive(a - math.radians(azimuth_deg)), pose_s,
        np.zeros((SCANS, 2)), 0, 4200.0, 0.0, 0.0,
    )  # fmt: skip


def errors(found: Fit, azimuth_deg: float, range_m: float, latency_s: float) -> np.ndarray:
    truth = np.array([math.radians(azimuth_deg), range_m, latency_s])
    return np.asarray(found.value[:3] - truth)


@pytest.mark.parametrize("seed", range(3))
def test_known_offsets_come_out_within_their_uncertainty_which_is_small(seed: int) -> None:
    ships = ways(6, seed)
    seen = sightings(ships, seed, azimuth_deg=2.3, range_m=35.0, latency_s=1.5, lag_s={})
    found, which = fitted("radar", seen, ships, SPAN, lags=True)
    sigma = np.array([found.sigma(i) for i in range(3)])
    assert (np.abs(errors(found, 2.3, 35.0, 1.5)) < 3 * sigma).all(), (found.value[:3], sigma)
    assert (sigma < [math.radians(0.3), 8.0, 1.5]).all() and len(which) >= 4
    assert not found.late.any()


def test_deviations_are_what_the_errors_of_many_scenes_are() -> None:
    """Not too small: of 8 scenes the normalised errors have a root mean square about one; not absurdly large."""
    normalised = []
    for seed in range(8):
        ships = ways(6, seed + 100)
        seen = sightings(ships, seed + 100, azimuth_deg=-1.2, range_m=-20.0, latency_s=0.7, lag_s={}, clutter=10)
        found, _ = fitted("radar", seen, ships, Span(math.radians(3.0), 100.0, 10.0), lags=True)
        normalised.append(errors(found, -1.2, -20.0, 0.7) / [found.sigma(i) for i in range(3)])
    rms = np.sqrt(np.mean(np.square(normalised), axis=0))
    assert (rms < 1.7).all() and (rms > 0.1).all(), rms


def test_a_ship_whose_reports_are_late_is_told_from_the_punctual_ones() -> None:
    ships = ways(6, 3)
    seen = sightings(ships, 3, azimuth_deg=-3.0, range_m=0.0, latency_s=0.5, lag_s={"2": 37.0})
    found, which = fitted("radar", seen, ships, SPAN, lags=True)
    i = [way.id for way in which].index("2")
    assert found.late.tolist() == [way.id == "2" for way in which]
    assert abs(found.shift_s[i] + found.value[2] - 37.0) < 3 * found.lag_sigma_s[i] < 12.0
    assert (np.abs(errors(found, -3.0, 0.0, 0.5)) < 3 * np.array([found.sigma(k) for k in range(3)])).all()


def test_little_to_go_by_gives_wide_deviations() -> None:
    ships = ways(6, 0)
    told = {"azimuth_deg": 2.0, "range_m": 10.0, "latency_s": 0.0, "lag_s": {}}
    many, _ = fitted("radar", sightings(ships, 0, **told), ships, SPAN, lags=True)  # type: ignore[arg-type]
    few, _ = fitted("radar", sightings(ships[:1], 0, **told), ships[:1], SPAN, lags=True)  # type: ignore[arg-type]
    assert few.sigma(2) > 2 * many.sigma(2) and few.sigma(0) > 1.5 * many.sigma(0)
    long = [replace(ships[0], bias_m=75.0)]
    unsure, _ = fitted("radar", sightings(long, 0, **told), long, SPAN, lags=True)  # type: ignore[arg-type]
    assert unsure.lag_sigma_s[0] > 75.0 / 9.0


def test_too_little_is_refused_with_a_reason() -> None:
    ships = ways(3, 1)
    seen = sightings(ships, 1, azimuth_deg=0.0, range_m=0.0, latency_s=0.0, lag_s={}, p_detect=0.0, moored=0)
    with pytest.raises(UsageError, match="none of 3 ships under way is seen often enough"):
        fitted("7-42", seen, ships, SPAN, lags=True)
    with pytest.raises(UsageError, match="7-42: no ship of the truth is under way within 4200 m"):
        fitted("7-42", seen, [], SPAN, lags=True)
    yesterday = [replace(way, t_s=way.t_s - 86_400.0) for way in ships]
    with pytest.raises(UsageError, match="no ship of the truth is under way"):
        fitted("7-42", seen, yesterday, SPAN, lags=True)


def test_ways_are_those_of_ships_under_way_and_bridge_no_long_gaps() -> None:
    t_ns = np.array([0, 10, 20, 100, 0, 50], np.int64) * 10**9
    position = np.array([[0, 0], [50, 0], [100, 0], [500, 0], [7, 7], [8, 7]], float)
    unknown = np.full(6, np.nan)
    reports = Reports(np.array([0, 0, 0, 0, 1, 1]), t_ns, position, np.full((6, 2), np.nan), unknown)
    reference = build_reference(
        reports, ids=["a", "b"], names=["", ""], length_m=unknown[:2], width_m=unknown[:2], complete=False
    )
    (way,) = ways_of(reference, 10**10, max_gap_s=30.0, bias_m={})
    assert way.id == "a" and way.bias_m == 50.0 and way.speed_mps == 5.0
    place, velocity, under_way = way.at(np.array([-15.0, -5.0, 0.0, 5.0, 50.0, 95.0]))
    assert under_way.tolist() == [False, True, True, True, False, False]
    assert_allclose(place[1:4], [[25, 0], [50, 0], [75, 0]])
    assert_allclose(velocity[1:4], [[5, 0]] * 3)


FOUND = Calibration(
    "truth",
    (SensorResult("7-42", -2.4123, 0.14, 1.26, 5.0, -1.5, 0.4, 5, 300, 40.0),
     SensorResult('quay "N"', 1.0, 0.1, 0.0, 1.0, 0.0, 1.0, 3, 90, 9.0)),
    (ShipResult("210574000", 'CORNELIS "Z"', 47.9, 7.7, True, 167), ShipResult("3", "", 1.0, 1.0, False, 9)),
)  # fmt: skip


def test_a_calibration_is_a_file_of_sensors_and_lags() -> None:
    base = InputConfig(latency_s=9.0, roi_max_m=5000.0)
    given = {"7-42": replace(base, lat_deg=50.0, lon_deg=-1.0)}
    sensors = calibrated(given, to_toml(FOUND), name="c.toml", base=base)
    assert sensors["7-42"] == replace(given["7-42"], azimuth_offset_deg=-2.412, range_offset_m=1.3, latency_s=-1.5)
    assert sensors['quay "N"'].azimuth_offset_deg == 1.0 and sensors['quay "N"'].roi_max_m == 5000.0
    assert lags_of(to_toml(FOUND), name="c.toml") == "210574000=47.9"
    assert lags_of(to_toml(replace(FOUND, ships=())), name="c.toml") == ""


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("[sensors", "c.toml: "),
        ("[sensor.a]\nlatency_s = 1", "c.toml: unknown key 'sensor'"),
        ("sensors = 3", "c.toml: no table of sensors"),
        ('[sensors.a]\nroi_max_m = 3.0', "c.toml: 'roi_max_m' is no result of a calibration"),
        ('[sensors.a]\nlatency_s = "x"', "c.toml: 'sensors.a.latency_s' = 'x' is not of type float"),
        ("[sensors.a]\nazimuth_offset_deg = nan", "c.toml: input.azimuth_offset_deg = nan is not within"),
        ("[sensors.a]\nazimuth_offset_deg = 1e308", "c.toml: input.azimuth_offset_deg = 1e+308 is not within"),
        ("[sensors.a]\nlatency_s = 1e10", "c.toml: input.latency_s = 10000000000.0 is not within"),
        ("[sensors.a]\nrange_offset_m = -inf", "c.toml: input.range_offset_m = -inf is not within"),
        (f"[sensors.a]\nlatency_s = 1{'0' * 400}", "c.toml: 'sensors.a.latency_s' = 1000000"),
        (f"[sensors.a]\nlatency_s = 1{'0' * 5000}", "c.toml: a number of too many digits"),
        (f"a = {'[' * 5000}{']' * 5000}", "c.toml: nests too deeply"),
        (f"[sensors.a]\nlatency_s{'.x' * 5000} = 1", "c.toml: 'sensors.a.latency_s' = {'x': {"),
        ('[score]\ntruth_lag_s = "1=1e400"', "c.toml: score.truth_lag_s: '1=1e400' is not within"),
        ('[score]\ntruth_lag_s = "1"', "c.toml: score.truth_lag_s: '1' is not ID=SECONDS"),
        ("\n", "c.toml: says nothing"),
    ],
)  # fmt: skip
def test_what_is_no_calibration_is_named(text: str, told: str) -> None:
    with pytest.raises(ConfigError) as caught:
        check_calibration(text.encode(), name="c.toml")
    assert str(caught.value).startswith(told)
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 200


def test_lags_of_another_kind_are_named() -> None:
    with pytest.raises(ConfigError, match=r"of \[score\] a calibration has truth_lag_s alone"):
        lags_of("[score]\nc_m = 3.0", name="c.toml")


def test_a_radar_that_sails_was_elsewhere_by_its_latency() -> None:
    """Polar coordinates count from where it was when it looked, not from where it is when it tells."""
    ships, latency_s, velocity = ways(6, 0), 4.0, np.array([12.0, -5.0])
    seen = sightings(ships, 0, azimuth_deg=0.0, range_m=0.0, latency_s=latency_s, lag_s={}, clutter=0, moored=0)
    at = geo.polar_to_en(seen.range_m, seen.azimuth_rad) - np.outer(seen.t_s - latency_s, velocity)
    range_m, azimuth_rad = geo.en_to_polar(at)
    sails = replace(seen, range_m=range_m, azimuth_rad=azimuth_rad, pose_m=np.outer(seen.pose_s, velocity))
    found, _ = fitted("radar", sails, ships, SPAN, lags=True)
    assert (np.abs(errors(found, 0.0, 0.0, latency_s)) < [math.radians(0.2), 8.0, 1.0]).all(), found.value[:3]


def test_no_offset_is_known_better_than_a_tenth_of_a_cell() -> None:
    ships = ways(6, 0)
    seen = sightings(ships, 0, azimuth_deg=1.0, range_m=10.0, latency_s=0.0, lag_s={})
    coarse = replace(seen, cell_m=80.0, cell_rad=math.radians(3.0))
    fine, found = (fitted("radar", one, ships, SPAN, lags=True)[0] for one in (seen, coarse))
    assert found.cov[0, 0] - fine.cov[0, 0] == pytest.approx(math.radians(0.3) ** 2, rel=1e-6)
    assert found.cov[1, 1] - fine.cov[1, 1] == pytest.approx(8.0**2, rel=1e-6)


def test_a_lag_is_no_surer_than_where_on_a_long_ship_its_echo_lies() -> None:
    """Not even of a ship that speeds up and slows down, by which a lag and a place ahead could be told apart."""
    t_s = np.arange(-80.0, TURN_S * SCANS + 80, 2.0)
    gone = 6.0 * t_s + 4.5 * 12.0 * np.sin(t_s / 12.0)
    quick = Way("q", "Q", 300.0, 40.0, 75.0, t_s, np.stack([gone - 500.0, 900.0 + 0.1 * gone], axis=1), 30.0)
    ships = [*ways(5, 1), quick]
    seen = sightings(ships, 1, azimuth_deg=0.0, range_m=0.0, latency_s=0.0, lag_s={})
    found, which = fitted("radar", seen, ships, SPAN, lags=True)
    i = [way.id for way in which].index("q")
    assert found.lag_sigma_s[i] > 75.0 / quick.speed_mps
