"""Share of datagrams that `record` loses at rising rates, beside the floor: a loop of recvfrom and nothing more.

python -m tests.bench.bench_record [--seconds 5] [--octets 1400] [--rates 5000,10000,20000,40000] [--kinds pcap,mcap]

Over the loopback interface, sender and receiver on the same cores. The floor has the same receive buffer.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import time
from pathlib import Path

RECORD = "from maritrack_cli.main import main; main()"
FLOOR = """
import sys
from maritrack.live.sockets import receiving_socket
sock, n, silent = receiving_socket(port=int(sys.argv[1]), interface="127.0.0.1"), 0, 0
print("listening", file=sys.stderr, flush=True)
sock.settimeout(20.0)
try:
    while True:
        sock.recvfrom(65536)
        n += 1
        if n == 1:
            sock.settimeout(1.0)
except TimeoutError:
    print(n)
"""


def payload(i: int, octets: int) -> bytes:
    """A data block of CAT240 of so many octets: 8-bit cells in pieces of 64, time of day, and SP for the rest."""
    n, rest = divmod(octets - 36, 64)
    head = struct.pack(">BHHBBBI", 240, octets, 0xE7AA, 7, 42, 2, i)
    video = struct.pack(
        ">HHIIBBHBHB", 16 * i % 65_536, 16 * (i + 1) % 65_536, 0, 66_712_819, 0, 4, 64 * n, 0, 64 * n, n
    )
    return head + video + bytes([i % 251]) * 64 * n + i.to_bytes(3, "big") + bytes([rest + 1]) + bytes(rest)


def send(port: int, *, rate: int, seconds: float, octets: int) -> int:
    """Send at a rate, each datagram when it is due. How many were sent."""
    n = int(rate * seconds)
    some = [payload(i, octets) for i in range(1000)]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.connect(("127.0.0.1", port))
        begun = time.monotonic()
        for i in range(n):
            left = begun + i / rate - time.monotonic()
            if left > 0:
                time.sleep(left)
            sock.send(some[i % 1000])
        print(f"    sent at {n / (time.monotonic() - begun):.0f}/s", file=sys.stderr)
    return n


def run(*command: str, rate: int, seconds: float, octets: int, port: int, end: bool) -> tuple[int, int, float, str]:
    """Datagrams sent and received, CPU seconds of the receiver, and what it says was lost."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    with subprocess.Popen([sys.executable, "-c", *command], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stderr is not None and process.stdout is not None
        process.stderr.readline()
        idle = cpu_of(process.pid)
        sent = send(port, rate=rate, seconds=seconds, octets=octets)
        if end:
            process.send_signal(signal.SIGINT)
        out = process.stdout.read()
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime - idle
    if not end:
        return sent, int(out), cpu, ""
    told = json.loads(out)
    return sent, told["datagrams"], cpu, f", {told['lost']} of them by the kernel"


def cpu_of(pid: int) -> float:
    """CPU seconds that a process has used for its start."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.0.0.1", 0))
        return int(sock.getsockname()[1])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=5.0)
    parser.add_argument("--octets", type=int, default=1400)
    parser.add_argument("--rates", default="5000,10000,20000,40000")
    parser.add_argument("--kinds", default="pcap,mcap")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        for rate in map(int, args.rates.split(",")):
            how = {"rate": rate, "seconds": args.seconds, "octets": args.octets}
            for kind in ["floor", *args.kinds.split(",")]:
                port = free_port()
                out = Path(folder) / f"rec.{kind}"
                record = (
                    "record",
                    "--port",
                    str(port),
                    "--interface",
                    "127.0.0.1",
                    "-o",
                    str(out),
                    "--json",
                    "--force",
                )
                command = (FLOOR, str(port)) if kind == "floor" else (RECORD, *record)
                sent, got, cpu, told = run(*command, port=port, end=kind != "floor", **how)
                print(
                    f"{rate:6d}/s  {kind:6s} {sent - got:6d} of {sent} lost ({(sent - got) / sent:.3%}{told}), "
                    f"{1e6 * cpu / sent:.1f} us CPU a datagram",
                    flush=True,
                )
                out.unlink(missing_ok=True)


if __name__ == "__main__":
    main()
