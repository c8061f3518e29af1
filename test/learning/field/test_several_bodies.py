"""Presses of several bodies in one fit, each with the body that its record names."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from described_chain import model_of
from layered_gel import SENSOR, SIDE, nominal, quiet_scaling, regions

from tactile_nodes.contact_tables.gel_tables import contact_table
from tactile_nodes.errors import DatasetError
from tactile_nodes.learning.config import Choice
from tactile_nodes.learning.datasets.simulated import Dataset
from tactile_nodes.learning.field.alone import transfer_alone
from tactile_nodes.learning.field.body import Bodies, KnownBody, body_of_card
from tactile_nodes.learning.field.calibration import Pressed
from tactile_nodes.learning.field.fit import FieldFit, fit_field
from tactile_nodes.learning.field.presses import Pressures
from tactile_nodes.learning.guided.targets import Target, Wish, linear_most_n
from tactile_nodes.learning.recorded.measuring import Measurer
from tactile_nodes.model_file import LoadedModel, find_model, load_model
from tactile_nodes.sensing.elasticity.regions import Regions
from tactile_nodes.sensing.rest.reference import average
from tactile_nodes.sensors import load_sensor
from tactile_nodes.simulation.described import gel_of
from tactile_nodes.simulation.optics import Optics, Press

BALL, PUNCH = KnownBody.named('ball:1'), KnownBody.named('punch:4')
EACH, SOFTER, NOISE_PX = 12, 1.25, 0.004


@pytest.fixture(scope='module')
def both() -> Dataset:
    """Presses of a ball, then of a punch, on a gel a quarter softer than described, as the layer answers to each."""
    gel, random, motion, presses = regions(), np.random.default_rng(1), [], []
    for body in (BALL, PUNCH):
        pressures = Pressures(gel, body)
        for _ in range(EACH):
            force_n, place = random.uniform(0.4, 0.95) * min(pressures.most_n, 3.0), random.uniform(-11, 11, (1, 2))
            shape = pressures.about(SOFTER * force_n)
            spectrum = gel.layer.points(shape.place_mm, shape.force_n)
            terms = gel.terms_of_pressure(place, spectrum, np.arange(gel.count))
            motion.append(SOFTER * force_n * np.einsum('nrpt,rt->nrp', terms, nominal())[0])
            presses.append((*place[0], 0.5, force_n))
    moved = np.array(motion) + NOISE_PX * random.standard_normal((2 * EACH, gel.count, 2))
    features = moved.reshape(2 * EACH, SIDE, SIDE, 2).astype(np.float16)
    ones, none = np.ones((1, SIDE, SIDE), np.float32), np.zeros(2 * EACH, int)
    names = np.repeat([BALL.name, PUNCH.name], EACH)
    return Dataset(features, np.array(presses, np.float32), none, ones, 'both', indenter=names)


def fitted(both: Dataset, bodies: Bodies) -> FieldFit:
    """Without a try of free and held sides."""
    rows = np.arange(2 * EACH)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr('tactile_nodes.learning.field.fit.UNEXPLAINED', np.inf)
        return fit_field(SENSOR, quiet_scaling(), both, rows, rows % 5, bodies)


def test_presses_of_two_bodies_are_each_fitted_with_their_own(both: Dataset) -> None:
    model = load_model(find_model('field'))
    bodies = Pressed().bodies(model, both)
    assert [each.name for each in bodies.known] == ['ball:1', 'punch:4'] and not bodies.is_a_ball
    right = fitted(both, bodies)
    assert right.presses == 2 * EACH
    assert right.gain == pytest.approx(SOFTER, rel=0.004)
    assert right.misfits['gain'] == pytest.approx(1.0, abs=0.2)
    as_punch = fitted(both, Bodies.one(PUNCH, 2 * EACH))
    assert as_punch.misfits['gain'] > 2 * right.misfits['gain']
    assert abs(as_punch.gain - SOFTER) > 2 * abs(right.gain - SOFTER)
    # All presses of the punch are deeper than a ball of 1 mm may go with as much force.
    as_ball = fitted(both, Bodies.one(BALL, 2 * EACH))
    assert as_ball.left_out == EACH


@pytest.mark.parametrize('body', ['ball:0.6', 'punch:3'])
@pytest.mark.parametrize(('sensor', 'share'), [('printed_dots', 0.18), ('speckle_membrane', 0.08)])
def test_the_layer_counts_as_linear_up_to_a_share_of_its_thickness(sensor: str, share: float, body: str) -> None:
    """Of 4 mm (docs/contacts.md); forces count in steps of a quarter."""
    pressures = Pressures(Regions(load_sensor(sensor), 6, 8), KnownBody.named(body))
    assert pressures.about(pressures.most_n).depth_mm == pytest.approx(share * 4.0, rel=0.25)


def test_what_a_rig_calls_its_indenter_is_known_as_a_body() -> None:
    assert KnownBody.named('sphere 1.2 mm').name == 'ball:0.6'
    assert KnownBody.named('flat punch 3 mm').name == 'punch:1.5'


def test_a_body_given_beside_fills_rows_that_name_none_and_one_name_of_all_rows(both: Dataset) -> None:
    model, pressed = load_model(find_model('field')), Pressed(body=KnownBody.named('ball:5'))
    assert both.indenter is not None
    some = dataclasses.replace(both, indenter=np.where(both.indenter == 'ball:1', '', both.indenter))
    assert [each.name for each in pressed.bodies(model, some).known] == ['ball:5', 'punch:4']
    probe = dataclasses.replace(both, indenter=np.full(2 * EACH, 'my probe'))
    assert pressed.bodies(model, probe).is_a_ball
    with pytest.raises(DatasetError, match=r"the indenter 'my probe' is not a known body: .*; or name it with --body"):
        Pressed().bodies(model, probe)


def test_a_model_of_several_bodies_says_so_and_names_none_for_the_next() -> None:
    bodies = Bodies((BALL, PUNCH), np.zeros(2, int))
    card = Pressed().to_card({}, bodies)
    assert card == {'body': 'ball:1, punch:4'}
    with pytest.raises(Exception, match=r'was made with presses of ball:1, punch:4; give the body that presses now'):
        body_of_card(card, 'm')


@pytest.fixture(scope='module')
def dots(tmp_path_factory: pytest.TempPathFactory) -> LoadedModel:
    return model_of(load_sensor('printed_dots'), tmp_path_factory.mktemp('dots'))


def test_light_presses_of_a_small_tip_calibrate_a_gel_with_printed_dots(dots: LoadedModel) -> None:
    """Half as hard again as described, and of a tip between dots a fifth is not seen: one gain makes up for both."""
    sensor = load_sensor('printed_dots')
    most_n = linear_most_n(sensor, KnownBody.named('ball:0.6'))
    assert most_n == pytest.approx(0.25, abs=0.02)
    gel = dataclasses.replace(gel_of(sensor), seed=5, shear_modulus_mpa=1.5 * sensor.gel.moduli_mpa[0])
    table, random = contact_table(gel), np.random.default_rng(2)
    wish, done = Wish(30, (0.5 * most_n, 0.7 * most_n, 0.85 * most_n), sensor), []
    while (target := wish.next(done)) is not None:
        done.append(Target(target.x_mm, target.y_mm, target.force_n * float(random.uniform(0.85, 1.15))))
    optics = Optics(gel, table)
    rests = [optics.render((), number) for number in range(20)]
    pressed = [optics.render((Press(*each[:2], table.depth_at(each.force_n)),), 100 + n) for n, each in enumerate(done)]
    with Measurer(Choice(*dots.flow), Choice(*dots.encoding), dots.image_size) as measurer:
        measurer.use_reference(average(rests))
        measured = [measurer.measure([each]) for each in (*rests, *pressed)]
    rows = np.zeros((50, 4), np.float32)
    rows[:20, 2], rows[20:, 2], rows[20:, [0, 1, 3]] = -1.0, 1.0, done
    values, confidence = (np.stack([getattr(each, name) for each in measured]) for name in ('values', 'confidence'))
    dataset = Dataset(values, rows, np.arange(50), confidence, 'dots', indenter=np.repeat(['', 'ball:0.6'], [20, 30]))
    made = transfer_alone(dots, dataset, Pressed())
    assert made.presses == 30
    assert made.form == 'gain'
    assert made.after.force_median_n < 0.6 * made.before.force_median_n
