"""Live radar video without the network's chances: heads, pace, the schedule of a player, sockets on this machine."""

from __future__ import annotations

import errno
import socket
import struct
import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from maritrack.errors import InputError, UsageError
from maritrack.io.containers.kinds import open_container
from maritrack.io.datagrams import NO_TIME, Datagrams, Stream
from maritrack.io.octets import octets_from_bytes, octets_from_file
from maritrack.live import batches, play
from maritrack.live.batches import ManyAtOnce, OneByOne, taker
from maritrack.live.heads import NO_HEAD, Head, read_head
from maritrack.live.pace import ANTENNA, RECEIVED, TIME_OF_DAY, Pace
from maritrack.live.play import LATE_NS, Clock, Player
from maritrack.live.receiver import Receiver
from maritrack.live.record import SIZE, STOPPED, Tally, record
from maritrack.live.sockets import dropped, endpoint, receiving_socket, resolved, sending_socket
from maritrack.types import Damage
from tests.io.cat240_blocks import block, video
from tests.shared import ROOT

MS, S = 1_000_000, 1_000_000_000
GROUP = "239.255.77.21"
GROUPS = (GROUP, "ff01::4d15")
TICK_NS = S // 128


def datagrams(payloads: list[bytes], t_ns: list[int] | None = None, *, damage: tuple[Damage, ...] = ()) -> Datagrams:
    bounds = np.cumsum([0, *map(len, payloads)])
    times = np.array([NO_TIME] * len(payloads) if t_ns is None else t_ns, dtype=np.int64)
    zeros = np.zeros(len(payloads), dtype=np.int64)
    return Datagrams(int(bounds[-1]), b"".join(payloads), bounds, bounds[:-1], times, zeros, damage)


def spoke(i: int, *, azimuth: int, tod: int | None, sac_sic: tuple[int, int] = (1, 2)) -> bytes:
    return block(video(i, azimuth=(azimuth % 65_536, (azimuth + 16) % 65_536), tod=tod, sac_sic=sac_sic))


def due_of(found: list[Datagrams], *, max_gap_s: float = 10.0) -> tuple[list[int], Pace]:
    pace = Pace(max_gap_ns=int(max_gap_s * S))
    return [at for d in found for at in pace.due(d).tolist()], pace


# --- heads


def test_a_head_is_read_from_any_make_of_record() -> None:
    payload = block(video(7, azimuth=(500, 516), tod=9000, sac_sic=(7, 42)))
    assert read_head(payload, 0, len(payload)) == Head(7 << 8 | 42, 500, 9000)
    nano = block(video(7, items={"040": struct.pack(">HHII", 3, 4, 0, 67), "SP": b"\2x"}, without=("041",), tod=5))
    assert read_head(nano, 0, len(nano))[1:] == (3, 5)
    untimed = block(video(7, azimuth=(9, 9), tod=None))
    assert read_head(untimed, 0, len(untimed))[1:] == (9, -1)


def test_a_head_is_found_behind_blocks_of_other_categories_and_nowhere_else() -> None:
    payload = b"\x30\0\x06abc" + spoke(1, azimuth=77, tod=3)
    assert read_head(b"??" + payload, 2, 2 + len(payload)).azimuth == 77
    assert read_head(b"$GPRMC,123519,A", 0, 15) == NO_HEAD
    assert read_head(b"", 0, 0) == NO_HEAD


@given(st.binary(max_size=80), st.booleans())
@settings(derandomize=True, deadline=None)
def test_no_octets_break_the_reader_of_heads(junk: bytes, like: bool) -> None:
    data = (b"\xf0\0\x40\xff\xfe\1\2\2" if like else b"") + junk
    assert len(read_head(data, 0, len(data))) == 3


# --- pace


@given(st.lists(st.integers(0, S), min_size=1, max_size=50), st.integers(1, 50), st.integers(0, 2**60))
@settings(derandomize=True, deadline=None)
def test_receive_times_are_kept_however_they_are_cut(steps: list[int], cut: int, start: int) -> None:
    t_ns = (start + np.cumsum(steps)).tolist()
    found = [datagrams([b"x"] * len(t_ns[i : i + cut]), t_ns[i : i + cut]) for i in range(0, len(t_ns), cut)]
    due, pace = due_of(found)
    assert due == [t - t_ns[0] for t in t_ns] and pace.kind == RECEIVED and pace.cuts == 0


def test_a_long_pause_is_cut_and_told() -> None:
    due, pace = due_of([datagrams([b"x"] * 4, [0, 1 * S, 3601 * S, 3602 * S])])
    assert due == [0, 1 * S, 11 * S, 12 * S]
    assert (pace.cuts, pace.cut_ns) == (1, 3590 * S)


def test_datagrams_out_of_order_do_not_make_it_longer() -> None:
    due, _ = due_of([datagrams([b"x"] * 5, [0, 30 * MS, 10 * MS, 20 * MS, 40 * MS])])
    assert due == [0, 30 * MS, 30 * MS, 30 * MS, 40 * MS]


def test_a_clock_that_is_set_back_goes_on() -> None:
    due, _ = due_of([datagrams([b"x"] * 4, [7200 * S, 7201 * S, 5 * S, 6 * S])])
    assert due == [0, 1 * S, 1 * S, 2 * S]


def test_a_datagram_without_a_time_goes_with_the_one_before() -> None:
    due, _ = due_of([datagrams([b"x"] * 3, [5 * S, NO_TIME, 7 * S])])
    assert due == [0, 0, 2 * S]


def test_another_pass_goes_on_after_the_usual_step() -> None:
    one = datagrams([b"x"] * 5, [0, S, 2 * S, 3 * S, 4 * S])
    due, pace = due_of([one])
    pace.again()
    assert pace.due(one).tolist() == [5 * S + at for at in due]


@pytest.mark.parametrize("part", [100, 1024, 1 << 20])
def test_a_raw_recording_keeps_the_time_of_day_of_its_records(part: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(play, "PART", part)
    sample = ROOT / "data" / "samples" / "harbour.cat240"
    whole = open_container(octets_from_file(sample, "")).datagrams()
    found = [part for d in whole for part in play._parts(d)]
    due, pace = due_of(found)
    tod = np.array([read_head(d.data, b, e).tod for d in found for b, e in pairwise(d.bounds.tolist())])
    assert pace.kind == TIME_OF_DAY and len(due) == len(tod) and (np.diff(due) >= 0).all()
    assert np.abs(np.array(due) - (tod - tod[0]) * TICK_NS).max() <= 2 * TICK_NS
    assert (np.diff(due) > 0).all()  # spread between the ticks


def test_time_of_day_goes_on_over_midnight() -> None:
    last = 86_400 * 128 - 64
    tods = [(last + 32 * i) % (86_400 * 128) for i in range(5)]
    due, _ = due_of([datagrams([spoke(i, azimuth=300 * i, tod=tod) for i, tod in enumerate(tods)])])
    assert due == [S // 4 * i for i in range(5)]


def test_without_any_time_the_antenna_turns_24_times_a_minute() -> None:
    due, pace = due_of([datagrams([spoke(i, azimuth=512 * i, tod=None) for i in range(257)])])
    assert due[128] == 2_500 * MS and due[256] == 5_000 * MS
    assert (pace.kind, pace.assumed) == (ANTENNA, True)


def test_sensors_whose_clocks_are_hours_apart_play_side_by_side() -> None:
    both = [
        spoke(i, azimuth=300 * i, tod=tod + 64 * i, sac_sic=(1, sic))
        for i in range(20)
        for sic, tod in ((1, 1000), (2, 500_000))
    ]
    due, pace = due_of([datagrams(both[:20]), datagrams(both[20:])])
    assert pace.cuts <= 1 and due[-1] <= 10 * S + 20 * S // 2


def test_a_sensor_that_comes_back_after_a_long_silence_is_not_hurried() -> None:
    first = [spoke(i, azimuth=300 * i, tod=1000 + 64 * i, sac_sic=(1, 2)) for i in range(10)]
    other = [spoke(i, azimuth=300 * i, tod=2000 + 64 * i, sac_sic=(1, 1)) for i in range(200)]
    again = [spoke(i, azimuth=300 * i, tod=99_000 + 64 * i, sac_sic=(1, 2)) for i in range(10)]
    due, _ = due_of([datagrams(first), datagrams(other), datagrams(again)])
    assert due[-1] - due[-10] >= 9 * S // 2 - S


# --- player


class Turned:
    """A clock that the player turns, and a socket that says when it was used."""

    family = socket.AF_INET

    def __init__(self, *, costs_ns: int = 0, full: int = 0, refuse: int = 0) -> None:
        self.now_ns, self.sent = 77, list[tuple[int, bytes]]()
        self._costs_ns, self._full, self._refuse = costs_ns, full, refuse

    def sleep_s(self, duration_s: float) -> None:
        self.now_ns += round(duration_s * 1e9)

    def sendto(self, payload: memoryview, _to: Any) -> int:
        self.now_ns += self._costs_ns
        if self._full:
            self._full -= 1
            raise OSError(errno.ENOBUFS, "full")
        if self._refuse:
            raise OSError(self._refuse, "refused")
        self.sent.append((self.now_ns - 77, bytes(payload)))
        return len(payload)

    def player(self, *, speed: float = 1.0, stop_after: int = 1 << 30) -> Player:
        pace = Pace(max_gap_ns=10 * S)
        clock = Clock(lambda: self.now_ns, self.sleep_s)
        stopped = lambda: len(self.sent) >= stop_after  # noqa: E731
        return Player(self, ("", 1), pace, speed=speed, stopped=stopped, clock=clock)  # type: ignore[arg-type]


@pytest.mark.parametrize("speed", [1.0, 4.0, 0.5])
def test_each_datagram_is_sent_when_it_is_due(speed: float) -> None:
    turned, t_ns = Turned(), [100 * S + 3 * MS * i for i in range(300)]
    player = turned.player(speed=speed)
    assert player.play([datagrams([b"%d" % i for i in range(300)], t_ns)])
    assert turned.sent == [(int(3 * MS * i / speed), b"%d" % i) for i in range(300)]
    assert player.sent.most_lag_ns == 0 and player.sent.recorded_ns == 299 * 3 * MS


def test_what_is_late_is_made_up_for() -> None:
    turned = Turned(costs_ns=2 * MS)
    player = turned.player()
    player.play([datagrams([b"x"] * 13, [*([0] * 10), 100 * MS, 101 * MS, 104 * MS])])
    assert [at for at, _ in turned.sent] == [*(2 * MS * i for i in range(1, 11)), 102 * MS, 104 * MS, 106 * MS]
    assert player.sent.most_lag_ns == 18 * MS and player.sent.slipped_ns == 0


def test_what_is_very_late_puts_the_schedule_off() -> None:
    turned = Turned()
    player = turned.player()
    player.play([datagrams([b"x"], [0])])
    turned.now_ns += 600 * S  # the computer slept
    player.play([datagrams([b"x"] * 3, [S, 2 * S, 3 * S])])
    assert [at for at, _ in turned.sent] == [0, 600 * S, 601 * S, 602 * S]
    assert player.sent.slipped_ns == 599 * S > LATE_NS


def test_as_fast_as_it_can_waits_for_nothing() -> None:
    turned = Turned()
    assert turned.player(speed=0.0).play([datagrams([b"x"] * 3, [0, 5 * S, 9 * S])])
    assert [at for at, _ in turned.sent] == [0, 0, 0]


def test_what_udp_cannot_carry_is_left_out_and_counted() -> None:
    turned = Turned()
    player = turned.player(speed=0.0)
    player.play([datagrams([b"a", bytes(65_508), bytes(65_507)])])
    assert [len(payload) for _, payload in turned.sent] == [1, 65_507] and player.sent.too_large == 1
    small = Turned(refuse=errno.EMSGSIZE).player(speed=0.0)
    assert small.play([datagrams([b"a"])]) and small.sent.too_large == 1


def test_a_system_without_room_is_waited_for() -> None:
    turned = Turned(full=5)
    player = turned.player()
    player.play([datagrams([b"a", b"b"], [0, 0])])
    assert [payload for _, payload in turned.sent] == [b"a", b"b"] and player.sent.waited == 5
    with pytest.raises(OSError, match="no room"):
        Turned(full=10**6).player().play([datagrams([b"a"], [0])])


def test_a_player_stops_within_a_pause_and_between_datagrams() -> None:
    turned = Turned()
    assert not turned.player(stop_after=1).play([datagrams([b"a", b"b"], [0, 9 * S])])
    assert len(turned.sent) == 1 and turned.now_ns < S
    fast = Turned()
    assert not fast.player(speed=0.0, stop_after=10).play([datagrams([b"x"] * 1000)])
    assert 10 <= len(fast.sent) < 100


def test_damage_of_the_recording_is_counted() -> None:
    player = Turned().player()
    player.play([datagrams([], damage=(Damage("lost-sync", 3, "junk", count=2),)), datagrams([b"a"], [0])])
    assert player.sent.damage == {"lost-sync": 2}


# --- sockets


@contextmanager
def pair(group: str = "", interface: str = "127.0.0.1") -> Iterator[tuple[Any, Any, Any]]:
    """A receiving socket, a sending one, and the address to send to."""
    host = group or interface
    port = free_port("::" if ":" in host else "")
    with receiving_socket(port=port, group=group, interface=interface) as receiving:
        sending, to = sending_socket(endpoint(host, port), interface=interface)
        with sending:
            yield receiving, sending, to


def free_port(host: str = "") -> int:
    with socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind((host, 0))
        port: int = sock.getsockname()[1]
        return port


class Kept:
    """A writer that keeps what it is given; every third datagram doesn't fit, where that is wanted."""

    def __init__(self, *, picky: bool = False) -> None:
        self.rows: list[tuple[bytes, int, Stream]] = []
        self._picky, self._n = picky, 0

    def write(self, payload: bytes, *, t_ns: int, stream: Stream) -> bool:
        self._n += 1
        if self._picky and self._n % 3 == 0:
            return False
        self.rows.append((payload, t_ns, stream))
        return True

    def flush(self) -> None: ...

    def close(self) -> None: ...

    def abort(self) -> None: ...


def multicast_interface(group: str) -> str:
    """An interface on which this machine hears a group from itself, or a skip. The groups stay on the machine."""
    names = ["127.0.0.1"] if "." in group else [name for _, name in socket.if_nameindex()]
    told = ""
    for name in names:
        try:
            with pair(group, interface=name) as (receiving, sending, to):
                receiving.settimeout(1.0)
                sending.sendto(b"x", to)
                receiving.recv(10)
                return name
        except (OSError, InputError) as error:
            told = str(error)
    pytest.skip(f"no multicast within this machine: {told}")


@pytest.mark.parametrize("make", [taker, lambda s: OneByOne(s, wall_ns=time.time_ns)], ids=["best", "plain"])
def test_what_is_sent_is_taken_with_time_and_addresses(make: Any) -> None:
    payloads = [bytes([i % 256]) * (i + 1) for i in range(600)]
    with pair() as (receiving, sending, to):
        take = make(receiving)
        before = time.time_ns()
        got, rows = [], []
        for first in range(0, 600, 100):
            for payload in payloads[first : first + 100]:
                sending.sendto(payload, to)
            while (batch := take.take(wait=False)) is not None:
                got += batch.payloads
                rows += [(t_ns, batch.stream(key)) for t_ns, key in batch.notes()]
        sender = f"127.0.0.1:{sending.getsockname()[1]}"
        assert got == payloads
        assert {stream for _, stream in rows} == {Stream(sender, f"127.0.0.1:{to[1]}")}
        assert all(before - S < t_ns < time.time_ns() + S for t_ns, _ in rows)


def test_many_datagrams_are_taken_at_once_where_the_system_can() -> None:
    with pair() as (receiving, sending, to):
        take = taker(receiving)
        if not isinstance(take, ManyAtOnce):
            pytest.skip("this system has no recvmmsg")
        for i in range(50):
            sending.sendto(bytes([i]) * 1400, to)
        batch = take.take(wait=True)
        assert batch is not None and len(batch.payloads) > 1
        assert take.take(wait=False) is None or len(batch.payloads) < 50


def test_the_largest_datagram_comes_whole() -> None:
    with pair() as (receiving, sending, to):
        sending.sendto(bytes(65_507), to)
        batch = taker(receiving).take(wait=True)
        assert batch is not None and batch.payloads == [bytes(65_507)]


@pytest.mark.parametrize("group", GROUPS)
def test_multicast_comes_with_its_group_as_destination(group: str) -> None:
    with pair(group, interface=multicast_interface(group)) as (receiving, sending, to):
        sending.sendto(b"hello", to)
        batch = taker(receiving).take(wait=True)
        assert batch is not None and batch.payloads == [b"hello"]
        ((_, key),) = batch.notes()
        assert batch.stream(key).destination == endpoint(group, to[1])


def test_ipv6_is_received_too() -> None:
    if not socket.has_ipv6:
        pytest.skip("no IPv6 on this machine")
    with pair(interface="::1") as (receiving, sending, to):
        sending.sendto(b"six", to)
        batch = taker(receiving).take(wait=True)
        assert batch is not None and batch.payloads == [b"six"]
        ((_, key),) = batch.notes()
        assert batch.stream(key) == Stream(endpoint("::1", sending.getsockname()[1]), endpoint("::1", to[1]))


def test_what_the_kernel_drops_is_counted_to_the_last() -> None:
    with pair() as (receiving, sending, to):
        if dropped(receiving) is None:
            pytest.skip("this system doesn't tell what it drops")
        receiving.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        for _ in range(500):
            sending.sendto(bytes(1400), to)
        kept, tally = Kept(), Tally()
        record(receiving, kept, tally, stopped=lambda: True)
        assert tally.lost is not None and tally.lost > 0
        assert tally.datagrams + tally.lost == 500 == len(kept.rows) + tally.lost


def test_what_has_come_before_the_end_is_still_recorded() -> None:
    with pair() as (receiving, sending, to):
        payloads = [spoke(i, azimuth=16 * i, tod=i, sac_sic=(7, i % 2)) for i in range(1000)]
        for payload in payloads:
            sending.sendto(payload, to)
        kept, tally = Kept(), Tally()
        record(receiving, kept, tally, stopped=lambda: True)
    assert [payload for payload, _, _ in kept.rows] == payloads
    assert tally.sensors == {"7-0": 500, "7-1": 500} and tally.other == 0 and tally.ended == STOPPED
    assert list(tally.streams.values()) == [1000]


def test_the_plain_way_records_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(batches, "LINUX", False)
    test_what_has_come_before_the_end_is_still_recorded()


def test_a_recording_ends_at_its_size() -> None:
    with pair() as (receiving, sending, to):
        for _ in range(10):
            sending.sendto(bytes(100), to)
        kept, tally = Kept(), Tally()
        record(receiving, kept, tally, stopped=lambda: False, max_octets=350)
    assert len(kept.rows) == 3 and tally.octets == 300 and tally.ended == SIZE


def test_what_the_file_cannot_hold_is_counted() -> None:
    with pair() as (receiving, sending, to):
        for _ in range(9):
            sending.sendto(b"text", to)
        tally = Tally()
        record(receiving, Kept(picky=True), tally, stopped=lambda: True)
    assert (tally.datagrams, tally.unfit, tally.other) == (6, 3, 6)


def test_a_full_store_leaves_the_rest_to_the_kernel() -> None:
    with pair() as (receiving, sending, to):
        receiver = Receiver(receiving, most_waiting=50_000)
        with receiver.running():
            for _ in range(2000):
                sending.sendto(bytes(1400), to)
            most = 0
            taken = 0
            for batch in receiver.batches(0.05):
                most = max(most, receiver.waiting)
                taken += len(batch.payloads) if batch is not None else 0
                if batch is None or taken == 2000:
                    receiver.end()
        assert taken + (dropped(receiving) or 0) == 2000
        assert most <= 50_000 + batches.MANY * 1800


@pytest.mark.parametrize(
    ("how", "told"),
    [
        ({"group": "10.0.0.1"}, "not a multicast address"),
        ({"group": "radar"}, "not an address"),
        ({"interface": "no-such0"}, "no-such0"),
        ({"group": "239.0.1.2", "interface": "::1"}, "same family"),
        ({"group": "ff02::1", "interface": "::1"}, "name it"),
    ],
)
def test_addresses_that_make_no_sense_are_told(how: dict[str, str], told: str) -> None:
    with pytest.raises(UsageError, match=told):
        receiving_socket(port=free_port(), **how)


@pytest.mark.parametrize(
    "to", ["", "8600", "host:", "host:0", "host:65536", ":8600", "host:port", "no.such.host.invalid:1"]
)
def test_targets_that_make_no_sense_are_told(to: str) -> None:
    with pytest.raises(UsageError):
        resolved(to)


def test_a_port_in_use_is_told_with_a_hint() -> None:
    with pair() as (receiving, _, _), pytest.raises(InputError) as told:
        receiving_socket(port=receiving.getsockname()[1], interface="127.0.0.1")
    assert "another program" in told.value.hint


def test_an_address_of_another_machine_is_told() -> None:
    with pytest.raises(InputError) as told:
        receiving_socket(port=free_port(), interface="203.0.113.9")
    assert "--interface" in told.value.hint


def test_two_programs_may_listen_to_one_group() -> None:
    multicast_interface(GROUP)
    with pair(GROUP) as (one, sending, to), receiving_socket(port=to[1], group=GROUP, interface="127.0.0.1") as other:
        sending.sendto(b"both", to)
        for sock in (one, other):
            sock.settimeout(1.0)
            assert sock.recv(10) == b"both"


def test_a_recording_without_datagrams_is_due_at_nothing() -> None:
    assert due_of([datagrams([])])[0] == []
    assert next(iter(open_container(octets_from_bytes(b"", name="x", channel="")).datagrams())).end == 0
