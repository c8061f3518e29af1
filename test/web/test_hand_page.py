"""The page of a hand: one server for all its sensors; in Chromium all together, and each alone when it is chosen."""

from __future__ import annotations

import math
import threading
from collections.abc import Iterator
from pathlib import Path
from socket import gethostname
from typing import Any

import numpy as np
import pytest
from browsing import IN_CHROMIUM, expect, opened

from tactile_nodes import conversions
from tactile_nodes.bus import topics
from tactile_nodes.bus.inprocess import InProcessBus
from tactile_nodes.bus.node.arguments import parse_arguments
from tactile_nodes.bus.node.runtime import run_until
from tactile_nodes.messages import types
from tactile_nodes.nodes.hand.hand_wrench import HandWrenchNode
from tactile_nodes.nodes.live_view import LiveViewNode
from tactile_nodes.pipeline.hand_forces import HandForces

pytestmark = IN_CHROMIUM
HAND = """\
frame: grip
friction: 0.5
sensors:
  - {name: left, frame: {rpy_deg: [90.0, 0.0, 0.0]}}
  - {name: right, frame: {rpy_deg: [-90.0, 0.0, 0.0]}}
  - {name: thumb, source: /dev/video99}
  - {name: thumb}
"""
SIGMA_N = 0.01


def pressed(stamp_ns: int, normal_n: float, shear_n: float) -> types.ForceDistribution:
    return types.ForceDistribution(
        header=conversions.header(stamp_ns, 'x'), rows=1, cols=2, bin_width=0.01, bin_height=0.01,
        normal_force=np.array([0.0, normal_n], np.float32), total=normal_n, peak=normal_n, in_contact=True,
        contacts=[types.Contact(force=normal_n, shear_x=shear_n)],
        wrench=types.Wrench(force=types.Vector3(x=shear_n, y=0.0, z=-normal_n)),
        wrench_covariance=np.eye(6).reshape(-1) * SIGMA_N**2,
    )  # fmt: skip


@pytest.fixture
def loads_n() -> dict[str, tuple[float, float]]:
    """How hard each finger is pressed and dragged."""
    return {'left': (1.0, 0.1), 'right': (1.5, 0.6)}


@pytest.fixture
def url(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, loads_n: dict[str, tuple[float, float]]) -> Iterator[str]:
    """Of the page of a hand, seen from a machine that calls itself lab."""
    monkeypatch.setattr('platform.node', lambda: 'lab')
    (tmp_path / 'hand.yaml').write_text(HAND)
    bus, done = InProcessBus(), threading.Event()
    arguments = parse_arguments(['--ros-args', '-p', f'hand:={tmp_path}/hand.yaml', '-p', 'port:=0'])
    nodes = [HandWrenchNode(bus, arguments), LiveViewNode(bus, arguments)]
    topic = topics.FORCE_DISTRIBUTION
    ends = {name: bus.advertise(f'/{name}/{topic.name}', topic.type_name, topic.qos) for name in loads_n}

    def publish() -> None:
        while not done.wait(1 / 20):
            stamp_ns = bus.clock.now_ns()
            for name, load_n in loads_n.items():
                ends[name].publish(pressed(stamp_ns, *load_n))

    threads = [threading.Thread(target=publish), threading.Thread(target=run_until, args=(nodes, done))]
    for thread in threads:
        thread.start()
    yield nodes[1].server.url
    done.set()
    for thread in threads:
        thread.join()
    bus.close()


@pytest.fixture
def page(chromium: Any, url: str) -> Iterator[Any]:
    with opened(chromium, url) as made:
        yield made
        assert made.faults == []


def test_all_sensors_are_seen_together_and_one_alone_when_it_is_chosen(page: Any) -> None:
    tiles = page.locator('.tile')
    expect(tiles).to_have_count(3)
    expect(tiles.nth(0)).to_contain_text('1.000 N')
    expect(tiles.nth(1)).to_contain_text('1.500 N')
    expect(tiles.nth(2)).to_contain_text('WAITING')
    expect(tiles.locator('.host')).to_have_text([f'on {gethostname()}', f'on {gethostname()}', ''])
    expect(page.locator('#missing')).to_have_text('missing: thumb')
    expect(page.locator('#left-out')).to_contain_text("7: there are two sensors with the name 'thumb'; rename")
    # Into the left gel is the hand's +y, into the right its -y: 0.5 N are left. Two variances of 0.01 N: 0.014 N.
    expect(page.locator('#force')).to_have_text('x +0.700 ± 0.014   y −0.500 ± 0.014   z +0.000 ± 0.014')
    # 0.6 N of 0.5 x 1.5 N are used.
    expect(page.locator('#slips')).to_contain_text('right, margin 0.20')
    page.set_viewport_size({'width': 390, 'height': 720})  # a phone
    page.wait_for_function('document.documentElement.scrollWidth === 390')
    tiles.nth(1).click()
    expect(page.locator('#namespace')).to_have_text('/right')
    expect(page.locator('#host')).to_have_text(f'on {gethostname()}')
    expect(page.locator('#total')).to_have_text('1.500')
    page.locator('#all').click()
    expect(tiles).to_have_count(3)
    assert page.request.get(f'{page.url}?sensor=fourth').status == 404


def test_forces_without_a_sum_are_not_called_complete(page: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    expect(page.locator('#missing')).to_have_text('missing: thumb')
    monkeypatch.setattr(HandForces, 'add', lambda *_: [])
    expect(page.locator('#missing')).to_have_text('no sum: nothing comes on hand_wrench')


def test_a_force_that_is_no_number_leaves_the_rest_of_the_page_as_it_is(page: Any, loads_n: dict[str, Any]) -> None:
    tiles = page.locator('.tile')
    expect(tiles.nth(1)).to_contain_text('1.500 N')
    loads_n |= {'left': (math.nan, math.nan), 'right': (1.75, 0.0)}
    expect(tiles.nth(0)).to_contain_text('– N')
    expect(tiles.nth(1)).to_contain_text('1.750 N')
    expect(page.locator('#force')).to_have_text('x – ± 0.014   y – ± 0.014   z – ± 0.014')
