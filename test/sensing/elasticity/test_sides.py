"""What the sides of a gel change: finite elements against theory, energy and the layer without sides."""

import dataclasses

import numpy as np
import pytest
from coarse_table import hertz

from tactile_nodes.sensing.elasticity.block import Block
from tactile_nodes.sensing.elasticity.layer import ElasticLayer
from tactile_nodes.sensing.elasticity.patches import PatchGrid
from tactile_nodes.sensing.elasticity.regions import Regions
from tactile_nodes.sensing.elasticity.sides import BlockPair, hats, sides_of
from tactile_nodes.sensing.elasticity.stack import Elastic
from tactile_nodes.sensing.geometry import BinGrid
from tactile_nodes.sensors import BinSettings, Sensor

GEL, SIZE_MM = (Elastic(4.0, 0.1),), (14.0, 10.0)
FREE = dataclasses.replace(
    Sensor(), bins=BinSettings(4, 4), gel=dataclasses.replace(Sensor().gel, sides='free')
)  # fmt: skip


@pytest.fixture(scope='module')
def free() -> BlockPair:
    return BlockPair(GEL, SIZE_MM, held=False, finer=0.75)


@pytest.fixture(scope='module')
def held() -> BlockPair:
    return BlockPair(GEL, SIZE_MM, held=True, finer=0.75)


def under(pair: BlockPair, x_mm: float, y_mm: float, *force: float) -> tuple[np.ndarray, np.ndarray]:
    """A force on the surface, and what the sides add to the displacements: (unknowns,) each."""
    loads = pair.loads_n(np.array([[x_mm, y_mm]]), np.array(force).reshape(1, 3, 1))
    return loads[:, 0], pair.added_mm(loads)[:, 0]


def test_a_block_under_even_pressure_is_compressed_as_by_hooke():
    """With Poisson's ratio 0 it stays as wide: 1 N on 100 mm² of 4 mm and E = 2 G = 0.2 MPa sinks by 0.2 mm."""
    lines = np.linspace(-5, 5, 6)
    block = Block((lines, lines, np.linspace(-4, 0, 4)), np.full(3, 0.1), np.zeros(3))
    weights = hats(np.linspace(-4.95, 4.95, 100), lines).mean(axis=0)
    force = np.zeros((*block.shape, 3))
    force[:, :, -1, 2] = -np.outer(weights, weights)
    moved = block.moved_mm(force.reshape(-1, 1)).reshape(*block.shape, 3)
    assert moved[:, :, -1, 2] == pytest.approx(np.full((6, 6), -0.2), rel=1e-3)
    assert moved[..., :2] == pytest.approx(0, abs=1e-9)


def test_held_sides_take_away_what_the_layer_without_sides_moves_there(held: BlockPair):
    """Halfway down at the nearer side, 3 mm from a load; the layer is solved by waves."""
    _, added = under(held, 4.0, 0.0, 0.0, 0.0, -1.0)
    x, y, z = held.lines_mm
    added = added.reshape(len(x), len(y), len(z), 3)
    middle, depth = len(y) // 2, len(z) // 2
    layer = ElasticLayer(GEL, np.array([-z[depth]]))
    moved = layer.kernels(layer.rectangle(0.5, 0.5))[0, :, 0]
    at = np.array(layer.cells) // 2 + np.round(np.array([3.0, 0.0]) / layer.spacing_mm).astype(int)
    assert y[middle] == pytest.approx(0)
    assert added[-1, middle, depth] == pytest.approx(-moved[:, at[1], at[0]], abs=0.08 * float(moved[0, at[1], at[0]]))


@pytest.mark.parametrize('force', [(0.0, 0.0, -1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)])
def test_free_sides_make_a_gel_softer_and_held_ones_stiffer(free: BlockPair, held: BlockPair, force: tuple[float, ...]):
    """The work of any load grows if a constraint goes, and falls if one is added (minimum of potential energy)."""
    for pair, sign in ((free, 1), (held, -1)):
        load, added = under(pair, 5.5, -3.5, *force)
        assert sign * float(load @ added) > 0


def test_what_one_load_adds_where_another_acts_is_the_same_the_other_way_round(free: BlockPair):
    """Betti's theorem, of the difference of two elastic bodies."""
    one, by_one = under(free, 6.0, 3.0, 0.0, 0.0, -1.0)
    other, by_other = under(free, -2.0, -4.0, 1.0, 0.0, 0.0)
    assert float(other @ by_one) == pytest.approx(float(one @ by_other), rel=1e-6)


def test_far_from_the_sides_nothing_changes():
    """Four times the thickness away."""
    long = BlockPair((Elastic(1.0, 0.1),), (12.0, 4.0), held=False, finer=0.5)
    _, added = under(long, 5.5, 0.0, 0.0, 0.0, -1.0)
    by_x = np.abs(added).reshape(len(long.lines_mm[0]), -1).max(axis=1)
    assert by_x[long.lines_mm[0] < 1.5].max() < 0.01 * by_x.max()


def test_a_thin_gel_has_no_more_elements_than_can_be_solved():
    pair = BlockPair((Elastic(1.0, 0.1),), (40.0, 2.0), held=False, finer=0.5)
    assert len(pair.lines_mm[0]) < 45


def test_patches_are_solved_by_mirror_images_of_a_quarter():
    pair, patches = BlockPair(GEL, SIZE_MM, held=False), PatchGrid(BinGrid(2, 3, *SIZE_MM))
    sides = sides_of(GEL, SIZE_MM, patches, held=False)
    width, height = patches.size_mm
    within = (np.arange(16) + 0.5) / 16 - 0.5
    spread = np.stack(np.meshgrid(width * within, height * within), -1).reshape(-1, 2)
    for load, force in enumerate(((0, 0, -1), (1, 0, 0), (0, 1, 0))):
        for number in (0, 9, 23):
            evenly = np.tile(np.array(force, float).reshape(1, 3, 1) / len(spread), (len(spread), 1, 1))
            added = pair.added_mm(pair.loads_n(patches.centres_mm[number] + spread, evenly))[:, 0]
            assert sides.added_mm[:, load * patches.count + number] == pytest.approx(added, abs=1e-5)


def test_sides_change_what_regions_see_of_a_press_as_of_a_patch_there():
    """2 mm from a free side the difference is more than a third of the motion; far from the sides it is small."""
    regions, ignored = Regions(FREE, 10, 10), Regions(dataclasses.replace(FREE, gel=Sensor().gel), 10, 10)
    known = np.flatnonzero(regions.usable)
    patch = 4 * regions.patches.shape[1] - 1  # of 4 mm, its middle 2 mm from the side
    place = regions.patches.centres_mm[patch : patch + 1]
    ball = (each.terms_of_pressure(place, hertz(each.layer, 1.0), known)[0][..., ::3] for each in (regions, ignored))
    with_sides, without = ball
    patches = regions.terms_of_patches(known)[..., patch][..., ::3]
    seen, plain, evenly = (each @ regions.nominal_shares[::3] for each in (with_sides, without, patches))
    assert np.linalg.norm(seen - plain) > np.linalg.norm(plain) / 3
    assert np.linalg.norm(evenly - seen) < 0.2 * np.linalg.norm(seen)
    by_sides = regions.terms_by_sides(known)
    assert by_sides is not None
    added = by_sides[..., patch][..., ::3] @ regions.nominal_shares[::3]
    assert np.linalg.norm(added - (seen - plain)) < 0.1 * np.linalg.norm(added)
    assert ignored.terms_by_sides(known) is None
