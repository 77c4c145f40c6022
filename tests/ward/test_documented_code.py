"""Every Python example of the tutorial and of the page on subscribing runs as it is printed, in a ward of real processes."""

import re
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from bridge.sim.motion import Still
from bridge.sim.motion_scripts import swing
from estimator.demo.ward import WARD, Ward
from tests.estimator.stream import calibration
from tests.ward.parts import add_simulated

pytestmark = [pytest.mark.ward, pytest.mark.xdist_group("ward"), pytest.mark.timeout(240)]
DOCS = Path(__file__).parents[2] / "docs"
EXAMPLES = [
    pytest.param(code, id=f"{page}-{number}")
    for page in ("tutorial", "subscribe")
    for number, code in enumerate(
        re.findall(r"```python\n(.*?)```", (DOCS / f"{page}.md").read_text("utf-8"), re.DOTALL)
    )
    if "tls/" not in code
]


@pytest.fixture(scope="module")
def ward(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Ward]:
    """A simulated device, and a recording without accelerometer whose rest after a minute of movement makes a revision."""
    rng = np.random.default_rng(5)
    life = calibration(seed=5, after=[*(swing(rng, 6.0, np.radians(90.0)) for _ in range(10)), Still(20.0)])
    with Ward(tmp_path_factory.mktemp("ward"), ()) as ward:
        np.savez(ward.folder / "chest.npz", gyro_rad_s=life.gyro, t_s=life.time)
        add_simulated(ward, ["wrist-left"], speed=4.0)
        ward.start("router", "bridge", "estimator")
        ward.wait_for_router()
        yield ward


@pytest.mark.parametrize("code", EXAMPLES)
def test_an_example_runs_as_printed(code: str, ward: Ward) -> None:
    """Only the address differs: the tests' router has a port of its own."""
    here = code.replace('Client(ward="demo")', f'Client({ward.endpoint!r}, ward="{WARD}")')
    replay = [
        "bridge",
        "replay",
        str(ward.folder / "chest.npz"),
        "--device",
        "chest",
        "--config",
        str(ward.config),
        "--speed",
        "10",
    ]
    ran = subprocess.Popen([sys.executable, "-c", here], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    played, deadline = None, time.monotonic() + 200.0
    while ran.poll() is None and time.monotonic() < deadline:
        if played is None or played.poll() is not None:  # an example that was slow to begin needs it once more
            played = subprocess.Popen([sys.executable, "-m", "estimator.cli.main", *replay])
        time.sleep(0.1)
    for one in (ran, played):
        if one is not None:
            one.kill()
            one.wait()
    assert ran.stdout is not None
    assert ran.stderr is not None
    assert ran.returncode == 0, ran.stderr.read()
    assert ran.stdout.read().strip()
