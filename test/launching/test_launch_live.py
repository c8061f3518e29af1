"""What the arguments of our own launch file for live sensing become."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml

from tactile_nodes import paths


@pytest.fixture
def commands(interpret):
    """The commands of a launch file of ours, included with these arguments."""

    def run(name: str, **given: object) -> list[list[str]]:
        arguments = [{'name': key, 'value': str(value)} for key, value in given.items()]
        included = {'file': str(paths.share_directory() / 'launch' / f'{name}.launch.yaml'), 'arg': arguments}
        return interpret(yaml.safe_dump([{'include': included}])).commands

    return run


def given_as(name: str, commands: list[list[str]]) -> Iterator[tuple[str, object]]:
    """Which programs get a parameter in a file, and its value."""
    for words in commands:
        for option, file in itertools.pairwise(words):
            if option == '--params-file':
                for values in yaml.safe_load(Path(file).read_text()).values():
                    if name in values['ros__parameters']:
                        yield ' '.join(words[:3]), values['ros__parameters'][name]


@pytest.mark.parametrize(('given', 'contact'), [({}, 'mixed'), ({'contact': 'ring'}, 'ring'), ({'contact': '7'}, '7')])
def test_the_contact_reaches_the_camera_and_no_other_node(commands, given: dict[str, str], contact: str):
    [(program, value)] = given_as('scene.contact', commands('live', page='false', **given))
    assert 'camera' in program
    assert value == contact


def test_a_rate_in_whole_pictures_reaches_the_camera_as_the_number_that_it_takes(commands):
    [camera] = [
        words for words in commands('live', page='false', fps=5, loop='true') if 'camera' in ' '.join(words[:3])
    ]
    assert [word for word in camera if word.startswith(('fps:=', 'loop:='))] == ['fps:=5.0', 'loop:=True']


@pytest.mark.parametrize(
    ('given', 'handed'), [('auto', []), ('true', ['compiled:=True']), ('false', ['compiled:=False'])]
)
@pytest.mark.parametrize(('name', 'needed'), [('live', {}), ('replay', {'bag': 'run1'})])
def test_nodes_are_reported_compiled_loops_only_where_somebody_chose(
    commands, name: str, needed: dict[str, str], given: str, handed: list[str]
):
    """What is handed on is a wish, and without numba an error; what nobody chose gives way to numpy."""
    [sensing] = [words for words in commands(name, compiled=given, **needed) if 'flow_features' in words]
    assert [word for word in sensing if word.startswith('compiled:=')] == handed


@pytest.mark.parametrize('name', ['collect', 'calibrate'])
@pytest.mark.parametrize('rig', ['simulated', 'emulated', 'real'])
def test_a_plan_of_ones_own_reaches_the_rig_as_one_that_ships_does(commands, name: str, rig: str):
    devices = paths.share_directory() / 'config/rigs/example.yaml'
    [(_, plan)] = given_as('plan_file', commands(name, rig=rig, plan='mine.yaml', devices=devices))
    assert plan == 'mine.yaml'


@pytest.mark.parametrize(('model', 'plan'), [('field', 'any_contact'), ('portable', 'calibrate')])
def test_a_field_is_calibrated_with_light_presses_too(commands, model: str, plan: str):
    assert [given for _, given in given_as('plan_file', commands('calibrate', model=model))] == [plan]
