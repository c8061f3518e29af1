"""All state that is kept between frames, as one value that can be saved, restored and compared.

A file holds numbers, texts, arrays and names of the classes below. Everything derived is computed again, and nothing
in a file is executed. Equal states give equal bytes.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from safetensors import SafetensorError
from safetensors.numpy import load, save

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.pipeline.judge import JudgeMemory
from tactile_nodes.pipeline.measure import MeasureMemory
from tactile_nodes.pipeline.rest_images import RestMemory
from tactile_nodes.sensing.judge.freshness import Freshness
from tactile_nodes.sensing.picture.dead_pixels import DeadPixels, Filling
from tactile_nodes.sensing.picture.dented_rest import DentedRest
from tactile_nodes.sensing.picture.motion import PictureMotion, Shift, Straightening
from tactile_nodes.sensing.picture.moved_dots import MovedDots
from tactile_nodes.sensing.picture.quality import PictureLikeness
from tactile_nodes.sensing.picture.registration import Registration, RegistrationOptions
from tactile_nodes.sensing.picture.stillness import StillnessCheck
from tactile_nodes.sensing.rest.capture import RestCapture
from tactile_nodes.sensing.rest.coming import Coming
from tactile_nodes.sensing.rest.in_use import RestInUse
from tactile_nodes.sensing.rest.prepared import Measuring, PreparedRest
from tactile_nodes.sensing.rest.reference import RestAccumulator
from tactile_nodes.sensing.rest.renewal import Renewal, RenewalOptions

_PLAIN = (bool, int, float, str, type(None))
_STATE = 'told'


class Memory:
    """The state of each stage, in their order."""

    def __init__(self, freshness: Freshness, measure: MeasureMemory, rest: RestMemory) -> None:
        self.freshness, self.measure, self.judge, self.rest = freshness, measure, JudgeMemory(), rest

    def begin(self, rest: RestInUse) -> None:
        """Measure against this rest image from now on."""
        self.measure.begin(rest)
        self.judge.begin(rest)

    @property
    def learned(self) -> tuple[object, ...]:
        """What took many frames to learn: rest image, motion of the whole image, number of dead pixels."""
        moved, rest = self.measure.registration, self.rest
        return (
            self._rest_id,
            (moved.straightening, moved.settled) if moved else None,
            rest.dead.count,
        )

    def saved(self) -> bytes:
        """The whole state, as a safetensors file."""
        arrays: dict[str, np.ndarray] = {}
        parts = _taken_apart(self, 'memory', arrays)
        state = json.dumps({'measuring': self._measuring, 'memory': parts}).encode()
        return bytes(save({**arrays, _STATE: np.frombuffer(state, np.uint8)}))

    def recall(self, data: bytes) -> None:
        """Restore the state that `saved` returned. A rest image that is in use already must be the one of that state.

        Raises:
            ConfigurationError: it was not saved by the same version, motion was measured with another method, or
                against another rest image.
        """
        try:
            arrays = load(data)
            state = json.loads(arrays[_STATE].tobytes())
            if state['measuring'] != self._measuring:
                raise ConfigurationError(
                    f'the state was saved with {state["measuring"]}, but motion is now measured with {self._measuring}'
                )
            if not isinstance(found := _Putting(arrays, self.rest.measuring).together(state['memory']), Memory):
                raise TypeError(f'{type(found).__name__} is not a saved state')
            if (in_use := self._rest_id) and in_use != found._rest_id:
                raise ConfigurationError(
                    f'the state was saved with rest image {found._rest_id or "(none)"}, but {in_use} is now in use'
                )
        except (SafetensorError, ValueError, KeyError, TypeError, IndexError) as error:
            raise ConfigurationError(f'the saved state cannot be used ({error}); start without it') from error
        vars(self).update(vars(found))
        self._take_up()

    @property
    def _rest_id(self) -> str:
        return self.rest.in_use.prepared.reference_id if self.rest.in_use else ''

    @property
    def _measuring(self) -> str:
        measuring = self.rest.measuring
        return f'{measuring.flow.name} {measuring.flow.options} {measuring.encoding.name} {measuring.encoding.options}'

    def _take_up(self) -> None:
        """Compute what follows from the saved state."""
        registration, rest = self.measure.registration, self.rest
        if registration and rest.in_use and rest.in_use.prepared.registering:
            registration.look_beside(rest.in_use.prepared.registering)
        if rest.coming is not None:
            rest.coming.begin(rest.measuring)


CLASSES: Mapping[str, type] = {
    each.__name__: each
    for each in (
        Coming, DeadPixels, DentedRest, Filling, Freshness, JudgeMemory, MeasureMemory, Memory, MovedDots,
        PictureLikeness, PictureMotion, Registration, RegistrationOptions, Renewal, RenewalOptions, RestAccumulator,
        RestCapture, RestInUse, RestMemory, Shift, Straightening,
    )
}  # fmt: skip
"""Classes that may be part of the state."""


def _taken_apart(value: Any, path: str, arrays: dict[str, np.ndarray]) -> Any:
    """Numbers and texts unchanged, arrays by their paths, objects as the name of their class and their parts."""
    if isinstance(value, _PLAIN):
        return value
    if isinstance(value, np.ndarray):
        arrays[path] = np.ascontiguousarray(value)
        return {'array': path}
    if isinstance(value, tuple | list):
        return [_taken_apart(each, f'{path}.{number}', arrays) for number, each in enumerate(value)]
    if isinstance(value, PreparedRest):
        return {'rest': _taken_apart(value.image, path, arrays)}
    if isinstance(value, StillnessCheck):  # the one of a capture, which has no options
        return {'check': _taken_apart(value.reference, path, arrays)}
    parts = {name: _taken_apart(each, f'{path}.{name}', arrays) for name, each in _parts_of(value).items()}
    return {'class': type(value).__name__, 'parts': parts}


def _parts_of(value: Any) -> dict[str, Any]:
    """The state of an object, without what is derived from it."""
    if CLASSES.get(type(value).__name__) is not type(value):
        raise TypeError(f'{type(value).__name__} cannot be saved')
    if dataclasses.is_dataclass(value):
        return {each.name: getattr(value, each.name) for each in dataclasses.fields(value)}
    derived = getattr(value, 'DERIVED', ())
    return {name: each for name, each in vars(value).items() if name not in derived}


class _Putting:
    """Rebuilds the objects that `_taken_apart` split."""

    def __init__(self, arrays: Mapping[str, np.ndarray], measuring: Measuring) -> None:
        self._arrays, self._measuring = arrays, measuring
        self._prepared: dict[bytes, PreparedRest] = {}

    def together(self, part: Any) -> Any:
        """The original value."""
        if isinstance(part, list):
            return tuple(self.together(each) for each in part)
        if not isinstance(part, dict):
            return part
        makes: dict[str, Callable[[Any], Any]] = {
            'array': self._array, 'rest': self._rest, 'check': self._check, 'class': self._object
        }  # fmt: skip
        return makes[next(iter(part), '')](part)

    def _array(self, part: Any) -> np.ndarray:
        return np.array(self._arrays[part['array']])

    def _object(self, part: Any) -> Any:
        instance: Any = object.__new__(CLASSES[part['class']])
        vars(instance).update({name: self.together(each) for name, each in part['parts'].items()})
        if isinstance(instance, RestMemory):
            instance.measuring = self._measuring
        return instance

    def _rest(self, part: Any) -> PreparedRest:
        image = self._array(part['rest'])
        if (content := image.tobytes()) not in self._prepared:
            self._prepared[content] = self._measuring.beside(image)
        return self._prepared[content]

    def _check(self, part: Any) -> StillnessCheck:
        check = StillnessCheck()
        check.set_reference(self._array(part['check']))
        return check
