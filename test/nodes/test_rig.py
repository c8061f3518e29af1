"""The rig node, with the twins of its devices in a small room, and images fed by hand."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from feeding import run, taken

from tactile_nodes import conversions, messages, params
from tactile_nodes.bag.metadata import BagTopic
from tactile_nodes.bag.writer import BagWriter
from tactile_nodes.bus import topics
from tactile_nodes.bus.inprocess import InProcessBus
from tactile_nodes.bus.node.arguments import NodeArguments
from tactile_nodes.bus.node.keeping import VARIABLE
from tactile_nodes.bus.node.runtime import run_until
from tactile_nodes.bus.protocol import Qos
from tactile_nodes.bus.subscription import Subscription
from tactile_nodes.bus.topics import Topic
from tactile_nodes.clock import NS_PER_S, SteppedClock, SystemClock, monotonic_s
from tactile_nodes.collection.hands import InterruptedRunError
from tactile_nodes.collection.machine_record import BEGUN, MachineRecord, record_file
from tactile_nodes.collection.plan.journal import RECORDED, STARTED, VERIFIED, Entry, Journal
from tactile_nodes.collection.run.session import Session
from tactile_nodes.collection.safety import SENSOR
from tactile_nodes.drivers.cnc.contract import SIMULATED
from tactile_nodes.errors import NOT_AGAIN, AskedToEndError, ConfigurationError, DeviceFaultError
from tactile_nodes.messages import services, types
from tactile_nodes.nodes.rig import RigNode
from tactile_nodes.sensing.geometry import Crop

PATIENCE_S = 120.0
HURRY = 5
TICK_S = 0.002
SMALL = """
rig:
  ros__parameters:
    folder: {folder}
    plan: {{columns: 2, rows: 1, pitch_mm: 2.0, depths_mm: [0.5]}}
    wait_s: 60.0
    world:
      {{start_mm: [-2.0, -2.0, -1.0], room_mm: [20.0, 20.0, 20.0], gel_x_mm: -10.0, gel_y_mm: -10.0, gel_z_mm: -4.0}}
    cnc: {{safe_z_mm: -2.5}}
    force_torque: {{rate_hz: 100.0}}
    limits: {{force_silence_ms: 5000.0, camera_silence_ms: 10000.0, bearable_n: 6.0, steady_again_s: 0.2}}
    motion: {{approach_mm_min: 600.0, press_mm_min: 120.0}}
    surface:
      {{gel_x_mm: -10.0, gel_y_mm: -10.0, top_mm: -3.9, bottom_mm: -5.0, reach_mm: 2.0, corners: 3, repeats: 1,
        dwell_s: 0.03, beyond: 3, step_mm: 0.2, fine_step_mm: 0.1, feed_mm_min: 60.0, flat_mm: 0.2, tilt: 0.2}}
    press: {{indenter: somebody says, tare_s: 0.1, steady_s: 0.05, frames: 2, steady_n_s: 5.0, depth_error_mm: 0.1}}
    reference_frames: 3
    anchor: {{every: 0}}
    sync: {{pulses: 0}}
    {more}
"""


@pytest.fixture
def clock() -> SystemClock:
    return SystemClock()


def arguments(folder: Path, more: str = '') -> NodeArguments:
    return NodeArguments(parameters=params.parse_parameters(SMALL.format(folder=folder, more=more), 'the test'))


class HurriedClock(SteppedClock):
    """Time passes five times as fast as outside, but stands still while this process gets no processor.

    With a clock that ran on, a busy machine's pause of one second would look to the rig like a sensor that was silent
    for five.
    """

    def __init__(self) -> None:
        super().__init__(SystemClock().now_ns())
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._tick)
        self._thread.start()

    def _tick(self) -> None:
        last_s = monotonic_s()
        while not self._over.wait(TICK_S):
            now_s = monotonic_s()
            self.advance(HURRY * min(now_s - last_s, 3 * TICK_S))
            last_s = now_s

    def close(self) -> None:
        self._over.set()
        self._thread.join()


class Rig:
    """The node in a thread, and a camera beside it."""

    def __init__(self, bus: InProcessBus, folder: Path, more: str) -> None:
        self._clock = HurriedClock()
        self.node = RigNode(bus, arguments(folder, more), self._clock)
        self._bus = bus
        self._over = threading.Event()
        self._threads = [threading.Thread(target=self.node.spin), threading.Thread(target=self._film)]
        for thread in self._threads:
            thread.start()

    def _film(self) -> None:
        image = self._bus.advertise('/image_raw', topics.IMAGE.type_name, topics.IMAGE.qos)
        picture = np.full((48, 64), 100, np.uint8)  # whole, as of somebody else's camera node
        while not self._over.wait(0.005):
            head = conversions.header(self.node.clock.now_ns(), 'camera')
            image.publish(conversions.image_message(picture, head))

    @property
    def has_ended(self) -> bool:
        return not self._threads[0].is_alive()

    def close(self) -> None:
        self._over.set()
        self.node.stop()
        for thread in self._threads:
            thread.join()
        self.node.close()
        self._clock.close()


@pytest.fixture
def start(bus: InProcessBus, tmp_path: Path) -> Iterator[Callable[..., Rig]]:
    rigs: list[Rig] = []

    def begin(more: str = '') -> Rig:
        rigs.append(Rig(bus, tmp_path, more))
        return rigs[-1]

    yield begin
    for rig in rigs:
        rig.close()


def listen(bus: InProcessBus, topic: Topic) -> Subscription:
    return bus.subscribe('/' + topic.name, topic.type_name, Qos('queue', 100_000))


def wait_until(done: Callable[[], bool]) -> None:
    deadline_s = monotonic_s() + PATIENCE_S
    while not done():
        assert monotonic_s() < deadline_s
        threading.Event().wait(0.02)


def test_plan_becomes_messages_that_belong_together(bus: InProcessBus, start: Callable[..., Rig]) -> None:
    names = (topics.PRESS, topics.PRESS_IMAGE, topics.FORCE_TORQUE, topics.SYNC_EDGE, topics.RIG_STATE)
    presses, images, samples, edges, states = (listen(bus, topic) for topic in names)
    rest, raw = listen(bus, topics.REFERENCE_IMAGE), listen(bus, topics.FORCE_TORQUE_COUNTS)
    rig = start()
    wait_until(lambda: rig.has_ended)
    assert rig.node.failure is None
    published = taken(presses)
    assert [press.press for press in sorted(published, key=lambda press: press.press)] == [1, 2]
    pictures = taken(images)
    assert {(image.width, image.height) for image in pictures} == {(40, 40)}
    stamps = [messages.stamp_ns(image.header.stamp) for image in pictures]
    forces = {messages.stamp_ns(each.header.stamp): each.wrench.force.z for each in taken(samples)}
    for press in published:
        assert press.status == types.Press.STATUS_RECORDED, press.reason
        assert press.indenter == 'sphere 1.2 mm'  # the simulated world's tip, whatever the parameter says
        begin, end = messages.stamp_ns(press.window_start), messages.stamp_ns(press.window_end)
        assert sum(begin <= stamp <= end for stamp in stamps) == press.frames == 2
        within = [force for stamp, force in forces.items() if begin <= stamp <= end]
        # The label is what the samples say, less the tare, pressing negative: whoever has the bag can compute it anew.
        assert len(within) == press.samples
        assert press.wrench.force.z == pytest.approx(-(np.mean(within) - press.tare.force.z), abs=1e-9)
    counted = {
        messages.stamp_ns(each.header.stamp) + int(after_ns): values[2]
        for each in taken(raw)
        for after_ns, values in zip(each.measured, each.counts.reshape(-1, each.channels), strict=True)
    }
    both_ns = min(max(counted), max(forces))  # the sensor goes on while one is read after the other
    of_forces, of_counts = (
        {stamp: force for stamp, force in found.items() if stamp <= both_ns} for found in (forces, counted)
    )
    assert of_counts == of_forces  # a twin counts in N
    assert max(forces) - both_ns <= 100_000_000
    assert [edge.level for edge in taken(edges)] == [True, False, True, False]
    assert any(state.press == 2 and state.depth > 0.4e-3 for state in taken(states))
    assert len(taken(rest)) == 1


def test_a_picture_that_the_camera_node_has_cropped_is_recorded_whole_whatever_its_shape(
    bus: InProcessBus, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A described sensor may have pictures that are not square, and its calibration reads them to the rim."""
    came: list[tuple[int, ...]] = []
    monkeypatch.setattr(Session, 'image', lambda _self, _stamp_ns, picture: came.append(picture.shape))
    image, info = (
        bus.advertise(f'/{each.name}', each.type_name, each.qos) for each in (topics.IMAGE, topics.CAMERA_INFO)
    )
    node = RigNode(bus, arguments(tmp_path, 'require_recorder: true'), SystemClock())
    head = conversions.header(0, 'camera')
    for crop in (Crop(0, 0, 64, 48), Crop(0, 0, 0, 0)):  # ours, and of a driver that crops nothing
        info.publish(conversions.camera_info(head, 64, 48, crop))
        run(node)
        image.publish(conversions.image_message(np.full((48, 64), 100, np.uint8), head))
        run(node)
    node.close()
    assert came == [(48, 64), (40, 40)]


@pytest.mark.parametrize(
    ('sensor', 'recorded'), [('digit_like', (320, 240)), ('simulated', (320, 240)), ('', (240, 240))]
)
def test_a_whole_picture_is_cropped_as_the_sensor_is_described(
    bus: InProcessBus, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, sensor: str, recorded: tuple[int, int]
) -> None:
    """240x320 is all of the first. The second has 640x480: a crop of its size would show another part of the gel."""
    came: list[tuple[int, ...]] = []
    monkeypatch.setattr(Session, 'image', lambda _self, _stamp_ns, picture: came.append(picture.shape))
    image = bus.advertise('/image_raw', topics.IMAGE.type_name, topics.IMAGE.qos)
    node = RigNode(bus, arguments(tmp_path, f"require_recorder: true\n    sensor: '{sensor}'"), SystemClock())
    run(node)
    image.publish(conversions.image_message(np.full((320, 240), 100, np.uint8), conversions.header(0, 'camera')))
    run(node)
    node.close()
    assert came == [recorded]


def test_nothing_moves_while_nobody_records_and_no_launch_starts_it_again(bus: InProcessBus, tmp_path: Path) -> None:
    states = listen(bus, topics.RIG_STATE)
    node = RigNode(bus, arguments(tmp_path, 'require_recorder: true\n    wait_s: 0.2'), SystemClock())
    assert run_until([node], threading.Event()) == NOT_AGAIN
    assert 'no recorder takes press, press_image and force_torque: none is running, or it has stopped' in str(
        node.failure
    )
    assert not taken(states)


def test_the_rig_does_not_wait_for_simulated_time(bus: InProcessBus, tmp_path: Path) -> None:
    more = 'require_recorder: true\n    wait_s: 0.2\n    use_sim_time: true'
    node = RigNode(bus, arguments(tmp_path, more))  # and no /clock
    spinning = threading.Thread(target=node.spin, daemon=True)
    spinning.start()
    spinning.join(30.0)
    assert 'no recorder' in str(node.failure)
    node.close()


def test_a_run_that_fails_after_silences_says_how_crowded_the_computer_is(
    bus: InProcessBus, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(session: Session) -> str:
        session.station.safety.fail(SENSOR, 'silent', 1)
        raise DeviceFaultError('stopped: silent')

    monkeypatch.setattr(Session, 'run', fail)
    monkeypatch.setattr(os, 'getloadavg', lambda: (99.0, 9.0, 9.0))
    node = RigNode(bus, arguments(tmp_path), SystemClock())
    node.spin()
    node.close()
    assert 'stopped: silent; this computer is overloaded (99 programs on' in str(node.failure)


def test_rig_that_is_started_again_while_it_pauses_goes_on_pausing(
    bus: InProcessBus, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(VARIABLE, str(tmp_path / 'kept'))
    paused = []
    for call in ('pause', 'resume', 'pause'):
        node = RigNode(bus, arguments(tmp_path, 'require_recorder: true\n    wait_s: 60.0'), SystemClock())
        paused.append(node._session.campaign.paused)
        spinning = threading.Thread(target=node.spin)
        spinning.start()
        assert bus.call(f'/rig/{call}', services.TRIGGER, types.Trigger_Request(), PATIENCE_S).success
        node.stop()
        spinning.join()
        node.close()
    assert paused == [False, True, False]


def test_progress_says_whether_the_rig_is_still_about_to_pause(bus: InProcessBus, tmp_path: Path) -> None:
    node = RigNode(bus, arguments(tmp_path), SystemClock())

    def said() -> str:
        node._report()
        (message,) = [each.message for each in node.diagnostics.message(0).status if each.name.endswith('collection')]
        return message

    node._session.campaign.paused = True
    assert said().startswith('pausing, [')
    node._session.campaign.stands = True
    assert said().startswith('paused, [')
    node._session.campaign.paused = False
    assert said().startswith('[')
    node.close()


def test_run_waits_with_the_tip_up_for_a_recorder_that_comes_back_and_loses_no_press(
    bus: InProcessBus, start: Callable[..., Rig], tmp_path: Path
) -> None:
    names = (topics.PRESS, topics.PRESS_IMAGE, topics.FORCE_TORQUE)
    states = listen(bus, topics.RIG_STATE)
    first = [listen(bus, topic) for topic in names]
    rig = start()
    wait_until(lambda: any(state.homed and state.position.z < -4.1e-3 and state.press for state in taken(states)))
    for subscription in first:
        subscription.close()
    wait_until(lambda: rig.node._session._voice.unheard_ns > 0)
    later = listen(bus, topics.RIG_STATE)
    wait_until(lambda: any(state.press == 0 and state.position.z > -2.6e-3 for state in taken(later)))
    again = [listen(bus, topic) for topic in names]
    wait_until(lambda: rig.has_ended)
    assert rig.node.failure is None
    published = taken(again[0])
    assert sorted(each.press for each in published if each.status == types.Press.STATUS_RECORDED) == [1, 2]


def with_a_bag(folder: Path) -> Path:
    writer = BagWriter(folder / 'bag')
    writer.add_topic(BagTopic.of_type('/press', topics.PRESS.type_name))
    writer.write('/press', messages.encode(types.Press()), 1, 1)
    writer.close()
    return folder


@pytest.mark.parametrize('waits_for', ['a device', 'large bags'])
def test_a_rig_that_waits_or_searches_large_bags_ends_when_it_is_asked_to(
    bus: InProcessBus, tmp_path: Path, waits_for: str
) -> None:
    noted(bus, with_a_bag(tmp_path))
    begin = arguments(tmp_path, f'cnc.source: {tmp_path}/not_plugged_in' if waits_for == 'a device' else '')
    begin.ending.set()
    with pytest.raises(AskedToEndError):
        RigNode(bus, begin, SystemClock())


def test_a_run_that_searches_large_bags_ends_when_it_is_asked_to(bus: InProcessBus, tmp_path: Path) -> None:
    node = RigNode(bus, arguments(with_a_bag(tmp_path), 'require_recorder: true'), SystemClock())
    outlet = node._session.campaign._outlet
    node._session.stop()
    with pytest.raises(InterruptedRunError):
        outlet.missing()
    with pytest.raises(InterruptedRunError):
        outlet.recall(Entry(1, 1, VERIFIED, 10))
    node.close()


def test_stop_ends_the_run_with_the_tip_up_and_without_a_failure(bus: InProcessBus, start: Callable[..., Rig]) -> None:
    kept = [listen(bus, topic) for topic in (topics.PRESS, topics.PRESS_IMAGE, topics.FORCE_TORQUE)]
    states = listen(bus, topics.RIG_STATE)
    rig = start()
    wait_until(lambda: any(state.homed and state.position.z < -4.1e-3 for state in taken(states)))  # in the gel
    answer = bus.call('/rig/stop', services.TRIGGER, types.Trigger_Request(), 5.0)
    assert answer.success
    wait_until(lambda: rig.has_ended)
    assert rig.node.failure is None
    assert taken(states)[-1].position.z == pytest.approx(-2.5e-3, abs=1e-5)
    assert kept


def test_plan_file_that_is_none_is_one_sentence(bus: InProcessBus, tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r'nowhere\.yaml'):
        RigNode(bus, arguments(tmp_path, 'plan_file: nowhere.yaml'), SystemClock())


def noted(bus: InProcessBus, folder: Path, *steps: str, more: str = '') -> None:
    """What an earlier run noted of its first press."""
    first = RigNode(bus, arguments(folder, more), SystemClock())
    plan = first._session.plan
    first.close()
    with Journal(folder / f'{plan.plan_id}.jsonl', plan) as journal:
        for step in (STARTED, *steps):
            journal.note(1, 1, step, 10)


@pytest.mark.parametrize(
    ('more', 'step', 'done'),
    [
        pytest.param('', VERIFIED, 1, id='it goes on'),
        pytest.param('anew: true', VERIFIED, 0, id='it begins anew'),
        # As for a recorder on another computer: its presses are not looked for in the folder.
        pytest.param('require_recorder: false', RECORDED, 1, id='recorded elsewhere'),
    ],
)
def test_a_rig_goes_on_with_its_plan_unless_it_is_to_begin_anew(
    bus: InProcessBus, tmp_path: Path, more: str, step: str, done: int
) -> None:
    noted(bus, tmp_path, step, more=more.replace('anew: true', ''))
    again = RigNode(bus, arguments(tmp_path, more), SystemClock())
    assert again._session.campaign.progress.done == done
    again.close()


def test_a_plan_is_not_gone_on_with_by_another_indenter(bus: InProcessBus, tmp_path: Path) -> None:
    noted(bus, tmp_path, VERIFIED)
    with pytest.raises(ConfigurationError, match=r'made with sphere 1\.2 mm, but the indenter is flat punch 3 mm'):
        RigNode(InProcessBus(SystemClock()), arguments(tmp_path, 'world.indenter: punch'), SystemClock())
    for more in ('world.indenter: punch\n    anew: true', 'world.indenter: punch'):  # now it is the punch's
        RigNode(bus, arguments(tmp_path, more), SystemClock()).close()


def test_a_rig_that_was_killed_says_what_to_type_and_moves_when_that_was_typed(
    bus: InProcessBus, start: Callable[..., Rig], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    machine = record_file(SIMULATED, tmp_path)
    MachineRecord(machine).note(BEGUN, 10)  # and then it was killed
    kept = [listen(bus, topic) for topic in (topics.PRESS, topics.PRESS_IMAGE, topics.FORCE_TORQUE)]
    states = listen(bus, topics.RIG_STATE)
    rig = start()
    wait_until(lambda: bool(rig.node._session.person.question))
    asked_ns = rig.node.clock.now_ns()
    wait_until(lambda: rig.node.clock.now_ns() > asked_ns + 2 * NS_PER_S)
    assert not taken(states)
    assert "then type: tactile service call /rig/acknowledge std_srvs/srv/Trigger '{}'" in capsys.readouterr().err
    assert bus.call('/rig/acknowledge', services.TRIGGER, types.Trigger_Request(), 5.0).message == 'continuing'
    wait_until(lambda: any(state.homed for state in taken(states)))
    assert kept


def test_a_recorder_that_is_missing_when_a_person_answers_late_is_waited_for(
    bus: InProcessBus, start: Callable[..., Rig], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    MachineRecord(record_file(SIMULATED, tmp_path)).note(BEGUN, 10)  # and then it was killed
    kept = [listen(bus, topic) for topic in (topics.PRESS, topics.PRESS_IMAGE, topics.FORCE_TORQUE)]
    rig = start('wait_s: 5.0')
    wait_until(lambda: bool(rig.node._session.person.question))
    asked_ns = rig.node.clock.now_ns()
    wait_until(lambda: rig.node.clock.now_ns() > asked_ns + 6 * NS_PER_S)
    kept.pop().close()
    assert bus.call('/rig/acknowledge', services.TRIGGER, types.Trigger_Request(), PATIENCE_S).success
    printed: list[str] = []
    wait_until(lambda: printed.append(capsys.readouterr().err) or 'no recorder' in ''.join(printed))
    assert 'no recorder is running; the tip stays up, waiting up to 5 s for one' in ''.join(printed)


def test_an_answer_that_nobody_asked_for_lets_nothing_go_on_later(bus: InProcessBus, tmp_path: Path) -> None:
    node = RigNode(bus, arguments(tmp_path), SystemClock())
    spinning = threading.Thread(target=node.spin)
    spinning.start()
    reply = bus.call('/rig/acknowledge', services.TRIGGER, types.Trigger_Request(), PATIENCE_S).message
    node.stop()
    spinning.join()
    node.close()
    assert reply == 'there is no open question'
