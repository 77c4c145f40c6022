"""The verbs `truerate bridge ...` and `truerate router`: arguments in, exit code out."""

import argparse
import logging
import sys
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path

from bridge.bus.contract import Bus, BusError
from bridge.bus.router import Router
from bridge.config import LOCAL, Bridge, ConfigError, Device, Root, check_endpoints, listening, load
from bridge.drivers import registry
from bridge.drivers.replayed import ReplayedOptions
from bridge.health import Health
from bridge.process import connected, stopped_by_signal
from bridge.recording import RecordingError
from bridge.recording import load as load_recording
from bridge.vitals import Vitals
from bridge.ward import Ward
from bridge.wire import keys

_DONE, _FAILED, _WRONG = 0, 1, 2
_log = logging.getLogger(__name__)

# Parsers of verbs that are added here set `run`, which takes the arguments and returns the exit code.
Run = Callable[[argparse.Namespace], int]
Verbs = argparse._SubParsersAction  # noqa: SLF001 - argparse has no public name for it


def add_verbs(verbs: "Verbs[argparse.ArgumentParser]") -> None:
    """Add `bridge` and `router` to the command; each sets `run(args) -> exit code`."""
    bridge = _parser(verbs, "bridge", "read devices and publish them", "truerate bridge run configs/ward.toml")
    inner = bridge.add_subparsers(metavar="VERB", required=True)
    run = _parser(inner, "run", "read the devices of a file and publish them", "truerate bridge run configs/ward.toml")
    run.add_argument("config", type=Path, metavar="CONFIG", help="the ward's TOML file")
    run.set_defaults(run=_guarded(_run))

    listed = _parser(
        inner,
        "list",
        "show the drivers, and whether a file's devices are there",
        "truerate bridge list configs/ward.toml",
    )
    listed.add_argument("config", type=Path, nargs="?", metavar="CONFIG", help="the ward's TOML file")
    listed.set_defaults(run=_guarded(_list))

    replay = _parser(
        inner,
        "replay",
        "publish a recording as if it were a device",
        "truerate bridge replay walk.npz --device wrist-01",
    )
    replay.add_argument("file", type=Path, metavar="FILE", help="a recording, .npz or .csv")
    replay.add_argument("--device", required=True, metavar="ID", help="the device it stands for")
    replay.add_argument("--speed", type=float, default=1.0, metavar="N", help="how many times faster (default 1)")
    replay.add_argument("--rate-hz", type=float, metavar="HZ", help="its rate, where the file does not say it")
    replay.add_argument(
        "--connect", action="append", metavar="ENDPOINT", help=f"a router (default: the file's, else {LOCAL})"
    )
    replay.add_argument("--ward", metavar="W", help="the ward's name (default: the file's, else 'ward')")
    replay.add_argument("--config", type=Path, help="take ward and router from this file")
    replay.set_defaults(run=_guarded(_replay))

    router = _parser(verbs, "router", "run zenoh's router here", f"truerate router --listen {LOCAL}")
    router.add_argument("--listen", action="append", metavar="ENDPOINT", help=f"where to listen (default {LOCAL})")
    router.add_argument("--config", type=Path, help="take the endpoints from this file")
    router.set_defaults(run=_guarded(_router))


def _parser(verbs: "Verbs[argparse.ArgumentParser]", name: str, does: str, example: str) -> argparse.ArgumentParser:
    return verbs.add_parser(name, help=does, description=f"{does[0].upper()}{does[1:]}.", epilog=f"Example: {example}")


def _guarded(run: Run) -> Run:
    """Errors as one line on stderr and an exit code."""

    def guarded(args: argparse.Namespace) -> int:
        try:
            return run(args)
        except (ConfigError, ValueError) as error:
            print(f"truerate: {error}", file=sys.stderr)
            return _WRONG
        except (BusError, RecordingError, OSError) as error:
            print(f"truerate: {error}", file=sys.stderr)
            return _FAILED

    return guarded


def _run(args: argparse.Namespace) -> int:
    root = load(args.config, Root)
    if root.bridge is None:
        raise ConfigError(f"{args.config}: it has no table [bridge]")
    if not root.bridge.devices:
        raise ConfigError(f"{args.config}: [bridge]: it has no [[bridge.devices]]")
    return _serve(root.ward, root.bridge, root.bus.connect, patient=True)


def _replay(args: argparse.Namespace) -> int:
    root = load(args.config, Root) if args.config else Root(ward=args.ward or "ward")
    connect = check_endpoints(args.connect, "--connect") if args.connect else root.bus.connect
    load_recording(args.file, args.rate_hz)  # a bad file is said at once, not tried again and again
    options = ReplayedOptions(file=str(args.file), speed=args.speed, rate_hz=args.rate_hz)
    bridge = Bridge(id=f"replay-{args.device}"[:32], devices=(Device.from_table(_table(args.device, options)),))
    return _serve(args.ward or root.ward, bridge, connect, patient=False)


def _table(device: str, options: ReplayedOptions) -> dict[str, object]:
    rate = {} if options.rate_hz is None else {"rate_hz": options.rate_hz}
    return {"id": device, "driver": "replayed", "file": options.file, "speed": options.speed, **rate}


def _serve(ward: str, bridge: Bridge, connect: tuple[str, ...], *, patient: bool) -> int:
    """Publish until stopped, or until every recording is over. Patient: wait for a router rather than give up."""
    with stopped_by_signal() as stop:
        bus = connected(connect, stop, patient=patient)
        if bus is None:
            return _DONE
        with bus, Ward(ward, bridge, bus) as running, _health(bridge, running, bus):
            _log.info(
                "bridge %s: %d devices of ward %s to %s", bridge.id, len(bridge.devices), ward, ", ".join(connect)
            )
            there = True
            while not stop.wait(0.2) and not running.over:
                if bus.connected != there:
                    there = bus.connected
                    _log.warning("router %s", "is back" if there else "is gone; going on, and waiting for it")
    return _DONE


def _health(bridge: Bridge, running: Ward, bus: Bus) -> AbstractContextManager[object]:
    if not bridge.health:
        return nullcontext()
    vitals = Vitals(lambda: running.infos, lambda: running.turned_s, lambda: bus.connected)
    return Health(listening(bridge.health), vitals.asked)


def _list(args: argparse.Namespace) -> int:
    for kind in registry.kinds().values():
        print(f"{kind.name:<12} {kind.summary}")
    if args.config:
        bridge = load(args.config, Root).bridge
        print(f"\n{args.config}:")
        for device in bridge.devices if bridge else ():
            state = registry.kinds()[device.driver].state(device.options)
            print(f"  {device.id:<32} {device.driver:<12} {device.make().place}: {state}")
    return _DONE


def _router(args: argparse.Namespace) -> int:
    listen = load(args.config, Root).router.listen if args.config else (LOCAL,)
    if args.listen:
        listen = check_endpoints(args.listen, "--listen")
    with stopped_by_signal() as stop, Router(listen, shed=keys.VIEWED):
        _log.info("router: listening on %s", ", ".join(listen))
        stop.wait()
    return _DONE
