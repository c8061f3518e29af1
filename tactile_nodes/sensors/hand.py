"""A hand as data: which sensors it has, where each gets its pictures, and where it is mounted. One YAML file."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.params import Located, from_mapping, load_listed, parameter
from tactile_nodes.paths import share_directory
from tactile_nodes.sensors.mounting import Mounting

SENSORS = 'sensors'
_NAME = re.compile(r'[A-Za-z][A-Za-z0-9_]*')


@dataclass(frozen=True)
class HandSensor:
    """One sensor of a hand; all but `frame` are arguments of the live launch, which says what they may be.

    Raises:
        ValueError: a name that no namespace can have.
    """

    name: str = parameter('', 'its namespace, and what its surface frame is called unless frame.id says otherwise')
    source: str = parameter('simulated', 'where its pictures come from')
    sensor: str = parameter('', 'description of the sensor')
    model: str = parameter('field', 'its force model')
    contact: str = parameter('mixed', 'what touches it where it is simulated')
    config: str = parameter('', 'parameter file of its nodes; empty: config/live.yaml')
    frame: Mounting = field(default_factory=Mounting)

    def __post_init__(self) -> None:
        if not _NAME.fullmatch(self.name):
            raise ValueError(f'a sensor needs a name of letters, digits and underscores, got {self.name!r}')

    @property
    def frames(self) -> tuple[str, str]:
        """That of the surface, and that of the pictures."""
        return self.frame.id, f'{self.frame.id}_camera_optical_frame'

    @property
    def camera(self) -> str:
        """What only one sensor can have: its camera; empty for pictures that several may take, files and simulated."""
        path = f'/dev/video{self.source}' if self.source.isdigit() else self.source
        if self.source == 'simulated' or Path(path).is_file() or Path(path).is_dir():
            return ''
        return os.path.realpath(path) if path.startswith('/dev/') else path


@dataclass(frozen=True)
class HandSettings:
    """What a hand file says besides its sensors."""

    frame: str = parameter('hand', 'frame that all sensors are fixed to, and that the sum of their forces is told in')
    fps: float = parameter(60.0, 'frames a second of every sensor', minimum=1.0, maximum=1000.0)
    friction: float = parameter(
        0.0, 'coefficient of friction between the surfaces and what they hold; 0: not known', minimum=0.0, maximum=10.0
    )


@dataclass(frozen=True)
class Hand(HandSettings):
    """Sensors fixed to one frame. `refused` are sentences on those that the file holds and that cannot be used."""

    sensors: tuple[HandSensor, ...] = ()
    refused: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Those of the sensors, in the order of the file."""
        return tuple(each.name for each in self.sensors)


def load_hand(name: Path | str) -> Hand:
    """A hand by the name of one that ships ('two_fingers'), or its file.

    A sensor that cannot be used is left out, with a sentence in `refused`: its values are none, or its name, frame or
    camera is taken by one before it.

    Raises:
        ConfigurationError: there is no such file, it is no hand, or none of its sensors can be used.
    """
    folder = share_directory() / 'config' / 'hands'
    shipped = folder / f'{name}.yaml'
    file = shipped if shipped.is_file() else Path(name)
    if not file.is_file():
        known = ', '.join(sorted(each.stem for each in folder.glob('*.yaml')))
        raise ConfigurationError(f'there is no hand {str(name)!r}; give a YAML file, or one that ships: {known}')
    rest, entries = load_listed(file, SENSORS)
    told = from_mapping(HandSettings, rest, source=str(file), exact=False)
    sensors: list[HandSensor] = []
    refused: list[str] = []
    for entry in entries:
        try:
            if isinstance(entry, ConfigurationError):
                raise entry
            sensors.append(_added(sensors, entry, told.frame, file))
        except ConfigurationError as error:
            refused.append(str(error))
    if not sensors:
        raise ConfigurationError(f'{file}: no sensor of it can be used: {"; ".join(refused)}')
    return Hand(told.frame, told.fps, told.friction, tuple(sensors), tuple(refused))


def _added(others: Sequence[HandSensor], entry: Mapping[str, Located], parent: str, file: Path) -> HandSensor:
    """A sensor beside others. Raises ConfigurationError: it cannot be used."""
    place = next(iter(entry.values()))
    written = entry.get('name', place)
    values = {'frame.id': written, 'frame.parent': parent, **entry}
    try:
        made = from_mapping(HandSensor, values, source=f'{file}:{place.line}', exact=False)
        _check(made, others, parent)
    except ValueError as error:
        raise ConfigurationError.at(file, place.line, str(error)) from error
    return made


def _check(made: HandSensor, others: Sequence[HandSensor], parent: str) -> None:
    if made.frame.parent != parent:
        raise ValueError(
            f'{made.name!r} is mounted in {made.frame.parent!r}, and forces are summed in {parent!r}, '
            'the frame of the hand: say where it is in that'
        )
    if parent in made.frames:
        raise ValueError(f'{made.name!r} has a frame {parent!r}, which is that of the hand; rename one')
    for other in others:
        if made.name == other.name:
            raise ValueError(f'there are two sensors with the name {made.name!r}; the first has it, rename this one')
        if made.frame.id == other.frame.id:
            raise ValueError(f'{made.name!r} and {other.name!r} have one frame.id, {made.frame.id!r}; rename one')
        if shared := set(made.frames) & set(other.frames):
            raise ValueError(f'{made.name!r} and {other.name!r} have one frame, {shared.pop()!r}; rename one')
        if made.camera and made.camera == other.camera:
            raise ValueError(f'{made.name!r} takes the camera {made.source}, which is that of {other.name!r}')
