"""Motion scripts drawn from a seed: calibration sessions, good or bad, and everyday motion of a wearer."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bridge.sim.motion import Motion, Piece, Spin, Still, Swing, Turn
from bridge.sim.quaternion import Array

SESSION_LEVER = (0.02, 0.01, 0.005)  # m; turned on a table, the sensor is near the centre
WORN_LEVER = (0.25, 0.02, 0.03)  # m; worn on a forearm
_WOBBLE_HARMONICS = 4
_SWING_HARMONICS = 3


@dataclass(frozen=True, slots=True)
class TurnPlan:
    """Plan of one hand-made turn about a sensor axis; a negative angle_deg turns in the other direction.

    axis: 0 for x, 1 for y, 2 for z. duration_s: None draws the duration. goes: number of pushes of the hand.
    swing: True replaces the turn: the device is picked up and put down in another pose. The rate then never
    exceeds the peak rate of a minimum-jerk turn by angle_deg in the same duration.
    """

    axis: int
    angle_deg: float = 360.0
    duration_s: float | None = None
    goes: int = 1
    swing: bool = False


@dataclass(frozen=True, slots=True)
class SessionPlan:
    """Plan of a calibration session: still, turn, still, turn … still.

    rests_s: duration of every rest, or one duration for each of the rests (number of turns + 1).
    turns: plans of the turns; None draws one turn about each axis, in any order and direction.
    turn_s: shortest and longest duration of a turn whose plan has none, s.
    wobble_deg: largest tilt of a turn's axis during the turn; the turn still closes exactly.
    tilt_deg: largest angle between a turn's axis and the sensor axis.
    replacement_deg: closure error of a turn (end attitude against start attitude), standard deviation per axis.
    """

    rests_s: float | tuple[float, ...] = 3.2
    turns: tuple[TurnPlan, ...] | None = None
    turn_s: tuple[float, float] = (3.5, 6.0)
    wobble_deg: float = 0.0
    tilt_deg: float = 0.0
    replacement_deg: float = 0.0


def session(rng: np.random.Generator, plan: SessionPlan | None = None) -> list[Piece]:
    """Draw the pieces of motion of a calibration session: rests at even positions, turns at odd ones.

    plan: None for SessionPlan(). Raises ValueError if the number of rests does not fit the number of turns.
    """
    plan = plan or SessionPlan()
    turns = any_three_turns(rng) if plan.turns is None else plan.turns
    rests = plan.rests_s if isinstance(plan.rests_s, tuple) else (plan.rests_s,) * (len(turns) + 1)
    if len(rests) != len(turns) + 1:
        raise ValueError(f"{len(turns)} turns need {len(turns) + 1} rests, not {len(rests)}")
    pieces: list[Piece] = [Still(rests[0])]
    for turn, rest in zip(turns, rests[1:], strict=True):
        pieces += [_turn(rng, plan, turn), Still(rest)]
    return pieces


def poses(rng: np.random.Generator, movements: int, *, rest_s: float = 3.0, turn_s: float = 2.0) -> list[Piece]:
    """Draw the motion of a device laid down in one pose after another, resting for rest_s in each.

    movements: number of movements between poses. Each movement turns by 60 to 170 degrees within turn_s, about any
    axis, with a wobbling hand.
    """
    pieces: list[Piece] = [Still(rest_s)]
    for _ in range(movements):
        axis = rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        angle = rng.choice([-1, 1]) * rng.uniform(np.radians(60), np.radians(170))
        wobble = np.radians(rng.normal(size=(_WOBBLE_HARMONICS, 3)))
        goes = np.array([[0.0, turn_s, 1.0]])
        pieces += [Turn(turn_s, axis, float(angle), goes, wobble, lever=SESSION_LEVER), Still(rest_s)]
    return pieces


def machine(
    mounts: Array, rates_dps: tuple[float, ...], *, rest_s: float = 3.0, spin_s: float = 5.0, up: Array | None = None
) -> list[Piece]:
    """Return the motion on a turntable or servo with a vertical axis: each rate, in each mounting of the sensor.

    mounts (m, 3): unit vector in sensor axes that points up, per mounting. rates_dps: constant rate of each spin, °/s.
    rest_s, spin_s: duration of each rest and spin. up (3,): unit vector in sensor axes that points up at the start;
    None for z.
    In each mounting, rests and spins alternate. A movement of 1 s leads to the next mounting.
    """
    up = np.array([0.0, 0.0, 1.0]) if up is None else up
    pieces: list[Piece] = [Still(rest_s)]
    for mount in mounts:
        if (turn := tipped(up, mount, 1.0)).angle > 1e-9:
            pieces += [turn, Still(rest_s)]
        for rate in np.radians(rates_dps):
            pieces += [Spin(spin_s, mount, float(rate)), Still(rest_s)]
        up = mount
    return pieces


def tipped(up: Array, then: Array, duration_s: float, wobble: Array | None = None) -> Turn:
    """Return the turn, in one push, after which the vector `then` points up instead of `up`.

    up, then (3,): unit vectors in sensor axes. duration_s: duration of the turn. wobble (h, 3): as in Turn, rad; None
    for no wobble.
    """
    across = np.cross(then, up)
    angle = float(np.arctan2(np.linalg.norm(across), then @ up))
    if np.pi - angle < 1e-9:  # upside down: any axis across will do
        across = np.cross(up, np.eye(3)[np.argmin(np.abs(up))])
    size = float(np.linalg.norm(across)) or 1.0
    wobble = np.zeros((1, 3)) if wobble is None else wobble
    return Turn(duration_s, across / size, angle, np.array([[0.0, duration_s, 1.0]]), wobble)


def any_three_turns(rng: np.random.Generator) -> tuple[TurnPlan, ...]:
    """Draw the plans of three turns by 360°, one about each sensor axis, in random order and direction."""
    return tuple(TurnPlan(int(axis), 360.0 * rng.choice([-1, 1])) for axis in rng.permutation(3))


def worn(
    rng: np.random.Generator,
    *,
    rest_s: tuple[float, float] = (2.0, 6.0),
    burst_s: tuple[float, float] = (1.0, 5.0),
    peak_dps: tuple[float, float] = (30.0, 150.0),
) -> Iterator[Piece]:
    """Yield endless everyday motion of a worn device: bursts of movement and rests alternate.

    rest_s, burst_s: shortest and longest duration, s. peak_dps: lowest and highest peak rate of a burst, °/s.
    """
    while True:
        yield swing(rng, rng.uniform(*burst_s), np.radians(rng.uniform(*peak_dps)))
        yield Still(rng.uniform(*rest_s))


def swing(rng: np.random.Generator, duration_s: float, peak_rate: float) -> Swing:
    """Draw a smooth movement about all axes to another pose, in duration_s, never faster than peak_rate rad/s."""
    fade = 1 / np.arange(1, _SWING_HARMONICS + 1)[:, None]
    pose, sine, cosine = rng.normal(size=3), *(fade * rng.normal(size=(2, _SWING_HARMONICS, 3)))
    shape = Swing(duration_s, pose, sine, cosine)
    grid = np.linspace(0, duration_s, 256)
    slope = np.linalg.norm(np.diff(shape.rotvec(grid), axis=0), axis=1).max() / grid[1]
    size = peak_rate / slope
    return Swing(duration_s, size * pose, size * sine, size * cosine, WORN_LEVER)


def demo_script(rng: np.random.Generator, warm_up_s: float = 2.0) -> Motion:
    """Draw the motion of the demonstration device: at rest for warm_up_s, then calibrated by hand, then worn forever.

    The calibration ends within 30 s.
    """

    def pieces() -> Iterator[Piece]:
        yield Still(warm_up_s)
        yield from session(rng, SessionPlan(turn_s=(3.5, 5.0), wobble_deg=2.0, tilt_deg=3.0, replacement_deg=0.2))
        yield from worn(rng)

    return Motion(pieces(), flat(rng))


def flat(rng: np.random.Generator) -> Array:
    """Draw the attitude of a device that lies on a table with its z axis up, at any heading.

    Returns a quaternion (4,) wxyz, sensor to earth.
    """
    half = rng.uniform(-np.pi, np.pi) / 2
    return np.array([np.cos(half), 0.0, 0.0, np.sin(half)])


def _turn(rng: np.random.Generator, plan: SessionPlan, turn: TurnPlan) -> Piece:
    duration_s = rng.uniform(*plan.turn_s) if turn.duration_s is None else turn.duration_s
    if turn.swing:
        # A minimum-jerk curve peaks at 15/8 of its mean rate.
        return swing(rng, duration_s, abs(np.radians(turn.angle_deg)) / duration_s * 15 / 8)
    axis = np.eye(3)[turn.axis]
    across = np.delete(np.arange(3), turn.axis)
    axis[across] = np.radians(rng.uniform(-plan.tilt_deg, plan.tilt_deg, 2)) / np.sqrt(2)
    offset = np.radians(plan.replacement_deg) * rng.normal(size=3)
    wobble = _wobble(rng, np.radians(plan.wobble_deg), across)
    axis /= np.linalg.norm(axis)
    goes = _goes(rng, duration_s, turn.goes)
    return Turn(duration_s, axis, float(np.radians(turn.angle_deg)), goes, wobble, offset, SESSION_LEVER)


def _wobble(rng: np.random.Generator, size: float, across: NDArray[np.intp]) -> Array:
    """Harmonics (h, 3) of a tilt about the two axes across the turn; its greatest angle is size rad."""
    harmonics = np.zeros((_WOBBLE_HARMONICS, 3))
    harmonics[:, across] = rng.normal(size=(_WOBBLE_HARMONICS, 2))
    path = np.sin(np.pi * np.linspace(0, 1, 101)[:, None] * np.arange(1, _WOBBLE_HARMONICS + 1)) @ harmonics
    return np.asarray(harmonics * (size / np.linalg.norm(path, axis=1).max()))


def _goes(rng: np.random.Generator, duration_s: float, n: int) -> Array:
    """N pushes (n, 3) over the duration, of unequal shares, with short pauses of the hand between."""
    share = rng.uniform(0.7, 1.3, n)
    share /= share.sum()
    pause_s = 0.0 if n == 1 else min(0.4, 0.3 * duration_s / n)
    length = share * (duration_s - pause_s * (n - 1))
    begin = np.concatenate([[0.0], np.cumsum(length + pause_s)[:-1]])
    return np.column_stack([begin, begin + length, share])
