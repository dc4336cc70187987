"""Several recordings as one, and settings of several sensors."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from maritrack.errors import ConfigError, UsageError
from maritrack.io.fuse import in_steps, merge_sources
from maritrack.io.sensors import for_input, load_sensors, parse_sensors
from maritrack.settings import InputConfig
from maritrack.types import Frame, Origin, Scan, Sensor


@dataclass
class Recorded:
    """A source of frames at these times; `read` is how many it gave."""

    name: str
    times: list[int]
    origin: Origin | None = None
    kind: str = "cat240"
    read: int = 0

    def frames(self) -> Iterator[Frame]:
        for k, t_ns in enumerate(self.times):
            self.read += 1
            yield Frame(k, Scan(Sensor(self.name, 0.0, 0.0, math.inf), t_ns, t_ns, np.zeros(2), math.nan))


@pytest.mark.eq("abs-1")
@given(st.lists(st.lists(st.integers(0, 50), max_size=9).map(sorted), min_size=1, max_size=4))
@settings(derandomize=True, deadline=None, max_examples=60)
def test_frames_come_in_order_of_time_and_none_is_lost(times: list[list[int]]) -> None:
    frames = list(merge_sources([Recorded(str(i), t) for i, t in enumerate(times)]).frames())
    expected = sorted((t, str(i)) for i, one in enumerate(times) for t in one)
    assert [(frame.t_ns, frame.scan.sensor.id) for frame in frames] == expected
    assert [frame.k for frame in frames] == list(range(len(expected)))


def test_no_more_than_one_frame_is_read_ahead() -> None:
    sources = [Recorded("a", list(range(100))), Recorded("b", list(range(100)))]
    frames = merge_sources(sources).frames()
    for _ in range(10):
        next(frames)
    assert sum(source.read for source in sources) <= 12


def test_merged_sources_have_one_origin_and_all_kinds() -> None:
    here, there = Origin(50.0, -1.0), Origin(51.0, -1.0)
    merged = merge_sources([Recorded("a", []), Recorded("b", [], here), Recorded("c", [], kind="points")])
    assert (merged.origin, merged.kind) == (here, "cat240+points")
    with pytest.raises(UsageError, match="origins"):
        merge_sources([Recorded("a", [], here), Recorded("b", [], there)])
    with pytest.raises(UsageError):
        merge_sources([])


BASE = InputConfig(date="2016-01-12", azimuth_offset_deg=1.0)


def test_a_sensor_has_its_own_settings_over_those_of_the_run(tmp_path: Path) -> None:
    file = tmp_path / "sensors.toml"
    file.write_text('[sensors."7-42"]\nlat_deg = 50\nazimuth_offset_deg = -3.5\n[sensors.quay]\nstabilised = "head"\n')
    sensors = load_sensors(file, base=BASE)
    assert sensors["7-42"] == replace(sensors["7-42"], lat_deg=50.0, azimuth_offset_deg=-3.5, date="2016-01-12")
    assert list(sensors) == ["7-42", "quay"]
    assert for_input(sensors, "quay", base=BASE).stabilised == "head"
    assert for_input(sensors, "elsewhere", base=BASE) is BASE


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('[sensors."7-42"]\nlat_degg = 1.0', "lat_deg"),
        ('[sensors."7-42"]\nlat_deg = "x"', "sensors.7-42.lat_deg"),
        ('[sensors."7-42"]\nlat_deg = 91', "91"),
        ('[sensor."7-42"]\nlat_deg = 1', "unknown key 'sensor'"),
        ("sensors = 3", "no table"),
        ("[sensors]\nquay = 3", "no table"),
        ("", "no table"),
        ("[sensors", "s.toml"),
    ],
)
def test_what_is_not_understood_is_refused_by_name(text: str, says: str) -> None:
    with pytest.raises(ConfigError) as caught:
        parse_sensors(text, name="s.toml", base=BASE)
    assert "s.toml" in str(caught.value)
    assert says in str(caught.value)


def test_a_file_that_is_not_there_is_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"none\.toml"):
        load_sensors(tmp_path / "none.toml", base=BASE)


def test_scans_of_a_step_are_of_one_instant_and_steps_of_zero_change_nothing() -> None:
    times = [100, 130, 200, 201, 340]
    frames = [
        Frame(k, Scan(Sensor("a", 0.0, 0.0, math.inf), t, t - 50, np.zeros(2), math.nan)) for k, t in enumerate(times)
    ]
    assert list(in_steps(iter(frames), 0.0)) == frames
    moved = [frame.scan for frame in in_steps(iter(frames), 100e-9)]
    assert [scan.t_ns for scan in moved] == [100, 200, 200, 300, 400]
    assert all(scan.t_start_ns == scan.t_ns for scan in moved)
