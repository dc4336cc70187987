"""Sentences of own ship's instruments: positions, headings, and what is wrong among them."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from maritrack.chain import detect
from maritrack.config import load_config
from maritrack.errors import InputError
from maritrack.geo import en_to_geodetic
from maritrack.io import sniff
from maritrack.io.nmea import read_nmea
from maritrack.recording import kinds_of, open_inputs, open_recording, side_documents
from maritrack.simulate.record import simulate
from maritrack.types import Origin
from tests.unit.test_simulate_stations import world

RMC = "GPRMC,080001.50,A,5400.6000,N,00759.4000,E,5.1,90.0,010326,,"
GGA = "GPGGA,080002.00,5400.6600,N,00759.4000,E,1,09,1.0,3.0,M,45.0,M,,"
T0_S = datetime(2026, 3, 1, 8, tzinfo=UTC).timestamp()


def line(body: str) -> str:
    total = 0
    for letter in body:
        total ^= ord(letter)
    return f"${body}*{total:02X}"


def read(*lines: str, date: str = "") -> tuple[list[list[float]], dict[str, int]]:
    """Seconds since eight o'clock, latitude, longitude and heading of each report, and what was wrong."""
    document = read_nmea("\r\n".join(lines).encode(), name="x", date=date)
    own = document.own
    assert own is not None
    rows = np.column_stack([own.t_ns * 1e-9 - T0_S, own.lat_deg, own.lon_deg, np.degrees(own.heading_rad)])
    return rows.round(6).tolist(), {d.code: d.count for d in document.reference.damage}


def test_positions_and_headings_make_reports() -> None:
    rows, wrong = read(line(RMC), line("HEHDT,12.5,T"), line(GGA), "$HETHS,13.5,A", line("IIMWV,1,R,2,N,A"))
    assert_allclose(rows, [[1.5, 54.01, 7.99, 12.5], [2.0, 54.011, 7.99, 13.5]], atol=2e-6)
    assert wrong == {}


def test_south_and_west_are_negative_and_tags_may_stand_before() -> None:
    body = RMC.replace("N", "S", 1).replace(",E,", ",W,")
    rows, _ = read("\\c:1772352001*00\\" + line(body))
    assert_allclose(rows[0][1:3], [-54.01, -7.99])


def test_what_is_wrong_is_counted_and_left_out() -> None:
    rows, wrong = read(
        line(RMC), line(GGA)[:-2] + "00", line("GPRMC,0800xx,A,5400,N,00759,E,1,2,010326"), line("HEHDT,,T"),
        line(GGA.replace("080002", "080003").replace("5400.66", "9900.66")), "no sentence", line("HETHS,50.0,V"),
        line(RMC.replace(",A,", ",V,").replace("080001", "080009")),
    )  # fmt: skip
    assert len(rows) == 1 and np.isnan(rows[0][3])
    assert wrong == {"bad-checksum": 1, "bad-sentence": 2}


def test_a_time_of_day_goes_on_past_midnight() -> None:
    rows, _ = read(line(GGA.replace("080002", "235959")), line(GGA.replace("080002", "000001")), date="2026-03-01")
    assert rows[1][0] - rows[0][0] == 2.0


def test_sentences_without_a_position_are_an_error() -> None:
    with pytest.raises(InputError, match="no position"):
        read_nmea(line("HEHDT,12.5,T").encode(), name="x")


@pytest.mark.parametrize("text", [line(RMC), "\\c:1*00\\" + line(RMC), line("HEHDT,1,T")])
def test_they_are_told_by_their_content(text: str) -> None:
    assert sniff(text.encode(), "x") == "nmea"


def test_a_radar_aboard_is_placed_by_its_ships_instruments(tmp_path: Path) -> None:
    scene = world(tmp_path)
    simulate(scene, tmp_path / "rec.cat240", seed=3, labels=False)
    times_s = np.arange(-1.0, 32.0)
    state = scene.vessel[0].course().at(times_s)
    lat_deg, lon_deg = en_to_geodetic(Origin(scene.lat_deg, scene.lon_deg), state.position_m)
    lines = []
    for t_s, lat, lon, heading in zip(times_s, lat_deg, lon_deg, np.degrees(state.heading_rad), strict=True):
        at = datetime.fromtimestamp(scene.start_s + t_s, UTC)
        place = f"{int(lat):02d}{lat % 1 * 60:08.5f},N,{int(lon):03d}{lon % 1 * 60:08.5f},E"
        lines += [line(f"GPRMC,{at:%H%M%S}.00,A,{place},9.0,0.0,{at:%d%m%y},,"), line(f"HEHDT,{heading:.1f},T")]
    (tmp_path / "own.nmea").write_text("\n".join(lines))
    paths = [tmp_path / "rec-c.cat240"]
    side = side_documents(
        paths, truth=tmp_path / "rec.truth.json", own_ship=tmp_path / "own.nmea", sensors=tmp_path / "rec.sensors.toml"
    )
    octets, config, off_m = open_inputs(paths), load_config(preset="radar"), []
    for frame in open_recording(octets, kinds_of(octets), side, config).frames:
        points = detect(frame.scan, config)
        away_m = points.position_m - scene.vessel[1].course().at(points.t_ns * 1e-9 - scene.start_s).position_m
        near = np.hypot(away_m[:, 0], away_m[:, 1]) < 120.0
        off_m += [away_m[near].mean(axis=0)] if near.any() else []
    assert len(off_m) >= 10 and np.hypot(*np.mean(off_m, axis=0)) < 12.0
