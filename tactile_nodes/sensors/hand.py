"""A hand as data, in one YAML file: its sensors, their image sources, and where each is mounted."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from pathlib import Path

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.params import Located, from_mapping, load_listed, parameter
from tactile_nodes.paths import described_in
from tactile_nodes.sensors.mounting import Mounting

SENSORS = 'sensors'
_NAME = re.compile(r'[A-Za-z][A-Za-z0-9_]*')


@dataclass(frozen=True)
class HandSensor:
    """One sensor of a hand. All entries except `frame` are arguments of the live launch, which lists their values.

    Raises:
        ValueError: the name cannot be a namespace, or the source is empty.
    """

    name: str = parameter('', 'namespace of the sensor, and name of its surface frame unless frame.id is given')
    source: str = parameter('simulated', 'image source')
    sensor: str = parameter('', 'description of the sensor')
    model: str = parameter('field', 'force model')
    contact: str = parameter('mixed', 'what touches a simulated sensor')
    config: str = parameter('', 'parameter file of the nodes; empty: config/live.yaml')
    frame: Mounting = field(default_factory=Mounting)

    def __post_init__(self) -> None:
        if not _NAME.fullmatch(self.name):
            raise ValueError(f'a sensor needs a name of letters, digits and underscores, got {self.name!r}')
        if not self.source.strip():
            raise ValueError(
                f'the source of {self.name!r} is empty; name a camera or a recording, or omit it to simulate one'
            )

    @property
    def frames(self) -> tuple[str, str]:
        """The frame of the surface, and the frame of the images."""
        return self.frame.id, f'{self.frame.id}_camera_optical_frame'

    @property
    def camera(self) -> str:
        """The camera, which only one sensor can use; empty for files and simulated images, which several may use."""
        path = f'/dev/video{self.source}' if self.source.isdigit() else self.source
        if self.source == 'simulated' or Path(path).is_file() or Path(path).is_dir():
            return ''
        return os.path.realpath(path) if path.startswith('/dev/') else path


@dataclass(frozen=True)
class HandSettings:
    """What a hand file says besides its sensors."""

    frame: str = parameter('hand', 'frame that all sensors are fixed to; the sum of their forces is given in it')
    fps: float = parameter(60.0, 'frame rate of every sensor [Hz]', minimum=1.0, maximum=1000.0)
    friction: float = parameter(
        0.0, 'coefficient of friction between the surfaces and the object; 0: unknown', minimum=0.0, maximum=10.0
    )


@dataclass(frozen=True)
class Hand(HandSettings):
    """Sensors fixed to one frame. `refused` holds a sentence for each sensor of the file that cannot be used."""

    sensors: tuple[HandSensor, ...] = ()
    refused: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the sensors, in the order of the file."""
        return tuple(each.name for each in self.sensors)

    @property
    def doubted(self) -> str:
        """Which sensors are described at one place and facing one way, as no two gels can be; empty if none are.

        So are those whose poses are missing, or given in m and rad. Closed fingers share a place, but face each other.
        """
        pairs = [
            f'{one.name!r} and {other.name!r}'
            for one, other in combinations(self.sensors, 2)
            if one.frame.coincides(other.frame)
        ]
        return (
            f'{", ".join(pairs)} are at the same place and face the same way, so moments and directions of the sum are '
            'wrong; give their poses: frame.position_mm in mm, frame.rpy_deg in degrees'
            if pairs
            else ''
        )


def load_hand(name: Path | str) -> Hand:
    """A hand by the name of a shipped one ('two_fingers'), or by its file.

    A sensor that cannot be used is left out, with a sentence in `refused`: its values are invalid, or an earlier sensor
    has the same name, frame or camera.

    Raises:
        ConfigurationError: there is no such file, it does not describe a hand, or none of its sensors can be used.
    """
    file = described_in('hands', name, 'hand')
    rest, entries = load_listed(file, SENSORS)
    settings = from_mapping(HandSettings, rest, source=str(file), exact=False)
    sensors: list[HandSensor] = []
    refused: list[str] = []
    for entry in entries:
        try:
            if isinstance(entry, ConfigurationError):
                raise entry
            sensors.append(_added(sensors, entry, settings.frame, file))
        except ConfigurationError as error:
            refused.append(str(error))
    if not sensors:
        raise ConfigurationError(f'{file}: none of its sensors can be used: {"; ".join(refused)}')
    return Hand(settings.frame, settings.fps, settings.friction, tuple(sensors), tuple(refused))


def load_gripper(name: Path | str) -> Hand:
    """A hand of exactly two sensors.

    Raises:
        ConfigurationError: as `load_hand`, or it has another number, perhaps because one was left out.
    """
    hand = load_hand(name)
    if len(hand.sensors) != 2:
        why = f': {"; ".join(hand.refused)}' if hand.refused else ''
        raise ConfigurationError(f'a gripper has two fingers; {name} has {len(hand.sensors)}{why}')
    return hand


def _added(others: Sequence[HandSensor], entry: Mapping[str, Located], parent: str, file: Path) -> HandSensor:
    """Check a sensor against those before it. Raises ConfigurationError: it cannot be used."""
    place = next(iter(entry.values()))
    written = entry.get('name', place)
    values = {'frame.id': written, 'frame.parent': parent, **entry}
    try:
        sensor = from_mapping(HandSensor, values, source=f'{file}:{place.line}', exact=False)
        _check(sensor, others, parent)
    except ValueError as error:
        raise ConfigurationError.at(file, place.line, str(error)) from error
    return sensor


def _check(sensor: HandSensor, others: Sequence[HandSensor], parent: str) -> None:
    if sensor.frame.parent != parent:
        raise ValueError(
            f'{sensor.name!r} is mounted in {sensor.frame.parent!r}, but forces are summed in {parent!r}, '
            'the frame of the hand: give its pose in that frame'
        )
    if parent in sensor.frames:
        raise ValueError(f'{sensor.name!r} has a frame {parent!r}, which is the frame of the hand; rename one')
    for other in others:
        if sensor.name == other.name:
            raise ValueError(f'there are two sensors with the name {sensor.name!r}; rename the second one')
        if sensor.frame.id == other.frame.id:
            raise ValueError(
                f'{sensor.name!r} and {other.name!r} have the same frame.id {sensor.frame.id!r}; rename one'
            )
        if shared := set(sensor.frames) & set(other.frames):
            raise ValueError(f'{sensor.name!r} and {other.name!r} have the same frame {shared.pop()!r}; rename one')
        if sensor.camera and sensor.camera == other.camera:
            raise ValueError(f'{sensor.name!r} uses the camera {sensor.source}, which {other.name!r} already uses')
