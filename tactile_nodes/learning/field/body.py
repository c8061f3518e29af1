"""The rigid body that presses a gel to calibrate it: its name, and its lower side."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tactile_nodes.contact_tables.touch_bodies import body_of
from tactile_nodes.contact_tables.touch_tables import Contact
from tactile_nodes.errors import ConfigurationError, ModelError
from tactile_nodes.sensors import Sensor
from tactile_nodes.shapes import Float, Int
from tactile_nodes.simulation.indenter import BALL, name_of_record
from tactile_nodes.simulation.touch.body import NO_BODY_MM, Body

BETWEEN = ', '
"""Separator between the names of several bodies on a model card."""

BODY, BALL_MM = 'body', 'ball_mm'
"""Keys of the model card: the body, and the radius of a ball on older cards."""

ROUND = {'tip': 'ball:0.6', 'ball': 'ball:5'}
"""Families that are balls."""


def as_ball(name: str) -> str:
    """The name of a body by its radius, if it is that of a family of balls: 'tip' is 'ball:0.6'."""
    return ROUND.get(name, name)


@dataclass(frozen=True)
class KnownBody:
    """A body by its name: 'ball:0.6', 'punch:1.5' (radius in mm), a family, a mesh, heights, or a description."""

    name: str
    body: Body

    @classmethod
    def named(cls, name: str) -> KnownBody:
        """From a name as `tactile calibrate --body` takes it.

        Raises:
            ConfigurationError: there is no such body or file, it is no body, or its radius is none.
        """
        name = ROUND.get(name, name_of_record(name))
        contact = Contact.named(name)
        return cls(name, body_of(contact.body, contact.tilt_deg))

    @property
    def is_ball(self) -> bool:
        """Whether its presses also calibrate the readout of tips."""
        return self.name.startswith(f'{BALL}:')

    @property
    def card_name(self) -> str:
        """The name on a model card; of a file its name."""
        return self.name if ':' in self.name else Path(self.name).name

    def over(self, nodes_mm: Float[np.ndarray, 'y x 2']) -> Float[np.ndarray, 'y x']:
        """Height of its lower side above the surface at first contact; infinite outside the body."""
        x, y = np.moveaxis(nodes_mm, -1, 0)
        height = self.body.under(x, y)[0]
        within = np.maximum(np.abs(x), np.abs(y)) <= self.body.half_mm
        return np.where(within & (height < NO_BODY_MM), height, np.inf)

    def require_within(self, sensor: Sensor) -> None:
        """Refuse a body that is wider than the gel. Raises ConfigurationError."""
        narrow_mm = min(sensor.gel.width_mm, sensor.gel.height_mm)
        if 2 * self.body.reach_mm > narrow_mm:
            raise ConfigurationError(
                f'the body {self.name} is {2 * self.body.reach_mm:.0f} mm wide, but the gel only {narrow_mm:g} mm; '
                'press with a smaller one'
            )


@dataclass(frozen=True)
class Bodies:
    """Bodies, and the number of the body that pressed in each sample of a data set."""

    known: tuple[KnownBody, ...]
    of: Int[np.ndarray, ' samples']

    @classmethod
    def one(cls, body: KnownBody, samples: int) -> Bodies:
        """The same body for all samples."""
        return cls((body,), np.zeros(samples, int))

    @property
    def is_a_ball(self) -> bool:
        """Whether it is a single ball, whose presses also calibrate the readout of tips."""
        return len(self.known) == 1 and self.known[0].is_ball

    @property
    def card_name(self) -> str:
        """The names on a model card."""
        return BETWEEN.join(each.card_name for each in self.known)


def body_of_card(card: Mapping[str, Any], model_id: str) -> KnownBody:
    """The body that pressed the gel of a model.

    Raises:
        ModelError: it is unknown, because the card does not name it, or names a file.
    """
    name = str(card[BODY]) if BODY in card else f'{BALL}:{card[BALL_MM]:g}' if BALL_MM in card else ''
    if name and BETWEEN not in name and not Path(name).suffix[1:].isalpha():
        return KnownBody.named(name)
    pressed = f'was made with presses of {name}' if name else 'does not say which body pressed'
    raise ModelError(f'model {model_id} {pressed}; give the body that presses now: --body ball:5 (radius in mm)')
