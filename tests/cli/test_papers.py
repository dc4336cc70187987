"""`maritrack papers`: by paper, by equation, by tracker."""

from __future__ import annotations

from tests.cli.calling import call, spawn


def test_an_equation_shows_its_home_and_its_tests() -> None:
    (row,) = spawn("papers", "polar-10", "--json").json["equations"]
    assert row["homes"][0]["file"] == "maritrack/objects/giw.py" and row["homes"][0]["line"] > 0
    assert any(test["file"].startswith("tests/") for test in row["tests"])
    assert "maritrack/objects/giw.py:" in call("papers", "polar-10").out


def test_a_paper_shows_its_equations_in_order() -> None:
    rows = call("papers", "polar", "--json").json["equations"]
    assert [row["number"] for row in rows] == [str(n) for n in range(1, 13)]


def test_a_tracker_shows_what_it_is_made_of() -> None:
    keys = {row["equation"] for row in call("papers", "--tracker", "jipda", "--json").json["equations"]}
    assert {"polar-8", "polar-9", "polar-11", "polar-12"} <= keys


def test_deviations_and_assumptions_are_listed() -> None:
    assert call("papers", "polar-10", "--deviations", "--json").json["deviations"][0]["text"]
    assert call("papers", "polar-2", "--deviations", "--json").json["deviations"] == []
    keys = {row["key"] for row in call("papers", "--assumed", "--json").json["assumed"]}
    assert "model.p_detect" in keys


def test_an_unknown_key_is_told_in_one_line() -> None:
    for arguments in (("nonsense",), ("polar-99",), ("--tracker", "nonsense")):
        done = call("papers", *arguments)
        assert done.code == 2 and arguments[-1] in done.error
