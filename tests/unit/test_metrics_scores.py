"""Scores of frames and the sums over them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.testing import assert_allclose

from maritrack.metrics.scores import (
    KEYS,
    ScoreSums,
    add,
    hold,
    means,
    score_frame,
    summary_objects,
    truth_distances,
)
from maritrack.types import Tracks, Truth

EXACT = 1e-9
S = 1_000_000_000


def truth_at(*position_m: tuple[float, float], ids: str = "ABC", velocity: float = 0.0, t_ns: int = 0) -> Truth:
    n = len(position_m)
    unknown = np.full(n, np.nan)
    return Truth(
        id=tuple(ids[:n]), name=("",) * n, t_ns=t_ns, position_m=np.array(position_m, dtype=float).reshape(n, 2),
        velocity_mps=np.full((n, 2), velocity), heading_rad=unknown, length_m=unknown, width_m=unknown,
    )  # fmt: skip


def tracks_at(*position_m: tuple[float, float], ids: Sequence[int] = range(1, 9), t_ns: int = 0) -> Tracks:
    n = len(position_m)
    return Tracks(
        id=np.array(ids[:n], dtype=np.int64), t_ns=np.full(n, t_ns, dtype=np.int64),
        position_m=np.array(position_m, dtype=float).reshape(n, 2), velocity_mps=np.zeros((n, 2)),
        cov=np.zeros((n, 4, 4)), extent_m2=np.zeros((n, 2, 2)), existence=np.ones(n),
        status=np.ones(n, dtype=np.int64), moving=np.ones(n, dtype=bool), cluster=np.full(n, -1),
    )  # fmt: skip


def scores(truth: Truth | None, tracks: Tracks, unexplained: bool = False) -> dict[str, float]:
    which = np.ones(len(tracks), dtype=bool)
    return score_frame(truth, tracks, which=which, c_m=100.0, p=2.0, unexplained=unexplained)


def held(*frames: tuple[Truth, Tracks]) -> ScoreSums:
    sums = ScoreSums()
    for truth, tracks in frames:
        sums = hold(sums, truth, tracks, which=np.ones(len(tracks), dtype=bool), hold_m=10.0)
    return sums


def test_truth_is_moved_to_the_time_of_each_track() -> None:
    truth = truth_at((0.0, 0.0), velocity=10.0, t_ns=5 * S)
    assert_allclose(truth_distances(truth, tracks_at((20.0, 20.0), (20.0, 23.0), t_ns=7 * S)), [[0.0, 3.0]], atol=EXACT)


def test_truth_of_unknown_velocity_stays_where_it_is() -> None:
    truth = truth_at((0.0, 0.0), velocity=np.nan)
    assert_allclose(truth_distances(truth, tracks_at((3.0, 4.0), t_ns=7 * S)), [[5.0]])


def test_a_frame_scores_what_is_held_missed_and_false() -> None:
    ours = scores(truth_at((0.0, 0.0), (1000.0, 0.0)), tracks_at((30.0, 0.0)))
    assert list(ours) == list(KEYS)
    assert_allclose(ours["gospa"], math.sqrt(900.0 + 5000.0))
    assert_allclose(ours["ospa"], math.sqrt((900.0 + 10_000.0) / 2.0))
    assert [ours[k] for k in ("gospa_localisation", "gospa_missed", "gospa_false")] == [900.0, 1.0, 0.0]
    assert [ours[k] for k in ("n_truth", "n_tracks")] == [2.0, 1.0]


def test_without_truth_all_is_nan_but_the_number_of_tracks() -> None:
    ours = scores(None, tracks_at((0.0, 0.0)))
    assert [name for name, value in ours.items() if not math.isnan(value)] == ["n_tracks"]
    assert ours["n_tracks"] == 1.0


def test_only_chosen_tracks_and_covered_truth_count() -> None:
    truth, tracks = truth_at((0.0, 0.0), (1000.0, 0.0)), tracks_at((0.0, 0.0), (500.0, 0.0))
    ours = score_frame(truth, tracks, which=np.array([True, False]), c_m=100.0, p=2.0, covered=np.array([True, False]))
    assert ours["gospa"] == 0.0
    assert (ours["n_truth"], ours["n_tracks"]) == (1.0, 1.0)


def test_false_tracks_are_called_unexplained_where_truth_is_incomplete() -> None:
    for truth in (truth_at(), None):
        ours = scores(truth, tracks_at((0.0, 0.0)), unexplained=True)
        assert "gospa_false" not in ours
        assert list(ours) == [k.replace("gospa_false", "gospa_unexplained") for k in KEYS]
    assert scores(truth_at(), tracks_at((0.0, 0.0)), unexplained=True)["gospa_unexplained"] == 1.0


def test_means_leave_out_what_is_nan() -> None:
    sums = ScoreSums()
    for value in (1.0, math.nan, 3.0):
        sums = add(sums, {"gospa": value, "ospa": math.nan})
    assert means(sums)["gospa"] == 2.0
    assert math.isnan(means(sums)["ospa"])
    assert sums.count == {"gospa": 2, "ospa": 0}


def test_adding_a_frame_leaves_the_old_sums_alone() -> None:
    before = add(held((truth_at((0.0, 0.0)), tracks_at((0.0, 0.0)))), {"gospa": 1.0})
    copy = summary_objects(before), means(before)
    add(before, {"gospa": 5.0})
    hold(before, truth_at((0.0, 0.0)), tracks_at((0.0, 0.0)), which=np.ones(1, dtype=bool), hold_m=10.0)
    assert (summary_objects(before), means(before)) == copy


def test_a_frame_without_truth_holds_nothing() -> None:
    tracks = tracks_at((0.0, 0.0))
    assert hold(ScoreSums(), None, tracks, which=np.ones(1, dtype=bool), hold_m=10.0).objects == {}


def test_an_object_is_held_broken_and_switched() -> None:
    truth = truth_at((0.0, 0.0))
    near, far = [(3.0, 0.0)], [(50.0, 0.0)]
    frames = [(near, [7]), (near, [7]), (far, [7]), (near, [8]), (near, [7]), (near, [7])]
    (row,) = summary_objects(held(*((truth, tracks_at(*position, ids=ids)) for position, ids in frames)))
    assert row == {
        "id": "A", "name": "", "frames": 6, "held": 5, "assigned": 5, "held_share": 5 / 6, "held_by_one": 4 / 6,
        "ids": 2, "switches": 2, "breaks": 1, "rms_m": 3.0,
    }  # fmt: skip


def test_a_pair_stays_together_while_it_can() -> None:
    """A second track that comes nearer takes the object over only when the first is out of reach."""
    truth = truth_at((0.0, 0.0))
    frames = [((2.0, 0.0), (9.0, 0.0)), ((6.0, 0.0), (1.0, 0.0)), ((11.0, 0.0), (1.0, 0.0))]
    (row,) = summary_objects(held(*((truth, tracks_at(*positions)) for positions in frames)))
    assert (row["held"], row["switches"], row["held_by_one"]) == (3, 1, 1.0)


def test_as_many_objects_as_possible_are_held() -> None:
    truth = truth_at((0.0, 0.0), (9.0, 0.0))
    rows = summary_objects(held((truth, tracks_at((0.5, 0.0), (-9.0, 0.0)))))
    assert [row["held"] for row in rows] == [1, 1]


def test_an_object_that_leaves_and_returns_is_not_present_meanwhile() -> None:
    both, one = truth_at((0.0, 0.0), (100.0, 0.0)), truth_at((0.0, 0.0))
    tracks = tracks_at((0.0, 0.0), (100.0, 0.0))
    rows = summary_objects(held((both, tracks), (one, tracks), (both, tracks)))
    assert [(row["id"], row["frames"], row["held"], row["breaks"]) for row in rows] == [("A", 3, 3, 0), ("B", 2, 2, 0)]


def test_an_object_that_nobody_holds_has_no_error() -> None:
    (row,) = summary_objects(held((truth_at((0.0, 0.0)), tracks_at())))
    assert (row["held"], row["held_by_one"], row["ids"]) == (0, 0.0, 0)
    assert math.isnan(row["rms_m"])


def test_height_counts_where_truth_and_tracks_have_it() -> None:
    truth, tracks = truth_at((0.0, 0.0), t_ns=0), tracks_at((3.0, 0.0), t_ns=2 * S)
    high = replace(truth, up_m=np.array([10.0]), vel_up_mps=np.array([1.0]))
    assert_allclose(truth_distances(high, tracks), [[3.0]], atol=EXACT)
    above = replace(tracks, up_m=np.array([8.0]), vel_up_mps=np.zeros(1))
    assert_allclose(truth_distances(high, above), [[5.0]], atol=EXACT)
    assert_allclose(truth_distances(truth, above), [[3.0]], atol=EXACT)
