"""Who has which device, and who is taken for alive."""

from bridge.wire.checks import MAX_EPOCH
from bridge.wire.messages import Holding, Owned
from estimator.service.cluster import Cluster, ClusterKnobs
from estimator.service.ownership import owner
from tests.estimator.clusters import DEVICES, KNOBS, World


def test_who_is_alone_has_all_at_once() -> None:
    alone = Cluster("e1", now=5.0)
    assert alone.alone
    assert all(alone.wants(device, 5.0) for device in DEVICES)
    assert alone.answers("anything")


def test_who_is_alone_uses_one_epoch() -> None:
    alone = Cluster("e1")
    assert len({alone.take(device, n * 10**9) for n, device in enumerate(DEVICES)}) == 1


def test_devices_are_shared_and_move_no_more_than_they_must() -> None:
    world = World("e1")
    world.run(1.0)
    assert len(world.all["e1"].held) == len(DEVICES)
    world.start("e2")
    world.start("e3")
    world.run(1.5)
    world.assert_shared()
    before = {name: dict(one.held) for name, one in world.all.items()}
    world.kill("e2")
    world.run(0.2)
    world.assert_shared()
    for name, one in world.all.items():
        assert before[name].items() <= one.held.items()


def test_a_newcomer_waits_until_it_knows_and_the_former_owner_goes_on_until_then() -> None:
    world = World("e1")
    world.run(1.0)
    world.start("e2")
    world.run(0.8)
    assert len(world.all["e1"].held) == len(DEVICES)
    assert not world.all["e2"].held
    world.run(0.5)
    world.assert_shared()


def test_a_newcomer_that_still_reads_the_past_waits_and_not_for_ever() -> None:
    world = World("e1")
    world.run(1.0)
    world.start("e2")
    for _ in range(30):
        world.run(0.1)
        world.all["e2"].behind(world.now)
    assert not world.all["e2"].held
    world.run(0.5)
    world.assert_shared()
    world.start("e3")
    for _ in range(160):
        world.run(0.1)
        world.all["e3"].behind(world.now)
    world.assert_shared()


def test_each_turn_at_a_device_has_a_higher_epoch_whatever_the_clocks_say() -> None:
    world = World("e1", "e2")
    world.run(1.5)
    ahead = world.all["e1"].held.copy()
    for device in ahead:  # its clock is a year ahead
        ahead[device] = world.all["e1"].take(device, 2**55)
    world.run(0.2)
    world.kill("e1")
    world.run(0.2)
    assert all(world.all["e2"].held[device] > epoch for device, epoch in ahead.items())


def test_without_a_router_nothing_changes_and_nobody_is_gone_before_all_had_time_to_come_back() -> None:
    world = World("e1", "e2", "e3")
    world.run(1.5)
    one = world.all["e1"]
    held = dict(one.held)
    for name in ("e2", "e3"):
        one.change(name, world.now, alive=False)
    for _ in range(40):
        world.now += 0.1
        one.unreachable(world.now)
        assert one.look(world.now) == ([], [])
    assert [d for d in DEVICES if d not in held and one.wants(d, world.now)] == []
    one.change("e2", world.now, alive=True)
    assert one.look(world.now + 0.9) == ([], [])
    assert one.look(world.now + 1.1) == ([], ["e3"])
    assert held == one.held


def test_one_that_hangs_though_its_connection_lives_is_gone_and_gives_way_when_it_wakes_up() -> None:
    world = World("e1", "e2")
    world.run(1.5)
    world.run(2.4, still="e2")
    world.assert_shared()
    world.run(0.4, still="e2")
    assert set(world.all["e1"].held) == set(DEVICES)
    world.say("e2")
    assert set(world.all["e1"].held) == set(DEVICES)
    world.say("e1")
    assert world.all["e2"].held == {}
    world.run(KNOBS.retry_s + 0.3)
    world.assert_shared()


def test_who_has_just_come_is_given_longer_to_speak() -> None:
    knobs = ClusterKnobs(settle_s=0.0, fresh_s=8.0)
    one = Cluster("e1", [], 0.0, knobs)
    one.change("e2", 0.0, alive=True)
    assert one.look(0.1) == (["e2"], [])
    assert one.look(2.4) == ([], []), "it may load what it needs"
    assert one.look(2.6) == ([], ["e2"])
    one.said(Owned("e2", 0, 0, 0.0, ()), 7.0)
    assert one.look(7.1) == (["e2"], [])
    one.said(Owned("e2", 0, 0, 0.0, ()), 7.2)
    for now in range(40):
        one.said(Owned("e2", 0, 0, 0.0, ()), 7.2 + now / 5)
    assert one.look(16.0 + knobs.hangs_most_s) == ([], ["e2"])
    one.change("e2", 20.0, alive=False)
    one.change("e2", 21.0, alive=True)
    assert one.look(21.1) == (["e2"], [])
    assert one.look(21.0 + knobs.hangs_s + 0.5) == ([], []), "it was started anew"


def test_who_makes_long_pauses_is_not_taken_for_gone_again_at_the_next() -> None:
    world = World("e1", "e2")
    world.run(1.5)
    device = next(iter(world.all["e2"].held))
    world.run(2.7, still="e2")
    assert world.most()[device] == "e1"
    world.run(KNOBS.retry_s + 0.3)
    for _ in range(5):
        world.run(2.7, still="e2")
        assert world.most()[device] == "e2"
        world.run(2.0)
    world.run(KNOBS.hangs_most_s + 0.2, still="e2")  # that is no pause
    assert world.most()[device] == "e1"


def test_what_is_being_calibrated_stays_where_it_is_until_it_is() -> None:
    world = World("e1")
    world.run(1.0)
    world.busy = set(DEVICES[:30])
    world.start("e2")
    world.run(KNOBS.busy_s - 1.0)
    assert set(world.all["e1"].held) >= world.busy
    assert set(world.all["e2"].held) == {d for d in DEVICES[30:] if owner(d, ["e1", "e2"]) == "e2"}
    world.busy.clear()
    world.run(0.3)
    world.assert_shared()


def test_what_is_never_done_with_being_calibrated_goes_where_it_is_to_be() -> None:
    world = World("e1")
    world.run(1.0)
    world.busy = set(DEVICES)
    world.start("e2")
    world.run(KNOBS.busy_s)
    assert not world.all["e2"].held
    world.run(1.5)
    world.assert_shared()


def test_who_dies_or_hangs_while_it_calibrates_is_waited_for_no_longer() -> None:
    world = World("e1", "e2", "e3")
    world.run(1.5)
    world.busy = set(DEVICES)
    world.kill("e3")
    world.run(0.2)
    world.assert_shared()
    idle = next(iter(world.all["e2"].held))
    world.busy.discard(idle)
    world.say("e2")
    world.run(2.8, still="e2")
    assert world.most()[idle] == "e1"
    assert {d for d in DEVICES if world.most()[d] == "e2"} == set(world.all["e2"].held) - {idle}
    world.run(1.5, still="e2")
    assert set(world.all["e1"].held) == set(DEVICES)


def test_our_own_sleep_is_not_held_against_the_others() -> None:
    world = World("e1", "e2")
    world.run(1.5)
    world.now += 10.0
    world.all["e1"].held_up(10.0, world.now)
    assert world.all["e1"].look(world.now) == ([], [])


def test_who_has_slept_for_long_gives_the_others_longer_to_speak() -> None:
    knobs = ClusterKnobs(settle_s=0.0)
    one = Cluster("e1", ["e2"], 0.0, knobs)
    for slept_s, gone in ((0.9 * knobs.hangs_s, ["e2"]), (4.0, [])):
        one.change("e2", 100.0, alive=True)
        one.look(100.0)
        now = 100.0 + slept_s
        one.held_up(slept_s, now)
        assert one.look(now + knobs.hangs_s + 0.1)[1] == gone
    assert one.look(now + knobs.hangs_most_s + 0.1)[1] == ["e2"]


def test_who_has_slept_for_long_takes_nobody_for_gone_whose_token_its_own_router_took_along() -> None:
    one = Cluster("e1", ["e2"], 0.0)
    one.said(Owned("e2", 0, 1, 0.0, ()), 99.9)
    one.look(100.0)
    theirs = next(d for d in DEVICES if owner(d, ("e1", "e2")) == "e2")
    one.held_up(4.0, 104.0)
    one.change("e2", 104.0, alive=False)
    assert one.look(104.0) == ([], [])
    assert not one.wants(theirs, 104.0)
    one.change("e2", 104.5, alive=True)
    assert one.look(107.0) == ([], [])
    one.change("e2", 107.1, alive=False)
    assert one.look(107.1) == ([], ["e2"])
    assert one.wants(theirs, 107.1)


def test_who_is_held_up_again_and_again_takes_over_all_the_same() -> None:
    one, now = Cluster("e1", ["e2"], 0.0, KNOBS), 100.0
    one.said(Owned("e2", 0, 1, 0.0, ()), now)
    one.look(now)
    one.change("e2", now, alive=False)
    gone = list[str]()
    while not gone and now < 100.0 + 2 * KNOBS.most_s:
        now += 1.1 * KNOBS.hangs_s
        one.held_up(1.1 * KNOBS.hangs_s, now)
        gone = one.look(now)[1]
    assert gone == ["e2"]


def test_who_is_held_up_again_and_again_as_it_begins_takes_at_once_what_is_switched_on_meanwhile() -> None:
    """On a busy machine such a device had nobody for 15 s."""
    one, now = Cluster("e1", ["e2"], 0.0, KNOBS), 3.0
    ours = [d for d in DEVICES if owner(d, ("e1", "e2")) == "e1"]
    for _ in range(5):
        now += 1.1 * KNOBS.hangs_s
        one.held_up(1.1 * KNOBS.hangs_s, now)
        for after_s in (0.0, 0.1):
            one.said(Owned("e2", 0, 1, 0.0, (Holding(ours[0], 1, 0, 0),)), now + after_s)
            one.look(now + after_s)
            assert not one.settled(now)
            assert not any(one.wants(d, now + after_s) for d in ours), "that may have been said before we slept"
        one.said(Owned("e2", 0, 1, 0.0, (Holding(ours[1], 1, 0, 0),), part=0, parts=2), now + 0.4)
        assert not any(one.wants(d, now + 0.4) for d in ours), "nor is that all that it has"
        one.said(Owned("e2", 0, 1, 0.0, (Holding(ours[0], 1, 0, 0),), part=1, parts=2), now + 0.4)
        assert {d for d in DEVICES if one.wants(d, now + 0.4)} == set(ours[2:])
    late, first = (
        Cluster("e1", ["e2"], 0.0, KNOBS),
        Owned("e2", 0, 1, 0.0, (Holding(ours[0], 1, 0, 0),), part=1, parts=2),
    )
    late.said(first, 0.5)
    assert not any(late.wants(d, 0.5) for d in ours), "what it said before that was not heard"
    one.change("e3", now, alive=True)
    one.look(now + 0.5)
    assert not any(one.wants(d, now + 0.5) for d in DEVICES), "nor does a third one have told what it has"


def test_who_is_alone_as_it_wakes_up_looks_round_first() -> None:
    one = Cluster("e1", ["e2"], 0.0, KNOBS)
    one.change("e2", 5.0, alive=False)
    one.look(6.0)
    assert one.alone
    one.held_up(10.0, 20.0)
    assert not any(one.wants(d, 20.0 + KNOBS.return_s / 2) for d in DEVICES)
    assert all(one.wants(d, 20.0 + KNOBS.return_s) for d in DEVICES)


def test_a_cut_network_has_an_estimator_on_each_side_and_one_owner_when_it_heals() -> None:
    world = World("e1", "e2")
    world.run(1.5)
    world.part("e1", "e2", cut=True)
    world.run(10.0)
    assert all(set(one.held) == set(DEVICES) for one in world.all.values())
    assert all(world.all["e1"].held[d] != world.all["e2"].held[d] for d in DEVICES)
    world.part("e1", "e2", cut=False)
    world.run(0.3)
    assert sorted(d for one in world.all.values() for d in one.held) == DEVICES
    world.run(KNOBS.retry_s + 0.5)
    world.assert_shared()


def test_an_epoch_that_nobody_could_go_above_is_not_gone_by() -> None:
    world = World("e1", "e2")
    world.run(1.5)
    for one in world.all.values():
        one.said(Owned("e3", 0, MAX_EPOCH, 0.0, ()), world.now)
    world.part("e1", "e2", cut=True)
    world.run(10.0)
    world.part("e1", "e2", cut=False)
    world.run(KNOBS.retry_s + 0.5)
    world.assert_shared()
    world.all["e1"].hear(MAX_EPOCH)
    assert world.all["e1"].highest == max(max(one.held.values()) for one in world.all.values())
    device = next(iter(world.all["e1"].held))
    assert world.all["e1"].said(Owned("e3", 0, 0, 0.0, (Holding(device, MAX_EPOCH, 0, 0),)), world.now) == []


def test_one_who_does_not_know_of_another_does_not_fight_with_it() -> None:
    """e1 never sees e2's token: it goes on with all, and e2 asks for its share again and again, not all the time."""
    world = World("e1", "e2")
    world.run(1.5)
    world.all["e1"].change("e2", world.now, alive=False)
    changes, before = 0, world.most()
    for _ in range(60):
        world.run(0.1)
        changes += sum(before[d] != who for d, who in world.most().items())
        before = world.most()
    assert changes <= 6 * len(DEVICES)


def test_one_answers_for_a_device_that_nobody_has() -> None:
    world = World("e1", "e2", "e3")
    world.run(1.5)
    for device in ("nobody", *DEVICES):
        assert sum(one.answers(device) for one in world.all.values()) == 1
    assert [d for d in DEVICES if world.all["e1"].answers(d)] == sorted(world.all["e1"].held)
