"""A sensor of another size, shape and camera: from its description to force, without any press."""

from __future__ import annotations

import dataclasses
import importlib.util
from contextlib import closing
from pathlib import Path

import cv2
import numpy as np
import pytest
from coarse_table import linear_table
from described_chain import DescribedChain, model_of, sensor_of
from press_bags import Collection
from press_bags import Sensor as BagSensor

from tactile_nodes.contact_tables.gel_tables import contact_table
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.learning.calibrating.calibrator import Calibrator, StopRule
from tactile_nodes.learning.calibrating.files import Source, calibrate
from tactile_nodes.learning.calibrating.hand_presses import presses_by_hand
from tactile_nodes.learning.calibrating.presses import BagPresses, finish, take_presses
from tactile_nodes.learning.field.calibration import described_model
from tactile_nodes.learning.field.fit import described
from tactile_nodes.learning.imported.arrays import import_arrays, options_of
from tactile_nodes.learning.progress import Progress
from tactile_nodes.learning.training.source import require_same_features
from tactile_nodes.model_file import LoadedModel, find_model, load_model, save_model
from tactile_nodes.pipeline.estimating import Estimating
from tactile_nodes.pipeline.judge_force import FORCE, judged
from tactile_nodes.sensing.elasticity.region_choice import usual_regions
from tactile_nodes.sensing.explain.field.readout import FieldReadout
from tactile_nodes.sensing.explain.field.spread import FieldSpread
from tactile_nodes.sensing.explain.model import ForceEstimator, ForceMap
from tactile_nodes.sensing.explain.network import InputScaling
from tactile_nodes.sensing.features import make_encoding
from tactile_nodes.sensing.flow.choice import make_flow
from tactile_nodes.sensing.geometry import BinGrid
from tactile_nodes.sensors import BinSettings, GelDescription, ImageSettings, MaskSettings, Sensor, load_sensor
from tactile_nodes.simulation.described import gel_of
from tactile_nodes.simulation.optics import Optics, Press, Shaping

SMALL = sensor_of(
    'small', ImageSettings(320, 240, 320, 200), GelDescription(18.0, 12.0, (4.0,), (0.1,), (0.5,), (0.3, 0.8), 0.0),
    4000, BinSettings(4, 6),
)  # fmt: skip
"""3 mm a bin, 20 px a millimetre: 16x10 mm are seen."""
MASKED = dataclasses.replace(SMALL, mask=MaskSettings(('0,0 79,0 79,239 0,239',)))


@pytest.fixture(scope='module')
def made(tmp_path_factory: pytest.TempPathFactory) -> LoadedModel:
    return model_of(SMALL, tmp_path_factory.mktemp('described'))


def test_a_model_reads_pictures_and_bins_as_the_description_has_them(made: LoadedModel) -> None:
    """8x12 patches and 1.8 regions for each near the surface: 14x22, and the nearest that divide 200x320 pixels into
    14 px or more."""
    assert made.image_size == (320, 200)
    assert made.model.bins == BinGrid(4, 6, 18.0, 12.0)
    assert (made.model.layout.rows, made.model.layout.cols) == (10, 20)


def test_presses_of_a_ball_are_read_though_nobody_ever_pressed_it(made: LoadedModel) -> None:
    table = linear_table(dataclasses.replace(gel_of(SMALL), tip_radius_mm=3.0))
    places_mm = [(0.0, 0.0), (4.0, -2.0), (-5.0, 2.5)]
    DescribedChain(SMALL, made, table).require_read(places_mm, depth_mm=0.6, share=0.15, off_mm=0.4)


@pytest.mark.timeout(400)  # the first use compiles
@pytest.mark.skipif(importlib.util.find_spec('numba') is None, reason='numba is not installed')
def test_a_model_that_was_never_saved_reads_with_compiled_loops_as_with_numpy(made: LoadedModel) -> None:
    """1 N on a patch in the middle."""
    assert isinstance(made.model.readout, FieldReadout)
    readout = described(SMALL, made.model.readout.scaling).readout
    patches, values = readout.solver.patches, np.zeros(readout.scaling.mean.shape, np.float32)
    middle = int(np.hypot(*patches.centres_mm.T).argmin())
    values[readout.scaling.trusted > 0] = readout.response[:, middle].reshape(-1, 2)
    sure = np.ones(values.shape[:2], np.float32)
    plain, compiled = (dataclasses.replace(readout, compiled=each).read(values, sure) for each in (False, True))
    assert plain.normal_force_n.sum() == pytest.approx(1.0, abs=0.1)
    np.testing.assert_allclose(compiled.normal_force_n, plain.normal_force_n, atol=1e-3)


def test_what_moves_on_a_covered_part_is_no_force(tmp_path: Path) -> None:
    """The left quarter of the picture shows something else than the gel, which goes 3 px to the right there."""
    made, gel = model_of(MASKED, tmp_path), dataclasses.replace(gel_of(SMALL), mechanics='linear')
    assert isinstance(made.model.readout, FieldReadout)
    assert not made.model.readout.scaling.trusted[:, :4].any()
    optics, flow = Optics(gel, linear_table(gel)), make_flow(*made.flow)
    rest, seen = (np.ascontiguousarray(optics.render((), number)[20:220]) for number in range(2))
    flow.set_reference(rest)
    seen[:, 3:80] = seen[:, :77].copy()
    field = flow.displacement(seen)
    features = make_encoding(*made.encoding).encode(field)
    assert not features.confidence[:, :4].any()
    assert ForceEstimator(made.model).predict(features).total_n < 0.005


def test_presses_on_a_sensor_with_a_mask_are_measured_as_its_model_was(tmp_path: Path) -> None:
    model_of(MASKED, tmp_path)
    optics = Optics(gel_of(SMALL), linear_table(gel_of(SMALL)))
    pictures = np.stack([optics.render((Press(x, 0.0, 0.3),) if x else (), 7) for x in (0.0, 2.0, -2.0)])
    file, x_mm, force_n = tmp_path / 'small.safetensors', np.array([np.nan, 2.0, -2.0]), np.array([0.0, 0.1, 0.2])
    presses = import_arrays(pictures, x_mm, 0 * x_mm, force_n, options=options_of(str(file)))
    require_same_features(load_model(file), presses)


def test_forces_on_printed_dots_are_not_ok_and_those_on_speckle_are(made: LoadedModel) -> None:
    """12 % are in doubt, and a fifth with printed dots; ok is what is in doubt by at most twice the nominal 7 %."""
    readout = made.model.readout
    assert isinstance(readout, FieldReadout)
    assert readout.spread.response == 0.12
    assert FieldSpread(response=0.2).normal_n(0.0, 1.0) > 2 * FieldSpread(response=0.2).nominal_n(1.0)
    assert FieldSpread(response=0.12).normal_n(0.0, 1.0) < 2 * FieldSpread(response=0.12).nominal_n(1.0)


def test_a_gel_of_half_or_twice_the_modulus_lies_within_the_interval_where_nobody_measured_it(tmp_path: Path) -> None:
    """Of 1 N reported 0.5 and 2 N were true, or 2.4 N under a ball between dots, where a sixth of the force is missed;
    1.645 * 0.9 = 1.48 N to either side hold all, and no such force is ok."""
    unmeasured = dataclasses.replace(SMALL, gel=dataclasses.replace(SMALL.gel, moduli_off=GelDescription.moduli_off))
    model_of(unmeasured, tmp_path)
    estimating = Estimating(str(tmp_path / 'small.safetensors'))
    readout = estimating.now.loaded.model.readout
    assert isinstance(readout, FieldReadout)
    interval_n = 1.645 * readout.spread.normal_n(0.0, 1.0)
    assert interval_n == pytest.approx(1.48, abs=0.02)
    found = ForceMap(np.zeros((4, 6), np.float32), 1.0, (0.0, 0.0), 1.0, total_sigma_n=interval_n / 1.645,
        unlikeness=0.5, nominal_n=readout.nominal_n(1.0))  # fmt: skip
    verdict = judged(found, estimating.now.reasons)
    assert (verdict.status, verdict.reasons) == (FORCE.STATUS_DEGRADED, FORCE.REASON_UNCALIBRATED)


def test_pictures_and_a_table_tell_how_stiff_its_gel_is(made: LoadedModel, tmp_path: Path) -> None:
    """A quarter stiffer than described; pictures of 320x240, of which 320x200 are read."""
    gel = dataclasses.replace(gel_of(SMALL), mechanics='linear')
    table, rows = linear_table(gel), ['picture,x_mm,y_mm,force_n,indenter']
    optics, random = Optics(gel, table), np.random.default_rng(3)
    for number in range(16):
        (x, y), depth_mm = random.uniform((-6.5, -3.5), (6.5, 3.5)), float(random.uniform(0.3, 0.9))
        presses = (Press(float(x), float(y), depth_mm),) if number >= 6 else ()
        cv2.imwrite(str(tmp_path / f'{number}.png'), optics.render(presses, number))
        cells = f'{x:.3f},{y:.3f},{1.25 * table.force_at(depth_mm):.4f},ball:0.6' if presses else ',,0,'
        rows.append(f'{number}.png,{cells}')
    (tmp_path / 'presses.csv').write_text('\n'.join(rows))
    save_model(tmp_path / 'described.safetensors', made.model, made.card)
    source, output = Source.find(str(tmp_path / 'described.safetensors')), tmp_path / 'mine.safetensors'
    presses = presses_by_hand(source.loaded, tmp_path / 'presses.csv', 'stiffer', Progress())
    _, made_of_it = calibrate(source, presses, output)
    assert made_of_it.after.force_median_n < 0.4 * made_of_it.before.force_median_n
    assert load_model(output).image_size == (320, 200)


def test_a_small_contact_is_found_on_a_corner_of_bins_as_within_one() -> None:
    """0.3 N within 0.3 mm, over markers 0.35 mm deep: regions show what no force spread over a bin moves. Bins are 3 mm
    wide; places are a corner of four, another, an edge, and the middle of one."""
    sensor = dataclasses.replace(SMALL, gel=dataclasses.replace(SMALL.gel, markers_mm=(0.3, 0.4)))
    regions = usual_regions(sensor)
    shape = regions.rows, regions.cols
    scaling = InputScaling(
        np.zeros((*shape, 2), np.float32), np.full((*shape, 2), 250, np.float32),
        regions.usable.reshape(shape).astype(np.float32), 0.1,
    )  # fmt: skip
    readout, around = described(sensor, scaling).readout, np.arange(8) * np.pi / 4
    disc = np.vstack([np.zeros(2), *(0.15 * n * np.column_stack([np.cos(around), np.sin(around)]) for n in (1, 2))])
    spectrum = regions.layer.points(disc, np.ones(len(disc)))
    places_mm = np.array([(0.0, 0.0), (3.0, 0.0), (0.7, 0.0), (1.5, 1.5)])
    terms = regions.terms_of_pressure(places_mm, spectrum, np.flatnonzero(scaling.trusted))
    for place_mm, motion in zip(places_mm, 0.3 * (terms @ regions.nominal_shares).astype(float), strict=True):
        found = readout.solver.field(motion, readout.solver.weights(motion, np.ones(len(motion))))
        centre_mm = found.forces_n[0] @ readout.solver.patches.centres_mm / found.total_n
        assert found.total_n == pytest.approx(0.3, rel=0.1), place_mm
        assert centre_mm == pytest.approx(place_mm, abs=0.15)


class SmallSensor(BagSensor):
    """The small sensor a quarter stiffer than described; bags keep its pictures as they are."""

    def force_n(self, depth_mm: float) -> float:
        return 1.25 * super().force_n(depth_mm)

    def image(self, *presses: Shaping) -> np.ndarray:
        self._seed += 1
        return self._optics.render(presses, self._seed)


def test_bags_of_presses_tell_it_too(made: LoadedModel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A ball's presses on pictures of 320x240, of which 320x200 are read."""
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path / 'cache'))
    sensor = SmallSensor(dataclasses.replace(gel_of(SMALL), mechanics='linear'))
    collection, random = Collection(tmp_path / 'bag', sensor), np.random.default_rng(3)
    collection.reference(0)
    for slot in range(16):
        x_mm, y_mm, depth_mm = random.uniform((-6.5, -3.5, 0.3), (6.5, 3.5, 0.8)).tolist()
        collection.press(slot, slot + 1, x_mm, y_mm, depth_mm)
    bags = [collection.close()]
    once = StopRule(first=16, most=16)
    with closing(Calibrator(made, {'id': 'pressed'}, once)) as calibrator, closing(BagPresses(bags)) as presses:
        take_presses(calibrator, presses, lambda line: None)
        finish(calibrator, presses, lambda line: None)
    assert calibrator.recordings is not None and calibrator.calibration is not None, calibrator.objection
    assert calibrator.recordings.card['crop_px'] == [320, 200]
    assert calibrator.calibration.after.force_median_n < 0.4 * calibrator.calibration.before.force_median_n


def test_a_ball_on_a_few_printed_dots_is_read(tmp_path: Path) -> None:
    """35 dots 2.5 mm apart, in 48 regions of 40 px, which are 2.3 mm: no two are taken for one.

    Of what presses between four of them at least 60 % is reported: a smaller force nearer to one does much the same.
    """
    sensor = load_sensor('printed_dots')
    made = model_of(sensor, tmp_path)
    assert (made.model.layout.rows, made.model.layout.cols) == (6, 8)
    chain = DescribedChain(sensor, made, contact_table(gel_of(sensor), 'ball'))
    for x_mm, y_mm in ((0.0, 0.0), (3.0, -2.0), (-4.0, 1.5), (1.3, 2.6)):
        read = chain.read(Press(x_mm, y_mm, 0.8))
        assert 0.55 < read.total_n / chain.table.force_at(0.8) < 1.25
        assert np.hypot(read.contacts[0].x_mm - x_mm, read.contacts[0].y_mm - y_mm) < 2.5 / 2
    assert chain.read().total_n == 0


@pytest.mark.parametrize(
    ('sensor', 'camera'),
    [
        (SMALL, {'position_mm': (40.0, 0.0, -20.0)}),
        (Sensor(), {'position_mm': (60.0, 0.0, -23.0)}),
        (Sensor(), {'tilt_deg': (90.0, 0.0)}),
        (Sensor(), {'tilt_deg': (180.0, 0.0)}),
    ],
)
def test_a_camera_that_looks_beside_the_gel_is_refused(sensor: Sensor, camera: dict[str, tuple[float, ...]]) -> None:
    beside = dataclasses.replace(sensor, camera=dataclasses.replace(sensor.camera, **camera))
    with pytest.raises(ConfigurationError, match=f'regions of the image of {sensor.name} see its gel'):
        described_model(load_model(find_model('field')), beside, '', Path('never'), Progress())


def test_few_bins_are_named_as_the_cause_of_regions_that_reach_beyond_the_gel() -> None:
    """One bin has two patches a side and thus two regions, each of which looks beyond the rim."""
    one_bin = dataclasses.replace(Sensor(), bins=BinSettings(rows=1, cols=1))
    with pytest.raises(ConfigurationError, match=r'0 of the 4 regions .* more bins\.rows and bins\.cols'):
        described_model(load_model(find_model('field')), one_bin, '', Path('never'), Progress())


def test_a_sensor_with_too_few_regions_for_any_force_is_refused() -> None:
    """Nine dots 7 mm apart, 121 px in an image of 320x240: four by two regions are nearest to 1.15 for each dot."""
    dots = load_sensor('printed_dots')
    few = dataclasses.replace(dots, pattern=dataclasses.replace(dots.pattern, pitch_mm=7.0))
    with pytest.raises(ConfigurationError, match='only 8 regions of the image of printed_dots see its gel, and 12'):
        described_model(load_model(find_model('field')), few, '', Path('never'), Progress())


def test_regions_that_look_beyond_the_rim_are_not_known_where_pictures_have_the_size_of_the_sources(tmp_path: Path):
    """10 mm to the right the rim is 6 mm aside, of markers 17 to 21.5 mm above the camera: 290 px/rad atan(6 / 17) = 98
    px at most, so that the four columns from 308 - 220 = 88 px on at the least see none at some depth."""
    sensor = Sensor()
    camera = dataclasses.replace(sensor.camera, position_mm=(10.0, 0.0, -23.0))
    file = tmp_path / 'aside.safetensors'
    described_model(load_model(find_model('field')), dataclasses.replace(sensor, camera=camera), '', file, Progress())
    readout = load_model(file).model.readout
    trusted = readout.scaling.trusted
    assert trusted.shape == (20, 20)
    assert not trusted[:, 14:].any()
    assert trusted[6:14, :12].all()
