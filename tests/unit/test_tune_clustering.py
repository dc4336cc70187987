"""The study of clustering: the same labels as the stage, the same numbers for any number of workers."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from maritrack.chain import detect
from maritrack.cluster.stage import labels
from maritrack.config import load_config
from maritrack.errors import InputError, UsageError
from maritrack.metrics.clusters import Noise, adjusted_rand_index, count_difference
from maritrack.recording import open_inputs, open_recording
from maritrack.tune.clustering import (
    Study,
    agreement,
    at_edge,
    choose,
    document,
    mean,
    rows,
    study,
)
from maritrack.tune.subjects import DOMAINS, Subject, labelled_scans
from maritrack.tune.subjects import subject as subject_of
from tests.shared import ROOT

SAMPLE = ROOT / "data" / "samples" / "harbour.cat240"
EPS, LEAST = (20.0, 40.0, 90.0), (1, 3, 6)
MARGINS = {"margin_m": 20.0, "radius_m": 50.0}
CONFIG = load_config(preset="radar", sets=["input.limit=2", "input.beam_width_deg=1.0"])


@pytest.fixture(scope="module")
def sample() -> Subject:
    return subject_of(SAMPLE, truth=None)


@pytest.mark.parametrize("noise", ["single", "class"])
def test_each_pair_is_judged_as_the_stage_clusters(sample: Subject, noise: Noise) -> None:
    scans = list(labelled_scans(sample, CONFIG, **MARGINS)[0])
    frames = open_recording(open_inputs([SAMPLE]), ["cat240"], {}, CONFIG).frames
    for scan, frame in zip(scans, frames, strict=True):
        found, points = agreement(scan, eps_m=EPS, min_points=LEAST, noise=noise), detect(frame.scan, CONFIG)
        for d, domain in enumerate(DOMAINS):
            for e, eps_m in enumerate(EPS):
                for k, least in enumerate(LEAST):
                    cluster = replace(CONFIG.cluster, method=domain, eps_m=eps_m, eps_cells=0.0, min_points=least)
                    label = labels(points, frame.scan, cluster)
                    ari = adjusted_rand_index(scan.truth, label, noise=noise)
                    count = count_difference(scan.truth, label)
                    assert found[:, d, e, k].tolist() == [ari, abs(count), count]


def test_the_answer_is_the_same_for_any_number_of_workers(sample: Subject) -> None:
    one, two = (
        study(sample, CONFIG, eps_m=EPS, min_points=LEAST, noise="single", workers=workers, **MARGINS)
        for workers in (1, 2)
    )
    assert rows(one) == rows(two) and one.scans == 2


def of(ari: list[list[float]], difference: list[list[float]]) -> Study:
    both = [np.array([v, v]) for v in (ari, difference, difference)]
    return Study((20.0, 40.0), (1, 2, 3), *both, 5, 1, {"object": 9}, "by hand")


def test_the_choice_is_the_smallest_count_difference_near_the_best_index() -> None:
    assert choose(of([[0.5, 0.9, 0.895], [0.8, 0.2, 0.1]], [[0.0, 4.0, 1.0], [0.0, 0.0, 0.0]]), 0) == (0, 2)
    assert choose(of([[0.9, 0.9, 0.9], [0.905, 0.9, 0.9]], [[1.0] * 3] * 2), 0) == (1, 0)  # then the index
    assert choose(of([[0.9] * 3] * 2, [[1.0] * 3] * 2), 0) == (0, 0)  # then eps and min_points
    assert [row["chosen"] for row in rows(of([[0.9] * 3] * 2, [[1.0] * 3] * 2))].count(True) == 2


def test_recordings_weigh_the_same() -> None:
    a, b = of([[0.0] * 3] * 2, [[2.0] * 3] * 2), of([[1.0] * 3] * 2, [[0.0] * 3] * 2)
    together = mean([a, b])
    assert np.all(together.ari == 0.5) and np.all(together.count_difference == 1.0)
    assert (together.scans, together.points["object"]) == (10, 18)


def test_what_has_no_truth_or_nothing_to_cluster_is_told(tmp_path: Path, sample: Subject) -> None:
    with pytest.raises(UsageError, match="no labelled cells and no truth"):
        labelled_scans(replace(sample, truth=None), CONFIG, **MARGINS)
    ferry = ROOT / "data" / "samples" / "autoferry13_detections.json"
    with pytest.raises(UsageError, match="nothing to cluster"):
        labelled_scans(subject_of(ferry, truth=None), CONFIG, **MARGINS)
    far = load_config(preset="radar", sets=["input.limit=1", "input.roi_max_m=1.0"])
    with pytest.raises(InputError, match="no point of an object in 1 scans"):
        study(sample, far, eps_m=EPS, min_points=LEAST, noise="single", **MARGINS)


def test_a_choice_at_the_edge_of_the_grid_is_noticed() -> None:
    middle = Study((20.0, 40.0, 60.0), (1, 2), *[np.zeros((2, 3, 2))] * 3, 5, 1, {"object": 9}, "by hand")
    middle.ari[0, 1, 0], middle.ari[1, 2, 0] = 1.0, 1.0
    assert at_edge(document(middle, recordings=["a"], noise="single")) == ["cartesian-dbscan"]
