"""`maritrack simulate`: recordings that are the same again, and wrong use."""

from __future__ import annotations

from pathlib import Path

from tests.cli.calling import call, spawn


def test_a_recording_and_its_truth_are_written(tmp_path: Path) -> None:
    done = spawn("simulate", "harbour", "-o", tmp_path / "rec.cat240", "--scans", "2", "--json")
    assert done.code == 0 and done.err == "" and done.json["scans"] == 2
    beside = ["rec.ais.csv", "rec.cat240", "rec.labels.parquet", "rec.truth.json"]
    assert sorted(p.name for p in tmp_path.iterdir()) == beside
    assert done.json["ais_reports"] > 0 and done.json["labelled_cells"] > 0
    shown = call("show", tmp_path / "rec.cat240", "--json").json
    assert shown["scans"] == 2 and shown["truth"] > 0


def test_ais_and_labels_are_left_out_on_request_and_change_nothing_else(tmp_path: Path) -> None:
    call("simulate", "harbour", "-o", tmp_path / "a.cat240", "--scans", "1")
    done = call("simulate", "harbour", "-o", tmp_path / "b.cat240", "--scans", "1", "--no-ais", "--no-labels", "--json")
    assert sorted(p.name for p in tmp_path.glob("b.*")) == ["b.cat240", "b.truth.json"]
    assert not {"ais", "labels", "ais_reports", "labelled_cells"} & set(done.json)
    for kind in ("cat240", "truth.json"):
        assert (tmp_path / f"a.{kind}").read_bytes() == (tmp_path / f"b.{kind}").read_bytes()


def test_equal_seeds_give_equal_octets(tmp_path: Path) -> None:
    paths = [tmp_path / name for name in ("a", "b", "c")]
    for path, seed in zip(paths, (3, 3, 4), strict=True):
        call("simulate", "harbour", "-o", path, "--scans", "1", "--seed", str(seed))
    a, b, c = (path.read_bytes() for path in paths)
    assert a == b and a != c


def test_the_sample_is_what_the_scene_makes(sample: Path, tmp_path: Path) -> None:
    call("simulate", "harbour", "-o", tmp_path / "rec.cat240", "--scans", "2")
    octets = (tmp_path / "rec.cat240").read_bytes()
    assert sample.read_bytes()[: len(octets)] == octets


def test_scenes_are_listed() -> None:
    assert {"harbour", "near-field", "far-field"} <= set(call("simulate", "--list").out.splitlines())
    assert "harbour" in call("simulate", "--list", "--json").json["scenes"]


def test_wrong_use_is_told_in_one_line(tmp_path: Path) -> None:
    out = tmp_path / "rec.cat240"
    assert "harbor" in call("simulate", "harbor", "-o", out).error
    assert "-o" in call("simulate", "harbour").error
    assert "-o" in call("simulate").error
    assert str(tmp_path / "no.toml") in call("simulate", tmp_path / "no.toml", "-o", out).error
    nowhere = tmp_path / "no" / "rec.cat240"
    assert str(nowhere) in call("simulate", "harbour", "-o", nowhere, "--scans", "1").error
    assert call("simulate", "harbour", "-o", out, "--scans", "0").code == 2
    assert call("simulate", "harbour", "-o", out, "--seed", "-1").code == 2
    assert not list(tmp_path.iterdir())


def test_several_radars_have_a_recording_each_that_process_reads_together(tmp_path: Path) -> None:
    from tests.unit.test_simulate_stations import WORLD

    (tmp_path / "reach.toml").write_text(WORLD, "utf-8")
    out = tmp_path / "rec.cat240"
    done = call("simulate", tmp_path / "reach.toml", "-o", out, "--scans", "4", "--no-labels", "--json").json
    names = [f"rec-{name}.cat240" for name in "abc"]
    assert [Path(path).name for path in done["recordings"]] == names
    beside = ("--sensors", done["sensors"], "--own-ship", done["ais"], "--truth", done["truth"])
    run = (
        "process",
        *done["recordings"],
        *beside,
        "-t",
        "pakf-jpda",
        "-o",
        tmp_path / "run",
        "--no-rrd",
        "--json",
        "-q",
    )
    assert call(*run).json["counts"]["scans"] >= 11
    assert call("replay", tmp_path / "run", "--verify", "-q").code == 0
    lost = call("process", done["recordings"][2], "--sensors", done["sensors"], "--no-rrd", "-o", tmp_path / "no")
    assert lost.code == 2 and "--own-ship" in lost.err
