"""How well Algorithm 1 does: many simulated sessions, recognised from the stream alone, against their truth."""

from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import track

from bridge.columns import Column, Columns
from bridge.recording import Recording
from bridge.sim.session import simulate_session
from bridge.wire.messages import Verdict
from estimator import figures, offline


def run(console: Console, sessions: int, noise_dps: float, wobble_deg: float, picture: Path) -> None:
    """Simulate, calibrate, compare; print a table and leave a picture."""
    k_error, bias_error, k_score, refused = [], [], [], 0
    for seed in track(range(sessions), "simulating and calibrating", console=console, transient=True):
        session = simulate_session(seed, noise_dps=noise_dps, wobble_deg=wobble_deg, rests_s=3.0, turn_s=(4.0, 6.0))
        recording = Recording(session.time_s, session.gyro, None, None, session.rate_hz, f"seed {seed}")
        result, _ = offline.calibrate(recording, "turn360")
        if result.verdict is not Verdict.ACCEPTED:
            refused += 1
            continue
        k_error.append(result.scale - session.truth.k)
        bias_error.append(np.degrees(result.bias - session.bias[0]))
        k_score.append(k_error[-1] / np.sqrt(np.diag(result.covariance)[3:]))
    if not k_error:
        console.print(f"None of {sessions} sessions was accepted: there is nothing to compare.")
        return
    k, bias = np.array(k_error), np.array(bias_error)
    table = Columns([Column(heading, number=True) for heading in ("", "rms", "median", "largest")])
    for name, error, form in (("scale factor k", k, ".2e"), ("bias °/s", bias, ".2e")):
        table.add(
            name,
            f"{np.sqrt(np.mean(error**2)):{form}}",
            f"{np.median(error):+{form}}",
            f"{np.abs(error).max():{form}}",
        )
    console.print(
        f"Algorithm 1: {sessions} sessions, noise {noise_dps:g} °/s, wobble {wobble_deg:g}°, bias from one rest of 3 s"
    )
    console.print(table)
    score = np.sqrt(np.mean(np.square(k_score)))
    console.print(
        f"k error / published standard deviation: rms {score:.2f}; {refused} of {sessions} sessions not accepted"
    )
    picture.parent.mkdir(parents=True, exist_ok=True)
    panels = {f"k_{axis}": (k[:, i], "error of k") for i, axis in enumerate("xyz")}
    panels["bias"] = bias.ravel(), "error in °/s, all axes"
    figures.histogram(panels, f"Algorithm 1 against truth, {sessions} simulated sessions", picture)
    console.print(f"Picture: {picture}")
