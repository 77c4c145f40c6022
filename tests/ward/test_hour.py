"""An hour of a ward, faster than life where TRUERATE_SPEED says so: nothing grows, and the filters stay honest.

Only in `make soak`: of a dozen seconds nobody can tell growth from what comes and goes, or a filter that is off from chance.
"""

import os
import time
from contextlib import suppress
from pathlib import Path
from statistics import median
from typing import NamedTuple

import pytest
from prometheus_client.parser import text_string_to_metric_families

from estimator.demo.subscribers import Watcher
from estimator.demo.ward import WARD, Ward, free_port
from tests.bridge.asking import get
from tests.ward.parts import add_simulated, wait

pytestmark = [
    pytest.mark.ward,
    pytest.mark.soak,
    pytest.mark.timeout(7200),
    pytest.mark.skipif("TRUERATE_SOAK" not in os.environ, reason="takes an hour: make soak"),
]
EVERY_S = 1.0
#: of each simulated device
RATE_HZ, LIVES_S = 104.0, 3600.0
#: of most looks at a device: the mean over a ward's devices, and each; 1 is what it should be, less where a short rest is
#: believed with caution
NIS, NIS_EACH = (0.3, 1.5), (0.15, 2.0)


class Look(NamedTuple):
    """One look at the estimator: MB, numbers, what its metrics say."""

    rss_mb: float
    threads: int
    files: int
    values: dict[str, float]  # of the ward
    nis: dict[str, float]  # of each device
    lived_s: float  # of the device that has sent least, since it was switched on


def own_threads(pid: int) -> int:
    """How many are ours: zenoh names its own, and keeps one for ten seconds after it had too much to do."""
    process, count = Path(f"/proc/{pid}"), 0
    own = (process / "comm").read_text(encoding="ascii")
    for task in (process / "task").iterdir():
        with suppress(OSError):  # it has ended
            count += (task / "comm").read_text(encoding="ascii") == own
    return count


def look(port: int, pid: int) -> Look:
    values: dict[str, float] = {}
    nis: dict[str, float] = {}
    lived_s: list[float] = []
    for family in text_string_to_metric_families(get(port, "/metrics")[1]):
        for sample in family.samples:
            if sample.name == "truerate_nis":
                nis[sample.labels["device"]] = sample.value
            elif sample.name == "truerate_samples_in_total":
                lived_s.append(sample.value / RATE_HZ)
            elif not sample.labels:
                values[sample.name] = sample.value
            elif "what" in sample.labels:
                values[sample.labels["what"]] = sample.value
    rss_mb = values["process_resident_memory_bytes"] / 2**20
    return Look(rss_mb, own_threads(pid), int(values["process_open_fds"]), values, nis, min(lived_s, default=0.0))


def test_an_hour_of_a_ward_leaves_it_as_it_was(tmp_path: Path) -> None:
    speed = float(os.environ.get("TRUERATE_SPEED", "1"))
    devices = int(os.environ.get("TRUERATE_DEVICES", "100"))
    names = [f"d{number:03d}" for number in range(devices)]
    with Ward(tmp_path, ()) as ward:
        add_simulated(ward, names, speed, "ward")
        port, text = free_port(), ward.config.read_text(encoding="utf-8")
        text = text.replace('id = "estimator-1"', f'id = "estimator-1"\nhealth = "127.0.0.1:{port}"')
        ward.config.write_text(text, encoding="utf-8")
        ward.start("router", "estimator", "bridge")
        ward.wait_for_router()
        watcher = Watcher(ward.endpoint, WARD)
        try:
            wait("calibrations", lambda: watcher.all_tracking(devices), watcher, ward, 60 / speed + 2 * devices + 60)
        finally:
            watcher.close()
        pid = ward._processes["estimator"].pid
        looks = [look(port, pid)]  # by the devices' clocks: a machine that is busy simulates more slowly
        while looks[-1].lived_s - looks[0].lived_s < LIVES_S:
            time.sleep(EVERY_S)
            looks.append(look(port, pid))
            ward.check()
    settled = looks[len(looks) // 2 :]  # caches fill up first
    early, late = settled[: len(settled) // 3], settled[-(len(settled) // 3) :]
    grown_mb = median(one.rss_mb for one in late) - median(one.rss_mb for one in early)
    last = looks[-1]
    nis = [median(one.nis[device] for one in settled if device in one.nis) for device in last.nis]
    mean_nis = sum(nis) / len(nis)
    print(  # noqa: T201 - a soak says what it found
        f"{devices} devices, {LIVES_S:g} s at {speed:g} times: {last.rss_mb:.0f} MB, grown by {grown_mb:.2f}; "
        f"threads {early[0].threads} to {last.threads}, files {early[0].files} to {last.files}; NIS {mean_nis:.2f} "
        f"({min(nis):.2f} to {max(nis):.2f}); { ({k: v for k, v in last.values.items() if ' ' in k}) }"
    )
    # From third to third of the later half of an hour: 10 minutes.
    assert grown_mb < 0.01 * last.rss_mb
    # What is there for a moment, as a thread that answers, is no leak.
    assert min(one.threads for one in late) <= max(one.threads for one in early)
    assert min(one.files for one in late) <= max(one.files for one in early)
    assert NIS[0] < mean_nis < NIS[1]
    assert NIS_EACH[0] < min(nis)
    assert max(nis) < NIS_EACH[1]
    assert last.values["truerate_law_violations_all_total"] == 0
    assert "sessions failed" not in last.values
