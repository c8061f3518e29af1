"""Runs the actions of a launch file one after another, in a context."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Protocol

from tactile_nodes.errors import LaunchFileError
from tactile_nodes.launching.actions import Action, Argument, Group
from tactile_nodes.launching.context import Context
from tactile_nodes.launching.processes.plan import ProcessPlan
from tactile_nodes.launching.reading import read_file
from tactile_nodes.launching.template import Place, SubstitutionError

_MAX_INCLUDES = 50


class Host(Protocol):
    """The target of actions: the launch service."""

    def log(self, level: str, source: str, text: str) -> None: ...

    def start(self, plan: ProcessPlan) -> None: ...

    def after(self, seconds: float, actions: tuple[Action, ...], file: Path, cancel_on_shutdown: bool) -> None: ...

    def request_shutdown(self, reason: str) -> None: ...


class Interpreter:
    """Performs actions; any failure is a `LaunchFileError` with file and line."""

    def __init__(self, context: Context, host: Host, *, output_override: str | None = None) -> None:
        self.context = context
        self.output_override = output_override
        self.host = host
        self._including: list[Path] = []
        self._process_numbers = itertools.count(1)
        self._file_numbers = itertools.count(1)

    def include(self, file: Path, arguments: Mapping[str, str], place: Place | None = None) -> None:
        """Read and run a launch file; `arguments` must include those that it requires."""
        file = file.absolute()
        if place is not None and not file.is_file():
            raise place.error(f'the included launch file {file} does not exist')
        with self._nested(file, place), self.context.inside(file):
            actions = read_file(file)
            _check_arguments(actions, arguments)
            self.context.configurations.update(arguments)
            self.perform(actions)

    def perform(self, actions: Iterable[Action]) -> None:
        for action in actions:
            self._perform(action)

    def _perform(self, action: Action) -> None:
        try:
            if action.condition is None or action.condition.holds(self):
                action.effect.perform(self)
        except SubstitutionError as error:
            raise action.place.error(f'{action.name}: {error}') from error

    def next_name(self, label: str) -> str:
        """The label of a process with its number in this launch."""
        return f'{label}-{next(self._process_numbers)}'

    def write_parameters(self, text: str) -> Path:
        """Write a parameter file to the log folder, where it also documents what a node was given."""
        file = self.context.log_folder / f'launch_params_{next(self._file_numbers)}.yaml'
        try:
            file.write_text(text, encoding='utf-8')
        except OSError as error:
            raise LaunchFileError(
                f'cannot write {file}: {error.strerror}; set ROS_LOG_DIR to a folder that you own'
            ) from error
        return file

    @contextmanager
    def _nested(self, file: Path, place: Place | None) -> Iterator[None]:
        if len(self._including) >= _MAX_INCLUDES and place is not None:
            raise place.error(f'includes are nested too deeply; does {file} include itself?')
        self._including.append(file)
        try:
            yield
        finally:
            self._including.pop()


def _check_arguments(actions: tuple[Action, ...], given: Mapping[str, str]) -> None:
    for argument in _unconditional(actions):
        if argument.default is None and argument.name not in given:
            raise argument.place.error(
                f"included launch description missing required argument '{argument.name}' "
                f"(description: '{argument.description}'), given: [{', '.join(given)}]"
            )


def _unconditional(actions: tuple[Action, ...]) -> Iterator[Argument]:
    for action in actions:
        if action.condition is not None:
            continue
        if isinstance(action.effect, Argument):
            yield action.effect
        elif isinstance(action.effect, Group):
            yield from _unconditional(action.effect.children)
