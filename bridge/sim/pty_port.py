"""Connects a virtual device to a real pseudo-terminal with a stable name, like udev's /dev/serial/by-id.

Programs see a serial port: it can be locked, set to any speed, unplugged and plugged in again.
"""

import fcntl
import os
import struct
import termios
import threading
import time
import tty
from collections.abc import Callable
from pathlib import Path
from typing import Self

from bridge.sim.virtual_device import VirtualDevice

_TURN_S = 0.01
_BLOCKED_S = 0.001
_READER_HOLDS = 4095  # bytes a Linux terminal buffers for a reader
_LONGEST_TURN_S = 0.25


class PtyPort:
    """Serial port of a virtual device: a pseudo-terminal served by its own thread; plugged in from the start.

    link: path of the symbolic link that names the port. speed: simulated seconds per real second.
    lossless: True stops the device's time while the reader has no room or the port is unplugged, so no byte is lost.
    False loses the bytes sent in that time, and counts them in `dropped_bytes`.
    byte_fault: function that damages the bytes on their way to the host; may be set and cleared at any time.
    """

    def __init__(
        self,
        device: VirtualDevice,
        link: Path,
        *,
        speed: float = 1.0,
        lossless: bool = False,
        byte_fault: Callable[[bytes], bytes] | None = None,
    ) -> None:
        self.device = device
        self.link = link
        self.byte_fault = byte_fault
        self.dropped_bytes = 0
        self._speed = speed
        self._lossless = lossless
        self._lock = threading.Lock()
        self._stop = threading.Event()
        self._master = self._slave = -1
        self._waiting = b""
        self._time_s = 0.0
        self.plug()
        self._thread = threading.Thread(target=self._run, name=f"pty {device.name}", daemon=True)
        self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *args: object) -> None:
        self.close()

    @property
    def device_time_s(self) -> float:
        """Simulated time for which the device has run, s."""
        return self._time_s

    def plug(self) -> None:
        """Plug the port in: create a new terminal under the same name; does nothing if plugged in."""
        with self._lock:
            if self._master >= 0:
                return
            self._master, self._slave = os.openpty()
            tty.setraw(self._slave)
            os.set_blocking(self._master, False)
            self.link.parent.mkdir(parents=True, exist_ok=True)
            # Renamed into place, so that the name always leads to the old terminal, nothing, or the new one.
            fresh = self.link.with_name(f".{self.link.name}.new")
            fresh.unlink(missing_ok=True)
            fresh.symlink_to(os.ttyname(self._slave))
            fresh.replace(self.link)

    def unplug(self) -> None:
        """Unplug the port: remove its name, and give a reader an error; does nothing if unplugged.

        The device keeps running, unless the port is lossless.
        """
        with self._lock:
            if self._master < 0:
                return
            self.link.unlink(missing_ok=True)
            os.close(self._master)
            os.close(self._slave)
            self._master = self._slave = -1
            if not self._lossless:
                self._drop(self._waiting)

    def close(self) -> None:
        """Unplug the port and end the device's thread; a second close does nothing."""
        self._stop.set()
        self._thread.join()
        self.unplug()

    def _run(self) -> None:
        then = time.monotonic()
        while not self._stop.wait(_BLOCKED_S if self._waiting else _TURN_S):
            now = time.monotonic()
            with self._lock:
                self._turn(now - then)
            then = now

    def _turn(self, elapsed_s: float) -> None:
        if self._master >= 0:
            self.device.receive(self._read())
        if self._lossless:
            self._send()
            if self._master < 0 or self._waiting:
                return  # the device's time stands still
            elapsed_s = min(elapsed_s, _LONGEST_TURN_S)
        self._time_s += elapsed_s * self._speed
        data = self.device.advance(self._time_s)
        self._waiting += data if self.byte_fault is None else self.byte_fault(data)
        self._send()
        if not self._lossless:
            self._drop(self._waiting)

    def _drop(self, data: bytes) -> None:
        self.dropped_bytes += len(data)
        self._waiting = b""

    def _read(self) -> bytes:
        try:
            return os.read(self._master, 4096)
        except BlockingIOError:
            return b""

    def _send(self) -> None:
        """Write as many bytes as the reader's buffer has room for; the rest stays in _waiting."""
        if self._master < 0 or not self._waiting:
            return
        # The kernel would buffer much more than a serial port, and deliver it late.
        held = struct.unpack("i", fcntl.ioctl(self._slave, termios.FIONREAD, b"\0" * 4))[0]
        room = max(0, _READER_HOLDS - held)
        if not room:
            return
        try:
            sent = os.write(self._master, self._waiting[:room])
        except BlockingIOError:
            return
        self._waiting = self._waiting[sent:]
