"""Command-line verbs `truerate bridge ...`: run a bridge, list drivers, scan ports, replay recordings, list profiles."""

import argparse
import logging
import time
from contextlib import AbstractContextManager, closing, nullcontext
from pathlib import Path

from bridge.bus.access_self_test import self_test
from bridge.bus.contract import Bus
from bridge.bus.router_watch import RouterWatch
from bridge.bus.routers import Routers
from bridge.bus.startup import claim_id, wait_for_router
from bridge.cli import scan
from bridge.cli.parser import Verbs, add_group, add_guarded
from bridge.cli.reading_options import add_reading, reading_of
from bridge.cli.ward_options import add_ward, ward_of
from bridge.config.schema import Bridge, ConfigError, Device, Root, listening, load
from bridge.config.ward_file import WardFile
from bridge.drivers import registry
from bridge.ingest.health import BridgeHealth
from bridge.ingest.pump import Pump
from bridge.pki.member import Role
from bridge.recording.error import RecordingError
from bridge.recording.reading import as_table
from bridge.runtime.health_server import HealthServer
from bridge.runtime.service_manager import supervised
from bridge.runtime.signals import stopped_by_signal
from bridge.terminal.console import plain_console
from bridge.terminal.plurals import count
from bridge.terminal.tables import Column, Columns
from bridge.text.profile import load_profile, shipped

_DONE, _NOT_USED = 0, 1
_LOOK_S = 0.2
#: a changed file is read after the estimator has read it, so that a new device begins with its model
_SETTLED_S = 1.0
_log = logging.getLogger(__name__)


def add_verbs(verbs: "Verbs[argparse.ArgumentParser]") -> None:
    """Add the command `bridge` and its verbs to the parser; each verb sets `run(args)`, which returns the exit code."""
    run_example = "truerate bridge run configs/ward.toml"
    inner = add_group(verbs, "bridge", "read devices and publish their samples to the ward", f"Example: {run_example}")
    verb = add_guarded(
        inner,
        "run",
        _run,
        "read the devices of a ward file and publish their samples until stopped (Ctrl-C)",
        run_example,
    )
    verb.add_argument("config", type=Path, metavar="CONFIG", help="the ward file (TOML)")
    does = "list the drivers; with CONFIG, also the devices of that file, and whether each can be opened"
    verb = add_guarded(inner, "list", _list, does, "truerate bridge list configs/ward.toml")
    verb.add_argument("config", type=Path, nargs="?", metavar="CONFIG", help="the ward file (TOML)")
    does = "listen on every serial port, recognise the devices, and print their tables for the ward file"
    example = "truerate bridge scan; truerate bridge scan --port tcp://10.0.0.5:8000"
    scan.add_arguments(add_guarded(inner, "scan", scan.scan, does, example))
    does = "publish a recording as if its devices were present"
    example = "truerate bridge replay walk.npz --device wrist-01; truerate bridge replay ward-3-20260801T101500Z.mcap --speed 10"
    _add_replay(add_guarded(inner, "replay", _replay, does, example))
    does = "list the profiles of devices that print text lines"
    add_guarded(inner, "profiles", _profiles, does, "truerate bridge profiles")


def _add_replay(verb: argparse.ArgumentParser) -> None:
    verb.add_argument("file", type=Path, metavar="FILE", help="recording to play: .npz, text such as .csv, or .mcap")
    verb.add_argument(
        "--device", metavar="ID", help="id to publish under; for a .mcap: the only device to play (default: all)"
    )
    verb.add_argument(
        "--speed", type=float, default=1.0, metavar="N", help="multiple of the recorded pace, 0.01 to 1000 (default: 1)"
    )
    add_reading(verb, device=False)
    add_ward(verb)


def _run(args: argparse.Namespace) -> int:
    file = WardFile(
        args.config,
        Root,
        ("bridge",),
        ("bridge.devices",),
        lambda root: _bridge_of(root, args.config),
        _SETTLED_S,
    )
    bridge = _bridge_of(file.root, args.config)
    routers = file.root.bus.routers_as(Role.BRIDGE, name=bridge.id)
    return _serve(file.root.ward, bridge, routers, file)


def _bridge_of(root: Root, path: Path) -> Bridge:
    if root.bridge is None:
        raise ConfigError(f"{path}: the table [bridge] is missing: add it as in configs/ward.toml")
    if not root.bridge.devices:
        raise ConfigError(f"{path}: [bridge] has no device: add a [[bridge.devices]]; `truerate bridge scan` prints it")
    return root.bridge


def _replay(args: argparse.Namespace) -> int:
    root = ward_of(args, Root)
    # Report a bad file at once; the driver would retry it again and again.
    tables = _of_a_ward(args) if args.file.suffix.lower() == ".mcap" else _of_a_device(args)
    bridge = Bridge(
        id=f"replay-{tables[0]['id']}"[:32] if len(tables) == 1 else "replay",
        devices=tuple(Device.from_table(table) for table in tables),
    )
    return _serve(root.ward, bridge, root.bus.routers_as(Role.BRIDGE, name=bridge.id))


def _of_a_ward(args: argparse.Namespace) -> list[dict[str, object]]:
    """Configuration tables of the devices of a ward's recording, or of the chosen device."""
    from bridge.drivers import replayed  # noqa: PLC0415 - slow to import, and only replays need it

    there = replayed.devices(args.file)
    if args.device is not None and args.device not in there:
        raise RecordingError(f"{args.file}: no samples of --device {args.device!r}; choose from {', '.join(there)}")
    played = [args.device] if args.device else there
    return [{**_replayed(args), "id": device, "recorded_device": device} for device in played]


def _of_a_device(args: argparse.Namespace) -> list[dict[str, object]]:
    if not args.file.is_file():
        raise RecordingError(
            f"{args.file}: {'not a file' if args.file.exists() else 'there is no such file'}; give the path of a recording"
        )
    from bridge.recording import load as load_recording  # noqa: PLC0415 - as above

    reading = reading_of(args)
    recorded = load_recording(args.file, reading=reading).device
    if not (device := args.device or recorded):
        raise ValueError(f"{args.file} does not name its device: name it with --device ID")
    return [{**_replayed(args), "id": device, **as_table(reading)}]


def _replayed(args: argparse.Namespace) -> dict[str, object]:
    return {"driver": "replayed", "file": str(args.file), "speed": args.speed}


def _serve(ward: str, bridge: Bridge, connect: Routers, file: WardFile[Root] | None = None) -> int:
    """Publish until stopped, or until every recording has ended.

    file: the ward file, which may change; its bridge waits for a router instead of giving up.
    """
    with stopped_by_signal() as stop, supervised():
        bus = wait_for_router(connect, stop, patient=file is not None)
        if bus is None:
            return _DONE
        for words in self_test(bus, connect, ward):
            _log.error("%s", words)
        with (
            bus,
            closing(claim_id(bus, ward, "bridge", bridge.id)),
            closing(file.answer(bus, connect, Role.BRIDGE, bridge.id)) if file else nullcontext(),
            Pump(ward, bridge, bus) as running,
            _health(bridge, running, bus, connect),
        ):
            _log.info(
                "bridge %s publishes %s of ward %s at %s",
                bridge.id,
                count(len(bridge.devices), "device"),
                ward,
                ", ".join(connect),
            )
            watched = RouterWatch(_log, connect)
            while not stop.wait(_LOOK_S) and not running.over:
                watched.look(time.monotonic(), connected=bus.connected)
                if file and (new := file.look(time.monotonic())) and new.bridge:
                    running.change(new.bridge.devices)
            if running.over and running.refused:
                names = ", ".join(sorted(running.refused))
                _log.error(
                    "the estimator used no sample that was played as %s: play the recording as another device, with --device ID",
                    names,
                )
                return _NOT_USED
    return _DONE


def _health(bridge: Bridge, running: Pump, bus: Bus, routers: Routers) -> AbstractContextManager[object]:
    if not bridge.health:
        return nullcontext()
    vitals = BridgeHealth(lambda: running.infos, lambda: running.turned_s, lambda: bus.connected, routers)
    return HealthServer(listening(bridge.health), vitals.asked)


def _profiles(_: argparse.Namespace) -> int:
    known = Columns([Column("profile", least=16), Column("device", least=20)], headings=False)
    for name in shipped():
        known.add(name, load_profile(name).summary)
    plain_console().print(known)
    return _DONE


def _list(args: argparse.Namespace) -> int:
    known = Columns([Column("driver", least=12), Column("what it reads", least=20)], headings=False)
    for kind in registry.kinds().values():
        known.add(kind.name, kind.summary)
    plain_console().print(known)
    if args.config:
        bridge = load(args.config, Root).bridge
        print(f"\n{args.config}:")
        for device in bridge.devices if bridge else ():
            state = registry.kinds()[device.driver].state(device.options)
            print(f"  {device.id:<32} {device.driver:<12} {device.make().place}: {state}")
    return _DONE
