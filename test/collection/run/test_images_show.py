"""A press that the images do not show is not recorded, whatever the force says."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from rehearsing import Run

from tactile_nodes.collection.readings import frame_of, pattern_change
from tactile_nodes.errors import DeviceFaultError, ImageError

GREY = np.full((40, 50), 100, np.uint8)


def test_marker_that_moves_within_a_block_is_a_change_though_the_mean_is_the_same() -> None:
    before, after = GREY.copy(), GREY.copy()
    before[4:8, 4:8], after[4:8, 8:12] = 0, 0  # 32 of the 256 pixels change by 100
    change = pattern_change(frame_of(1, before), frame_of(2, after))
    assert change == pytest.approx(100 * (32 / 256) ** 0.5)


def test_images_of_two_sizes_cannot_be_compared() -> None:
    with pytest.raises(ImageError, match='size'):
        pattern_change(frame_of(1, GREY), frame_of(2, GREY[:32]))


def test_camera_that_shows_the_untouched_gel_for_ever_ends_the_run_at_deep_presses(tmp_path: Path) -> None:
    run = Run(tmp_path)
    run.rig._camera = lambda time_ns: GREY
    with pytest.raises(DeviceFaultError, match='images do not show'):
        run.campaign.run()
    assert {record.point.depth_mm for record in run.published if not record.reason} == {0.5}  # too light to be sure
