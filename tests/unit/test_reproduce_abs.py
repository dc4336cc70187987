"""The port's experiment: claims from numbers made up, both ways, and all of it on a small world."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from maritrack.reproduce import REPRODUCTIONS
from maritrack.reproduce.abs_claims import V2, V3, claims_of, share_held, table_of
from maritrack.reproduce.abs_figures import draw
from maritrack.reproduce.abs_runs import CASES, Case, Piece, Run, record, run_case
from maritrack.reproduce.claims import Report
from tests.unit.test_simulate_stations import RADAR, VESSEL

VESSELS = (V2, "dlr4", V3)
T_S = np.arange(1, 601) * 4.0
FIELDS = {name: i for i, name in enumerate(("tp", "fp", "fn", "tn"))}


def made_up(case: Case, *, fp: int = 20, **changes: Any) -> Run:
    """A run as the paper tells it: V2 leaves her berth, V3 reaches hers, FPR falls at first and rises twice."""
    under_way = np.column_stack([T_S > 999, T_S > 0, T_S < 2085])
    held_by = np.where(under_way & (T_S > 250)[:, None], [7, 8, 9], -1)
    held_by[T_S >= 2085, 2] = 9
    if case.start == "empty":
        held_by[T_S > 100, 0] = 7
    table = np.tile([1000, fp, 100 + 100 * case.launch, 80], (600, 1))
    table[T_S <= 200, FIELDS["fp"]] = 200
    table[T_S <= 200, FIELDS["tn"]] = 10
    table[(T_S > 500) & (T_S < 1000), FIELDS["fp"]] += 50
    table[T_S > 1750, FIELDS["fp"]] += 50
    stationary = np.zeros_like(under_way)
    stationary[T_S >= 2085, 2] = True
    run = Run(
        case=case, seed=1, t_s=T_S, vessels=VESSELS, known=np.full((600, 3), True),
        under_way=under_way, held_by=held_by, stationary=stationary,
        n_tracks=(held_by >= 0).sum(axis=1), table=table, converged_s=250.0, snapshots=(),
    )  # fmt: skip
    return replace(run, **changes)


def all_runs() -> list[Run]:
    """Every case, those with the launch with fewer points lost and no misdetection."""
    runs = []
    for case in CASES:
        run = made_up(case, fp=5 if case.launch else 20)
        if not case.launch:
            held_by = run.held_by.copy()
            held_by[100:105, 1] = -1
            run = replace(run, held_by=held_by)
        runs.append(run)
    return runs


def test_every_claim_holds_where_runs_are_as_the_paper_tells_them() -> None:
    claims = claims_of(all_runs())
    assert [claim.name for claim in claims if not claim.holds] == []
    assert len({claim.name for claim in claims}) == len(claims) >= 25
    json.dumps(Report("abs", True, claims, {"cases": table_of(all_runs())}).document(), allow_nan=False)


@pytest.mark.parametrize(
    ("case", "change", "falls"),
    [
        ("2B", {"held_by": np.full((600, 3), -1)}, "2B: fewer misdetections after"),
        ("2B", {"held_by": np.full((600, 3), -1)}, "2B misses fewer than 2A"),
        ("1B", {"fp": 60}, "1B has a lower FPR"),
        ("2B", {"table": np.tile([1000, 5, 50, 80], (600, 1))}, "2B has a lower NPV"),
        ("2A", {"table": np.tile([1000, 20, 100, 80], (600, 1))}, "2A: FPR and NPV improve"),
        ("2A", {"table": np.tile([1000, 20, 100, 80], (600, 1))}, "2A: FPR rises after 500"),
        ("2A", {"table": np.tile([1000, 20, 100, 80], (600, 1))}, "2A: FPR rises after 1750"),
        ("1A", {"held_by": np.arange(1800).reshape(600, 3)}, "1A: dlr4 under way"),
        ("1A", {"held_by": np.arange(1800).reshape(600, 3)}, f"1A: the track of {V3}"),
        ("2A, sea empty at first", {"held_by": np.full((600, 3), -1)}, f"2A, sea empty at first: the track of {V2}"),
        ("2B, sea empty at first", {"held_by": np.full((600, 3), -1)}, f"2B, sea empty at first: the track of {V2}"),
        ("2B, sea empty at first", {"held_by": np.full((600, 3), -1)}, f"2B, sea empty at first: {V3} under way"),
        ("2A, sea empty at first", {"held_by": np.full((600, 3), -1)}, "2A, sea empty at first: fewer misdetections"),
    ],
)
def test_a_claim_falls_where_its_numbers_say_so(case: str, change: dict[str, Any], falls: str) -> None:
    runs = [made_up(run.case, **change) if run.case.name == case else run for run in all_runs()]
    claim = next(claim for claim in claims_of(runs) if claim.name.startswith(falls))
    assert not claim.holds


def test_misdetections_come_with_how_long_the_background_took_everything() -> None:
    """A vessel that nothing could have shown is missed before convergence, whatever the tracker does."""
    run = made_up(CASES[2])
    table = run.table.copy()
    table[:34, [FIELDS["fn"], FIELDS["tn"]]] = 0
    assert run.all_hidden_s() == 0.0 and replace(run, table=table).all_hidden_s() == 34 * 4.0
    table[:, [FIELDS["fn"], FIELDS["tn"]]] = 0
    assert replace(run, table=table).all_hidden_s() == T_S[-1]
    runs = [replace(r, table=table) if r.case.name == "2A" else r for r in all_runs()]
    told = {c.name: c.ours for c in claims_of(runs) if "fewer misdetections" in c.name}
    assert [numbers["all_hidden_s"] for numbers in told.values()] == [T_S[-1], 0.0, 0.0, 0.0]


def test_a_berth_tells_how_many_tracks_its_vessel_has_had_there() -> None:
    """Kept is the last one; the one before it is not forgotten."""
    runs = all_runs()
    held_by = runs[-1].held_by.copy()
    held_by[(T_S > 300) & (T_S < 500), 0] = 70
    runs[-1] = replace(runs[-1], held_by=held_by)
    claim = next(c for c in claims_of(runs) if c.name.startswith(f"2B, sea empty at first: the track of {V2}"))
    assert claim.holds and claim.ours["tracks_at_berth"] == 2.0


def test_shares_count_the_time_under_way_after_convergence() -> None:
    run = made_up(CASES[0])
    held_by = run.held_by.copy()
    span = np.flatnonzero(run.under_way[:, 0] & (T_S > 250.0))
    held_by[span, 0] = np.where(np.arange(len(span)) < len(span) // 2, 7, 77)
    held_by[span[-10:], 0] = -1
    held, one = share_held(replace(run, held_by=held_by), 0)
    assert held == 1 - 10 / len(span) and one == (len(span) // 2) / len(span)


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A scene with the radars' names and one vessel, and the folder of its recordings."""
    folder = tmp_path_factory.mktemp("port")
    places = {"west": "east_m = -500.0", "middle": "north_m = -300.0", "east": "east_m = 450.0",
              "launch": 'aboard = "dlr4"\nhead_up = true\nfirst_cell = 3'}  # fmt: skip
    text = 'title = "reach"\nstart = 2026-03-01T08:00:00Z\nlat_deg = 54.0\nlon_deg = 8.0\nscans = 30\n'
    for sic, (name, place) in enumerate(places.items(), 1):
        text += RADAR.format(name=name, sic=sic, place=place)
    text += VESSEL.format(id="dlr4", length=20.0, way="[[-200, -200], [400, -200]]", speed=4.0)
    text += VESSEL.format(id=V3, length=90.0, way="[[-300, 150], [300, 150]]", speed=6.0)
    (folder / "reach.toml").write_text(text, "utf-8")
    record(folder, seed=1, scans=0, workers=1, scene=folder / "reach.toml")
    return folder, folder / "reach.toml"


def test_the_small_world_is_tracked_by_radars_ashore_and_aboard(small: tuple[Path, Path], tmp_path: Path) -> None:
    sets = ("subtract.half_life_scans=20", "pakf.confirm_hits=2")
    runs = [run_case(Piece(case, small[0], 1, small[1], sets)) for case in CASES]
    for run in runs:
        assert run.vessels == ("dlr4", V3) and len(run.t_s) >= 30
        assert (run.table.sum(axis=1) > 0).mean() > 0.9
    sea_empty = runs[-1]
    assert (sea_empty.held_by[10:, 1] >= 0).mean() > 0.8
    by_case = {run.case.name: run for run in runs}
    assert by_case["1B"].table.sum() > by_case["1A"].table.sum()  # the launch's points
    files = draw(runs, tmp_path)
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in files.values())


def test_it_is_one_of_the_experiments() -> None:
    assert "abs" in REPRODUCTIONS
