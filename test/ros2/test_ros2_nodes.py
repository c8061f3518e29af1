"""Nodes on a ROS 2 graph as its users see them: parameters, /clock, names, quality of service, the end of a program."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import pytest
from ros2_here import environment

from tactile_nodes.bus import topics
from tactile_nodes.bus.node.arguments import parse_arguments
from tactile_nodes.bus.node.node import Node, NodeParams
from tactile_nodes.bus.node.parameter_client import ParameterClient
from tactile_nodes.bus.node.parameters import to_message
from tactile_nodes.bus.node.runtime import open_bus
from tactile_nodes.bus.protocol import Qos
from tactile_nodes.errors import NOT_AGAIN, BusError, ConfigurationError
from tactile_nodes.messages import services, types
from tactile_nodes.params import parameter

QUEUE = Qos('queue', 100)

Join = Callable[[], Any]
Until = Callable[[Callable[[], Any]], Any]
Start = Callable[..., Any]


@dataclass(frozen=True)
class Params(NodeParams):
    rate: float = parameter(60.0, 'frames per second', minimum=1.0, maximum=240.0)
    names: tuple[str, ...] = parameter((), 'a list')


class Sensor(Node):
    NAME = 'sensor'
    PARAMS = Params

    def __init__(self, bus: Any, arguments: Any = None, clock: Any = None) -> None:
        super().__init__(bus, arguments, clock)
        self.forces = self.create_publisher(topics.WRENCH)
        self.images: list[Any] = []
        self.create_subscription(topics.IMAGE, self.images.append)
        self.create_trigger('~/tare', self.tare)
        self.ticks: list[int] = []
        self.create_timer(0.1, lambda: self.ticks.append(self.clock.now_ns()))

    def tare(self) -> str:
        raise ConfigurationError('nothing touches the gel yet')


@pytest.fixture
def start(join: Join, spinning: Callable[[Node], Node]) -> Start:
    """Start a node in a participant and a thread of its own: ``start('-r', '__ns:=/skin')``."""

    def make(*arguments: str) -> Node:
        return spinning(Sensor(join(), parse_arguments(['--ros-args', *arguments])))

    return make


def _client(bus: Any, node: str, until: Until) -> ParameterClient:
    until(lambda: bus.graph().services(f'{node}/list_parameters'))
    return ParameterClient(bus, node)


def test_parameters_are_listed_read_described_and_set(start: Start, join: Join, until: Until) -> None:
    node = start('-p', 'rate:=30.0')
    client = _client(join(), '/sensor', until)
    assert client.names() == ['names', 'rate', 'use_sim_time']
    assert client.values(['rate', 'names', 'none']) == {'rate': 30.0, 'names': [], 'none': None}
    client.set('rate', 50.0)
    assert node.params.rate == 50.0
    with pytest.raises(ConfigurationError, match="'rate' must be"):
        client.set('rate', 500.0)
    (described,) = client.descriptors(['rate'])
    assert described.floating_point_range[0].to_value == 240.0


def test_all_six_parameter_services_are_there_because_clients_wait_for_all(
    start: Start, join: Join, until: Until
) -> None:
    start()
    bus = join()
    wanted = {
        'describe_parameters', 'get_parameters', 'get_parameter_types', 'list_parameters', 'set_parameters',
        'set_parameters_atomically',
    }  # fmt: skip
    until(lambda: wanted <= {end.name.removeprefix('/sensor/') for end in bus.graph().services()})


def test_types_of_parameters_are_reported(start: Start, join: Join) -> None:
    start()
    request = types.GetParameterTypes_Request(names=['rate', 'names', 'use_sim_time', 'none'])
    response = join().call('/sensor/get_parameter_types', services.GET_PARAMETER_TYPES, request)
    assert response.types.tolist() == [3, 9, 1, 0]  # DOUBLE, STRING_ARRAY, BOOL, NOT_SET of ParameterType.msg


def test_parameters_set_atomically_are_all_set_or_none(start: Start, join: Join) -> None:
    node = start()
    entries = [('names', ['a']), ('rate', 0.0)]
    request = types.SetParametersAtomically_Request(
        parameters=[types.Parameter(name=name, value=to_message(value)) for name, value in entries]
    )
    result = join().call('/sensor/set_parameters_atomically', services.SET_PARAMETERS_ATOMICALLY, request).result
    assert not result.successful
    assert "'rate' must be" in result.reason
    assert node.params.names == ()


def test_parameters_that_were_set_are_reported_to_the_graph(start: Start, join: Join, until: Until) -> None:
    start()
    bus = join()
    events = bus.subscribe('/parameter_events', 'rcl_interfaces/msg/ParameterEvent', QUEUE)
    client = _client(bus, '/sensor', until)
    until(lambda: len(bus.graph().publishers('/parameter_events')) >= 2)
    with pytest.raises(ConfigurationError):
        client.set('rate', 500.0)
    client.set('rate', 50.0)
    event: Any = None
    while event is None or event.node != '/sensor':  # rclpy's own nodes tell of theirs
        event = until(lambda: events.get(0.2)).message
    (changed,) = event.changed_parameters
    assert (changed.name, changed.value.double_value) == ('rate', 50.0)


def test_trigger_that_fails_answers_with_its_sentence(start: Start, join: Join) -> None:
    start()
    response = join().call('/sensor/tare', services.TRIGGER, types.Trigger_Request())
    assert (response.success, response.message) == (False, 'nothing touches the gel yet')


def test_namespace_and_remaps_of_the_command_line_hold_in_the_graph(start: Start, join: Join, until: Until) -> None:
    start('-r', '__ns:=/skin', '-r', '__node:=left', '-r', 'wrench:=/arm/wrench', '-r', 'image_raw:=camera/image')
    bus = join()
    graph = until(lambda: (found := bus.graph()).publishers('/arm/wrench') and found)
    assert '/skin/left' in graph.nodes()
    assert [end.node for end in until(lambda: bus.graph().subscriptions('/skin/camera/image'))] == ['/skin/left']
    assert not graph.publishers('/wrench')


def test_simulated_time_comes_from_clock(start: Start, join: Join, until: Until) -> None:
    node = start('-p', 'use_sim_time:=true')
    topic = topics.CLOCK
    publisher = join().advertise(topic.name, topic.type_name, Qos('latest', 1, reliable=False))
    until(lambda: publisher.listeners)
    for nanosec in (0, 150_000_000):
        clock, now_ns = types.Clock(clock=types.Time(sec=100, nanosec=nanosec)), 100 * 10**9 + nanosec
        # Again and again: what is sent once as best effort may be lost on a busy machine.
        until(lambda clock=clock, now_ns=now_ns: publisher.publish(clock) or node.clock.now_ns() == now_ns)
    until(lambda: node.ticks)
    assert node.ticks[-1] == 100_150_000_000


def test_rosout_and_diagnostics_are_in_the_graph(start: Start, join: Join, until: Until) -> None:
    node = start()
    bus = join()
    said = bus.subscribe(topics.ROSOUT.name, topics.ROSOUT.type_name, QUEUE)
    how = bus.subscribe(topics.DIAGNOSTICS.name, topics.DIAGNOSTICS.type_name, QUEUE)
    until(lambda: node.log.publisher and node.log.publisher.listeners)
    node.log.warn('the gel is dusty')
    node.report('camera', 0, '')
    texts: list[str] = []
    until(lambda: 'the gel is dusty' in [*texts, *([r.message.msg] if (r := said.take()) else [])])
    assert until(lambda: how.get(0.2)).message.header.stamp.sec > 0


def test_quality_of_service_is_set_by_parameters(start: Start, join: Join, until: Until) -> None:
    node = start('-p', 'qos_overrides./wrench.publisher.durability:=transient_local')
    node.forces.publish(types.WrenchStamped())
    bus = join()
    until(lambda: bus.graph().publishers('/wrench'))
    assert bus.graph().publishers('/wrench')[0].latched
    assert bus.subscribe('/wrench', topics.WRENCH.type_name, QUEUE).get(10.0) is not None


def test_image_is_received_in_the_thread_of_the_node(start: Start, join: Join, until: Until) -> None:
    node = start()
    publisher = join().advertise('/image_raw', topics.IMAGE.type_name, topics.IMAGE.qos)
    until(lambda: publisher.listeners)
    publisher.publish(types.Image(header=types.Header(stamp=types.Time(sec=3))))
    until(lambda: node.images)
    assert node.images[0].message.header.stamp.sec == 3


class Refusing:
    """A publisher or client of rclpy's that the middleware refuses (RCLError) or that is gone (InvalidHandle).

    Both are RuntimeErrors.
    """

    def publish(self, data: bytes) -> None:
        raise RuntimeError('Failed to publish: cannot publish data')

    def wait_for_service(self, timeout_sec: float) -> bool:
        raise RuntimeError('cannot use Destroyable because destruction was requested')


def test_a_message_that_the_middleware_refuses_does_not_end_the_node(
    start: Start, until: Until, capfd: pytest.CaptureFixture[str]
) -> None:
    node = start()
    node.forces._handle = Refusing()
    node.post(lambda: node.forces.publish(types.WrenchStamped()))
    went_on: list[int] = []
    node.post(lambda: went_on.append(1))
    until(lambda: went_on)
    assert 'errors: ROS 2 did not publish a message on /wrench (Failed to publish: cannot' in capfd.readouterr().err


def test_a_call_while_the_bus_is_closed_is_refused_in_a_sentence(join: Join) -> None:
    bus = join()
    bus._clients['/s', services.TRIGGER] = Refusing()
    with pytest.raises(BusError, match=r'ROS 2 could not call /s \(cannot use Destroyable'):
        bus.call('/s', services.TRIGGER, types.Trigger_Request())


# --- programs ---------------------------------------------------------------------------------------------------


def test_unknown_bus_is_refused_in_a_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv('TACTILE_BUS', 'ros1')
    with pytest.raises(ConfigurationError, match="TACTILE_BUS is 'ros1'; set it to zeromq, ros2 or auto"):
        open_bus()


def test_without_rclpy_a_node_says_what_to_source() -> None:
    code = (
        'import sys; sys.modules["rclpy"] = None\n'
        'from tactile_nodes.nodes.flow_features import main\nsys.argv = ["flow_features_node"]\nsys.exit(main())'
    )
    ended = subprocess.run(
        [sys.executable, '-c', code], env=environment(TACTILE_BUS='ros2'), capture_output=True, text=True, check=False
    )
    assert ended.returncode == NOT_AGAIN
    assert ended.stderr.startswith('TACTILE_BUS=ros2 needs rclpy')
    assert 'source /opt/ros/jazzy/setup.bash' in ended.stderr
    assert 'Traceback' not in ended.stderr


_READY = """
import sys
from tactile_nodes.bus.node.node import Node
from tactile_nodes.bus.node.runtime import run_node

class Ready(Node):
    def __init__(self, *arguments):
        super().__init__(*arguments)
        self.post(lambda: print('running', flush=True))

sys.exit(run_node(Ready))
"""


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_program_of_a_node_ends_soon_and_cleanly_on_a_signal(number: signal.Signals) -> None:
    words, pipe = [sys.executable, '-c', _READY], subprocess.PIPE
    with subprocess.Popen(words, env=environment(TACTILE_BUS='ros2'), stdout=pipe, stderr=pipe, text=True) as program:
        assert program.stdout is not None
        assert program.stdout.readline() == 'running\n'
        program.send_signal(number)
        _, said = program.communicate(timeout=60.0)
    assert program.returncode == 0, said
    assert 'Traceback' not in said
