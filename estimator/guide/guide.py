"""Guide for a calibration by hand: turns a device's status and readings into instructions for a person. Pure."""

from dataclasses import replace
from math import degrees, pi

import numpy as np

from bridge.reasons.codes import Code, Sentence, Sentences
from bridge.wire.messages import SampleBatch, State, Status
from estimator.calibration.method_names import BY_MOVEMENTS, DEFAULT
from estimator.calibration.turn_recognition import LEAST_TURN
from estimator.geometry.gyro_model import AXES
from estimator.guide.hand_motion import Hand
from estimator.guide.steps import Instruction, Picture, Step, Words
from estimator.stillness.detector import NOISE_GUESS

CALIBRATING = (State.AWAITING_STILL, State.BIAS_ONLY, State.TURNING)
_CALIBRATED = (State.TRACKING, State.DEGRADED)
#: reasons given for a device that the estimator hears but does not accept
_UNUSED = frozenset({Code.NOT_ENROLLED, Code.ENROLLED_ELSEWHERE})
#: reasons that report no fault: the steps themselves say as much
_USUAL = frozenset(
    {
        Code.NEVER_HEARD,
        Code.WARMING_UP,
        Code.RESTARTED,
        Code.HOLD_STILL,
        Code.TURN_NOW,
        Code.TURN_TAKEN,
        Code.TURNS_NEEDED,
        Code.NUDGE,
        Code.CALIBRATED,
        Code.CALIBRATION_GOES_ON,
        Code.RECALIBRATION_ASKED,
        Code.REQUEST_REASON,
        Code.OLD_CALIBRATION_STAYS,
        Code.BIAS_CONFIRMED,
        Code.TURNS_CLOSED,
        Code.TURNS_ASSUMED,
        Code.VERTICAL_TURNS_ASSUMED,
        Code.TURNS_TILTED,
        Code.LIBRARY_SENSITIVITY,
        Code.FULL_MATRIX,
        Code.CONDITION_NUMBER,
        Code.DIAGONAL_ONLY,
        Code.GRAVITY_CARRIED,
        Code.MOVEMENTS_LEFT_OUT,
    }
)
#: after this much rest the estimator has judged a turn or will not judge it at all, s
_JUDGED_S = 3.0
_FULL = 2 * pi
_IGNORED = "movement ignored"
#: faults of a turn, which do not apply to a movement between two poses
_OF_TURNS = frozenset(
    {
        Code.TURN_TOO_SHORT,
        Code.TURN_TOO_LONG,
        Code.BACK_AND_FORTH,
        Code.NOT_ONE_AXIS,
        Code.ENDED_TILTED,
        Code.RATE_OFF_BY_TWO,
        Code.TURN_TOO_SLOW,
        Code.TURN_TOO_OLD,
        Code.TURN_BIAS_MOVED,
        Code.TURNS_OPEN,
    }
)
#: tilt, degrees, from which on a device lies on another face
_ANOTHER_FACE = 45.0
#: faults of a movement that was no attempt at a turn where it only laid the device on another face
_OF_ATTEMPTS = frozenset({Code.TURN_TOO_SHORT, Code.BACK_AND_FORTH, Code.NOT_ONE_AXIS, Code.RESTLESS})
#: number of sides of a device
SIDES = 6


class Guide:
    """Guide of one device's calibration by hand: turns its status and readings into instructions for a person.

    method: the calibration method. noise_guess: standard deviation of the white noise of one reading, rad/s, assumed
    until measured in a rest.
    horizontal: accept only turns about a horizontal axis; then the device must stand on its side for the turn about its
    upright axis.
    """

    def __init__(self, method: str = DEFAULT, noise_guess: float = NOISE_GUESS, *, horizontal: bool = False) -> None:
        self.hand, self.method, self._horizontal = Hand(noise_guess), method, horizontal
        self._sides: tuple[int, ...] = ()
        self._status: Status | None = None
        self._boot = 0
        self._rebooted = self._began = False
        self._turned = False  # whether the running calibration has completed turns, as far as was heard
        self._before = ""  # id of the calibration in force when this one began
        #: verdict on the previous turn when the present turn began, and the axis and the way that were asked for
        self._verdict: tuple[object, ...] = ()
        self._asked: tuple[int, Picture] | None = None
        #: axis of the last attempt; where that failed, it is asked for again
        self._tried: int | None = None
        #: by axis, how the device was turned in each accepted turn that the guide followed
        self._made: dict[int, Picture] = {}

    def take_samples(self, batch: SampleBatch) -> None:
        """Process a batch of the device's raw readings, in order, to follow its rests, turns and attitude."""
        was_settled = self.hand.settled
        self.hand.take(batch)
        if was_settled and not self.hand.settled:
            self._verdict, self._asked = self._said(), self._asks()
        if not was_settled and self.hand.settled and self.hand.moved:
            self._put_down()
        if self.hand.settled and self.hand.upright is not None and self._sure:
            self._sides = tuple(dict.fromkeys((*self._sides, 2 * self.hand.upright + self.hand.upside_down)))

    def take_status(self, status: Status) -> None:
        """Process the estimator's latest status of the device; a repeated status changes nothing."""
        before, self._status = self._status, status
        if status.boot and status.boot != self._boot:
            self._rebooted |= self._turned
            self._boot, self._sides, self._turned, self._tried = status.boot, (), False, None
            self._made = {}
        if before is not None and before.state in CALIBRATING:
            self._keep_ways(before, status)
        if status.axes_done and self._rebooted:
            self._rebooted = False
        if before is not None and before.state is State.AWAITING_STILL and status.state is State.BIAS_ONLY:
            self._verdict = self._said()
        if status.state in (*CALIBRATING, *_CALIBRATED):
            self._turned = status.state in CALIBRATING and bool(status.axes_done)
        if status.state not in CALIBRATING:
            return
        begins = before is not None and status.state is State.AWAITING_STILL and before.state is not status.state
        if begins or not self._began:
            self._began, self._before = True, status.calibration
        if begins:
            self._sides, self._tried, self._made = (), None, {}
            self.hand.begin_rest()  # rest before the calibration began does not count

    def told(self) -> Instruction:
        """Return the present instruction for the person."""
        sides = self._sides if self.method in BY_MOVEMENTS else None
        ways = self._made.get(0, self._way(0)), self._made.get(1, self._way(1)), self._made.get(2, self._way(2))
        return replace(self._now(), rebooted=self._rebooted, ways=ways, sides=sides)

    def _keep_ways(self, before: Status, status: Status) -> None:
        """Keep how the device was turned about each axis done since the status `before`: it may be laid otherwise now."""
        over = status.state in _CALIBRATED
        accepted = range(3) if over else status.axes_done
        new = [axis for axis in accepted if over or axis not in before.axes_done]
        kept = {axis: way for axis, way in self._made.items() if axis in accepted}
        self._made = {axis: self._way(axis) for axis in new} | kept

    def _now(self) -> Instruction:
        status = self._status
        said = frozenset[str]() if status is None else {one.code for one in status.reason}
        if status is not None and status.state is State.UNKNOWN and Code.ROUTER_GONE in said:
            return Instruction(Step.BROKEN, Picture.NOTHING, Words("broken"))
        unused = status is not None and (status.state is State.UNKNOWN or not _UNUSED.isdisjoint(said))
        if status is not None and unused and (why := wrong_in(status.reason)):
            return Instruction(Step.REFUSED, Picture.NOTHING, Words("refused"), wrong=why)
        if status is None or status.state in (State.UNKNOWN, State.LOST):
            return Instruction(Step.AWAY, Picture.NOTHING, Words("away"))
        if status.state is State.WARMING:
            return Instruction(Step.WARM, Picture.EDGE, Words("warm"), needed=self._order(()))
        if status.state in _CALIBRATED:
            return self._over(status)
        return self._under_way(status)

    def _over(self, status: Status) -> Instruction:
        self._rebooted, self._tried = False, None
        why, exact = wrong_in(status.reason), status.state is State.TRACKING
        if self._began and status.calibration == self._before:
            return Instruction(Step.CANCELLED, Picture.EDGE, Words("cancelled_old"), wrong=why)
        step, words, ring = (Step.DONE, Words("done"), 1.0) if self._began else (Step.IDLE, Words("idle"), 0.0)
        if exact:
            return Instruction(step, Picture.WELL, words, ring, done=self._order(()))
        return Instruction(step, Picture.EDGE, Words("degraded"), ring, done=self._order(()), wrong=why)

    def _under_way(self, status: Status) -> Instruction:
        hand = self.hand
        done = status.axes_done
        needed = self._order(done)
        wrong = tuple(self._as_seen(one) for one in wrong_in(status.reason) if not self._is_no_attempt(one))
        if status.state is State.AWAITING_STILL:
            return Instruction(
                Step.PLACE, Picture.EDGE, Words("place"), hand.rested, done=done, needed=needed, wrong=wrong,
            )  # fmt: skip
        if self.method in BY_MOVEMENTS:
            return self._between_poses(status)
        if hand.moved and self._judging(status):
            return self._turning(status, done, needed)
        axis = needed[0] if needed else 0
        way = self._way(axis)
        if way is Picture.SIDE:
            return Instruction(
                Step.STAND, Picture.POSE, Words("stand"), axis=axis, done=done, needed=needed, wrong=wrong
            )
        words = Words(f"{'again' if wrong else 'turn'}_{way}", {"axis": AXES[axis]})
        return Instruction(Step.TURN, way, words, 0.0, 0.0, axis, done, needed, wrong, laid=hand.laid and not wrong)

    def _is_no_attempt(self, one: Sentence) -> bool:
        """Return whether a rejected movement only laid the device on another face: as the guide asked, or as before."""
        if one.code == Code.VERTICAL_TURN:
            return self.hand.laid and self._way(AXES.index(one.params["axis"])) is not Picture.SIDE
        return self.hand.laid and one.code in _OF_ATTEMPTS

    def _as_seen(self, one: Sentence) -> Sentence:
        """A fault as a person sees it: a device that came to lie on another face was not turned all the way round."""
        if one.code != Code.ENDED_TILTED or float(one.params["angle_deg"]) < _ANOTHER_FACE:
            return one
        angle = degrees(float(np.linalg.norm(self.hand.turned)))
        return (
            Code.TURN_TOO_SHORT(angle_deg=f"{angle:.0f}")
            if angle < 360
            else Code.TURN_TOO_LONG(angle_deg=f"{angle:.0f}")
        )

    def _asks(self) -> tuple[int, Picture] | None:
        """The turn that is asked for now: its axis, and how the device is turned about it."""
        status = self._status
        needed = () if status is None or status.state not in CALIBRATING else self._order(status.axes_done)
        return (needed[0], self._way(needed[0])) if needed else None

    def _put_down(self) -> None:
        """Take note of a movement that ended: what it was an attempt at, and what it shows of how the device lies."""
        hand = self.hand
        if hand.laid:
            return
        axis = hand.axis
        self._tried = axis if axis is not None or self._asked is None else self._asked[0]
        way = None if self._asked is None else self._asked[1]
        if axis is not None and axis != hand.top and way in (Picture.ALONG, Picture.ACROSS):
            hand.believe(axis if way is Picture.ALONG else 3 - hand.top - axis)

    def _between_poses(self, status: Status) -> Instruction:
        """Instruction for methods by movements: a rest on each side, until the estimator has the whole matrix."""
        hand = self.hand
        wrong = tuple(one for one in wrong_in(status.reason) if one.code not in _OF_TURNS)
        if hand.still_s > 0 and not hand.settled:
            return Instruction(Step.SETTLE, Picture.EDGE, Words("settle"), hand.rested, wrong=wrong)
        key = self.method if len(self._sides) < SIDES else "more"
        return Instruction(Step.POSE, Picture.POSE, Words(f"pose_{key}"), len(self._sides) / SIDES, wrong=wrong)

    @property
    def _sure(self) -> bool:
        """True if rests count now: a calibration is running, and readings and status are of the same boot."""
        return self._status is not None and self._status.state in CALIBRATING and self.hand.boot == self._status.boot

    def _turning(self, status: Status, done: tuple[int, ...], needed: tuple[int, ...]) -> Instruction:
        hand = self.hand
        axis = hand.axis
        about = axis if axis is not None else needed[0] if needed else 0
        angle = float(hand.turned[about]) * status.scale[about]
        picture = self._way(about)
        whole = abs(angle) >= LEAST_TURN
        if hand.settled or (hand.still_s > 0 and whole):
            return Instruction(
                Step.SETTLE, Picture.EDGE, Words("settle"), hand.rested, angle, axis, done, needed,
            )  # fmt: skip
        ring = min(1.0, abs(angle) / _FULL)
        return Instruction(Step.TURNING, picture, Words("turning"), ring, angle, axis, done, needed)

    def _judging(self, status: Status) -> bool:
        """Return whether a turn is in progress, or has ended and awaits the estimator's verdict."""
        if not self.hand.settled:
            return True
        waited = self.hand.still_s > self.hand.rest_s + _JUDGED_S
        return not waited and self._said() == self._verdict and status.state is not State.AWAITING_STILL

    def _said(self) -> tuple[object, ...]:
        status = self._status
        return () if status is None else (status.axes_done, status.reason, status.events.get(_IGNORED, 0))

    def _order(self, done: tuple[int, ...]) -> tuple[int, ...]:
        """Axes still needed: of a failed turn first, then the easiest turn, flat on the table.

        Where turns must be horizontal, a turn that is flat comes last.
        """

        def hard(axis: int) -> tuple[bool, bool, bool]:
            flat = axis == self.hand.top
            return axis != self._tried or (flat and self._horizontal), flat == self._horizontal, axis != self.hand.edge

        return tuple(sorted((axis for axis in range(3) if axis not in done), key=hard))

    def _way(self, axis: int) -> Picture:
        """Picture of how to turn the device about an axis."""
        if axis == self.hand.top:
            return Picture.SIDE if self._horizontal and self.hand.upright is not None else Picture.FLAT
        return Picture.ALONG if axis == self.hand.edge else Picture.ACROSS


def wrong_in(reason: Sentences) -> Sentences:
    """Return the sentences of a status's `reason` that name faults; messages that name no fault are left out.

    After an accepted turn, `reason` ends with the turns still needed and the faults of earlier turns. These are left
    out, too.
    """
    codes = [one.code for one in reason]
    if Code.TURN_TAKEN in codes and Code.TURNS_NEEDED in codes:
        reason = reason[: codes.index(Code.TURNS_NEEDED)]
    return tuple(one for one in reason if one.code not in _USUAL)
