"""The guarded grasp with its simulated gripper, as nodes on one bus; the forces come from here, not from models."""

from __future__ import annotations

import math
import re
import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tactile_nodes import conversions
from tactile_nodes.bus import topics
from tactile_nodes.bus.inprocess import InProcessBus
from tactile_nodes.bus.node.arguments import parse_arguments
from tactile_nodes.bus.node.node import Node
from tactile_nodes.bus.node.runtime import run_until
from tactile_nodes.bus.protocol import Qos
from tactile_nodes.clock import NS_PER_S, monotonic_s
from tactile_nodes.emulators.gripper import finger_of
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.messages import types
from tactile_nodes.messages.services import TRIGGER
from tactile_nodes.nodes.hand.guarded_grasp import GuardedGraspNode
from tactile_nodes.nodes.hand.simulated_gripper import SimulatedGripperNode
from tactile_nodes.paths import share_directory
from tactile_nodes.pipeline.hand_forces import HandForces
from tactile_nodes.sensors import load_hand
from tactile_nodes.simulation.optics import Press
from tactile_nodes.simulation.touch.gripping import Finger

PATIENCE_S = 60.0
SIGMA_N = 0.005
HAND = load_hand('gripping_fingers')


class Feeling:
    """In the place of cameras and models: the force of each touch that the gripper reports, and their sum."""

    def __init__(self, bus: InProcessBus, finger: Finger) -> None:
        self.blind, self.late_s = '', 0.0
        self._finger = finger
        self._forces = HandForces(HAND)
        self._held = {
            name: bus.subscribe(f'/{name}/held', topics.HELD.type_name, Qos('latest', 1)) for name in HAND.names
        }
        force, wrench = topics.FORCE_DISTRIBUTION, topics.HAND_WRENCH
        self._out = {name: bus.advertise(f'/{name}/{force.name}', force.type_name, force.qos) for name in HAND.names}
        self._sum = bus.advertise(f'/{wrench.name}', wrench.type_name, wrench.qos)
        self._clock = bus.clock

    def tell(self) -> None:
        now_ns = self._clock.now_ns() - round(self.late_s * NS_PER_S)
        for name, end in self._held.items():
            if (received := end.take()) is not None:
                force = self._of(now_ns, conversions.press_of(received.message)[1])
                if name == self.blind:
                    force = replace(force, status=force.STATUS_INVALID, total=math.nan)
                self._out[name].publish(force)
                for each in self._forces.add(name, force):
                    self._sum.publish(each)

    def _of(self, now_ns: int, press: Press) -> types.ForceDistribution:
        normal_n = self._finger.table.force_at(press.depth_mm)
        x_n, y_n = (self._finger.drag_n(press.depth_mm, each) for each in press.shift_mm)
        touched = [types.Contact(force=normal_n, shear_x=x_n, shear_y=y_n)] if normal_n else []
        return types.ForceDistribution(
            header=conversions.header(now_ns, 'x'), rows=1, cols=1, normal_force=np.array([normal_n], np.float32),
            total=normal_n, in_contact=bool(touched), contacts=touched,
            wrench=types.Wrench(force=types.Vector3(x=x_n, y=y_n, z=-normal_n)),
            wrench_covariance=np.eye(6).reshape(-1) * SIGMA_N**2,
        )  # fmt: skip


class Loop:
    """Gripper and grasp at work; `go_on` lets them feel until a condition holds."""

    def __init__(self, finger: Finger, *words: str) -> None:
        self.bus = InProcessBus()
        arguments = parse_arguments(['--ros-args', *(part for word in words for part in ('-p', word))])
        self.gripper, self.grasp = SimulatedGripperNode(self.bus, arguments), GuardedGraspNode(self.bus, arguments)
        command = topics.GRIPPER_COMMAND
        self._commands = self.bus.subscribe(f'/{command.name}', command.type_name, Qos('queue', 10_000))
        self.feeling = Feeling(self.bus, finger)
        self.commands_mm: list[float] = []
        self._done = threading.Event()
        self._thread = threading.Thread(target=run_until, args=([self.gripper, self.grasp], self._done))

    def __enter__(self) -> Loop:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._done.set()
        self._thread.join()
        self.bus.close()

    def go_on(self, until: Callable[[], object]) -> None:
        deadline_s = monotonic_s() + PATIENCE_S
        while not until():
            assert monotonic_s() < deadline_s
            self.feeling.tell()
            while (received := self._commands.take()) is not None:
                self.commands_mm.append(received.message.data * 1e3)
            self.bus.clock.sleep_until(self.bus.clock.now_ns() + NS_PER_S // 100)

    def status(self) -> str:
        statuses = [each for each in self.grasp.diagnostics.message(0).status if each.name.endswith('grasp')]
        return ' '.join(str(entry.message) for entry in statuses)


@pytest.fixture(scope='module')
def finger() -> Finger:
    return finger_of(HAND.sensors[0])


def test_object_is_held_while_it_is_pulled_and_let_go_at_the_end(finger: Finger) -> None:
    pulled = 'pull_n:=0.4', 'pull_after_s:=0.3', 'pull_n_s:=1.0'
    with Loop(finger, 'object_mm:=49.0', 'grasp.hold_s:=1.2', *pulled) as loop:
        loop.go_on(lambda: 'held for' in loop.status())
        loop.go_on(lambda: loop.commands_mm[-1:] == [pytest.approx(50.0)])  # as far open as at first
        assert loop.grasp.failure is None
        assert min(loop.commands_mm) < 49.0
        # 0.2 N on each side; with the hand's friction of 0.8 a margin of 0.4 asks for 0.42 N.
        last_n = float(re.search(r'([0-9.]+) N at the end', loop.status())[1])  # type: ignore[index]
        assert last_n == pytest.approx(0.42, abs=0.05)


def test_grasp_that_finds_nothing_ends_with_a_sentence_and_the_status_of_a_failure(finger: Finger) -> None:
    """Also where simulated time is set for all nodes: by it no force would ever be old."""
    with Loop(finger, 'object_mm:=10.0', 'open_mm:=40.0', 'grasp.least_mm:=39.0', 'use_sim_time:=true') as loop:
        loop.go_on(lambda: loop.grasp.failure is not None)
        assert str(loop.grasp.failure).startswith('no contact down to an opening of 3')


def test_stopping_leaves_the_gripper_as_it_is(finger: Finger) -> None:
    with Loop(finger, 'object_mm:=49.0') as loop:
        loop.go_on(lambda: loop.status() == 'holding')
        response = loop.bus.call('/guarded_grasp/stop', TRIGGER, types.Trigger_Request(), 5.0)
        assert response.message == 'the grasp ends, and the gripper stays as it is'
        loop.go_on(lambda: loop.status() == 'stopped on request; the gripper stays as it is')
        assert loop.commands_mm[-1] < 49.0


@pytest.mark.parametrize('others', [[0.1, 0.2], [math.nan]])
def test_states_of_other_joints_on_the_topic_are_not_taken_for_the_gripper(others: list[float]) -> None:
    """An arm publishes its joints there too; and a gripper may report nan while it does not know where it is."""
    bus = InProcessBus()
    grasp, states = GuardedGraspNode(bus), topics.JOINT_STATES
    out = bus.advertise(f'/{states.name}', states.type_name, states.qos)
    for position in ([0.05], others):
        out.publish(types.JointState(name=['a'] * len(position), position=np.array(position)))
        grasp.spin_once(1.0)
    assert grasp._opening is not None and grasp._opening.mm == pytest.approx(50.0)
    grasp.close()


def end_the_gripper(loop: Loop) -> None:
    loop.gripper._tell = lambda: None  # type: ignore[method-assign]
    loop.gripper._states.publish = lambda _: None  # type: ignore[method-assign]


def blind_a_finger(loop: Loop) -> None:
    loop.feeling.blind = 'right'


@pytest.mark.parametrize(
    ('fault', 'sentence'),
    [
        (end_the_gripper, r'has not reported its opening for \d+ ms, above 1000 ms'),
        (blind_a_finger, r'the newest valid force is \d+ ms old, above 1000 ms'),
    ],
)
def test_gripper_whose_driver_ends_and_finger_whose_force_stays_invalid_end_the_grasp(
    finger: Finger, fault: Callable[[Loop], None], sentence: str
) -> None:
    with Loop(finger, 'object_mm:=49.0', 'grasp.hold_s:=60.0') as loop:
        loop.go_on(lambda: loop.status() == 'holding')
        fault(loop)
        loop.go_on(lambda: loop.grasp.failure is not None)
        assert loop.commands_mm[-1] < 49.0
    assert re.search(sentence, str(loop.grasp.failure))


@pytest.mark.parametrize('node', [SimulatedGripperNode, GuardedGraspNode])
@pytest.mark.parametrize(('second', 'why'), [('', ''), (', {name: right, modell: field}', ": .*'modell'")])
def test_hand_of_one_finger_is_no_gripper(node: type[Node], second: str, why: str, tmp_path: Path) -> None:
    """Nobody would know how hard the other finger presses. It may have been left out because of a typing error."""
    (tmp_path / 'one.yaml').write_text(f'frame: hand\nsensors: [{{name: left}}{second}]\n')
    with pytest.raises(ConfigurationError, match=rf'a gripper has two fingers; .*one.yaml has 1{why}'):
        node(InProcessBus(), parse_arguments(['--ros-args', '-p', f'hand:={tmp_path}/one.yaml']))


@pytest.mark.parametrize(('blind', 'late_s'), [('right', 0.0), ('', 2.0)])
def test_a_force_that_is_invalid_or_late_at_the_start_is_waited_for(finger: Finger, blind: str, late_s: float) -> None:
    """On a busy machine there is no rest image for seconds, and the first pictures wait as long for their force."""
    waiting = 'waiting: a force is invalid, or older than 1000 ms'
    with Loop(finger, 'object_mm:=49.0', 'grasp.hold_s:=60.0') as loop:
        loop.feeling.blind, loop.feeling.late_s = blind, late_s
        loop.go_on(lambda: loop.grasp.failure or loop.status() in {waiting, 'closing'})
        assert loop.status() == waiting
        loop.feeling.blind, loop.feeling.late_s = '', 0.0
        loop.go_on(lambda: 'holding' in loop.status())


def test_a_hand_without_friction_is_reported_to_have_no_guard(
    finger: Finger, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shipped = share_directory() / 'config' / 'hands' / 'gripping_fingers.yaml'
    lines = [line for line in shipped.read_text('utf-8').splitlines() if not line.startswith('friction')]
    (tmp_path / 'hand.yaml').write_text('\n'.join(lines), 'utf-8')
    with Loop(finger, f'hand:={tmp_path / "hand.yaml"}'):
        pass
    assert 'has no friction, so no slip margin protects the held object' in capsys.readouterr().err
