"""A person with a device at a table, who knows what the pages say and nothing else: reads, clicks, turns, lets go."""

from collections import deque
from collections.abc import Iterator

import numpy as np
from playwright.sync_api import Page, expect

from bridge.sim.imu_errors import DEMO_SPEC
from bridge.sim.motion import Motion, Piece, Still
from bridge.sim.motion_scripts import SessionPlan, TurnPlan, flat, session
from bridge.sim.sample_source import SimulatedSource
from bridge.sim.virtual_device import VirtualDevice
from tests.ward.parts import WAITING
from tests.web import page_state

#: it lies there until somebody turns it
_LIES = Still(0.05)
#: which of its axes a picture shows turning, of a device that lies flat
_SHOWN = {"flat": 2, "along": 0, "across": 1}
#: steps at which there is nothing more to be done
OVER = ("done", "idle", "cancelled")


class Table:
    """A virtual device on a table, that lives through what a hand does with it; at rest else."""

    def __init__(self, name: str, seed: int) -> None:
        self._rng = np.random.default_rng(seed)
        self._due: deque[Piece] = deque()
        #: how long each turn took, s of the device's time
        self.turned_s: list[float] = []
        self.device = VirtualDevice(name, SimulatedSource(self._lying, DEMO_SPEC, 104.0), seed, WAITING)

    def turn(self, axis: int, angle_deg: float = 360.0) -> None:
        """By a hand that wobbles, and does not put it back quite as it lay; once round takes 3.5 to 5 s of the device's time."""
        part = abs(angle_deg) / 360.0
        turns = (TurnPlan(axis, angle_deg * self._rng.choice([-1, 1])),)
        plan = SessionPlan(
            turns=turns, turn_s=(3.5 * part, 5.0 * part), wobble_deg=2.0, tilt_deg=3.0, replacement_deg=0.2
        )
        piece = session(self._rng, plan)[1]
        self._due.append(piece)
        self.turned_s.append(piece.duration_s)

    def reboot(self) -> None:
        """Power is lost and comes back; it lies on the table."""
        self._due.clear()
        self.device.reboot()

    def _lying(self, rng: np.random.Generator) -> Motion:
        return Motion(self._pieces(), flat(rng))

    def _pieces(self) -> Iterator[Piece]:
        while True:
            yield self._due.popleft() if self._due else _LIES


_STEP = "document.querySelector('.guide').dataset.step"
#: what the page says of turns that are over
_TOLD = """() => [...document.querySelectorAll('#turns [data-mark]')].map(turn => turn.dataset.mark).join()
    + document.querySelector('#wrong').textContent"""


class Hand:
    """What a person does who looks at the guide's page. reads_ms: to take in what is new before doing anything."""

    def __init__(self, page: Page, table: Table, reads_ms: float = 0.0) -> None:
        self._page, self._table, self._reads_ms = page, table, reads_ms
        self.read_s = 0.0  # spent by reading so far

    def from_the_ward_page(self, name: str) -> None:
        """Open what the ward page offers for a device that needs a person."""
        tile = self._page.locator(f'.tile[data-id="{name}"]')
        offered = tile.get_by_role("link", name="Calibrate")
        expect(offered).to_be_visible()
        self.reads()
        offered.click()
        expect(self._page.locator("#do")).to_be_visible()

    def begin(self) -> None:
        """Ask for a calibration, and see that it is under way."""
        self._page.get_by_role("button", name="Calibrate it again").click()
        self.wait_for(("place", "turn"))  # it may lie there long enough before the page looks

    def follow(self, until: tuple[str, ...] = OVER, *, half: str = "", turns: int = 9) -> None:
        """Do as the page says, until it is at one of these steps or so many turns are made.

        half: pictures, with commas between them, at each of which one turn is made by half.
        """
        halves = half.split(",")
        for _ in range(turns):
            if self.wait_for(("turn", *until)) != "turn":
                return
            self.reads()
            shown = self._page.locator("#pictures > :visible").get_attribute("data-picture") or ""
            before = self._page.evaluate(_TOLD)
            self._table.turn(_SHOWN[shown], 180.0 if shown in halves else 360.0)
            if shown in halves:
                halves.remove(shown)
            # A quick turn may be over before a page that has much to do shows that it is made.
            page_state.wait_for(self._page, f"before => {_STEP} === 'turning' || ({_TOLD})() !== before", arg=before)

    def wait_for(self, steps: tuple[str, ...]) -> str:
        """The step the page is at, as soon as it is one of these."""
        chosen = ", ".join(f'.guide[data-step="{step}"]' for step in steps)
        return self._page.locator(chosen).get_attribute("data-step") or ""

    def reads(self) -> None:
        """Take in what is new: nothing is painted before the page's styles are there, but to us all pictures would be visible."""
        self._page.wait_for_load_state()
        self._page.wait_for_timeout(self._reads_ms)
        self.read_s += self._reads_ms / 1000
