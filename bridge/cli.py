"""The verbs `truerate bridge ...` and `truerate router`: arguments in, exit code out."""

import argparse
import logging
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, closing, nullcontext
from datetime import UTC, datetime
from pathlib import Path

from msgspec.structs import replace

from bridge import cli_profiles, cli_scan
from bridge.bus import router_check
from bridge.bus.contract import Bus, BusError
from bridge.bus.router import Router
from bridge.bus.router_check import RouterFile
from bridge.bus.routers import Routers
from bridge.bus.self_test import self_test
from bridge.columns import Column, Columns
from bridge.config import LOCAL, Bridge, ConfigError, Device, Root, check, check_endpoints, listening, load
from bridge.config import Bus as BusTable
from bridge.console import plain_console
from bridge.drivers import registry, replayed
from bridge.health import Health
from bridge.pki.identity import SOON, faults
from bridge.pki.member import Role
from bridge.process import alone, connected, stopped_by_signal
from bridge.recording import RecordingError
from bridge.recording import load as load_recording
from bridge.router_watch import RouterWatch
from bridge.virtual_ximu3.ports import ANNOUNCED_AT, REPLY_PORT, Address
from bridge.virtual_ximu3.show import MOST_DEVICES, Wanted, show
from bridge.vitals import Vitals
from bridge.ward import Ward
from bridge.wire import keys
from bridge.wording import count

_DONE = 0
_LOOK_S = 0.2
#: how often a router says that its certificate ends soon
_SELDOM_S = 12 * 3600.0
_ENDS = "the certificate that this router began with ends on %s: renew it, and start the router again"
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

    scan = _parser(
        inner,
        "scan",
        "listen at every port, and guess which device is there",
        "truerate bridge scan; truerate bridge scan --port tcp://10.0.0.5:8000",
    )
    cli_scan.add_arguments(scan)
    scan.set_defaults(run=_guarded(cli_scan.scan))

    drivers = _parser(inner, "drivers", "show the drivers", "truerate bridge drivers")
    drivers.set_defaults(run=_guarded(_list), config=None)

    replay = _parser(
        inner,
        "replay",
        "publish a recording as if it were a device, or a ward's as if it were the ward",
        "truerate bridge replay walk.npz --device wrist-01; truerate bridge replay ward-3-20260801T101500Z.mcap --speed 10",
    )
    replay.add_argument("file", type=Path, metavar="FILE", help="a recording, .npz or .csv, or a ward's, .mcap")
    replay.add_argument(
        "--device", metavar="ID", help="the device it stands for; of a .mcap only this one (default: all)"
    )
    replay.add_argument("--speed", type=float, default=1.0, metavar="N", help="how many times faster (default 1)")
    replay.add_argument("--rate-hz", type=float, metavar="HZ", help="its rate, where the file does not say it")
    _add_ward(replay)
    replay.set_defaults(run=_guarded(_replay))

    shown = _parser(
        inner,
        "ximu3",
        "show devices of a ward as x-IMU3s, to x-io's GUI and whatever reads those",
        "truerate bridge ximu3 --config configs/ward.toml --device chest --udp 127.0.0.1:8000",
    )
    shown.add_argument(
        "--device", action="append", default=[], metavar="ID", help="which (default: all that are heard)"
    )
    shown.add_argument("--raw", action="store_true", help="raw rates rather than corrected ones")
    shown.add_argument(
        "--udp",
        metavar="HOST:PORT",
        help="send there; the next device to the next port (default 127.0.0.1:8000, unless there is --tcp)",
    )
    shown.add_argument("--tcp", metavar="[HOST:]PORT", help="listen there; the next device at the next port")
    shown.add_argument(
        "--announce",
        default="127.0.0.1",
        metavar="HOST",
        help="tell this host, or broadcast address, of them (default 127.0.0.1)",
    )
    _add_ward(shown)
    shown.set_defaults(run=_guarded(_shown))
    listed = _parser(inner, "profiles", "list the profiles of devices that print lines", "truerate bridge profiles")
    listed.set_defaults(run=_guarded(cli_profiles.profiles))
    tried = _parser(
        inner,
        "try",
        "show what a profile understands of a captured file",
        "truerate bridge try nano-33-ble capture.txt --seconds 60",
    )
    cli_profiles.add_try(tried)
    tried.set_defaults(run=_guarded(cli_profiles.try_profile))

    router = _parser(verbs, "router", "run zenoh's router here", f"truerate router --listen {LOCAL}")
    router.add_argument("--listen", action="append", metavar="ENDPOINT", help=f"where to listen (default {LOCAL})")
    router.add_argument(
        "--config", type=Path, help="take the endpoints from this ward's file; or a file for zenohd, .json5"
    )
    router.set_defaults(run=_guarded(_router))


def _parser(verbs: "Verbs[argparse.ArgumentParser]", name: str, does: str, example: str) -> argparse.ArgumentParser:
    return verbs.add_parser(name, help=does, description=f"{does[0].upper()}{does[1:]}.", epilog=f"Example: {example}")


def _add_ward(verb: argparse.ArgumentParser) -> None:
    verb.add_argument(
        "--connect", action="append", metavar="ENDPOINT", help=f"a router (default: that of --config, else {LOCAL})"
    )
    verb.add_argument("--ward", metavar="W", help="the ward's name (default: that of --config, else 'ward')")
    verb.add_argument("--config", type=Path, help="take ward and router from this file")


def _guarded(run: Run) -> Run:
    """What was given and cannot be is an error of who gave it, as in a file; how errors are said is the command's."""

    def guarded(args: argparse.Namespace) -> int:
        try:
            return run(args)
        except ValueError as error:
            raise ConfigError(str(error)) from None

    return guarded


def _run(args: argparse.Namespace) -> int:
    root = load(args.config, Root)
    if root.bridge is None:
        raise ConfigError(f"{args.config}: it has no table [bridge]")
    if not root.bridge.devices:
        raise ConfigError(f"{args.config}: [bridge]: it has no [[bridge.devices]]")
    routers = root.bus.routers_as(Role.BRIDGE, name=root.bridge.id)
    return _serve(root.ward, root.bridge, routers, patient=True)


def _replay(args: argparse.Namespace) -> int:
    ward, table = _ward_of(args)
    # A bad file is said at once, not tried again and again.
    tables = _of_a_ward(args) if args.file.suffix == ".mcap" else _of_a_device(args)
    bridge = Bridge(
        id=f"replay-{tables[0]['id']}"[:32] if len(tables) == 1 else "replay",
        devices=tuple(Device.from_table(table) for table in tables),
    )
    return _serve(ward, bridge, table.routers_as(Role.BRIDGE, name=bridge.id), patient=False)


def _ward_of(args: argparse.Namespace) -> tuple[str, BusTable]:
    """The ward's name, and [bus]."""
    root = load(args.config, Root) if args.config else Root(ward=args.ward or "ward")
    bus = replace(root.bus, connect=check_endpoints(args.connect, "--connect")) if args.connect else root.bus
    return check(args.ward or root.ward, "--ward"), bus


def _shown(args: argparse.Namespace) -> int:
    ward, table = _ward_of(args)
    connect = table.routers_as(*(() if args.raw else (Role.VIEWER,)), Role.COMMANDER, Role.RECORDER)
    devices = tuple(check(device, "--device") for device in dict.fromkeys(args.device))
    if len(devices) > MOST_DEVICES:
        raise ValueError(f"{len(devices)} devices are to be shown; at most {MOST_DEVICES} can be")
    wanted = Wanted(
        ward=ward,
        devices=devices,
        corrected=not args.raw,
        udp=_address(args.udp or (None if args.tcp else "127.0.0.1:8000"), "--udp"),
        tcp=_address(args.tcp, "--tcp"),
        announce=Address(args.announce, ANNOUNCED_AT) if args.announce else None,
    )
    with stopped_by_signal() as stop:
        bus = connected(connect, stop, patient=True)
        if bus is not None:
            with bus:
                show(bus, wanted, stop)
    return _DONE


def _address(text: str | None, option: str) -> Address | None:
    if text is None:
        return None
    host, _, port = text.rpartition(":")
    highest = (1 << 16) - 1 - REPLY_PORT - MOST_DEVICES
    if not (port.isascii() and port.isdigit() and 0 < int(port) <= highest):
        raise ValueError(f"{option} {text!r} has no port from 1 to {highest}; one looks like 127.0.0.1:8000")
    return Address(host or "127.0.0.1", int(port))


def _of_a_ward(args: argparse.Namespace) -> list[dict[str, object]]:
    """A table for each device of a ward's recording, or for the one that is wanted."""
    there = replayed.devices(args.file)
    if args.device is not None and args.device not in there:
        raise RecordingError(f"{args.file}: there are no samples of {args.device!r} in it; it has {', '.join(there)}")
    played = [args.device] if args.device else there
    return [{**_replayed(args), "id": device, "recorded_device": device} for device in played]


def _of_a_device(args: argparse.Namespace) -> list[dict[str, object]]:
    if not args.file.is_file():
        raise RecordingError(f"{args.file}: {'not a file' if args.file.exists() else 'there is no such file'}")
    if args.device is None and args.file.suffix != ".part":  # of which loading says what is to be done first
        raise ValueError(f"{args.file} does not say which device it is of: say it with --device ID")
    load_recording(args.file, args.rate_hz)
    rate = {} if args.rate_hz is None else {"rate_hz": args.rate_hz}
    return [{**_replayed(args), "id": args.device, **rate}]


def _replayed(args: argparse.Namespace) -> dict[str, object]:
    return {"driver": "replayed", "file": str(args.file), "speed": args.speed}


def _serve(ward: str, bridge: Bridge, connect: Routers, *, patient: bool) -> int:
    """Publish until stopped, or until every recording is over. Patient: wait for a router rather than give up."""
    with stopped_by_signal() as stop:
        bus = connected(connect, stop, patient=patient)
        if bus is None:
            return _DONE
        for words in self_test(bus, connect, ward):
            _log.error("%s", words)
        with (
            bus,
            closing(alone(bus, ward, "bridge", bridge.id)),
            Ward(ward, bridge, bus) as running,
            _health(bridge, running, bus, connect),
        ):
            _log.info(
                "bridge %s: %s of ward %s to %s",
                bridge.id,
                count(len(bridge.devices), "device"),
                ward,
                ", ".join(connect),
            )
            watched = RouterWatch(_log, _LOOK_S, connect)
            while not stop.wait(_LOOK_S) and not running.over:
                watched.look(time.monotonic(), connected=bus.connected)
    return _DONE


def _health(bridge: Bridge, running: Ward, bus: Bus, routers: Routers) -> AbstractContextManager[object]:
    if not bridge.health:
        return nullcontext()
    vitals = Vitals(lambda: running.infos, lambda: running.turned_s, lambda: bus.connected, routers)
    return Health(listening(bridge.health), vitals.asked)


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


def _router(args: argparse.Namespace) -> int:
    written = args.config and args.config.suffix in (".json5", ".json")
    file = _looked_through(args.config) if written else None
    ends = Routers(file.listen, file.identity).until() if file else None
    with stopped_by_signal() as stop, _listening_router(args, written=bool(written)) as router:
        _log.info("router: listening on %s", ", ".join(router.listen))
        while True:  # of the certificate that it began with: of a new one it knows nothing
            if ends and ends < datetime.now(UTC) + SOON:
                _log.warning(_ENDS, f"{ends:%Y-%m-%d %H:%M} UTC")
            if stop.wait(_SELDOM_S):
                return _DONE


def _looked_through(path: Path) -> RouterFile:
    """A router's own file; BusError where by its certificate it would be of no use."""
    file = router_check.read(path)
    if file.identity is not None and (wrong := faults(file.identity, datetime.now(UTC), (Role.ROUTER,))):
        raise BusError("\n".join(wrong))
    for words in file.faults:
        _log.warning("%s: %s", path, words)
    return file


def _listening_router(args: argparse.Namespace, *, written: bool) -> Router:
    if written:
        if args.listen:
            raise ValueError(f"{args.config} says where to listen, and what is safe there: change it in the file")
        return Router.of_file(args.config)
    root = load(args.config, Root) if args.config else None
    if root is not None and root.bus.identity is not None and not args.listen:
        raise ConfigError(
            f"{args.config}: by its [bus] a router asks for certificates, which this one would not: `truerate pki router` writes"
            " a file for one that does, `truerate router --config router.json5`"
        )
    listen = root.router.listen if root else (LOCAL,)
    return Router(check_endpoints(args.listen, "--listen") if args.listen else listen, shed=keys.VIEWED)
