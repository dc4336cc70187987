"""Tolerances by name, and JUnit of what was compared."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from maritrack.diff import diff
from maritrack.errors import ConfigError
from maritrack.junit import junit_octets
from maritrack.tolerances import Tolerance, Tolerances, read_tolerances
from tests import runs

NONE = Tolerance()


def told(tmp_path: Path, text: str) -> Tolerances:
    path = tmp_path / "tol.toml"
    path.write_text(text)
    return read_tolerances(path, floats=NONE)


def summary(path: Path, gospa: float, points: int, zlib: int = 1) -> Path:
    counts = {"points": points, "warnings": {"zlib-error": zlib}}
    path.write_text(json.dumps({"metrics": {"gospa": gospa, "ospa": 7.0}, "counts": counts}))
    return path


def test_each_name_has_its_own_tolerance(tmp_path: Path) -> None:
    a, b = summary(tmp_path / "a.json", 100.0, 1000), summary(tmp_path / "b.json", 100.9, 1001, 2)
    rules = told(tmp_path, "[metrics]\ngospa = 0.01\n[counts]\npoints = {atol = 1}\n[counts.warnings]\nzlib-error = 1")
    assert diff(a, b, tolerances=rules).equal
    assert diff(a, b, rtol=1.0).count == 2  # counts are exact unless named
    tight = told(tmp_path, "rtol = 1.0\n[metrics]\ngospa = 0.001\n[counts]\n'*' = 1.0")
    assert list(diff(a, b, tolerances=tight).metrics) == ["gospa"]


def test_what_is_said_of_a_column_of_tracks_holds_in_archives(tmp_path: Path) -> None:
    results = [runs.result(k) for k in range(2)]
    a = runs.archive(tmp_path / "a.mcap", results)
    results[1].tracks.position_m[0, 0] += 1e-3
    b = runs.archive(tmp_path / "b.mcap", results)
    assert not diff(a, b, tolerances=told(tmp_path, "[tracks]\nvelocity_mps = {atol = 0.01}")).equal
    assert diff(a, b, tolerances=told(tmp_path, "[tracks]\nposition_m = {atol = 0.01}")).equal


@pytest.mark.parametrize(
    "text",
    ["nix = 1", "[metrics]\ngospa = -1", "[metrics]\ngospa = 'a'", "rtol = inf", "[metrics]\ngospa = {}", "a =",
     "a = " + "[" * 5000, "rtol = 1" + "0" * 5000],
    ids=range(8),
)  # fmt: skip
def test_a_file_that_makes_no_sense_is_told(tmp_path: Path, text: str) -> None:
    with pytest.raises(ConfigError, match=r"tol\.toml"):
        told(tmp_path, text)


def test_names_that_nothing_has_are_told(tmp_path: Path) -> None:
    a = summary(tmp_path / "a.json", 40.0, 1000)
    some = told(tmp_path, "[metrics]\ngospa = 1\ngopsa = 1\n'*' = 1\n[counts]\npoint = 1\nwarnings.gap = 1\n")
    assert some.unused(diff(a, a).parts) == ["metrics.gopsa", "counts.point"]
    assert some.unused(diff(a, a, only="metrics").parts) == ["metrics.gopsa"]
    assert told(tmp_path, "[tracks]\nx = 1").unused(diff(a, a).parts) == []


def test_a_case_for_all_that_was_compared_and_a_failure_for_all_that_differs(tmp_path: Path) -> None:
    a, b = summary(tmp_path / "a.json", 100.0, 1000), summary(tmp_path / "b.json", 101.0, 1000)
    octets = junit_octets(diff(a, b), a="golden", b="now")
    root = ET.fromstring(octets)
    cases = {f"{c.get('classname')}.{c.get('name')}": c.find("failure") for c in root.iter("testcase")}
    names = ["metrics.gospa", "metrics.ospa", "counts.points", "counts.warnings.zlib-error"]
    assert list(cases) == [f"maritrack.{name}" for name in names]
    failure = cases["maritrack.metrics.gospa"]
    assert failure is not None and failure.get("message") == "metrics gospa: 100.0 became 101.0"
    suite = root.find("testsuite")
    assert suite is not None and (suite.get("tests"), suite.get("failures")) == ("4", "1")
    assert sum(case is not None for case in cases.values()) == 1 and octets == junit_octets(
        diff(a, b), a="golden", b="now"
    )


def test_parts_of_frames_beyond_the_limit_fail_as_well(tmp_path: Path) -> None:
    results = [runs.result(k) for k in range(4)]
    a = runs.archive(tmp_path / "a.mcap", results)
    for result in results:
        result.clusters.mean_m[0] += 1.0
    results[3].tracks.position_m[0] += 1.0
    found = diff(a, runs.archive(tmp_path / "b.mcap", results), limit=1)
    assert len(found.differences) == 1 and found.parts["clusters"].n == 4 and found.parts["tracks"].n == 1
    assert found.count == 5 and found.parts["points"].n == 0
    root = ET.fromstring(junit_octets(found, a="\x00", b="b"))
    told = [str(failure.get("message")) for failure in root.iter("failure")]
    assert root.get("failures") == "2" and [", and 3 more" in text for text in told] == [True, False]
