"""Activities of a simulated wearer on a ward, drawn without end: lying, sleeping, sitting, walking, being pushed.

Angles of this module are in °; the stretches made from them are in rad.
"""

from collections.abc import Callable, Iterator

import numpy as np

from bridge.sim.body import Activity, Stretch, Ticks, Waves
from bridge.sim.quaternion import Array

_MINUTE = 60.0
#: probabilities of the next block of activity
_BLOCKS = {"lie": 0.28, "sleep": 0.14, "sit": 0.26, "walk": 0.22, "pushed": 0.05, "table": 0.05}


class Wearer:
    """Simulated wearer of one device: draws stretches of activity (body.Stretch) from rng.

    rng: also decides the wearer's depth of breathing, stride frequency and speed of swinging.
    """

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        #: ° of rotation by breathing; depends on the place of the device and on the posture
        self._breath_deg = float(np.exp(rng.uniform(np.log(0.2), np.log(1.0))))
        self._stride_hz = float(rng.uniform(0.75, 1.1))
        self._swing_dps = float(rng.uniform(70, 160))
        self._blocks: dict[str, Callable[[], Iterator[Stretch]]] = {
            "lie": self._lie,
            "sleep": self._sleep,
            "sit": self._sit,
            "walk": self._walk,
            "pushed": self._pushed,
            "table": self._off_and_on,
        }

    def life(self) -> Iterator[Stretch]:
        """Yield stretches of activity without end: a minute on the table, then mostly worn."""
        yield self.table(_MINUTE)
        yield self._handled()
        while True:
            yield from self._blocks[str(self._rng.choice(list(_BLOCKS), p=list(_BLOCKS.values())))]()

    def table(self, duration_s: float) -> Stretch:
        """Draw a stretch of lying on a table for duration_s, not worn; the building's vibrations move the device."""
        return Stretch(Activity.TABLE, duration_s, ticks=self._passers_by(duration_s, 0.3))

    def turned(self, rate_dps: float, duration_s: float, *, breath: float = 1.0, ramp_s: float = 1.0) -> Stretch:
        """Draw a stretch in a bed or chair that turns about the vertical at a constant rate, with rattling wheels.

        rate_dps: rate, °/s; positive is counter-clockwise seen from above. duration_s: duration of the stretch.
        breath: depth of breathing relative to an awake wearer, 0 for none. ramp_s: time to reach the rate, s.
        """
        goes = np.array([[0.0, duration_s, np.radians(rate_dps) * (duration_s - ramp_s), ramp_s]])
        sway = [self._rattle(np.radians(0.2)), *([self._breathing(breath)] if breath else [])]
        shaken = (self._rattle(0.04),)
        ticks = self._passers_by(duration_s, 1.0)
        return Stretch(Activity.SLOW_TURN, duration_s, goes=goes, sway=tuple(sway), bounce=shaken, ticks=ticks)

    def quiet(self, activity: Activity, duration_s: float, *, breath: float, restless_deg: float = 0.0) -> Stretch:
        """Draw a stretch of keeping still for duration_s, with breathing and an unsteady hand.

        activity: label of the stretch. breath: depth of breathing relative to an awake wearer.
        restless_deg: amplitude of the hand's unsteadiness, °.
        """
        sway = [self._breathing(breath * self._rng.uniform(0.6, 1.4))]
        if restless_deg:
            f = self._rng.uniform(0.1, 0.7, 4)
            size = np.radians(restless_deg) * self._rng.normal(size=(4, 3)) / 2
            sway.append(Waves(size, f, self._phases(4), np.full(4, 1.5)))
        return Stretch(activity, duration_s, sway=tuple(sway), fade_s=3.0, ticks=self._passers_by(duration_s, 1.0))

    def moved(self, duration_s: float, size_deg: float, activity: Activity = Activity.MOVING) -> Stretch:
        """Draw a stretch of free movement for duration_s about all axes, to a random pose about size_deg away.

        activity: label of the stretch.
        """
        pose = np.radians(size_deg) * self._rng.normal(size=3) / 2
        f = self._rng.uniform(0.3, 1.2, 3)
        sway = Waves(0.1 * np.radians(size_deg) * self._rng.normal(size=(3, 3)) / f[:, None], f, self._phases(3), f)
        bounce = Waves(0.1 * self._rng.normal(size=(3, 3)), f, self._phases(3), f)
        return Stretch(activity, duration_s, pose, sway=(sway,), bounce=(bounce,), fade_s=duration_s / 2)

    def _lie(self) -> Iterator[Stretch]:
        """Ten minutes to an hour in bed, awake: breathing, movements, turning over, bed adjustments."""
        yield self._movement(60)
        for _ in range(self._rng.integers(3, 12)):
            yield self.quiet(Activity.LYING, self._rng.uniform(1, 8) * _MINUTE, breath=1.0)
            yield from self._interrupted()

    def _sleep(self) -> Iterator[Stretch]:
        """Half an hour to an hour and a half asleep: breathing and movements, shallower and rarer."""
        yield self._movement(60)
        for _ in range(self._rng.integers(2, 6)):
            yield self.quiet(Activity.ASLEEP, self._rng.uniform(8, 25) * _MINUTE, breath=0.6)
            yield self._movement(self._rng.choice([8, 90]))

    def _interrupted(self) -> Iterator[Stretch]:
        what = self._rng.uniform()
        if what < 0.12:
            rate_dps = self._rng.choice([-1, 1]) * np.exp(self._rng.uniform(np.log(0.1), np.log(2.0)))
            yield self.turned(float(rate_dps), self._rng.uniform(20, 90))
        elif what < 0.24:
            yield self._bed_adjusted()
        else:
            yield self._movement(120 if what < 0.4 else 20)

    def _sit(self) -> Iterator[Stretch]:
        """Five to forty minutes in a chair, fidgeting."""
        yield self._movement(70)
        for _ in range(self._rng.integers(10, 60)):
            yield self.quiet(Activity.SITTING, float(self._rng.gamma(1.5, 20)) + 2, breath=0.4, restless_deg=0.15)
            yield self._movement(float(self._rng.exponential(12)) + 1)

    def _walk(self) -> Iterator[Stretch]:
        """A few legs of a walk, with pauses."""
        yield self._movement(70)
        for _ in range(self._rng.integers(1, 6)):
            yield from self.leg_and_pause()

    def leg_and_pause(self) -> Iterator[Stretch]:
        """Yield a stretch of walking for 10 to 120 s, then a pause of 2 to 15 s, labelled as activity SITTING."""
        yield self.leg(self._rng.uniform(10, 120))
        yield self.quiet(Activity.SITTING, self._rng.uniform(2, 15), breath=0.4, restless_deg=0.4)

    def leg(self, duration_s: float) -> Stretch:
        """Draw a stretch of walking for duration_s at a constant speed, with turns at corners."""
        f, rng = self._stride_hz * self._rng.uniform(0.9, 1.1), self._rng
        times = np.array([1.0, 2.0, 1.0, 3.0])
        share = np.array([1.0, 0.3, 0.35, 0.15])[:, None]
        along = rng.normal(size=(4, 3))
        along /= np.linalg.norm(along, axis=1)[:, None]
        rate = np.radians(self._swing_dps) * rng.uniform(0.8, 1.1)
        sway = Waves(rate * share * along / (2 * np.pi * f * times[:, None]), f * times, self._phases(4), 0.4 / times)
        # Up and down twice a stride, and the heel strike.
        beat = np.array([[0.1, 0, 0], [0, 0.08, 0], [0, 0, 0.2], [0.05, 0.03, 0.06]])
        bounce = Waves(
            rng.uniform(0.7, 1.2) * beat, f * np.array([2.0, 1.0, 2.0, 6.0]), self._phases(4), np.full(4, 0.2)
        )
        return Stretch(
            Activity.WALKING,
            duration_s,
            goes=self._corners(duration_s, (1.0, 2.5)),
            sway=(sway,),
            bounce=(bounce,),
            speed=rng.uniform(0.5, 1.3),
        )

    def _pushed(self) -> Iterator[Stretch]:
        """A bed pushed along a corridor and round corners."""
        for _ in range(self._rng.integers(1, 4)):
            yield self.quiet(Activity.LYING, self._rng.uniform(20, 120), breath=1.0)
            duration_s = self._rng.uniform(30, 180)
            yield Stretch(
                Activity.PUSHED,
                duration_s,
                goes=self._corners(duration_s, (3.0, 7.0)),
                sway=(self._breathing(1.0), self._rattle(np.radians(1.5))),
                bounce=(self._rattle(0.4),),
                speed=self._rng.uniform(0.5, 1.1),
                fade_s=2.0,
            )

    def _off_and_on(self) -> Iterator[Stretch]:
        yield self._handled()
        yield self.table(self._rng.uniform(5, 25) * _MINUTE)
        yield self._handled()

    def _handled(self) -> Stretch:
        return self.moved(self._rng.uniform(3, 8), 120, Activity.HANDLED)

    def _movement(self, size_deg: float) -> Stretch:
        """Movement to another pose, some size_deg away: from a twitch to turning over."""
        return self.moved(self._rng.uniform(0.6, 2.0) + size_deg / 60, size_deg)

    def _bed_adjusted(self) -> Stretch:
        """The bed's back is moved up or down by a motor, about a horizontal axis."""
        towards = self._rng.uniform(0, 2 * np.pi)
        angle = np.radians(self._rng.uniform(8, 40))
        duration_s = angle / np.radians(self._rng.uniform(0.7, 2.0)) + 1.0
        return Stretch(
            Activity.BED_ADJUSTED,
            duration_s,
            axis=np.array([np.cos(towards), np.sin(towards), 0.0]),
            goes=np.array([[0.0, duration_s, self._rng.choice([-1, 1]) * angle, 0.5]]),
            sway=(self._breathing(1.0), self._rattle(np.radians(0.3))),
            bounce=(self._rattle(0.08),),
        )

    def _breathing(self, size: float) -> Waves:
        """Breathing at 0.2 to 0.35 Hz, with its overtone and a slower drift of the depth; mostly about one axis."""
        f = self._rng.uniform(0.2, 0.35) * np.array([1.0, 2.0, 0.87])
        main = self._rng.normal(size=3)
        across = 0.3 * self._rng.normal(size=(3, 3))
        size_rad = np.radians(self._breath_deg * size)
        along = main / np.linalg.norm(main) + across
        return Waves(size_rad * np.array([[1.0], [0.2], [0.35]]) * along, f, self._phases(3), np.array([2.0, 2.0, 2.5]))

    def _rattle(self, change: float) -> Waves:
        """Rattle of motors and wheels, 4 to 18 Hz; `change` is the rms of its rate of change, per second and axis."""
        f = self._rng.uniform(4, 18, 6)
        size = change * self._rng.normal(size=(6, 3)) / (np.sqrt(3) * 2 * np.pi * f[:, None])
        return Waves(size, f, self._phases(6), np.full(6, 5.0))

    def _corners(self, duration_s: float, takes_s: tuple[float, float]) -> Array:
        """Turns of ±90°, 180° and 45°, some seconds apart."""
        goes, at = [], self._rng.uniform(4, 12)
        while at + takes_s[1] < duration_s:
            takes = self._rng.uniform(*takes_s)
            goes.append([at, at + takes, np.radians(self._rng.choice([-90, 90, 180, 45])), takes / 2])
            at += takes + self._rng.uniform(5, 25)
        return np.array(goes).reshape(-1, 4)

    def _passers_by(self, duration_s: float, size: float) -> Ticks:
        """Footfalls near the bed: people walk past now and then, at two steps a second."""
        steps = [
            begin + np.cumsum(self._rng.uniform(0.42, 0.6, self._rng.integers(5, 25)))
            for begin in self._rng.uniform(0, duration_s, self._rng.poisson(duration_s / 150))
        ]
        time_s = np.sort(np.concatenate([*steps, np.zeros(0)]))
        loud = size * self._rng.lognormal(sigma=0.6, size=(len(time_s), 1))
        tilt = np.radians(0.003) * loud * self._rng.normal(size=(len(time_s), 3))
        return Ticks(time_s, tilt, 6e-4 * loud * self._rng.normal(size=(len(time_s), 3)))

    def _phases(self, n: int) -> Array:
        return self._rng.uniform(0, 2 * np.pi, n)
