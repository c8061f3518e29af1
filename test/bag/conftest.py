"""What the tests of bags share."""

from __future__ import annotations

from pathlib import Path

import pytest
from bagging import samples, write


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """A bag of ten messages."""
    write(tmp_path / 'press', samples(10))
    return tmp_path / 'press'
