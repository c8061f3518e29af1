"""The cache of features: several processes use it at once, and what prevents that is said."""

from __future__ import annotations

import shutil
import sqlite3
from pathlib import Path

import numpy as np
import pytest

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.learning.config import Choice
from tactile_nodes.learning.recorded.feature_cache import FeatureCache, Measured
from tactile_nodes.learning.recorded.measuring import CODE, Measurer
from tactile_nodes.sensing.flow.choice import SENSING, code_id

KEY, OTHER = bytes(32), bytes([1] * 32)
SHAPE = (2, 3, 2)
MEASURED = Measured(np.ones(SHAPE, np.float16), np.ones(SHAPE[:2], np.float32))


def test_what_one_process_measured_another_has_at_once_and_may_write_too(tmp_path: Path) -> None:
    first, second = (FeatureCache(tmp_path / 'a.sqlite') for _ in range(2))
    second._open.execute('PRAGMA busy_timeout=100')  # ms; it waits for 30 s otherwise
    first.put(KEY, MEASURED)
    second.put(OTHER, MEASURED)
    assert second.get(KEY, SHAPE) is not None
    assert first.get(OTHER, SHAPE) is not None
    for each in (first, second):
        each.close()


def test_a_cache_that_another_process_is_just_making_is_used(tmp_path: Path) -> None:
    """SQLite waits for the other's lock, but not where it changes the mode of the file: there it fails at once."""
    other = sqlite3.connect(tmp_path / 'a.sqlite', isolation_level=None)
    other.execute('CREATE TABLE features (key BLOB PRIMARY KEY, vals BLOB, confidence BLOB)')
    other.execute('BEGIN IMMEDIATE')
    cache = FeatureCache(tmp_path / 'a.sqlite')
    assert cache.get(KEY, SHAPE) is None
    other.execute('COMMIT')
    cache.put(KEY, MEASURED)
    assert cache.get(KEY, SHAPE) is not None
    cache.close()
    other.close()


def test_a_folder_for_the_cache_that_cannot_be_made_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / 'file').touch()
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path / 'file'))
    with pytest.raises(ConfigurationError, match=r'/file/.* \(Not a directory\); set XDG_CACHE_HOME'):
        Measurer(Choice('dis'), Choice('cartesian_mean', {'rows': 20, 'cols': 20}))


@pytest.mark.parametrize('changed', ['flow/dots.py', 'features.py', 'picture/knocks.py', 'rest/moved_camera.py'])
def test_what_other_code_has_measured_is_measured_again(changed: str, tmp_path: Path) -> None:
    """A model's response is that of the code at hand; the motion of an older version would calibrate it wrong."""
    for version in ('same', 'newer'):
        shutil.copytree(SENSING, tmp_path / version)
    with (tmp_path / 'newer' / changed).open('a') as file:
        file.write('ROUNDS = 13\n')
    same, newer = (code_id(tmp_path / version, CODE) for version in ('same', 'newer'))
    assert same == code_id(measuring=CODE) != newer
