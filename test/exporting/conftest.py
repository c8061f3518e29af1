"""What the tests of exports share."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from tactile_nodes.cli.main import main


@pytest.fixture(scope='module')
def parquet(bag: Path) -> Path:
    """The tables of the module's bag."""
    output = bag.parent / 'tables'
    assert main(['export', 'parquet', str(bag), '-o', str(output)]) == 0
    return output


@pytest.fixture
def refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """With which words an export of bags is refused, of which nothing is left."""

    def words_of(kind: str, *words: Path | str) -> str:
        output = tmp_path / 'refused'
        assert main(['export', kind, *map(str, words), '-o', str(output)]) == 1
        assert not output.exists()
        return capsys.readouterr().err

    return words_of
