"""The sample run against what it gave when it was last looked at; a change of numbers is a change of this file."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from maritrack.config import load_config
from maritrack.diff import diff
from maritrack.job import Job, execute
from maritrack.manifest import file_digest
from maritrack.recording import default_preset, kinds_of, open_inputs, side_documents
from tests.shared import ROOT

GOLDEN = ROOT / "data" / "golden"
SAMPLES = ROOT / "data" / "samples"


@pytest.mark.parametrize(
    ("sample", "golden"),
    [("harbour.cat240", "harbour-jipda.json"), ("autoferry13_detections.json", "autoferry13-jipda.json")],
)
def test_the_sample_gives_the_numbers_it_gave(sample: str, golden: str, tmp_path: Path) -> None:
    path = SAMPLES / sample
    octets = open_inputs([path])
    kinds = kinds_of(octets)
    job = Job(
        octets=octets, kinds=kinds, input_sha256=[file_digest(path)], config=load_config(preset=default_preset(kinds)),
        side=side_documents([path], truth=None, own_ship=None, sensors=None), name="sample", out=tmp_path, rrd=False,
    )  # fmt: skip
    execute(job)
    found = diff(GOLDEN / golden, tmp_path / "summary.json", rtol=1e-6, atol=1e-9)
    assert found.equal, [(d.where, d.what, d.a, d.b) for d in found.differences]


def test_goldens_hold_metrics_and_counts_alone() -> None:
    for path in GOLDEN.glob("*.json"):
        assert set(json.loads(path.read_text())) == {"metrics", "counts"}
