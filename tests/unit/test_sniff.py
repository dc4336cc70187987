"""What an input is, told from its octets."""

from __future__ import annotations

import functools
import gzip
import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from maritrack.errors import InputError
from maritrack.io import sniff
from tests.shared import shared

RECORD = bytes.fromhex("e7a0070202000000010000001000000000000000640000040000040000000401") + bytes(64)
BLOCK = b"\xf0" + (len(RECORD) + 3).to_bytes(2, "big") + RECORD
zipped = functools.partial(gzip.compress, mtime=0)  # the same octets each time, for the names of tests
OTHER = b"\x30\x00\x10" + b"\xff\x01" * 6 + b"\x00"  # 16 octets of category 48


@pytest.mark.parametrize(
    ("head", "kind"),
    [
        (BLOCK, "cat240"),
        (BLOCK[:40], "cat240"),
        (BLOCK * 3, "cat240"),
        (b"\xd4\xc3\xb2\xa1\x02\x00", "cat240"),
        (b"\xa1\xb2\x3c\x4d\x00\x02", "cat240"),
        (b"\x0a\x0d\x0d\x0a", "cat240"),
        (b"\x89MCAP0\r\n", "cat240"),
        (zipped(BLOCK), "cat240"),
        (zipped(b"\xd4\xc3\xb2\xa1\x02\x00"), "cat240"),
        (OTHER * 5 + BLOCK, "cat240"),
        (b"damaged \x01\x02\xf0\x00" + BLOCK * 2, "cat240"),
        (b'{"format": "maritrack-points/1", "scans": []}', "points"),
        (b'\xef\xbb\xbf\n {\n "scans": [], "format" : "maritrack-points/1"}', "points"),
        (b'{"format":"maritrack-points/1","frame":"enu"}\n{"time_s":0,"points":[]}\n', "points"),
        (b'{"format":"maritrack-points/9"}', "points"),
        (b'[{"sensorID":3,"measurements":[]}]', "autoferry"),
        (b'[[{"targetID":1,"position":[1,2,0],"time":1}]]', "autoferry-truth"),
        (b"MATLAB 5.0 MAT-file, Platform: GLNXA64", "autoferry"),
        (b"time_s_utc_of_day,azimuth_rad,range_m\n1,2,3\n", "plots"),
        (b"Range [m];Time;Bearing (deg)\n", "plots"),
        (b"Time,MMSI,Latitude_degrees,Longitude_degrees\n", "ais"),
        (b"!AIVDM,1,1,,A,15,0*00\n", "ais"),
        (b"\\c:1452603600*00\\!BSVDM,1,1,,A,15,0*00\n", "ais"),
        (b"# Timestamp\tMMSI\tLatitude\tLongitude\r\n", "ais"),
    ],
)
def test_the_content_says_what_it_is(head, kind):
    assert sniff(head, "misleading.png") == kind


@pytest.mark.parametrize(
    ("head", "message"),
    [
        (b"", "empty"),
        (b"\x89PNG\r\n\x1a\n", "PNG"),
        (zipped(b'{"format": "maritrack-points/1"}'), "gzip (points)"),
        (zipped(zipped(BLOCK)), "gzip (gzip)"),
        (b"\x1f\x8b\x08\x00 damaged", "can't be unpacked"),
        (zipped(b""), "empty, compressed with gzip"),
        (zipped(b"")[:-9], "can't be unpacked"),
        (b"\x89MCAP0\r\n" + bytes(90) + b"maritrack.archive", "archive of a run"),
        (b"RRF2\x00", "Rerun"),
        (b"\x89HDF\r\n\x1a\n", "HDF5"),
        (OTHER * 5, "category 048"),
        (b'{"type":"FeatureCollection"}', "GeoJSON"),
        (b'{"a": 1}', 'without "format"'),
        (b"{}", 'without "format"'),
        (b"[[1, 2]]", "not of Autoferry"),
        (b"t\x00i\x00m\x00e\x00", "not a recording"),
        (b"\xff\xfet\x00", "UTF-16"),
        (b"dear reader,\n", "not a recording"),
        (b"\xf0", "not a recording"),
    ],
)
def test_what_is_not_read_is_named_in_one_line(head, message):
    with pytest.raises(InputError) as caught:
        sniff(head, "rec.cat240")
    assert str(caught.value).startswith("rec.cat240: ")
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_archive_is_sent_to_replay():
    with pytest.raises(InputError) as caught:
        sniff(b"\x89MCAP0\r\n" + b"maritrack.archive", "run.mcap")
    assert "maritrack replay" in caught.value.hint


@settings(derandomize=True, deadline=None, max_examples=300)
@given(st.binary(max_size=300))
def test_no_octets_lead_to_anything_but_a_kind_or_an_input_error(head):
    try:
        assert sniff(head, "x") in {"cat240", "points", "autoferry", "autoferry-truth", "plots", "ais"}
    except InputError as error:
        assert "\n" not in str(error)


def test_random_octets_are_no_radar_video():
    generator = np.random.default_rng(7)
    for _ in range(20):
        with pytest.raises(InputError):
            sniff(b"\x01" + generator.bytes(65535), "x")


def test_garbage_before_the_first_block_does_not_hide_it():
    generator = np.random.default_rng(7)
    for n in (1, 2, 3, 100, 5000):
        assert sniff(b"\x01" + generator.bytes(n) + BLOCK * 4, "x") == "cat240"


def test_all_known_messages_are_recognised_as_video():
    for name in ("cat240_vectors.json", "cat240_bad_vectors.json"):
        for vector in json.loads(shared(f"vectors/{name}").read_text("utf-8")):
            if vector["name"] != "ascii-file":
                assert sniff(bytes.fromhex(vector["hex"]), vector["name"]) == "cat240", vector["name"]


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("cat240/genuine_two_blocks.ast", "cat240"),
        ("marce_solent/run_01_005/solent_01_005.cat240", "cat240"),
        ("marce_solent/run_01_005/detections.csv", "plots"),
        ("marce_solent/run_01_005/ais_tracks.csv", "ais"),
        ("ais_solent/SolentAIS_20160112_130211.csv", "ais"),
        ("autoferry/scenario13/scenario13_detections.json", "autoferry"),
        ("autoferry/scenario13/scenario13_groundTruth.json", "autoferry-truth"),
        ("autoferry/scenario13/scenario13.mat", "autoferry"),
    ],
)
def test_real_recordings_are_recognised(name, kind):
    with shared(f"data/{name}").open("rb") as file:
        assert sniff(file.read(65536), "x") == kind
