"""AIS sentences: times, parts, particulars, what is wrong with them, and the positions that pyais alone finds."""

from __future__ import annotations

import gzip
import io
import zipfile
from collections import Counter
from datetime import UTC, datetime

import numpy as np
import pyais
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from maritrack.errors import InputError
from maritrack.io.ais import read_ais
from maritrack.io.aisrows import OTHER, VESSEL
from maritrack.io.aivdm import MOST_OPEN, POSITIONS, read_sentences
from maritrack.io.documents import unpacked
from maritrack.types import Origin
from tests.shared import shared

T0 = 1_452_603_600  # 2016-01-12 13:00:00
HERE = Origin(50.7, -1.1)


def checksum(text: str) -> str:
    value = 0
    for letter in text:
        value ^= ord(letter)
    return f"{value:02X}"


def encoded(told: dict[str, object], **more: object) -> list[str]:
    """Sentences of a message, heard by a receiver."""
    return pyais.encode_dict(told, sentence_type="VDM", **{"talker_id": "AI", **more})


def position(mmsi: int, t_s: int, *, lat: float = 50.7, lon: float = -1.1, kind: int = 1, **more: object) -> list[str]:
    told = {"speed": 10.0, "course": 90.0, "heading": 90, "second": t_s % 60, **more}
    return encoded({"msg_type": kind, "mmsi": mmsi, "lat": lat, "lon": lon, **told})


def particulars(mmsi: int, **more: object) -> list[str]:
    told = {"shipname": "ALPHA", "to_bow": 30, "to_stern": 70, "to_port": 8, "to_starboard": 12, **more}
    return encoded({"msg_type": 5, "mmsi": mmsi, **told}, seq_id=3)


def tagged(lines: list[str], t_s: float) -> list[str]:
    tag = f"s:shore,c:{t_s:.0f}"
    return [f"\\{tag}*{checksum(tag)}\\{line}" for line in lines]


def stamp(t_s: float) -> str:
    t = datetime.fromtimestamp(t_s, UTC)
    text = f"PGHP,1,{t.year},{t.month},{t.day},{t.hour},{t.minute},{t.second},{t.microsecond // 1000},219,,2190064,1,5D"
    return f"${text}*{checksum(text)}"


def document(*lines: str) -> bytes:
    return ("\r\n".join(lines) + "\r\n").encode()


def clock(text: str) -> str:
    return f"${text}*{checksum(text)}"


@pytest.mark.parametrize(
    "lines",
    [
        tagged(position(235000001, T0), T0),
        [stamp(T0), *position(235000001, T0)],
        [f"{line},{T0}" for line in position(235000001, T0)],
        [f"{T0}000 {line}" for line in position(235000001, T0)],
        [f"2016-01-12T13:00:00Z,{line}" for line in position(235000001, T0)],
        [clock("GPZDA,130000.00,12,01,2016,00,00"), *position(235000001, T0)],
        [clock("GPRMC,130000,A,5042.0,N,00106.0,W,0.0,0.0,120116,,"), *position(235000001, T0)],
    ],
)
def test_times_come_from_whatever_tells_them(lines):
    reference = read_ais(document(*lines), name="x", origin=HERE).reference
    assert reference.ids == ("235000001",)
    assert reference.t_ns.tolist() == [T0 * 10**9]
    np.testing.assert_allclose(reference.position_m, [[0.0, 0.0]], atol=0.2)
    np.testing.assert_allclose(reference.velocity_mps, [[5.144, 0.0]], atol=1e-3)
    assert reference.damage == ()


def test_a_position_is_of_the_second_that_its_message_names():
    lines = [*tagged(position(1, T0), T0 + 4), *tagged(position(2, T0 + 5), T0 + 3), *tagged(position(3, T0 + 20), T0)]
    rows = read_sentences(document(*lines)).rows
    assert (rows.t_ns // 10**9 - T0).tolist() == [0, 5, 0]  # 20 s are too much: its clock is wrong


def test_without_any_clock_base_stations_tell_the_time_and_that_is_said():
    base = encoded(
        {"msg_type": 4, "mmsi": 2190064, "year": 2016, "month": 1, "day": 12, "hour": 13, "minute": 0, "second": 0,
         "lat": 50.0, "lon": -1.0}, talker_id="BS",
    )  # fmt: skip
    found = read_ais(document(*position(1, T0), *base, *position(2, T0 + 7)), name="x", origin=HERE).reference
    assert found.ids == ("2",)
    assert found.t_ns.tolist() == [(T0 + 7) * 10**9]
    assert {d.code: d.count for d in found.damage} == {"bad-report": 1, "not-afloat": 1, "coarse-time": 2}


def test_sentences_without_any_time_are_an_error_that_says_what_is_wanted():
    with pytest.raises(InputError, match=r"rec\.nmea: AIS sentences that tell no times") as caught:
        read_ais(document(*position(1, T0)), name="rec.nmea")
    assert "c:" in caught.value.hint


def test_particulars_of_several_sentences_are_joined_and_move_the_antenna_to_the_middle():
    first, second = particulars(235000001)
    other = tagged(position(235000002, T0, lat=50.8), T0)
    lines = [*tagged([first], T0), *other, *tagged([second], T0 + 1), *tagged(position(235000001, T0 + 2), T0 + 2)]
    reference = read_ais(document(*lines), name="x", origin=HERE).reference
    assert reference.names == ("ALPHA", "")
    assert reference.length_m[0] == 100.0
    assert reference.width_m[0] == 20.0
    np.testing.assert_allclose(reference.position_m[0], [-20.0, -2.0], atol=0.2)


def test_messages_of_two_channels_or_talkers_that_count_alike_are_not_mixed():
    first, second = particulars(235000001)
    third, fourth = encoded({"msg_type": 5, "mmsi": 235000002, "shipname": "BRAVO"}, seq_id=3, radio_channel="B")
    fifth, sixth = encoded({"msg_type": 5, "mmsi": 235000003, "shipname": "CHARLIE"}, seq_id=3, talker_id="BS")
    lines = [*position(235000001, T0), *position(235000002, T0 + 1), *position(235000003, T0 + 2)]
    told = document(*tagged([first, third, fifth, *lines, fourth, sixth, second], T0))
    reference = read_ais(told, name="x").reference
    assert reference.names == ("ALPHA", "BRAVO", "CHARLIE") and reference.damage == ()


def test_a_message_in_parts_is_of_the_time_of_its_first():
    first, second = particulars(235000001)
    rows = read_sentences(document(*tagged([first], T0), *tagged([second], T0 + 7))).rows
    assert rows.t_ns.tolist() == [T0 * 10**9]


def test_what_a_second_receiver_heard_later_is_no_second_report():
    step = {"lon": -1.099}
    lines = [*tagged(position(1, T0), T0), *tagged(position(1, T0 + 10, **step), T0 + 10)]
    late = tagged(position(1, T0), T0 + 21)  # too late for its second to count, and the ship has gone on
    reference = read_ais(document(*lines, *late), name="x").reference
    assert (reference.t_ns // 10**9 - T0).tolist() == [0, 10]
    assert {d.code: d.count for d in reference.damage} == {"duplicate-report": 1}
    again = read_ais(document(*lines, *lines[::-1]), name="x").reference
    assert again.t_ns.tolist() == reference.t_ns.tolist()
    assert {d.code: d.count for d in again.damage} == {"duplicate-time": 2}


def test_order_of_lines_does_not_matter():
    lines = [line for i in range(6) for line in tagged(position(1 + i % 2, T0 + i, lon=-1.1 + i * 1e-4), T0 + i)]
    one, other = (read_ais(document(*order), name="x", origin=HERE).reference for order in (lines, lines[::-1]))
    assert np.array_equal(one.t_ns, other.t_ns)
    assert np.array_equal(one.position_m, other.position_m)


def test_unknown_places_headings_courses_and_speeds_are_nan():
    lines = tagged(position(1, T0, heading=511, course=360.0, speed=102.3), T0)
    nowhere = tagged(position(2, T0, lat=91.0, lon=181.0), T0)
    reference = read_ais(document(*lines, *nowhere), name="x").reference
    assert reference.ids == ("1",)
    assert np.isnan(reference.heading_rad).all()
    assert np.isnan(reference.velocity_mps).all()
    assert {d.code: d.count for d in reference.damage} == {"bad-position": 1}


def test_aids_to_navigation_are_there_and_virtual_ones_are_not():
    aids = [
        encoded({"msg_type": 21, "mmsi": 992350000 + v, "name": "BUOY", "lat": 50.7, "lon": -1.1,
                           "virtual_aid": v, "second": 61})
        for v in (0, 1)
    ]  # fmt: skip
    rows = read_sentences(document(*(line for aid in aids for line in tagged(aid, T0)))).rows
    assert rows.kind.tolist() == [VESSEL, OTHER]


def test_own_ship_is_what_vdo_tells():
    own = [line.replace("AIVDM", "AIVDO") for line in position(9, T0)]
    own = [line[:-2] + checksum(line[1:-3]) for line in own]
    found = read_ais(document(*tagged(own, T0), *tagged(position(1, T0, lat=50.8), T0)), name="x")
    assert found.reference.ids == ("1",)
    assert found.own is not None
    np.testing.assert_allclose(found.own.position_m, [[0.0, 0.0]], atol=1e-9)


def test_wrong_sentences_are_counted_and_the_rest_is_read():
    (good,) = position(1, T0)
    (first, second) = particulars(2)
    lines = [
        *tagged([good], T0), good[:-2] + "00", "!AIVDM,1,1,,A", first, first, second,
        "!AIVDM,1,1,,A,15,0*" + checksum("AIVDM,1,1,,A,15,0"), "!AIVDM,2,3,4,A,15,0*" + checksum("AIVDM,2,3,4,A,15,0"),
    ]  # fmt: skip
    found = read_sentences(document(*lines))
    assert {d.code: d.count for d in found.damage} == {
        "bad-checksum": 1, "bad-message": 1, "bad-sentence": 2, "incomplete-message": 1,
    }  # fmt: skip
    assert found.messages == {1: 1, 5: 1}


def test_messages_that_never_end_do_not_pile_up():
    pairs = [particulars(i)[0].replace(",3,A,", f",{i % 10},{i // 10:02d},") for i in range(500)]
    pairs = [line[:-2] + checksum(line[1:-3]) for line in pairs]
    found = read_sentences(document(*pairs, *tagged(position(1, T0), T0)))
    assert {d.code: d.count for d in found.damage} == {"incomplete-message": 500}
    assert MOST_OPEN < 500
    assert found.messages == {1: 1}


def test_an_endless_line_is_passed_over():
    data = document(*tagged(position(1, T0), T0)) + b"!AIVDM,1,1,,A," + b"0" * 20_000_000
    found = read_sentences(data)
    assert found.messages == {1: 1}
    assert {d.code: d.count for d in found.damage} == {"bad-sentence": 1}


LINES = document(stamp(T0), *position(1, T0), *tagged([*particulars(1), *position(2, T0, kind=18)], T0))


@settings(derandomize=True, deadline=None, max_examples=300)
@given(st.integers(0, len(LINES) - 1), st.binary(max_size=8), st.booleans())
def test_damaged_sentences_are_read_or_refused(at, octets, cut):
    data = LINES[:at] + octets + (b"" if cut else LINES[at + len(octets) :])
    found = read_sentences(data)
    assert sum(found.messages.values()) <= 3 + len(octets)
    try:
        reference = read_ais(LINES + data, name="x").reference
    except InputError as error:
        assert "\n" not in str(error)
    else:
        assert np.isfinite(reference.position_m).all()


@settings(derandomize=True, deadline=None, max_examples=300)
@given(st.text(alphabet=[chr(c) for c in (*range(48, 88), *range(96, 120))], max_size=90), st.integers(0, 5))
def test_any_payload_is_decoded_or_counted(payload, fill):
    text = f"AIVDM,1,1,,A,{payload},{fill}"
    found = read_sentences(f"!{text}*{checksum(text)}\n".encode())
    assert sum(found.messages.values()) + sum(d.count for d in found.damage if d.code == "bad-message") == 1


def _by_pyais(path) -> tuple[Counter, Counter]:
    """Positions (mmsi, latitude, longitude) and types of all messages as pyais alone tells them."""
    places, types = Counter(), Counter()
    with pyais.FileReaderStream(str(path)) as stream:
        for sentence in stream:
            told = sentence.decode()
            types[told.msg_type] += 1
            if told.msg_type in POSITIONS:  # others tell the place of weather or of what corrects satellites
                places[(str(told.mmsi), told.lat, told.lon)] += 1
    return places, types


def _by_us(data: bytes) -> tuple[Counter, Counter]:
    found = read_sentences(data)
    rows = found.rows
    placed = ~rows.static
    places = zip(*(column[placed].tolist() for column in (rows.label, rows.lat_deg, rows.lon_deg)), strict=True)
    return Counter(places), Counter(found.messages)


def test_all_positions_are_those_of_pyais_alone(tmp_path):
    rng = np.random.default_rng(1)
    lines: list[str] = []
    for i in range(200):
        kind = (1, 2, 3, 18, 19, 9, 27, 21, 5, 4)[i % 10]
        made = encoded(
            {"msg_type": kind, "mmsi": 235000000 + i % 17, "lat": rng.uniform(-80, 80), "lon": rng.uniform(-170, 170)},
            talker_id=("AI", "BS")[i % 2], seq_id=i % 10,
        )  # fmt: skip
        lines += [stamp(T0 + i), *made]
    path = tmp_path / "a.nmea"
    path.write_bytes(document(*lines))
    assert _by_us(path.read_bytes()) == _by_pyais(path)


def test_the_danish_sample_gives_the_positions_of_pyais_alone_and_loses_no_message():
    path = shared("data/ais_denmark_nmea/stream_example.txt")
    data = path.read_bytes()
    ours, theirs = _by_us(data), _by_pyais(path)
    assert ours == theirs
    assert sum(ours[1].values()) == 4051
    assert read_sentences(data).damage == ()
    document = read_ais(data, name="x")
    kept = {d.code: d.count for d in document.reference.damage}
    ships = [key for key, n in ours[0].items() for _ in range(n) if abs(key[1]) <= 90]
    left_out = sum(n for code, n in kept.items() if code != "bad-position")
    assert len(document.reference.t_ns) + left_out == len(ships)


def test_gzip_and_zip_of_one_file_are_unpacked():
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a.csv", LINES)
    assert unpacked(gzip.compress(LINES), name="x") == LINES
    assert unpacked(gzip.compress(LINES) * 2, name="x") == LINES * 2
    assert unpacked(packed.getvalue(), name="x") == LINES
    assert unpacked(LINES, name="x") == LINES


def test_what_can_not_be_unpacked_is_an_error_of_one_line():
    several = io.BytesIO()
    with zipfile.ZipFile(several, "w") as archive:
        archive.writestr("a", b"1")
        archive.writestr("b", b"2")
    packed = gzip.compress(bytes(3_000_000))
    bad = [several.getvalue(), several.getvalue()[:40], packed[:-30], packed[:12] + b"\xff" * 40, b"PK\x03\x04"]
    for data in bad:
        with pytest.raises(InputError, match=r"^x: ") as caught:
            unpacked(data, name="x")
        assert "\n" not in str(caught.value)
    with pytest.raises(InputError, match="more than 1 MiB"):
        unpacked(packed, name="x", most=1 << 20)
