"""AIS checked by radar: what was made wrong is found, and nothing else."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from maritrack.aischeck.check import Options, check_ais
from maritrack.aischeck.judge import CONFIRMED, DISPLACED, UNDECIDED, UNSEEN
from maritrack.aischeck.report import document, finding_rows, hints
from tests.aisscene import SHIPS, T0, ais, record
from tests.cli.calling import call
from tests.shared import shared

SEEDS = (0, 1, 2)


@pytest.fixture(scope="module", params=SEEDS)
def run(request, tmp_path_factory):
    return record(tmp_path_factory.mktemp("run"), request.param)


def found(run, folder, **wrong):
    check = check_ais(run / "run.mcap", ais(folder, **wrong), Options())
    rows = finding_rows(check)
    return check, {(row["kind"], row.get("ship")) for row in rows}


def test_of_honest_ships_nothing_is_said(run, tmp_path):
    check, said = found(run, tmp_path)
    assert said == set()
    assert [one.verdict for one in check.verdicts] == [CONFIRMED] * len(SHIPS)
    assert all(one.offset_sigmas < 1.0 for one in check.verdicts)
    assert abs(check.azimuth_deg) < 0.3


@pytest.mark.parametrize(("moved", "gone", "by"), [("201", "204", (0.0, 500.0)), ("202", "205", (470.0, -171.0)),
                                                   ("204", "201", (0.0, -500.0))])  # fmt: skip
def test_a_ship_half_a_kilometre_off_and_one_without_ais_are_found_and_nothing_else(run, tmp_path, moved, gone, by):
    check, said = found(run, tmp_path, shift={moved: by}, without=(gone,))
    assert said == {(DISPLACED, moved), ("no-ais", None)}
    (stranger,) = check.strangers
    expected = np.hypot(*(np.array(stranger.from_m) - np.array(SHIPS[gone][:2])))
    assert expected < 60.0 * SHIPS[gone][2]
    assert stranger.speed_mps == pytest.approx(SHIPS[gone][2], abs=1.0)
    displaced = next(one.displaced for one in check.verdicts if one.id == moved)
    assert displaced is not None
    np.testing.assert_allclose(displaced.offset_m, [-by[0], -by[1]], atol=30.0)


@pytest.mark.parametrize(
    ("off_m", "said"), [(60.0, set()), (80.0, {("position", "201")}), (100.0, {("displaced", "201")})]
)
def test_a_position_off_by_more_than_its_covariance_is_told_and_then_a_displacement(tmp_path, off_m, said):
    assert found(record(tmp_path, 0), tmp_path, shift={"201": (0.0, off_m)})[1] == said


def test_a_ship_that_is_not_there_is_unseen_with_its_probability(run, tmp_path):
    check, said = found(run, tmp_path, ghost=True)
    assert said == {(UNSEEN, "999")}
    ghost = next(one for one in check.verdicts if one.id == "999")
    assert ghost.p_so_few < 1e-3
    assert ghost.p_detect > 0.7
    assert ghost.looks > 40


def test_few_looks_are_not_enough_to_call_a_ship_unseen(run, tmp_path):
    path = ais(tmp_path, ghost=True)
    lines = path.read_text().splitlines()
    kept = [line for line in lines if ",999," not in line or float(line.split(",")[0]) < 1_452_603_600 + 9]
    path.write_text("\n".join(kept) + "\n")
    check = check_ais(run / "run.mcap", path, Options())
    ghost = next(one for one in check.verdicts if one.id == "999")
    assert ghost.looks <= 3
    assert ghost.verdict == UNDECIDED


def test_a_late_transponder_is_told_with_its_lag(run, tmp_path):
    check, said = found(run, tmp_path, late_s={"205": 36.0})
    assert said == {("late", "205")}
    late = next(one for one in check.verdicts if one.id == "205")
    assert late.verdict == CONFIRMED
    assert late.lag_s == pytest.approx(36.0, abs=4.0)
    known = check_ais(run / "run.mcap", tmp_path / "ais.csv", Options(), lags=["205=36"])
    assert next(one for one in known.verdicts if one.id == "205").lag_s == 36.0


def test_a_leap_is_found_where_it_is(run, tmp_path):
    check, said = found(run, tmp_path, leap={"203": 20})
    assert ("jump", "203") in said
    assert {ship for _, ship in said} <= {"203", None}
    (jump,) = check.jumps
    assert jump.off_m == pytest.approx(800.0, abs=40.0)
    assert (jump.t_ns - check.start_ns) * 1e-9 == pytest.approx(80.0, abs=1.0)


def test_ships_behind_land_are_not_judged(run, tmp_path):
    wall = {"type": "Polygon", "coordinates": [[[9.99, 54.003], [10.05, 54.003], [10.05, 54.0032], [9.99, 54.0032],
                                                [9.99, 54.003]]]}  # fmt: skip
    (tmp_path / "wall.geojson").write_text(json.dumps(wall))
    path = ais(tmp_path, ghost=True)
    check = check_ais(run / "run.mcap", path, Options(), coast=tmp_path / "wall.geojson")
    ghost = next(one for one in check.verdicts if one.id == "999")
    assert ghost.verdict == UNDECIDED
    assert ghost.looks == 0
    assert "land lies before it" in ghost.why


def test_the_document_is_json_and_says_how_to_read_it(run, tmp_path):
    check, _ = found(run, tmp_path, ghost=True)
    told = json.loads(json.dumps(document(check, run="r", ais="a")))
    assert told["counts"] == {"confirmed": len(SHIPS), "unseen": 1}
    assert "beta-binomial" in told["reading"]
    rings = told["seeing"]["rings"]
    assert sum(ring["looks"] for ring in rings) > 200
    assert all(ring["low"] <= ring["p_detect"] <= ring["high"] for ring in rings if ring["looks"] > 20)


def test_the_command_writes_its_files_and_tells_findings(tmp_path):
    run = record(tmp_path, 7)
    path = ais(tmp_path, shift={"201": (0.0, 500.0)}, without=("204",))
    done = call("verify-ais", run, "--ais", path, "-o", tmp_path / "check", "--json")
    assert done.code == 0, done.err
    assert {row["kind"] for row in done.json["findings"]} == {"displaced", "no-ais"}
    chart = json.loads((tmp_path / "check" / "verify-ais.geojson").read_text())
    kinds = {feature["properties"]["what"] for feature in chart["features"]}
    assert kinds == {"ship", "displacement", "track without AIS"}
    lon, lat = chart["features"][0]["geometry"]["coordinates"][0]
    assert (abs(lat - 54.0) < 0.1, abs(lon - 10.0) < 0.1) == (True, True)
    assert (tmp_path / "check" / "verify-ais.rrd").stat().st_size > 1000
    assert not list((tmp_path / "check").glob("*.partial"))
    people = call("verify-ais", run / "run.mcap", "--ais", path, "--match", "201,202")
    assert "2 ships of AIS looked at" in people.out
    again = call("verify-ais", run, "--ais", path, "-o", tmp_path / "again", "--json", "--no-rrd")
    assert (tmp_path / "again" / "verify-ais.json").read_bytes() == (
        tmp_path / "check" / "verify-ais.json"
    ).read_bytes()
    assert "rrd" not in again.json["outputs"]


def test_what_can_not_be_checked_is_an_error_of_one_line(tmp_path):
    run = record(tmp_path, 7)
    path = ais(tmp_path)
    (tmp_path / "b.csv").write_text("hello\n")
    cases = [
        (["--ais", tmp_path / "none.csv"], "none.csv"), (["--ais", tmp_path / "b.csv"], "b.csv"),
        (["--ais", path, "--match", "7"], "no ship 7"), (["--ais", path, "--p-unseen", "2"], "between 0 and 1"),
        (["--ais", path, "--coast", path], "no GeoJSON"), (["--ais", path, "--lag", "x"], "ID=SECONDS"),
        (["--ais", path, "--view"], "needs a picture"),
    ]  # fmt: skip
    for more, words in cases:
        done = call("verify-ais", run, *more)
        assert done.code == 2, (more, done.err)
        assert words in done.error


def test_the_ship_that_carries_the_radar_is_told_to_be_so(run, tmp_path):
    path = ais(tmp_path)
    with path.open("a") as file:
        file.writelines(f"{T0 + t},900,54.0,10.0,0,0,0,30,8\n" for t in range(-20, 200, 5))
    check = check_ais(run / "run.mcap", path, Options())
    own = next(one for one in check.verdicts if one.id == "900")
    assert own.verdict == UNDECIDED
    assert "--own-ship" in own.why
    assert finding_rows(check) == []


@pytest.mark.parametrize(
    ("off_deg", "sigma_deg", "said"),
    [(0.9, 0.2, True), (0.9, 0.6, False), (0.4, 0.1, False), (-0.9, 0.2, True), (3.0, math.nan, False)],
)
def test_to_calibrate_is_advised_where_several_ships_ask_for_it(run, tmp_path, off_deg, sigma_deg, said):
    check = check_ais(run / "run.mcap", ais(tmp_path), Options())
    told = hints(replace(check, azimuth_deg=off_deg, azimuth_sigma_deg=sigma_deg))
    assert bool(told) == said


def test_ais_of_another_day_is_said_to_be_so(tmp_path):
    run = record(tmp_path, 7)
    path = ais(tmp_path)
    path.write_text(path.read_text().replace("\n14526", "\n14536"))
    done = call("verify-ais", run, "--ais", path)
    assert done.code == 0
    assert "another day or another place" in done.err


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_in_a_harbour_with_land_and_sea_what_was_made_wrong_is_found_and_nothing_else(tmp_path, seed):
    call("simulate", "harbour", "-o", tmp_path / "r.cat240", "--seed", seed, "--scans", 60)
    call("process", tmp_path / "r.cat240", "-o", tmp_path, "--no-rrd", "-q")
    rows = (tmp_path / "r.ais.csv").read_text().splitlines()
    names = rows[0].split(",")
    ship, north = names.index("id"), names.index("lat_deg")

    def told(moved: str, gone: str) -> set[tuple[str, str | None]]:
        kept = [row.split(",") for row in rows if row.split(",")[ship] != gone]
        for row in kept:
            if row[ship] == moved:
                row[north] = f"{float(row[north]) + 500.0 / 111_200.0:.7f}"
        (tmp_path / "m.csv").write_text("\n".join(",".join(row) for row in kept) + "\n")
        check = check_ais(tmp_path / "run.mcap", tmp_path / "m.csv", Options())
        return {(row["kind"], row.get("ship")) for row in finding_rows(check)}

    assert told("", "") == set()
    for moved, gone in (("ferry", "tug"), ("coaster", "boat-2"), ("boat-1", "tug")):
        assert told(moved, gone) == {(DISPLACED, moved), ("no-ais", None)}


@pytest.mark.slow
def test_the_two_large_ships_of_the_solent_are_confirmed(tmp_path):
    recording = shared("data/marce_solent/run_01_005/solent_01_005.cat240")
    table = shared("data/marce_solent/run_01_005/ais_tracks.csv")
    call("process", recording, "--truth", table, "--own-ship", table, "-o", tmp_path, "--no-rrd", "-q",
         "--azimuth-offset", "-2.4")  # fmt: skip
    check = check_ais(tmp_path / "run.mcap", table, Options())
    said = {one.id: one for one in check.verdicts}
    for ship in ("210574000", "367168640"):
        assert said[ship].verdict == CONFIRMED
        assert said[ship].matched > 200
    assert 30.0 < said["210574000"].lag_s < 60.0
    assert not [one for one in check.verdicts if one.verdict in (UNSEEN, DISPLACED)]


@pytest.mark.parametrize("dated", ["run", "ais"])
def test_a_date_that_one_of_the_two_does_not_know_is_taken_from_the_other(tmp_path, dated):
    day = 1_452_556_800
    path = ais(tmp_path, ghost=True)
    if dated == "run":
        rows = path.read_text().splitlines()
        rows[1:] = [f"{float(row.split(',')[0]) - day},{row.split(',', 1)[1]}" for row in rows[1:]]
        path.write_text("\n".join(rows) + "\n")
        run = record(tmp_path, 3)
    else:
        run = record(tmp_path, 3, start_s=1_452_603_600 - day)
    check = check_ais(run / "run.mcap", path, Options())
    assert {row["kind"] for row in finding_rows(check)} == {UNSEEN}
    assert len(check.verdicts) == len(SHIPS) + 1
