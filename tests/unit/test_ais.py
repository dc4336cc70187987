"""AIS tables in the shapes that people have them, and the wrong positions in them."""

from __future__ import annotations

import csv

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from maritrack.errors import InputError
from maritrack.geo import geodetic_to_en
from maritrack.io.ais import read_ais
from maritrack.types import Origin
from tests.shared import shared

HERE = Origin(50.7, -1.1)
COLUMNS = ("Time", "MMSI", "Latitude", "Longitude", "COG", "SOG", "Heading", "Name")
ROWS = (
    ("2016-01-12 13:00:00", "235000001", "50.7000", "-1.1000", "90.0", "10.0", "85", "ALPHA"),
    ("2016-01-12 13:00:10", "235000001", "50.7000", "-1.0993", "90.0", "10.0", "511", "ALPHA"),
    ("2016-01-12 13:00:05", "235000002", "50.7100", "-1.1200", "360.0", "0.0", "0", "BRAVO"),
)
T0 = 1_452_603_600 * 10**9


def table(rows=ROWS, columns=COLUMNS, separator=",", end="\n"):
    return end.join(separator.join(row) for row in (columns, *rows)).encode()


def codes(document):
    return {damage.code: damage.count for damage in document.reference.damage}


def test_reports_become_ships_in_local_coordinates():
    reference = read_ais(table(), name="x", origin=HERE).reference
    assert reference.ids == ("235000001", "235000002")
    assert reference.names == ("ALPHA", "BRAVO")
    assert reference.start.tolist() == [0, 2, 3]
    assert (reference.t_ns - T0).tolist() == [0, 10 * 10**9, 5 * 10**9]
    expected = geodetic_to_en(HERE, np.array([50.7, 50.7, 50.71]), np.array([-1.1, -1.0993, -1.12]))
    np.testing.assert_allclose(reference.position_m, expected)
    np.testing.assert_allclose(reference.heading_rad, [np.deg2rad(85.0), np.nan, 0.0])
    np.testing.assert_allclose(reference.velocity_mps[0], [5.1444, 0.0], atol=1e-3)
    assert np.isnan(reference.velocity_mps[2]).all()
    assert not reference.complete


@settings(derandomize=True, deadline=None)
@given(st.permutations(range(len(COLUMNS))), st.sampled_from([",", ";", "\t"]), st.sampled_from(["\n", "\r\n"]))
def test_columns_are_found_by_name_in_any_order_and_with_any_separator(order, separator, end):
    rows = [tuple(row[i] for i in order) for row in ROWS]
    data = table(rows, tuple(COLUMNS[i] for i in order), separator, end)
    one, other = (read_ais(d, name="x", origin=HERE).reference for d in (table(), data))
    assert one.ids == other.ids
    assert np.array_equal(one.position_m, other.position_m)
    assert np.array_equal(one.heading_rad, other.heading_rad, equal_nan=True)


@settings(derandomize=True, deadline=None)
@given(st.permutations(range(len(ROWS))))
def test_order_of_rows_does_not_matter(order):
    one, other = (read_ais(table(rows), name="x").reference for rows in (ROWS, [ROWS[i] for i in order]))
    assert np.array_equal(one.t_ns, other.t_ns)
    assert np.array_equal(one.position_m, other.position_m)


def test_decimal_commas_are_read_where_commas_do_not_separate():
    rows = [tuple(cell.replace(".", ",") if i in (2, 3) else cell for i, cell in enumerate(row)) for row in ROWS]
    reference = read_ais(table(rows, separator=";"), name="x", origin=HERE).reference
    np.testing.assert_allclose(reference.position_m, read_ais(table(), name="x", origin=HERE).reference.position_m)


def test_the_origin_is_the_first_report_where_nobody_is_own_ship():
    document = read_ais(table(), name="x")
    assert document.origin == HERE
    assert document.own is None


def test_own_ship_is_apart_and_makes_the_origin():
    document = read_ais(table(), name="x", own_ship="235000002")
    assert document.origin == Origin(50.71, -1.12)
    assert document.reference.ids == ("235000001",)
    assert document.own is not None
    assert (document.own.t_ns - T0).tolist() == [5 * 10**9]
    np.testing.assert_allclose(document.own.position_m, [[0.0, 0.0]], atol=1e-9)


def test_own_ship_may_be_marked_in_a_column():
    rows = [(*row, mark) for row, mark in zip(ROWS, "110", strict=True)]
    document = read_ais(table(rows, (*COLUMNS, "is_own_ship")), name="x")
    assert document.reference.ids == ("235000002",)
    assert document.own is not None
    np.testing.assert_allclose(document.own.lon_deg, [-1.1, -1.0993])


def test_an_own_ship_that_is_not_there_is_an_error():
    with pytest.raises(InputError, match="ais: no report of own ship '7'"):
        read_ais(table(), name="ais", own_ship="7")
    rows = [(*row, "1") for row in ROWS]
    with pytest.raises(InputError, match="several ships"):
        read_ais(table(rows, (*COLUMNS, "is_own_ship")), name="ais")


def test_places_off_the_globe_and_unknown_ones_are_left_out_and_counted():
    wrong = [("91.0", "181.0"), ("0.0", "0.0"), ("-90.5", "1.0"), ("", "1.0"), ("nan", "1.0")]
    rows = [("2016-01-12 13:00:30", "235000003", lat, lon, "", "", "", "") for lat, lon in wrong]
    document = read_ais(table([*ROWS, *rows]), name="x")
    assert document.reference.ids == ("235000001", "235000002")
    assert codes(document) == {"bad-position": 5}


def test_rows_without_time_or_ship_are_left_out_and_counted():
    rows = [
        ("", "235000003", "50.7", "-1.1", "", "", "", ""),
        ("2016-01-12 13:00:30", "", "50.7", "-1.1", "", "", "", ""),
    ]
    assert codes(read_ais(table([*ROWS, *rows]), name="x")) == {"bad-report": 2}


def test_of_two_reports_at_one_time_the_first_in_the_table_counts():
    rows = [*ROWS, ("2016-01-12 13:00:10", "235000001", "50.7001", "-1.0", "", "", "", "")]
    document = read_ais(table(rows), name="x", origin=HERE)
    assert codes(document) == {"duplicate-time": 1}
    np.testing.assert_allclose(
        document.reference.position_m[1], geodetic_to_en(HERE, np.array(50.7), np.array(-1.0993))
    )


@pytest.mark.parametrize("wrong", [0, 1, 3])
def test_a_single_position_that_no_ship_can_have_reached_is_left_out(wrong):
    rows = [(f"2016-01-12 13:00:0{i}", "1", "50.7", "54.8" if i == wrong else "-1.1", "", "", "", "") for i in range(4)]
    document = read_ais(table(rows), name="x")
    assert codes(document) == {"position-jump": 1}
    assert len(document.reference.t_ns) == 3
    assert np.ptp(document.reference.position_m) < 1e-6


def test_of_places_that_are_all_too_far_from_each_other_none_is_the_wrong_one():
    lons = ["-1.1", "-1.1", "0.5", "2.0", "2.0"]
    rows = [(f"2016-01-12 13:00:0{i}", "1", "50.7", lon, "", "", "", "") for i, lon in enumerate(lons)]
    assert codes(read_ais(table(rows), name="x")) == {}


def test_a_ship_that_went_on_elsewhere_is_not_a_jump():
    lons = ["-1.1", "-1.1", "0.5", "0.5"]
    rows = [(f"2016-01-12 13:00:0{i}", "1", "50.7", lon, "", "", "", "") for i, lon in enumerate(lons)]
    assert codes(read_ais(table(rows), name="x")) == {}


def test_times_of_day_are_placed_on_their_date_and_go_on_past_midnight():
    columns = ("mmsi", "time_s_utc_of_day", "lat_deg", "lon_deg")
    rows = [("2", "3", "50.7", "-1.1"), ("1", "86399", "50.7", "-1.1"), ("1", "1", "50.7", "-1.1")]
    dated = read_ais(table(rows, columns), name="x", date="2016-01-12").reference
    midnight = 1_452_643_200 * 10**9
    assert ((dated.t_ns - midnight) // 10**9).tolist() == [-1, 1, 3]
    undated = read_ais(table(rows, columns), name="x").reference
    assert (undated.t_ns // 10**9).tolist() == [86399, 86401, 86403]


def test_control_characters_in_names_can_not_reach_a_terminal():
    rows = [(*ROWS[0][:-1], "CORNELIS\x1aANEN \x1b[31m")]
    assert read_ais(table(rows), name="x").reference.names == ("CORNELIS?ANEN ?[31m",)


def test_length_and_width_are_the_first_that_a_ship_tells():
    sizes = [("0", ""), ("120", "20"), ("-5", "4")]
    rows = [(*row, *size) for row, size in zip(ROWS, sizes, strict=True)]
    reference = read_ais(table(rows, (*COLUMNS, "Length", "Width")), name="x").reference
    np.testing.assert_array_equal(reference.length_m, [120.0, np.nan])
    np.testing.assert_array_equal(reference.width_m, [20.0, 4.0])


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "empty"),
        (b"time,mmsi\n1,2\n", "no columns of latitude and longitude"),
        (b"mmsi,lat,lon\n1,2,3\n", "no column of times"),
        (b"time,mmsi,lat,lon\n", "no report"),
        (b"time,mmsi,lat,lon\n1,2,99,3\n", "no report"),
        (b"time,mmsi,lat,lon\n" + b"x" * 200_000, "line 2: field larger"),
        (b"time,mmsi,lat,lon\n" + b"1,2,50,1," * 500_000, "a line of more than 1024 KiB"),
    ],
)
def test_a_table_that_is_none_is_an_error_of_one_line(data, message):
    with pytest.raises(InputError, match=message) as caught:
        read_ais(data, name="rec.csv")
    assert str(caught.value).startswith("rec.csv: ")


@settings(derandomize=True, deadline=None, max_examples=200)
@given(st.integers(0, len(table()) - 1), st.binary(min_size=1, max_size=6))
def test_a_damaged_table_is_read_or_refused(at, octets):
    data = table()
    try:
        reference = read_ais(data[:at] + octets + data[at + len(octets) :], name="x").reference
    except InputError as error:
        assert "\n" not in str(error)
    else:
        assert np.isfinite(reference.position_m).all()


@pytest.mark.parametrize(
    ("run", "expected"), [("run_01_004", {"duplicate-time"}), ("run_01_005", {"duplicate-time", "bad-position"})]
)
def test_real_reports_lie_where_their_table_says(run, expected):
    path = shared(f"data/marce_solent/{run}/ais_tracks.csv")
    document = read_ais(path.read_bytes(), name="x")
    assert document.own is not None
    assert set(codes(document)) == expected
    own = {}
    with path.open(encoding="utf-8", errors="replace", newline="") as file:
        for row in csv.DictReader(file):
            if row["is_own_ship"] == "1":
                own.setdefault(int(float(row["time_s_utc_of_day"])), (float(row["east_m"]), float(row["north_m"])))
    assert (document.own.t_ns // 10**9).tolist() == sorted(own)
    np.testing.assert_allclose(document.own.position_m, [own[t] for t in sorted(own)], atol=0.02)
    assert "235028893" not in document.reference.ids


def test_the_corrupted_row_and_the_double_times_of_a_real_recording_are_found():
    data = shared("data/ais_solent/SolentAIS_20160112_130211.csv").read_bytes()
    document = read_ais(data, name="x")
    assert len(document.reference) == 91
    assert codes(document) == {"duplicate-time": 3, "duplicate-report": 100, "position-jump": 1}
    assert np.abs(document.reference.position_m).max() < 100_000.0


SIDES = ("to_bow", "to_stern", "to_port", "to_starboard")


def middle(heading: str, course: str, speed: str, sides: tuple[str, ...]) -> np.ndarray:
    row = ("2016-01-12 13:00:00", "1", "50.7", "-1.1", course, speed, heading, "X", *sides)
    return read_ais(table([row], (*COLUMNS, *SIDES)), name="x", origin=HERE).reference.position_m[0]


@pytest.mark.parametrize(
    ("heading", "course", "speed", "sides", "place"),
    [
        ("0", "0", "9", ("30", "70", "8", "12"), (2.0, -20.0)),  # the antenna is ahead of the middle, and to port
        ("90", "0", "9", ("30", "70", "8", "12"), (-20.0, -2.0)),
        ("511", "180", "9", ("70", "30", "12", "8"), (2.0, -20.0)),  # by the course
        ("511", "180", "0.1", ("70", "30", "12", "8"), (0.0, 0.0)),  # at rest nothing tells where it points
        ("0", "0", "9", ("30", "", "8", "12"), (0.0, 0.0)),
        ("0", "0", "9", ("0", "100", "0", "20"), (0.0, 0.0)),  # only the size is told
    ],
)
def test_positions_are_moved_from_the_antenna_to_the_middle_of_the_hull(heading, course, speed, sides, place):
    np.testing.assert_allclose(middle(heading, course, speed, sides), place, atol=1e-6)


def test_distances_from_the_antenna_tell_the_size_where_no_column_does():
    row = (*ROWS[0], "30", "70", "8", "12")
    reference = read_ais(table([row], (*COLUMNS, *SIDES)), name="x", origin=HERE).reference
    assert (reference.length_m[0], reference.width_m[0]) == (100.0, 20.0)


def test_own_ship_stays_where_its_antenna_is():
    row = ("2016-01-12 13:00:00", "1", "50.7", "-1.1", "0", "9", "0", "X", "30", "70", "8", "12")
    document = read_ais(table([row], (*COLUMNS, *SIDES)), name="x", origin=HERE, own_ship="1")
    np.testing.assert_allclose(document.own.position_m, [[0.0, 0.0]], atol=1e-6)
