"""The field of motions that were made with known forces."""

import numpy as np
import pytest

from tactile_nodes.sensing.elasticity.patches import PatchGrid
from tactile_nodes.sensing.explain.field.contacts import contacts_of, parts_of, slip_share
from tactile_nodes.sensing.explain.field.solver import Field, FieldSolver
from tactile_nodes.sensing.explain.field.spread import FieldSpread
from tactile_nodes.sensing.explain.field.sums import sums
from tactile_nodes.sensing.geometry import BinGrid
from tactile_nodes.sensing.grasp import moved_wrench, wrench_mover

NOISE_PX = 0.004
STILL = np.zeros((2, 1, 1), np.float32)


def moved(solver: FieldSolver, forces: np.ndarray, seed: int = 1) -> np.ndarray:
    """The motion of all regions under forces on patches, with noise."""
    motion = (solver.response @ forces.reshape(-1)).reshape(-1, 2)
    return motion + NOISE_PX * np.random.default_rng(seed).standard_normal(motion.shape)


def explained(solver: FieldSolver, motion: np.ndarray) -> Field:
    """What is found of a motion of which all regions are sure."""
    return solver.field(motion, solver.weights(motion, np.ones(len(motion))))


def disc(solver: FieldSolver, at_mm: tuple[float, float], radius_mm: float, total_n: float) -> np.ndarray:
    """Normal forces alone, spread evenly over a disc."""
    away = np.hypot(*(solver.patches.centres_mm - np.array(at_mm)).T)
    forces = np.zeros((3, solver.patches.count))
    forces[0] = total_n * (away < radius_mm) / (away < radius_mm).sum()
    return forces


def test_a_dragged_contact_is_reported_with_its_place_force_and_shear(solver: FieldSolver) -> None:
    forces = disc(solver, (3.0, -2.0), 3.0, 1.5)
    forces[1] = 0.3 * forces[0]
    field = explained(solver, moved(solver, forces))
    assert field.total_n == pytest.approx(1.5, rel=0.05)
    assert field.forces_n[1].sum() == pytest.approx(0.45, rel=0.05)
    assert abs(field.forces_n[2].sum()) < 0.02
    estimated, true = (solver.patches.over_bins(each) for each in (field.forces_n[0], forces[0]))
    assert np.abs(estimated - true).sum() / 2 < 0.15 * 1.5


def test_the_force_of_a_light_wide_contact_is_not_reduced(solver: FieldSolver) -> None:
    """With the weight that selects the patches, the l1 term reduces 0.1 N on a ring by an eighth."""
    x, y = (solver.patches.centres_mm - np.array([2.0, 1.0])).T
    forces = np.zeros((3, solver.patches.count))
    forces[0] = np.abs(np.hypot(x, y) - 3.0) < 0.9
    for total_n in (0.1, 0.2):
        field = explained(solver, moved(solver, total_n * forces / forces.sum()))
        assert field.total_n == pytest.approx(total_n, rel=0.1)


def test_eight_times_the_noise_alone_is_no_force_either(solver: FieldSolver) -> None:
    motion = 8 * moved(solver, np.zeros((3, solver.patches.count)))
    field = solver.field(motion, solver.weights(motion, np.ones(len(motion)), 8 * NOISE_PX))
    assert field.gain < 8.0


@pytest.mark.parametrize('way', range(5), ids=['right', 'down', 'roll', 'nearer', 'not at all'])
def test_noise_and_what_the_camera_moves_are_no_force(solver: FieldSolver, way: int) -> None:
    motion = moved(solver, np.zeros((3, solver.patches.count)))
    if way < solver.camera.shape[1]:
        motion += solver.camera[:, way].reshape(-1, 2)
    field = explained(solver, motion)
    assert field.gain < 8.0
    assert field.total_n < 0.01


def test_a_contact_is_reported_as_it_is_while_the_camera_moves(solver: FieldSolver) -> None:
    forces = disc(solver, (3.0, -2.0), 3.0, 1.5)
    forces[1] = 0.3 * forces[0]
    still = moved(solver, forces)
    motion = still + (solver.camera @ [1.0, -1.0, 1.0, 0.5]).reshape(-1, 2)
    estimated, true = (explained(solver, each) for each in (motion, still))
    assert estimated.total_n == pytest.approx(true.total_n, rel=0.02)
    assert estimated.forces_n[1].sum() == pytest.approx(true.forces_n[1].sum(), abs=0.02)
    assert np.abs(solver.patches.over_bins(estimated.forces_n[0] - true.forces_n[0])).sum() / 2 < 0.05 * 1.5


def test_a_region_that_was_followed_wrongly_and_knows_it_does_no_harm(solver: FieldSolver) -> None:
    forces = disc(solver, (0.0, 0.0), 3.0, 1.0)
    motion, sure = moved(solver, forces), np.ones(len(solver.response) // 2)
    lost = np.argsort(-np.hypot(*motion.T))[2:5]
    motion[lost], sure[lost] = 3.0, 0.0
    field = solver.field(motion, solver.weights(motion, sure))
    assert field.total_n == pytest.approx(1.0, rel=0.1)


@pytest.mark.parametrize('total_n', [2.0, 5.0, 10.0])
def test_a_contact_that_is_wide_beside_the_layer_is_filled(solver: FieldSolver, total_n: float) -> None:
    """An even pressure on 20x20 mm moves next to nothing under its middle; estimated within 20 %, in the interval."""
    forces = np.zeros((3, solver.patches.count))
    forces[0] = total_n * (np.abs(solver.patches.centres_mm) < 10.0).all(axis=1)
    forces[0] *= total_n / forces[0].sum()
    field = explained(solver, moved(solver, forces))
    assert field.total_n == pytest.approx(total_n, rel=0.2)
    summed = sums(field, STILL, solver.patches)
    covariance = FieldSpread().covariance(summed.field, solver.patches, summed.wrench_covariance)
    assert abs(field.total_n - total_n) < 1.645 * np.sqrt(covariance[2, 2])


def test_an_error_of_a_force_is_one_of_its_torque_too(solver: FieldSolver) -> None:
    """2 N on one patch are 0.2 N off, and appear as 0.07 N of shear: about that patch there is no torque."""
    forces, patch = np.zeros((3, solver.patches.count)), 2 * solver.patches.shape[1] + 14
    forces[0, patch] = 2.0
    x, y = solver.patches.centres_mm[patch]
    found = Field(forces, np.array([patch]), np.zeros((3, 3)), 1.0, 0.0)
    exact = FieldSpread(normal=(0.0, 0.0), shear=(0.0, 0.0), wide=0.0, response=0.1, floor_n=0.0)
    covariance = exact.covariance(found, solver.patches, np.zeros((6, 6)))
    squared, sheared = 0.2**2, (0.35 * 0.2) ** 2
    expected = [sheared, sheared, squared, squared * y * y, squared * x * x, sheared * (x * x + y * y)]
    assert np.diag(covariance) == pytest.approx(expected)
    assert covariance[2, 3:] == pytest.approx([squared * y, -squared * x, 0.0])
    assert (covariance[0, 5], covariance[1, 5]) == pytest.approx((-sheared * y, sheared * x))
    there = np.eye(4)
    there[:2, 3] = -x, -y
    _, moved_there = moved_wrench(wrench_mover(there), np.zeros(6), covariance)
    assert moved_there == pytest.approx(np.diag([sheared, sheared, squared, 0, 0, 0]), abs=1e-9)


def test_an_error_of_the_response_is_one_of_its_shear(solver: FieldSolver) -> None:
    """2 N into the gel and 1 N along x, 10 % too high: 0.1 N along x, and 0.07 N that the pressure adds either way."""
    forces = np.zeros((3, solver.patches.count))
    forces[:2, 40] = 2.0, 1.0
    found = Field(forces, np.array([40]), np.zeros((3, 3)), 1.0, 0.0)
    high = FieldSpread(shear=(0.0, 0.0), response=0.1)
    along_x, along_y = np.hypot(0.1, 0.07), 0.07
    assert [high.shear_n(0.0, each, 2.0) for each in (1.0, 0.0)] == pytest.approx([along_x, along_y])
    covariance = high.covariance(found, solver.patches, np.zeros((6, 6)))
    assert np.diag(covariance)[:2] == pytest.approx([along_x**2, along_y**2])


def test_contacts_are_told_apart_with_what_acts_on_each(solver: FieldSolver) -> None:
    forces = disc(solver, (-8.0, 0.0), 2.0, 1.0) + disc(solver, (8.0, 0.0), 2.0, 0.5)
    field = explained(solver, moved(solver, forces))
    first, second = contacts_of(sums(field, STILL, solver.patches).contacts, FieldSpread())[:2]
    assert (first.x_mm, second.x_mm) == (pytest.approx(-8.0, abs=0.4), pytest.approx(8.0, abs=0.4))
    assert (first.force_n, second.force_n) == (pytest.approx(1.0, abs=0.1), pytest.approx(0.5, abs=0.1))
    assert first.region is not None
    assert 5.0 < first.region.area_mm2 < 30.0  # pi 2² is 12.6
    assert first.sigma_n < 0.1


@pytest.mark.parametrize(
    ('row', 'parts'),
    [
        ([0.0, 1.0, 0.20, 0.8, 0.0], [0, 1, 1, 2, 0]),  # 0.20 < 0.3 * 0.8
        ([0.0, 1.0, 0.28, 0.8, 0.0], [0, 1, 1, 1, 0]),
        ([0.0, 1.0, 0.00, 0.8, 0.0], [0, 1, 0, 2, 0]),
        ([1.0, 1.0, 1.0, 1.0, 0.031, 0.104], [1, 1, 1, 1, 1, 1]),  # 0.104 is less than 3 % of the whole
        ([5.0, 0.16, 4.0, 0.20, 3.0], [1, 1, 2, 2, 3]),
    ],
)
def test_two_peaks_are_two_contacts_where_pressure_between_them_falls_below_three_tenths(row, parts) -> None:
    grid = np.pad(np.array([row]), 1)
    assert parts_of(grid.ravel(), grid.shape).reshape(grid.shape)[1, 1:-1].tolist() == parts
    assert parts_of(grid.T.ravel(), grid.T.shape).reshape(grid.T.shape)[1:-1, 1].tolist() == parts


def test_a_twist_is_reported_as_torsion(solver: FieldSolver) -> None:
    """Shear around the middle, q = 0.2 N / mm² r: the moment is that sum over the patches."""
    forces = disc(solver, (0.9, 0.9), 4.0, 3.0)
    away = solver.patches.centres_mm - 0.9
    turning = 0.08 * (forces[0] > 0) * forces[0].max()
    forces[1], forces[2] = -turning * away[:, 1], turning * away[:, 0]
    field = explained(solver, moved(solver, forces))
    (contact, *_) = contacts_of(sums(field, STILL, solver.patches).contacts, FieldSpread())
    true = float((away[:, 0] * forces[2] - away[:, 1] * forces[1]).sum())
    assert contact.region is not None
    assert contact.region.torsion_n_mm == pytest.approx(true, rel=0.1)


def test_slip_is_the_net_shear_over_that_of_the_greatest_friction_all_over() -> None:
    """Cattaneo: a middle that sticks at a third of the limit of 0.6, a rim at it: (0.12 + 2 * 0.12) / 0.6 = 0.6."""
    pressed = np.array([0.6, 0.2, 0.2])
    rubbed = np.array([[0.6 * 0.2, 0.2 * 0.6, 0.2 * 0.6], [0.0, 0.0, 0.0]])
    assert slip_share(pressed, rubbed, 0.0, 1.0) == pytest.approx(0.6)
    assert slip_share(pressed, np.zeros((2, 3)), 0.0, 1.0) == 0.0
    assert slip_share(pressed, 0.5 * np.stack([pressed, np.zeros(3)]), 0.0, 1.0) == pytest.approx(1.0)


def test_a_ring_that_only_presses_does_not_slip_and_one_that_is_turned_under_friction_slips_as_a_whole() -> None:
    turn = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    pressed, outwards, around = np.full(12, 0.1), np.stack([np.cos(turn), np.sin(turn)]), [-np.sin(turn), np.cos(turn)]
    assert slip_share(pressed, -0.06 * outwards, 0.0, 4.0) == pytest.approx(0.0, abs=1e-9)
    assert slip_share(pressed, 0.06 * np.stack(around), 12 * 0.06 * 4.0, 4.0) == pytest.approx(1.0)
    assert slip_share(pressed[:1], np.array([[0.02], [0.0]]), 0.0, 0.0) == pytest.approx(1.0)


def test_a_middle_that_a_camera_straight_above_sees_move_less_is_not_hidden_as_a_rim_is() -> None:
    """Each of 10x10 patches moves one region: the 36 outermost ones half as far as most, the middle four 0.8 times."""
    shown = np.full((10, 10), 0.5)
    shown[1:-1, 1:-1] = 1.0
    shown[4:6, 4:6] = 0.8
    response = np.zeros((200, 300), np.float32)
    response[::2, :100] = np.diag(shown.ravel())
    tested = FieldSolver(response, np.zeros((200, 4)), PatchGrid(BinGrid(5, 5, 30.0, 30.0)), NOISE_PX, 0.02)
    by_patch = np.array([tested.hidden(each) for each in np.eye(100)]).reshape(10, 10)
    np.testing.assert_allclose(by_patch, np.where(shown == 0.5, 1.0, 0.0), atol=1e-6)
