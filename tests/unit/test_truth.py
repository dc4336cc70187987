"""Truth from whatever document holds it, in the plane of the run."""

from __future__ import annotations

import json

import numpy as np
import pytest

from maritrack.errors import InputError
from maritrack.geo import en_to_geodetic
from maritrack.io.autoferry import ORIGIN
from maritrack.io.truth import document_origin, find_truth, read_reference
from maritrack.types import Origin
from tests.shared import ROOT

HERE, THERE = Origin(50.7, -1.1), Origin(50.75, -1.0)
RECORD = {"id": "a", "time_s": 1, "east_m": 100, "north_m": -50}
POINTS = json.dumps({"format": "maritrack-points/1", "origin": {"lat_deg": 50.7, "lon_deg": -1.1}, "scans": [],
                     "truth": [RECORD]}).encode()  # fmt: skip
AUTOFERRY = b'[[{"targetID":1,"position":[1,2,0],"time":1}]]'
AIS = b"time,mmsi,lat,lon\n1,5,50.75,-1.0\n"


@pytest.mark.parametrize(
    ("data", "own", "complete"), [(POINTS, HERE, True), (AUTOFERRY, ORIGIN, True), (AIS, THERE, False)]
)
def test_positions_are_the_same_place_about_any_origin(data, own, complete):
    alone, moved = (
        read_reference(data, name="x", origin=origin) for origin in (None, Origin(own.lat_deg + 0.01, own.lon_deg))
    )
    assert alone.complete == moved.complete == complete
    at = Origin(own.lat_deg + 0.01, own.lon_deg)
    np.testing.assert_allclose(en_to_geodetic(own, alone.position_m), en_to_geodetic(at, moved.position_m), atol=1e-6)
    assert np.linalg.norm(alone.position_m - moved.position_m) > 1000.0


def test_a_document_knows_its_origin_or_does_not():
    assert document_origin(POINTS) == HERE
    assert document_origin(AUTOFERRY) == ORIGIN
    assert document_origin(AIS) is None
    assert document_origin(b"") is None
    assert document_origin(b'{"format": "maritrack-points/1"') is None


@pytest.mark.parametrize("data", [b"", b"hello", b"time_s,azimuth_deg,range_m\n1,2,3\n", b'{"a": 1}'])
def test_what_holds_no_truth_is_an_error_of_one_line(data):
    with pytest.raises(InputError) as caught:
        read_reference(data, name="truth.txt", origin=None)
    assert str(caught.value).startswith("truth.txt: ")


@pytest.mark.parametrize(
    ("recording", "truth"),
    [
        ("rec.cat240", "rec.truth.json"),
        ("rec.cat240", "rec.cat240.truth.json"),
        ("rec.cat240.gz", "rec.truth.json"),
        ("rec.jsonl", "rec.truth.json"),
        ("rec", "rec.truth.json"),
        ("scenario13_detections.json", "scenario13_groundTruth.json"),
        ("scenario13.mat", "scenario13_groundTruth.json"),
    ],
)
def test_truth_beside_a_recording_is_found_by_its_name(tmp_path, recording, truth):
    (tmp_path / recording).touch()
    assert find_truth(tmp_path / recording) is None
    (tmp_path / truth).touch()
    assert find_truth(tmp_path / recording) == tmp_path / truth


def test_a_truth_is_not_its_own_truth(tmp_path):
    (tmp_path / "rec.truth.json").touch()
    (tmp_path / "s_groundTruth.json").touch()
    assert find_truth(tmp_path / "rec.truth.json") is None
    assert find_truth(tmp_path / "s_groundTruth.json") is None


def test_the_truth_of_the_sample_is_found():
    path = find_truth(ROOT / "data" / "samples" / "autoferry13_detections.json")
    assert path is not None
    assert len(read_reference(path.read_bytes(), name="x", origin=None)) == 2
