"""All that is remembered from frame to frame: one value, that can be saved, gone on from, and compared.

Saved are numbers, texts, arrays and names of the classes below; what follows from them is computed again, so that
nothing in a file is executed. Of two memories that hold the same the bytes are the same.
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
_TOLD = 'told'


class Memory:
    """What each stage remembers, one after another."""

    def __init__(self, freshness: Freshness, measure: MeasureMemory, rest: RestMemory) -> None:
        self.freshness, self.measure, self.judge, self.rest = freshness, measure, JudgeMemory(), rest

    def begin(self, rest: RestInUse) -> None:
        """Measure against this rest image from now on."""
        self.measure.begin(rest)
        self.judge.begin(rest)

    @property
    def learned(self) -> tuple[object, ...]:
        """What took many frames to learn: rest image, how the whole picture moved, how many pixels are dead."""
        moved, rest = self.measure.registration, self.rest
        return (
            rest.in_use.prepared.reference_id if rest.in_use else '',
            (moved.straightening, moved.settled) if moved else None,
            rest.dead.count,
        )

    def saved(self) -> bytes:
        """All of it, as a safetensors file."""
        arrays: dict[str, np.ndarray] = {}
        parts = _taken_apart(self, 'memory', arrays)
        told = json.dumps({'measuring': self._measuring, 'memory': parts}).encode()
        return bytes(save({**arrays, _TOLD: np.frombuffer(told, np.uint8)}))

    def recall(self, data: bytes) -> None:
        """Go on where `saved` was asked.

        Raises:
            ConfigurationError: it is nothing that was saved by the same version, or motion was measured otherwise.
        """
        try:
            arrays = load(data)
            told = json.loads(arrays[_TOLD].tobytes())
            if told['measuring'] != self._measuring:
                raise ConfigurationError(
                    f'saved was what {told["measuring"]} remembers, and motion is measured by {self._measuring} now'
                )
            if not isinstance(found := _Putting(arrays, self.rest.measuring).together(told['memory']), Memory):
                raise TypeError(f'{type(found).__name__} is no memory')
        except (SafetensorError, ValueError, KeyError, TypeError, IndexError) as error:
            raise ConfigurationError(f'this is nothing that was remembered ({error}); begin anew') from error
        vars(self).update(vars(found))
        self._take_up()

    @property
    def _measuring(self) -> str:
        measuring = self.rest.measuring
        return f'{measuring.flow.name} {measuring.flow.options} {measuring.encoding.name} {measuring.encoding.options}'

    def _take_up(self) -> None:
        """What follows from what was saved."""
        registration, rest = self.measure.registration, self.rest
        if registration and rest.in_use and rest.in_use.prepared.registering:
            registration.look_beside(rest.in_use.prepared.registering)
        if rest.coming is not None:
            rest.coming.begin(rest.measuring)


CLASSES: Mapping[str, type] = {
    each.__name__: each
    for each in (
        Coming, DeadPixels, DentedRest, Filling, Freshness, JudgeMemory, MeasureMemory, Memory, PictureLikeness,
        PictureMotion, Registration, RegistrationOptions, Renewal, RenewalOptions, RestAccumulator, RestCapture,
        RestInUse, RestMemory, Shift, Straightening,
    )
}  # fmt: skip
"""What may be part of a memory."""


def _taken_apart(value: Any, path: str, arrays: dict[str, np.ndarray]) -> Any:
    """Numbers and texts as they are, arrays aside under their paths, objects as the name of their class and parts."""
    if isinstance(value, _PLAIN):
        return value
    if isinstance(value, np.ndarray):
        arrays[path] = np.ascontiguousarray(value)
        return {'array': path}
    if isinstance(value, tuple | list):
        return [_taken_apart(each, f'{path}.{number}', arrays) for number, each in enumerate(value)]
    if isinstance(value, PreparedRest):
        return {'rest': _taken_apart(value.image, path, arrays)}
    if isinstance(value, StillnessCheck):  # that of a capture, which has no options
        return {'check': _taken_apart(value.reference, path, arrays)}
    parts = {name: _taken_apart(each, f'{path}.{name}', arrays) for name, each in _parts_of(value).items()}
    return {'class': type(value).__name__, 'parts': parts}


def _parts_of(value: Any) -> dict[str, Any]:
    """What an object remembers, without what follows from that."""
    if CLASSES.get(type(value).__name__) is not type(value):
        raise TypeError(f'{type(value).__name__} is nothing that can be saved')
    if dataclasses.is_dataclass(value):
        return {each.name: getattr(value, each.name) for each in dataclasses.fields(value)}
    derived = getattr(value, 'DERIVED', ())
    return {name: each for name, each in vars(value).items() if name not in derived}


class _Putting:
    """Puts together what was taken apart."""

    def __init__(self, arrays: Mapping[str, np.ndarray], measuring: Measuring) -> None:
        self._arrays, self._measuring = arrays, measuring
        self._prepared: dict[bytes, PreparedRest] = {}

    def together(self, told: Any) -> Any:
        """The value that it was."""
        if isinstance(told, list):
            return tuple(self.together(each) for each in told)
        if not isinstance(told, dict):
            return told
        makes: dict[str, Callable[[Any], Any]] = {
            'array': self._array, 'rest': self._rest, 'check': self._check, 'class': self._object
        }  # fmt: skip
        return makes[next(iter(told), '')](told)

    def _array(self, told: Any) -> np.ndarray:
        return np.array(self._arrays[told['array']])

    def _object(self, told: Any) -> Any:
        made: Any = object.__new__(CLASSES[told['class']])
        vars(made).update({name: self.together(each) for name, each in told['parts'].items()})
        if isinstance(made, RestMemory):
            made.measuring = self._measuring
        return made

    def _rest(self, told: Any) -> PreparedRest:
        image = self._array(told['rest'])
        if (content := image.tobytes()) not in self._prepared:
            self._prepared[content] = self._measuring.beside(image)
        return self._prepared[content]

    def _check(self, told: Any) -> StillnessCheck:
        check = StillnessCheck()
        check.set_reference(self._array(told['check']))
        return check
