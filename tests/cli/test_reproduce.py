"""`maritrack reproduce`: one report, for people and for programs, and wrong use."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from maritrack.fanout import Tick, fan_out
from maritrack.reproduce import REPRODUCTIONS
from maritrack.reproduce.claims import Claim, Plan, Report, Table
from tests.cli.calling import call


def halve(x: int) -> float:
    return x / 2


def experiment(plan: Plan, tick: Tick | None) -> Report:
    """A small one: halves of the seeds, a statement that holds and one that doesn't."""
    seeds = range(1, (plan.seeds or (2 if plan.quick else 4)) + 1)
    halves = dict(fan_out(halve, seeds, workers=plan.workers, tick=tick))
    rows = tuple((str(i), halves[i - 1], None) for i in seeds)
    table = Table("halves of numbers", ("number", "half", "third"), rows)
    claims = (
        Claim("halves are smaller", halves[0] < 1, {"largest": max(halves.values())}, {"largest": 2}),
        Claim("halves are larger", False, {"none": float("nan")}, None),
    )  # fmt: skip
    figures = {}
    if plan.out is not None:
        figures["list"] = plan.out / "list.txt"
        figures["list"].write_text(repr(halves))
    return Report("numbers", plan.quick, claims, {"halves": table}, figures)


@pytest.fixture(autouse=True)
def small_experiment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(REPRODUCTIONS, "numbers", experiment)


def test_the_document_tells_claims_tables_and_figures(tmp_path: Path) -> None:
    done = call("reproduce", "numbers", "--quick", "--json", "-o", tmp_path / "new" / "folder")
    assert done.code == 0 and done.err == ""
    assert done.json == {
        "paper": "numbers",
        "quick": True,
        "claims": [
            {"name": "halves are smaller", "holds": True, "ours": {"largest": 1.0}, "paper": {"largest": 2}},
            {"name": "halves are larger", "holds": False, "ours": {"none": None}, "paper": None},
        ],
        "tables": {
            "halves": [{"number": "1", "half": 0.5, "third": None}, {"number": "2", "half": 1.0, "third": None}]
        },
        "figures": {"list": str(tmp_path / "new" / "folder" / "list.txt")},
    }  # fmt: skip
    assert json.loads((tmp_path / "new" / "folder" / "report.json").read_text()) == done.json


def test_a_number_of_runs_that_cannot_be_is_told_by_its_option() -> None:
    assert call("reproduce", "numbers", "--seeds", "-1").error.startswith("--seeds -1: not negative")


def test_a_statement_that_does_not_hold_is_told_and_is_no_error() -> None:
    done = call("reproduce", "numbers")
    assert done.code == 0
    assert "holds: halves are smaller" in done.out and "DOES NOT HOLD: halves are larger" in done.out
    assert "number  half  third" in done.out and "largest 2" in done.out


def test_results_do_not_depend_on_workers_and_seeds_can_be_chosen() -> None:
    one, two = (call("reproduce", "numbers", "--json", "--workers", n, "--seeds", "3").json for n in ("1", "2"))
    assert one == two and len(one["tables"]["halves"]) == 3


def test_experiments_are_listed() -> None:
    assert "numbers" in call("reproduce", "--list").out.splitlines()
    assert "numbers" in call("reproduce", "--list", "--json").json["papers"]


def test_wrong_use_is_told_in_one_line(tmp_path: Path) -> None:
    assert "'colours'" in call("reproduce", "colours").error
    assert "which paper" in call("reproduce").error
    assert "--workers -1: from 1 to 64" in call("reproduce", "numbers", "--workers", "-1").error
    (tmp_path / "file").write_text("")
    assert "file" in call("reproduce", "numbers", "-o", tmp_path / "file").error


def test_rows_have_as_many_cells_as_the_header() -> None:
    with pytest.raises(ValueError, match="'odd'"):
        Table("odd", ("a", "b"), (("x",),))
