"""The bench of accuracy: what it writes, and the shares that its aims are stated in."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from coarse_model import config_of, random_network

from benchmarks import accuracy
from benchmarks.accuracy.page import page
from benchmarks.harness.report import surroundings
from tactile_nodes.cli.main import main
from tactile_nodes.learning.progress import Progress

pytestmark = pytest.mark.usefixtures('own_cache')


def save(file: Path, seconds: float, hidden: int) -> Path:
    """A network that claims a training time."""
    return random_network(file, config_of(), hidden=(hidden,), seed=hidden, seconds=seconds)


@pytest.fixture(scope='module')
def models(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp('models')
    return [save(folder / 'paper.safetensors', 400.0, 16), save(folder / 'fast.safetensors', 4.0, 4)]


@pytest.fixture(scope='module')
def results(models: list[Path]) -> accuracy.Results:
    return accuracy.measure(models, models[:1], accuracy.QUICK, Progress())


def paged(results: accuracy.Results) -> str:
    return page({**surroundings('tactile bench accuracy'), **results.plain, '_page': results})


def test_every_model_is_measured_and_timed(results: accuracy.Results) -> None:
    plain = json.loads(json.dumps(results.plain, allow_nan=False))
    assert list(plain['models']) == list(plain['times_ms']) == ['paper', 'fast']
    assert plain['models']['fast']['parameters'] == 200 * 4 + 4 + 4 * 81 + 81
    assert plain['times_ms']['paper']['predict_ratio'] == {'median': 1.0, 'low': 1.0, 'high': 1.0}
    assert plain['times_ms']['fast']['flow']['median'] > 0


def test_the_page_says_what_is_simulation_and_what_the_paper_has(results: accuracy.Results) -> None:
    text = paged(results)
    assert 'All results are simulated' in text
    paper = next(line for line in text.splitlines() if line.startswith('| the paper, real gel'))
    assert [cell.strip() for cell in paper.split('|')[2:5]] == ['0.0090', '0.107', '0.0650']
    shares = {
        line.split(',')[0].strip('| '): line.split('|')[-2].strip()
        for line in text.splitlines()
        if 'relative to `paper`' in line
    }
    assert shares['training time'] == '0.010'
    assert shares['parameters'] == f'{(200 * 4 + 4 + 4 * 81 + 81) / (200 * 16 + 16 + 16 * 81 + 81):.3f}'


def test_the_curve_tells_presses_by_plan(results: accuracy.Results) -> None:
    assert '| network, random |   19000 |' in paged(results)  # 20000, of which 5 % touch nothing


@pytest.mark.parametrize(('plan', 'presses'), [('paper', 10952), ('jittered', 10952)])
def test_a_grid_has_the_papers_presses(plan: str, presses: int) -> None:
    assert accuracy.collected({'plan': plan, 'presses': 20000, 'without_contact': 0.05}) == presses


def test_the_command_writes_page_numbers_and_pictures(
    models: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip('matplotlib')
    assert main(['bench', 'accuracy', str(models[1]), '--quick', '--presses', '8', '-o', str(tmp_path)]) == 0
    assert sorted(file.name for file in tmp_path.iterdir()) == ['accuracy.json', 'accuracy.md', 'accuracy_fast.png']
    assert (tmp_path / 'accuracy.md').read_text(encoding='utf-8').strip() in capsys.readouterr().out


def test_models_of_one_name_are_refused(models: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    other = save(tmp_path / 'fast.safetensors', 1.0, 2)
    assert main(['bench', 'accuracy', str(models[1]), str(other), '--quick']) == 1
    assert 'the same file name' in capsys.readouterr().err


def test_options_of_evaluate_that_contradict_are_one_sentence(
    models: list[Path], capsys: pytest.CaptureFixture[str]
) -> None:
    for words in (
        ['--put-aside', '--dataset', 'x.npz'],
        ['--presses', '0'],
        ['--presses', '9' * 20],
        ['--presses', '100', '--dataset', 'x.npz'],
        ['--seed', '0', '--put-aside'],
    ):
        assert main(['evaluate', str(models[0]), *words]) == 1
        (said,) = capsys.readouterr().err.splitlines()
        assert words[0] in said


def test_evaluate_compares_models_and_keeps_scores(
    models: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    kept = tmp_path / 'scores.json'
    words = ['evaluate', *map(str, models), '--presses', '24', '--json', str(kept)]
    assert main(words) == 0
    assert capsys.readouterr().out.count('all presses') >= 3  # side by side, and each alone
    assert [each['name'] for each in json.loads(kept.read_text(encoding='utf-8'))] == ['paper', 'fast']
