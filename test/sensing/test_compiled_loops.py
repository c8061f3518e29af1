"""Compiled loops answer as numpy does, to the last digits."""

from __future__ import annotations

import ast
import dataclasses
import importlib.util
import itertools
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import cv2
import numpy as np
import pytest
from responding import COMPONENTS, components, features, readout

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.model_file import find_model, load_model
from tactile_nodes.pipeline.loop_choice import choose
from tactile_nodes.sensing.compiling import NOTICE, PARTS, notice_of_compiling
from tactile_nodes.sensing.explain.axisymmetric.radial_smear import RadialSmear
from tactile_nodes.sensing.explain.axisymmetric.response import DISTANCES, AxisymmetricResponse
from tactile_nodes.sensing.explain.field.cone import inverse_root
from tactile_nodes.sensing.explain.field.solver import Field
from tactile_nodes.sensing.explain.field.sums import sums
from tactile_nodes.sensing.explain.model import ForceEstimator
from tactile_nodes.sensing.explain.reading import Reading
from tactile_nodes.sensing.features import Features
from tactile_nodes.sensing.flow.choice import make_flow
from tactile_nodes.sensing.flow.inverse_compositional import InverseCompositionalFlow
from tactile_nodes.sensing.flow.methods import DisplacementField
from tactile_nodes.sensing.picture.motion import MotionFit
from tactile_nodes.sensing.picture.quality import PictureFaults, picture_faults, sharpness
from tactile_nodes.sensing.picture.stillness import StillnessCheck, StillnessOptions

pytestmark = pytest.mark.timeout(400)  # the first use compiles
needs_numba = pytest.mark.skipif(importlib.util.find_spec('numba') is None, reason='numba is not installed')

T = TypeVar('T')


def both(answer: Callable[[bool], T]) -> tuple[T, T]:
    """By numpy, and compiled."""
    return answer(False), answer(True)


def moved(image: np.ndarray, dx: float, dy: float) -> np.ndarray:
    return cv2.warpAffine(image, np.array([[1, 0, dx], [0, 1, dy]]), image.shape[::-1], flags=cv2.INTER_CUBIC)


@needs_numba
@pytest.mark.parametrize('lost', [0, 3, 20])
@pytest.mark.parametrize(
    'contacts',
    [
        [(2.0, 1.0, 0.4)], [(-4.0, 3.0, 0.5), (5.0, -2.0, 0.7)], [(11.9, -3.0, 0.9)], [(11.9, 11.9, 0.05)], [],
        [(1.0, 0.0, 0.2), (3.0, 0.0, 0.2), (2.0, 1.0, 0.2)], [(2.0, 1.0, 0.8)], [(-10.5, -10.6, 0.4)],
        [(1.3, 0.0, 0.1), (2.7, 0.0, 0.1)], [(1.3, 0.0, 0.2), (2.7, 0.0, 0.2)],
    ],
)  # fmt: skip
def test_the_same_forces_are_read(contacts: list[tuple[float, float, float]], lost: int):
    reader = readout(growth=3.0)
    sure = np.ones((6, 6), np.float32)
    sure.reshape(-1)[np.random.default_rng(3).permutation(36)[:lost]] = 0.2
    noise = np.random.default_rng(1).normal(size=COMPONENTS).astype(np.float32)
    seen = features(reader, components(reader.response, *contacts) + noise)
    plain, compiled = both(lambda compiled: dataclasses.replace(reader, compiled=compiled).read(seen, sure))
    np.testing.assert_allclose(compiled.normal_force_n, plain.normal_force_n, atol=1e-5)
    np.testing.assert_allclose(numbers_of(compiled), numbers_of(plain), rtol=1e-3, atol=1e-5)


@needs_numba
@pytest.mark.parametrize('limit', [1e-9, 20.0, 1e9])
@pytest.mark.parametrize('shift', [(0.0, 0.0), (3.0, -2.0)])
@pytest.mark.parametrize('contacts', [[(2.0, 1.0, 0.4)], [(-4.0, 3.0, 0.5), (5.0, -2.0, 0.7)]])
def test_the_same_is_said_of_drags(
    contacts: list[tuple[float, float, float]], shift: tuple[float, float], limit: float
):
    """A shift of everything is a drag, or none, for both."""
    reader = dataclasses.replace(readout(growth=3.0), most_shift_gain=limit)
    noise = np.random.default_rng(1).normal(size=COMPONENTS).astype(np.float32)
    seen = features(reader, components(reader.response, *contacts) + noise) + np.array(shift, np.float32)
    sure = np.ones((6, 6), np.float32)
    plain, compiled = both(lambda compiled: dataclasses.replace(reader, compiled=compiled).read(seen, sure))
    np.testing.assert_allclose(numbers_of(compiled), numbers_of(plain), rtol=1e-3, atol=1e-5)


def numbers_of(reading: Reading) -> list[float]:
    """All its numbers in a row."""
    contacts = [number for each in reading.contacts for number in dataclasses.astuple(each) if number is not None]
    return [*contacts, reading.total_sigma_n, reading.unlikeness]


@needs_numba
@pytest.mark.parametrize(('value', 'lost'), [(np.nan, 0), (1.0, 30)])
def test_nothing_is_read_from_what_is_no_number_or_too_little(value: float, lost: int):
    reader = readout()
    sure = np.ones((6, 6), np.float32)
    sure.reshape(-1)[:lost] = 0.0
    seen = features(reader, components(reader.response, (2.0, 1.0, 0.4)))
    seen[5, 5, 0] = value
    plain, compiled = both(lambda compiled: dataclasses.replace(reader, compiled=compiled).read(seen, sure))
    assert np.isnan(numbers_of(compiled)).all()
    np.testing.assert_array_equal(numbers_of(compiled), numbers_of(plain))


@needs_numba
@pytest.mark.parametrize('shift', [(0.02, -0.01), (1.5, -0.8), (-6.3, 4.4)])
@pytest.mark.parametrize('options', [{}, {'rows': 20, 'cols': 20, 'finest_scale': 1}])
def test_the_same_motion_is_seen(speckle: np.ndarray, shift: tuple[float, float], options: dict[str, object]):
    image = moved(speckle, *shift)

    def seen(compiled: bool) -> DisplacementField:
        flow = make_flow('inverse_compositional', options, compiled=compiled)
        flow.set_reference(speckle)
        return flow.displacement(image)

    plain, compiled = both(seen)
    assert plain.confidence is not None
    sure = plain.confidence > 0.5
    np.testing.assert_allclose(compiled.displacement_px[sure], plain.displacement_px[sure], atol=2e-3)
    np.testing.assert_allclose(compiled.confidence, plain.confidence, atol=2e-2)


@needs_numba
def test_one_who_computes_compiled_changes_no_bit_of_one_who_does_not(speckle: np.ndarray):
    image = moved(speckle, 0.4, -0.3)
    flows = both(lambda compiled: InverseCompositionalFlow(compiled=compiled))
    for flow in flows:
        flow.set_reference(speckle)
    first, compiled, second = (flow.displacement(image).displacement_px for flow in (*flows, flows[0]))
    np.testing.assert_array_equal(second, first)
    assert (compiled != first).any()


@needs_numba
@pytest.mark.parametrize('about_none', [True, False])
def test_the_same_common_motion_is_found(about_none: bool):
    fits = [MotionFit((440, 400), 10, 10, compiled=compiled) for compiled in (False, True)]
    random = np.random.default_rng(6)
    true = np.array([0.8, -0.3, 0.05, 0.02, 0.01, -0.02, 0.03, 0.01])
    motion = fits[0].carried(true) + random.normal(scale=0.01, size=(100, 2))
    motion[20:45] += random.normal(scale=1.0, size=(25, 2))  # pressed
    weight = (np.arange(100) % 9 > 0).astype(float)
    plain, compiled = (fit.common(motion, weight, rounds=3, about_none=about_none) for fit in fits)
    np.testing.assert_allclose(compiled, plain, rtol=1e-9, atol=1e-12)


@needs_numba
@pytest.mark.parametrize('shape', [(0, 440), (440, 0)])
def test_a_picture_without_pixels_is_dark(shape: tuple[int, int]):
    for faults in both(lambda compiled: picture_faults(np.zeros(shape, np.uint8), compiled=compiled)):
        assert faults == PictureFaults(0.0, True, False)


@needs_numba
@pytest.mark.parametrize('shape', [(240, 240), (101, 203)])
@pytest.mark.parametrize('light', [1.0, 3.0, 0.01])
def test_the_same_is_said_of_a_picture(speckle: np.ndarray, shape: tuple[int, int], light: float):
    picture = np.clip(light * np.resize(speckle, shape).astype(float), 0, 255).astype(np.uint8)
    plain, compiled = both(lambda compiled: picture_faults(picture, compiled=compiled))
    assert compiled == plain
    plain_sharpness, compiled_sharpness = both(lambda compiled: sharpness(picture, compiled=compiled))
    assert compiled_sharpness == pytest.approx(plain_sharpness, rel=1e-12)


def stillness_beside(speckle: np.ndarray, **options: int) -> tuple[StillnessCheck, StillnessCheck]:
    checks = both(lambda compiled: StillnessCheck(StillnessOptions(**options), compiled=compiled))
    for check in checks:
        check.set_reference(speckle)
    return checks


@needs_numba
def test_the_same_pictures_are_still(speckle: np.ndarray):
    checks = stillness_beside(speckle, full_every=1000)
    noise = np.random.default_rng(8).normal(size=speckle.shape)
    verdicts = set()
    for grey, shift in itertools.product((0.0, 1.0, 2.0), (0.0, 0.02, 0.3)):
        picture = np.clip(np.rint(moved(speckle, shift, 0.0) + grey * noise), 0, 255).astype(np.uint8)
        plain, compiled = (check(picture) for check in checks)
        assert compiled == plain
        verdicts.add(plain)
    assert verdicts == {True, False}


@needs_numba
def test_the_same_is_seen_at_rest_and_under_a_touch(speckle: np.ndarray):
    checks = stillness_beside(speckle)
    noise = np.random.default_rng(9).normal(size=speckle.shape)
    for light, shift in itertools.product((1.0, 0.9), (0.0, 0.05, 1.0)):
        picture = np.clip(np.rint(light * moved(speckle, shift, 0.0) + noise), 0, 255).astype(np.uint8)
        plain, compiled = (check.look(picture) for check in checks)
        np.testing.assert_allclose(dataclasses.astuple(compiled), dataclasses.astuple(plain), rtol=1e-3)


@needs_numba
@pytest.mark.parametrize('lateral', [1, 2])
def test_the_same_motion_is_expected_around_a_press(lateral: int):
    random = np.random.default_rng(2)
    profiles = random.normal(size=(3, DISTANCES.count, 9))
    columns = 2 * lateral + len(profiles) - lateral
    gel = AxisymmetricResponse(
        profiles, lateral, 1.2, random.uniform(-14, 14, (50, 2)), random.normal(size=(50, 2, columns)), 1.1, 0.8,
        RadialSmear(-0.4, 0.1),
    )  # fmt: skip
    contacts = np.array([(0.0, 0.0, 0.0), (3.0, -11.0, 0.7), (*gel.places[4], 1.4), (-9.0, 2.0, 1.5)])
    plain, compiled = both(
        lambda compiled: dataclasses.replace(gel, compiled=compiled).motion_slopes_and_columns(contacts)
    )
    for one, other in zip(plain, compiled, strict=True):
        np.testing.assert_allclose(other, one, rtol=1e-9, atol=1e-9)


@needs_numba
def test_compiling_is_reported_in_one_line_and_loading_is_not(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    from numba import config, njit

    monkeypatch.setattr(config, 'CACHE_DIR', str(tmp_path))
    for notices_expected in (1, 0):
        notices: list[str] = []
        with notice_of_compiling(notices.append):
            njit('i8(i8)', cache=True)(one_more)
            njit('i8(i8)', cache=True)(one_less)
        assert notices == notices_expected * [NOTICE]


def one_more(number):
    return number + 1


def one_less(number):
    return number - 1


def test_the_parts_that_are_compiled_ahead_are_those_that_loops_come_from():
    source = Path(importlib.util.find_spec('tactile_nodes.sensing.loops.every').origin).read_text()
    imported = {node.module.rpartition('.')[2] for node in ast.parse(source).body if isinstance(node, ast.ImportFrom)}
    assert imported == set(PARTS)


@needs_numba
def test_the_same_is_not_known_of_regions():
    random = np.random.default_rng(2)
    profiles, couplings = random.normal(size=(3, DISTANCES.count, 9)), random.normal(size=(50, 2, 5))
    gel = AxisymmetricResponse(
        profiles, 2, 1.2, random.uniform(-14, 14, (50, 2)), couplings, unsure=random.normal(size=(50, 2, 7, 3))
    )
    _, slopes, columns = gel.motion_slopes_and_columns(np.array([(0.0, 0.0, 0.3), (3.0, -11.0, 0.7)]))
    plain, compiled = both(lambda compiled: dataclasses.replace(gel, compiled=compiled).variance(slopes, columns))
    np.testing.assert_allclose(compiled, plain, rtol=1e-9)


@needs_numba
@pytest.mark.parametrize('size', [1, 2, 3, 4, 7, 30, 101])
def test_the_same_root_makes_the_inverse(size: int):
    """Rows go in fours and pairs; whatever is left over goes by itself."""
    from tactile_nodes.sensing.loops.common import inverse_root as by_loops

    made = np.random.default_rng(size).normal(size=(size, size + 40)).astype(np.float32)
    matrix, root = made @ made.T, np.zeros((size, size), np.float32)
    assert by_loops(matrix.copy(), root)
    wanted = inverse_root(matrix)
    np.testing.assert_allclose(root, wanted, atol=1e-4 * np.abs(wanted).max())
    matrix[-1, -1] = -1.0
    assert not by_loops(matrix, np.zeros((size, size), np.float32))


@needs_numba
@pytest.mark.parametrize(
    ('pressed_n', 'passes'), [(1.5, 1), (0.02, 1), (0.0, 1), (-0.3, 1), (1.5, 3), (0.02, 3), (0.0, 3)]
)
def test_the_same_field_explains_a_motion(pressed_n: float, passes: int):
    """One that is dragged over eight patches, light, none, and suction, which the linear answer sees nowhere.

    Suction in three passes is no case of it: that ends on nearly all patches, and rounding decides by which the total
    is spread, to some per cent of it and otherwise on each processor.
    """
    solver = dataclasses.replace(load_model(find_model('field')).model.readout.solver, passes=passes)
    on, forces = np.arange(8) + 150 + 14 * (np.arange(8) // 4), np.zeros((3, solver.patches.count))
    forces[0, on], forces[1, on] = pressed_n / 8, pressed_n / 40
    noise = np.random.default_rng(2).normal(scale=solver.noise_px, size=len(solver.response))
    motion = (solver.response @ forces.reshape(-1) + noise).reshape(-1, 2)
    weights = solver.weights(motion, np.linspace(0.2, 1.0, len(motion)))
    plain, compiled = both(lambda compiled: dataclasses.replace(solver, compiled=compiled).field(motion, weights))
    np.testing.assert_array_equal(compiled.active, plain.active)
    np.testing.assert_allclose(compiled.forces_n, plain.forces_n, atol=2e-4)
    np.testing.assert_allclose(compiled.root.T @ compiled.root, plain.root.T @ plain.root, rtol=1e-2, atol=3e-4)
    assert (compiled.misfit, compiled.gain) == pytest.approx((plain.misfit, plain.gain), rel=1e-3, abs=1e-3)


@needs_numba
@pytest.mark.parametrize('lost', [0.0, 0.3, 0.98])
@pytest.mark.parametrize('moved_px', [0.0, 0.4, np.nan])
def test_regions_count_as_much(moved_px: float, lost: float):
    """Of a frame of which nothing, some or nearly all is lost, and whose motion is noise, or noise and a slope."""
    readout, random = load_model(find_model('field')).model.readout, np.random.default_rng(6)
    values = random.normal(scale=0.02, size=readout.scaling.mean.shape).astype(np.float32)
    values[..., 0] += moved_px * np.linspace(0.0, 1.0, values.shape[1], dtype=np.float32)
    confidence = np.where(random.random(values.shape[:2]) < lost, 0.0, random.uniform(0.2, 1.0, values.shape[:2]))
    plain, compiled = both(
        lambda compiled: dataclasses.replace(readout, compiled=compiled).observed(values, confidence.astype(np.float32))
    )
    assert (plain is None) == (compiled is None) == bool(np.isnan(moved_px) or lost > 0.9)
    if plain is None or compiled is None:
        return
    assert compiled[0] == pytest.approx(plain[0], rel=1e-5)
    np.testing.assert_array_equal(compiled[1], plain[1])
    np.testing.assert_allclose(compiled[2].single, plain[2].single, rtol=1e-4)
    np.testing.assert_allclose(compiled[2].shared, plain[2].shared, rtol=1e-3, atol=1e-3 * plain[2].shared.max())


@needs_numba
@pytest.mark.parametrize('contacts', [0, 1, 2, 3])
def test_the_same_is_reported_of_a_field(contacts: int):
    """2x3, 2x4 and 2x5 patches, one of them in the corner, each with a force of its own."""
    readout = load_model(find_model('field')).model.readout
    patches, random = readout.solver.patches, np.random.default_rng(5)
    pressed = np.zeros((3, *patches.shape))
    for number, (row, col) in enumerate([(3, 4), (16, 14), (9, 9)][:contacts]):
        pressed[0, row : row + 2, col : col + 3 + number] = random.uniform(0.05, 0.1, (2, 3 + number))
        pressed[1:, row : row + 2, col : col + 3 + number] = random.uniform(-0.04, 0.05, (2, 2, 3 + number))
    active = np.flatnonzero(pressed[0])
    root = np.tril(random.normal(scale=0.01, size=2 * (3 * active.size,))).astype(np.float32)
    found = Field(pressed.reshape(3, -1), active, root, 1.0, 10.0)
    plain, compiled = both(lambda compiled: sums(found, readout.surface, patches, compiled=compiled))
    for name in ('bins_n', 'bins_off_n', 'wrench', 'wrench_covariance'):
        np.testing.assert_allclose(getattr(compiled, name), getattr(plain, name), rtol=1e-5, atol=1e-6, err_msg=name)
    np.testing.assert_allclose(compiled.field.forces_n, plain.field.forces_n, atol=1e-9)
    strongest = [each.contacts[np.argsort(-each.contacts[:, 2])] for each in (plain, compiled)]
    assert len(strongest[0]) == contacts
    np.testing.assert_allclose(strongest[1], strongest[0], rtol=1e-4, atol=1e-6)


@needs_numba
@pytest.mark.parametrize('name', ['fast', 'portable', 'field', 'paper'])
def test_every_part_of_a_model_computes_as_its_estimator_was_configured(name: str):
    loaded = load_model(find_model(name))
    model, layout = loaded.model, loaded.model.layout
    noise = np.random.default_rng(4).normal(scale=0.02, size=(layout.rows, layout.cols, layout.channels))
    seen = Features(layout.encoding, noise.astype(np.float32), np.ones(noise.shape[:2], np.float32))
    plain, compiled = both(lambda compiled: ForceEstimator(model, compiled=compiled).predict(seen))
    np.testing.assert_allclose(compiled.normal_force_n, plain.normal_force_n, atol=1e-3)
    assert compiled_flags(ForceEstimator(model, compiled=True).model) == {True}
    assert compiled_flags(ForceEstimator(model).model) == {False}


def compiled_flags(part: object) -> set[bool]:
    """The settings `compiled` of all parts of a model that have compiled loops."""
    values = [getattr(part, each.name) for each in dataclasses.fields(part)]
    own = {part.compiled} if hasattr(part, 'compiled') else set()
    return own.union(*(compiled_flags(each) for each in values if dataclasses.is_dataclass(each)))


WITHOUT_NUMBA = """
import sys
sys.modules['numba'] = None  # as if it were not installed: to import it fails
from tactile_nodes.pipeline.loop_choice import choose
print(choose({setting}, print, print))
"""


def chosen_without_numba(setting: bool | None) -> subprocess.CompletedProcess[str]:
    code = WITHOUT_NUMBA.format(setting=setting)
    return subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=False)


def test_without_numba_who_asks_for_compiled_loops_is_told_what_to_do():
    ended = chosen_without_numba(True)
    assert ended.returncode
    assert 'ConfigurationError: numba cannot compile the inner loops here' in ended.stderr
    assert 'pip install numba, or set the parameter compiled to false' in ended.stderr


def test_where_numba_may_store_nothing_it_is_said_what_to_set(monkeypatch: pytest.MonkeyPatch):
    def refuse(_: str):
        raise RuntimeError("cannot cache function 'field': no locator available for file 'field.py'")

    monkeypatch.setattr('tactile_nodes.sensing.compiling.importlib.import_module', refuse)
    with pytest.raises(ConfigurationError, match='set NUMBA_CACHE_DIR to a folder that you own, or set the parameter'):
        choose(True, print, print)


def test_without_numba_others_are_warned_once_and_get_numpy():
    warning, answer = chosen_without_numba(None).stdout.splitlines()
    assert warning.startswith('computing with NumPy')
    assert answer == 'False'


@needs_numba
def test_who_asks_for_numpy_gets_it_without_a_word(capsys: pytest.CaptureFixture[str]):
    assert not choose(False, print, print)
    assert not capsys.readouterr().out


@needs_numba
def test_what_was_compiled_before_the_newest_source_is_forgotten(tmp_path: Path):
    """numba would load it, though a function of another file that is compiled into it has changed."""
    from tactile_nodes.sensing.loops.common import forget_older

    (tmp_path / '__pycache__').mkdir()
    source, older, newer = (tmp_path / name for name in ('a.py', '__pycache__/a.nbi', '__pycache__/b.nbi'))
    for number, file in enumerate((older, source, newer)):
        file.touch()
        os.utime(file, (number, number))
    forget_older(tmp_path)
    assert (older.exists(), newer.exists()) == (False, True)
