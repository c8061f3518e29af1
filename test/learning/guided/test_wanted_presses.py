"""Which press a person is asked for next: its place, its force, and that the camera sees the gel there."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tactile_nodes.cli.main import main
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.learning.guided.targets import Target, Wish
from tactile_nodes.sensors import Sensor, load_sensor
from tactile_nodes.sensors.covering import MaskSettings
from tactile_nodes.sensors.writing import text_of

MEMBRANE = load_sensor('speckle_membrane')
"""25 mm by 19 mm of gel in 640x480 pixels, so a region of a tenth of the image is 2.5 mm by 1.9 mm."""


def masked(*polygons_px: str) -> Sensor:
    return replace(MEMBRANE, mask=MaskSettings(polygons_px))


def test_the_next_press_is_far_from_all_before_and_of_the_rarest_force() -> None:
    wish = Wish(5, (0.2, 0.5), MEMBRANE)
    assert wish.next([]) == Target(0.0, 0.0, 0.2)
    # 0.8 of 12.5 and 9.5 mm may be pressed, in steps of 0.5 mm: the corners are farthest from the middle.
    second = wish.next([Target(0.0, 0.0, 0.21)])
    assert second is not None
    assert (abs(second.x_mm), abs(second.y_mm), second.force_n) == (10.0, 7.5, 0.5)
    assert wish.next([Target(0.0, 0.0, 0.2)] * 5) is None
    assert wish.gap_mm([Target(0.0, 0.0, 0.2)]) == pytest.approx(math.hypot(10, 7.5))


def test_after_a_skipped_place_another_one_comes_with_the_same_force() -> None:
    """The middle first, then the four corners, which are 12.5 mm from it and 15 mm or more from one another.

    A skipped press counts for no force.
    """
    wish, skipped = Wish(5, (0.2, 0.5), MEMBRANE), list[Target]()
    for number in range(5):
        target = wish.next([], skipped)
        assert target is not None and target.force_n == 0.2
        assert (abs(target.x_mm), abs(target.y_mm)) == ((10.0, 7.5) if number else (0.0, 0.0))
        assert target not in skipped
        skipped.append(target)


def test_a_press_counts_for_the_nearest_force_only() -> None:
    wish = Wish(9, (0.25, 0.35, 0.42), MEMBRANE)  # a quarter of 0.42 is more than the way to 0.35
    done = [Target(0.0, 0.0, force_n) for force_n in (0.26, 0.38, 0.40, 1.0)]
    assert wish.counts(done) == [1, 1, 1]


def test_presses_stay_within_the_rim_of_a_round_gel() -> None:
    """Within 0.8 of its radius of 9.5 mm, and up to half a millimetre of that."""
    round_gel = replace(MEMBRANE.gel, width_mm=19.0, height_mm=19.0, outline_mm='ellipse')
    places = Wish(5, (0.2,), replace(MEMBRANE, gel=round_gel)).places
    away = np.hypot(*places.T)
    assert 7.1 < away.max() <= 7.6 + 1e-6
    assert places[0].tolist() == [0.0, 0.0]


@pytest.mark.parametrize('name', ['simulated', 'printed_dots', 'digit_like', '9dtact_like', 'speckle_membrane'])
def test_without_a_mask_all_of_a_shipped_gel_but_its_rim_is_asked_for(name: str) -> None:
    sensor = load_sensor(name)
    width, height = (2 * int(0.8 * side / 2 / 0.5) + 1 for side in (sensor.gel.width_mm, sensor.gel.height_mm))
    assert len(Wish(5, (0.2,), sensor).places) == width * height


def test_nobody_is_asked_to_press_beside_the_bins(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A calibration refuses presses there. The bins reach from 0 to 6 mm along x, and 5 mm up and down."""
    bins = replace(MEMBRANE.bins, width_mm=6.0, height_mm=10.0, centre_mm=(3.0, 0.0))
    described = replace(MEMBRANE, bins=bins)
    places = Wish(5, (0.2,), described).places
    assert [places.min(axis=0).tolist(), places.max(axis=0).tolist()] == [[0.0, -5.0], [6.0, 5.0]]
    (tmp_path / 'mine.yaml').write_text(text_of(described, {}))
    words = ['press', str(tmp_path / 'by_hand'), '--sensor', str(tmp_path / 'mine.yaml'), '--presses', '3']
    (tmp_path / 'by_hand').mkdir()
    (tmp_path / 'by_hand' / 'presses.csv').write_text('picture,x_mm,y_mm,force_g,indenter\na.png,7,0,20,ball:0.6\n')
    assert main(words) == 1
    assert 'line 2: 7, 0 mm lies beyond the bins of this sensor' in capsys.readouterr().err


def test_nobody_is_asked_to_press_under_a_mask() -> None:
    """The mask covers the left half of the image, and the middle of the gel is in the middle of the image."""
    wish = Wish(5, (0.2,), masked('0,0 318,0 318,479 0,479'))
    assert wish.places[:, 0].min() == 0.0
    assert (wish.places[:, 1] == 0).sum() == 21  # 0 to 10 mm along x
    assert (wish.places[:, 0] == 10).sum() == 31  # -7.5 to 7.5 mm along y


def test_nobody_is_asked_to_press_in_a_gap_of_the_mask_that_holds_no_whole_region() -> None:
    """A slit of 60 px on the left, narrower than a region, beside an open right half."""
    wish = Wish(5, (0.2,), masked('0,0 99,0 99,479 0,479', '160,0 318,0 318,479 160,479'))
    assert wish.places[:, 0].min() == 0.0


def test_a_mask_that_leaves_nothing_to_press_is_told() -> None:
    """All is covered but a hole of 40 px, which holds no region."""
    wish = Wish(5, (0.2,), masked('0,0 639,0 639,479 0,479', '300,220 340,220 340,260 300,260'))
    with pytest.raises(ConfigurationError, match='sees no place of the gel that could be pressed: correct mask'):
        wish.next([])
