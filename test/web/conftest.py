"""One browser for the pages of a file."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest


@pytest.fixture(scope='module')
def chromium() -> Iterator[Any]:
    from browsing import started  # not above: it may not be installed

    with started() as made:
        yield made
