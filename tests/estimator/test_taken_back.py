"""When a device that another took is taken back, or taken from who does nothing with it; and not to and fro for ever."""

from bridge.wire.messages import Holding, Owned
from estimator.service.cluster import Cluster
from estimator.service.ownership import owner
from tests.estimator.clusters import DEVICES, KNOBS, World


def test_what_was_taken_by_one_that_is_ended_then_is_taken_back_at_once() -> None:
    world = World("e1", "e2")
    world.run(1.5)
    world.run(2.8, still="e2")
    world.run(0.2)
    assert world.all["e2"].held == {}, "it has woken up, and leaves them alone for a while"
    world.kill("e1")
    world.run(0.1)
    assert set(world.all["e2"].held) == set(DEVICES)


def taken_from_the_second() -> tuple[Cluster, float]:
    """One of two that has lost all of its devices to the other."""
    world = World("e1", "e2")
    world.run(1.5)
    world.run(2.8, still="e2")
    world.run(0.2)
    assert world.all["e2"].held == {}
    return world.all["e2"], world.now


def test_who_took_and_is_started_anew_under_its_name_has_ended() -> None:
    two, now = taken_from_the_second()
    device = next(d for d in DEVICES if owner(d, ("e1", "e2")) == "e2")
    two.change("e1", now, alive=False)
    two.change("e1", now + 0.1, alive=True)
    two.said(Owned("e1", 0, two.highest, 0.0, ()), now + 0.2)
    two.look(now + 0.2)
    assert two.wants(device, now + 0.2)


def test_who_took_and_ended_before_that_was_looked_at_has_ended() -> None:
    world = World("e1", "e2")
    world.run(1.5)
    two, device = world.all["e2"], next(iter(world.all["e2"].held))
    taker = two.taker("e1")
    two.change("e1", world.now, alive=False)
    two.look(world.now)
    two.lose(device, taker, world.now)
    assert two.wants(device, world.now + 0.1)


def test_what_another_has_taken_from_who_took_it_is_not_taken_back_at_once() -> None:
    two, now = taken_from_the_second()
    device = next(d for d in DEVICES if owner(d, ("e1", "e2", "e3")) == "e2")
    two.change("e3", now, alive=True)
    two.said(Owned("e3", 0, two.highest + 9, 0.0, (Holding(device, two.highest + 9, 0, 0),)), now)
    two.change("e1", now, alive=False)
    two.look(now)
    assert not two.wants(device, now + 0.1)


def test_over_a_line_that_breaks_again_and_again_devices_are_not_taken_back_at_once_each_time() -> None:
    world = World("e1", "e2")
    world.run(1.5)
    moves, before = 0, world.most()
    for _ in range(20):
        for cut in (True, False):
            world.part("e1", "e2", cut=cut)
            world.run(1.0 if cut else 2.0)
            moves += sum(before[d] != who for d, who in world.most().items())
            before = world.most()
    assert moves <= 12 * len(DEVICES), "each time is 20"


def test_over_a_bad_line_devices_go_to_and_fro_ever_more_seldom_until_it_was_calm() -> None:
    world = World("e1", "e2")
    world.run(1.5)
    device = next(iter(world.all["e2"].held))
    taken = 0
    for _ in range(20):
        had = world.most()[device]
        world.run(4.2, still="e2")
        taken += had == "e2" and world.most()[device] == "e1"
        world.run(3.5)
    assert 3 <= taken <= 10
    world.run(KNOBS.calm_s)
    world.assert_shared()
    world.run(2.7, still="e2")
    assert world.most()[device] == "e1"
    world.run(KNOBS.retry_s + 0.3)
    world.assert_shared()


def test_who_does_nothing_with_what_comes_of_a_device_has_it_no_longer_than_that_is_kept() -> None:
    world = World("e1", "e2")
    world.run(1.5)
    for _ in range(3):
        world.run(4.2, still="e2")
        world.run(3.5)
    world.run(4.2, still="e2")
    device, two = next(d for d in DEVICES if owner(d, ("e1", "e2")) == "e2"), world.all["e2"]
    robbed_s = world.now + 0.1
    world.run(2.0)
    assert world.most()[device] == "e1"
    later_s = robbed_s + KNOBS.stands_s
    assert not two.wants(device, later_s + 0.5, waits_s=0.5), "it is only not to be fought for yet"
    assert not two.wants(device, later_s - 0.5, waits_s=60.0), "who has it may not have said yet how far it is"
    assert two.wants(device, later_s + 0.1, waits_s=KNOBS.stands_s)


def test_of_one_that_hears_nothing_of_a_device_the_next_takes_it_and_nobody_else() -> None:
    world = World("e1", "e2", "e3")
    world.run(1.5)
    for device in DEVICES:
        first = owner(device, list(world.all))
        others = [name for name in world.all if name != first]
        for name in others:
            waits_s = KNOBS.stands_s
            assert world.all[name].wants(device, world.now, waits_s) == (name == owner(device, others))
            assert not world.all[name].wants(device, world.now, waits_s - 0.1)
