"""Single objects that association finds hard, as cells of a radar: gaps, crossings, occlusion, merged clusters."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, replace

import numpy as np
import pytest

from maritrack import geo
from maritrack.chain import build_chain, process
from maritrack.cluster.stage import cluster_points
from maritrack.config import load_config
from maritrack.settings import Config
from maritrack.trackers import TRACKERS
from maritrack.types import CONFIRMED, FloatArray, Frame, Points, Scan, Sensor, Tracks
from tests.unit.scans import LIST_TRACKERS

TURN_S, CELL_M, CELL_RAD, SCANS = 2.5, 7.5, 2 * np.pi / 2048, 64
PATIENT = ("model.p_detect=0.6", "model.p_survive=0.999", "tracker.delete_misses=14", "tracker.delete_existence=0.005",
           "sprt.beta=0.01", "phd.p_survive_scan=0.999", "phd.prune_weight=1e-5", "phd.hold_scans=14",
           "intensity.p_survive_scan=0.999", "intensity.prune_weight=1e-5", "intensity.hold_scans=14",
           "pmbm.extract_existence=0.0", "pmbm.prune_existence=1e-5")  # fmt: skip
OTHERS = {"smc-phd", "gp-pmbm"}  # the particles of one lose an object now and then, the other is for contours
STEADY = [name for name in TRACKERS if name not in OTHERS]
each_tracker = pytest.mark.parametrize("name", STEADY)
each_seed = pytest.mark.parametrize("seed", range(3))


@dataclass(frozen=True)
class Ship:
    """A hull that keeps its course, at `start_m` in scan 0; `hidden` says in which scans nobody sees it."""

    start_m: tuple[float, float]
    velocity_mps: tuple[float, float]
    length_m: float
    width_m: float
    hidden: Callable[[int], bool] = lambda k: False
    echo_m2: float = 40.0  # hull that gives one echo

    def at(self, k: float) -> FloatArray:
        return np.array(self.start_m) + k * TURN_S * np.array(self.velocity_mps)

    def echoes(self, k: int, rng: np.random.Generator) -> FloatArray:
        """Points spread evenly over the hull, its bow ahead."""
        n = max(round(self.length_m * self.width_m / self.echo_m2), 4)
        u = rng.uniform(-0.5, 0.5, (n, 2)) * [self.length_m, self.width_m]
        ahead = np.array(self.velocity_mps) / np.hypot(*self.velocity_mps)
        return self.at(k) + u[:, :1] * ahead + u[:, 1:] * np.array([-ahead[1], ahead[0]])


def config_of(name: str, *sets: str) -> Config:
    return load_config(
        preset="radar", sets=[f"tracker_name={name}", "cluster.eps_m=25.0", "subtract.method=none", *PATIENT, *sets]
    )


def scan_of_cells(z: FloatArray, k: int) -> Scan:
    """The cells that hold a point of z (n, 2), each once."""
    range_m, azimuth = geo.en_to_polar(z)
    cells = np.unique(np.floor(np.stack([range_m / CELL_M, azimuth / CELL_RAD], 1)), axis=0) + 0.5
    range_m, azimuth, n, t_ns = cells[:, 0] * CELL_M, cells[:, 1] * CELL_RAD, len(cells), round(k * TURN_S * 1e9)
    points = Points(
        range_m=range_m, azimuth_rad=azimuth, position_m=geo.polar_to_en(range_m, azimuth), intensity=np.ones(n),
        t_ns=np.full(n, t_ns), range_width_m=np.full(n, CELL_M), azimuth_width_rad=np.full(n, CELL_RAD),
    )  # fmt: skip
    return Scan(Sensor("radar", CELL_M, CELL_RAD, 6000.0), t_ns, t_ns, np.zeros(2), np.nan, points=points)


def watch(ships: list[Ship], config: Config, seed: int) -> list[Tracks]:
    """Tracks after each scan; ships are missed in a twentieth of the scans, two clusters a scan are clutter."""
    rng, chain, seen = np.random.default_rng(seed), build_chain(config), []
    state = chain.init()
    for k in range(SCANS):
        z = [ship.echoes(k, rng) for ship in ships if rng.random() < 0.95 and not ship.hidden(k)]
        z += [rng.uniform([-1500, 1500], [1500, 4500]) + rng.normal(0, 8, (4, 2)) for _ in range(rng.poisson(2))]
        state, result = process(chain, state, Frame(k, scan_of_cells(np.concatenate([np.zeros((0, 2)), *z]), k)))
        seen.append(result.tracks)
    return seen


def held(seen: list[Tracks], ship: Ship, reach_m: float = 70.0) -> list[int]:
    """Id of the confirmed track nearest to the ship in each scan, 0 where there is none within reach."""
    ids = []
    for k, tracks in enumerate(seen):
        away = np.hypot(*(tracks.position_m - ship.at(k)).T)
        good = np.flatnonzero((tracks.status >= CONFIRMED) & (away < reach_m))
        ids.append(int(tracks.id[good[np.argmin(away[good])]]) if len(good) else 0)
    return ids


def assert_kept(seen: list[Tracks], *ships: Ship, without: Collection[int] = ()) -> None:
    """From its tenth scan to the end, but for some scans, each ship has one track, and no other ship has it."""
    which = [k for k in range(10, SCANS) if k not in without]
    ids = [{held(seen, ship)[k] for k in which} for ship in ships]
    assert all(len(mine) == 1 and 0 not in mine for mine in ids), ids
    assert len(set.union(*ids)) == len(ships)


def crossing(distance_m: float) -> list[Ship]:
    """Two ships on courses at right angles that come as near as `distance_m` in scan 30, 3 km away."""
    way = 6.0 * TURN_S * 30
    one = Ship((-way, 3000.0), (6.0, 0.0), 50.0, 12.0)
    return [one, Ship((0.0, 3000.0 - way + np.sqrt(2.0) * distance_m), (0.0, 6.0), 40.0, 10.0)]


GAP = Ship((-400.0, 3000.0), (6.0, 1.5), 80.0, 16.0, hidden=lambda k: 30 <= k < 40)


@each_tracker
@each_seed
def test_a_vessel_with_a_gap_of_ten_scans_keeps_its_id(name: str, seed: int) -> None:
    assert_kept(watch([GAP], config_of(name), seed), GAP)


@each_tracker
def test_without_patience_the_same_gap_ends_the_track(name: str) -> None:
    seen = watch(
        [GAP], config_of(name, "tracker.delete_misses=6", "phd.prune_weight=1e-2", "pakf.confirmed_misses=6",
                         "intensity.prune_weight=1e-2"), 0
    )  # fmt: skip
    ids = held(seen, GAP)
    assert ids[39] == 0 and ids[-1] not in (0, ids[29])


@pytest.mark.parametrize("name", [*LIST_TRACKERS, "cb-giw-phd", "pakf-jpda"])
@pytest.mark.parametrize("preset", ["polar", "radar"])
def test_after_ten_minutes_of_silence_a_cluster_far_away_starts_a_track_of_its_own(name: str, preset: str) -> None:
    """The one before, whose gate is kilometres wide by then, does not jump to it."""
    ship, rng = Ship((0.0, 3000.0), (4.0, 0.0), 80.0, 16.0), np.random.default_rng(1)
    chain = build_chain(
        load_config(preset=preset, sets=[f"tracker_name={name}", "subtract.method=none", "clutter_map.method=none"])
    )
    state, silence = chain.init(), round(600.0 / TURN_S)
    for k in [*range(12), *range(12 + silence, 16 + silence)]:
        z = ship.echoes(min(k, 12), rng) + np.array([3000.0 * (k >= 12), 0.0])
        state, result = process(chain, state, Frame(k, scan_of_cells(z, k)))
        if k == 11:
            before = set(result.tracks.id[result.tracks.status >= CONFIRMED].tolist())
    assert before and len(result.tracks)
    assert before.isdisjoint(result.tracks.id.tolist())


@each_tracker
@each_seed
def test_two_vessels_that_cross_at_sixty_metres_keep_their_ids(name: str, seed: int) -> None:
    ships = crossing(60.0)
    near = min(float(np.hypot(*(ships[0].at(k) - ships[1].at(k)))) for k in range(SCANS))
    assert near == pytest.approx(60.0, abs=1.0)
    assert_kept(watch(ships, config_of(name), seed), *ships)


@pytest.mark.parametrize("name", LIST_TRACKERS)
@each_seed
def test_vessels_keep_their_ids_over_scans_in_which_they_are_one_cluster(name: str, seed: int) -> None:
    ships, config = crossing(14.0), config_of(name)
    rng = np.random.default_rng(seed)
    merged = [k for k in range(SCANS) if n_clusters(ships, k, config, rng) == 1]
    assert len(merged) >= 4 and 30 in merged
    assert_kept(watch(ships, config, seed), *ships, without=merged)


@each_seed
def test_the_phd_filter_finds_both_vessels_again_after_scans_in_which_they_are_one_cluster(seed: int) -> None:
    """Not always under the old label: to it one cluster is one object, so the weight of two halves meanwhile."""
    ships = crossing(14.0)
    seen = watch(ships, config_of("cb-giw-phd"), seed)
    ids = [held(seen, ship) for ship in ships]
    assert all(len(set(mine[10:26])) == 1 and len(set(mine[52:])) == 1 for mine in ids), ids
    assert 0 not in {mine[-1] for mine in ids} and ids[0][-1] != ids[1][-1]


@each_tracker
def test_a_ship_of_four_hundred_metres_at_five_hundred_is_one_track(name: str) -> None:
    """It passes abeam, 43 degrees wide; its hull breaks now and then, and the part is no second track."""
    ship = Ship((-640.0, 500.0), (8.0, 0.0), 400.0, 60.0, echo_m2=20.0)
    seen = watch([ship], config_of(name, "model.max_axis_m=400.0"), 0)
    assert_kept(seen, ship)
    on_it = []
    for k, tracks in enumerate(seen[10:], start=10):
        along, across = np.abs(tracks.position_m - ship.at(k)).T
        on_it.append(((along < 220.0) & (across < 50.0) & (tracks.status >= CONFIRMED)).sum())
    assert on_it == [1] * len(on_it)


@each_tracker
@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_a_vessel_that_crosses_the_bearing_where_turns_begin_keeps_its_id_at_every_bearing(
    name: str, sense: float
) -> None:
    """Sixteen vessels, each crosses a bearing of its own in the middle of the run; one of them crosses North.

    Each echo has the time of its spoke, so that the hull on North has the beginning and the end of a turn.
    """
    bearing = 2 * np.pi * np.arange(16) / 16
    out, along = np.stack([np.sin(bearing), np.cos(bearing)], 1), np.stack([np.cos(bearing), -np.sin(bearing)], 1)
    velocity = sense * 6.0 * along
    ships = [
        Ship(tuple(3000.0 * u - 32 * TURN_S * v), tuple(v), 80.0, 16.0) for u, v in zip(out, velocity, strict=True)
    ]
    rng, chain = np.random.default_rng(1), build_chain(config_of(name))
    state = chain.init()
    ids: list[set[int]] = [set() for _ in ships]
    for k in range(SCANS):
        state, result = process(chain, state, Frame(k, turning_scan(ships, k, rng)))
        tracks = result.tracks
        for ship, mine in zip(ships, ids, strict=True) if k >= 10 else ():
            at = np.stack([ship.at(t / (TURN_S * 1e9)) for t in tracks.t_ns])
            near = (np.hypot(*(tracks.position_m - at).T) < 40.0) & (tracks.status >= CONFIRMED)
            mine.update(tracks.id[near].tolist() or [0])
    assert all(len(mine) == 1 and 0 not in mine for mine in ids), ids
    assert len(set.union(*ids)) == len(ships)


def turning_scan(ships: list[Ship], k: int, rng: np.random.Generator) -> Scan:
    """The cells of turn k, each echo where the hull is when the beam passes it, with that time."""
    z = []
    for ship in ships:
        echoes = ship.echoes(k, rng)
        share = geo.en_to_polar(echoes)[1] / geo.TWO_PI  # of the turn that has passed
        z.append(echoes + share[:, None] * TURN_S * np.array(ship.velocity_mps))
    scan = scan_of_cells(np.concatenate(z), k)
    points, start_ns = scan.points, round(k * TURN_S * 1e9)
    assert points is not None
    t_ns = start_ns + np.rint(points.azimuth_rad / geo.TWO_PI * TURN_S * 1e9).astype(np.int64)
    return replace(scan, t_ns=start_ns + round(TURN_S * 1e9), t_start_ns=start_ns, points=replace(points, t_ns=t_ns))


@each_tracker
@each_seed
def test_a_vessel_that_passes_behind_another_keeps_its_id(name: str, seed: int) -> None:
    wall = Ship((-100.0, 2800.0), (1e-3, 0.0), 200.0, 30.0)
    shadow = np.arctan2([-200.0, 0.0], 2800.0)
    passing = Ship((-650.0, 3100.0), (10.0, 0.0), 60.0, 14.0)
    azimuth = [np.arctan2(*passing.at(k)) for k in range(SCANS)]
    behind = [bool(shadow[0] < a < shadow[1]) for a in azimuth]
    assert sum(behind) >= 8
    ships = [wall, Ship(passing.start_m, passing.velocity_mps, 60.0, 14.0, hidden=lambda k: behind[k])]
    assert_kept(watch(ships, config_of(name), seed), *ships)


def n_clusters(ships: list[Ship], k: int, config: Config, rng: np.random.Generator) -> int:
    """Clusters of the ships alone."""
    scan = scan_of_cells(np.concatenate([ship.echoes(k, rng) for ship in ships]), k)
    assert scan.points is not None
    return len(cluster_points(scan.points, scan, config.cluster, config.input))
