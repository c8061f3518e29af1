"""The page in a real browser: Chromium without a window, looking at a node of this process."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browsing import IN_CHROMIUM, PATIENCE_MS, SIZE, expect, opened
from matplotlib import colormaps
from seen import ring

from tactile_nodes import conversions
from tactile_nodes.bus import topics
from tactile_nodes.bus.inprocess import InProcessBus
from tactile_nodes.bus.node.arguments import NodeArguments, Remap
from tactile_nodes.bus.node.node import Node
from tactile_nodes.bus.node.runtime import run_until
from tactile_nodes.messages import services, types
from tactile_nodes.nodes.live_view import LiveViewNode
from tactile_nodes.nodes.recorder import RecorderNode
from tactile_nodes.params import Located, NodeParameters
from tactile_nodes.sensing.explain.reading import Contact
from tactile_nodes.sensing.geometry import BinGrid
from tactile_nodes.viewing.reasons import sentences
from tactile_nodes.web import accounts
from tactile_nodes.web.viewers import IN_FLIGHT

pytestmark = IN_CHROMIUM
BINS = BinGrid(9, 9, 32.0, 32.0)
PRESS_N, PLACE_MM = 0.73, (4.0, -2.0)  # in the bin of row 3, column 5: its middle is at (3.56, -3.56) mm


@dataclass
class Sensor:
    """Publishes ten times a second what a sensor would that is pressed with `total_n`."""

    bus: InProcessBus
    total_n: float = PRESS_N
    status: int = types.ForceDistribution.STATUS_OK
    reasons: int = 0
    sending: bool = True
    has_field: bool = False
    _done: threading.Event = field(default_factory=threading.Event)

    def __post_init__(self) -> None:
        made = (topics.IMAGE, topics.FLOW_FEATURES, topics.FORCE_DISTRIBUTION, topics.FORCE_FIELD)
        self._ends = [self.bus.advertise(f'/{topic.name}', topic.type_name, topic.qos) for topic in made]
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def close(self) -> None:
        self._done.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._done.wait(1 / 10):
            if self.sending:
                for end, message in zip(self._ends, self._messages(), strict=False):  # a field is there at times
                    end.publish(message)

    def _messages(self) -> tuple[Any, ...]:
        stamp_ns = self.bus.clock.now_ns()
        head = conversions.header(stamp_ns, 'gel')
        picture = np.tile(np.arange(0, 160, 4, dtype=np.uint8), (40, 1))
        arrows = np.tile(np.array([0.5, -0.25], np.float32), 4)
        motion = types.FlowFeatures(
            header=head, rows=2, cols=2, channels=2, encoding='cartesian_mean', values=arrows,
            confidence=np.ones(4, np.float32), image_width=40, image_height=40,
        )  # fmt: skip
        if self.has_field:
            return conversions.image_message(picture, head), motion, *ring(stamp_ns)
        bins = np.zeros((9, 9), np.float32)
        bins[3, 5] = self.total_n
        touching = (Contact(*PLACE_MM, self.total_n, 0.03, 0.004),) if self.total_n else ()
        force = types.ForceDistribution(
            header=head, status=self.status, reasons=self.reasons, **conversions.force_fields(bins, BINS, touching)
        )
        return conversions.image_message(picture, head), motion, force


@dataclass
class Running:
    """Nodes of this process, each started and ended as its program would."""

    bus: InProcessBus
    ends: list[Callable[[], None]] = field(default_factory=list)

    def start(self, kind: type[Node], namespace: str = '/', **values: object) -> Node:
        located = {name: Located(value, 'test') for name, value in values.items()}
        parameters = (NodeParameters('/**', located),)
        node = kind(self.bus, NodeArguments((Remap('__ns', namespace),), parameters))
        done = threading.Event()
        thread = threading.Thread(target=run_until, args=([node], done))
        thread.start()

        def end() -> None:
            done.set()
            thread.join()

        self.ends.append(end)
        return node

    def end(self) -> None:
        """End what was started last."""
        self.ends.pop()()


@pytest.fixture
def running() -> Iterator[Running]:
    made = Running(InProcessBus())
    yield made
    while made.ends:
        made.end()
    made.bus.close()


@pytest.fixture(scope='module')
def shared(chromium: Any) -> Iterator[tuple[Sensor, Any]]:
    """A sensor and its page, for all tests that leave nothing behind on it."""
    running = Running(InProcessBus())
    sensor, node = Sensor(running.bus), running.start(LiveViewNode, port=0)
    with opened(chromium, node.server.url) as page:
        yield sensor, page
    sensor.close()
    running.end()
    running.bus.close()


@pytest.fixture
def sensor(shared: tuple[Sensor, Any]) -> Iterator[Sensor]:
    """As it was in the beginning; at rest between tests, since the browser would draw what it sends."""
    made = shared[0]
    made.total_n, made.status, made.reasons = PRESS_N, types.ForceDistribution.STATUS_OK, 0
    made.sending, made.has_field = True, False
    yield made
    made.sending = False


@pytest.fixture
def page(shared: tuple[Sensor, Any], sensor: Sensor) -> Any:
    """The page of that sensor, which shows its force."""
    made = shared[1]
    made.set_viewport_size(SIZE)
    text(made, '#map-title').to_have_text('Force on each bin')
    text(made, '#total').to_have_text('0.730')
    text(made, '#status').to_have_text('OK')
    return made


@pytest.fixture
def own_sensor(running: Running) -> Iterator[Sensor]:
    made = Sensor(running.bus)
    yield made
    made.close()


@pytest.fixture
def url(running: Running) -> str:
    return running.start(LiveViewNode, port=0).server.url


@pytest.fixture
def own_page(chromium: Any, url: str, own_sensor: Sensor) -> Iterator[Any]:
    """Of a node of the test's own."""
    with opened(chromium, url) as made:
        yield made


def text(page: Any, place: str) -> Any:
    return expect(page.locator(place))


def test_the_force_of_a_known_press_is_shown(page: Any) -> None:
    text(page, '#total').to_have_text('0.730')
    text(page, '#answer').to_contain_text('Tare without contact')
    text(page, '#status').to_have_text('OK')
    row = page.locator('#contacts tr').first
    expect(row.locator('td').nth(1)).to_have_text('4.00, −2.00 ± 0.03')
    expect(row.locator('td').nth(2)).to_have_text('0.730 ± 0.004')
    text(page, '#longest').to_have_text('0.6')  # of (0.5, -0.25) px
    assert page.faults == []


def test_the_bin_that_is_pressed_has_the_colour_of_its_force(page: Any) -> None:
    text(page, '#total').to_have_text('0.730')
    step = int(0.73 * 64)  # of the 64 from 0 to 1 N
    red, green, blue = (round(255 * part) for part in colormaps['inferno'](np.linspace(0, 1, 64))[step][:3])
    count = page.evaluate(
        """([red, green, blue]) => {
            const canvas = document.getElementById('map');
            const data = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data;
            let count = 0;
            for (let at = 0; at < data.length; at += 4)
                count += Math.abs(data[at] - red) + Math.abs(data[at + 1] - green) + Math.abs(data[at + 2] - blue) < 4;
            return count;
        }""",
        [red, green, blue],
    )
    assert count > 300  # a bin of about 35 x 35 pixels, less its number


def test_a_force_field_is_shown_with_its_numbers_and_without_it_the_bins_come_back(page: Any, sensor: Sensor) -> None:
    text(page, '#map-title').to_have_text('Force on each bin')
    expect(page.locator('#net')).to_be_hidden()
    sensor.has_field = True
    text(page, '#map-title').to_have_text('Pressure and shear')
    text(page, '#shear').to_have_text('0.600 ± 0.020 N')
    text(page, '#torsion').to_have_text('4.0 ± 0.1 N mm')
    text(page, '#explanation').to_have_text('field')
    row = page.locator('#contacts tr').first
    expect(row.locator('td').nth(3)).to_have_text('0.600')
    expect(row.locator('td').nth(4)).to_have_text('4.00')
    text(page, '#peak-unit').to_have_text('kPa')
    assert [place for place in ('.net', '.contacts') if not is_whole(page, place)] == []
    sensor.has_field = False
    text(page, '#map-title').to_have_text('Force on each bin')
    expect(page.locator('#net')).to_be_hidden()
    assert page.faults == []


def test_a_ring_is_drawn_as_a_smooth_ring_about_its_place(page: Any, sensor: Sensor) -> None:
    sensor.has_field = True
    text(page, '#map-title').to_have_text('Pressure and shear')
    found = page.evaluate(
        """async () => {
            const { framed } = await import('/static/js/axes.js');
            const canvas = document.getElementById('map'), context = canvas.getContext('2d');
            const frame = framed(canvas.clientWidth, canvas.clientHeight, 36, 36);
            const light = (away) => { // mean of the strongest channel on a circle of so many mm about (4, -3) mm
                let sum = 0;
                for (let step = 0; step < 72; step += 1) {
                    const x = 4 + away * Math.cos(step * Math.PI / 36), y = -3 + away * Math.sin(step * Math.PI / 36);
                    const place = [frame.left + (x + 18) * frame.scale, frame.top + (y + 18) * frame.scale];
                    sum += Math.max(...context.getImageData(...place.map(Math.round), 1, 1).data.slice(0, 3)) / 72;
                }
                return sum;
            };
            const { left, top, across, down } = frame;
            const data = new Uint32Array(context.getImageData(left, top, across, down).data.buffer);
            return [light(1), light(5), light(9), new Set(data).size];
        }"""
    )
    assert max(found[0], found[2]) < 60
    assert found[1] > 150
    assert found[3] > 200  # colours: bins, and steps between them, would have some ten


def test_a_smooth_map_runs_through_its_cells_and_its_lines_lie_where_it_has_their_value(page: Any) -> None:
    found = page.evaluate(
        """async () => {
            const { contour, finer } = await import('/static/js/smooth.js');
            const ramp = finer(Float32Array.of(0, 1, 2, 3, 0, 1, 2, 3), 2, 4, 3);
            const cone = Float32Array.from({ length: 81 }, (_, at) => Math.hypot(at % 9 - 4, Math.floor(at / 9) - 4));
            const path = contour({ values: cone, rows: 9, cols: 9 }, 3, 0, 0, 10, 20); // about (45, 90)
            const context = document.createElement('canvas').getContext('2d');
            const angles = Array.from({ length: 16 }, (_, step) => step * Math.PI / 8);
            const at = (away, angle) => [45 + away * Math.cos(angle), 90 + 2 * away * Math.sin(angle)];
            const on = (away) => angles.filter((angle) => context.isPointInStroke(path, ...at(away, angle))).length;
            context.lineWidth = 4;
            return { middles: [1, 4, 7, 10].map((at) => ramp.values[12 + at]), between: ramp.values[12 + 5],
                     size: [ramp.rows, ramp.cols], on: [on(25), on(30), on(35)] };
        }"""
    )
    assert found['size'] == [6, 12]
    assert found['middles'] == pytest.approx([0, 1, 2, 3], abs=1e-6)
    assert found['between'] == pytest.approx(1 + 1 / 3, abs=1e-6)  # of a straight rise, a third of the way
    assert found['on'] == [0, 16, 0]


def test_the_page_follows_the_force(page: Any, sensor: Sensor) -> None:
    text(page, '#total').to_have_text('0.730')
    sensor.total_n = 0.25
    text(page, '#total').to_have_text('0.250')
    sensor.total_n = 0.0
    text(page, '#contacts tr:first-child').to_contain_text('nothing touches')
    text(page, '#total').to_have_text('0.000')


def test_after_packets_that_could_not_be_drawn_the_page_goes_on(own_page: Any, own_sensor: Sensor) -> None:
    text(own_page, '#total').to_have_text('0.730')
    own_page.evaluate(
        """() => {
          const context = CanvasRenderingContext2D.prototype, works = context.clearRect;
          context.clearRect = () => { throw new Error('no canvas'); };
          window.mend = () => { context.clearRect = works; };
        }"""
    )
    while len(own_page.faults) < IN_FLIGHT:
        own_page.wait_for_timeout(20)
    own_page.evaluate('() => window.mend()')
    own_sensor.total_n = 0.25
    text(own_page, '#total').to_have_text('0.250')


def test_an_invalid_force_is_no_number_and_the_reason_is_a_sentence(page: Any, sensor: Sensor) -> None:
    sensor.status, sensor.reasons = types.ForceDistribution.STATUS_INVALID, types.ForceDistribution.REASON_DARK_IMAGE
    sensor.total_n = 0.0
    text(page, '#status').to_have_text('INVALID')
    text(page, '#contacts tr:first-child').to_have_text('–')
    text(page, '#reason').to_have_text('The image is dark. Is the lamp on and the lens uncovered?')
    text(page, '#total').to_have_text('–')


# What the page says of fields that have not changed for 5 s.
TOLD = "async (fields) => (await import('/static/js/status.js')).statusOf(fields, 5, false, { open: true })"


def test_when_nothing_comes_what_is_most_wrong_is_named(page: Any) -> None:
    sentences = {
        ('warning', 'error'): 'No data for 5 s. /flow: it is flow',
        ('error', 'error'): 'No data for 5 s. /camera: it is camera',
        ('ok', 'warning'): 'No data for 5 s. /flow: it is flow',
        ('ok', 'ok'): 'No data for 5 s.',
    }
    for levels, sentence in sentences.items():
        health = [
            {'node': f'/{name}', 'level': level, 'text': f'it is {name}', 'silent_s': None}
            for name, level in zip(('camera', 'flow'), levels, strict=True)
        ]
        assert page.evaluate(TOLD, {'force': {}, 'slow': {'health': health}}) == ['nodata', 'NO DATA', sentence]


def test_a_live_view_that_hangs_is_no_sensor_that_sends_nothing(page: Any) -> None:
    """Its connection stays open, also when the network on the way to it has gone."""
    told = """async () => {
        const { Link } = await import('/static/js/link.js');
        const { statusOf } = await import('/static/js/status.js');
        const link = Object.create(Link.prototype, { open: { value: true } });
        return [1000, 4000].map((ago) => {
            link.heardAt = performance.now() - ago;
            return statusOf({ force: {}, slow: { health: [] } }, 5, false, link);
        });
    }"""
    assert page.evaluate(told) == [
        ['nodata', 'NO DATA', 'No data for 5 s.'],
        ['nodata', 'NO CONNECTION', 'The live view does not respond, no data for 5 s.'],
    ]


def test_a_node_that_was_silent_long_before_the_data_ended_is_not_named(page: Any) -> None:
    """A recorder that ended an hour ago, say. The camera was lost with its last words."""
    recorder = {'node': '/bag_recorder', 'level': 'error', 'text': 'bag: the disk is full', 'silent_s': 3600.0}
    for level, sentence in {'error': '/camera: camera: lost', 'ok': 'Silent: /camera, /flow.'}.items():
        camera = {'node': '/camera', 'level': level, 'text': 'camera: lost', 'silent_s': 6.0}
        flow = {**camera, 'node': '/flow', 'level': 'ok'}
        found = page.evaluate(TOLD, {'force': {}, 'slow': {'health': [recorder, camera, flow]}})
        assert found == ['nodata', 'NO DATA', f'No data for 5 s. {sentence}']


def test_when_nothing_comes_no_number_stays_and_when_it_comes_again_it_is_shown(page: Any, sensor: Sensor) -> None:
    text(page, '#total').to_have_text('0.730')
    sensor.sending = False
    text(page, '#status').to_have_text('NO DATA')
    text(page, '#total').to_have_text('–')
    text(page, '#reason').to_contain_text('No data for')
    text(page, '#camera-veil').to_contain_text('no image for')
    sensor.sending = True
    text(page, '#total').to_have_text('0.730')
    text(page, '#status').to_have_text('OK')


def test_the_page_comes_back_by_itself_when_its_node_is_started_again(
    own_page: Any, running: Running, url: str
) -> None:
    text(own_page, '#total').to_have_text('0.730')
    running.end()
    text(own_page, '#status').to_have_text('NO CONNECTION')
    text(own_page, '#total').to_have_text('–')
    running.start(LiveViewNode, port=int(url.rstrip('/').rpartition(':')[2]))
    text(own_page, '#total').to_have_text('0.730')


def test_a_rest_image_is_refused_under_a_touch_unless_a_person_insists(own_page: Any, running: Running) -> None:
    called = threading.Event()

    def answer(_: types.Trigger_Request, reply: Callable[[Any], None]) -> None:
        called.set()
        reply(types.Trigger_Response(success=True, message='capturing it'))

    running.bus.serve('/flow_features/capture_reference', services.TRIGGER, answer)
    text(own_page, '#total').to_have_text('0.730')
    own_page.click('#rest')
    text(own_page, '#answer').to_contain_text('Something seems to touch the gel (0.730 N)')
    assert not called.is_set()
    own_page.click('#answer button')
    text(own_page, '#answer').to_have_text('capturing it')
    assert called.is_set()


def test_a_bag_is_recorded_from_the_page(
    own_page: Any, running: Running, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    running.start(RecorderNode, autostart=False)
    own_page.click('#record')
    text(own_page, '#recording-mark').to_be_visible()
    text(own_page, '#bag').to_contain_text(f'recording into {tmp_path}')
    expect(own_page.locator('#bag li')).to_have_count(1)
    own_page.click('#record')
    text(own_page, '#recording-mark').to_be_hidden()
    (bag,) = tmp_path.glob('rosbag2_*')
    expect(own_page.locator('#bag li').first).to_contain_text(f'into {bag}')
    assert len(list(bag.glob('*.mcap'))) == 1


def test_what_a_bag_lost_and_what_that_means_stays_on_the_page_whole(own_page: Any, running: Running) -> None:
    publisher = running.bus.advertise(topics.DIAGNOSTICS.name, topics.DIAGNOSTICS.type_name, topics.DIAGNOSTICS.qos)
    lines = [
        'wrote 7283 messages (118.3 MB, 12.2 s) into /home/somebody/recordings/of/the/day/rosbag2_2030_01_31-13_59_59',
        'lost on the way: 72 of /image_raw, 3 of /camera_info',
        '/image_raw: forces of those instants cannot be computed again',
        '/camera_info: nothing that is computed needs them',
    ]
    values = {'bag': lines[0].rpartition(' ')[2], 'messages': '7283', 'lost': '75', 'lost_of': '/image_raw 72'}
    status = types.DiagnosticStatus(
        level=1, name='recorder: bag', message='; '.join(lines),
        values=[types.KeyValue(key=key, value=value) for key, value in values.items()],
    )  # fmt: skip
    publisher.publish(types.DiagnosticArray(status=[status]))
    expect(own_page.locator('#bag li')).to_have_text(lines)
    expect(own_page.locator('#nodes')).not_to_contain_text('lost on the way')  # once is enough
    assert is_whole(own_page, '#bag')


WARNING = (
    'The light has changed since the rest image was taken, and frames are not trusted as far as they differ: shield '
    'the sensor from outside light, or press "Tare: new rest image" while nothing touches the gel, and look here again.'
)


def test_a_warning_shows_its_remedy_whole(own_page: Any, running: Running, own_sensor: Sensor) -> None:
    health = running.bus.advertise(topics.DIAGNOSTICS.name, topics.DIAGNOSTICS.type_name, topics.DIAGNOSTICS.qos)
    health.publish(
        types.DiagnosticArray(status=[types.DiagnosticStatus(level=1, name='camera: camera', message=WARNING)])
    )
    publisher = running.bus.advertise(topics.ROSOUT.name, topics.ROSOUT.type_name, topics.ROSOUT.qos)
    publisher.publish(types.Log(level=30, name='camera', msg=WARNING))
    own_sensor.status = types.ForceDistribution.STATUS_DEGRADED
    own_sensor.reasons = (1 << 20) - 1  # all there are
    text(own_page, '#reason').to_contain_text(sentences(own_sensor.reasons)[-1])
    text(own_page, '#nodes').to_contain_text(WARNING)
    text(own_page, '#logs').to_contain_text(WARNING)
    for width in (1280, 390):
        own_page.set_viewport_size({'width': width, 'height': 720})
        own_page.wait_for_function('(width) => document.documentElement.scrollWidth === width', arg=width)
        assert [place for place in ('#reason', '#nodes', '#logs') if not is_whole(own_page, place)] == []


def is_whole(page: Any, place: str) -> bool:
    """Whether no part of a text is cut off: of none of its elements, nor of those around it."""
    return bool(
        page.evaluate(
            """(place) => {
                const found = document.querySelector(place);
                const inside = [found, ...found.querySelectorAll('*')];
                const cut = (each) =>
                    each.scrollWidth > each.clientWidth + 1 || each.scrollHeight > each.clientHeight + 1;
                const flat = inside.filter((each) => getComputedStyle(each).display !== 'inline');
                for (let outer = found.parentElement; outer; outer = outer.parentElement) {
                    const [box, frame] = [found.getBoundingClientRect(), outer.getBoundingClientRect()];
                    const hides = getComputedStyle(outer).overflow !== 'visible';
                    if (hides && (box.bottom > frame.bottom + 1 || box.right > frame.right + 1)) return false;
                }
                return !flat.some(cut);
            }""",
            place,
        )
    )


def test_the_scale_follows_a_press_down_to_a_twentieth_of_a_newton(page: Any, sensor: Sensor) -> None:
    expect(page.locator('#scale')).to_have_value('auto')
    page.wait_for_function(bin_is_bright(), arg=0.5)  # on 0 to 1 N: beyond the middle of the colours
    sensor.total_n = 0.05
    text(page, '#total').to_have_text('0.050')
    page.wait_for_function(bin_is_bright(), arg=0.5)


def bin_is_bright() -> str:
    """JavaScript: whether some 300 pixels of the map are at least so bright (0 to 1)."""
    return """(least) => {
        const canvas = document.getElementById('map');
        const width = canvas.width * 0.8; // without the bar of the colours
        const data = canvas.getContext('2d').getImageData(0, 0, width, canvas.height).data;
        let count = 0;
        for (let at = 0; at < data.length; at += 4) {
            // "inferno": red and yellow, not the bluish ring of the contact
            count += data[at] > 255 * least && data[at] > data[at + 2] + 60;
        }
        return count > 300;
    }"""


def test_the_course_of_the_force_begins_before_the_page_was_opened(
    chromium: Any, running: Running, own_sensor: Sensor
) -> None:
    node = running.start(LiveViewNode, port=0)
    assert isinstance(node, LiveViewNode)
    while len(node.server._audiences['']._history) < 15:
        threading.Event().wait(0.05)
    own_sensor.total_n = 0.0
    with opened(chromium, node.server.url) as page:
        text(page, '#total').to_have_text('0.000')
        page.wait_for_function(
            """() => {
                const canvas = document.querySelector('#chart canvas');
                const data = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height * 0.6).data;
                let count = 0;
                for (let at = 0; at < data.length; at += 4)
                    count += data[at] > 200 && data[at + 1] > 120 && data[at + 2] < 120 && data[at + 3] > 100;
                return count > 10; // orange, far above nought
            }"""
        )


@pytest.mark.usefixtures('own_sensor')
def test_one_page_too_many_says_so_and_watches_once_another_is_closed(chromium: Any, running: Running) -> None:
    url = running.start(LiveViewNode, port=0, viewers=1).server.url
    with opened(chromium, url) as one, opened(chromium, url) as other:
        text(one, '#total').to_have_text('0.730')
        text(other, '#reason').to_have_text('Too many pages are open already. Close one.')
        one.close()
        text(other, '#total').to_have_text('0.730')
        assert other.faults == []


@pytest.fixture
def of_another_account(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(accounts, 'owners', lambda: frozenset({os.getuid() + 1}))


@pytest.mark.usefixtures('own_sensor', 'of_another_account')
def test_a_guest_watches_and_finds_the_buttons_closed(chromium: Any, running: Running) -> None:
    running.bus.serve('/flow_features/capture_reference', services.TRIGGER, lambda request, reply: None)
    node = running.start(LiveViewNode, port=0, guests='watch')
    with opened(chromium, node.server.url) as page:
        text(page, '#total').to_have_text('0.730')
        text(page, '#answer').to_contain_text('Only the user who started the sensor')
        expect(page.locator('#rest')).to_be_disabled()


@pytest.mark.usefixtures('of_another_account')
def test_another_account_reads_why_it_sees_nothing(chromium: Any, url: str) -> None:
    with opened(chromium, url) as page:
        text(page, 'body').to_contain_text('This server is for the user who started it')


def test_nothing_lies_beyond_the_edge(page: Any) -> None:
    for width, height in ((1280, 720), (1920, 1080), (390, 844)):
        page.set_viewport_size({'width': width, 'height': height})
        page.wait_for_function(
            """([width, height]) => {
                const { scrollWidth, scrollHeight } = document.documentElement;
                return scrollWidth === width && (scrollHeight === height || width < 500);
            }""",
            arg=[width, height],
            timeout=PATIENCE_MS,
        )  # one screen, but on a telephone


def test_the_page_of_a_sensor_in_a_namespace_says_which(chromium: Any, running: Running) -> None:
    node = running.start(LiveViewNode, namespace='/left', port=0)
    with opened(chromium, node.server.url) as page:
        text(page, 'h1').to_have_text('tactile /left')
        text(page, '#status').to_have_text('WAITING')


def test_what_nodes_say_cannot_become_part_of_the_page(own_page: Any, running: Running) -> None:
    publisher = running.bus.advertise(topics.ROSOUT.name, topics.ROSOUT.type_name, topics.ROSOUT.qos)
    publisher.publish(types.Log(level=40, name='camera', msg='<img src=x onerror=alert(1)>'))
    text(own_page, '#logs').to_contain_text('<img src=x onerror=alert(1)>')
    expect(own_page.locator('#logs img')).to_have_count(0)
