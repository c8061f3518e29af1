"""The bench of frames in which nothing touches: what it counts, and its short form."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks import untouched
from benchmarks.untouched.page import page
from tactile_nodes.learning.progress import Progress
from tactile_nodes.sensing.picture.stillness import StillnessOptions


def test_a_touch_within_the_limit_is_counted_as_missed() -> None:
    shares = untouched._shares([3.0, 5.0, 4.0, 9.0], limit=4.0)
    assert (shares['count'], shares['within'], shares['least'], shares['most']) == (4, 2, 3.0, 9.0)


@pytest.mark.parametrize('name', list(untouched.DISTURBANCES))
def test_disturbances_leave_an_image_an_image(name: str) -> None:
    image = np.random.default_rng(0).integers(20, 200, (440, 440), dtype=np.uint8)
    changed = untouched.DISTURBANCES[name](image)
    assert (changed.shape, changed.dtype) == (image.shape, np.uint8)
    assert (changed == image).all() == (name == 'nothing')


def test_seconds_of_presses_are_answered_alike_with_the_look_and_without() -> None:
    found = untouched.minute(['fast'], 1.5, Progress())['fast']
    assert found['frames'] == 90
    assert 0 < found['touching'] < 90
    assert found['untouched_at_rest'] > 10
    assert found['missed_20_mn'] == 0
    assert found['same_when_measured']


def test_the_page_says_how_many_touches_were_missed() -> None:
    gel = {
        'rest': {'count': 100, 'within': 90, 'least': 1.0, 'median': 2.0, 'most': 5.0},
        'touches': {'0.02': {'count': 50, 'within': 1, 'least': 3.0, 'median': 9.0, 'most': 12.0}},
        'corners': {'count': 40, 'within': 2, 'least': 3.0, 'median': 6.0, 'most': 12.0},
    }
    times = {'without': 2.0, 'with': 1.0}
    minute = {
        'frames': 3600, 'touching': 1800, 'untouched': 1500, 'untouched_at_rest': 1490, 'most_missed_n': 0.004,
        'missed_20_mn': 0, 'rest_ms': times, 'touch_ms': times, 'cpu_s': times, 'rmse_n': times,
        'same_when_measured': True,
    }  # fmt: skip
    surroundings = {
        'command': 'tactile bench untouched', 'commit': 'abc', 'versions': {'numpy': '2'},
        'machine': {'processor': 'P', 'cores_allowed': 2, 'load_before': [0.5]},
    }  # fmt: skip
    options = vars(StillnessOptions())
    text = page({**surroundings, 'options': options, 'gels': {'soft': gel},
                 'disturbances': {'dirt': {'measured': 1.0, 'missed': 0.0}}, 'minute': {'fast': minute}})  # fmt: skip
    assert '| soft, at rest          |    100 | 10 (10.0%) alarms |' in text
    assert '| soft, 20 mN            |     50 |   1 (2.0%) missed |' in text
    assert '| soft, 20 mN in corners |     40 |   2 (5.0%) missed |' in text
    assert '50%' in text
