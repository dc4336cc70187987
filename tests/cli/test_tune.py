"""`maritrack tune`: studies as from a shell."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest
from maritrack_cli.main import app
from typer.testing import CliRunner

from tests.cli.calling import call
from tests.shared import ROOT, shared

FERRY = ROOT / "data" / "samples" / "autoferry13_detections.json"
SMALL = ("--eps", "20,55", "--min-points", "2:3", "--limit", "1")
PNG = b"\x89PNG\r\n\x1a\n"


@pytest.fixture(scope="module")
def labelled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("tune") / "rec.cat240"
    assert call("simulate", "harbour", "-o", path, "--scans", "1", "-q").code == 0
    return path


def table(path: Path) -> list[dict[str, str]]:
    return list(csv.DictReader(path.read_text("utf-8").splitlines()))


@pytest.mark.parametrize("command", ["clustering", "tracker"])
def test_help_gives_examples(command: str) -> None:
    done = CliRunner().invoke(app, ["tune", command, "--help"], env={"COLUMNS": "200"})
    assert done.exit_code == 0 and f"maritrack tune {command}" in done.output and "Examples" in done.output


def test_clustering_says_which_pair_is_best_in_each_domain(labelled: Path, tmp_path: Path) -> None:
    done = call("tune", "clustering", labelled, *SMALL, "--json", "-o", tmp_path)
    assert done.code == 0, done.err
    assert done.json["scans"] == 1 and "cells of rec.labels.parquet" in done.json["labels"]
    for domain in ("polar-dbscan", "cartesian-dbscan"):
        own = [row for row in done.json["grid"] if row["domain"] == domain]
        chosen = [row for row in own if row["chosen"]]
        assert len(own) == 4 and len(chosen) == 1
        assert max(row["ari"] for row in own) - chosen[0]["ari"] <= 0.01
        assert done.json["domains"][domain]["paper"]["eps_m"] == 55.0
    assert (tmp_path / "clustering.png").read_bytes()[:8] == PNG
    rows = table(tmp_path / "clustering.csv")
    assert [float(row["ari"]) for row in rows] == [row["ari"] for row in done.json["grid"]]


def test_clustering_is_told_to_people_with_the_settings_to_use(labelled: Path) -> None:
    done = call("tune", "clustering", labelled, "--truth", labelled.with_name("rec.truth.json"), *SMALL)
    assert done.code == 0 and "cells of rec.labels.parquet" in done.out and "--set cluster.eps_m=" in done.out
    by_positions = call("tune", "clustering", labelled, *SMALL, "--positions", "--moving")
    assert "objects under way" in by_positions.out
    assert "--positions" in call("tune", "clustering", labelled, *SMALL, "--moving").err
    other = labelled.with_name("other.json")
    other.write_bytes(labelled.with_name("rec.truth.json").read_bytes())
    assert "positions and hulls of all objects" in call("tune", "clustering", labelled, *SMALL, "--truth", other).out


def test_tracker_gives_a_row_a_combination_the_best_first(tmp_path: Path) -> None:
    axes = ("--grid", "model.p_detect=0.5,0.9", "--grid", "tracker.delete_misses=4,8", "--limit", "15")
    done = call("tune", "tracker", FERRY, *axes, "--tracker", "jipda,sprt", "--json", "-o", tmp_path)
    assert done.code == 0, done.err
    gospa = [row["metrics"]["gospa"] for row in done.json["rows"]]
    assert len(gospa) == 8 and gospa == sorted(gospa) and done.json["best"] == done.json["rows"][0]
    assert (tmp_path / "tracker.png").read_bytes()[:8] == PNG
    assert [float(row["gospa"]) for row in table(tmp_path / "tracker.csv")] == gospa


def test_tracker_answers_the_same_again_and_draws_lines_for_one_key(tmp_path: Path) -> None:
    what = ("tune", "tracker", FERRY, "--grid", "tracker.assign_by=likeliest,nearest", "--limit", "8", "-t", "ipda")
    one = call(*what, "--json", "-o", tmp_path / "a")
    two = call(*what, "--json", "-o", tmp_path / "b")
    assert one.json["rows"] == two.json["rows"]
    for name in ("tracker.csv", "tracker.png"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


def test_a_failed_combination_is_told_in_its_row(tmp_path: Path) -> None:
    done = call("tune", "tracker", FERRY, "--grid", "input.sensor=sonar,radar", "--limit", "10", "-o", tmp_path)
    assert done.code == 0 and "sonar" in done.out.splitlines()[3]
    assert [bool(row["error"]) for row in table(tmp_path / "tracker.csv")] == [False, True]
    three = ("--grid", "seed=1", "--grid", "model.rho=0.2", "--grid", "model.p_gate=0.9")
    assert "picture" in call("tune", "tracker", FERRY, *three, "--limit", "5", "-o", tmp_path).err


def test_chosen_ships_are_all_the_truth_of_a_study(labelled: Path) -> None:
    def n_truth(*more: str) -> float:
        done = call("tune", "tracker", FERRY, "--tracker", "jipda", "--limit", "4", "--json", *more)
        return float(done.json["rows"][0]["metrics"]["n_truth"])

    assert (n_truth(), n_truth("--truth-match", "1")) == (2.0, 1.0)
    ids = sorted({row["id"] for row in json.loads(labelled.with_suffix(".truth.json").read_text())["truth"]})
    counts = [
        call("tune", "clustering", labelled, *SMALL, "--positions", "--json", *more).json["grid"]
        for more in ((), ("--truth-match", ids[0]))
    ]
    assert counts[0] != counts[1]
    assert "--positions" in call("tune", "clustering", labelled, *SMALL, "--truth-match", ids[0]).err


def test_wrong_use_is_told_in_one_line(labelled: Path, tmp_path: Path) -> None:
    assert "nothing to cluster" in call("tune", "clustering", FERRY).error
    assert "--eps" in call("tune", "clustering", labelled, "--eps", "5:1").error
    assert "--eps" in call("tune", "clustering", labelled, "--eps", "0:10:5").error
    assert "--noise" in call("tune", "clustering", labelled, "--noise", "odd").error
    assert "no.json" in call("tune", "clustering", labelled, "--truth", tmp_path / "no.json").error
    assert "no.cat240" in call("tune", "tracker", tmp_path / "no.cat240", "--grid", "seed=1").error
    assert "model.p_detec" in call("tune", "tracker", FERRY, "--grid", "model.p_detec=0.7").error
    assert "--grid or --tracker" in call("tune", "tracker", FERRY).error
    assert "--by" in call("tune", "tracker", FERRY, "--grid", "seed=1", "--by", "speed").error
    assert "jida" in call("tune", "tracker", FERRY, "--tracker", "jida").error


def test_clusters_of_a_real_recording_by_its_ais() -> None:
    folder = shared("data/marce_solent/run_01_005")
    ais = folder / "ais_tracks.csv"
    done = call(
        "tune", "clustering", folder / "solent_01_005.cat240", "--truth", ais, "--own-ship", ais, "--moving", *SMALL,
        "--margin", "100", "--json",
    )  # fmt: skip
    assert done.code == 0, done.err
    assert done.json["points"]["object"] > 10 and done.json["points"]["unknown"] > 1000
