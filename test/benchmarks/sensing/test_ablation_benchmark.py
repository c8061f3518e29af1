"""The ablation: every switch reaches what it names, and the page tells what gets worse."""

from dataclasses import replace

import pytest

from benchmarks.ablation import figures
from benchmarks.ablation.mechanisms import BY_NAME, MECHANISMS, Mechanism, instead
from benchmarks.ablation.page import page, worsened
from benchmarks.stability.stream import Plan, World
from tactile_nodes.learning.progress import Progress
from tactile_nodes.paths import share_directory


@pytest.mark.parametrize('name', BY_NAME)
def test_a_mechanism_can_be_switched_off_and_its_files_and_streams_are_there(name: str) -> None:
    mechanism = BY_NAME[name]
    with mechanism.off():
        pass
    assert mechanism.lines(share_directory()) > 0 or not mechanism.files
    for stream in mechanism.streams:
        figures.change_of(stream)


def test_each_mechanism_is_measured_by_something() -> None:
    assert all(each.streams or each.contacts or each.transfer for each in MECHANISMS)


def test_without_registration_a_knock_is_read_as_force() -> None:
    """A knock of 3 px moves every region by 3 px; a press of 0.5 N moves none by more than one."""
    off = BY_NAME['registration'].off
    mechanism = Mechanism('registration', '', (), off, ('camera shifted 3',), ('fast',))
    plan = Plan(presses=2, before=1, coming=4, hold=1, after=1)
    found = figures.streams(mechanism, World(indenters=()), Progress(), plan)['fast, camera shifted 3']
    error = found['force error, mN']
    assert error['without'] > 10 * error['with']


@pytest.mark.parametrize('name', ['width of a contact, and drag', 'weights by what is explained'])
def test_what_stands_in_for_a_part_takes_what_that_part_takes(name: str) -> None:
    mechanism = replace(BY_NAME[name], streams=('none',))
    plan = Plan(presses=1, before=1, coming=4, hold=1, after=1)
    assert figures.streams(mechanism, World(indenters=()), Progress(), plan)


def test_a_switch_is_undone_when_it_is_left() -> None:
    from tactile_nodes.sensing.explain.field import solver

    before = solver.HELD
    with instead('tactile_nodes.sensing.explain.field.solver:HELD', 0.0)():
        assert solver.HELD == 0.0
    assert before == solver.HELD


def _measured(with_it: float, without: float, figure: str = 'force error, mN') -> dict[str, object]:
    return {'a stream': {figure: {'with': with_it, 'without': without}}}


@pytest.mark.parametrize(
    ('with_it', 'without', 'figure', 'worse'),
    [
        (2.0, 2.1, 'force error, mN', False),  # less than a tenth
        (2.0, 4.0, 'force error, mN', True),
        (4.0, 2.0, 'force error, mN', False),  # better without it
        (0.01, 0.03, 'force error, mN', False),  # nobody sees 0.02 mN
        (1.0, 0.5, 'frames ok', True),
        (0.5, 1.0, 'frames ok', False),
        (2.0, float('nan'), 'force error, mN', True),  # no number at all
    ],
)
def test_a_figure_counts_that_gets_worse_by_more_than_a_tenth(
    with_it: float, without: float, figure: str, worse: bool
) -> None:
    assert bool(list(worsened(_measured(with_it, without, figure)))) is worse


def test_the_page_says_what_pays_and_what_went() -> None:
    about = {'does': 'something', 'files': ['a.py'], 'lines': 10, 'command': 'tactile bench ablation', 'commit': 'abc'}
    machine = {'machine': {'processor': 'x', 'cores_allowed': 2, 'load_before': [0.0]}, 'versions': {}}
    text = page(
        {
            'registration': {**about, **machine, 'figures': _measured(2.0, 4.0)},
            'dead pixels': {**about, **machine, 'figures': _measured(2.0, 2.0)},
            'something of before': {**about, **machine, 'figures': _measured(2.0, 2.0)},
        }
    )
    rows = {line.split('|')[1].strip(): line for line in text.splitlines() if line.startswith('|')}
    assert '2 to 4' in rows['registration'] and rows['registration'].rstrip(' |').endswith('yes')
    assert rows['dead pixels'].rstrip(' |').endswith('**no**')
    assert rows['something of before'].rstrip(' |').endswith('removed')
