"""Numbers and strings of a message as table columns, found by walking the first message of a topic."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from operator import attrgetter
from typing import Any

import numpy as np

from tactile_nodes.bus.topics import FLOW_FEATURES, FORCE_DISTRIBUTION, FORCE_FIELD, HAND_WRENCH
from tactile_nodes.clock import NS_PER_S
from tactile_nodes.conversions import image_pixels
from tactile_nodes.errors import DatasetError, MessageError
from tactile_nodes.exporting.units import unit_of

TEXT = 'text'
IMAGE_TYPE = 'sensor_msgs/msg/Image'
_TIME_FIELDS = ['sec', 'nanosec']
_MAPS = {
    FORCE_DISTRIBUTION.type_name: (
        'normal_force', 'confidence', 'normal_force_sigma', 'shear_force_x', 'shear_force_y',
    ),
    FORCE_FIELD.type_name: ('pressure', 'shear_x', 'shear_y', 'pressure_sigma', 'shear_sigma'),
}  # fmt: skip
"""Arrays on a grid of rows and columns; unknown ones, or those of an invalid frame, are empty."""

_MOTION = FLOW_FEATURES.type_name, 'picture_motion'
"""Eight numbers, or none if the picture did not move."""

_APART = {IMAGE_TYPE: ('data',), HAND_WRENCH.type_name: ('sensors', 'missing', 'margins')}
"""Fields whose columns have another form."""

_MARGIN = (
    'position.x', 'position.y', 'position.z', 'normal', 'shear', 'margin', 'margin_sigma', 'slip_share',
)  # fmt: skip
_STRONGEST = (
    'position_sigma', 'force', 'force_sigma', 'shear_x', 'shear_y', 'shear_sigma', 'torsion', 'torsion_sigma', 'area',
    'length', 'width', 'angle', 'slip_share',
)  # fmt: skip


@dataclass(frozen=True)
class Column:
    """One column. `dtype` names a numpy type, or is `TEXT`; `shape` is that of one row; `unit` is empty without one."""

    name: str
    dtype: str
    shape: tuple[int, ...] = ()
    unit: str = ''


Getter = Callable[[Any], Any]


@dataclass
class Layout:
    """The columns of one topic, and how to read them from a message. `left_out`: fields without a column, and why.

    Lists of texts, such as joint names, must be the same in every message. They are stored once, beside the table.
    """

    topic: str
    type_name: str
    columns: list[Column] = field(default_factory=list)
    getters: list[Getter] = field(default_factory=list)
    left_out: dict[str, str] = field(default_factory=dict)
    empty: dict[str, Getter] = field(default_factory=dict)
    constant: dict[str, tuple[Getter, list[str]]] = field(default_factory=dict)
    filled: set[str] = field(default_factory=set)

    @classmethod
    def of(cls, topic: str, type_name: str, first: Any, sensors: Sequence[str] = ()) -> Layout:
        """The layout for a topic, from its first message; `sensors` are those in a hand's wrench.

        Raises:
            MessageError: a map has another size than its numbers of rows and columns say.
            ImageError: a picture that cannot be read.
        """
        layout = cls(topic, type_name)
        layout._add_all(first, '', lambda message: message)
        if type_name in _MAPS:
            layout._shape_maps(first)
        if type_name == FORCE_DISTRIBUTION.type_name:
            layout._add_contacts(first)
        if type_name == IMAGE_TYPE:
            layout._add_image(first)
        for sensor in sensors:
            layout._add_sensor(sensor)
        return layout

    @property
    def is_force(self) -> bool:
        return self.type_name == FORCE_DISTRIBUTION.type_name

    @property
    def is_field(self) -> bool:
        return self.type_name == FORCE_FIELD.type_name

    def row(self, message: Any) -> list[Any]:
        """The values of one message, in the order of the columns.

        Raises:
            DatasetError: an array has another shape than in the first message.
        """
        for name, get in self.empty.items():
            if len(get(message)):
                raise self._changed(name, (0,), (len(get(message)),))
        for name, (get, texts) in self.constant.items():
            if get(message) != texts:
                raise DatasetError(
                    f'{name} of {self.topic} is {texts} in the first message and {get(message)} in a later one, so its '
                    f'columns would change their meaning; leave the topic out with --exclude {self.topic}'
                )
        return [self._fitted(column, get(message)) for column, get in zip(self.columns, self.getters, strict=True)]

    def _fitted(self, column: Column, value: Any) -> Any:
        if not column.shape:
            return value
        array = np.asarray(value, column.dtype)
        if array.size == 0 and array.dtype.kind == 'f':  # unknown in this message, e.g. in an invalid frame
            return np.full(column.shape, np.nan, array.dtype)
        if array.size != np.prod(column.shape) or (array.ndim > 1 and array.shape != column.shape):
            raise self._changed(column.name, column.shape, array.shape)
        return array.reshape(column.shape)

    def _changed(self, name: str, was: tuple[int, ...], now: tuple[int, ...]) -> DatasetError:
        return DatasetError(
            f'{name} of {self.topic} has the shape {was} in the first message and {now} in a later one, which no table '
            f'of one shape can hold; leave the topic out with --exclude {self.topic}, or export the parts of the bag'
        )

    # --- walking --------------------------------------------------------------------------------------------

    def _add(self, name: str, dtype: str, get: Getter, shape: tuple[int, ...] = ()) -> None:
        self.columns.append(Column(name, dtype, shape, unit_of(self.type_name, name)))
        self.getters.append(get)

    def _add_all(self, value: Any, prefix: str, get: Getter) -> None:
        for entry in _fields(value):
            if not prefix and entry in _APART.get(self.type_name, ()):
                continue
            name = f'{prefix}{entry}'
            if name == 'header':
                self._add('frame_id', TEXT, lambda message: message.header.frame_id)
            else:
                self._add_leaf(getattr(value, entry), name, _within(get, entry))

    def _add_leaf(self, value: Any, name: str, get: Getter) -> None:
        if dataclasses.is_dataclass(value) and list(_fields(value)) == _TIME_FIELDS:
            self._add(f'{name}_ns', 'int64', lambda message: get(message).sec * NS_PER_S + get(message).nanosec)
        elif dataclasses.is_dataclass(value):
            self._add_all(value, f'{name}.', get)
        elif isinstance(value, str):
            self._add(name, TEXT, get)
        elif (self.type_name, name) == _MOTION:
            self._add(name, 'float32', get, (8,))
        elif isinstance(value, np.ndarray) and value.size == 0 and not self._has_map(name):
            self.empty[name] = get
        elif isinstance(value, np.ndarray) and value.dtype.kind in 'fiub':
            self._add(name, value.dtype.name, get, value.shape)
        elif isinstance(value, (bool, int, float, np.generic)):
            self._add(name, np.asarray(value).dtype.name, get)
        elif isinstance(value, list) and value and all(isinstance(each, str) for each in value):
            self.constant[name] = (get, value)
        else:
            self.left_out[name] = 'a list of any length'

    def _has_map(self, name: str) -> bool:
        return name in _MAPS.get(self.type_name, ())

    def _shape_maps(self, first: Any) -> None:
        """Give the maps the shape rows by columns; `filled` are those that are not empty in the first message."""
        grid = (int(first.rows), int(first.cols))
        for number, column in enumerate(self.columns):
            if self._has_map(column.name):
                size = len(getattr(first, column.name))
                if size not in (0, grid[0] * grid[1]):
                    raise MessageError(f'{column.name} has {size} values for {grid[0]} rows and {grid[1]} columns')
                self.columns[number] = dataclasses.replace(column, dtype='float32', shape=grid)
                self.filled |= {column.name} if size else set()

    def _add_contacts(self, first: Any) -> None:
        """Add the number of contacts, and the strongest one."""
        if not hasattr(first, 'contacts'):  # bags of older releases
            return
        self.left_out['contacts'] = 'a list; contact_count and strongest.* say how many there are and the first of them'
        self._add('contact_count', 'int64', lambda message: len(message.contacts))
        for name in _STRONGEST:
            self._add(f'strongest.{name}', 'float64', _strongest(name))

    def _add_sensor(self, sensor: str) -> None:
        """Add for a sensor of a hand: whether its wrench is in the sum, how many contacts, and which slips first."""
        self._add(f'sensors.{sensor}', 'bool', lambda message: sensor in message.sensors)
        self._add(f'margins.{sensor}.count', 'int64', lambda message: len(_margins(message, sensor)))
        for part in _MARGIN:
            self._add(f'margins.{sensor}.{part}', 'float64', _first_margin(sensor, part))

    def _add_image(self, first: Any) -> None:
        pixels = image_pixels(first)
        self._add('pixels', pixels.dtype.name, image_pixels, pixels.shape)


def _fields(value: Any) -> Iterator[str]:
    return (entry.name for entry in dataclasses.fields(value) if not entry.name.startswith('_'))


def _within(get: Getter, entry: str) -> Getter:
    return lambda message: getattr(get(message), entry)


def _strongest(name: str) -> Getter:
    """Read a number of the strongest contact; NaN without contact."""
    return lambda message: float(getattr(message.contacts[0], name)) if message.contacts else float('nan')


def _margins(message: Any, sensor: str) -> list[Any]:
    return [margin for margin in message.margins if margin.sensor == sensor]


def _first_margin(sensor: str, part: str) -> Getter:
    """Read a number of the first margin of a sensor; NaN without contact on that sensor."""
    read = attrgetter(part)
    return lambda message: next((float(read(each)) for each in _margins(message, sensor)), float('nan'))
