"""Guided calibration in a terminal: shows the next step, a progress bar, and the verdict.

A terminal is updated in place; other outputs get a line per step.
"""

import time
from math import degrees

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.padding import Padding
from rich.progress_bar import ProgressBar
from rich.text import Text

from bridge.bus.contract import BusError
from bridge.reasons.catalogue import english
from bridge.terminal.tables import Column, Columns
from estimator.client import Client
from estimator.config.device_settings import Treatment
from estimator.device.session_knobs import SessionKnobs
from estimator.geometry.gyro_model import AXES
from estimator.guide.comparison import last_before
from estimator.guide.guide import Guide
from estimator.guide.steps import Instruction, Step
from estimator.language.texts import Texts
from estimator.overview.ward import listed
from estimator.web.guide_view import against, rows, unless_broken
from estimator.web.ward_state import Known, Story

#: seconds between two updates
LOOK_S = 0.1
#: seconds after which a device that no bridge lists is taken for a misspelt id
MISNAMED_S = 3.0
_STYLES = {Step.DONE: "bold green", Step.IDLE: "bold green", Step.CANCELLED: "bold yellow"}
_STYLES |= dict.fromkeys((Step.AWAY, Step.BROKEN, Step.REFUSED), "bold red")
_UNDER_WAY = (Step.WARM, Step.PLACE, Step.TURN, Step.STAND, Step.TURNING, Step.POSE, Step.SETTLE)
_BARS = (Step.PLACE, Step.SETTLE, Step.TURNING)


def calibrate(
    console: Console,
    client: Client,
    device: str,
    who: str,
    t: Texts,
    *,
    seconds: float | None = None,
    knobs: SessionKnobs | None = None,
) -> int:
    """Guide a person in a terminal through the calibration of a live device; request one unless one is in progress.

    who: name of the person, recorded with the command. t: texts in the person's language. seconds: give up after this
    time, s; None for no limit.
    knobs: settings of the device; by default those of a device of unknown model.
    Returns the exit code: 0 if the device is calibrated, else 1.
    """
    heard = Heard(client, device, knobs or Treatment().of(device))
    told, asked, begin, misnamed = heard.guide.told(), False, time.monotonic(), False
    screen = GuideScreen(console, t, device)
    try:
        while True:
            told, passed = heard.told(LOOK_S), time.monotonic() - begin
            if passed > MISNAMED_S and not misnamed and (there := heard.others()):
                misnamed = True
                console.print(t("guide.not_heard", device=device, names=listed(there)))
            if told.step is Step.IDLE and not asked:
                asked = True
                reply = client.recalibrate(device, who)
                console.print(Text(f"{device}: {t.text(reply.message)}", "dim"))
                if not reply.accepted:
                    return 1
                continue
            if told.step is not Step.IDLE:
                screen.show(told)
            if told.step in (Step.DONE, Step.CANCELLED) or (seconds is not None and passed > seconds):
                break
    except KeyboardInterrupt:
        pass
    finally:
        screen.close()
        if (step := heard.guide.told().step) not in (Step.DONE, Step.CANCELLED, Step.IDLE):
            after_s = time.monotonic() - begin
            said = _given_up(client, device, who) if asked else _left(t, step, client.ward, device, after_s)
            console.print(Text(said, "dim"), end="\n" if said else "")
        heard.close()
    return _end(console, t, told, heard.story)


class Heard:
    """Receiver of messages about one device during a calibration, and of the bridges and estimators that are alive.

    `guide`: turns the messages into instructions. `story`: collected messages of the device. knobs: settings of the
    device.
    """

    def __init__(self, client: Client, device: str, knobs: SessionKnobs) -> None:
        self._client, self._device, self._known = client, device, Known(client.ward)
        self.guide, self.story = (
            Guide(knobs.method, knobs.prior.noise_std, horizontal=knobs.horizontal_turns),
            self._known.story(device) or Story(0),
        )
        self._samples, self._statuses = client.raw(device), client.follow(device)
        self._made, self._infos = client.follow_calibrations(device), client.follow_infos()
        self._watches = [client.watch_alive(what, alive.__setitem__) for what, alive in self._known.alive.items()]

    def told(self, wait_s: float) -> Instruction:
        """Receive messages, waiting at most `wait_s` seconds for readings, and return the current instruction."""
        for batch in self._samples.drain(wait_s):
            self.guide.take_samples(batch)
        now = time.monotonic()
        self._known.take_router(now, there=self._client.connected)
        if (latest := self._statuses.latest()) is not None:  # earlier ones are out of date
            self._known.take_status(latest, now)
            self.guide.take_status(latest)
        for calibration in self._made.drain():
            self._known.take_calibration(calibration)
        for info in self._infos.drain():
            self._known.take_info(info)
        return unless_broken(self.guide.told(), self._known, self._device, now)

    def others(self) -> list[str]:
        """Return the ids of the ward's devices if the device to calibrate is not among them; else an empty list."""
        there = sorted(name for name, story in self._known.stories.items() if story.info is not None)
        return there if self.story.status is None and self._device not in there else []

    def close(self) -> None:
        """End all subscriptions."""
        for stream in (self._samples, self._statuses, self._made, self._infos):
            stream.close()
        for watch in self._watches:
            watch.close()


def _given_up(client: Client, device: str, who: str) -> str:
    """Cancel the calibration that this guide asked for, or the device would wait for ever; return what to say."""
    try:
        said = english(*client.cancel(device, who).message)
    except BusError as error:
        said = f"the calibration is still running, because it could not be cancelled: {error}"
    return f"{device}: {said}"


def _left(t: Texts, step: Step, ward: str, device: str, after_s: float) -> str:
    """Say that a calibration asked for by another person goes on; that person may be at the device."""
    return t("guide.goes_on", seconds=f"{after_s:.0f}", device=device, ward=ward) if step in _UNDER_WAY else ""


class GuideScreen:
    """Display for instructions of the guide: updated in place on a terminal, otherwise a line per change.

    t: texts in the person's language.
    """

    def __init__(self, console: Console, t: Texts, device: str) -> None:
        self._console, self._t, self._device = console, t, device
        self._live = Live(console=console, refresh_per_second=10, transient=True) if console.is_terminal else None
        self._said = ""
        if self._live:
            self._live.start()

    def show(self, told: Instruction) -> None:
        """Show an instruction: update the terminal in place, or print it if it is new."""
        if self._live:
            self._live.update(Group(*panel(told, self._device, self._t)))
        said = "\n".join(sentences(told, self._t))
        if not self._live and said != self._said:
            self._said = said
            self._console.print(said, highlight=False)

    def close(self) -> None:
        """Stop showing instructions, and release the terminal."""
        if self._live:
            self._live.stop()


def sentences(told: Instruction, t: Texts) -> list[str]:
    """Return an instruction as sentences: turns lost by a reboot, faults of the last attempt, what to do, and how."""
    wrong = [t.text((one,)) for one in told.wrong]
    again = [t("guide.rebooted")] if told.rebooted else []
    return [*again, *wrong, t.say("head", told.head), f"  {t(f'how.{told.how}')}"]


def panel(told: Instruction, device: str, t: Texts) -> list[RenderableType]:
    """Return an instruction as a few lines for a terminal, with a progress bar and the state of each turn."""
    *wrong, head, how = sentences(told, t)
    lines: list[RenderableType] = [
        Text(t("guide.title", device=device), "bold"),
        *(Text(one, "yellow") for one in wrong),
    ]
    lines += [Text(head, _STYLES.get(told.step, "bold cyan")), Text(how.strip())]
    if told.step in _BARS:
        lines.append(
            Padding(ProgressBar(total=1.0, completed=told.ring, width=40))
        )  # Padding ends the line; a bar alone does not
    turned = f"{abs(degrees(told.angle)):.0f}°" if told.step is Step.TURNING else ""
    turns = [
        f"{AXES[axis]} {t(f'guide.{told.ways[axis]}')}: {t('guide.done' if axis in told.done else 'guide.next')}"
        for axis in sorted((*told.done, *told.needed))
    ]
    if told.sides is not None:
        turns = [t("guide.sides", seen=len(told.sides))]
    lines.append(Text("   ".join([*([turned] if turned else []), *turns]), "dim"))
    return lines


def _end(console: Console, t: Texts, told: Instruction, story: Story) -> int:
    if console.is_terminal:  # other outputs show it already
        console.print("\n".join(sentences(told, t)), highlight=False)
    calibration = story.calibrations.get(story.status.calibration) if story.status is not None else None
    if told.step is not Step.DONE or calibration is None:
        return 0 if told.step is Step.DONE else 1
    before = last_before(calibration, story.calibrations.values())
    table = Columns([Column(t(f"guide.{name}"), number=True) for name in ("axis", "scale", "scale_before", "bias")])
    for one in rows(calibration, before):
        table.add(one.axis, one.scale, one.before, one.bias)
    console.print(table)
    console.print(against(calibration, before, t), highlight=False)
    return 0
