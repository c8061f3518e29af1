"""Beside this file lies what the tests of the folders below import: `rehearsing` and `quick_clock`."""

from __future__ import annotations

import os

import pytest


@pytest.fixture(autouse=True)
def _nothing_waits_for_the_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    """A killed process loses nothing that it has written; only a power cut would."""
    monkeypatch.setattr(os, 'fsync', lambda _: None)
