from __future__ import annotations

import errno
import hashlib
import json
import math
import pickle
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import safetensors.numpy
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_nodes.errors import ConfigurationError, ModelError
from tactile_nodes.model_file import FORMAT, NO_CHECKSUM, find_model, load_model, save_model
from tactile_nodes.sensing.explain.likeness import Likeness
from tactile_nodes.sensing.explain.measured.readout import ResponseReadout
from tactile_nodes.sensing.explain.measured.response import Response
from tactile_nodes.sensing.explain.model import FeatureLayout, ForceEstimator, ForceModel
from tactile_nodes.sensing.explain.network import CalibrationLayer, InputScaling, Mlp, NetworkReadout, TotalSpread
from tactile_nodes.sensing.explain.novelty_check import NoveltyCheck
from tactile_nodes.sensing.explain.splines import SplineAxis
from tactile_nodes.sensing.explain.uncertainty import Calibration
from tactile_nodes.sensing.features import Features
from tactile_nodes.sensing.geometry import BinGrid

CARD = {
    'flow': {'name': 'dis', 'options': {'preset': 'ultrafast'}},
    'encoding': {'name': 'cartesian_mean', 'options': {'rows': 2, 'cols': 2}},
    'crop_px': 440,
    'gel': {'id': 'gel-7'},
    'command': 'tactile train small.yaml',
}


def small_model() -> ForceModel:
    random = np.random.default_rng(0)
    shape = (2, 2, 2)
    sizes = (8, 5, 9)
    # Multiples of 1/64 are exact as 16 bit floats.
    weights = tuple(
        random.integers(-64, 64, pair).astype(np.float32) / 64 for pair in zip(sizes[1:], sizes[:-1], strict=True)
    )
    biases = tuple(random.normal(size=n).astype(np.float32) for n in sizes[1:])
    scaling = InputScaling(
        random.normal(size=shape).astype(np.float32), np.full(shape, 2, np.float32), np.ones((2, 2), np.float32), 0.4
    )
    layout = FeatureLayout('cartesian_mean', 2, 2, 2)
    bins = BinGrid(3, 3, 30.0, 30.0)
    directions = np.ascontiguousarray(np.linalg.qr(random.normal(size=(8, 3)))[0].T, np.float32)
    likeness = Likeness(np.ones(8, np.float32), directions, 0.5, 0.25)
    network = Mlp(weights, biases, 'relu')
    return ForceModel(layout, bins, NetworkReadout(scaling, network, bins, 0.1, TotalSpread(0.01, 0.2), likeness), 0.02)


def small_response() -> ForceModel:
    """Three components that follow x, y and s; made of numbers that mean nothing, but work."""
    random = np.random.default_rng(2)
    bins, made = BinGrid(3, 3, 30.0, 30.0), small_model().readout
    axes = SplineAxis(-10.0, 10.0, 3), SplineAxis(-10.0, 10.0, 3), SplineAxis(0.0, 1.0, 2)
    table = random.normal(size=(6, 6, 5, 3)).astype(np.float32)
    response = Response(*axes, table, np.array([0.1, 0.2, 0.3], np.float32))
    readout = ResponseReadout(
        made.scaling, made.likeness, np.eye(3, dtype=np.float32), response, bins,
        Calibration(0.1, 0.01, (2.0, 3.0), (1.0, 2.0, 4.0), 4.0, 0.5), 2,
    )  # fmt: skip
    return ForceModel(FeatureLayout('cartesian_mean', 2, 2, 2), bins, readout, 0.03)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / 'small.safetensors'
    save_model(path, small_model(), CARD)
    return path


@pytest.fixture(scope='module')
def saved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp('model') / 'small.safetensors'
    save_model(path, small_model(), CARD)
    return path


@pytest.fixture
def content(saved: Path) -> bytes:
    return saved.read_bytes()


def layered_model() -> ForceModel:
    """The small network behind a calibration layer."""
    random, model = np.random.default_rng(3), small_model()
    change = (0.01 * random.normal(size=(8, 8))).astype(np.float16)
    layer = CalibrationLayer.of_change(change, random.normal(size=8).astype(np.float32))
    return replace(model, readout=replace(model.readout, layer=layer))


def checked_model() -> ForceModel:
    """The small network with the small response as its novelty check."""
    model, response = small_model(), small_response().readout
    assert isinstance(response, ResponseReadout)
    novelty_check = NoveltyCheck(replace(response, most_contacts=1), 'cartesian_mean')
    return replace(model, readout=replace(model.readout, novelty_check=novelty_check))


def watchful_response() -> ForceModel:
    """The small response, which takes any press for one that drags."""
    model = small_response()
    assert isinstance(model.readout, ResponseReadout)
    return replace(model, readout=replace(model.readout, most_shift_gain=1e-9))


@pytest.mark.parametrize('make', [small_model, layered_model, small_response, checked_model, watchful_response])
def test_a_model_comes_back_with_the_same_predictions(tmp_path: Path, make: Callable[[], ForceModel]):
    file = tmp_path / 'model.safetensors'
    save_model(file, make(), CARD)
    random = np.random.default_rng(1)
    features = Features('cartesian_mean', random.normal(size=(2, 2, 2)).astype(np.float32), np.ones((2, 2), np.float32))
    before = ForceEstimator(make()).predict(features)
    after = ForceEstimator(load_model(file).model).predict(features)
    np.testing.assert_array_equal(after.normal_force_n, before.normal_force_n)
    assert repr(after.contacts) == repr(before.contacts)  # some numbers are NaN
    assert (after.total_sigma_n, after.unlikeness) == (before.total_sigma_n, before.unlikeness)


def test_a_file_of_an_earlier_release_that_holds_what_drags_add_still_tells_them(tmp_path: Path):
    """It reported them from 9.5 on; the array itself is left unread."""
    file = tmp_path / 'earlier.safetensors'
    save_model(file, small_response(), CARD)
    limits = {'axes': [], 'least_gain': 9.5, 'most_mm': 1.0, 'doubt_n': 0.01}
    added = {'drag': np.zeros((4, 4, 4, 5, 3), np.float16)}
    file.write_bytes(_with_card(file.read_bytes(), lambda card: card['readout'].update(drag=limits), added))
    readout = load_model(file).model.readout
    assert isinstance(readout, ResponseReadout)
    assert readout.most_shift_gain == 9.5


def test_what_an_earlier_release_knew_of_blur_and_texture_is_left_unread(tmp_path: Path):
    file = tmp_path / 'earlier.safetensors'
    save_model(file, small_response(), CARD)
    added = {'blur0.change': np.zeros((4, 4), np.float16), 'texture_gains': np.zeros((2, 2), np.int8),
             'finer_model': np.zeros(9, np.uint8)}  # fmt: skip
    file.write_bytes(_with_card(file.read_bytes(), lambda card: card['readout'].update(blurs={'levels': [{}]}), added))
    assert load_model(file).model.readout.parameter_count == small_response().readout.parameter_count


def test_a_novelty_check_comes_back_with_all_that_it_says(tmp_path: Path):
    file, made = tmp_path / 'novelty_checked.safetensors', checked_model().readout.novelty_check
    save_model(file, checked_model(), CARD)
    found = load_model(file).model.readout.novelty_check
    assert found.encoding == 'cartesian_mean'
    random = np.random.default_rng(1)
    seen = random.normal(size=(2, 2, 2)).astype(np.float32), np.ones((2, 2), np.float32)
    assert found.read(*seen).contacts == made.read(*seen).contacts
    assert found.read(*seen).unlikeness == made.read(*seen).unlikeness


def test_a_network_without_a_novelty_check_is_the_file_that_it_always_was(file: Path):
    """Models that were trained before networks had one are read on."""
    assert load_model(file).model.readout.novelty_check is None
    assert 'witness' not in load_model(file).card['readout']


def test_a_layer_has_a_version_that_earlier_releases_refuse(file: Path, tmp_path: Path):
    save_model(tmp_path / 'layered.safetensors', layered_model(), CARD)
    assert load_model(file).card['format_version'] == 2
    assert load_model(tmp_path / 'layered.safetensors').card['format_version'] == 3


def test_a_response_with_radial_smear_has_a_version_that_earlier_releases_refuse(tmp_path: Path):
    """They would read it as if there were none. Files of version 4, written before it, are still read."""
    shipped = load_model(find_model('portable'))
    save_model(tmp_path / 'again.safetensors', shipped.model, shipped.card)
    assert load_model(tmp_path / 'again.safetensors').card['format_version'] == 5
    old = (tmp_path / 'again.safetensors').read_bytes().replace(b'format_version\\": 5', b'format_version\\": 4')
    entry = json.loads(json.loads(old[8 : 8 + int.from_bytes(old[:8], 'little')])['__metadata__'][FORMAT])
    blank = old.replace(entry['sha256'].encode(), NO_CHECKSUM.encode(), 1)
    (tmp_path / 'old.safetensors').write_bytes(
        blank.replace(NO_CHECKSUM.encode(), hashlib.sha256(blank).hexdigest().encode(), 1)
    )
    assert load_model(tmp_path / 'old.safetensors').card['format_version'] == 4


def test_a_network_that_knows_no_uncertainty_comes_back_not_knowing(tmp_path: Path):
    model = small_model()
    bare = replace(model, readout=replace(model.readout, spread=TotalSpread(), likeness=None))
    save_model(tmp_path / 'bare.safetensors', bare, CARD)
    features = Features('cartesian_mean', np.zeros((2, 2, 2), np.float32), np.ones((2, 2), np.float32))
    found = ForceEstimator(load_model(tmp_path / 'bare.safetensors').model).predict(features)
    assert math.isnan(found.total_sigma_n)
    assert math.isnan(found.unlikeness)


def test_a_model_comes_back_with_all_that_its_numbers_mean(file: Path):
    loaded, made = load_model(file), small_model()
    assert (loaded.model.layout, loaded.model.bins) == (made.layout, made.bins)
    assert loaded.model.readout.scaling.confidence_floor == 0.4
    assert (loaded.model.readout.output_scale_n, loaded.model.contact_threshold_n) == (0.1, 0.02)
    assert loaded.flow == ('dis', {'preset': 'ultrafast'})
    assert loaded.encoding == ('cartesian_mean', {'rows': 2, 'cols': 2})
    assert loaded.card['units']['normal_force'].startswith('N')


def test_the_id_is_the_same_at_saving_and_at_loading(tmp_path: Path):
    saved = save_model(tmp_path / 'model.safetensors', small_model(), CARD)
    assert load_model(tmp_path / 'model.safetensors').model_id == saved
    assert len(saved) == 12


def test_another_card_makes_another_id(tmp_path: Path):
    ids = {save_model(tmp_path / 'model.safetensors', small_model(), {**CARD, 'command': each}) for each in 'ab'}
    assert len(ids) == 2


def test_any_reader_of_safetensors_can_open_the_file(file: Path):
    assert safetensors.numpy.load_file(file)['layer0.weight'].shape == (5, 8)


def test_nothing_is_left_beside_the_file(file: Path):
    assert [each.name for each in file.parent.iterdir()] == ['small.safetensors']


@settings(max_examples=300, deadline=None)
@given(st.data())
def test_any_altered_byte_is_noticed(saved: Path, tmp_path_factory: pytest.TempPathFactory, data: st.DataObject):
    content = saved.read_bytes()
    place = data.draw(st.integers(0, len(content) - 1))
    flip = data.draw(st.integers(1, 255))
    path = tmp_path_factory.getbasetemp() / 'altered.safetensors'
    path.write_bytes(content[:place] + bytes([content[place] ^ flip]) + content[place + 1 :])
    with pytest.raises(ModelError):
        load_model(path)


@pytest.mark.parametrize('kept', [0, 4, 8, 100, -1])
def test_a_file_cut_short_is_noticed(content: bytes, tmp_path: Path, kept: int):
    (tmp_path / 'cut.safetensors').write_bytes(content[:kept])
    with pytest.raises(ModelError):
        load_model(tmp_path / 'cut.safetensors')


def test_a_damaged_weight_is_called_damage(content: bytes, tmp_path: Path):
    (tmp_path / 'bad.safetensors').write_bytes(content[:-3] + b'abc')
    with pytest.raises(ModelError, match=r'bad\.safetensors is damaged: .* download or train it again'):
        load_model(tmp_path / 'bad.safetensors')


@pytest.mark.parametrize('name', ['folder', 'x' * 300, 'none'])
def test_a_model_that_cannot_be_written_is_refused_in_a_sentence(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """A folder, a name too long, and a disk that is full: what is there stays, and nothing is left beside it."""
    (tmp_path / 'folder').mkdir()

    def full(*_: object) -> int:
        raise OSError(errno.ENOSPC, 'No space left on device')

    if name == 'none':
        monkeypatch.setattr(Path, 'write_bytes', full)
    with pytest.raises((ConfigurationError, ModelError), match='cannot write'):
        save_model(tmp_path / name, small_model(), CARD)
    assert [each.name for each in tmp_path.iterdir()] == ['folder']


def _with_card(content: bytes, change: Callable[[dict[str, Any]], None], arrays: dict[str, np.ndarray]) -> bytes:
    """The file that somebody writes who also knows how to make its checksum."""
    entry = json.loads(json.loads(content[8 : 8 + int.from_bytes(content[:8], 'little')])['__metadata__'][FORMAT])
    change(entry['card'])
    metadata = {FORMAT: json.dumps({'sha256': NO_CHECKSUM, 'card': entry['card']}, sort_keys=True)}
    blank = safetensors.numpy.save(safetensors.numpy.load(content) | arrays, metadata)
    return blank.replace(NO_CHECKSUM.encode(), hashlib.sha256(blank).hexdigest().encode(), 1)


@pytest.mark.parametrize(
    ('section', 'value'),
    [
        ('layout', {'encoding': 'cartesian_mean', 'rows': 3, 'cols': 2, 'channels': 2}),
        ('layout', []),
        ('bins', None),
        ('bins', {'rows': 'a'}),
        ('readout', {'kind': 'network'}),
        ('readout', 5),
        ('flow', None),
        ('flow', {'name': 'dis', 'options': 'x'}),
        ('encoding', 'cartesian_mean'),
        ('crop_px', 'wide'),
        ('gel', None),
        ('contact_threshold_n', None),
    ],
)
def test_a_card_that_cannot_be_is_refused_though_its_checksum_is_right(
    section: str, value: object, content: bytes, tmp_path: Path
):
    file = tmp_path / 'odd.safetensors'
    file.write_bytes(_with_card(content, lambda card: card.update({section: value}), {}))
    with pytest.raises(ModelError) as refused:
        load_model(file)
    assert '\n' not in str(refused.value)


@pytest.mark.parametrize('entry', ['flow', 'encoding', 'crop_px', 'gel'])
def test_a_card_without_what_every_use_of_the_model_reads_is_refused(entry: str, content: bytes, tmp_path: Path):
    file = tmp_path / 'odd.safetensors'
    file.write_bytes(_with_card(content, lambda card: card.pop(entry), {}))
    with pytest.raises(ModelError, match=f'lacks a part of the model.*{entry}'):
        load_model(file)


@pytest.mark.parametrize('number', [math.nan, math.inf])
def test_weights_that_are_no_numbers_are_refused(number: float, content: bytes, tmp_path: Path):
    file, weights = tmp_path / 'odd.safetensors', safetensors.numpy.load(content)['layer0.weight']
    weights[1, 2] = number
    file.write_bytes(_with_card(content, lambda _: None, {'layer0.weight': weights}))
    with pytest.raises(ModelError, match=r'layer0\.weight contains NaN or infinite numbers'):
        load_model(file)


@pytest.mark.parametrize(
    ('part', 'name', 'value'),
    [
        ('response', 'width', 0.0),
        ('response', 'width', 1e300),
        ('response', 'softness', -1.0),
        ('response', 'hardest_n', 0.0),
        ('correction', 'reach_mm', 1e6),
    ],
)
def test_numbers_that_no_gel_has_are_refused(part: str, name: str, value: float, tmp_path: Path):
    """A reading would divide by nothing, or begin with a table that no memory holds."""
    shipped = load_model(find_model('portable'))
    readout = shipped.model.readout
    absurd = replace(readout, **{part: replace(getattr(readout, part), **{name: value})})
    save_model(tmp_path / 'absurd.safetensors', replace(shipped.model, readout=absurd), shipped.card)
    with pytest.raises(ModelError, match=f'{name} is .*, but must be from'):
        load_model(tmp_path / 'absurd.safetensors')


def test_a_missing_file_says_how_to_make_one(tmp_path: Path):
    with pytest.raises(ModelError, match=r"there is no model file .* tactile train -o '.*/my gel.safetensors'"):
        load_model(tmp_path / 'my gel.safetensors')


def test_a_folder_is_no_model(tmp_path: Path):
    with pytest.raises(ModelError, match='cannot read'):
        load_model(tmp_path)


def test_somebody_elses_safetensors_are_refused(tmp_path: Path):
    safetensors.numpy.save_file({'x': np.zeros(3)}, tmp_path / 'other.safetensors')
    with pytest.raises(ModelError, match='not a model of tactile_nodes'):
        load_model(tmp_path / 'other.safetensors')


class Bomb:
    def __reduce__(self) -> tuple[object, tuple[str]]:
        return exec, ('raise SystemExit("it ran")',)


def test_a_pickle_is_refused_without_being_run(tmp_path: Path):
    (tmp_path / 'bomb.pt').write_bytes(pickle.dumps(Bomb()))
    with pytest.raises(ModelError, match='may run code when loaded'):
        load_model(tmp_path / 'bomb.pt')


def test_a_newer_format_says_to_update(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr('tactile_nodes.model_file.FORMAT_VERSION', 9)
    save_model(tmp_path / 'new.safetensors', small_model(), CARD)
    monkeypatch.undo()
    with pytest.raises(ModelError, match=r'format version 9, but this release reads versions 2 .*; update'):
        load_model(tmp_path / 'new.safetensors')


def test_the_card_is_plain_json(file: Path):
    json.dumps(dict(load_model(file).card))


def test_a_model_file_holds_the_rest_image_of_its_calibration_and_one_without_is_read(tmp_path: Path) -> None:
    picture = np.random.default_rng(1).integers(0, 255, (6, 8), np.uint8)
    save_model(tmp_path / 'with.safetensors', small_response(), CARD, picture)
    save_model(tmp_path / 'without.safetensors', small_response(), CARD)
    np.testing.assert_array_equal(load_model(tmp_path / 'with.safetensors').rest_image, picture)
    assert load_model(tmp_path / 'without.safetensors').rest_image.size == 0
