"""`maritrack config`: names, the resolved text, and files that are wrong."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.cli.calling import call, spawn


def test_presets_trackers_and_scenes_are_listed() -> None:
    listed = spawn("config", "list", "--json").json
    assert listed["presets"]["radar"] and listed["trackers"]["jipda"] and listed["scenes"]["harbour"]
    assert "radar" in call("config", "list").out


def test_what_is_shown_can_be_given_back(tmp_path: Path) -> None:
    shown = call("config", "show", "radar", "--set", "model.p_detect=0.5", "-t", "jipda", "--seed", "7").out
    assert "p_detect = 0.5" in shown and "seed = 7" in shown
    file = tmp_path / "my.toml"
    file.write_text(shown)
    assert call("config", "check", file).out == f"{file}: ok\n"
    again = call("config", "show", "--config", file).out
    assert again.splitlines()[1:] == shown.splitlines()[1:]  # the first line names the preset


def test_a_file_may_extend_a_preset(tmp_path: Path) -> None:
    file = tmp_path / "my.toml"
    file.write_text('extends = "points"\n[model]\np_detect = 0.4\n')
    shown = call("config", "show", "--config", file).out
    assert "p_detect = 0.4" in shown and 'extent = "point"' in shown


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("[model]\np_detct = 0.4\n", "did you mean 'p_detect'"),
        ("[model]\np_detect = 4\n", "within 0..1"),
        ("[model]\np_detect = 'much'\n", "model.p_detect"),
        ("tracker_name = 'nonsense'\n", "nonsense"),
        ("extends = 'nonsense'\n", "nonsense"),
        ("[model\n", "line 1"),
        ("\0", "line 1"),
        ("extends = 3\n", "'extends' = 3"),
        (f"a = {'[' * 5000}", "nests too deeply"),
        (f"[model]\np_detect{'.a' * 5000} = 1\n", "'model.p_detect' = {'a': {"),
        (f"[model]\np_detect = 1{'0' * 400}\n", "is too large a number"),
        (f"seed = 1{'0' * 5000}\n", "a number of too many digits"),
        ("[subtract]\nhalf_life_scans = 0.0001\n", "subtract.half_life_scans = 0.0001: at least 0.1"),
        ("[input]\nsigma_m = nan\n", "input.sigma_m = nan"),
        ("[score]\ntruth_lag_s = 'a=nan'\n", "score.truth_lag_s: 'a=nan'"),
    ],
)
def test_a_wrong_file_is_told_in_one_line_with_its_name(tmp_path: Path, text: str, told: str) -> None:
    file = tmp_path / "my.toml"
    file.write_text(text)
    done = call("config", "check", file)
    assert done.code == 2 and str(file) in done.error and told in done.error


def test_wrong_names_are_told_in_one_line(tmp_path: Path) -> None:
    assert "did you mean 'radar'" in call("config", "show", "rador").error
    assert str(tmp_path / "no.toml") in call("config", "check", tmp_path / "no.toml").error
    assert str(tmp_path) in call("config", "check", tmp_path).error
