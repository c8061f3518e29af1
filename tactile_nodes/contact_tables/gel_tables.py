"""Contact tables by gel: shipped with the package, read from the cache, or solved on demand."""

from __future__ import annotations

from contextlib import suppress
from functools import cache
from pathlib import Path

from tactile_nodes import paths
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.npz_files import read_npz, write_npz
from tactile_nodes.params import load_mapping
from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.mechanics import ContactTable, solve
from tactile_nodes.simulation.solution import OnStep, Problem, Solution, problem_of, solve_problem


def load_gel(name: str) -> Gel:
    """The gel of a YAML file, or a shipped gel (config/gels) by its file name without suffix; '' is the paper's gel.

    Raises:
        ConfigurationError: there is no such file, or it holds an entry that is not a property of a gel.
    """
    if not name:
        return Gel()
    file = paths.described_in('gels', name, 'gel')
    values = {key: located.value for key, located in load_mapping(file).items()}
    return Gel.from_mapping(values, str(file))


@cache
def contact_table(gel: Gel, indenter: str = 'tip') -> ContactTable:
    """The contact table of an indenter on a gel. Solving a new finite-strain table takes half a minute.

    Raises:
        ConfigurationError: there is no such indenter, or the linear solution does not support it.
    """
    if gel.mechanics == 'finite_strain':
        return solution_of(problem_of(gel, indenter)).table(gel.shear_modulus_mpa)
    if indenter != 'tip':
        raise ConfigurationError(
            f'{indenter!r} needs a gel with mechanics: finite_strain; linear mechanics has the tip only'
        )
    return solve(gel)


def tip_table(gel: Gel, on_step: OnStep | None = None) -> ContactTable:
    """The tip's `contact_table`; if a new table is solved, `on_step` is called as by `solve_problem`."""
    if gel.mechanics != 'finite_strain' or on_step is None:
        return contact_table(gel)
    return solution_of(problem_of(gel, 'tip'), on_step).table(gel.shear_modulus_mpa)


def solution_of(problem: Problem, on_step: OnStep | None = None) -> Solution:
    """The solution of a problem: shipped with the package, read from the cache, or solved and cached if possible."""
    shipped = _read(paths.share_directory() / 'config' / 'gels' / 'paper_table.npz', problem.key)
    if (found := shipped or _cached(problem.key)) is not None:
        return found
    solution = solve_problem(problem, on_step)
    with suppress(OSError, ConfigurationError):
        write_solution(_in_cache(problem.key), solution)
    return solution


def _in_cache(key: str) -> Path:
    return paths.cache_directory() / 'contacts' / f'{key}.npz'


def _cached(key: str) -> Solution | None:
    with suppress(OSError, ConfigurationError):
        return _read(_in_cache(key), key)
    return None


def write_solution(file: Path, solution: Solution) -> None:
    """Write a solution. Raises the errors of `write_npz`."""
    write_npz(file, solution.to_arrays(), compressed=True)


def _read(file: Path, key: str) -> Solution | None:
    """The solution in a file, if it belongs to the key and is not damaged."""
    arrays = read_npz(file)
    if arrays is None or str(arrays.get('key')) != key:
        return None
    with suppress(KeyError):
        return Solution.from_arrays(arrays)
    return None
