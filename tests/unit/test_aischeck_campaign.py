"""AIS of the campaign `manv` checked by its radar: one ship told 500 m off, one not told, and nothing else is found."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from maritrack.aischeck.check import Options, check_ais
from maritrack.aischeck.judge import CONFIRMED, DISPLACED
from maritrack.aischeck.report import finding_rows
from maritrack.simulate.aistable import reports_table
from maritrack.simulate.campaign import Campaign
from maritrack.simulate.campaignwriter import simulate_campaign
from maritrack.simulate.scenes import load_any
from tests.cli.calling import call

SCANS = 240
Shift = tuple[float, float]


def manv() -> Campaign:
    """The campaign, whose craft also has AIS."""
    scene = load_any("manv")
    assert isinstance(scene, Campaign)
    return replace(scene, vessel=tuple(replace(v, ais=True) for v in scene.vessel))


@pytest.fixture(scope="module", params=[(1, SCANS), (2, SCANS), pytest.param((3, 1000), marks=pytest.mark.slow)])
def run(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("manv")
    seed, scans = request.param
    simulate_campaign(manv(), folder / "rec.json", seed=seed, scans=scans, ais=False)
    done = call("process", folder / "rec.json", "-p", "dataset", "--set", "centroid.start=clusters",
                "-o", folder / "run", "--no-rrd", "-q", "--json")  # fmt: skip
    assert done.code == 0, done.err
    return folder / "run" / "run.mcap"


def found(run: Path, folder: Path, shift: dict[str, Shift], without: tuple[str, ...]) -> set[tuple[str, str | None]]:
    """What is found with AIS in which some ships are elsewhere by metres east and north, and some are not."""
    scene = manv()
    fleet = [v for v in scene.others if v.id not in without]
    told = [
        replace(v, waypoints_m=tuple((e + shift[v.id][0], n + shift[v.id][1]) for e, n in v.waypoints_m))
        if v.id in shift
        else v
        for v in fleet
    ]
    (folder / "ais.csv").write_text(reports_table(told, scene.origin, scene.start_s, scene.scans + 20.0))
    check = check_ais(run, folder / "ais.csv", Options())
    assert all(one.verdict == CONFIRMED for one in check.verdicts if one.id not in shift)
    return {(row["kind"], row.get("ship")) for row in finding_rows(check)}


def test_of_what_is_true_nothing_is_said(run: Path, tmp_path: Path) -> None:
    assert found(run, tmp_path, {}, ()) == set()


def test_a_craft_without_ais_is_found(run: Path, tmp_path: Path) -> None:
    assert found(run, tmp_path, {}, ("craft",)) == {("no-ais", None)}


@pytest.mark.parametrize(
    ("moved", "by", "gone"),
    [("target-2", (0.0, 500.0), "target-3"), ("target-3", (400.0, -300.0), "target-2")],
)
def test_a_ship_half_a_kilometre_off_and_one_not_told_are_found_and_nothing_else(
    run: Path, tmp_path: Path, moved: str, by: Shift, gone: str
) -> None:
    assert found(run, tmp_path, {moved: by}, (gone,)) == {(DISPLACED, moved), ("no-ais", None)}
