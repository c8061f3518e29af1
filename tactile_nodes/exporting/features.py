"""The content of a LeRobot frame: features of fixed shape, made from the columns of a bag's topics."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from tactile_nodes.bus.topics import (
    CALIBRATION_IMAGE,
    CALIBRATION_STATE,
    FORCE_DISTRIBUTION,
    MODEL_IN_USE,
    PRESS,
    REFERENCE_IMAGE,
    SYNC_EDGE,
    TRUE_FORCE,
)
from tactile_nodes.errors import ConfigurationError, DatasetError
from tactile_nodes.exporting.columns import IMAGE_TYPE, TEXT, Column, Layout
from tactile_nodes.exporting.resampling import Picked

EVENTS = [
    topic.name
    for topic in (PRESS, SYNC_EDGE, CALIBRATION_STATE, MODEL_IN_USE, REFERENCE_IMAGE, CALIBRATION_IMAGE, TRUE_FORCE)
]
"""Topics that are no observation: single events, and what only a simulator knows. They are exported when named."""
_FORCE = (
    ('total_force', 'float32', ['total']),
    ('total_force_sigma', 'float32', ['total_sigma']),
    ('contact', 'float32', ['contact.x', 'contact.y', 'strongest.force']),
    ('contact_sigma', 'float32', ['strongest.position_sigma', 'strongest.force_sigma']),
    ('in_contact', 'bool', ['in_contact']),
    ('unlikeness', 'float32', ['unlikeness']),
    ('status', 'int64', ['status']),
    ('reasons', 'int64', ['reasons']),
)
_SHEAR = (
    ('contact_shear', 'float32', ['strongest.shear_x', 'strongest.shear_y', 'strongest.torsion']),
    ('explanation', 'int64', ['explanation']),
)
"""Only for models that estimate shear."""
_MAP = 'normal_force'
_SHEAR_MAPS = ('shear_force_x', 'shear_force_y')


@dataclass(frozen=True)
class Feature:
    """One feature. `places` are the indices of its columns in the topic's layout; empty: the age of the message."""

    key: str
    topic: str
    dtype: str
    names: tuple[str, ...]
    places: tuple[int, ...] = ()
    shape: tuple[int, ...] = (1,)
    units: tuple[str, ...] = ()

    @property
    def is_image(self) -> bool:
        return self.dtype == 'image'

    def described(self, fps: int) -> dict[str, Any]:
        """The description for `info.json`."""
        return {'dtype': self.dtype, 'shape': list(self.shape), 'names': list(self.names), 'fps': fps}

    def value(self, picked: Picked) -> Any:
        """Its value in a frame.

        Raises:
            DatasetError: there is none, and its type has no NaN.
        """
        if not self.places:
            return np.float32(picked.age_s)
        if picked.value is None:
            return self._unknown()
        if self.is_image:
            return picked.value[self.places[0]]
        parts = [np.asarray(picked.value[place], self.dtype).reshape(-1) for place in self.places]
        return np.concatenate(parts) if self.shape != (1,) else parts[0][0]

    def _unknown(self) -> Any:
        if self.dtype != 'float32':
            raise DatasetError(
                f'{self.topic} has no message until after the first frame, and {self.key} ({self.dtype}) has no NaN; '
                f'leave it out with --exclude {self.topic}'
            )
        return np.full(self.shape, np.nan, np.float32) if self.shape != (1,) else np.float32(np.nan)


def features_of(layouts: Sequence[Layout], state: str = '', action: str = '') -> list[Feature]:
    """The features of a bag. A topic whose name is that of a part of the force gets `topic.` in front of it.

    Args:
        layouts: the layouts of its topics.
        state: full name of the topic that becomes observation.state.
        action: full name of the topic that becomes action.

    Raises:
        ConfigurationError: such a topic has no numbers, or is named for both.
    """
    if state and state == action:
        raise ConfigurationError(f'{state} cannot be both observation.state and action; name one of them')
    named = {state: 'observation.state', action: 'action'}
    found = {layout.topic: _features_of_one(layout, named.get(layout.topic) or _key(layout)) for layout in layouts}
    first = {layout.topic for layout in layouts if layout.is_force or layout.topic in named}
    taken = {feature.key for topic in first for feature in found[topic]}
    for layout in layouts:
        features = found[layout.topic]
        if layout.topic in named and (layout.is_force or not features or features[0].is_image):
            raise ConfigurationError(
                f'{layout.topic} is not a vector of numbers, so it cannot be {named[layout.topic]}; use another topic'
            )
        if layout.topic not in first and any(feature.key in taken for feature in features):
            found[layout.topic] = _features_of_one(layout, f'observation.topic.{_key(layout).partition(".")[2]}')
    return [feature for features in found.values() for feature in features]


def png(pixels: np.ndarray) -> bytes:
    """A picture as PNG with three channels, which image encoders expect; a grey picture has three equal channels."""
    if pixels.dtype != np.uint8:
        raise DatasetError(f'pictures of {pixels.dtype} do not fit into the 8 bits of a data set; export them as zarr')
    colour = cv2.cvtColor(pixels, cv2.COLOR_GRAY2BGR if pixels.ndim == 2 else cv2.COLOR_RGB2BGR)
    return bytes(cv2.imencode('.png', colour)[1].tobytes())


def _features_of_one(layout: Layout, key: str) -> list[Feature]:
    if layout.type_name == IMAGE_TYPE:
        features = [_picture(layout, key)]
    elif layout.is_force:
        features = _forces(layout, key)
    elif layout.is_field:
        features = _field(layout, key)
    else:
        features = _numbers(layout, key)
    # Not named as an observation or action, or policies would use the age as one.
    about = f'{key}.force' if layout.is_force else key
    age = f'age_s.{about.removeprefix("observation.")}'
    return [*features, Feature(age, layout.topic, 'float32', ('age',), units=('s',))] if features else []


def _key(layout: Layout) -> str:
    """'/left/wrench' as 'observation.left.wrench'. A sensor's forces lose their name; pictures are in .images."""
    parts = layout.topic.strip('/').split('/')
    if layout.is_force and parts[-1] == FORCE_DISTRIBUTION.name:
        parts = parts[:-1]
    return '.'.join(['observation', *(['images'] if layout.type_name == IMAGE_TYPE else []), *parts])


def _forces(layout: Layout, key: str) -> list[Feature]:
    features = [_map(layout, f'{key}.force_map', [_MAP])]
    wanted = list(_FORCE)
    if layout.filled.issuperset(_SHEAR_MAPS):
        features.append(_map(layout, f'{key}.shear_map', _SHEAR_MAPS))
        wanted += _SHEAR
    at = _places(layout)
    for name, dtype, parts in wanted:
        if all(each in at for each in parts):  # bags of older releases have fewer fields
            units = tuple(layout.columns[at[each]].unit for each in parts)
            places = tuple(at[each] for each in parts)
            features.append(Feature(f'{key}.{name}', layout.topic, dtype, tuple(parts), places, (len(parts),), units))
    return features


def _field(layout: Layout, key: str) -> list[Feature]:
    """Pressure and shear of the cells; the grid and the standard deviations are only in parquet and zarr."""
    return [_map(layout, f'{key}.pressure', ['pressure']), _map(layout, f'{key}.shear', ['shear_x', 'shear_y'])]


def _map(layout: Layout, key: str, names: Sequence[str]) -> Feature:
    """One feature of several maps, one after the other, each row by row."""
    at = _places(layout)
    columns = [layout.columns[at[name]] for name in names]
    rows, cols = columns[0].shape
    cells = [f'row{row}_col{col}' for row in range(rows) for col in range(cols)]
    parts = tuple(cell if len(names) == 1 else f'{name}_{cell}' for name in names for cell in cells)
    units = tuple(column.unit for column in columns for _ in cells)
    return Feature(key, layout.topic, 'float32', parts, tuple(at[name] for name in names), (len(parts),), units)


def _places(layout: Layout) -> dict[str, int]:
    return {column.name: place for place, column in enumerate(layout.columns)}


def _numbers(layout: Layout, key: str) -> list[Feature]:
    """All floating-point numbers and flags (0, 1), one after the other; no integers and times."""
    chosen = [(place, column) for place, column in enumerate(layout.columns) if _is_number(column)]
    names = tuple(name for _, column in chosen for name in _component_names(column))
    units = tuple(column.unit for _, column in chosen for _ in _component_names(column))
    if not chosen:
        return []
    places = tuple(place for place, _ in chosen)
    return [Feature(key, layout.topic, 'float32', names, places, (len(names),), units)]


def _picture(layout: Layout, key: str) -> Feature:
    place = next(place for place, column in enumerate(layout.columns) if column.name == 'pixels')
    height, width = layout.columns[place].shape[:2]
    return Feature(key, layout.topic, 'image', ('height', 'width', 'channel'), (place,), (height, width, 3))


def _is_number(column: Column) -> bool:
    return column.dtype != TEXT and np.dtype(column.dtype).kind in 'fb'


def _component_names(column: Column) -> list[str]:
    return (
        [f'{column.name}[{number}]' for number in range(int(np.prod(column.shape)))] if column.shape else [column.name]
    )
