"""A calibration from its first press to the file that it writes, or to its end before that."""

from __future__ import annotations

from pathlib import Path

import pytest

from tactile_nodes.errors import AskedToEndError
from tactile_nodes.learning.calibrating.presses import BagPresses
from tactile_nodes.learning.calibrating.session import CalibrationSession, CalibrationSettings

pytestmark = pytest.mark.usefixtures('own_cache')


def test_a_session_that_is_ended_finishes_the_press_under_way_and_writes_no_model(
    first_model: Path, other_bag: Path, tmp_path: Path
) -> None:
    folder = tmp_path / 'calibration'
    settings = CalibrationSettings(model=str(first_model), gel='gel-7', folder=str(folder))
    session = CalibrationSession(settings, lambda _: session.end())  # told of the first press
    with pytest.raises(AskedToEndError, match='asked to end after 2 presses; no model was written'):
        session.run(BagPresses([other_bag]), None)
    assert not folder.exists()
