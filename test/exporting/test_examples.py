"""The examples that turn a bag into a figure and into a table, on a bag of known forces."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from exported_bags import START_NS, STEP_NS, force, write_bag, write_messages
from matplotlib.quiver import Quiver
from seen import ring

from tactile_nodes.bus.topics import FORCE_DISTRIBUTION, FORCE_FIELD

EXAMPLES = Path(__file__).parents[2] / 'examples'


def example(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f'{name}.py')
    assert spec is not None
    assert spec.loader is not None
    made = importlib.util.module_from_spec(spec)
    sys.modules[name] = made  # a dataclass looks its module up there
    spec.loader.exec_module(made)
    return made


@pytest.fixture(scope='module')
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp('bags') / 'touch'
    write_bag(folder, frames=4)
    return folder


def test_the_figure_is_drawn_of_what_the_messages_say_in_mm_and_seconds(bag: Path) -> None:
    forces, truth = example('bag_to_figure').read(bag)
    wanted = [force(number, START_NS + number * STEP_NS) for number in range(4)]
    np.testing.assert_allclose(forces.time_s, np.arange(4) * STEP_NS / 1e9)
    np.testing.assert_array_equal(forces.total_n, [each.total for each in wanted])
    np.testing.assert_array_equal(forces.map_n[2], wanted[2].normal_force.reshape(9, 9))
    np.testing.assert_allclose(forces.contacts[:, 1:], [[1 / 3, -2.0, 0.1]] * 3)  # all but the second touch
    np.testing.assert_allclose(forces.extent_mm, (-11.25, 11.25, 11.25, -11.25))  # y downwards
    assert list(forces.status) == [2, 0, 0, 0]
    assert len(truth) == 0


def test_the_map_is_drawn_of_the_largest_force_that_is_not_invalid_or_of_the_instant_that_is_asked_for(
    bag: Path,
) -> None:
    script = example('bag_to_figure')
    forces, truth = script.read(bag)
    largest = int(np.argmax(forces.total_n[1:])) + 1
    maps = [script.draw(forces, truth, at).axes[1].images[0].get_array() for at in (None, 0.034)]
    np.testing.assert_array_equal(maps[0], forces.map_n[largest])
    np.testing.assert_array_equal(maps[1], forces.map_n[2])


def test_the_strongest_contacts_are_drawn_last(bag: Path) -> None:
    """Else the end of a press, where its force is low, hides how hard it was."""
    script = example('bag_to_figure')
    forces, truth = script.read(bag)
    forces.contacts[:, 3] = [0.2, 0.5, 0.1]
    (drawn,) = [axes for axes in script.draw(forces, truth, None).axes if axes.get_title().startswith('Contacts')]
    np.testing.assert_array_equal(drawn.collections[0].get_array(), [0.1, 0.2, 0.5])


def test_the_status_says_the_reasons_in_words(bag: Path) -> None:
    script = example('bag_to_figure')
    titles = [axes.get_title() for axes in script.draw(*script.read(bag)).axes]
    assert 'Status of each frame: 3 ok, 0 degraded, 1 invalid; reasons: low confidence' in titles


def test_a_force_field_is_drawn_as_a_smooth_map_with_arrows_and_outlines(tmp_path: Path) -> None:
    received = zip((FORCE_DISTRIBUTION, FORCE_FIELD), ring(START_NS), strict=True)
    folder = write_messages(tmp_path / 'ring', *((f'/{topic.name}', each, START_NS) for topic, each in received))
    script = example('bag_to_figure')
    forces, truth = script.read(folder)
    surface = script.read_surface(folder, '/', START_NS)
    axes = script.draw(forces, truth, None, surface).axes[1]
    (drawn,) = axes.images
    assert drawn.get_interpolation() == 'bicubic'
    assert drawn.get_array().sum() == pytest.approx(2e3, rel=1e-5)  # kPa on cells of 1 mm²: 2 N
    (arrows,) = [each for each in axes.collections if isinstance(each, Quiver)]
    # of blocks of 2 x 2 cells, four of 1 mm² each; what is shorter than 6 % of the longest is not drawn
    assert np.ma.masked_array(arrows.U, arrows.Umask).sum() * 4e-3 == pytest.approx(0.6, rel=0.03)
    assert axes.get_title() == '2.000 N, shear 0.600 N at 0.00 s'


def test_the_program_writes_a_picture_of_a_bag_of_before_shear_was_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = ['bag_to_figure.py', str(EXAMPLES / 'press_bag'), '-o', str(tmp_path / 'press.png')]
    monkeypatch.setattr(sys, 'argv', words)
    assert example('bag_to_figure').main() == 0
    assert (tmp_path / 'press.png').read_bytes().startswith(b'\x89PNG')


@pytest.mark.parametrize('namespace', ['/left', 'left'])
def test_the_sensor_is_named_as_in_the_commands(
    namespace: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_messages(tmp_path / 'hand', (f'/left/{FORCE_DISTRIBUTION.name}', force(1, START_NS), START_NS))
    words = ['bag_to_figure.py', str(tmp_path / 'hand'), '--namespace', namespace, '-o', str(tmp_path / 'left.png')]
    monkeypatch.setattr(sys, 'argv', words)
    assert example('bag_to_figure').main() == 0


@pytest.mark.parametrize(
    ('words', 'said'),
    [
        (['--namespace', '/left'], 'holds no message of /left/force_distribution; see: tactile bag info'),
        (['--at', '300'], 'there is no force at 300 s: those of the bag span 0 to 0.1 s'),
    ],
)
def test_what_a_bag_does_not_hold_is_refused_in_a_sentence(
    words: list[str], said: str, bag: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, 'argv', ['bag_to_figure.py', str(bag), *words])
    assert example('bag_to_figure').main() == 1
    assert said in capsys.readouterr().err


def test_rosbags_alone_reads_the_same_numbers(bag: Path) -> None:
    forces, _ = example('bag_to_figure').read(bag)
    table = list(example('bag_with_pandas').rows(bag))
    assert [row['total_n'] for row in table] == list(forces.total_n)
    assert [row['stamp_ns'] for row in table] == [START_NS + number * STEP_NS for number in range(4)]
    assert [row['f80'] for row in table] == list(forces.map_n[:, 8, 8])


def test_the_table_needs_nothing_of_this_package() -> None:
    assert 'tactile_nodes.' not in (EXAMPLES / 'bag_with_pandas.py').read_text(encoding='utf-8')
