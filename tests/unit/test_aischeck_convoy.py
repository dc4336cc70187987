"""Ships in line: which of them tells no AIS, and what can't be told of two that go alike."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from maritrack.aischeck.check import Check, Options, check_ais
from maritrack.aischeck.judge import CONFIRMED
from maritrack.aischeck.report import document, finding_rows
from tests.aisscene import SHIPS, Fleet, ais, record, way

AHEAD = np.array([np.sin(np.radians(95.0)), np.cos(np.radians(95.0))])


def convoy(gap_m: float) -> Fleet:
    """Ship 201 and, so far behind it, 207; others elsewhere."""
    others = {i: SHIPS[i] for i in ("202", "203", "204", "205")}
    east, north = np.array(SHIPS["201"][:2]) - gap_m * AHEAD
    return others | {"201": SHIPS["201"], "207": (float(east), float(north), *SHIPS["201"][2:])}


def checked(
    folder: Path, ships: Fleet, seed: int, *, without: str, shift: dict[str, tuple[float, float]] | None = None
) -> tuple[Check, dict[tuple[str, str | None], str]]:
    run = record(folder, seed, ships=ships)
    check = check_ais(run / "run.mcap", ais(folder, ships=ships, without=(without,), shift=shift), Options())
    return check, {(row["kind"], row.get("ship")): row["what"] for row in finding_rows(check)}


def from_ship_m(check: Check, ships: Fleet, ship: str) -> float:
    """How far the only track without AIS is from a ship when it begins."""
    (stranger,) = check.strangers
    return float(np.hypot(*(way(ships[ship], np.array([stranger.first_s]))[0] - np.array(stranger.from_m))))


@pytest.mark.parametrize("gone", ["201", "207"])
@pytest.mark.parametrize("gap_m", [100.0, 200.0, 300.0])
def test_the_ship_of_a_convoy_that_tells_no_ais_is_found_and_the_other_is_not_late(
    tmp_path: Path, gap_m: float, gone: str
) -> None:
    ships = convoy(gap_m)
    check, said = checked(tmp_path, ships, 2, without=gone)  # another ship's track is longer than the own one here
    assert set(said) == {("no-ais", None)}
    assert from_ship_m(check, ships, gone) < 50.0
    assert all(one.verdict == CONFIRMED and not one.doubles for one in check.verdicts)


def test_of_two_tracks_that_go_as_a_displaced_ship_does_the_other_is_told_too(tmp_path: Path) -> None:
    check, said = checked(tmp_path, convoy(300.0), 1, without="201", shift={"207": (0.0, 500.0)})
    assert set(said) == {("no-ais", None), ("displaced", "207")}
    (stranger,) = check.strangers
    assert f"or it is track {stranger.track}," in said["displaced", "207"]
    told = next(one for one in document(check, run="r", ais="a")["ships"] if one["id"] == "207")
    assert told["tracks_alike"] == [stranger.track]


def test_a_ship_that_seems_late_may_be_another_one_of_its_convoy(tmp_path: Path) -> None:
    back = tuple((-500.0 * AHEAD).tolist())  # 201 is told 200 m behind 207
    check, said = checked(tmp_path, convoy(300.0), 1, without="207", shift={"201": back})
    (stranger,) = check.strangers
    assert set(said) == {("no-ais", None), ("late", "201")}
    assert f"or it is track {stranger.track}," in said["late", "201"]
