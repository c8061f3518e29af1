"""`tactile model info`: a model's card, readable by people and by programs."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from tactile_nodes.cli.main import main


def test_the_card_says_what_a_model_was_made_of_and_for(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['model', 'info', 'fast']) == 0
    card = yaml.safe_load(capsys.readouterr().out)
    assert card['command'] == 'tactile train config/train/fast.yaml'
    assert card['flow']['name'] == 'inverse_compositional'
    assert card['units']['normal_force'].startswith('N')
    assert {'model_id', 'data', 'gel', 'training', 'validation', 'licence', 'readout'} <= set(card)


@pytest.mark.parametrize('name', ['fast', 'portable', 'paper'])
def test_cards_that_ship_name_no_place_on_somebodys_machine(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['model', 'info', name]) == 0
    assert str(Path.home()) not in (printed := capsys.readouterr().out)
    assert yaml.safe_load(printed)['command'] == f'tactile train config/train/{name}.yaml'


def test_a_model_that_is_none_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['model', 'info', 'soft']) == 1
    assert "there is no model 'soft'" in capsys.readouterr().err
