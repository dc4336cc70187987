"""The scores of a scan whose tracks a joined run holds for surer than the segment did."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from maritrack.config import load_config
from maritrack.io.archive import Stored
from maritrack.io.messages import decode_scores, decode_tracks
from maritrack.metrics.scores import score_frame
from maritrack.sinks.mcap import encode_result
from maritrack.sweep.joining import _named
from maritrack.sweep.seams import Names
from maritrack.types import CONFIRMED, TENTATIVE, Result
from tests import runs


def a_scan() -> Result:
    """Of a tentative track where the truth is, and what else runs.result tells."""
    result = runs.result(1)
    truth = result.frame.truth
    assert truth is not None
    some = runs.tracks(0, np.random.default_rng(0), 1)
    tracks = replace(some, id=np.array([2]), status=np.array([TENTATIVE]), cluster=np.array([0]),
                     position_m=truth.position_m[:1])  # fmt: skip
    return replace(result, tracks=tracks, scores={"gospa": -1.0})


@pytest.mark.parametrize("held", [True, False])
def test_a_track_that_is_held_is_scored_as_one(held: bool) -> None:
    config = load_config(preset="radar")
    result = a_scan()
    parts = [Stored(topic, 1, 0, data, 0) for topic, data in encode_result(result)]
    names = Names({2: 7}, frozenset({7} if held else ()), top=6, shift=10)
    told = {part.topic: part.data for part in _named(parts, names, config)}
    tracks, scores = decode_tracks(told["/tracks"]), decode_scores(told["/scores"])
    assert tracks.id.tolist() == [7] and (tracks.status.tolist() == [CONFIRMED]) == held
    if not held:
        assert scores == {"gospa": -1.0}
        return
    rules = config.score
    expected = score_frame(
        result.frame.truth, tracks, which=np.ones(1, bool), c_m=rules.c_m, p=rules.p, unexplained=False,
        velocity=rules.velocity, bow_share=rules.bow_share,
    )  # fmt: skip
    assert scores["gospa"] == pytest.approx(expected["gospa"]) and scores["gospa"] > 0
