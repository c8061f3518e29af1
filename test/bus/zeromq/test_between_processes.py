"""The bus between processes: who comes late, is slow, hangs or dies harms nobody else."""

from __future__ import annotations

import os
import signal
import stat
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from agents import IMAGE, NUMBER, FullDisk, Other, image, number_of, until

from tactile_nodes.bus.protocol import Qos
from tactile_nodes.bus.subscription import Subscription
from tactile_nodes.bus.zeromq import receiving
from tactile_nodes.bus.zeromq.host_bus import ZmqBus
from tactile_nodes.bus.zeromq.receiving import Receiver
from tactile_nodes.messages import types

Start = Callable[..., Other]
Join = Callable[..., ZmqBus]
QUEUE = Qos('queue', 1000)
LATCHED = Qos('latest', 1, latched=True)
MEGABYTE = 1 << 20


def _taken(subscription: Subscription, into: list[int]) -> list[int]:
    while (received := subscription.take()) is not None:
        into.append(number_of(received))
    return into


def _meet(publisher: Other, subscriber: Other, topic: str) -> None:
    """Wait until what `publisher` says reaches `subscriber`: number 0 does."""

    def try_once() -> bool:
        publisher.say(topic, 0)
        return 0 in subscriber.received(topic)

    until(try_once, f'{topic} to be connected')


def test_messages_of_several_processes_arrive_complete_and_in_order(start: Start, join: Join) -> None:
    bus = join()
    subscription = bus.subscribe('/n', NUMBER, QUEUE)
    one, two = start(), start()
    one.advertise('/n')
    two.advertise('/n')
    got: list[int] = []
    until(lambda: one.say('/n', 0) or two.say('/n', 1) or {0, 1} <= set(_taken(subscription, got)), 'both')
    one.say('/n', *range(100, 200))
    two.say('/n', *range(200, 300))
    until(lambda: len([n for n in _taken(subscription, got) if n >= 100]) == 200, 'all 200')
    assert [n for n in got if 100 <= n < 200] == list(range(100, 200))
    assert [n for n in got if n >= 200] == list(range(200, 300))


def test_stamps_of_different_processes_are_on_one_time_base(start: Start, join: Join) -> None:
    bus, other = join(), start()
    subscription = bus.subscribe('/n', NUMBER, QUEUE)
    other.advertise('/n')
    before_ns = bus.clock.now_ns()
    received = until(lambda: other.say('/n', 1) or subscription.take())
    assert before_ns < received.source_ns < received.received_ns < bus.clock.now_ns()


def test_subscriber_that_comes_late_receives_from_then_on(start: Start, join: Join) -> None:
    talker = start()
    talker.advertise('/n')
    talker.talk('/n', 0.002)
    until(lambda: talker.count_published() > 20)
    subscription = join().subscribe('/n', NUMBER, QUEUE)
    got: list[int] = []
    until(lambda: len(_taken(subscription, got)) > 20)
    assert got == list(range(got[0], got[0] + len(got)))
    assert got[0] > 20


def test_slow_subscriber_gets_the_newest_and_counts_the_rest(start: Start, join: Join) -> None:
    bus, talker = join(), start()
    slow, prompt = bus.subscribe('/n', NUMBER, Qos('latest', 1)), bus.subscribe('/n', NUMBER, QUEUE)
    talker.advertise('/n')
    got: list[int] = []
    until(lambda: talker.say('/n', 0) or _taken(prompt, got))
    talker.say('/n', *range(1, 501))
    until(lambda: _taken(prompt, got)[-1] == 500, 'the newest')  # the other one, made before, has it by now
    assert got[-500:] == list(range(1, 501))
    assert _taken(slow, []) == [500]
    assert slow.dropped + 1 == slow.received == len(got)


def test_stopped_subscriber_slows_neither_publisher_nor_healthy_subscriber_and_memory_stays_bounded(
    start: Start,
) -> None:
    talker, healthy, stuck = start(), start(), start()
    talker.advertise('/image', IMAGE, Qos('latest', 1))
    for other in (healthy, stuck):
        other.listen('/image', IMAGE, Qos('latest', 1))
        _meet(talker, other, '/image')
    stuck.signal(signal.SIGSTOP)
    before = talker.resident_bytes()
    talker.talk('/image', 0.002)
    until(lambda: talker.count_published() > 300, 'the publisher to go on')  # 300 images are 58 MB
    until(lambda: talker.count_published() - healthy.received('/image')[-1] < 20, 'the healthy one to keep up')
    published = talker.count_published()
    until(lambda: healthy.received('/image')[-1] > published, 'the healthy one to go on')
    assert talker.resident_bytes() - before < 25 * MEGABYTE
    stuck.signal(signal.SIGCONT)
    until(lambda: stuck.received('/image')[-1] > published, 'the stuck one to catch up')


def test_publishers_loop_takes_as_long_with_a_stopped_subscriber_as_with_a_running_one(start: Start) -> None:
    talker, other = start(), start()
    talker.advertise('/image', IMAGE, Qos('latest', 1))
    other.listen('/image', IMAGE, Qos('latest', 1))
    _meet(talker, other, '/image')

    running_s = talker.takes_s('/image', 100)
    other.signal(signal.SIGSTOP)
    stopped_s = talker.takes_s('/image', 100)
    other.signal(signal.SIGCONT)
    assert stopped_s < 2 * running_s + 0.005


def test_killed_subscriber_is_forgotten_and_disturbs_nobody(start: Start, folder: Path) -> None:
    talker, healthy, victim = start(), start(), start()
    talker.advertise('/n')
    for other in (healthy, victim):
        other.listen('/n')
        _meet(talker, other, '/n')
    victim.signal(signal.SIGKILL)
    talker.talk('/n', 0.002)
    until(lambda: len(healthy.received('/n')) > 100)
    until(lambda: len(list(folder.glob('d7/*.lock'))) == 2, 'the files of the dead one to go')
    until(lambda: list(folder.glob('d7/*.sock')) and len(list(folder.glob('d7/*.json'))) == 2)


def test_killed_and_restarted_publisher_is_heard_again(start: Start, join: Join) -> None:
    subscription = join().subscribe('/n', NUMBER, QUEUE)
    got: list[int] = []
    for number in (1, 2):
        talker = start()
        talker.advertise('/n')
        until(lambda: talker.say('/n', number) or number in _taken(subscription, got))  # noqa: B023
        talker.signal(signal.SIGKILL)


def test_killed_and_restarted_subscriber_hears_again(start: Start) -> None:
    talker = start()
    talker.advertise('/n')
    talker.talk('/n', 0.002)
    for _ in range(2):
        listener = start()
        listener.listen('/n')
        until(lambda: len(listener.received('/n')) > 10)  # noqa: B023
        listener.signal(signal.SIGKILL)


def test_last_messages_of_a_process_that_leaves_still_arrive(start: Start, join: Join) -> None:
    subscription = join().subscribe('/n', NUMBER, QUEUE)
    talker = start()
    talker.advertise('/n')
    got: list[int] = []
    until(lambda: talker.say('/n', 0) or 0 in _taken(subscription, got))
    talker.say('/n', *range(1, 200))
    talker.close()
    until(lambda: _taken(subscription, got)[-199:] == list(range(1, 200)), 'what was said at last')


def test_last_messages_of_a_publisher_that_left_arrive_also_where_time_is_short(
    join: Join, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On a busy computer they still wait in the subscriber's socket when it has long been seen that nobody is there."""
    take_in = Receiver.take_in

    def take_in_late(receiver: Receiver) -> None:
        time.sleep(0.002)
        take_in(receiver)

    monkeypatch.setattr(receiving, '_LEAVE_AFTER_S', 0.0)
    monkeypatch.setattr(Receiver, 'take_in', take_in_late)
    listening, leaving = join(), join()
    subscription = listening.subscribe('/n', NUMBER, QUEUE)
    publisher = leaving.advertise('/n', NUMBER, QUEUE)
    until(lambda: publisher.listeners)
    for number in range(500):
        publisher.publish(types.Int64(data=number))
    leaving.close()
    until(lambda: not listening.peers(), 'the publisher to be gone')
    got: list[int] = []
    until(lambda: _taken(subscription, got)[-1:] == [499], 'what was said at last')
    assert got == list(range(500))


def test_latched_message_reaches_each_late_process_once(start: Start) -> None:
    talker, early = start(), start()
    early.listen('/ref')
    talker.advertise('/ref', NUMBER, LATCHED)
    talker.say('/ref', 1)
    until(lambda: early.received('/ref') == [1])
    for _ in range(2):
        late = start()
        late.listen('/ref')
        until(lambda: late.received('/ref') == [1])  # noqa: B023
    talker.say('/ref', 2)
    until(lambda: 2 in early.received('/ref'))
    assert early.received('/ref') == [1, 2]


def test_latched_message_reaches_a_second_subscriber_of_the_same_process(start: Start, join: Join) -> None:
    bus, talker = join(), start()
    first = bus.subscribe('/ref', NUMBER, QUEUE)
    talker.advertise('/ref', NUMBER, LATCHED)
    talker.say('/ref', 1)
    got: list[int] = []
    until(lambda: _taken(first, got) == [1])
    second = bus.subscribe('/ref', NUMBER, QUEUE)
    received = second.get(30.0)
    assert received is not None
    assert number_of(received) == 1
    assert first.take() is None


def test_latched_image_reaches_who_comes_while_another_leaves(start: Start, join: Join) -> None:
    publisher = join().advertise('/ref', IMAGE, LATCHED)
    publisher.publish(image(3))
    for _ in range(3):
        late = start()
        late.listen('/ref', IMAGE)
        until(lambda: late.received('/ref') == [3])  # noqa: B023
        late.signal(signal.SIGKILL)


def test_node_that_was_killed_leaves_the_graph_and_a_restarted_one_returns(start: Start, join: Join) -> None:
    bus = join()
    for _ in range(2):
        other = start()
        other.add_node('/skin/camera')
        until(lambda: bus.graph().nodes() == ['/skin/camera'])
        other.signal(signal.SIGKILL)
        until(lambda: bus.graph().nodes() == [])


def test_stopped_process_is_alive_but_does_not_answer_a_ping(start: Start, join: Join) -> None:
    bus, other = join(), start()
    (record,) = until(bus.peers)
    uid = record.participant.uid
    assert until(lambda: bus.ping(uid), 'an answer') < 5.0
    other.signal(signal.SIGSTOP)
    assert bus.ping(uid, timeout_s=0.1) is None
    assert [peer.participant.uid for peer in bus.peers()] == [uid]


def test_two_domains_on_one_host_do_not_hear_each_other(start: Start) -> None:
    talker, same, other = start(8), start(8), start(9)
    for listener in (same, other):
        listener.listen('/n')
    talker.advertise('/n')
    talker.add_node('/talker')
    _meet(talker, same, '/n')
    assert other.received('/n') == []
    assert (same.nodes(), other.nodes()) == (['/talker'], [])


def test_domain_is_taken_from_ros_domain_id(start: Start) -> None:
    talker = start(None, {'ROS_DOMAIN_ID': '12'})
    same, default = start(12), start(None)
    for listener in (same, default):
        listener.listen('/n')
    talker.advertise('/n')
    _meet(talker, same, '/n')
    assert default.received('/n') == []


def test_nothing_listens_on_any_network(start: Start) -> None:
    other = start()
    other.advertise('/n')
    other.listen('/m')
    other.serve('/s', 'answer')
    assert other.addresses() == []


def test_sockets_and_their_folder_are_the_users_own(start: Start, folder: Path) -> None:
    other = start()
    other.advertise('/n')
    assert stat.S_IMODE((folder / 'd7').stat().st_mode) == 0o700
    sockets = list((folder / 'd7').glob('*.sock'))
    assert len(sockets) == 2
    assert all(file.stat().st_uid == os.getuid() for file in sockets)


@pytest.mark.skipif(os.getuid() != 0, reason='only root can become somebody else')
def test_another_user_cannot_reach_the_sockets(start: Start, folder: Path) -> None:
    other = start()
    other.advertise('/n')
    socket = next((folder / 'd7').glob('*.sock'))
    child = os.fork()
    if child == 0:
        os.setgid(65534)
        os.setuid(65534)
        os._exit(0 if not os.access(socket, os.F_OK) and not os.access(folder / 'd7', os.R_OK | os.X_OK) else 1)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0


def test_fifty_participants_meet(start: Start, join: Join) -> None:
    buses = [join() for _ in range(49)]
    publishers = [bus.advertise('/n', NUMBER, QUEUE) for bus in buses]
    listener = start()
    listener.listen('/n')
    until(lambda: all(publisher.listeners for publisher in publishers), 'fifty to meet')
    for index, publisher in enumerate(publishers):
        publisher.publish(types.Int64(data=index))
    until(lambda: sorted(listener.received('/n')) == list(range(49)), 'all of their messages')


def test_fault_that_cannot_be_reported_because_the_disk_is_full_makes_nobody_deaf(
    join: Join, monkeypatch: pytest.MonkeyPatch
) -> None:
    publisher = join().advertise('/n', NUMBER, QUEUE)
    listening = join()
    monkeypatch.setattr('sys.stderr', FullDisk())
    listening._hub.post(lambda: {}['a bug'])
    until(lambda: listening._hub.faults, 'the fault')
    subscription = listening.subscribe('/n', NUMBER, QUEUE)
    until(lambda: publisher.publish(types.Int64(data=1)) or subscription.take(), 'a message')
