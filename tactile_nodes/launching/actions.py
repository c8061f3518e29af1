"""The actions of a launch file: what each takes, checked when the file is read, and what each does when it runs."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from tactile_nodes.launching import values
from tactile_nodes.launching.document import Item
from tactile_nodes.launching.names import check_namespace, joined_namespace
from tactile_nodes.launching.template import Place, SubstitutionError, Template

if TYPE_CHECKING:
    from tactile_nodes.launching.interpreter import Interpreter


class Effect(Protocol):
    def perform(self, run: Interpreter) -> None: ...


@dataclass(frozen=True)
class Condition:
    """``if`` or ``unless``."""

    text: Template
    wanted: bool

    def holds(self, run: Interpreter) -> bool:
        return values.condition(self.text.evaluate(run.context)) is self.wanted


@dataclass(frozen=True)
class Action:
    """One action of a file."""

    name: str
    place: Place
    effect: Effect
    condition: Condition | None
    item: Item


@dataclass(frozen=True)
class Argument:
    """``arg``: sets its launch configuration unless that is set already."""

    name: str
    default: Template | None
    description: str
    choices: tuple[str, ...]
    place: Place

    def perform(self, run: Interpreter) -> None:
        configurations = run.context.configurations
        if self.name not in configurations:
            if self.default is None:
                raise self.place.error(f"required launch argument '{self.name}' was not provided")
            configurations[self.name] = self.default.evaluate(run.context)
        value = configurations[self.name]
        if self.choices and value not in self.choices:
            raise self.place.error(
                f"argument '{self.name}' provided value '{value}' is not valid; valid options are: {list(self.choices)}"
            )


@dataclass(frozen=True)
class Let:
    name: Template
    value: Template

    def perform(self, run: Interpreter) -> None:
        value = self.value.evaluate(run.context)
        run.context.configurations[self.name.evaluate(run.context)] = value


@dataclass(frozen=True)
class Log:
    message: Template

    def perform(self, run: Interpreter) -> None:
        run.host.log('INFO', 'launch.user', self.message.evaluate(run.context))


@dataclass(frozen=True)
class Shutdown:
    reason: Template | None

    def perform(self, run: Interpreter) -> None:
        run.host.request_shutdown(self.reason.evaluate(run.context) if self.reason else 'reason not given')


@dataclass(frozen=True)
class Timer:
    """``timer``: its children run later, in the scope that is active then (as in ROS 2), but in this file."""

    period: Template | float
    cancel_on_shutdown: Template | bool
    children: tuple[Action, ...]

    def perform(self, run: Interpreter) -> None:
        period = values.number(
            str(self.period) if isinstance(self.period, float) else self.period.evaluate(run.context)
        )
        run.host.after(period, self.children, run.context.file, _boolean(self.cancel_on_shutdown, run))


@dataclass(frozen=True)
class Include:
    """``include``: not scoped, so what it sets remains set."""

    file: Template
    arguments: tuple[Let, ...]
    place: Place

    def perform(self, run: Interpreter) -> None:
        file = Path(self.file.evaluate(run.context))
        run.include(file, _evaluated(self.arguments, run), self.place)


@dataclass(frozen=True)
class Group:
    """``group``: scoped unless it says otherwise."""

    children: tuple[Action, ...]
    scoped: bool
    forwarding: bool
    keep: tuple[Let, ...]

    def perform(self, run: Interpreter) -> None:
        kept = _evaluated(self.keep, run)
        if not self.scoped:
            run.context.configurations.update(kept)
            run.perform(self.children)
            return
        with run.context.scoped():
            if not self.forwarding:
                run.context.reset_configurations()
            run.context.configurations.update(kept)
            run.perform(self.children)


@dataclass(frozen=True)
class PushNamespace:
    namespace: Template

    def perform(self, run: Interpreter) -> None:
        context = run.context
        namespace = joined_namespace(context.configurations.get('ros_namespace'), self.namespace.evaluate(context))
        check_namespace(namespace)
        context.configurations['ros_namespace'] = namespace or '/'


@dataclass(frozen=True)
class SetParameter:
    name: Template
    value: Template

    def perform(self, run: Interpreter) -> None:
        value = values.from_yaml(self.value.evaluate(run.context))
        if isinstance(value, list):
            raise SubstitutionError('a list cannot be given to all nodes; ROS 2 would pass it as a string')
        run.context.scope.parameters.append((self.name.evaluate(run.context), str(value)))


@dataclass(frozen=True)
class SetParametersFromFile:
    file: Template

    def perform(self, run: Interpreter) -> None:
        file = Path(self.file.evaluate(run.context)).absolute()
        if not file.is_file():
            raise SubstitutionError(f'the parameter file {file} does not exist')
        run.context.scope.parameters.append(file)


@dataclass(frozen=True)
class SetRemap:
    source: Template
    target: Template

    def perform(self, run: Interpreter) -> None:
        source, target = self.source.evaluate(run.context), self.target.evaluate(run.context)
        run.context.scope.remaps.append((source, target))


def _boolean(value: Template | bool, run: Interpreter) -> bool:
    return value if isinstance(value, bool) else values.boolean(value.evaluate(run.context))


def _evaluated(pairs: Iterable[Let], run: Interpreter) -> dict[str, str]:
    return {pair.name.evaluate(run.context): pair.value.evaluate(run.context) for pair in pairs}
