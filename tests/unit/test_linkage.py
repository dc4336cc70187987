"""Linkages cut at a distance: the partition of SciPy's, and what each of them promises."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.cluster.hierarchy import fcluster, fclusterdata, linkage
from scipy.spatial.distance import pdist

from maritrack.cluster import linkage as ours
from maritrack.cluster.linkage import linkage_labels
from maritrack.metrics import adjusted_rand_index
from maritrack.types import FloatArray


def places(n: int, seed: int) -> FloatArray:
    return np.random.default_rng(seed).uniform(-25.0, 25.0, (n, 2))


@given(st.integers(2, 60), st.integers(0, 999))
@settings(derandomize=True, deadline=None, max_examples=60)
def test_partitions_are_those_of_scipy(n: int, seed: int) -> None:
    z = places(n, seed)
    single = linkage_labels(z, distance_m=5.0, how="single-linkage")
    assert adjusted_rand_index(single, fclusterdata(z, 5.0, criterion="distance")) == 1.0
    complete = linkage_labels(z, distance_m=5.0, how="complete-linkage")
    assert adjusted_rand_index(complete, fcluster(linkage(z, "complete"), 5.0, "distance")) == 1.0
    for label in (single, complete):
        assert sorted(set(label.tolist())) == list(range(label.max() + 1))


def test_a_chain_is_one_cluster_or_parts_that_are_no_longer_than_the_distance() -> None:
    chain = np.stack([np.arange(30.0), np.zeros(30)], axis=1)
    assert linkage_labels(chain, distance_m=5.0, how="single-linkage").max() == 0
    parts = linkage_labels(chain, distance_m=5.0, how="complete-linkage")
    assert parts.max() >= 4 and all(np.ptp(chain[parts == k, 0]) <= 5.0 for k in range(parts.max() + 1))


def test_a_crowd_is_cut_into_squares_that_keep_the_promise(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ours, "MAX_WHOLE", 50)
    z = places(400, 3)
    label = linkage_labels(z, distance_m=5.0, how="complete-linkage")
    assert max(pdist(z[label == k]).max(initial=0.0) for k in range(label.max() + 1)) <= 5.0


@pytest.mark.parametrize("how", ["single-linkage", "complete-linkage"])
def test_no_point_and_one_point(how: ours.Linkage) -> None:
    assert linkage_labels(np.zeros((0, 2)), distance_m=5.0, how=how).tolist() == []
    assert linkage_labels(np.ones((1, 2)), distance_m=5.0, how=how).tolist() == [0]
