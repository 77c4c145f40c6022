"""Every Python example of the tutorial and of the page on subscribing runs as it is printed, in a ward of real processes."""

import re
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from bridge.sim.motion import Still
from bridge.sim.motion_scripts import swing
from estimator.demo.ward import WARD, Ward
from tests.estimator.stream import calibration
from tests.ward.parts import add_simulated

pytestmark = [pytest.mark.ward, pytest.mark.xdist_group("ward 2"), pytest.mark.timeout(240)]
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
        over = threading.Event()
        player = threading.Thread(target=_play, args=(ward, over))
        player.start()
        yield ward
        over.set()
        player.join()


def _play(ward: Ward, over: threading.Event) -> None:
    """Replay the recording again and again."""
    words = ["bridge", "replay", str(ward.folder / "chest.npz"), "--device", "chest", "--config", str(ward.config)]
    while not over.is_set():
        with subprocess.Popen([sys.executable, "-m", "estimator.cli.main", *words, "--speed", "10"]) as played:
            while played.poll() is None and not over.wait(0.1):
                pass
            played.terminate()


@pytest.mark.parametrize("code", EXAMPLES)
def test_an_example_runs_as_printed(code: str, ward: Ward) -> None:
    """Only the address differs: the tests' router has a port of its own."""
    here = code.replace('Client(ward="demo")', f'Client({ward.endpoint!r}, ward="{WARD}")')
    ran = subprocess.run([sys.executable, "-c", here], capture_output=True, text=True, timeout=200, check=False)
    assert ran.returncode == 0, ran.stderr
    assert ran.stdout.strip()
