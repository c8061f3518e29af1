"""A simulated person: presses a simulated gel as asked, with small errors, and reads a scale."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from tactile_nodes.contact_tables.gel_tables import contact_table
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.learning.field.body import KnownBody
from tactile_nodes.learning.guided.guide import Picture
from tactile_nodes.learning.guided.targets import Target
from tactile_nodes.learning.guided.watching import UNTOUCHED
from tactile_nodes.sensors import Sensor
from tactile_nodes.simulation import worlds
from tactile_nodes.simulation.described import gel_of
from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.indenter import indenter_of
from tactile_nodes.simulation.mechanics import ContactTable
from tactile_nodes.simulation.optics import Press

AWAY = Press(0.0, 0.0, -1.0)
UNSTEADY = 0.15
"""Relative error of the force with which a hand presses."""
HARDER = 1.05
"""Factor on the depth while the camera sees no press."""
TIP = 'ball:0.6'


class SimulatedPerson:
    """Presses at once, with about the wanted force, exactly at the place.

    The scale is right to a tenth of a per cent of its full range.

    Args:
        sensor: what is pressed.
        newton: the scale's unit in N.
        tell: receives the text for a person.
        world: the name under which the simulated camera finds the gel.
        body: what presses; solved once for a gel, which takes a quarter of a minute, and cached.

    Raises:
        ConfigurationError: the body is neither a ball nor a punch.
    """

    def __init__(
        self,
        sensor: Sensor,
        newton: float,
        tell: Callable[[str], None],
        world: str = 'by hand',
        body: KnownBody | None = None,
    ) -> None:
        self._gel, self._newton, self._tell = gel_of(sensor), newton, tell
        tip = body.name if body else TIP
        if indenter_of(tip) is None:
            raise ConfigurationError(
                f'a simulated hand presses with a ball or a punch, such as ball:5 or punch:1.5, not with {tip}; name '
                'one of these, or give a camera with --source'
            )
        self._table = contact_table(self._gel, tip)
        self._random = np.random.default_rng(1)
        self._now = self._held = AWAY
        worlds.share(world, self)

    @property
    def gel(self) -> Gel:
        """The pressed gel."""
        return self._gel

    @property
    def tables(self) -> Mapping[str, ContactTable]:
        """The contact table of the pressing body."""
        return {'tip': self._table}

    def press_at(self, time_ns: int) -> Press:  # noqa: ARG002
        """The current press."""
        return self._now

    def presses_at(self, time_ns: int) -> tuple[Press, ...]:  # noqa: ARG002
        """The current press, if it touches."""
        return (self._now,) if self._now.depth_mm > 0 else ()

    def force_at(self, time_ns: int) -> float:  # noqa: ARG002
        """The current force, N."""
        return self._table.force_at(self._now.depth_mm) if self._now.depth_mm > 0 else 0.0

    def leave_untouched(self) -> None:
        self._now = AWAY

    def press(self, target: Target, picture: Picture, done: list[Target]) -> None:  # noqa: ARG002
        force_n = target.force_n * float(self._random.uniform(1 - UNSTEADY, 1 + UNSTEADY))
        self._now = self._held = Press(target.x_mm, target.y_mm, self._table.depth_at(force_n))
        self._tell(f'pressing at x {target.x_mm:g}, y {target.y_mm:g} mm')

    def sees(self, state: str, place_mm: tuple[float, float]) -> None:  # noqa: ARG002
        """Press harder if the camera sees no press."""
        if state == UNTOUCHED and self._now.touching:
            self._now = self._held = replace(self._now, depth_mm=HARDER * self._now.depth_mm)

    def reading(self, target: Target) -> tuple[float, tuple[float, float]] | None:
        self._now = self._held  # kept while the question is repeated
        return round(self.force_at(0) / self._newton, 4), (target.x_mm, target.y_mm)

    def say(self, text: str) -> None:
        self._now = AWAY
        self._tell(text)
