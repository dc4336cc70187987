"""Blobs: equal to those of scikit-image, the same wherever they are worked out, and bounded."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from maritrack.detect import hessian

SIGMAS = (2.0, 5.0, 8.0)


def lights(density: float, *, seed: int, edge: int = 30) -> NDArray[np.uint8]:
    """Blurred lights at random places off the upper and left edges."""
    rng = np.random.default_rng(seed)
    picture = gaussian_filter((rng.random((240, 280)) < density) * 1.0, 2.5)
    picture *= rng.uniform(0.8, 1.0, picture.shape)  # no two values alike: rounding is not to decide
    picture[:edge], picture[:, :edge] = 0, 0
    whole = np.rint(picture / picture.max() * 255).astype(np.uint8)
    whole[whole < 20] = 0
    return whole


@pytest.mark.parametrize("sigma", [1.0, 2.0, 3.0, 4.4, 7.0, 12.5])
def test_the_determinant_is_that_of_scikit_image(sigma: float) -> None:
    from skimage.feature import hessian_matrix_det

    picture = lights(0.01, seed=1)
    edge = int(3 * sigma) + 3
    ours = hessian.determinant(hessian._slices(hessian.integral(picture, edge), edge, picture.shape), sigma)
    assert_allclose(ours, hessian_matrix_det(picture / 255.0, sigma), atol=1e-12)


@pytest.mark.parametrize(("density", "overlap"), [(0.0003, 0.2), (0.0003, 0.5), (0.0003, 1.0), (0.003, 1.0)])
def test_blobs_are_those_of_scikit_image(density: float, overlap: float) -> None:
    """Of chains of overlapping blobs scikit-image keeps those that the order of a set of pairs leaves: dense pictures
    are compared before that."""
    from skimage.feature import blob_doh

    picture = lights(density, seed=2)
    ours = hessian.blobs(picture, SIGMAS, threshold=0.003, overlap=overlap)
    theirs = blob_doh(picture / 255.0, min_sigma=2, max_sigma=8, num_sigma=3, threshold=0.003, overlap=overlap)
    assert len(theirs) > 5
    assert set(zip(ours.row.tolist(), ours.column.tolist(), ours.sigma_px.tolist(), strict=True)) == {
        (int(row), int(column), float(sigma)) for row, column, sigma in theirs
    }


def test_blobs_do_not_depend_on_where_determinants_are_worked_out(monkeypatch: pytest.MonkeyPatch) -> None:
    picture = lights(0.0001, seed=3, edge=0)
    some = hessian.blobs(picture, SIGMAS, threshold=0.003, overlap=0.5)
    monkeypatch.setattr(hessian, "DENSE_SHARE", -1.0)
    everywhere = hessian.blobs(picture, SIGMAS, threshold=0.003, overlap=0.5)
    assert len(some) > 3
    for name in ("row", "column", "sigma_px", "value"):
        assert np.array_equal(getattr(some, name), getattr(everywhere, name))


def test_pixels_left_out_have_no_determinant_over_the_threshold() -> None:
    picture = lights(0.00005, seed=4, edge=0)
    for sigma in (2.0, 6.0):
        at = hessian.near(picture, np.flatnonzero(picture), sigma, 0.003)
        assert at is not None
        edge = int(3 * sigma) + 3
        value = hessian.determinant(hessian._slices(hessian.integral(picture, edge), edge, picture.shape), sigma)
        out = np.ones(picture.size, bool)
        out[at] = False
        assert out.sum() > picture.size / 2
        assert value.reshape(-1)[out].max() <= 0.003


@pytest.mark.parametrize("shape", [(1, 1), (3, 70), (41, 8)])
def test_any_picture_is_searched(shape: tuple[int, int]) -> None:
    for fill in (0, 255):
        found = hessian.blobs(np.full(shape, fill, np.uint8), SIGMAS, threshold=0.003, overlap=0.5)
        assert np.all(found.row < shape[0]) and np.all(found.column < shape[1])


def test_of_noise_all_over_the_strongest_blobs_are_left(monkeypatch: pytest.MonkeyPatch) -> None:
    picture = np.random.default_rng(0).integers(0, 256, (150, 200)).astype(np.uint8)
    every = hessian.blobs(picture, (2.0,), threshold=1e-6, overlap=1.0)
    assert 5000 > len(every) > 300
    monkeypatch.setattr(hessian, "MOST_PEAKS", 100)
    some = hessian.blobs(picture, (2.0,), threshold=1e-6, overlap=1.0)
    assert np.array_equal(some.value, every.value[: len(some)]) and len(some) > 90


def test_a_dark_picture_has_no_blob() -> None:
    assert len(hessian.blobs(np.zeros((50, 60), np.uint8), SIGMAS, threshold=0.003, overlap=0.5)) == 0


def test_a_disc_is_one_blob_at_its_centre_and_of_its_size() -> None:
    y, x = np.mgrid[:80, :80]
    picture = ((np.hypot(y - 40, x - 33) <= 7) * 255).astype(np.uint8)
    found = hessian.blobs(picture, (2.0, 3.0, 4.5, 6.5, 10.0), threshold=0.01, overlap=0.3)
    assert len(found) == 1
    assert abs(found.row[0] - 40) <= 1 and abs(found.column[0] - 33) <= 1
    assert found.sigma_px[0] in (6.5, 10.0)


def test_the_area_that_discs_share_is_that_of_counting() -> None:
    y, x = np.mgrid[-300:300, -300:600]
    for apart, r1, r2 in ((120.0, 100.0, 80.0), (30.0, 100.0, 80.0), (10.0, 100.0, 80.0), (190.0, 100.0, 80.0)):
        both = (np.hypot(y, x) <= r1) & (np.hypot(y, x - apart) <= r2)
        counted = both.sum() / (math.pi * min(r1, r2) ** 2)
        told = hessian.shared(np.array([apart]), np.array([r1]), np.array([r2]))[0]
        assert told == pytest.approx(min(counted, 1.0), abs=3e-3)
