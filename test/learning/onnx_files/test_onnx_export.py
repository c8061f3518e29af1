"""Models as ONNX: the same answers as numpy's, frame by frame, and what the file says of itself."""

from __future__ import annotations

import functools
import itertools
import json
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip('onnx')
pytest.importorskip('onnxruntime')

import onnx
from onnx.reference import ReferenceEvaluator

from tactile_nodes import model_file
from tactile_nodes.cli.main import main
from tactile_nodes.errors import ModelError
from tactile_nodes.learning.onnx_files.check import OnnxSession, compare, real_samples
from tactile_nodes.learning.onnx_files.export import export_onnx, onnx_bytes
from tactile_nodes.model_file import LoadedModel, find_model, load_model, save_model
from tactile_nodes.sensing.explain.likeness import Likeness
from tactile_nodes.sensing.explain.measured.readout import ResponseReadout
from tactile_nodes.sensing.explain.measured.response import Response
from tactile_nodes.sensing.explain.model import FeatureLayout, ForceEstimator, ForceModel
from tactile_nodes.sensing.explain.network import CalibrationLayer, InputScaling, Mlp, NetworkReadout, TotalSpread
from tactile_nodes.sensing.explain.novelty_check import NoveltyCheck
from tactile_nodes.sensing.explain.reading import BEYOND_UNLIKENESS
from tactile_nodes.sensing.explain.splines import SplineAxis, value_and_slopes
from tactile_nodes.sensing.explain.uncertainty import Calibration
from tactile_nodes.sensing.features import Features
from tactile_nodes.sensing.geometry import BinGrid

LAYOUT = FeatureLayout('cartesian_mean', 4, 5, 2)
SHAPE = (4, 5, 2)
BINS = BinGrid(3, 4, 30.0, 40.0)
CARD = {
    'flow': {'name': 'dis', 'options': {}}, 'encoding': {'name': 'cartesian_mean', 'options': {}},
    'gel': {'id': 'g'}, 'crop_px': 440,
}  # fmt: skip


def scaling() -> InputScaling:
    random = np.random.default_rng(0)
    trusted = np.ones((4, 5), np.float32)
    trusted[0, :2] = 0
    return InputScaling(random.normal(size=SHAPE).astype(np.float32), np.full(SHAPE, 2, np.float32), trusted, 0.4)


def network(hidden: str = 'logistic') -> LoadedModel:
    random = np.random.default_rng(1)
    weights = tuple(random.normal(size=shape).astype(np.float32) for shape in ((7, 40), (6, 7), (12, 6)))
    biases = tuple(random.normal(size=len(each)).astype(np.float32) for each in weights)
    directions = np.ascontiguousarray(np.linalg.qr(random.normal(size=(40, 3)))[0].T, np.float32)
    likeness = Likeness(random.normal(size=40).astype(np.float32), directions, 0.5, 0.25)
    readout = NetworkReadout(scaling(), Mlp(weights, biases, hidden), BINS, 0.1, TotalSpread(0.01, 0.2), likeness)
    return LoadedModel(ForceModel(LAYOUT, BINS, readout, 0.05, 'abc'), CARD)


def response(*, gain: float = 0.0, contacts: int = 1) -> LoadedModel:
    """Six smooth functions of x, y and s, which no other contact explains as well."""
    random = np.random.default_rng(2)
    directions = np.ascontiguousarray(np.linalg.qr(random.normal(size=(40, 6)))[0].T, np.float32)
    axes = SplineAxis(-10.0, 10.0, 5), SplineAxis(-12.0, 12.0, 6), SplineAxis(0.0, 1.2, 4)
    x, y, s = (np.linspace(-1, 1, axis.count) for axis in axes)
    x, y, s = np.meshgrid(x, y, s + 1, indexing='ij')
    table = np.stack([s * 90 * each for each in (x, y, np.ones_like(x), x * y, x * x, y * y)], axis=-1)
    made = Response(*axes, table.astype(np.float32), np.linspace(0.1, 3, 6, dtype=np.float32))
    calibration = Calibration(0.02, 0.004, (1.5, 2.0, 4.0), (1.2,), 3.0, gain)
    likeness = Likeness(np.zeros(40, np.float32), directions, 0.5, 0.25)
    whitening = np.asarray(np.diag(np.linspace(1, 2, 6)), np.float32)
    readout = ResponseReadout(scaling(), likeness, whitening, made, BINS, calibration, contacts)
    return LoadedModel(ForceModel(LAYOUT, BINS, readout, 0.05, 'abc'), CARD)


@functools.cache
def exported(make: Callable[[], LoadedModel]) -> bytes:
    """A model as it is made without options."""
    return onnx_bytes(make())


@pytest.mark.parametrize(
    ('make', 'part', 'value'),
    [
        (network, 'hidden', 'x'),
        (network, 'hidden', []),
        (network, 'output_scale_n', 'x'),
        (response, 'power', 0),
        (response, 'power', 0.6),
        (response, 'axes', [{'low': 0, 'high': 0, 'intervals': 3}] * 3),
        (response, 'axes', [{'low': 0, 'high': 1, 'intervals': 'x'}] * 3),
        (response, 'calibration', {'place_factors': 1}),
    ],
)
def test_a_card_with_odd_numbers_is_refused_in_a_sentence(
    make: Callable[[], LoadedModel], part: str, value: object, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    apart = model_file.readout_arrays

    def odd(readout: object) -> object:
        arrays, said = apart(readout)
        return arrays, {**said, part: value}

    monkeypatch.setattr(model_file, 'readout_arrays', odd)
    made = make()
    save_model(tmp_path / 'odd.safetensors', made.model, CARD)
    with pytest.raises(ModelError, match='has an invalid one'):
        load_model(tmp_path / 'odd.safetensors')


@pytest.mark.parametrize(
    ('model', 'said'),
    [
        ('field', r'solved frame by frame.*run it with tactile_nodes .*export fast'),
        ('portable', 'export a network or a measured response, such as fast'),
    ],
)
def test_a_model_that_is_no_graph_is_refused_with_what_to_use_instead(model: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(ModelError, match=said):
        export_onnx(load_model(find_model(model)), tmp_path / 'refused.onnx')
    assert not (tmp_path / 'refused.onnx').exists()


def test_numbers_that_overflow_are_refused_in_a_sentence(tmp_path: Path) -> None:
    made = response()
    readout = replace(made.model.readout, calibration=Calibration(force_floor_n=1e308))
    with pytest.raises(ModelError, match='holds what no gel has and cannot be exported'):
        export_onnx(replace(made, model=replace(made.model, readout=readout)), tmp_path / 'odd.onnx')
    assert not (tmp_path / 'odd.onnx').exists()


def shown(loaded: LoadedModel, count: int = 30, confidence: float = 1.0) -> list[Features]:
    """What contacts all over would show, with a little noise; for a network any numbers."""
    random, made = np.random.default_rng(3), []
    readout = loaded.model.readout
    for _ in range(count):
        inputs = random.normal(0, 0.5, 40)
        if isinstance(readout, ResponseReadout):
            at = random.uniform((-9, -11, 0.1), (9, 11, 1.1)).tolist()
            components = value_and_slopes(readout.response.axes, readout.response.coefficients, at)[0]
            inputs = inputs + np.linalg.solve(readout.whitening, components) @ readout.likeness.directions
        values = inputs.reshape(SHAPE) / readout.scaling.gain + readout.scaling.mean
        made.append(Features('cartesian_mean', values.astype(np.float32), np.full((4, 5), confidence, np.float32)))
    return made


def lose(frames: list[Features], *places: tuple[int, int]) -> list[Features]:
    """The same without confidence in some regions."""
    kept = np.ones((4, 5), np.float32)
    for place in places:
        kept[place] = 0
    return [replace(each, confidence=each.confidence * kept) for each in frames]


def layered() -> LoadedModel:
    """The network behind a calibration layer, which changes what it answers."""
    random, loaded = np.random.default_rng(5), network()
    layer = CalibrationLayer.of_change(
        random.normal(0, 0.1, (40, 40)).astype('f2'), random.normal(size=40).astype(np.float32)
    )
    made = replace(loaded, model=replace(loaded.model, readout=replace(loaded.model.readout, layer=layer)))
    assert np.abs(_bins(made, shown(loaded)) - _bins(loaded, shown(loaded))).max() > 0.01
    return made


@pytest.mark.parametrize('make', [network, lambda: network('relu'), layered], ids=['logistic', 'relu', 'layered'])
def test_a_network_answers_as_numpy_does(make: Callable[[], LoadedModel]) -> None:
    loaded = make()
    found = compare(loaded, onnx_bytes(loaded), shown(loaded))
    assert (found.bin_n, found.place_mm, found.force_n) == pytest.approx((0, 0, 0), abs=2e-5)
    assert max(found.sigma_share, found.unlikeness_share) < 1e-5


def _bins(loaded: LoadedModel, frames: list[Features]) -> np.ndarray:
    return np.stack([ForceEstimator(loaded.model).predict(each).normal_force_n for each in frames])


def novelty_checked(encoding: str) -> LoadedModel:
    """The network beside the response."""
    loaded, watching = network(), response().model.readout
    novelty_check = NoveltyCheck(watching, encoding)
    return replace(
        loaded, model=replace(loaded.model, readout=replace(loaded.model.readout, novelty_check=novelty_check))
    )


def seen_by_novelty_check(encoding: str) -> list[Features]:
    """Frames of single contacts as the encoding has them."""
    made = shown(response())
    if encoding != 'polar_mean':
        return made
    parts = [np.moveaxis(each.values, -1, 0) for each in made]
    polar = [np.stack([np.hypot(x, y), np.arctan2(y, x) % (2 * np.pi)], axis=-1) for x, y in parts]
    return [replace(each, values=values.astype(np.float32)) for each, values in zip(made, polar, strict=True)]


@pytest.mark.parametrize('encoding', ['cartesian_mean', 'polar_mean'])
def test_what_a_novelty_check_calls_unlike_is_so_in_the_graph(encoding: str) -> None:
    loaded, frames = novelty_checked(encoding), seen_by_novelty_check(encoding)
    found = compare(loaded, onnx_bytes(loaded), frames)
    checked = [ForceEstimator(loaded.model).predict(each).unlikeness for each in frames]
    without = [ForceEstimator(network().model).predict(each).unlikeness for each in frames]
    assert any(mine > alone for mine, alone in zip(checked, without, strict=True))
    assert found.unlikeness_share < 1e-3


def test_a_network_that_knows_no_uncertainty_does_not_make_one_up() -> None:
    loaded = network()
    bare = replace(loaded.model, readout=replace(loaded.model.readout, spread=TotalSpread(), likeness=None))
    found = OnnxSession(onnx_bytes(replace(loaded, model=bare))).answer(shown(loaded)[0].values, np.ones((4, 5), 'f4'))
    assert all(np.isnan(found[name]) for name in ('position_sigma', 'total_sigma', 'unlikeness'))


def test_a_response_answers_as_numpy_does() -> None:
    loaded = response()
    found = compare(loaded, exported(response), shown(loaded))
    assert found.place_mm < 0.005  # steps end at 0.002 mm
    assert max(found.bin_n, found.force_n) < 1e-3
    assert max(found.sigma_share, found.unlikeness_share) < 1e-3


def test_wide_contacts_and_those_near_two_ends_are_reported_as_in_numpy() -> None:
    loaded = response()
    readout = loaded.model.readout
    frames = []

    def value(*at: float) -> np.ndarray:
        return value_and_slopes(readout.response.axes, readout.response.coefficients, at)[0]

    # A quarter of the force in each corner of a square makes a contact wider. The training went hardly beyond an s of
    # 0.9, which alone is no matter, and never beyond 1.2: there the response goes on as from 1.1 to 1.2. At 8 mm half
    # of the last interval along x has begun, so that half of 0.9 is hard.
    narrow, wide = value(1, 2, 0.5), sum(value(1 + x, 2 + y, 0.5) for x in (-4, 4) for y in (-4, 4)) / 4
    hardest = 2 * value(-3, 4, 1.2) - value(-3, 4, 1.1)
    for components in (narrow, value(-8, 4, 0.4), value(-3, 4, 1.0), wide, value(-8, 4, 0.5), hardest):
        inputs = np.linalg.solve(readout.whitening, components) @ readout.likeness.directions
        values = inputs.reshape(SHAPE) / readout.scaling.gain + readout.scaling.mean
        frames.append(Features('cartesian_mean', values.astype(np.float32), np.ones((4, 5), np.float32)))
    readings = [ForceEstimator(loaded.model).predict(each) for each in frames]
    assert readings[0].unlikeness < 0.5
    assert max(each.unlikeness for each in readings[1:3]) < 1
    assert readings[3].total_sigma_n > 3 * readings[0].total_sigma_n
    assert [each.unlikeness for each in readings[4:]] == 2 * [BEYOND_UNLIKENESS]
    found = compare(loaded, exported(response), frames)
    assert max(found.bin_n, found.force_n, found.sigma_share, found.unlikeness_share) < 2e-3


def test_missing_regions_have_no_say_as_in_numpy() -> None:
    loaded = response()
    frames = lose(shown(loaded), (1, 1), (2, 3), (3, 4), (0, 0))
    whole = [ForceEstimator(loaded.model).predict(each).unlikeness for each in shown(loaded)]
    lost = [ForceEstimator(loaded.model).predict(each).unlikeness for each in frames]
    assert whole != lost
    found = compare(loaded, exported(response), frames)
    assert found.place_mm < 0.005
    assert max(found.bin_n, found.force_n, found.sigma_share, found.unlikeness_share) < 2e-3


@pytest.mark.parametrize(('regions', 'known'), [(3, True), (2, False)])
def test_fewer_inputs_than_components_give_nothing(regions: int, known: bool) -> None:
    """Six components need three regions of two channels."""
    loaded, confidence = response(), np.zeros((4, 5), np.float32)
    confidence[2, :regions] = 1
    values = shown(loaded)[0].values
    frame = Features('cartesian_mean', values, confidence)
    found = OnnxSession(exported(response)).answer(values, confidence)
    assert np.isfinite(found['contact']).all() == known
    assert compare(loaded, exported(response), [frame]).bin_n < 2e-3


def test_what_may_be_noise_is_no_force() -> None:
    loaded = response(gain=1e9)
    frame = shown(loaded)[0]
    found = OnnxSession(onnx_bytes(loaded)).answer(frame.values, frame.confidence)
    assert found['contact'][2] == 0
    assert found['normal_force'].max() == 0
    assert found['position_sigma'] == np.float32(9.2)


@pytest.mark.parametrize(('make', 'bad'), [(network, np.nan), (response, np.nan), (response, np.inf)])
def test_features_that_are_no_numbers_give_no_force(make: Callable[[], LoadedModel], bad: float) -> None:
    loaded = make()
    values = shown(loaded)[0].values.copy()
    values[2, 2, 0] = bad
    found = OnnxSession(exported(make)).answer(values, np.ones((4, 5), np.float32))
    assert not found['unlikeness'] <= 1
    assert not np.isfinite(found['contact']).all()


def test_the_share_of_regions_seen_is_reported() -> None:
    loaded = network()
    (frame,) = lose(shown(loaded, 1), (2, 2), (0, 0))  # the second is not trusted anyway
    found = OnnxSession(exported(network)).answer(frame.values, frame.confidence)
    assert found['seen'] == pytest.approx(17 / 18)


def test_frames_with_several_contacts_are_counted_and_flagged() -> None:
    loaded = response(contacts=2)
    frames = shown(loaded, 10)
    both = [replace(a, values=a.values + b.values) for a, b in itertools.pairwise(frames)]
    found = compare(loaded, onnx_bytes(loaded), both)
    assert found.several > 0
    assert found.several_flagged == found.several
    assert found.place_mm < 0.005


@pytest.mark.parametrize('make', [network, response])
def test_another_runtime_gives_the_same_answers(make: Callable[[], LoadedModel]) -> None:
    """The reference implementation of ONNX, in numpy: nothing leans on what onnxruntime alone does."""
    loaded = make()
    content = exported(make)
    reference, session = ReferenceEvaluator(onnx.load_from_string(content)), OnnxSession(content)
    for frame in [*shown(loaded, 3), *lose(shown(loaded, 3), (2, 2), (3, 1))]:
        values = reference.run(None, {'features': frame.values[None], 'confidence': frame.confidence})
        found = session.answer(frame.values, frame.confidence)
        for name, value in zip(reference.output_names, values, strict=True):
            np.testing.assert_allclose(found[name], value, rtol=1e-4, atol=1e-4)


def test_a_graph_transposes_nothing_that_older_runtimes_would_fuse_with_a_product() -> None:
    """onnxruntime 1.20 to 1.23 cannot load a graph with the transpose of a matrix of 64-bit numbers in a product."""
    graph = onnx.load_from_string(exported(response)).graph
    bodies = [graph, *(each.g for node in graph.node for each in node.attribute if each.HasField('g'))]
    operators = {node.op_type for body in bodies for node in body.node}
    assert {'MatMul', 'Gemm'} <= operators
    assert 'Transpose' not in operators


def test_the_file_holds_the_card(tmp_path: Path) -> None:
    size = export_onnx(response(), tmp_path / 'made' / 'x.onnx')
    assert size == (tmp_path / 'made' / 'x.onnx').stat().st_size
    properties = {each.key: each.value for each in onnx.load(tmp_path / 'made' / 'x.onnx').metadata_props}
    assert json.loads(properties['card']) == CARD
    assert (properties['model_id'], properties['contacts']) == ('abc', '1')


def test_equal_models_are_equal_files() -> None:
    assert onnx_bytes(response()) == exported(response)


def export(folder: Path, model: LoadedModel, output: str = 's.onnx', *words: str) -> int:
    """By the command, from a file."""
    save_model(folder / 'small.safetensors', model.model, CARD)
    return main(['model', 'export', str(folder / 'small.safetensors'), '-o', str(folder / output), *words])


def test_the_command_exports_a_model_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert export(tmp_path, response(contacts=3)) == 0
    out = capsys.readouterr().out
    assert 'response readout' in out
    assert 'reports one contact' in out
    assert (tmp_path / 's.onnx').read_bytes() == onnx_bytes(load_model(tmp_path / 'small.safetensors'))


def test_a_model_of_recorded_presses_has_no_frames_to_compare_it_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert export(tmp_path, response(), 's.onnx', '--check') == 1
    assert 'export it without --check' in capsys.readouterr().err


@pytest.mark.parametrize('seed', [1000, 1001, 1002])
def test_it_is_compared_on_frames_of_another_seed_than_that_of_its_training(
    seed: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path))
    loaded = load_model(find_model('fast'))
    of_seed = replace(loaded, card={**loaded.card, 'data': {**loaded.card['data'], 'seed': seed}})
    assert len(real_samples(of_seed, 2).presses) == 2


def test_a_place_that_cannot_be_written_is_one_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / 'file').touch()
    assert export(tmp_path, network(), 'file/s.onnx') == 1
    assert 'cannot write' in capsys.readouterr().err


def test_without_onnx_it_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, 'onnx', None)
    for name in [name for name in sys.modules if name.startswith('tactile_nodes.learning.onnx_')]:
        monkeypatch.delitem(sys.modules, name)
    assert export(tmp_path, network()) == 1
    assert "pip install 'tactile_nodes[onnx]'" in capsys.readouterr().err
