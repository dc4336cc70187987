"""AIS in the shapes that people publish and keep it: the same reports from each, and chosen ships of them."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.io import savemat

from maritrack.errors import ConfigError, InputError, UsageError
from maritrack.io import aismat, sniff
from maritrack.io.ais import read_ais
from maritrack.io.aismat import table_of_mat
from maritrack.io.carriers import own_ship
from maritrack.io.reference import only
from maritrack.io.truth import document_kind, document_origin, read_reference
from maritrack.recording import side_documents
from maritrack.settings import InputConfig, ScoreConfig, parse_ids
from maritrack.types import Origin
from tests.cli.calling import call
from tests.shared import shared

HERE = Origin(50.7, -1.1)
T0 = 1_452_603_600
DANISH = """# Timestamp,Type of mobile,MMSI,Latitude,Longitude,Navigational status,ROT,SOG,COG,Heading,IMO,Callsign,\
Name,Ship type,Cargo type,Width,Length,Type of position fixing device,Draught,Destination,ETA,Data source type,A,B,C,D
12/01/2016 13:00:00,Class A,235000001,50.700000,-1.100000,Moored,,10,90,90,1,X,ALPHA,,,20,100,,5,A,,AIS,,,,
12/01/2016 13:00:10,Class A,235000001,50.700000,-1.099270,Moored,,10,90,,1,X,Unknown,,,20,100,,5,A,,AIS,30,70,8,12
12/01/2016 13:00:05,Base Station,2350000,50.8,-1.2,Unknown value,,,,,Unknown,,,,,,,GPS,,,,AIS,,,,
12/01/2016 13:00:06,Class B,235000002,91.0,0.0,Unknown value,,,,,Unknown,,,,,,,GPS,,,,AIS,,,,
"""
AMERICAN = """MMSI,BaseDateTime,LAT,LON,SOG,COG,Heading,VesselName,IMO,CallSign,VesselType,Status,Length,Width,Draft
235000001,2016-01-12T13:00:00,50.70000,-1.10000,10.0,90.0,90.0,ALPHA,IMO1,X,70,0,100.0,20.0,5.0
235000001,2016-01-12T13:00:10,50.70000,-1.09927,10.0,90.0,511.0,ALPHA,IMO1,X,70,0,100.0,20.0,5.0
"""
NEWER = AMERICAN.replace("MMSI,BaseDateTime,LAT,LON", "mmsi,base_date_time,latitude,longitude").replace(
    "Heading,VesselName", "heading,vessel_name"
)
PLAIN = """timestamp,mmsi,lat,lon,sog,cog,heading,name,length,width
1452603600,235000001,50.7,-1.1,10,90,90,ALPHA,100,20
1452603610,235000001,50.7,-1.09927,10,90,511,ALPHA,100,20
"""
SPLIT = """timestamp,mmsi,lat,lon,sog,cog,heading,name,length,width
1452603600,235000001,50.7,-1.1,10,90,90,,,
1452603603,235000001,,,,,,ALPHA,100,20
1452603610,235000001,50.7,-1.09927,10,90,511,,,
"""


def reports(data: bytes):
    return read_reference(data, name="x", origin=HERE)


@pytest.mark.parametrize("text", [AMERICAN, NEWER, SPLIT])
def test_each_shape_of_table_says_the_same(text):
    one, other = reports(text.encode()), reports(PLAIN.encode())
    assert one.ids == other.ids
    assert one.names == other.names == ("ALPHA",)
    for name in ("t_ns", "position_m", "velocity_mps", "heading_rad", "length_m", "width_m"):
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), atol=1e-6)
    assert one.damage == ()


def test_the_danish_table_joins_the_antenna_and_leaves_out_base_stations():
    found = reports(DANISH.encode())
    assert found.ids == ("235000001",)
    assert found.names == ("ALPHA",)
    assert found.t_ns.tolist() == [T0 * 10**9, (T0 + 10) * 10**9]
    np.testing.assert_allclose(found.position_m - reports(PLAIN.encode()).position_m, [[-20, -2], [-20, -2]], atol=0.01)
    assert {d.code: d.count for d in found.damage} == {"bad-position": 1, "not-afloat": 1}


def mat(tmp_path, **content) -> bytes:
    savemat(tmp_path / "a.mat", content)
    return (tmp_path / "a.mat").read_bytes()


COLUMNS = {
    "mmsi": np.array([235000001.0] * 2), "lat": np.array([50.7, 50.7]), "lon": np.array([-1.1, -1.09927]),
    "sog": np.array([10.0, 10.0]), "cog": np.array([90.0, 90.0]), "heading": np.array([90.0, 511.0]),
    "time": np.array([T0, T0 + 10.0]),
}  # fmt: skip
SHIP = COLUMNS | {"mmsi": 235000001, "name": "ALPHA", "length": 100.0, "width": 20.0}


def test_matlab_files_of_every_arrangement_say_the_same(tmp_path):
    days = SHIP | {"time": COLUMNS["time"] / 86400.0 + 719529.0}
    other = SHIP | {"mmsi": 235000002, "lat": COLUMNS["lat"] + 0.01}
    want = reports(PLAIN.encode())
    for content in (SHIP, {"ais": SHIP}, {"ais": np.array([SHIP, other], dtype=object)}, {"a": days, "b": other}):
        data = mat(tmp_path, **content)
        assert document_kind(data, name="x") == "ais"
        assert document_origin(data) is None
        found = only(reports(data), ("235000001",))
        assert found.names == ("ALPHA",)
        np.testing.assert_allclose(found.t_ns, want.t_ns, atol=1e5)
        np.testing.assert_allclose(found.position_m, want.position_m, atol=1e-6)
        np.testing.assert_allclose(found.length_m, want.length_m)


def test_a_matlab_file_of_more_reports_than_memory_should_hold_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(aismat, "MOST_ROWS", 3)
    data = mat(tmp_path, a={"lat": np.ones(2), "lon": np.ones(2)}, b={"lat": np.ones(2), "lon": np.ones(2)})
    assert aismat.holds_ais(data)
    with pytest.raises(InputError, match="x: 4 reports, at most 3 are read"):
        table_of_mat(data, name="x")


def test_a_matlab_file_without_positions_says_what_it_holds(tmp_path):
    data = mat(tmp_path, radar=np.zeros(3), speed=1.0)
    with pytest.raises(InputError, match="x: no columns of latitude and longitude: it holds radar, speed"):
        table_of_mat(data, name="x")
    uneven = mat(tmp_path, lat=np.zeros(3), lon=np.zeros(2), time=np.zeros(3))
    assert document_kind(uneven, name="x") == "rwmr-truth"
    cut = mat(tmp_path, **COLUMNS)[:-9]
    with pytest.raises(InputError):
        reports(cut)


def test_chosen_ships_are_all_that_is_left():
    rows = PLAIN + "1452603600,235000002,50.71,-1.1,0,0,0,BRAVO,50,10\n"
    everything = reports(rows.encode())
    one = only(everything, parse_ids(" 235000002,235000002 "))
    assert (one.ids, one.names) == (("235000002",), ("BRAVO",))
    assert one.start.tolist() == [0, 1]
    np.testing.assert_array_equal(one.position_m, everything.position_m[2:])
    assert one.length_m.tolist() == [50.0]
    assert only(everything, ()) is everything
    with pytest.raises(UsageError, match="no ship 7 in the truth") as caught:
        only(everything, ("235000002", "7"))
    assert "235000001" in caught.value.hint


def test_a_log_of_the_bridge_places_own_ship_by_its_own_instruments():
    from tests.io.test_aivdm import clock, document, position

    rmc = clock("GPRMC,130000,A,5042.0,N,00106.0,W,0.0,0.0,120116,,")
    data = document(rmc, *position(235000001, T0))
    assert sniff(data, "x") == "ais"
    place = own_ship({"own-ship": data}, InputConfig(), None)
    assert place is not None and place.own is not None
    np.testing.assert_allclose([place.own.lat_deg[0], place.own.lon_deg[0]], [50.7, -1.1])
    alone = own_ship({"own-ship": document(f"{position(235000001, T0)[0]},{T0}")}, InputConfig(), None)
    assert alone is not None and alone.own is not None


def test_compressed_truth_is_unpacked_once_and_archived_as_it_is(tmp_path):
    import gzip

    (tmp_path / "a.csv.gz").write_bytes(gzip.compress(PLAIN.encode()))
    side = side_documents([tmp_path / "r"], truth=tmp_path / "a.csv.gz", own_ship=None, sensors=None)
    assert side["truth"] == PLAIN.encode()


def test_truth_match_reaches_the_run_and_the_score(tmp_path):
    points = {"format": "maritrack-points/1", "frame": "enu", "origin": {"lat_deg": 50.7, "lon_deg": -1.1}, "scans": [
        {"time_s": T0 + i, "points": [[5.0 * i, 0.0]]} for i in range(8)]}  # fmt: skip
    (tmp_path / "r.json").write_text(json.dumps(points))
    rows = PLAIN + "1452603600,9,50.71,-1.1,0,0,0,B,50,10\n1452603610,9,50.71,-1.1,0,0,0,B,50,10\n"
    (tmp_path / "ais.csv").write_text(rows)
    args = ["process", tmp_path / "r.json", "--truth", tmp_path / "ais.csv", "-o", tmp_path / "o", "--no-rrd", "--json"]
    everything = call(*args, "--force").json
    chosen = call(*args, "--truth-match", "9", "--force").json
    assert everything["metrics"]["n_truth"] == 2.0
    assert chosen["metrics"]["n_truth"] == 1.0
    assert [o["id"] for o in chosen["objects"]] == ["9"]
    scored = call("score", tmp_path / "o", "--truth", tmp_path / "ais.csv", "--truth-match", "235000001", "--json")
    assert [o["id"] for o in scored.json["objects"]] == ["235000001"]
    wrong = call(*args, "--truth-match", "5", "--force")
    assert wrong.code == 2
    assert "no ship 5 in the truth" in wrong.err


def test_a_run_takes_sentences_in_gzip_as_its_truth(tmp_path):
    import gzip

    from tests.io.test_aivdm import document, position, tagged

    points = {"format": "maritrack-points/1", "frame": "enu", "origin": {"lat_deg": 50.7, "lon_deg": -1.1}, "scans": [
        {"time_s": T0 + i, "points": [[5.0 * i, 0.0]]} for i in range(8)]}  # fmt: skip
    (tmp_path / "r.json").write_text(json.dumps(points))
    lines = [line for i in (0, 8) for line in tagged(position(235000001, T0 + i, lon=-1.1 + 9e-6 * i), T0 + i)]
    (tmp_path / "ais.nmea.gz").write_bytes(gzip.compress(document(*lines, "!AIVDM,1,1,,A,15,0*00")))
    done = call("process", tmp_path / "r.json", "--truth", tmp_path / "ais.nmea.gz", "-o", tmp_path / "o", "--json")
    assert done.json["metrics"]["n_truth"] == 1.0
    assert done.json["counts"]["warnings"] == {"truth-bad-checksum": 1}
    again = call("replay", tmp_path / "o", "--verify")
    assert again.code == 0


def test_ids_are_a_list_with_commas():
    assert parse_ids("a, b,,a") == ("a", "b")
    assert ScoreConfig(truth_match="").truth_match == ""
    with pytest.raises(ConfigError):
        ScoreConfig(truth_lag_s="x")


def test_84_minutes_of_the_solent_are_truth():
    data = shared("data/ais_solent/SolentAIS_20160112_130211.csv").read_bytes()
    found = read_ais(data, name="x", origin=Origin(50.78, -1.10)).reference
    assert len(found) == 91
    assert float(np.ptp(found.t_ns)) / 60e9 == pytest.approx(84.0, abs=1.0)
    assert len(found.t_ns) == 18_623 - 3 - 100 - 1
    speed = np.hypot(*np.diff(found.position_m, axis=0).T) / np.maximum(np.diff(found.t_ns) / 1e9, 1.0)
    same = np.ones(len(speed), bool)
    same[found.start[1:-1] - 1] = False
    assert speed[same].max() < 60.0
