"""`tactile compile`: loops are compiled ahead, once."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest

from tactile_nodes.cli.compile import compile_all
from tactile_nodes.errors import ConfigurationError

pytestmark = pytest.mark.timeout(400)


@pytest.mark.skipif(importlib.util.find_spec('numba') is None, reason='numba is not installed')
def test_the_second_time_all_is_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv('NUMBA_CACHE_DIR', str(tmp_path))
    assert compile_all(('axisymmetric',)).startswith('compiled 1 of 1 parts in ')
    assert compile_all(('axisymmetric',)) == 'all inner loops were compiled before; compiled:=true starts at once'


def test_without_numba_the_message_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    from tactile_nodes.sensing.compiling import compile_part

    monkeypatch.setattr(importlib.util, 'find_spec', lambda _: None)
    with pytest.raises(ConfigurationError, match=r"pip install 'tactile_nodes\[compiled\]'"):
        compile_part('patches')
