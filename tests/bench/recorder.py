"""What a recorder costs: 100 devices at 104 Hz, raw and corrected, batches of 50 ms, over a real router. `make bench`.

The processor time of its process, in percent of one core, after it has begun; goal 10 %.
"""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from rich.console import Console

from bridge.bus.zenoh_bus import ZenohBus
from bridge.recording.survey import survey
from tests.bridge.recording.crowd import RATE_HZ, WARD, Crowd

ENDPOINT, GOAL = "tcp/127.0.0.1:7541", 10.0
_TICKS = os.sysconf("SC_CLK_TCK")


def cpu_s(pid: int) -> float:
    """Processor seconds a process has used."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / _TICKS


def main(devices: int = 100, seconds: float = 30.0) -> None:
    """Print a line."""
    truerate = [sys.executable, "-m", "estimator.cli.main"]
    router = subprocess.Popen([*truerate, "router", "--listen", ENDPOINT], stderr=subprocess.DEVNULL)
    try:
        time.sleep(1.5)
        with tempfile.TemporaryDirectory() as folder, ZenohBus((ENDPOINT,)) as bus, Crowd(bus, devices) as crowd:
            time.sleep(1.0)
            words = ["record", "--ward", WARD, "--connect", ENDPOINT, "--out", folder]
            recorder = subprocess.Popen([*truerate, *words])
            time.sleep(8.0)
            before, since = cpu_s(recorder.pid), time.monotonic()
            time.sleep(seconds)
            used, lasted = cpu_s(recorder.pid) - before, time.monotonic() - since
            recorder.terminate()
            recorder.wait(30)
            until = crowd.sent_by(time.monotonic())
            (path,) = Path(folder).iterdir()
            found = survey([path])
            kept = [boot.samples for device in found.devices.values() for boot in device.boots.values()]
            missing = sum(boot.missing for device in found.devices.values() for boot in device.boots.values())
        Console().print(
            f"{devices} devices at {RATE_HZ:g} Hz: {100 * used / lasted:.1f} % of a core (goal {GOAL:g} %), "
            f"{found.size / found.duration_s / 1e3:.0f} kB/s; {sum(kept)} samples, {missing} missing, "
            f"{until * devices - sum(kept)} after the stop"
        )
    finally:
        router.terminate()
        router.wait(10)


if __name__ == "__main__":
    main(*(int(word) for word in sys.argv[1:]))
