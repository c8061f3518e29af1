"""Conversion of readouts to and from named arrays and plain numbers, as in a model file."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, fields, is_dataclass
from typing import Any

import numpy as np

from tactile_nodes.sensing.explain.axisymmetric.prior import ErrorPrior
from tactile_nodes.sensing.explain.axisymmetric.radial_smear import RadialSmear
from tactile_nodes.sensing.explain.axisymmetric.readout import AxisymmetricReadout, Correction
from tactile_nodes.sensing.explain.axisymmetric.response import AxisymmetricResponse
from tactile_nodes.sensing.explain.field.readout import STILL, FieldReadout
from tactile_nodes.sensing.explain.field.spread import FieldSpread
from tactile_nodes.sensing.explain.likeness import Likeness
from tactile_nodes.sensing.explain.measured.readout import ResponseReadout
from tactile_nodes.sensing.explain.measured.response import Response
from tactile_nodes.sensing.explain.network import (
    ACTIVATIONS,
    CalibrationLayer,
    InputScaling,
    Mlp,
    NetworkReadout,
    TotalSpread,
)
from tactile_nodes.sensing.explain.novelty_check import NoveltyCheck
from tactile_nodes.sensing.explain.reading import Readout
from tactile_nodes.sensing.explain.splines import SplineAxis
from tactile_nodes.sensing.explain.uncertainty import Calibration
from tactile_nodes.sensing.geometry import BinGrid

Arrays = dict[str, np.ndarray]
NOVELTY_CHECK, TIPS = 'witness.', 'tips.'
FIELD_NUMBERS = 'noise_px', 'doubt', 'misfit_limit', 'least_gain'
AnyReadout = NetworkReadout | ResponseReadout | AxisymmetricReadout | FieldReadout
RANGES = {'hardest_n': (1e-4, 1e4), 'reach_mm': (0.1, 1e3), 'width': (0.01, 100.0), 'softness': (1e-4, 1e4)}
RANGES['pressed_n'] = RANGES['hardest_n']
RANGES |= {'noise_px': (1e-6, 10.0), 'doubt': (0.0, 1.0), 'misfit_limit': (1e-3, 1e3), 'least_gain': (0.0, 1e9)}
RANGES['passes'] = 1, 10
"""No gel is outside these limits; other numbers in a file would cause a division by zero or an endless table."""


def readout_arrays(readout: AnyReadout) -> tuple[Arrays, dict[str, Any]]:
    """Arrays by name, and further numbers; both are stored in a model file."""
    if isinstance(readout, NetworkReadout):
        made = _network_arrays(readout)
    elif isinstance(readout, ResponseReadout):
        made = _response_arrays(readout)
    elif isinstance(readout, FieldReadout):
        made = _field_arrays(readout)
    else:
        made = _axisymmetric_arrays(readout)
    return {name: np.ascontiguousarray(array) for name, array in made[0].items()}, made[1]


def readout_from(arrays: Mapping[str, np.ndarray], said: Mapping[str, Any], bins: BinGrid) -> AnyReadout:
    """The inverse of `readout_arrays`.

    Raises:
        KeyError, TypeError, ValueError: a part is missing or invalid.
    """
    made: AnyReadout
    if said['kind'] == NetworkReadout.kind:
        made = _network(arrays, said, bins)
    elif said['kind'] == FieldReadout.kind:
        made = _field(arrays, said, bins)
    else:
        made = (_response if said['kind'] == ResponseReadout.kind else _axisymmetric)(arrays, said, bins)
    check_numbers(made)
    return made


def _known_activation(name: str) -> str:
    if name not in ACTIVATIONS:
        raise ValueError(f'hidden units cannot be {name!r:.40}')
    return name


def _network_arrays(readout: NetworkReadout) -> tuple[Arrays, dict[str, Any]]:
    arrays = _scaling_arrays(readout.scaling) | _likeness_arrays(readout.likeness)
    for i, (weight, bias) in enumerate(zip(readout.network.weights, readout.network.biases, strict=True)):
        arrays[f'layer{i}.weight'] = weight.astype(np.float16)
        arrays[f'layer{i}.bias'] = bias
    if readout.layer:
        arrays |= {'calibration.change': readout.layer.change, 'calibration.bias': readout.layer.bias}
    heard, told = _novelty_check_arrays(readout.novelty_check)
    return arrays | heard, {
        **_said(readout.kind, readout.scaling, readout.likeness),
        'sizes': list(readout.network.sizes),
        'hidden': readout.network.hidden,
        'output': 'identity',
        'output_scale_n': readout.output_scale_n,
        'spread': _finite(asdict(readout.spread)),
        **({'calibration_layer': 'relu'} if readout.layer else {}),
        **told,
    }


def _novelty_check_arrays(check: Readout | None) -> tuple[Arrays, dict[str, Any]]:
    """Arrays of a novelty check, under their own prefix; files of networks without one stay as before."""
    if not isinstance(check, NoveltyCheck):
        return {}, {}
    arrays, said = _response_arrays(check.readout)
    return {NOVELTY_CHECK + name: each for name, each in arrays.items()}, {
        'witness': said | {'encoding': check.encoding}
    }


def _novelty_check(
    arrays: Mapping[str, np.ndarray], said: Mapping[str, Any] | None, bins: BinGrid
) -> NoveltyCheck | None:
    if said is None:
        return None
    own = {name.removeprefix(NOVELTY_CHECK): each for name, each in arrays.items() if name.startswith(NOVELTY_CHECK)}
    return NoveltyCheck(_response(own, said, bins), said['encoding'])


def _network(arrays: Mapping[str, np.ndarray], said: Mapping[str, Any], bins: BinGrid) -> NetworkReadout:
    layers = range(len(said['sizes']) - 1)
    network = Mlp(
        tuple(arrays[f'layer{i}.weight'].astype(np.float32) for i in layers),
        tuple(arrays[f'layer{i}.bias'] for i in layers),
        _known_activation(said['hidden']),
    )
    spread = TotalSpread(**{name: value for name, value in said['spread'].items() if value is not None})
    likeness = _likeness(arrays, said['likeness'])
    layer = None
    if 'calibration_layer' in said:
        layer = CalibrationLayer.of_change(arrays['calibration.change'], arrays['calibration.bias'])
    novelty_check = _novelty_check(arrays, said.get('witness'), bins)
    return NetworkReadout(
        _scaling(arrays, said), network, bins, said['output_scale_n'], spread, likeness, layer, novelty_check
    )


def _response_arrays(readout: ResponseReadout) -> tuple[Arrays, dict[str, Any]]:
    response = readout.response
    arrays = _scaling_arrays(readout.scaling) | _likeness_arrays(readout.likeness)
    arrays |= {'whitening': readout.whitening, 'coefficients': response.coefficients, 'growth': response.growth}
    limits = {} if readout.most_shift_gain == math.inf else {'most_shift_gain': readout.most_shift_gain}
    return arrays, {
        **_said(readout.kind, readout.scaling, readout.likeness),
        'axes': [asdict(axis) for axis in response.axes],
        'calibration': asdict(readout.calibration),
        'most_contacts': readout.most_contacts,
        **limits,
    }


def _most_shift_gain(said: Mapping[str, Any]) -> float:
    """The limit of a drag; files of earlier releases hold it in another form, equal to within a tenth."""
    return float(said.get('most_shift_gain', said.get('drag', {}).get('least_gain', math.inf)))


def _response(arrays: Mapping[str, np.ndarray], said: Mapping[str, Any], bins: BinGrid) -> ResponseReadout:
    x, y, s = (SplineAxis(**axis) for axis in said['axes'])
    likeness = _likeness(arrays, said['likeness'])
    if likeness is None:
        raise KeyError('likeness.directions')
    if said.get('power', 1) != 1:
        raise ValueError('a response over another power of the force is no longer supported; train it again')
    return ResponseReadout(
        _scaling(arrays, said),
        likeness,
        arrays['whitening'],
        Response(x, y, s, arrays['coefficients'], arrays['growth']),
        bins,
        _calibration(said['calibration']),
        said['most_contacts'],
        _most_shift_gain(said),
    )


def _axisymmetric_arrays(readout: AxisymmetricReadout) -> tuple[Arrays, dict[str, Any]]:
    response, correction = readout.response, readout.correction
    arrays = _scaling_arrays(readout.scaling)
    arrays |= {name: np.asarray(getattr(response, name), np.float32) for name in ('profiles', 'places', 'couplings')}
    if response.unsure is not None:
        arrays['unsure'] = response.unsure.astype(np.float16)
    arrays |= {'doubt': np.asarray(readout.doubt, np.float32), 'correction': np.asarray(correction.terms, np.float32)}
    if correction.local is not None:
        arrays['local'] = np.asarray(correction.local, np.float32)
    prior = {}
    if readout.prior is not None:
        arrays['carried'] = np.asarray(readout.prior.terms, np.float32)
        prior = {'carried': list(readout.prior.presses)}
    return arrays, {
        **_said(readout.kind, readout.scaling, None),
        'lateral': response.lateral,
        'hardest_n': response.hardest_n,
        'width': response.width,
        'softness': response.softness,
        'streak': asdict(response.smear),
        'correction': {'reach_mm': correction.reach_mm, 'hardest_n': correction.hardest_n},
        'calibration': asdict(readout.calibration),
        'most_contacts': readout.most_contacts,
        **({'pressed_n': readout.pressed_n} if readout.pressed_n else {}),
        **prior,
    }


def _axisymmetric(arrays: Mapping[str, np.ndarray], said: Mapping[str, Any], bins: BinGrid) -> AxisymmetricReadout:
    _require_within(said)
    _require_within(said['correction'])
    profiles, places, couplings = (arrays[name].astype(float) for name in ('profiles', 'places', 'couplings'))
    numbers = said['hardest_n'], places, couplings, said['width'], said['softness']
    smear = RadialSmear(**said.get('streak', {}))
    unsure = arrays['unsure'].astype(float) if 'unsure' in arrays else None
    local = arrays['local'].astype(float) if 'local' in arrays else None
    prior = ErrorPrior(tuple(said['carried']), arrays['carried'].astype(float)) if 'carried' in said else None
    return AxisymmetricReadout(
        _scaling(arrays, said),
        AxisymmetricResponse(profiles, said['lateral'], *numbers, smear, unsure),
        arrays['doubt'].astype(float),
        Correction(arrays['correction'].astype(float), **said['correction'], local=local),
        bins,
        _calibration(said['calibration']),
        said['most_contacts'],
        prior,
        said.get('pressed_n', 0.0),
    )


def _field_arrays(readout: FieldReadout) -> tuple[Arrays, dict[str, Any]]:
    """Arrays of a field. 16-bit floats are precise enough for the response; the arrays of `tips` have a prefix."""
    arrays = {
        **_scaling_arrays(readout.scaling),
        'field': readout.response.astype(np.float16),
        'surface': readout.surface,
    }
    tips: dict[str, Any] = {}
    if readout.tips is not None:
        inner, said = _axisymmetric_arrays(readout.tips)
        arrays |= {TIPS + name: each for name, each in inner.items()}
        tips = {'tips': said}
    numbers = {name: getattr(readout, name) for name in (*FIELD_NUMBERS, 'passes')}
    spread = {'spread': {'response': readout.spread.response}}
    return arrays, {**_said(readout.kind, readout.scaling, None), **numbers, **spread, **tips}


def _field(arrays: Mapping[str, np.ndarray], said: Mapping[str, Any], bins: BinGrid) -> FieldReadout:
    _require_within(said)
    own = {name.removeprefix(TIPS): each for name, each in arrays.items() if name.startswith(TIPS)}
    tips = _axisymmetric(own, said['tips'], bins) if 'tips' in said else None
    numbers: dict[str, Any] = {name: float(said[name]) for name in FIELD_NUMBERS}
    response, spread = arrays['field'].astype(np.float32), FieldSpread(response=float(said['spread']['response']))
    surface = arrays.get('surface', STILL)
    return FieldReadout(
        _scaling(arrays, said), response, bins, spread=spread, tips=tips, surface=surface,
        passes=int(said.get('passes', 1)), **numbers,
    )  # fmt: skip


def _require_within(said: Mapping[str, Any]) -> None:
    for name in RANGES.keys() & said.keys():
        low, high = RANGES[name]
        if not low <= said[name] <= high:
            raise ValueError(f'{name} is {said[name]!r:.40}, but must be from {low:g} to {high:g}')


def _calibration(said: Mapping[str, Any]) -> Calibration:
    plain: dict[str, Any] = {name: tuple(each) if isinstance(each, list) else each for name, each in said.items()}
    return Calibration(**plain)


def _said(kind: str, scaling: InputScaling, likeness: Likeness | None) -> dict[str, Any]:
    limits = None if likeness is None else {'floor': likeness.floor, 'share': likeness.share}
    return {'kind': kind, 'confidence_floor': scaling.confidence_floor, 'likeness': limits}


def _scaling_arrays(scaling: InputScaling) -> Arrays:
    return {'input.mean': scaling.mean, 'input.gain': scaling.gain, 'input.trusted': scaling.trusted}


def _scaling(arrays: Mapping[str, np.ndarray], said: Mapping[str, Any]) -> InputScaling:
    return InputScaling(
        arrays['input.mean'], arrays['input.gain'], arrays['input.trusted'], float(said['confidence_floor'])
    )


def _likeness_arrays(likeness: Likeness | None) -> Arrays:
    if likeness is None:
        return {}
    return {'likeness.mean': likeness.mean, 'likeness.directions': likeness.directions}


def _likeness(arrays: Mapping[str, np.ndarray], limits: Mapping[str, float] | None) -> Likeness | None:
    if limits is None:
        return None
    return Likeness(arrays['likeness.mean'], arrays['likeness.directions'], limits['floor'], limits['share'])


def _finite(numbers: Mapping[str, float]) -> dict[str, float | None]:
    """Replace NaN by None, since JSON has no NaN."""
    return {name: value if np.isfinite(value) else None for name, value in numbers.items()}


def check_numbers(part: Any) -> None:
    """Refuse invalid numbers in `part` and its parts: a reading would fail on them later.

    Raises:
        TypeError: a value has another type.
        ValueError: a number is not finite but must be.
    """
    for field in fields(part):
        value = getattr(part, field.name)
        for number, kind in _numbers(value, str(field.type)):
            if isinstance(number, bool) or not isinstance(number, (int, float) if kind == 'float' else int):
                raise TypeError(f'{field.name} cannot be {value!r:.40}')
            if not (math.isfinite(number) or (isinstance(field.default, float) and not math.isfinite(field.default))):
                raise ValueError(f'{field.name} is {number}')
        if is_dataclass(value):
            check_numbers(value)


def _numbers(value: Any, announced: str) -> Iterator[tuple[Any, str]]:
    if announced in {'float', 'int'}:
        yield value, announced
    elif announced.startswith(('tuple[float', 'tuple[int')):
        kind = announced.removeprefix('tuple[').split(',')[0]
        if not isinstance(value, tuple | list) or not value:
            raise TypeError(f'a list of numbers cannot be {value!r:.40}')
        yield from ((each, kind) for each in value)
