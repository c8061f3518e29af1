"""The state of a running launch: launch configurations, environment, and settings for all nodes.

A scoped group works on a copy (`scoped`), so its changes are gone after it; an include does not.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from tactile_nodes.launching import substitutions
from tactile_nodes.launching.template import SubstitutionError


@dataclass
class Scope:
    """What a scoped group restores.

    Attributes:
        configurations: launch configurations (arguments, ``let``, and ROS 2's own, like ``ros_namespace``).
        remaps: (from, to) of ``set_remap``.
        parameters: (name, value) of ``set_parameter``, and files of ``set_parameters_from_file``, in order.
    """

    configurations: dict[str, str]
    remaps: list[tuple[str, str]] = field(default_factory=list)
    parameters: list[tuple[str, str] | Path] = field(default_factory=list)


class Context:
    """The active scope, the current file, and the values of substitutions."""

    def __init__(
        self,
        environment: Mapping[str, str],
        log_folder: Path,
        *,
        file: Path,
    ) -> None:
        self.scope = Scope({})
        self.file = file
        self.log_folder = log_folder
        self.environment = dict(environment)

    @property
    def configurations(self) -> dict[str, str]:
        return self.scope.configurations

    @contextmanager
    def scoped(self) -> Iterator[None]:
        """On exit, undo every change of the scope."""
        outer = self.scope
        self.scope = copy.deepcopy(outer)
        try:
            yield
        finally:
            self.scope = outer

    @contextmanager
    def inside(self, file: Path) -> Iterator[None]:
        """Within the context, let ``$(dirname)`` and ``$(filename)`` refer to another file."""
        outer, self.file = self.file, file
        try:
            yield
        finally:
            self.file = outer

    def reset_configurations(self) -> None:
        """Clear them, including namespace, remaps and parameters for all nodes, which ROS 2 stores there."""
        self.scope = Scope({})

    def call(self, name: str, arguments: list[str]) -> str:
        """The value of a substitution; see `template.Caller`."""
        try:
            return substitutions.FUNCTIONS[name](self, *arguments)
        except OSError as error:
            raise SubstitutionError(str(error)) from error
