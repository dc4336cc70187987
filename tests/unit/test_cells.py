"""Video to points: thresholds, CFAR against its definition, geometry of cells."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from maritrack.detect.cells import amplitude_threshold, cfar, detect_cells
from maritrack.settings import DetectConfig
from maritrack.types import Scan, Sensor, Video


def scan_of(intensity: np.ndarray, *, bits: int = 8, cell_m: float = 10.0) -> Scan:
    a = len(intensity)
    azimuth = (np.arange(a) + 0.5) * 2 * np.pi / max(a, 1)
    video = Video(
        azimuth_rad=azimuth, width_rad=np.full(a, 2 * np.pi / max(a, 1)), t_ns=np.arange(a) * 10**6,
        first_range_m=5.0, cell_m=cell_m, intensity=intensity, cells_used=np.full(a, intensity.shape[1]),
    )  # fmt: skip
    sensor = Sensor("1-2", cell_m, 2 * np.pi / max(a, 1), cell_m * intensity.shape[1], bits)
    return Scan(sensor, a * 10**6, 0, np.array([100.0, -50.0]), np.nan, video=video)


def test_points_are_the_cells_at_or_over_the_threshold_at_their_centres() -> None:
    intensity = np.zeros((4, 6), np.uint8)
    intensity[1, 2], intensity[3, 5], intensity[0, 0] = 200, 128, 127
    points = detect_cells(scan_of(intensity), DetectConfig(threshold=128 / 255))
    assert_allclose(points.range_m, [25.0, 55.0])
    assert_allclose(points.azimuth_rad, [3 * np.pi / 4, 7 * np.pi / 4])
    east_north = [100 + 25 * np.sin(3 * np.pi / 4), -50 + 25 * np.cos(3 * np.pi / 4)]
    assert_allclose(points.position_m[0], east_north)
    assert points.t_ns.tolist() == [10**6, 3 * 10**6]
    assert points.intensity.tolist() == [200, 128]


def test_a_receiver_that_limits_hard_gets_full_scale_as_threshold() -> None:
    soft = np.array([[0, 20, 100, 180, 255]], np.uint8)
    hard = np.array([[0, 0, 255, 255, 30]], np.uint8)
    assert amplitude_threshold(soft, 0.0, 255.0) == 128
    assert amplitude_threshold(hard, 0.0, 255.0) == 250
    one_bit = np.array([[0, 0, 1, 0, 1]], np.uint8)
    assert amplitude_threshold(one_bit, 0.0, 1.0) == 1
    assert amplitude_threshold(2 * one_bit, 0.0, 3.0) == 2
    assert amplitude_threshold(hard, 0.2, 255.0) == pytest.approx(51)


def test_the_strongest_points_stay_where_there_are_too_many() -> None:
    intensity = np.arange(240, dtype=np.uint8).reshape(8, 30)
    points = detect_cells(scan_of(intensity), DetectConfig(threshold=0.1, max_points=5))
    assert points.intensity.tolist() == [235, 236, 237, 238, 239]


@settings(derandomize=True, deadline=None, max_examples=25)
@given(st.integers(0, 10_000), st.sampled_from(["ca-cfar", "os-cfar"]), st.integers(1, 6), st.integers(0, 3))
def test_cfar_equals_its_definition(seed: int, method: str, window: int, guard: int) -> None:
    config = DetectConfig(method=method, cfar_window=window, cfar_guard=guard, cfar_scale=1.5, os_rank=0.6)  # type: ignore[arg-type]
    intensity = np.random.default_rng(seed).integers(0, 60, (3, 25)).astype(np.uint8)
    expected = np.zeros(intensity.shape, bool)
    for a in range(3):
        for i in range(25):
            at = [j for j in range(25) if guard < abs(j - i) <= guard + window]
            values = np.sort(intensity[a, at].astype(float))
            if method == "ca-cfar":
                level = values.mean() if len(values) else 0.0
            else:
                level = values[max(int(np.ceil(0.6 * len(values))) - 1, 0)] if len(values) else 0.0
            expected[a, i] = intensity[a, i] > 1.5 * level and intensity[a, i] >= 3
    assert (cfar(intensity, config, 3.0) == expected).all()


@pytest.mark.parametrize(("dtype", "bits"), [(np.uint8, 1), (np.uint8, 4), (np.uint16, 16), (np.uint32, 32)])
def test_every_resolution_is_detected_at_half_of_its_full_scale(dtype: type, bits: int) -> None:
    intensity = np.zeros((2, 8), dtype)
    intensity[0, 1:5] = 1
    intensity[1, 3] = 2**bits - 1
    intensity[1, 5] = 2 ** (bits - 1) if bits > 1 else 1
    found = detect_cells(scan_of(intensity, bits=bits), DetectConfig(threshold=0.5))
    assert len(found) == (2 if bits > 1 else 6)


def test_no_spoke_gives_no_point() -> None:
    assert len(detect_cells(scan_of(np.zeros((0, 4), np.uint8)), DetectConfig())) == 0


@pytest.mark.parametrize("method", ["ca-cfar", "os-cfar"])
def test_cfar_of_a_padded_spoke_is_that_of_the_spoke(method: str) -> None:
    config = DetectConfig(method=method, cfar_window=6, cfar_guard=2, cfar_scale=1.2)  # type: ignore[arg-type]
    intensity = np.random.default_rng(3).integers(20, 60, (4, 30)).astype(np.uint8)
    padded = np.zeros((4, 60), np.uint8)
    padded[:, :30] = intensity
    found = cfar(padded, config, 3.0, cells_used=np.full(4, 30))
    assert (found[:, :30] == cfar(intensity, config, 3.0)).all() and not found[:, 30:].any()
