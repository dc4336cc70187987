"""Presets and the loader of configurations: what is read is what is written, and what is wrong has a name."""

from __future__ import annotations

import math
import tomllib
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from maritrack import papers
from maritrack.chain import build_chain
from maritrack.config import config_from_toml, load_config, parse_set, preset_names, preset_table, to_toml
from maritrack.errors import ConfigError
from maritrack.recording import PRESET_OF_KIND
from maritrack.settings import Config, InputConfig  # fmt: skip
from tests.shared import ROOT

PRESETS = ROOT / "maritrack" / "presets"


def same(a: Any, b: Any) -> bool:
    """Equal settings; nan is nan."""
    if is_dataclass(a):
        return type(a) is type(b) and all(same(getattr(a, f.name), getattr(b, f.name)) for f in fields(a))
    return a == b or (isinstance(a, float) and isinstance(b, float) and math.isnan(a) and math.isnan(b))


@pytest.mark.parametrize("name", preset_names())
def test_each_preset_loads_builds_a_chain_and_survives_its_own_text(name: str) -> None:
    config = load_config(preset=name)
    assert config.preset == name
    build_chain(config)
    assert same(config_from_toml(to_toml(config)), config)
    assert to_toml(config_from_toml(to_toml(config))) == to_toml(config)


@pytest.mark.parametrize("name", preset_names())
def test_each_preset_says_in_its_first_line_what_it_is_for(name: str) -> None:
    assert (PRESETS / f"{name}.toml").read_text("utf-8").startswith("# ")


def test_each_kind_of_input_has_its_preset() -> None:
    assert set(PRESET_OF_KIND.values()) <= set(preset_names())


def _at(table: dict[str, Any], key: str) -> Any:
    for part in key.split("."):
        table = table.get(part, {}) if isinstance(table, dict) else {}
    return table


def test_every_line_that_says_assumed_is_listed_with_a_key_that_is_there() -> None:
    listed = papers.assumed()
    lines = [line for path in PRESETS.glob("*.toml") for line in path.read_text("utf-8").splitlines()]
    assert len(listed) == sum("# assumed" in line for line in lines)
    for row in listed:
        value = _at(preset_table(row.preset), row.key)
        assert same(value, tomllib.loads(f"v = {row.value}")["v"]), row


@pytest.mark.parametrize(
    ("assignment", "told"),
    [
        ("model.p_detct=0.9", "unknown key 'model.p_detct', did you mean 'p_detect'?"),
        ("modl.p_detect=0.9", "unknown key 'modl', did you mean 'model'?"),
        ("model=3", "'model' is a table"),
        ("model.p_detect=high", "'model.p_detect' = 'high' is not of type float"),
        ("model.p_detect=true", "'model.p_detect' = True is not of type float"),
        ("tracker.confirm_hits=2.5", "is not of type int"),
        ("detect.method=tresh", "one of threshold, ca-cfar, os-cfar"),
        ("model.p_detect=1.5", "not within 0..1"),
        ("model.p_detect", "KEY=VALUE"),
        ("=3", "KEY=VALUE"),
    ],
)
def test_a_wrong_setting_is_named_with_what_would_be_right(assignment: str, told: str) -> None:
    with pytest.raises(ConfigError) as caught:
        load_config(preset="radar", sets=[assignment])
    assert told in str(caught.value)


def test_an_unknown_preset_names_the_nearest() -> None:
    with pytest.raises(ConfigError, match="did you mean 'points'") as caught:
        load_config(preset="point")
    assert "radar" in caught.value.hint


def test_later_wins_default_preset_file_set_option(tmp_path: Path) -> None:
    default, preset = Config().tracker.birth_existence, load_config(preset="radar").tracker.birth_existence
    file = tmp_path / "my.toml"
    file.write_text("seed = 1\n[tracker]\nbirth_existence = 0.31\n")
    steps: list[dict[str, Any]] = [{"file": file}]
    steps.append(steps[-1] | {"sets": ["tracker.birth_existence=0.32"]})
    steps.append(steps[-1] | {"over": {"tracker": {"birth_existence": 0.33}}})
    got = [load_config(preset="radar", **step).tracker.birth_existence for step in steps]
    assert len({default, preset, *got}) == 5
    assert got == [0.31, 0.32, 0.33]
    assert load_config(preset="radar", file=file, sets=["seed=2"], over={"seed": 3}).seed == 3


def test_the_last_of_equal_settings_counts() -> None:
    assert load_config(preset="radar", sets=["seed=1", "seed=2"]).seed == 2


def test_a_preset_below_a_file_loses_to_the_file(tmp_path: Path) -> None:
    file = tmp_path / "my.toml"
    file.write_text('extends = "points"\n[model]\np_detect = 0.123\n')
    config = load_config(preset="", file=file)
    assert config.model.p_detect == 0.123 and config.model.extent == "point"


def test_whole_numbers_stand_for_floats_and_words_for_text() -> None:
    assert load_config(preset="", sets=["input.latency_s=2"]).input.latency_s == 2.0
    assert load_config(preset="", sets=["input.sensor=7-42"]).input.sensor == "7-42"
    assert parse_set("input.date='2017-11-02'") == {"input": {"date": "2017-11-02"}}


@settings(derandomize=True, deadline=None)
@given(
    st.text(), st.text(), st.integers(-(2**63), 2**63 - 1), st.floats(), st.floats(-90, 90) | st.just(math.nan),
    st.booleans(),
)  # fmt: skip
def test_any_settings_survive_their_own_text(
    sensor: str, ship: str, seed: int, extent: float, lat: float, moving: bool
) -> None:
    base = Config()
    inputs = replace(InputConfig(), sensor=sensor, own_ship=ship, lat_deg=lat)
    cluster, score = replace(base.cluster, max_extent_m=extent), replace(base.score, moving_only=moving)
    config = replace(base, seed=seed, input=inputs, cluster=cluster, score=score)
    assert same(config_from_toml(to_toml(config)), config)


def test_a_damaged_text_is_an_error_of_configuration() -> None:
    with pytest.raises(ConfigError):
        config_from_toml(to_toml(Config()).replace("[model]", "[modell]"))
    with pytest.raises(ConfigError):
        config_from_toml("[model")


def test_the_presets_of_the_polar_paper_hold_its_numbers_for_every_tracker() -> None:
    near, far = load_config(preset="polar-near"), load_config(preset="polar-far")
    for config in (near, far):
        model = config.model
        assert (model.p_detect, model.clutter, model.clutter_density_per_m2) == (0.8, "fixed", 1e-4)
        assert (model.shape, model.shape_n_max, model.cluster_size, model.centroid_n_max) == ("plugin", 0, "count", 0)
        assert (config.cluster.eps_m, config.cluster.min_points, config.cluster.intensity_weighting) == (55.0, 3, True)
        assert (config.sprt.p_false_alarm, config.phd.p_survive_scan, config.tracker.birth_existence) == (
            0.01,
            0.95,
            0.6,
        )
    assert (near.input.roi_max_m, far.input.roi_min_m, far.input.roi_max_m) == (5000.0, 20_000.0, 30_000.0)
