"""``tactile evaluate``: which files it writes."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest

from tactile_nodes.cli import evaluate
from tactile_nodes.cli.main import main


@pytest.mark.parametrize(
    ('models', 'written'),
    [
        (['a/gel.safetensors'], ['answers.csv']),
        (['a/gel.safetensors', 'b/other.safetensors'], ['answers_gel.csv', 'answers_other.csv']),
        # as in two folders of presses by hand, whose models are both called calibrated.safetensors
        (['a/gel.safetensors', 'b/gel.safetensors'], ['answers_gel_id of a.csv', 'answers_gel_id of b.csv']),
    ],
)
def test_each_of_several_models_gets_a_table_of_its_own(
    models: list[str], written: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def evaluated(name: str, _: object) -> SimpleNamespace:
        file = Path(name)
        return SimpleNamespace(name=file.stem, model_id=f'id of {file.parent}', answers=[name])

    monkeypatch.setattr(evaluate, '_evaluated', evaluated)
    monkeypatch.setattr('tactile_nodes.learning.evaluation.tables.report', lambda _: '')
    monkeypatch.setattr(
        'tactile_nodes.learning.evaluation.tables.write_estimates', lambda answers, file: file.write_text(answers[0])
    )
    assert main(['evaluate', *models, '--table', str(tmp_path / 'answers.csv')]) == 0
    assert sorted(each.name for each in tmp_path.iterdir()) == written
    assert [(tmp_path / name).read_text() for name in written] == models
