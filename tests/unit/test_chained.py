"""Groups that a gap parts against DBSCAN with one point a cluster, label by label."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from maritrack.cluster import chained
from maritrack.cluster.chained import groups
from maritrack.cluster.dbscan import dbscan


@settings(derandomize=True, deadline=None, max_examples=150)
@given(
    seed=st.integers(0, 10_000),
    n=st.integers(1, 250),
    wide_m=st.sampled_from([20.0, 60.0, 200.0, 800.0]),
    step_m=st.sampled_from([0.0, 7.0710678, 10.0]),  # 0 = anywhere; else a lattice, full of distances that are the gap
    gap_m=st.sampled_from([5.0, 10.0, 14.142135623730951, 20.0, 30.0]),
    away_m=st.sampled_from([0.0, -1e6]),
)
def test_groups_are_those_of_single_linkage(
    seed: int, n: int, wide_m: float, step_m: float, gap_m: float, away_m: float
) -> None:
    xy = np.random.default_rng(seed).uniform(-wide_m, wide_m, (n, 2))
    xy = away_m + (np.round(xy / step_m) * step_m if step_m else xy)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(chained, "CROWD", 1)
        assert_array_equal(groups(xy, gap_m), dbscan(xy, eps_m=gap_m, min_points=1))


def test_rings_within_each_other_are_two_groups_until_the_gap_bridges_them() -> None:
    """Whose outermost points are far apart, and whose points are not."""
    angle = np.linspace(0.0, 2.0 * np.pi, 3000, endpoint=False)
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    both = np.concatenate([500.0 * ring, 470.0 * ring])
    assert_array_equal(groups(both, 29.9), np.repeat([0, 1], 3000))
    assert groups(both, 30.1).max() == 0


def test_of_nothing_there_is_no_group_and_of_few_or_far_points_each_is_one() -> None:
    assert groups(np.zeros((0, 2)), 10.0).tolist() == []
    far = np.stack([np.arange(1500) * 1e5, np.zeros(1500)], axis=-1)
    assert groups(far, 1e-3).max() == 1499
