"""`maritrack record` and `maritrack play`, in processes of their own, over the loopback interface."""

from __future__ import annotations

import io
import json
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from maritrack_cli import live
from maritrack_cli.record import _progress

from maritrack.errors import MaritrackError
from maritrack.io.containers.kinds import open_container
from maritrack.io.containers.writers import open_writer
from maritrack.io.datagrams import Stream
from maritrack.io.octets import octets_from_file
from maritrack.live.record import Tally
from maritrack.live.sockets import granted_octets, receiving_socket, sending_socket
from tests.bench.bench_record import free_port, payload
from tests.cli.calling import COMMAND, call, spawn, start

GROUP = "239.255.77.22"
START_NS = 1_750_000_000 * 10**9
PATIENCE_S = 20.0
KINDS = (".pcap", ".mcap", ".final", ".pcap.gz")


def write_recording(path: Path, payloads: list[bytes], *, step_ns: int = 200_000) -> Path:
    """A recording of datagrams that came one step after the other."""
    writer = open_writer(path)
    for i, one in enumerate(payloads):
        assert writer.write(one, t_ns=START_NS + i * step_ns, stream=Stream("192.0.2.7:4000", "239.0.1.2:8600"))
    writer.close()
    return path


def payloads_of(path: Path) -> list[bytes]:
    """The payloads of a recording in any container."""
    found = []
    for d in open_container(octets_from_file(path, "")).datagrams():
        found += [d.data[a:b] for a, b in zip(d.bounds, d.bounds[1:], strict=False)]
    return found


def times_of(path: Path) -> list[int]:
    return [t for d in open_container(octets_from_file(path, "")).datagrams() for t in d.t_ns.tolist()]


@contextmanager
def recording(out: Path, *options: str, port: int) -> Iterator[subprocess.Popen[bytes]]:
    """`record` that has begun to listen."""
    with start("record", "--port", str(port), "--interface", "127.0.0.1", "-o", out, *options) as process:
        assert process.stderr is not None
        told = process.stderr.readline()
        assert told.startswith(b"listening"), told + process.stderr.read()
        yield process


def ended(process: subprocess.Popen[bytes], number: int = signal.SIGINT) -> tuple[int, str, str]:
    """Exit code, standard output and standard error after a signal."""
    process.send_signal(number)
    out, err = process.communicate(timeout=60)
    return process.returncode, out.decode(), err.decode()


def send(port: int, payloads: list[bytes], host: str = "127.0.0.1") -> None:
    sock, to = sending_socket(f"{host}:{port}", interface="127.0.0.1")
    with sock:
        for one in payloads:
            sock.sendto(one, to)


def wait_for(size: int, path: Path) -> None:
    """Until a file has at least so many datagrams that others can read."""
    until = time.monotonic() + PATIENCE_S
    while time.monotonic() < until:
        if path.exists() and path.stat().st_size and len(payloads_of(path)) >= size:
            return
        time.sleep(0.05)
    raise AssertionError(f"{path} is not readable up to datagram {size}")


@pytest.fixture
def multicast() -> str:
    """A group that works within this machine, or a skip."""
    try:
        port = free_port()
        with receiving_socket(port=port, group=GROUP, interface="127.0.0.1") as sock:
            sock.settimeout(1.0)
            send(port, [b"x"], GROUP)
            sock.recv(10)
    except (OSError, MaritrackError) as error:
        pytest.skip(f"no multicast on this machine's loopback interface: {error}")
    return GROUP


SOME = [payload(i, 300) for i in range(200)]


# --- record, and play what was recorded


def test_5000_datagrams_a_second_come_back_in_order_and_again(tmp_path: Path, multicast: str) -> None:
    with receiving_socket(port=free_port(), interface="127.0.0.1") as sock:
        rate = 5000 if granted_octets(sock) >= 1 << 22 else 1000  # a kernel that holds 40 ms loses on a busy machine
    sent = [payload(i, 1400) for i in range(2 * rate)]
    source = write_recording(tmp_path / "source.pcap", sent, step_ns=10**9 // rate)
    for out in (tmp_path / "first.pcap", tmp_path / "second.mcap"):
        port = free_port()
        with recording(out, "--group", multicast, "--json", port=port) as process:
            to = f"{multicast}:{port}"
            played = spawn("play", source, "--to", to, "--interface", "127.0.0.1", "--json")
            code, text, _ = ended(process)
        told = json.loads(text)
        assert played.code == 0 and (played.json["datagrams"], played.json["octets"]) == (2 * rate, 2800 * rate)
        assert (code, told["datagrams"], told["octets"], told["lost"]) == (0, 2 * rate, 2800 * rate, 0)
        assert told["sensors"] == [{"id": "7-42", "datagrams": 2 * rate}] and told["ended"] == "stopped"
        assert [s["destination"] for s in told["streams"]] == [to]
        assert payloads_of(out) == sent
        assert times_of(out) == sorted(times_of(out)) and times_of(out)[0] > START_NS
        source = out


@pytest.mark.parametrize("kind", [*KINDS, ".cat240", ".cat240.gz"])
def test_every_kind_of_file_is_recorded(tmp_path: Path, kind: str) -> None:
    out, port = tmp_path / f"rec{kind}", free_port()
    with recording(out, port=port) as process:
        send(port, SOME)
        code, text, _ = ended(process)
    assert code == 0 and f"{out}: 200 datagrams, 60 kB" in text and "0 lost" in text and "7-42" in text
    assert payloads_of(out) == SOME and sorted(p.name for p in tmp_path.iterdir()) == [out.name]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_to_end_finishes_the_file(tmp_path: Path, number: int) -> None:
    out, port = tmp_path / "rec.pcap", free_port()
    with recording(out, "--json", port=port) as process:
        send(port, SOME)
        code, text, err = ended(process, number)
    assert (code, err, json.loads(text)["datagrams"]) == (0, "", 200)
    assert payloads_of(out) == SOME and not out.with_name("rec.pcap.partial").exists()


@pytest.mark.parametrize("kind", KINDS)
def test_a_kill_leaves_what_came_until_the_last_second(tmp_path: Path, kind: str) -> None:
    out, port = tmp_path / f"rec{kind}", free_port()
    partial = out.with_name(out.name + ".partial")
    with recording(out, port=port) as process:
        send(port, SOME)
        wait_for(200, partial)
        process.kill()
        process.wait(timeout=60)
    assert payloads_of(partial) == SOME and not out.exists()


def test_a_recording_ends_after_its_time_or_its_size(tmp_path: Path) -> None:
    port = free_port()
    with recording(tmp_path / "a.pcap", "--max-octets", "3000", "--json", port=port) as process:
        send(port, SOME)
        out, _ = process.communicate(timeout=60)
    told = json.loads(out)
    assert (process.returncode, told["datagrams"], told["ended"]) == (0, 10, "size")
    with recording(tmp_path / "b.pcap", "--duration", "0.5", "--json", port=port) as process:
        send(port, SOME[:7])
        out, _ = process.communicate(timeout=60)
    told = json.loads(out)
    assert (process.returncode, told["datagrams"], told["ended"]) == (0, 7, "duration")


def test_silence_is_an_error_with_a_hint_and_leaves_nothing(tmp_path: Path) -> None:
    done = call("record", "--port", free_port(), "--interface", "127.0.0.1", "--duration", "0.2", "-q",
                "-o", tmp_path / "rec.pcap")  # fmt: skip
    assert done.code == 2 and "no datagram" in done.error and "interface" in done.err and "firewall" in done.err
    assert list(tmp_path.iterdir()) == []


def test_what_a_file_cannot_hold_is_told_and_no_success(tmp_path: Path) -> None:
    out, port = tmp_path / "rec.cat240", free_port()
    with recording(out, "--json", port=port) as process:
        send(port, [SOME[0], b"$GPRMC,123519,A", SOME[1]])
        code, text, _ = ended(process)
    assert (code, json.loads(text)["datagrams"], json.loads(text)["unfit"]) == (1, 2, 1)
    assert payloads_of(out) == SOME[:2]
    other = tmp_path / "other.cat240"
    with recording(other, port=port) as process:
        send(port, [b"text"])
        code, text, err = ended(process)
    assert code == 2 and "none that this file can hold" in err and not other.exists()


def test_other_traffic_is_kept_in_a_capture_and_told(tmp_path: Path) -> None:
    out, port = tmp_path / "rec.pcap", free_port()
    with recording(out, port=port) as process:
        send(port, [b"$GPRMC,123519,A", SOME[0]])
        code, text, _ = ended(process)
    assert code == 0 and "1 of the datagrams hold no CAT240" in text
    assert b"$GPRMC,123519,A" in out.read_bytes()


def test_a_recording_that_is_there_is_not_written_over(tmp_path: Path) -> None:
    out = tmp_path / "rec.pcap"
    for there in (out, tmp_path / "rec.pcap.partial"):
        there.write_bytes(b"precious")
        done = call("record", "--port", free_port(), "-o", out)
        assert done.code == 2 and str(there) in done.error and there.read_bytes() == b"precious"
        there.unlink()
    out.write_bytes(b"precious")
    port = free_port()
    with recording(out, "--force", port=port) as process:
        send(port, SOME)
        assert ended(process)[0] == 0
    assert payloads_of(out) == SOME


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (("--port", "0"), "--port 0"),
        (("--port", "65536"), "--port 65536"),
        (("--port", "8600", "--duration", "0"), "--duration"),
        (("--port", "8600", "--duration", "nan"), "--duration"),
        (("--port", "8600", "--max-octets", "-1"), "--max-octets"),
        (("--port", "8600", "--group", "10.1.2.3"), "not a multicast address"),
        (("--port", "8600", "--interface", "no-such0"), "no-such0"),
    ],
)
def test_wrong_options_of_record_are_told_in_one_line(tmp_path: Path, options: tuple[str, ...], told: str) -> None:
    done = call("record", *options, "-o", tmp_path / "rec.pcap")
    assert done.code == 2 and told in done.error and list(tmp_path.iterdir()) == []


def test_a_folder_that_is_not_there_is_told_before_it_listens(tmp_path: Path) -> None:
    done = call("record", "--port", free_port(), "-o", tmp_path / "no" / "rec.pcap")
    assert done.code == 2 and "rec.pcap" in done.error
    done = call("record", "--port", free_port(), "-o", tmp_path / "rec.txt")
    assert done.code == 2 and "rec.txt" in done.error


def test_a_port_in_use_leaves_no_file(tmp_path: Path) -> None:
    port = free_port()
    with receiving_socket(port=port, interface="127.0.0.1"):
        done = call("record", "--port", port, "--interface", "127.0.0.1", "-o", tmp_path / "rec.pcap")
    assert done.code == 2 and str(port) in done.error and "another program" in done.err
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_is_told_and_what_fitted_is_kept(tmp_path: Path) -> None:
    limit = "import resource as r; r.setrlimit(r.RLIMIT_FSIZE, (20_000, 20_000)); "
    port = free_port()
    command = [sys.executable, "-c", limit + COMMAND[-1], "record", "--port", str(port), "--interface", "127.0.0.1"]
    command += ["-o", str(tmp_path / "rec.pcap")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stderr is not None
        process.stderr.readline()
        send(port, SOME)
        out, err = process.communicate(timeout=60)
    partial = tmp_path / "rec.pcap.partial"
    assert process.returncode == 2 and out == b"" and b"can't be written" in err and str(partial).encode() in err
    *kept, _cut = payloads_of(partial)
    assert 0 < len(kept) < 200 and kept == SOME[: len(kept)] and not (tmp_path / "rec.pcap").exists()


# --- play


@contextmanager
def listening() -> Iterator[tuple[int, list[bytes]]]:
    """A port, and what came to it after the block."""
    port, got, done = free_port(), list[bytes](), threading.Event()
    with receiving_socket(port=port, interface="127.0.0.1") as sock:
        sock.settimeout(0.2)

        def take() -> None:
            while True:
                try:
                    got.append(sock.recv(65_536))
                except TimeoutError:
                    if done.is_set():
                        return

        thread = threading.Thread(target=take)
        thread.start()
        try:
            yield port, got
        finally:
            done.set()
            thread.join()


@pytest.mark.parametrize("kind", [".pcap", ".mcap", ".final", ".cat240", ".cat240.gz"])
def test_a_recording_of_any_kind_is_sent_as_it_is(tmp_path: Path, kind: str) -> None:
    source = write_recording(tmp_path / f"rec{kind}", SOME, step_ns=10**6)
    with listening() as (port, got):
        done = call("play", source, "--to", f"127.0.0.1:{port}", "--speed", "4x", "--json")
    raw = kind.startswith(".cat240")
    assert done.code == 0 and got == SOME
    assert done.json["pace"] == ("time of day" if raw else "receive time") and done.json["warnings"] == {}
    assert done.json["recorded_seconds"] == pytest.approx(199 / 128 if raw else 0.199, abs=0.011)
    assert done.json["seconds"] >= done.json["recorded_seconds"] / 4


def test_the_simulated_harbour_plays(sample: Path) -> None:
    with listening() as (port, got):
        done = call("play", sample, "--to", f"127.0.0.1:{port}", "--speed", "max")
    assert done.code == 0 and "datagrams" in done.out and "late" not in done.out
    assert b"".join(got) == sample.read_bytes()


def test_standard_input_plays_once(sample: Path) -> None:
    with listening() as (port, got), sample.open("rb") as file:
        done = spawn("play", "-", "--to", f"127.0.0.1:{port}", "--speed", "max", "--json", stdin=file)
    assert done.code == 0 and b"".join(got) == sample.read_bytes()
    refused = call("play", "-", "--to", "127.0.0.1:9", "--loop")
    assert refused.code == 2 and "--loop" in refused.error


def test_of_a_run_its_recording_plays(finished_run: Path, sample: Path) -> None:
    with listening() as (port, got):
        done = call("play", finished_run / "run.mcap", "--to", f"127.0.0.1:{port}", "--speed", "max", "--json")
    assert done.code == 0 and len(got) == done.json["datagrams"] > 100
    assert sample.read_bytes().startswith(b"".join(got))


def test_only_the_stream_that_is_asked_for_is_sent(tmp_path: Path) -> None:
    writer = open_writer(tmp_path / "two.pcap")
    for i, one in enumerate(SOME):
        writer.write(one, t_ns=START_NS + i, stream=Stream(f"192.0.2.{i % 2}:4000", "239.0.1.2:8600"))
    writer.close()
    with listening() as (port, got):
        done = call("play", tmp_path / "two.pcap", "--to", f"127.0.0.1:{port}", "--stream", "192.0.2.1:4000")
    assert done.code == 0 and got == SOME[1::2]


def test_a_pause_is_cut_to_the_gap_that_is_allowed(tmp_path: Path) -> None:
    source = write_recording(tmp_path / "rec.pcap", SOME[:3], step_ns=3600 * 10**9)
    with listening() as (port, got):
        done = call("play", source, "--to", f"127.0.0.1:{port}", "--max-gap", "0.1")
    assert got == SOME[:3] and "2 pauses cut by 7199.8 s" in done.out


def test_a_loop_goes_on_until_it_is_interrupted(tmp_path: Path) -> None:
    source = write_recording(tmp_path / "rec.pcap", SOME[:5])
    with listening() as (port, got), start("play", source, "--to", f"127.0.0.1:{port}", "--loop", "--json") as process:
        until = time.monotonic() + PATIENCE_S
        while len(got) < 50 and time.monotonic() < until:
            time.sleep(0.02)
        code, text, err = ended(process)
    told = json.loads(text)
    assert (code, err) == (0, "") and told["passes"] >= 9 and told["datagrams"] == len(got)
    assert got == [SOME[i % 5] for i in range(len(got))]


def test_an_interrupted_play_says_how_far_it_came(tmp_path: Path) -> None:
    source = write_recording(tmp_path / "rec.pcap", SOME[:3], step_ns=9 * 10**9)
    with listening() as (port, got), start("play", source, "--to", f"127.0.0.1:{port}", "--json") as process:
        until = time.monotonic() + PATIENCE_S
        while not got and time.monotonic() < until:
            time.sleep(0.02)
        code, text, _ = ended(process)
    assert (code, json.loads(text)["datagrams"], got) == (130, 1, SOME[:1])


def test_what_is_no_recording_is_told(tmp_path: Path) -> None:
    for name, octets in (("empty", b""), ("text", b"no radar here\n" * 100)):
        (tmp_path / name).write_bytes(octets)
        done = call("play", tmp_path / name, "--to", "127.0.0.1:9", "--loop")
        assert done.code == 2 and str(tmp_path / name) in done.error
    assert "nowhere" in call("play", tmp_path / "nowhere", "--to", "127.0.0.1:9").error


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (("--to", "127.0.0.1"), "HOST:PORT"),
        (("--to", "127.0.0.1:9", "--speed", "fast"), "--speed"),
        (("--to", "127.0.0.1:9", "--speed", "0"), "--speed"),
        (("--to", "127.0.0.1:9", "--speed", "nan"), "--speed"),
        (("--to", "127.0.0.1:9", "--speed", "-2x"), "--speed"),
        (("--to", "127.0.0.1:9", "--max-gap", "-1"), "--max-gap"),
        (("--to", "127.0.0.1:9", "--max-gap", "nan"), "--max-gap"),
        (("--to", "239.0.1.2:9", "--ttl", "256"), "--ttl"),
        (("--to", "239.0.1.2:9", "--interface", "no-such0"), "no-such0"),
    ],
)
def test_wrong_options_of_play_are_told_in_one_line(sample: Path, options: tuple[str, ...], told: str) -> None:
    done = call("play", sample, *options)
    assert done.code == 2 and told in done.error


# --- what both share


def test_the_line_is_shown_on_a_terminal_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    for stream, quiet, shown in ((Terminal(), False, True), (Terminal(), True, False), (io.StringIO(), False, False)):
        monkeypatch.setattr(sys, "stderr", stream)
        with live.line(lambda state: f"at {state}", quiet=quiet) as show:
            show(3)
        assert ("at 3" in stream.getvalue()) == shown


def test_the_line_of_a_recording_tells_rate_losses_and_sensors() -> None:
    text = _progress()
    text(Tally(datagrams=100, octets=100_000, seconds=1.0))
    told = text(Tally(datagrams=300, octets=500_000, seconds=2.0, lost=4, sensors={"7-42": 300}))
    assert all(part in told for part in ("300 datagrams", "500 kB", "200/s", "400 kB/s", "4 lost", "7-42"))


def test_sizes_are_told_in_the_unit_that_fits() -> None:
    assert [live.size(n) for n in (0, 999, 14_000_000, 1.5e9, 2e12)] == [
        "0 octets", "999 octets", "14 MB", "1.5 GB", "2000 GB",
    ]  # fmt: skip


def test_the_first_interruption_asks_and_the_second_works_as_ever() -> None:
    before = signal.getsignal(signal.SIGINT)
    with live.interruption() as stopped:
        assert not stopped()
        signal.raise_signal(signal.SIGINT)
        assert stopped()
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is before


def test_a_signal_that_is_ignored_stays_ignored() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with live.interruption() as stopped:
            signal.raise_signal(signal.SIGHUP)
            assert not stopped()
    finally:
        signal.signal(signal.SIGHUP, before)
