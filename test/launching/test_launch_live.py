"""What the arguments of our own launch file for live sensing become."""

from __future__ import annotations

import itertools
from pathlib import Path

import pytest
import yaml

from tactile_nodes import paths


@pytest.mark.parametrize(('given', 'contact'), [({}, 'mixed'), ({'contact': 'ring'}, 'ring'), ({'contact': '7'}, '7')])
def test_the_contact_reaches_the_camera_and_no_other_node(interpret, given: dict[str, str], contact: str):
    arguments = [{'name': name, 'value': value} for name, value in {'page': 'false', **given}.items()]
    included = {'file': str(paths.share_directory() / 'launch' / 'live.launch.yaml'), 'arg': arguments}
    notes = interpret(yaml.safe_dump([{'include': included}]))
    received = [
        (words[:3], values['ros__parameters']['scene.contact'])
        for words in notes.commands
        for option, file in itertools.pairwise(words)
        if option == '--params-file'
        for values in yaml.safe_load(Path(file).read_text()).values()
        if 'scene.contact' in values['ros__parameters']
    ]
    [(command, value)] = received
    assert 'camera' in ' '.join(command)
    assert value == contact


def test_a_rate_in_whole_pictures_reaches_the_camera_as_the_number_that_it_takes(interpret):
    given = {'page': 'false', 'fps': '5', 'loop': 'true'}
    arguments = [{'name': name, 'value': value} for name, value in given.items()]
    included = {'file': str(paths.share_directory() / 'launch' / 'live.launch.yaml'), 'arg': arguments}
    commands = interpret(yaml.safe_dump([{'include': included}])).commands
    [camera] = [words for words in commands if 'camera' in ' '.join(words[:3])]
    assert [word for word in camera if word.startswith(('fps:=', 'loop:='))] == ['fps:=5.0', 'loop:=True']


@pytest.mark.parametrize(
    ('given', 'handed'), [('auto', []), ('true', ['compiled:=True']), ('false', ['compiled:=False'])]
)
@pytest.mark.parametrize(('name', 'needed'), [('live', {}), ('replay', {'bag': 'run1'})])
def test_nodes_are_reported_compiled_loops_only_where_somebody_chose(
    interpret, name: str, needed: dict[str, str], given: str, handed: list[str]
):
    """What is handed on is a wish, and without numba an error; what nobody chose gives way to numpy."""
    arguments = [{'name': key, 'value': value} for key, value in {'compiled': given, **needed}.items()]
    included = {'file': str(paths.share_directory() / 'launch' / f'{name}.launch.yaml'), 'arg': arguments}
    commands = interpret(yaml.safe_dump([{'include': included}])).commands
    [sensing] = [words for words in commands if 'flow_features' in words]
    assert [word for word in sensing if word.startswith('compiled:=')] == handed


@pytest.mark.parametrize('name', ['collect', 'calibrate'])
@pytest.mark.parametrize('rig', ['simulated', 'emulated', 'real'])
def test_a_plan_of_ones_own_reaches_the_rig_as_one_that_ships_does(interpret, name: str, rig: str):
    given = {'rig': rig, 'plan': 'mine.yaml', 'devices': paths.share_directory() / 'config/rigs/example.yaml'}
    arguments = [{'name': key, 'value': str(value)} for key, value in given.items()]
    included = {'file': str(paths.share_directory() / 'launch' / f'{name}.launch.yaml'), 'arg': arguments}
    commands = interpret(yaml.safe_dump([{'include': included}])).commands
    plans = [
        values['ros__parameters']['plan_file']
        for words in commands
        for option, file in itertools.pairwise(words)
        if option == '--params-file'
        for values in yaml.safe_load(Path(file).read_text()).values()
        if 'plan_file' in values['ros__parameters']
    ]
    assert plans == ['mine.yaml']
