"""A picture of what moved: arrows where something did, and nowhere else."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_nodes.sensing.flow.overlay import overlay


@pytest.mark.parametrize('side', [160, 4], ids=['by pixels', 'by patches'])
def test_overlay_draws_arrows_only_where_something_moves(side: int) -> None:
    field = np.zeros((side, side, 2), np.float32)
    field[side // 2 :, side // 2 :] = (3.0, 0.0)
    picture = overlay(np.zeros((160, 160), np.uint8), field)
    assert picture.shape == (160, 160, 3)
    assert picture[:70, :70].max() == 0
    assert picture[90:150, 90:150].max() > 0
