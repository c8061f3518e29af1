"""The bench of runtimes: every runtime answers, what is installed is weighed, and the page tells it."""

from __future__ import annotations

import importlib.metadata
import json
import os
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from coarse_model import SHAPE, config_of, random_network

from benchmarks import runtimes
from benchmarks.runtimes.ends import BEGIN
from benchmarks.runtimes.sizes import installed_size
from tactile_nodes.cli.main import main
from tactile_nodes.learning.onnx_files.export import onnx_bytes
from tactile_nodes.model_file import find_model, load_model
from tactile_nodes.sensing.features import Features

INSTALLED = find_spec('onnx') is not None and find_spec('onnxruntime') is not None
pytestmark = [
    pytest.mark.usefixtures('own_cache'),
    pytest.mark.skipif(not INSTALLED, reason='onnx or onnxruntime is not installed'),
]


@pytest.fixture(scope='module')
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp('models') / 'small.safetensors'
    return random_network(file, config_of(), hidden=(8,), size=0.1, seed=0)


@pytest.fixture(scope='module')
def written(model: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder that the command wrote, in its short form; without torch, which takes seconds to load."""
    folder = tmp_path_factory.mktemp('results')
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv('TACTILE_BUS', 'zeromq')  # as every command has it
        patch.setattr(runtimes, 'PACKAGES', ('numpy', 'onnxruntime'))
        environment = dict(os.environ)
        assert main(['bench', 'runtimes', str(model), '--quick', '-o', str(folder)]) == 0
        assert dict(os.environ) == environment
    return folder


def test_both_runtimes_take_turns_and_agree(written: Path) -> None:
    result = json.loads((written / 'runtimes.json').read_text(encoding='utf-8'))
    found = result['models']['small']
    assert list(found['runtimes']) == list(result['packages']) == ['numpy', 'onnxruntime']
    assert found['runtimes']['numpy']['ratio'] == {'median': 1.0, 'low': 1.0, 'high': 1.0}
    for each in found['runtimes'].values():
        assert each['answer_ms']['median'] > 0
        assert each['start_s'] > 0
    assert found['differences']['as they are']['samples'] == runtimes.QUICK.frames
    assert found['differences']['5 % lost']['bin_n'] < 1e-5


def test_the_models_that_are_measured_without_names_can_be_exported() -> None:
    for name in runtimes.EXPORTED:
        assert onnx_bytes(load_model(find_model(name)))


def test_the_page_has_a_row_for_each_runtime(written: Path) -> None:
    text = (written / 'runtimes.md').read_text(encoding='utf-8')
    assert '| small (network, 2337 numbers) |       numpy |' in text
    assert '| small (network, 2337 numbers) | onnxruntime |' in text


def test_torch_computes_the_same_forces(model: Path) -> None:
    pytest.importorskip('torch')
    random = np.random.default_rng(1)
    confidence = random.random(SHAPE[:2]).astype(np.float32)
    frame = Features('cartesian_mean', random.normal(size=SHAPE).astype(np.float32), confidence)
    answers = {name: BEGIN[name](model, model)(frame) for name in ('numpy', 'torch')}
    np.testing.assert_allclose(answers['torch'], answers['numpy'], atol=1e-5)


def test_models_of_one_name_are_refused(model: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['bench', 'runtimes', str(model), str(model), '--quick']) == 1
    assert 'the same file name' in capsys.readouterr().err


def test_a_package_weighs_what_its_files_do() -> None:
    found = installed_size('zmq') or installed_size('pyzmq')
    assert found is not None
    files = importlib.metadata.files('pyzmq') or []
    exact = sum(Path(str(each.locate())).stat().st_size for each in files if Path(str(each.locate())).is_file())
    assert found['alone_mb'] == pytest.approx(exact / 1e6)
    assert found['with_what_it_brings_mb'] == found['alone_mb']  # what it needs is needed anyway


def test_a_package_brings_what_only_it_needs() -> None:
    found = installed_size('onnxruntime')
    assert found is not None
    assert found['with_what_it_brings_mb'] > found['alone_mb']  # flatbuffers and protobuf


def test_what_is_not_installed_weighs_nothing() -> None:
    assert installed_size('a-package-that-nobody-has-installed') is None
