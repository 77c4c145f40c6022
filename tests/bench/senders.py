"""Many devices that speak the native protocol at little cost, in a process of their own: on terminals, TCP or UDP.

Ticks are the host's microseconds at the moment of writing, so that whoever hears a sample knows how long it was under way.
Run by `bridge_load`; prints the ports as a JSON list, then sends until its standard input ends.
"""

import contextlib
import json
import os
import secrets
import select
import socket
import sys
import time
import tty
from collections.abc import Callable

import numpy as np

from bridge.framing.cobs_frames import frame
from bridge.framing.packets import Data, Hello, encode_data, encode_hello

RATE_HZ = 104.0
_GYRO_RANGE = 4.36
_HELLO_S = 1.0


class Sender:
    """One device: what it says at a time, and where to."""

    def __init__(self, write: Callable[[bytes], object], per_packet: int) -> None:
        self._write = write
        self._n = per_packet
        self._boot = secrets.randbits(63)
        self._hello = frame(encode_hello(Hello(self._boot, 1e-6, RATE_HZ, _GYRO_RANGE, True, True, "bench", "1")))
        self._hello_at_s = 0.0
        self._sequence = 0
        self._gyro = np.random.default_rng(self._boot).normal(0, 0.1, (per_packet, 3)).astype(np.float32)
        self._accel = np.tile(np.array([0, 0, 9.81], np.float32), (per_packet, 1))
        self._celsius = np.full(per_packet, 30, np.float32)
        self._share = np.arange(1, per_packet + 1) / per_packet
        self._last_us = time.time_ns() // 1000

    def turn(self, now_s: float) -> None:
        """A packet, and who it is from once a second."""
        if now_s >= self._hello_at_s:
            self._hello_at_s = now_s + _HELLO_S
            self._send(self._hello)
        now_us, then_us = time.time_ns() // 1000, self._last_us
        ticks = ((then_us + (self._share * (now_us - then_us)).astype(np.int64)) & 0xFFFFFFFF).astype(np.uint32)
        self._last_us = now_us
        self._send(frame(encode_data(Data(self._boot, self._sequence, ticks, self._gyro, self._accel, self._celsius))))
        self._sequence += self._n

    def _send(self, data: bytes) -> None:
        with contextlib.suppress(OSError):  # nobody is there yet, or any more
            self._write(data)


def terminals(n: int) -> tuple[list[str], list[Callable[[bytes], object]]]:
    """Pseudo-terminals."""
    ports, writes = [], []
    for _ in range(n):
        master, slave = os.openpty()
        tty.setraw(slave)
        os.set_blocking(master, False)
        ports.append(os.ttyname(slave))
        writes.append(lambda data, master=master: os.write(master, data))
    return ports, list[Callable[[bytes], object]](writes)


def tcp(n: int) -> tuple[list[str], list[Callable[[bytes], object]]]:
    """TCP servers; each takes one client."""
    ports, writes = [], []
    for _ in range(n):
        server = socket.create_server(("127.0.0.1", 0))
        server.setblocking(False)
        ports.append(f"tcp://127.0.0.1:{server.getsockname()[1]}")
        writes.append(_served(server))
    return ports, list[Callable[[bytes], object]](writes)


def udp(n: int) -> tuple[list[str], list[Callable[[bytes], object]]]:
    """Hosts of their own that send to one port."""
    with socket.socket(type=socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    ports, writes = [], []
    for i in range(n):
        host = f"127.0.{1 + i // 200}.{1 + i % 200}"
        sender = socket.socket(type=socket.SOCK_DGRAM)
        sender.bind((host, 0))
        ports.append(f"udp://127.0.0.1:{port}?from={host}")
        writes.append(lambda data, sender=sender: sender.sendto(data, ("127.0.0.1", port)))
    return ports, list[Callable[[bytes], object]](writes)


def _served(server: socket.socket) -> Callable[[bytes], object]:
    client: list[socket.socket] = []

    def write(data: bytes) -> None:
        if not client:
            client.append(server.accept()[0])
            client[0].setblocking(False)
            client[0].setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        client[0].send(data)

    return write


def main(kind: str, n: int, per_packet: int) -> None:
    """Send until nobody listens to this process any more."""
    ports, writes = {"pty": terminals, "tcp": tcp, "udp": udp}[kind](n)
    sys.stdout.write(json.dumps(ports) + "\n")
    sys.stdout.flush()
    senders = [Sender(write, per_packet) for write in writes]
    period_s = per_packet / RATE_HZ
    begun_s = time.monotonic()
    turn = 0
    while True:
        due_s = begun_s + turn * period_s / n
        wait_s = due_s - time.monotonic()
        # One system call tells both that it is time and that it is over.
        if select.select([sys.stdin], [], [], max(0.0, wait_s) if turn % 16 == 0 or wait_s > 0 else 0)[0]:
            return
        senders[turn % n].turn(time.monotonic())
        turn += 1


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]))
