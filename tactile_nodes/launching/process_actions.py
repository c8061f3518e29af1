"""The actions that start processes: ``executable`` and ``node``."""

from __future__ import annotations

import re
import shlex
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from tactile_nodes.launching import packages, values
from tactile_nodes.launching.document import Entity
from tactile_nodes.launching.names import check_namespace, check_node_name, joined_namespace
from tactile_nodes.launching.node_parameters import NodeParameter, read_parameter
from tactile_nodes.launching.processes.plan import ProcessPlan
from tactile_nodes.launching.template import Call, SubstitutionError, Template

if TYPE_CHECKING:
    from tactile_nodes.launching.context import Context
    from tactile_nodes.launching.interpreter import Interpreter

_TIMEOUT_S = '5'
_BECOME_THE_PROGRAM = {'chrt', 'ionice', 'nice', 'taskset'}
"""Prefixes that are replaced by the program they run. Others, such as debuggers, must receive signals themselves."""
_OUTPUTS = {'log', 'screen', 'both', 'own_log', 'full'}


@dataclass(frozen=True)
class ProcessOptions:
    """Options of both `executable` and `node`."""

    cwd: Template | None
    prefix: Template | None
    output: Template | None
    environment: tuple[tuple[Template, Template], ...]
    respawn: Template | None
    respawn_delay_s: float
    respawn_max_retries: int
    shell: bool
    emulate_tty: bool
    required: bool
    sigterm_timeout_s: float | None
    sigkill_timeout_s: float | None

    def plan(
        self, run: Interpreter, command: list[str], label: str | None, needed: Mapping[str, str], *, ours: bool = False
    ) -> ProcessPlan:
        """The process to start, from its command; `needed` is added to its environment.

        A program of this package (`ours`) unblocks SIGINT when it is ready for it (`tactile_nodes.nodes`).
        """
        context = run.context
        prefix = self._prefix(context, command[0])
        words = prefix + command
        return ProcessPlan(
            name=run.next_name(label or Path(words[0]).name),
            command=tuple(words),
            cwd=self.cwd.evaluate(context) if self.cwd else None,
            environment={**context.environment, **needed, **self._environment(context)},
            shell=self.shell,
            emulate_tty=self._emulate_tty(context),
            output=self._output(run),
            respawn=self.respawn is not None and values.boolean(self.respawn.evaluate(context)),
            respawn_delay_s=self.respawn_delay_s,
            respawn_max_retries=self.respawn_max_retries,
            required=self.required,
            holds_sigint=ours and not self.shell and (not prefix or Path(prefix[0]).name in _BECOME_THE_PROGRAM),
            sigterm_timeout=_timeout(context, 'sigterm_timeout', self.sigterm_timeout_s),
            sigkill_timeout=_timeout(context, 'sigkill_timeout', self.sigkill_timeout_s),
        )

    def _prefix(self, context: Context, program: str) -> list[str]:
        if self.prefix is not None:
            return _prefix_words(self.prefix.evaluate(context))
        if not _matches(context.configurations.get('launch-prefix-filter', ''), Path(program).name):
            return []
        return _prefix_words(context.configurations.get('launch-prefix', ''))

    def _environment(self, context: Context) -> dict[str, str]:
        return {name.evaluate(context): value.evaluate(context) for name, value in self.environment}

    def _emulate_tty(self, context: Context) -> bool:
        chosen = context.configurations.get('emulate_tty')
        return self.emulate_tty if chosen is None else values.condition(chosen)

    def _output(self, run: Interpreter) -> str:
        output = run.output_override or (self.output.evaluate(run.context) if self.output else 'log')
        if output not in _OUTPUTS:
            raise SubstitutionError(f"output is one of {', '.join(sorted(_OUTPUTS))}, got '{output}'")
        return output


@dataclass(frozen=True)
class Executable:
    """``executable``: any program."""

    command: tuple[Template, ...]
    name: Template | None
    options: ProcessOptions

    def perform(self, run: Interpreter) -> None:
        words = [word.evaluate(run.context) for word in self.command]
        if not words or not words[0]:
            raise SubstitutionError('the command is empty')
        label = self.name.evaluate(run.context) if self.name else None
        run.host.start(self.options.plan(run, words, label, {}))


@dataclass(frozen=True)
class Node:
    """``node``: a program that takes ROS arguments."""

    package: Template | None
    executable: Template
    label: Template | None
    name: Template | None
    namespace: Template | None
    arguments: tuple[Template, ...]
    ros_arguments: tuple[Template, ...] | None
    parameters: tuple[NodeParameter, ...]
    remaps: tuple[tuple[Template, Template], ...]
    options: ProcessOptions

    def perform(self, run: Interpreter) -> None:
        context = run.context
        program = self.program(context)
        words = [*program, *(word.evaluate(context) for word in self.arguments)]
        if self.ros_arguments is not None:
            words += ['--ros-args', *(word.evaluate(context) for word in self.ros_arguments)]
        words += ['--ros-args', *self._ros_arguments(run)]
        needed, ours = packages.source_environment(program), self._is_ours(context, program)
        run.host.start(self.options.plan(run, words, self._label(context, program), needed, ours=ours))

    def program(self, context: Context) -> list[str]:
        """The command that starts the executable: nearly always one word, its path."""
        executable = self.executable.evaluate(context)
        if self.package is None:
            return [executable]
        return packages.command_of(self.package.evaluate(context), executable, context.environment)

    def _is_ours(self, context: Context, program: list[str]) -> bool:
        named = self.package is not None and self.package.evaluate(context) == packages.OWN
        return named and program[-1].endswith('_node')

    def _label(self, context: Context, program: list[str]) -> str | None:
        if self.label is not None:
            return self.label.evaluate(context)
        name = self.executable.evaluate(context)
        return name if Path(program[-1]).name != name and self.package is not None else None

    def _ros_arguments(self, run: Interpreter) -> list[str]:
        context = run.context
        name = self.name.evaluate(context) if self.name else None
        namespace = joined_namespace(
            context.configurations.get('ros_namespace'),
            self.namespace.evaluate(context) if self.namespace else None,
        )
        if name is not None:
            check_node_name(name)
        check_namespace(namespace)
        words = ['-r', f'__node:={name}'] if name is not None else []
        words += ['-r', f'__ns:={namespace}'] if namespace is not None else []
        return [*words, *self._parameters(run, _full_name(namespace, name)), *self._remaps(context)]

    def _parameters(self, run: Interpreter, node: str | None) -> list[str]:
        words: list[str] = []
        for given in run.context.scope.parameters:
            words += ['--params-file', str(given)] if isinstance(given, Path) else ['-p', f'{given[0]}:={given[1]}']
        for parameter in self.parameters:
            words += ['--params-file', str(parameter.file(run, node))]
        return words

    def _remaps(self, context: Context) -> list[str]:
        own = [(source.evaluate(context), target.evaluate(context)) for source, target in self.remaps]
        return [word for source, target in [*context.scope.remaps, *own] for word in ('-r', f'{source}:={target}')]


def read_executable(entity: Entity) -> Executable:
    command = entity.template('cmd')
    return Executable(split_words(command), entity.template_or_none('name'), _read_options(entity))


def read_node(entity: Entity) -> Node:
    ros_arguments = entity.template_or_none('ros_args')
    arguments = entity.template_or_none('args')
    return Node(
        package=entity.template_or_none('pkg'),
        executable=entity.template('exec'),
        label=entity.template_or_none('exec_name'),
        name=entity.template_or_none('name'),
        namespace=entity.template_or_none('namespace'),
        arguments=split_words(arguments) if arguments else (),
        ros_arguments=split_words(ros_arguments) if ros_arguments else None,
        parameters=tuple(read_parameter(each) for each in entity.entities('param')),
        remaps=entity.entities_of('remap', lambda each: (each.template('from'), each.template('to'))),
        options=_read_options(entity),
    )


def split_words(command: Template) -> tuple[Template, ...]:
    """A command line as words: literal text is split as by a shell, results of substitutions are never split.

    Raises:
        LaunchFileError: a quote spans a substitution or is not closed.
    """
    words: list[list[str | Call]] = []
    word: list[str | Call] = []
    for part in command.parts:
        if isinstance(part, Call):
            word.append(part)
            continue
        tokens = _shell_words(part, command)
        if not tokens or (part[0].isspace() and word):
            words.append(word)
            word = []
        for index, token in enumerate(tokens):
            if index:
                words.append(word)
                word = []
            word.append(token)
        if tokens and part[-1].isspace():
            words.append(word)
            word = []
    return tuple(Template(tuple(each), command.place) for each in ([*words, word] if word else words))


def _shell_words(text: str, command: Template) -> list[str]:
    try:
        return shlex.split(text)
    except ValueError as error:
        raise command.place.error(f'{error} in {text!r}; a quoted part must not contain a substitution') from error


def _read_options(entity: Entity) -> ProcessOptions:
    respawn_delay_s = entity.number_or_none('respawn_delay') or 0.0
    if respawn_delay_s < 0:
        raise entity.place.error(f"{entity.kind}: 'respawn_delay' must not be negative, got {respawn_delay_s}")
    on_exit = entity.text_or_none('on_exit')
    if on_exit not in {None, 'shutdown'}:
        raise entity.place.error(f"{entity.kind}: 'on_exit' takes 'shutdown', got '{on_exit}'")
    return ProcessOptions(
        cwd=entity.template_or_none('cwd'),
        prefix=entity.template_or_none('launch-prefix'),
        output=entity.template_or_none('output'),
        environment=entity.entities_of('env', lambda each: (each.template('name'), each.template('value'))),
        respawn=entity.template_or_none('respawn'),
        respawn_delay_s=respawn_delay_s,
        respawn_max_retries=entity.integer('respawn_max_retries', default=-1),
        shell=entity.boolean('shell', default=False),
        emulate_tty=entity.boolean('emulate_tty', default=False),
        required=on_exit is not None,
        sigterm_timeout_s=entity.number_or_none('sigterm_timeout'),
        sigkill_timeout_s=entity.number_or_none('sigkill_timeout'),
    )


def _prefix_words(text: str) -> list[str]:
    try:
        return shlex.split(text)
    except ValueError as error:
        raise SubstitutionError(f"the launch prefix '{text}' is not a valid command: {error}") from error


def _matches(pattern: str, program: str) -> bool:
    try:
        return re.match(pattern, program) is not None
    except re.error as error:
        raise SubstitutionError(f"launch-prefix-filter: '{pattern}' is not a regular expression: {error}") from error


def _timeout(context: Context, name: str, given_s: float | None) -> str:
    text = context.configurations.get(name, _TIMEOUT_S) if given_s is None else str(given_s)
    if values.number(text) < 0:
        raise SubstitutionError(f"'{name}' must not be negative, got {text}")
    return text


def _full_name(namespace: str | None, name: str | None) -> str | None:
    if namespace is None or name is None:
        return None
    return f'{namespace.rstrip("/")}/{name}'
