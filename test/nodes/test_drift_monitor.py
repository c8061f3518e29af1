"""Pictures and forces in, the state of the calibration out: stamps, what is compared with, diagnostics, a weight."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from feeding import START_NS, given, image, run, taken

from tactile_nodes import conversions
from tactile_nodes.bus import topics
from tactile_nodes.bus.inprocess import InProcessBus
from tactile_nodes.bus.node.keeping import VARIABLE
from tactile_nodes.bus.protocol import Publisher
from tactile_nodes.bus.subscription import Subscription
from tactile_nodes.bus.topics import Topic
from tactile_nodes.clock import SteppedClock
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.gel_list import Calibration, GelList
from tactile_nodes.messages import stamp_ns, types
from tactile_nodes.nodes.drift_monitor import DriftMonitorNode, DriftMonitorParams
from tactile_nodes.pipeline.drifting import FILE, FIRST, GEL, rest_picture
from tactile_nodes.simulation.gel import Gel

Listen = Callable[[Topic], Subscription]
Advertise = Callable[[Topic], Publisher]
STATE = types.CalibrationState
S = 1_000_000_000


def speckle(seed: int) -> np.ndarray:
    random = np.random.default_rng(seed).uniform(0, 255, (200, 200)).astype(np.float32)
    smooth = cv2.GaussianBlur(random, (0, 0), 2.0)
    return np.clip(128 + 40 * (smooth - smooth.mean()) / smooth.std(), 0, 255).astype(np.uint8)


REST, OTHER = speckle(1), speckle(2)
KNOCKED = np.roll(REST, 2, axis=1)


class Bench:
    """The node, and everything that it hears and says."""

    def __init__(
        self, bus: InProcessBus, clock: SteppedClock, listen: Listen, publisher: Advertise, *parameters: str
    ) -> None:
        self.bus, self._publisher = bus, publisher
        self.states = listen(topics.CALIBRATION_STATE)
        self.node = DriftMonitorNode(bus, given(*parameters), clock)
        self._publishers: dict[str, Publisher] = {}

    def say(self, topic: Topic, message: Any) -> None:
        if topic.name not in self._publishers:
            self._publishers[topic.name] = self._publisher(topic)
        self._publishers[topic.name].publish(message)
        run(self.node)

    def model(self, rest: np.ndarray | None = None, gel: str = 'some gel') -> None:
        shown = np.zeros((0, 0), np.uint8) if rest is None else rest
        self.say(topics.MODEL_IN_USE, types.Provenance(model='m', model_id='0123456789ab', gel=gel))
        self.say(topics.CALIBRATION_IMAGE, conversions.image_message(shown, conversions.header(0, '0123456789ab')))

    def pictures(self, pixels: np.ndarray, seconds: int = 7, begin_s: int = 1) -> None:
        """At 10 a second."""
        for number in range(10 * seconds):
            self.say(topics.IMAGE, image(pixels, START_NS + begin_s * S + number * S // 10))

    def rest(self, pixels: np.ndarray) -> None:
        self.say(topics.REFERENCE_IMAGE, image(pixels))

    def weigh(self, read_n: float) -> str:
        """So much is read for three seconds, and is compared with the weight then."""
        for number in range(180):
            head = conversions.header(START_NS + number * S // 60, 'gel_surface')
            self.say(topics.FORCE_DISTRIBUTION, types.ForceDistribution(header=head, total=read_n, in_contact=True))
        return self.node._check_weight()

    def published(self) -> list[types.CalibrationState]:
        return taken(self.states)


@pytest.fixture
def bench(bus: InProcessBus, clock: SteppedClock, listen: Listen, publisher: Advertise) -> Callable[..., Bench]:
    return lambda *parameters: Bench(bus, clock, listen, publisher, *parameters)


@pytest.fixture
def tested(bench: Callable[..., Bench]) -> Bench:
    return bench()


def test_a_picture_every_two_seconds_is_looked_at_and_reported_with_its_stamp(tested: Bench) -> None:
    tested.rest(REST)
    tested.pictures(REST, seconds=8)
    states = tested.published()
    assert [stamp_ns(each.header.stamp) - START_NS for each in states[1:]] == [S + 2 * n * S for n in range(4)]
    assert {stamp_ns(each.valid_from) - stamp_ns(each.header.stamp) for each in states[1:]} == {S // 2}
    assert stamp_ns(states[0].valid_from) == stamp_ns(states[0].header.stamp)  # of the rest image: from itself on
    assert {each.level for each in states} == {STATE.LEVEL_VALID}


def test_a_knocked_camera_is_reported_with_what_to_do_and_on_diagnostics(tested: Bench) -> None:
    tested.rest(REST)
    tested.pictures(KNOCKED)
    state = tested.published()[-1]
    assert (state.level, state.reasons) == (STATE.LEVEL_INVALID, STATE.REASON_PICTURE_MOVED)
    assert state.moved == pytest.approx(2.0, abs=0.05)
    status = [each for each in tested.node.diagnostics.message(0).status if each.name.endswith(': calibration')]
    assert [each.level for each in status] == [2]
    assert 'capture the rest image again' in status[0].message


def test_of_whole_pictures_of_another_camera_node_the_middle_is_looked_at(tested: Bench) -> None:
    tested.rest(REST)
    whole = np.full((REST.shape[0] + 40, REST.shape[1] + 200), 90, np.uint8)
    whole[20:-20, 100:-100] = REST
    tested.pictures(whole, seconds=6)
    states = tested.published()
    assert len(states) > 2
    assert {each.level for each in states} == {STATE.LEVEL_VALID}


def test_the_table_of_topics_says_how_often_it_is_reported() -> None:
    assert topics.CALIBRATION_STATE.rate_hz == 1.0 / DriftMonitorParams().check_s


def test_the_rest_image_of_the_model_file_is_what_is_compared_with(tested: Bench) -> None:
    tested.model(OTHER)
    tested.rest(REST)
    state = tested.published()[-1]
    assert (state.calibration, state.model_id) == (FILE, '0123456789ab')
    assert (state.level, state.reasons) == (STATE.LEVEL_INVALID, STATE.REASON_OTHER_GEL)


def test_another_model_that_takes_over_brings_its_own_rest_image(tested: Bench) -> None:
    tested.model(OTHER)
    tested.rest(REST)
    tested.model(REST)
    tested.pictures(REST, seconds=1)
    assert tested.published()[-1].level == STATE.LEVEL_VALID


def test_sensing_that_starts_again_with_its_rest_image_leaves_the_evidence_against_it(tested: Bench) -> None:
    tested.rest(REST)
    tested.pictures(KNOCKED)
    tested.rest(REST)
    assert tested.published()[-1].reasons == STATE.REASON_PICTURE_MOVED
    tested.rest(KNOCKED)
    assert not tested.published()[-1].reasons & STATE.REASON_PICTURE_MOVED


def test_without_one_the_first_rest_image_stands_in_also_when_the_estimator_starts_again(tested: Bench) -> None:
    tested.model()
    tested.rest(REST)
    tested.rest(KNOCKED)
    tested.model()
    tested.pictures(KNOCKED, seconds=1)
    *_, before, after = tested.published()
    for state in (before, after):
        assert state.calibration == FIRST
        assert (state.level, state.reasons) == (STATE.LEVEL_AGEING, STATE.REASON_MOVED_SINCE_CALIBRATION)
        assert state.since_calibration_moved == pytest.approx(2.0, abs=0.05)


def test_of_a_simulated_camera_the_gel_on_the_card_is_known(bench: Callable[..., Bench]) -> None:
    tested = bench('source:=simulated')
    tested.model(gel=Gel().gel_id)
    tested.rest(rest_picture(Gel(), 440))
    assert tested.published()[-1].calibration == GEL
    tested.rest(rest_picture(Gel(seed=7), 440))
    state = tested.published()[-1]
    assert (state.level, state.reasons) == (STATE.LEVEL_INVALID, STATE.REASON_OTHER_GEL)


def test_of_a_calibration_without_rest_image_the_first_of_another_size_stands_in(tested: Bench) -> None:
    """The camera was started with another crop, and then with the right one."""
    tested.model()
    tested.rest(OTHER[:160, :160])
    tested.rest(REST)
    assert len(states := tested.published()) == 2
    assert (states[-1].calibration, states[-1].level) == (FIRST, STATE.LEVEL_VALID)
    tested.rest(KNOCKED)
    assert tested.published()[-1].reasons == STATE.REASON_MOVED_SINCE_CALIBRATION


def test_after_a_rest_image_that_cannot_be_judged_the_verdict_on_the_one_before_is_withdrawn(tested: Bench) -> None:
    tested.rest(REST)
    tested.pictures(KNOCKED)
    assert tested.published()[-1].level == STATE.LEVEL_INVALID
    tested.rest(np.full_like(REST, 90))
    assert tested.published()[-1].level == STATE.LEVEL_UNKNOWN


def test_a_weight_on_the_gel_is_compared_when_asked(bench: Callable[..., Bench]) -> None:
    tested = bench('weight_g:=100.0')
    tested.rest(REST)
    assert 'reads 0.900 N of 0.981 N' in tested.weigh(0.9)
    tested.pictures(REST, seconds=1, begin_s=4)
    state = tested.published()[-1]
    assert (state.level, state.reasons) == (STATE.LEVEL_AGEING, STATE.REASON_FORCE_RATIO)
    assert state.force_ratio == pytest.approx(0.9 / 0.980665, rel=1e-5)


def test_a_weight_is_not_compared_with_forces_that_ceased_to_come(
    bench: Callable[..., Bench], clock: SteppedClock
) -> None:
    """The estimator died while 100 g lay on the gel; 200 g lie there now."""
    tested = bench('weight_g:=200.0')
    tested.rest(REST)
    tested.weigh(0.98)
    clock.advance(30.0)
    with pytest.raises(ConfigurationError, match='the last force came 30 s ago'):
        tested.node._check_weight()


def test_an_independent_sensor_is_listened_to_where_one_is_named(bench: Callable[..., Bench]) -> None:
    tested = bench('force_topic:=wrist_force')
    tested.rest(REST)
    wrist = Topic('wrist_force', topics.FORCE_TORQUE.type_name, '', topics.FORCE_TORQUE.qos)
    for number in range(12 * 120):
        at_ns, force_n = START_NS + number * S // 60, max(0.0, float(np.sin(2 * np.pi * number / 120)))
        head = conversions.header(at_ns, '')
        wrench = types.Wrench(force=types.Vector3(z=3.0 - force_n))
        tested.say(wrist, types.WrenchStamped(header=head, wrench=wrench))
        force = types.ForceDistribution(header=head, total=0.8 * force_n, in_contact=force_n > 0.03, unlikeness=0.3)
        tested.say(topics.FORCE_DISTRIBUTION, force)
    tested.pictures(REST, seconds=1, begin_s=30)
    state = tested.published()[-1]
    assert (state.level, state.reasons) == (STATE.LEVEL_INVALID, STATE.REASON_FORCE_RATIO)
    assert state.force_ratio == pytest.approx(0.8, rel=0.01)
    assert state.force_ratio_contacts >= 10


def test_an_independent_sensor_of_which_nothing_comes_is_reported(bench: Callable[..., Bench]) -> None:
    def told() -> tuple[int, str]:
        statuses = tested.node.diagnostics.message(0).status
        (found,) = (each for each in statuses if each.name.endswith(': independent force'))
        return found.level, found.message

    tested = bench('force_topic:=wrist_force')
    tested.rest(REST)
    assert told() == (1, 'no message on /wrist_force')
    wrist = Topic('wrist_force', topics.FORCE_TORQUE.type_name, '', topics.FORCE_TORQUE.qos)
    tested.say(wrist, types.WrenchStamped(header=conversions.header(START_NS, '')))
    tested.pictures(REST, seconds=1)
    assert told() == (0, '/wrist_force')
    tested.pictures(REST, seconds=3, begin_s=2)
    assert told() == (1, 'no message on /wrist_force')


@pytest.fixture
def again(
    bench: Callable[..., Bench], bus: InProcessBus, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> Callable[[], Bench]:
    """The monitor as the same launch starts it once more after a kill, of which nothing is left on the bus."""
    monkeypatch.setenv(VARIABLE, str(tmp_path / 'kept'))

    def make() -> Bench:
        bus._publishers.clear()
        bus._subscriptions.clear()
        bus._services.clear()
        return bench('weight_g:=100.0')

    return make


def test_a_monitor_that_was_killed_goes_on_with_the_evidence(again: Callable[[], Bench]) -> None:
    """Of pictures and of a weight; nothing better is told in between, whatever comes first."""
    tested = again()
    tested.model(REST)
    tested.rest(REST)
    tested.weigh(0.9)
    tested.pictures(KNOCKED)
    before = tested.published()[-1]
    assert before.reasons == STATE.REASON_PICTURE_MOVED | STATE.REASON_FORCE_RATIO
    tested = again()
    tested.rest(REST)
    tested.pictures(KNOCKED, seconds=1, begin_s=10)
    assert tested.published() == []  # which model is in use is not known yet
    tested.model(REST)
    tested.pictures(KNOCKED, seconds=1, begin_s=12)
    state = tested.published()[0]
    assert (state.level, state.reasons, state.text) == (before.level, before.reasons, before.text)
    assert state.force_ratio == before.force_ratio
    tested.pictures(REST, seconds=3, begin_s=14)
    assert tested.published()[-1].reasons == STATE.REASON_FORCE_RATIO


def test_evidence_against_another_model_or_rest_image_does_not_count_after_a_restart(
    again: Callable[[], Bench],
) -> None:
    for model, rest in ((OTHER, OTHER), (REST, OTHER)):
        tested = again()
        tested.model(REST)
        tested.rest(REST)
        tested.weigh(0.9)
        tested.pictures(REST, seconds=1)
        assert tested.published()[-1].reasons == STATE.REASON_FORCE_RATIO
        tested = again()
        tested.model(model)
        tested.rest(rest)
        tested.pictures(rest, seconds=1, begin_s=10)
        assert not tested.published()[-1].reasons & STATE.REASON_FORCE_RATIO


def test_evidence_that_is_damaged_counts_for_nothing(again: Callable[[], Bench], tmp_path: Path) -> None:
    tested = again()
    tested.model(REST)
    tested.rest(REST)
    tested.pictures(KNOCKED)
    (file,) = (tmp_path / 'kept').glob('*evidence')
    file.write_bytes(file.read_bytes()[:-5])
    tested = again()
    tested.model(REST)
    tested.rest(REST)
    tested.pictures(REST, seconds=1, begin_s=10)
    assert tested.published()[-1].level == STATE.LEVEL_VALID


def test_what_is_found_of_a_calibration_is_kept_in_the_list_of_gels(
    bench: Callable[..., Bench], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv('TACTILE_GELS', str(tmp_path / 'gels.sqlite'))
    tested = bench()
    gels = GelList()
    gels.add(Calibration('0123456789ab', gel='some gel'))
    tested.model(REST)
    tested.rest(REST)
    tested.pictures(REST)
    (found,) = gels.calibrations()
    assert (found.level, found.remedy) == ('valid', '')
    tested.pictures(np.roll(REST, 2, axis=1), begin_s=20)
    (found,) = gels.calibrations()
    assert found.level == 'invalid'
    assert 'capture' in found.remedy
    assert found.looked_ns > START_NS + 20 * S
