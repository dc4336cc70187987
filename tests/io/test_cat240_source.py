"""Frames from a recording: octets, damage, sensors, place."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from maritrack.errors import ConfigError, InputError
from maritrack.io import cat240_source
from maritrack.io.cat240.encode import encode_video
from maritrack.io.cat240.radials import Batch, Radials
from maritrack.io.cat240.reader import file_chunks
from maritrack.io.cat240_source import Cat240Source
from maritrack.io.pose import PoseTrack
from maritrack.io.source import Octets, Source
from maritrack.settings import InputConfig
from maritrack.types import Frame, Origin
from tests.io.spins import OCTETS, batches, octets, spin
from tests.shared import shared

DAY_NS = 86_400 * 1_000_000_000
CHANNEL = "/input/cat240"


def source(chunks: Iterable[bytes] = (), *, strict: bool = False, poses: Any = None, **config: Any) -> Cat240Source:
    pose, sensor_configs = config.pop("pose", None), config.pop("sensor_configs", None)
    return Cat240Source(
        Octets("rec.cat240", CHANNEL, chunks, b"", -1),
        InputConfig(**config),
        pose=pose,
        origin=Origin(50.0, -1.0),
        strict=strict,
        sensor_configs=sensor_configs,
        sensor_poses=poses,
    )


def frames_of(of: Radials, at: Sequence[int] = (), **config: Any) -> list[Frame]:
    return list(source(**config).frames_of(batches(of, at)))


def joined(frames: Iterable[Frame]) -> bytes:
    return b"".join(part for frame in frames for _, part in frame.inputs)


def encoded(of: Radials) -> list[bytes]:
    """The radials as data blocks."""
    names = ("sac", "sic", "idx", "start_az", "end_az", "start_rg", "cell_dur", "tod")
    headers: list[dict[str, Any]] = [{name: int(getattr(of, name)[i]) for name in names} for i in range(len(of))]
    return [encode_video(**header, cells=of.cells[i], bits=int(of.bits[i])) for i, header in enumerate(headers)]


def two_sensors() -> Radials:
    of = spin(6.0)
    of.sic[:] = 42 + np.arange(384) % 2
    of.start_az[:] = np.arange(384) // 2 * 1024 % 65_536
    of.start_az[1::2] = (of.start_az[1::2] + 20_000) % 65_536
    of.end_az[:] = (of.start_az + 1024) % 65_536
    of.idx[:] //= 2
    return of


def test_a_frame_has_the_octets_up_to_the_first_spoke_of_the_next_scan() -> None:
    frames = frames_of(spin(3.0), [10, 100, 101])
    assert [frame.inputs for frame in frames] == [((CHANNEL, octets(64 * k, 64 * k + 64)),) for k in range(3)]
    assert [frame.k for frame in frames] == [0, 1, 2]


@given(at=st.lists(st.integers(0, 384), max_size=12), turned=st.booleans(), tail=st.integers(0, 60))
@settings(derandomize=True, deadline=None, max_examples=40)
def test_the_octets_of_all_frames_are_the_input(at: list[int], turned: bool, tail: int) -> None:
    of = two_sensors() if turned else spin(6.0)
    of.start_az[384 - tail :] = of.start_az[383 - tail]
    whole, parts = frames_of(of), frames_of(of, at)
    assert joined(whole) == octets(0, 384)
    assert [(f.k, f.inputs, f.damage, f.t_ns, f.scan.sensor) for f in parts] == [
        (f.k, f.inputs, f.damage, f.t_ns, f.scan.sensor) for f in whole
    ]


def test_the_last_frame_carries_what_is_too_short_for_a_scan() -> None:
    frames = frames_of(spin(2.0 + 2 / 64))
    assert len(frames) == 2
    assert frames[-1].inputs == ((CHANNEL, octets(64, 130)),)
    assert [(d.code, d.count) for d in frames[-1].damage] == [("short-scan", 2)]


def test_a_frame_does_not_wait_for_the_end_of_the_next_turn() -> None:
    read = 0

    def one_by_one() -> Iterator[Batch]:
        nonlocal read
        for batch in batches(spin(3.0), range(192)):
            read = batch.end // OCTETS
            yield batch

    next(iter(source().frames_of(one_by_one())))
    assert 64 < read <= 64 + 6


def test_scans_of_two_sensors_come_in_the_order_in_which_they_end() -> None:
    frames = frames_of(two_sensors(), [50, 51, 300])
    assert [frame.scan.sensor.id for frame in frames] == ["7-42", "7-43"] * 3
    assert [frame.t_ns for frame in frames] == sorted(frame.t_ns for frame in frames)


def test_one_of_several_sensors_is_read_and_all_octets_are_kept() -> None:
    frames = frames_of(two_sensors(), sensor="7-43")
    assert [frame.scan.sensor.id for frame in frames] == ["7-43"] * 3
    assert joined(frames) == octets(0, 384)


def test_a_sensor_that_is_not_there_is_an_error_that_names_those_that_are() -> None:
    with pytest.raises(InputError, match=r"rec\.cat240: no sensor '9-9'") as caught:
        frames_of(two_sensors(), sensor="9-9")
    assert caught.value.hint == "sensors in it: 7-42, 7-43"


def test_without_a_scan_there_is_no_frame_and_damage_stays_with_the_source() -> None:
    reading = source()
    assert list(reading.frames_of(batches(spin(2 / 64)))) == []
    assert [damage.code for damage in reading.unclaimed] == ["short-scan"]
    assert list(source().frames()) == []


def test_octets_without_end_and_without_a_scan_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cat240_source, "MAX_WAITING", 2000)
    of = spin(2.0)
    of.start_az[:] = 5
    with pytest.raises(InputError, match="no scan within"):
        frames_of(of, range(128))


def test_lost_records_are_fatal_only_where_strict() -> None:
    of = spin(2.0)
    of.idx[30:] += 4
    assert [(d.code, d.count) for frame in frames_of(of) for d in frame.damage] == [("lost-records", 4)]
    with pytest.raises(InputError, match="at byte 1500: lost-records"):
        frames_of(of, strict=True)


def test_times_begin_at_the_day_of_the_recording() -> None:
    (plain,), (dated,) = frames_of(spin(1.0)), frames_of(spin(1.0), date="2016-01-12")
    assert dated.t_ns - plain.t_ns == 16_812 * DAY_NS


def test_a_sensor_may_have_a_place_and_settings_of_its_own() -> None:
    turned = {"7-43": InputConfig(azimuth_offset_deg=90.0)}
    first, second, *_ = frames_of(
        two_sensors(),
        sensor_configs=turned,
        poses={"7-43": PoseTrack.fixed((5.0, 6.0))},
        pose=PoseTrack.fixed((1.0, 2.0)),
    )
    assert_allclose([first.scan.position_m, second.scan.position_m], [[1, 2], [5, 6]])
    assert first.scan.video is not None
    assert second.scan.video is not None
    shift = np.rad2deg(second.scan.video.azimuth_rad[0] - first.scan.video.azimuth_rad[0])
    assert shift == pytest.approx(90.0 + 20_000 * 360 / 65_536)


def test_head_up_video_needs_a_heading() -> None:
    with pytest.raises(ConfigError, match="heading"):
        source(stabilised="head")
    with pytest.raises(ConfigError, match="heading"):
        source(stabilised="head", pose=PoseTrack.fixed())
    with pytest.raises(ConfigError, match="sensor 7-42"):
        source(sensor_configs={"7-42": InputConfig(stabilised="head")})
    assert len(frames_of(spin(1.0), stabilised="head", pose=PoseTrack.fixed(heading_rad=1.0))) == 1


@pytest.mark.parametrize("size", [1, 7, 1000, 10**6])
def test_a_file_read_in_pieces_of_any_size_gives_the_same_frames(size: int) -> None:
    blocks = encoded(spin(2.5, begin=300))
    data = b"\x00junk" + b"".join(blocks) + b"\xf0\x00"
    frames = list(source([data[i : i + size] for i in range(0, len(data), size)]).frames())
    assert joined(frames) == data
    assert [frame.scan.n_spokes for frame in frames] == [64, 64, 32]
    assert len(frames[0].inputs[0][1]) == 5 + sum(map(len, blocks[:64]))
    for frame in frames:
        assert frame.scan.video is not None
        numbers = frame.scan.video.intensity[:, 0].astype(int) - 1
        assert_array_equal(numbers, 64 * frame.k + np.arange(len(numbers)))
    assert all(damage.offset in (0, len(data) - 2) for frame in frames for damage in frame.damage)
    assert sum(len(frame.damage) for frame in frames) >= 2


def test_the_turns_of_a_real_recording_take_two_and_a_half_seconds() -> None:
    path = shared("data/marce_solent/run_01_005/solent_01_005.cat240")
    data = path.read_bytes()
    seen, at, end_ns = [], 0, 0
    for frame in source(file_chunks(path, size=1 << 20), date="2016-01-12").frames():
        for _, part in frame.inputs:
            assert data[at : at + len(part)] == part
            at += len(part)
        assert frame.scan.t_start_ns >= end_ns
        end_ns = frame.scan.t_ns
        seen.append((frame.scan.n_spokes, (frame.scan.t_ns - frame.scan.t_start_ns) * 1e-9))
        assert {damage.code for damage in frame.damage} <= {"repeated-spoke"}
    assert at == len(data)
    spokes, took_s = np.array(seen[:-1]).T
    assert len(seen) == 243
    assert (spokes.min() >= 700, spokes.max() <= 722, np.median(spokes)) == (True, True, 720)
    assert_allclose(took_s, 2.5, atol=0.06)


def test_damage_without_end_is_summed_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cat240_source, "MAX_TOLD", 10)
    of = spin(3.0)
    of.tod[:100] = np.arange(100) * 128 * 60  # a silence before every spoke
    first, *_ = frames_of(of)
    assert len(first.damage) <= 30
    told = sum(damage.count for damage in first.damage if damage.code == "gap")
    assert told == 98  # spokes 2 to 99; the time of the first fits no neighbour and is passed over


def test_it_is_a_source() -> None:
    reading: Source = source()
    assert (reading.kind, reading.origin) == ("cat240", Origin(50.0, -1.0))
