"""`tactile collect`: what a plan asks of a rig, before anything moves."""

from __future__ import annotations

from pathlib import Path

import pytest

from tactile_nodes.cli.main import main


def test_a_plan_is_reported_press_by_press(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['collect', 'quick', '--points']) == 0
    printed = capsys.readouterr().out
    assert printed.count('depth 1.000 mm') == 9  # 3x3 places, 5 mm apart
    assert 'x -5 to 5 mm, y -5 to 5 mm from the middle, at most 1 mm deep' in printed


def test_the_way_is_drawn(tmp_path: Path) -> None:
    pytest.importorskip('matplotlib')
    assert main(['collect', 'quick', '--draw', str(tmp_path / 'new' / 'way.png')]) == 0
    assert (tmp_path / 'new' / 'way.png').read_bytes().startswith(b'\x89PNG')


def test_a_drawing_without_an_ending_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip('matplotlib')
    assert main(['collect', 'quick', '--draw', str(tmp_path / 'way')]) == 1
    assert 'its name must end in .png, .pdf or .svg' in capsys.readouterr().err
