"""``tactile evaluate``: which files it writes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pytest

from tactile_nodes.cli import evaluate
from tactile_nodes.cli.main import main


@dataclass
class Evaluated:
    name: str
    model_id: str
    answers: list[str]


@pytest.mark.parametrize(
    ('models', 'written'),
    [
        (['a/gel.safetensors'], ['answers.csv']),
        (['a/gel.safetensors', 'b/other.safetensors'], ['answers_gel.csv', 'answers_other.csv']),
        # as in two folders of presses by hand, whose models are both called calibrated.safetensors
        (['a/gel.safetensors', 'b/gel.safetensors'], ['answers_gel_id of a.csv', 'answers_gel_id of b.csv']),
    ],
)
def test_each_of_several_models_has_a_table_and_a_name_of_its_own(
    models: list[str], written: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    reported: list[Evaluated] = []

    def evaluated(name: str, _: object) -> Evaluated:
        file = Path(name)
        return Evaluated(file.stem, f'id of {file.parent}', [name])

    monkeypatch.setattr(evaluate, '_evaluated', evaluated)
    monkeypatch.setattr('tactile_nodes.learning.evaluation.tables.report', reported.extend)
    monkeypatch.setattr(
        'tactile_nodes.learning.evaluation.tables.write_estimates', lambda answers, file: file.write_text(answers[0])
    )
    assert main(['evaluate', *models, '--table', str(tmp_path / 'answers.csv')]) == 0
    assert sorted(each.name for each in tmp_path.iterdir()) == written
    assert [(tmp_path / name).read_text() for name in written] == models
    assert len({each.name for each in reported}) == len(models)
