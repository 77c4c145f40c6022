"""Liveliness: tokens go and come with whoever has them."""

import time

from bridge.bus.contract import Bus
from tests.bridge.bus.worlds import World, eventually


class Watched:
    """What a watcher was told."""

    def __init__(self, bus: Bus, pattern: str) -> None:
        self.changes: list[tuple[str, bool]] = []
        self.declared = bus.watch_alive(pattern, lambda key, alive: self.changes.append((key, alive)))


def test_liveliness_is_seen_by_early_and_late_watchers(world: World, a: Bus, b: Bus) -> None:
    early = Watched(b, "alive/**")
    token = a.declare_alive("alive/x")
    a.declare_alive("other/x")
    eventually(lambda: early.changes == [("alive/x", True)])
    late = Watched(b, "alive/*")
    eventually(lambda: late.changes == [("alive/x", True)])
    time.sleep(0.1)  # see ZenohBus.watch_alive for a token that dies while a watcher joins
    token.close()
    token.close()
    for watched in (early, late):
        eventually(lambda w=watched: w.changes == [("alive/x", True), ("alive/x", False)])  # type: ignore[misc]


def test_a_closed_bus_takes_its_tokens_with_it(world: World, b: Bus) -> None:
    watched = Watched(b, "alive/*")
    with world.bus() as gone:
        gone.declare_alive("alive/y")
        eventually(lambda: watched.changes == [("alive/y", True)])
    eventually(lambda: watched.changes == [("alive/y", True), ("alive/y", False)])


def test_tokens_go_and_come_with_the_connection(world: World, a: Bus, b: Bus) -> None:
    watched = Watched(b, "alive/*")
    a.declare_alive("alive/z")
    eventually(lambda: len(watched.changes) == 1)
    world.stop()
    eventually(lambda: len(watched.changes) == 2)
    world.start()
    eventually(lambda: watched.changes == [("alive/z", alive) for alive in (True, False, True)])


def test_a_watcher_that_raises_keeps_watching(a: Bus, b: Bus) -> None:
    seen: list[str] = []

    def on_change(key: str, alive: bool) -> None:
        seen.append(key)
        raise RuntimeError("not today")

    b.watch_alive("alive/*", on_change)
    for n in range(3):
        a.declare_alive(f"alive/{n}")
    eventually(lambda: sorted(seen) == ["alive/0", "alive/1", "alive/2"])
