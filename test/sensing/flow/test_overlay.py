"""A picture of what moved: arrows where something did, and nowhere else."""

from __future__ import annotations

import numpy as np

from tactile_nodes.sensing.flow.overlay import overlay


def test_overlay_draws_arrows_only_where_something_moves() -> None:
    field = np.zeros((160, 160, 2), np.float32)
    field[80:, 80:] = (3.0, 0.0)
    picture = overlay(np.zeros((160, 160), np.uint8), field)
    assert picture.shape == (160, 160, 3)
    assert picture[:70, :70].max() == 0
    assert picture[90:150, 90:150].max() > 0


def test_overlay_draws_motion_by_patches_where_the_patches_are() -> None:
    field = np.zeros((4, 4, 2), np.float32)
    field[2:, 2:] = (3.0, 0.0)
    picture = overlay(np.zeros((160, 160), np.uint8), field)
    assert picture[:70, :70].max() == 0
    assert picture[90:150, 90:150].max() > 0
