"""Devices that were taken over and send nothing: it goes on being said of them that they are lost, and what is known of them."""

from collections.abc import Callable, Iterator
from dataclasses import replace

from bridge.bus.contract import Bus, Publisher
from bridge.wire import codec, keys
from bridge.wire.messages import Checkpoint
from estimator.service import published
from estimator.service.replicas import Replicas
from estimator.session import DeviceSession
from estimator.session_knobs import SessionKnobs

#: checkpoints said in a second: those that send something do not wait for them
AT_ONCE = 20
SILENT = "no samples since another estimator had it: is it switched on, plugged in, in reach?"


class Silent:
    """Each with a session that was begun from the last checkpoint; one that is heard again is dropped here."""

    def __init__(self, bus: Bus, ward: str, replicas: Replicas, knobs: Callable[[str], SessionKnobs]) -> None:
        self._bus, self._ward, self._replicas, self._knobs = bus, ward, replicas, knobs
        self._sessions: dict[str, tuple[DeviceSession, Checkpoint, int]] = {}
        self._publishers: dict[str, tuple[Publisher, ...]] = {}
        self._untold: dict[str, None] = {}  # whose checkpoint is still to be said

    def __contains__(self, device: str) -> bool:
        return device in self._sessions

    def __iter__(self) -> Iterator[str]:
        return iter(self._sessions)

    def take(self, known: Checkpoint, epoch: int, now_ns: int) -> None:
        """It is ours from now on, under this epoch."""
        session = DeviceSession(known.device, self._knobs(known.device))
        remembered = self._replicas.recall(known.device, known.boot, now_ns)
        session.begin_boot(known.boot, known.device_time_s, remembered)
        if remembered is None and known.calibration is not None:
            session.believe(known.calibration)
        session.silence(SILENT)
        self._sessions[known.device] = session, known, epoch
        self._publishers[known.device] = (self._publisher("status", known.device),)
        self._untold[known.device] = None

    def say(self, now_ns: int) -> None:
        """Publish what is known of each."""
        for device, (session, known, epoch) in self._sessions.items():
            status = published.status(session.status(now_ns, bridge=known.bridge, epoch=epoch))
            self._publishers[device][0].put(codec.encode_status(status))
        # Who joins, and is to have it, may have nobody else who knows: who said it last is gone, and its cache.
        for device in list(self._untold)[:AT_ONCE]:
            del self._untold[device]
            _, known, epoch = self._sessions[device]
            checkpoint = self._publisher("checkpoint", device)
            self._publishers[device] += (checkpoint,)
            checkpoint.put(codec.encode_checkpoint(replace(known, epoch=epoch)))

    def _publisher(self, what: str, device: str) -> Publisher:
        return self._bus.publisher(keys.build(self._ward, what, device=device), cache=1)

    def drop(self, device: str) -> None:
        """It is heard, or another estimator's."""
        self._untold.pop(device, None)
        if self._sessions.pop(device, None) is not None:
            for publisher in self._publishers.pop(device):
                publisher.close()

    def close(self) -> None:
        """Say no more of any."""
        for device in list(self._sessions):
            self.drop(device)
