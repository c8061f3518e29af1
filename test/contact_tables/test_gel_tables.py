from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from tactile_nodes import paths
from tactile_nodes.contact_tables import gel_tables
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.params import load_mapping
from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.solution import Problem, Solution, solve_problem

QUICK = Problem(finest_mm=0.4, growth=2.0, deepest_mm=0.2, rungs=2)
GELS = paths.share_directory() / 'config' / 'gels'


@pytest.fixture(scope='module')
def solution() -> Solution:
    return solve_problem(QUICK)


@pytest.fixture
def known(solution: Solution, monkeypatch: pytest.MonkeyPatch) -> None:
    """A problem that is to be solved gets this solution at once."""
    monkeypatch.setattr(gel_tables, 'solve_problem', lambda problem, _: dataclasses.replace(solution, key=problem.key))


def refuse(problem: Problem) -> Solution:
    raise AssertionError(f'{problem} was solved')


@pytest.fixture
def own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(paths, 'cache_directory', lambda: tmp_path)
    return tmp_path / 'contacts'


def load(name: str) -> Gel:
    return Gel.from_mapping({key: located.value for key, located in load_mapping(GELS / name).items()}, name)


@pytest.mark.parametrize('name', ['paper.yaml', 'stiff.yaml', 'lifelike.yaml'])
def test_gels_of_the_papers_layer_need_no_solution(name: str, own_cache: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(gel_tables, 'solve_problem', refuse)
    gel_tables.contact_table.cache_clear()
    assert gel_tables.contact_table(load(name)).force_at(2.0) == pytest.approx(
        9.0 * load(name).shear_modulus_mpa, rel=0.01
    )


def test_every_gel_that_ships_can_be_read():
    assert [load(each.name).layer_mm for each in sorted(GELS.glob('*.yaml'))] == [6.0, 6.0, 6.0, 4.0]


def test_a_solution_is_kept_and_found_again(own_cache: Path, known: None, monkeypatch: pytest.MonkeyPatch):
    first = gel_tables.solution_of(QUICK)
    assert [each.name for each in own_cache.iterdir()] == [f'{QUICK.key}.npz']
    monkeypatch.setattr(gel_tables, 'solve_problem', refuse)
    np.testing.assert_array_equal(gel_tables.solution_of(QUICK).moved_mm, first.moved_mm)


def test_a_kept_file_of_another_problem_is_not_taken(own_cache: Path, known: None, solution: Solution):
    other = dataclasses.replace(QUICK, layer_mm=5.0)
    gel_tables.write_solution(own_cache / f'{other.key}.npz', solution)
    assert gel_tables.solution_of(other).key == other.key


@pytest.mark.parametrize('content', [b'', b'PK\x03\x04 and no more', bytes(4096)])
def test_a_damaged_file_of_the_cache_is_solved_and_written_again(content: bytes, own_cache: Path, known: None):
    """A cut of power leaves an empty file or zeros under the right name; every later start would end there."""
    own_cache.mkdir()
    (own_cache / f'{QUICK.key}.npz').write_bytes(content)
    solution = gel_tables.solution_of(QUICK)
    with np.load(own_cache / f'{QUICK.key}.npz') as arrays:
        np.testing.assert_array_equal(arrays['moved_mm'], solution.moved_mm)


def test_a_gel_needs_no_cache(known: None, monkeypatch: pytest.MonkeyPatch):
    """Below a device no folder can be made, as little as in a home folder that a service may only read."""
    monkeypatch.setenv('XDG_CACHE_HOME', '/dev/null')
    assert gel_tables.solution_of(QUICK).key == QUICK.key


def test_the_linear_gel_has_its_own_tip_only():
    with pytest.raises(ConfigurationError, match='finite_strain'):
        gel_tables.contact_table(Gel(mechanics='linear'), 'ball')


def test_a_gel_that_does_not_exist_is_refused_with_those_that_do():
    with pytest.raises(ConfigurationError, match=r"there is no gel 'soft'; .* lifelike, paper, stiff, thin$"):
        gel_tables.load_gel('soft')
