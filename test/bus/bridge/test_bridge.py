"""Bridges between machines: here two folders of sockets, which know nothing of each other, and TCP on loopback."""

from __future__ import annotations

import contextlib
import itertools
import os
import re
import signal
import socket
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from functools import partial
from ipaddress import ip_interface
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import zenoh
from agents import DEADLINE_S, IMAGE, NUMBER, Other, until
from programs import Program

from tactile_nodes.bus.bridge.bridge import Bridge
from tactile_nodes.bus.bridge.finding import near
from tactile_nodes.bus.bridge.forwarding import Forward
from tactile_nodes.bus.bridge.keys import create_keys
from tactile_nodes.bus.bridge.link import LONGEST_BYTES, PLAIN_TCP, Address, open_session
from tactile_nodes.bus.bridge.talk import VERSION, Choice, key_of
from tactile_nodes.bus.protocol import Endpoint, Participant, Qos, Received
from tactile_nodes.bus.subscription import Subscription
from tactile_nodes.bus.zeromq.discovery import Meeting
from tactile_nodes.bus.zeromq.host_bus import ZmqBus
from tactile_nodes.bus.zeromq.records import Outlet, Record
from tactile_nodes.errors import NOT_AGAIN, AddressInUseError, ConfigurationError

LATCHED = Qos('latest', 1, latched=True)
HERE = '127.0.0.1'


class Machine:
    """A folder of sockets, and what runs there."""

    def __init__(self, keys: Path) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix='tb', ignore_cleanup_errors=True)
        self.path = Path(self._folder.name)
        self._keys = keys
        self._others: list[Other] = []
        self.programs: list[Program] = []

    def agent(self) -> Other:
        self._others.append(Other(self.path, 0))
        return self._others[-1]

    def run(self, name: str, *parameters: str, node: str = '') -> Program:
        words = [word for parameter in parameters for word in ('-p', parameter)]
        words += ['-r', f'__node:={node}'] if node else []
        environment = {'TACTILE_KEYS': str(self._keys), 'TACTILE_RUN_DIR': str(self.path)}
        place = Path(tempfile.mkdtemp(dir=self.path))
        self.programs.append(Program(place, [name], ['--ros-args', *words], environment))
        return self.programs[-1]

    def bridge(self, *parameters: str, node: str = '') -> Program:
        return self.run('BridgeNode', *parameters, node=node)

    def close(self) -> None:
        for program in self.programs:
            program.process.kill()
            program.process.join()
        for other in self._others:
            other.end()
        self._folder.cleanup()


@pytest.fixture(scope='session')
def keys(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp('keys')
    for name in ('robot', 'lab', 'stranger'):
        create_keys(name, folder)
    return folder


@pytest.fixture
def machine(keys: Path) -> Iterator[Callable[[], Machine]]:
    machines: list[Machine] = []

    def make() -> Machine:
        machines.append(Machine(keys))
        return machines[-1]

    yield make
    for made in machines:
        made.close()


PORTS = (10_000 + (97 * os.getpid() + number) % 22_000 for number in itertools.count())
"""Others for each worker, and below 32768: a port that the system chooses for a test may be another connection's before
the bridge listens there."""


def _is_free(port: int) -> bool:
    with socket.socket() as probe, contextlib.suppress(OSError):
        probe.bind((HERE, port))
        return True
    return False


def _free_port() -> int:
    return next(filter(_is_free, PORTS))


@pytest.fixture
def port() -> int:
    return _free_port()


@pytest.fixture(scope='module')
def joined_at() -> int:
    """The port of the bridge between those that are joined."""
    return _free_port()


@pytest.fixture(scope='module')
def joined(keys: Path, joined_at: int) -> Iterator[tuple[Machine, Machine]]:
    """Two machines with a bridge between them, with keys, which tests share: each has topics of its own."""
    robot, lab = Machine(keys), Machine(keys)
    robot.bridge(f'listen:={HERE}:{joined_at}', 'key:=robot', 'peers:=[lab]')
    lab.bridge(f'connect:={HERE}:{joined_at}', 'key:=lab', 'peers:=[robot]')
    yield robot, lab
    robot.close()
    lab.close()


def _until_received(talker: Other, listener: Other, topic: str) -> None:
    """Until a message comes, or one more."""
    numbers, before = iter(range(1, 100_000)), len(listener.received(topic))
    until(lambda: talker.say(topic, next(numbers)) or len(listener.received(topic)) > before, f'{topic} to cross')


def test_topic_crosses_the_bridge_both_ways(joined: tuple[Machine, Machine]) -> None:
    here, there = (machine.agent() for machine in joined)
    for talker, listener, topic in ((here, there, '/a'), (there, here, '/b')):
        talker.advertise(topic)
        listener.listen(topic)
    for talker, listener, topic in ((here, there, '/a'), (there, here, '/b')):
        _until_received(talker, listener, topic)
        start = max(listener.received(topic))
        talker.say(topic, *range(start + 1000, start + 1050))
        until(lambda: listener.received(topic)[-1] == start + 1049)  # noqa: B023
        assert listener.received(topic)[-50:] == list(range(start + 1000, start + 1050))


def test_latched_message_reaches_those_who_come_late_over_there_once(joined: tuple[Machine, Machine]) -> None:
    talker = joined[0].agent()
    talker.advertise('/ref', IMAGE, LATCHED)
    talker.say('/ref', 7)
    for _ in range(2):
        late = joined[1].agent()
        late.listen('/ref', IMAGE)
        until(lambda: late.received('/ref') == [7])  # noqa: B023


def test_message_keeps_its_publisher_its_number_and_its_stamp(joined: tuple[Machine, Machine]) -> None:
    talker, near, far = joined[0].agent(), joined[0].agent(), joined[1].agent()
    talker.advertise('/n')
    near.listen('/n')
    far.listen('/n')
    _until_received(talker, far, '/n')
    shared = until(lambda: set(near.marks('/n')) & set(far.marks('/n')))
    assert len(shared) >= 1


def test_nodes_of_the_other_machine_are_seen_and_their_services_called(joined: tuple[Machine, Machine]) -> None:
    here, there = joined[0].agent(), joined[1].agent()
    there.add_node('/lab/rig')
    there.serve('/lab/rig/stop', 'refuse')
    there.serve('/lab/rig/home', 'answer')  # whoever knows it knows the one before
    until(lambda: '/lab/rig' in here.nodes())
    until(lambda: here.call('/lab/rig/home', 5.0) == f'from {there.pid()}')
    assert here.call('/lab/rig/stop') == 'ServiceError: /lab/rig/stop: /lab/rig/stop: not today'
    assert here.call('/lab/none').startswith('ServiceUnavailableError')


def test_bridges_that_are_started_as_the_manual_says_share_no_name(machine: Callable[[], Machine], port: int) -> None:
    manual = (Path(__file__).parents[3] / 'docs/bus.md').read_text(encoding='utf-8')
    names = dict(re.findall(r'^(robot|lab)\$ +tactile run bridge_node .*-r __node:=(\w+)', manual, re.MULTILINE))
    robot, lab = machine(), machine()
    robot.bridge(f'listen:={HERE}:{port}', 'key:=robot', 'peers:=[lab]', node=names['robot'])
    lab.bridge(f'connect:={HERE}:{port}', 'key:=lab', 'peers:=[robot]', node=names['lab'])
    agent = robot.agent()
    until(lambda: len([node for node in agent.nodes() if node.startswith('/bridge')]) == 2, 'both bridges')
    assert len(set(agent.nodes())) == len(agent.nodes())


def test_parameters_of_a_node_of_the_other_machine_are_set(joined: tuple[Machine, Machine]) -> None:
    here = joined[0].agent()
    joined[1].run('Tunable')
    until(lambda: '/tunable' in here.nodes())
    assert until(lambda: here.set_parameter('/tunable', 'rate', 30.0)) == (True, '')
    successful, reason = here.set_parameter('/tunable', 'rate', -1.0)
    assert not successful
    assert "'rate' must be at least 0.0" in reason


def test_only_what_is_chosen_crosses_the_bridge(machine: Callable[[], Machine], port: int) -> None:
    robot, lab = machine(), machine()
    robot.bridge(f'listen:={HERE}:{port}', 'send:=[/skin/*, /both]', "serve:=['/allowed']")
    lab.bridge(f'connect:={HERE}:{port}', 'receive:=[/skin/**, /other]')
    talker, listener = robot.agent(), lab.agent()
    for topic in ('/both', '/other', '/skin/deep/force', '/skin/force'):
        talker.advertise(topic)
        listener.listen(topic)
    for service in ('/forbidden', '/allowed'):  # whoever knows the second knows the first
        talker.serve(service, 'answer')
    for topic in ('/both', '/other', '/skin/deep/force'):
        talker.say(topic, 1)
    _until_received(talker, listener, '/skin/force')
    for topic in ('/both', '/other', '/skin/deep/force'):
        talker.say(topic, 2)
    until(lambda: listener.call('/allowed', 5.0).startswith('from'))
    assert 'may not be called from other machines' in listener.call('/forbidden')
    assert [listener.received(topic) for topic in ('/both', '/other', '/skin/deep/force')] == [[], [], []]


@pytest.fixture
def twice_joined(machine: Callable[[], Machine], port: int) -> tuple[Machine, Machine]:
    """Two machines with two bridges between them."""
    robot, lab, second = machine(), machine(), _free_port()
    robot.bridge(f'listen:={HERE}:{port}', node='one')
    lab.bridge(f'connect:={HERE}:{port}', node='one_too')
    robot.bridge(f'connect:={HERE}:{second}', node='two')
    lab.bridge(f'listen:={HERE}:{second}', node='two_too')
    return robot, lab


def test_two_bridges_between_two_machines_neither_loop_nor_double_nor_lose(
    twice_joined: tuple[Machine, Machine],
) -> None:
    here, there = (machine.agent() for machine in twice_joined)
    for agent in (here, there):
        agent.listen('/n')
        agent.advertise('/n')
    until(lambda: {'/one', '/one_too', '/two', '/two_too'} <= set(here.nodes()), 'all bridges')
    numbers = iter(range(1, 100_000))
    until(lambda: here.say('/n', next(numbers)) or there.received('/n'))
    until(lambda: there.say('/n', next(numbers)) or set(here.received('/n')) - set(here.sent('/n')))
    here.say('/n', *range(200_000, 200_050))
    there.say('/n', *range(300_000, 300_050))
    for agent in (here, there):
        until(lambda: {200_049, 300_049} <= set(agent.received('/n')))  # noqa: B023
        numbers_received = agent.received('/n')
        assert len(numbers_received) == len(set(numbers_received))
        assert [number for number in numbers_received if 200_000 <= number < 300_000] == list(range(200_000, 200_050))
        assert [number for number in numbers_received if number >= 300_000] == list(range(300_000, 300_050))
    assert len(here.nodes()) == len(set(here.nodes()))


def test_when_one_of_two_bridges_dies_the_other_carries_on(twice_joined: tuple[Machine, Machine]) -> None:
    robot, lab = twice_joined
    here, there = robot.agent(), lab.agent()
    here.advertise('/n')
    there.listen('/n')
    until(lambda: {'/one', '/two', '/one_too', '/two_too'} <= set(there.nodes()), 'all bridges')
    _until_received(here, there, '/n')
    robot.programs[0].signal(signal.SIGKILL)
    until(lambda: '/one' not in there.nodes())
    _until_received(here, there, '/n')


def test_killed_bridge_is_forgotten_and_a_restarted_one_joins_again(machine: Callable[[], Machine], port: int) -> None:
    robot, lab = machine(), machine()
    robot.bridge(f'listen:={HERE}:{port}')
    here, there = robot.agent(), lab.agent()
    here.advertise('/ref', NUMBER, LATCHED)
    here.say('/ref', 1)
    here.add_node('/camera')
    for number in (1, 2):
        bridge = lab.bridge(f'connect:={HERE}:{port}')
        until(lambda: '/camera' in there.nodes())
        late = lab.agent()
        late.listen('/ref')
        until(lambda: late.received('/ref')[-1:] == [number])  # noqa: B023
        bridge.signal(signal.SIGKILL)
        until(lambda: '/camera' not in there.nodes())
        here.say('/ref', number + 1)


def test_three_machines_see_each_other_when_each_connects_to_those_before(machine: Callable[[], Machine]) -> None:
    first, second, third = _free_port(), _free_port(), _free_port()
    machines = [machine(), machine(), machine()]
    machines[0].bridge(f'listen:={HERE}:{first}')
    machines[1].bridge(f'listen:={HERE}:{second}', f'connect:={HERE}:{first}')
    machines[2].bridge(f'listen:={HERE}:{third}', f"connect:='{HERE}:{first}, {HERE}:{second}'")
    agents = [each.agent() for each in machines]
    for number, agent in enumerate(agents):
        agent.advertise(f'/n{number}')
        agent.listen(f'/n{(number + 1) % 3}')
    for number, agent in enumerate(agents):
        _until_received(agent, agents[number - 1], f'/n{number}')
        numbers = agents[number - 1].received(f'/n{number}')
        assert len(numbers) == len(set(numbers))


def test_bridge_that_listens_may_come_later_and_come_back(machine: Callable[[], Machine], port: int) -> None:
    robot, lab = machine(), machine()
    lab.bridge(f'connect:={HERE}:{port}')
    here, there = robot.agent(), lab.agent()
    here.advertise('/n')
    there.listen('/n')
    for _ in range(2):
        bridge = robot.bridge(f'listen:={HERE}:{port}')
        _until_received(here, there, '/n')
        bridge.signal(signal.SIGKILL)
        bridge.process.join()


@pytest.mark.parametrize('stranger', ['key:=stranger', 'plain', 'wrong server'])
def test_whoever_has_no_key_that_is_allowed_gets_nothing(
    machine: Callable[[], Machine], port: int, stranger: str
) -> None:
    robot, other = machine(), machine()
    robot.bridge(f'listen:={HERE}:{port}', 'key:=robot', 'peers:=[lab]')
    words = {'plain': [], 'wrong server': ['key:=lab', 'peers:=[stranger]']}.get(stranger, [stranger, 'peers:=[robot]'])
    theirs = other.bridge(f'connect:={HERE}:{port}', *words)
    here, there = robot.agent(), other.agent()
    here.add_node('/camera')
    here.advertise('/n', NUMBER, LATCHED)
    here.say('/n', 1)
    there.listen('/n')
    until(lambda: f'no response from {HERE}:{port}' in theirs.output)
    assert (there.received('/n'), [node for node in there.nodes() if node == '/camera']) == ([], [])
    # … and the one who may is let in all the same.
    lab = machine()
    lab.bridge(f'connect:={HERE}:{port}', 'key:=lab', 'peers:=[robot]')
    friend = lab.agent()
    friend.listen('/n')
    until(lambda: friend.received('/n') == [1])


def test_nonsense_from_a_peer_does_not_end_a_bridge(machine: Callable[[], Machine], port: int) -> None:
    robot, lab = machine(), machine()
    robot.bridge(f'listen:={HERE}:{port}')
    here, there = robot.agent(), lab.agent()
    here.advertise('/n')
    there.listen('/n')
    with contextlib.closing(open_session(None, [Address(HERE, port)])) as raw:
        tokens = [raw.liveliness().declare_token(key) for key in (key_of('mallory'), 'tactile_nodes/9/other')]
        alive = partial(raw.liveliness().get, key_of('*'))
        (uid,) = until(lambda: {str(each.ok.key_expr).split('/')[2] for each in alive()} - {'mallory'})
        for payload in (b'', b'{}', b'[]', b'{"host": 1, "participants": 2, "outlets": 3}'):
            raw.put(key_of('mallory', 'state'), payload)
            raw.put(key_of(uid, 'data', 'x.1'), payload)
            raw.put(key_of(uid, 'data', 'x.1'), payload, attachment=b'x')
            for what in ('call', 'now', 'state'):
                list(raw.get(key_of(uid, what), payload=payload, attachment=payload, timeout=1.0))
        lab.bridge(f'connect:={HERE}:{port}')
        _until_received(here, there, '/n')
        assert len(tokens) == 2


def test_bridge_of_another_version_is_named_and_nothing_is_taken_from_it(
    machine: Callable[[], Machine], port: int
) -> None:
    robot = machine()
    bridge = robot.bridge(f'listen:={HERE}:{port}')
    with contextlib.closing(open_session(None, [Address(HERE, port)])) as raw:
        token = raw.liveliness().declare_token(key_of('other', version='9'))
        sentence = f'has version 9 of the bridge, this one has {VERSION}: update the older'
        until(lambda: sentence in bridge.output)
        assert token is not None


@pytest.mark.parametrize(
    ('parameters', 'sentence'),
    [
        ([], 'set listen or connect'),
        (['listen:=0.0.0.0:7461'], f"set plain_tcp to '{PLAIN_TCP}'"),
        (['connect:=192.0.2.1:7461'], 'could be read and used by anyone on the network'),
        (['connect:=nowhere'], "'nowhere' is not an address; use host:port"),
        (['listen:=127.0.0.1:7461', 'key:=robot'], 'set peers to the public keys'),
        (['listen:=127.0.0.1:7461', 'peers:=[lab]'], 'peers has no effect without key: set key'),
        (['listen:=127.0.0.1:7461', 'key:=nobody', 'peers:=[lab]'], 'cannot read the key'),
        (['listen:=192.0.2.77:7461', 'key:=robot', 'peers:=[lab]'], 'is it an address of this machine?'),
        (['connect:=127.0.0.1:7461', 'discover:=true'], 'discover also needs listen'),
        (
            ['listen:=192.0.2.77:7461', 'discover:=true', 'key:=robot', 'peers:=[lab]'],
            '192.0.2.77 is not an address of this machine',
        ),
    ],
)
def test_bridge_that_cannot_or_should_not_be_is_one_sentence(
    machine: Callable[[], Machine], parameters: list[str], sentence: str
) -> None:
    program = machine().bridge(*parameters)
    assert program.ended(DEADLINE_S) in {1, NOT_AGAIN}
    assert sentence in program.output
    assert 'Traceback' not in program.output


def test_port_that_is_taken_is_named_with_what_to_do(machine: Callable[[], Machine], port: int) -> None:
    with socket.socket() as taken:
        taken.bind((HERE, port))
        taken.listen()
        program = machine().bridge(f'listen:={HERE}:{port}')
        assert program.ended(DEADLINE_S) == 1
        assert f'port {port} is in use on {HERE}; stop the program that listens there' in program.output
        with pytest.raises(AddressInUseError):
            open_session(Address(HERE, port))


def test_plain_tcp_on_a_network_needs_the_words(port: int) -> None:
    with pytest.raises(ConfigurationError, match='could be read and used by anyone'):
        open_session(Address.parse(f'*:{port}'), plain_tcp='yes')
    open_session(Address.parse(f'*:{port}'), plain_tcp=PLAIN_TCP).close()


@pytest.mark.parametrize(
    ('text', 'loopback'),
    [
        ('127.0.0.1:1', True), ('localhost:1', True), ('[::1]:1', True),
        ('*:1', False), ('0.0.0.0:1', False), ('robot:1', False),
    ],
)  # fmt: skip
def test_loopback_is_reported_from_networks(text: str, loopback: bool) -> None:
    assert Address.parse(text).is_loopback() is loopback


@pytest.mark.parametrize('text', ['', ':1', 'a', 'a:', 'a:0', 'a:65536', 'a:b', 'udp://a:1', 'a b:1'])
def test_address_that_is_none_is_refused(text: str) -> None:
    with pytest.raises(ConfigurationError, match='is not an address; use host:port'):
        Address.parse(text)


def _listeners(pid: int) -> list[Any]:
    import psutil

    return [entry.laddr for entry in psutil.Process(pid).net_connections('inet') if entry.status == 'LISTEN']


def test_bridge_listens_at_one_port_and_the_connecting_one_at_none(
    joined: tuple[Machine, Machine], joined_at: int
) -> None:
    here = joined[0].agent()
    until(lambda: here.nodes().count('/bridge') == 2)
    robot, lab = (machine.programs[0] for machine in joined)
    assert [tuple(entry) for entry in _listeners(robot.process.pid or 0)] == [(HERE, joined_at)]
    assert _listeners(lab.process.pid or 0) == []
    assert os.getpid() != robot.process.pid


def test_message_longer_than_any_is_not_taken_in_and_the_others_are(port: int) -> None:
    with (
        contextlib.closing(open_session(Address(HERE, port))) as here,
        contextlib.closing(open_session(None, [Address(HERE, port)])) as there,
    ):
        came: list[int] = []
        subscriber = here.declare_subscriber('n', lambda sample: came.append(len(sample.payload)))
        until(lambda: there.put('n', b'x') or came)
        for length in (LONGEST_BYTES + 1, LONGEST_BYTES // 2, 7):
            there.put('n', bytes(length), congestion_control=zenoh.CongestionControl.BLOCK)
        until(lambda: 7 in came)
        assert [length for length in came if length > 1] == [LONGEST_BYTES // 2, 7]
        subscriber.undeclare()


@contextlib.contextmanager
def bridged(here: ZmqBus, there: ZmqBus, port: int) -> Iterator[tuple[Bridge, Bridge]]:
    """Of two buses of this process, the bridge that listens and the one that connects."""
    with (
        contextlib.closing(Bridge(here, open_session(Address(HERE, port)), Choice())) as listening,
        contextlib.closing(Bridge(there, open_session(None, [Address(HERE, port)]), Choice())) as connecting,
    ):
        yield listening, connecting


def test_type_that_a_bridge_does_not_know_keeps_nothing_else_from_crossing(
    folder: Path, join: Callable[..., ZmqBus], port: int
) -> None:
    """A program that was started after a type was added, beside a bridge that was started before."""
    newer, topic, kind = Meeting('0123abcd', 7, folder), '/new', 'tactile_nodes/msg/New'
    outlet = Outlet('0123abcd.1', topic, kind, newer.socket_address(1))
    ends = {'publishers': (Endpoint(topic, kind, '/n', gid=outlet.gid),), 'subscriptions': (Endpoint(topic, kind, ''),)}
    newer.announce(Record(Participant('0123abcd', 1, 'robot', **ends), (outlet,), newer.socket_address(0)))
    here, there = join(7), join(8)
    with bridged(here, there, port) as (listening, connecting):
        until(lambda: there.graph().publishers(topic), 'the machines to see each other')
        assert listening.faults == connecting.faults == 0
    newer.leave()


def test_a_change_that_did_not_arrive_is_asked_for(
    join: Callable[..., ZmqBus], port: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One that is published while the others connect may be lost, or be overtaken by the answer from before."""
    hear, lost = Bridge._hear, list[str]()
    here, there = join(7), join(8)

    def hear_all_but_one(bridge: Bridge, sample: zenoh.Sample) -> None:
        if bridge._bus is there and b'/late' in sample.payload.to_bytes() and not lost:
            lost.append(str(sample.key_expr))
        else:
            hear(bridge, sample)

    monkeypatch.setattr(Bridge, '_hear', hear_all_but_one)
    with bridged(here, there, port) as (_, connecting):
        until(
            lambda: [clock for _, clock in connecting.connected() if clock.ahead_ns is not None],
            'them to know each other',
        )
        here.add_node('/late')
        until(lambda: '/late' in there.graph().nodes())
        assert lost


def test_closed_bridge_receives_nothing_more_of_what_it_forwarded(join: Callable[[], ZmqBus], port: int) -> None:
    """One that searches for others is closed, and opened anew, with each that it finds."""
    robot, bus = join(), join()
    robot.advertise('/reference_image', IMAGE, LATCHED)
    bridge = Bridge(bus, open_session(Address(HERE, port)), Choice())
    until(lambda: bus.own_participant().subscriptions, 'the bridge to receive it')
    bridge.close()
    assert bus.own_participant().subscriptions == ()


def test_picture_that_comes_while_a_bridge_subscribes_to_it_is_sent_and_again_to_who_comes_late() -> None:
    """A latched one would else reach nobody over there until the next; pictures are sent in a thread of their own.

    It is sent again as pictures are: as a reply to the one who came late it stood before forces, on 8 Mbit/s for 1.4 s.
    """
    outlet, sent, asked = Outlet('a.1', '/reference_image', IMAGE, 'ipc://none', latched=True), list[Any](), list[Any]()

    def follow(outlet: Outlet, qos: Qos, node: str, on_ready: Callable[[], None]) -> Subscription:
        subscription = Subscription(outlet.topic, outlet.type_name, qos, node, on_ready, lambda _: None)
        subscription.put(Received(IMAGE, outlet.gid, 1, 0, 0, data=b'a picture'))
        return subscription

    def declare_publisher(_: str, priority: zenoh.Priority, **__: Any) -> Any:
        return SimpleNamespace(put=lambda data, attachment: sent.append((data, priority)))

    session: Any = SimpleNamespace(
        declare_publisher=declare_publisher, declare_queryable=lambda _, handler: asked.append(handler)
    )
    bus: Any = SimpleNamespace(uid='a', follow=follow)
    Forward(session, bus, outlet, lambda action: action(), patient=True).look()
    assert sent == [(b'a picture', zenoh.Priority.DATA_LOW)]
    asked[0](object())
    assert sent == 2 * [(b'a picture', zenoh.Priority.DATA_LOW)]


def test_addresses_that_a_stranger_tells_are_taken_only_where_they_are_in_a_network_of_ours() -> None:
    ends = [('eth0', ip_interface('10.0.0.5/24')), ('docker0', ip_interface('172.17.0.1/16'))]
    addresses = [
        'tls/10.0.0.9:7460?prio=0-5', 'tls/172.17.0.1:7460', 'tls/192.168.1.9:7460', 'tls/[fe80::1%eth0]:7460',
        'tls/robot:7460', 'unixpipe/a', 'tls/10.0.0.9:99999', '',
    ]  # fmt: skip
    assert list(near(addresses, ends)) == [Address('10.0.0.9', 7460)]


SLOW_SHUTDOWN = """
import sys, time, types
from tactile_nodes.nodes.bridge import main

class Slow:
    def __del__(self, sleep=time.sleep):
        sleep(4.0)

sys.modules['slow'] = slow = types.ModuleType('slow')
slow.object = Slow()
sys.exit(main())
"""


def test_bridge_that_still_connects_ends_in_order_while_python_takes_long_to_shut_down(
    tmp_path: Path, port: int
) -> None:
    """An attempt to connect takes 3 s and returned during the shutdown of Python, which aborted the process."""
    with socket.socket() as silent, tempfile.TemporaryDirectory(prefix='tb') as folder:
        silent.bind((HERE, port))
        silent.listen()  # the kernel accepts the connection, and nobody answers
        words = ['--ros-args', '-p', f'connect:={HERE}:{port}']
        program = subprocess.Popen(
            [sys.executable, '-c', SLOW_SHUTDOWN, *words], stderr=subprocess.PIPE, text=True, cwd=tmp_path,
            env={**os.environ, 'TACTILE_RUN_DIR': folder},
        )  # fmt: skip
        assert program.stderr is not None
        assert any('connects to' in line for line in program.stderr)
        program.send_signal(signal.SIGINT)
        _, errors = program.communicate(timeout=60.0)
    said = [line for line in errors.splitlines() if 'no response from' not in line]  # if it was asked a second later
    assert (program.returncode, said) == (0, [])
