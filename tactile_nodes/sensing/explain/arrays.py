"""Conversion of readouts to and from named arrays and plain numbers, as in a model file."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, fields, is_dataclass
from typing import Any

import numpy as np

from tactile_nodes.sensing.elasticity.patches import PatchGrid
from tactile_nodes.sensing.explain.axisymmetric.by_sides import BySides
from tactile_nodes.sensing.explain.axisymmetric.correction import Correction
from tactile_nodes.sensing.explain.axisymmetric.prior import ErrorPrior
from tactile_nodes.sensing.explain.axisymmetric.radial_smear import RadialSmear
from tactile_nodes.sensing.explain.axisymmetric.readout import AxisymmetricReadout
from tactile_nodes.sensing.explain.axisymmetric.response import AxisymmetricResponse
from tactile_nodes.sensing.explain.field.readout import STILL, FieldReadout
from tactile_nodes.sensing.explain.field.refinement import INPUTS, KEPT, Refinement
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
NOVELTY_CHECK, TIPS, REFINEMENT = 'witness.', 'tips.', 'refinement.'
LIMITS = 'total_limits'
LAYER = 'kernel', 'bias'
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
        parts = _network_arrays(readout)
    elif isinstance(readout, ResponseReadout):
        parts = _response_arrays(readout)
    elif isinstance(readout, FieldReadout):
        parts = _field_arrays(readout)
    else:
        parts = _axisymmetric_arrays(readout)
    return {name: np.ascontiguousarray(array) for name, array in parts[0].items()}, parts[1]


def readout_from(arrays: Mapping[str, np.ndarray], entries: Mapping[str, Any], bins: BinGrid) -> AnyReadout:
    """The inverse of `readout_arrays`.

    Raises:
        KeyError, TypeError, ValueError: a part is missing or invalid.
    """
    readout: AnyReadout
    if entries['kind'] == NetworkReadout.kind:
        readout = _network(arrays, entries, bins)
    elif entries['kind'] == FieldReadout.kind:
        readout = _field(arrays, entries, bins)
    else:
        readout = (_response if entries['kind'] == ResponseReadout.kind else _axisymmetric)(arrays, entries, bins)
    check_numbers(readout)
    return readout


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
    check_arrays, check_entries = _novelty_check_arrays(readout.novelty_check)
    return arrays | check_arrays, {
        **_entries(readout.kind, readout.scaling, readout.likeness),
        'sizes': list(readout.network.sizes),
        'hidden': readout.network.hidden,
        'output': 'identity',
        'output_scale_n': readout.output_scale_n,
        'spread': _finite(asdict(readout.spread)),
        **({'calibration_layer': 'relu'} if readout.layer else {}),
        **check_entries,
    }


def _novelty_check_arrays(check: Readout | None) -> tuple[Arrays, dict[str, Any]]:
    """Arrays of a novelty check, under their own prefix; files of networks without one stay as before."""
    if not isinstance(check, NoveltyCheck):
        return {}, {}
    arrays, entries = _response_arrays(check.readout)
    return {NOVELTY_CHECK + name: each for name, each in arrays.items()}, {
        'witness': entries | {'encoding': check.encoding}
    }


def _novelty_check(
    arrays: Mapping[str, np.ndarray], entries: Mapping[str, Any] | None, bins: BinGrid
) -> NoveltyCheck | None:
    if entries is None:
        return None
    own = {name.removeprefix(NOVELTY_CHECK): each for name, each in arrays.items() if name.startswith(NOVELTY_CHECK)}
    return NoveltyCheck(_response(own, entries, bins), entries['encoding'])


def _network(arrays: Mapping[str, np.ndarray], entries: Mapping[str, Any], bins: BinGrid) -> NetworkReadout:
    layers = range(len(entries['sizes']) - 1)
    network = Mlp(
        tuple(arrays[f'layer{i}.weight'].astype(np.float32) for i in layers),
        tuple(arrays[f'layer{i}.bias'] for i in layers),
        _known_activation(entries['hidden']),
    )
    spread = TotalSpread(**{name: value for name, value in entries['spread'].items() if value is not None})
    likeness = _likeness(arrays, entries['likeness'])
    layer = None
    if 'calibration_layer' in entries:
        layer = CalibrationLayer.of_change(arrays['calibration.change'], arrays['calibration.bias'])
    novelty_check = _novelty_check(arrays, entries.get('witness'), bins)
    return NetworkReadout(
        _scaling(arrays, entries), network, bins, entries['output_scale_n'], spread, likeness, layer, novelty_check
    )


def _response_arrays(readout: ResponseReadout) -> tuple[Arrays, dict[str, Any]]:
    response = readout.response
    arrays = _scaling_arrays(readout.scaling) | _likeness_arrays(readout.likeness)
    arrays |= {'whitening': readout.whitening, 'coefficients': response.coefficients, 'growth': response.growth}
    limits = {} if readout.most_shift_gain == math.inf else {'most_shift_gain': readout.most_shift_gain}
    return arrays, {
        **_entries(readout.kind, readout.scaling, readout.likeness),
        'axes': [asdict(axis) for axis in response.axes],
        'calibration': asdict(readout.calibration),
        'most_contacts': readout.most_contacts,
        **limits,
    }


def _most_shift_gain(entries: Mapping[str, Any]) -> float:
    """The limit of a drag; files of earlier releases hold it in another form, equal to within a tenth."""
    return float(entries.get('most_shift_gain', entries.get('drag', {}).get('least_gain', math.inf)))


def _response(arrays: Mapping[str, np.ndarray], entries: Mapping[str, Any], bins: BinGrid) -> ResponseReadout:
    x, y, s = (SplineAxis(**axis) for axis in entries['axes'])
    likeness = _likeness(arrays, entries['likeness'])
    if likeness is None:
        raise KeyError('likeness.directions')
    if entries.get('power', 1) != 1:
        raise ValueError('a response over another power of the force is no longer supported; train it again')
    return ResponseReadout(
        _scaling(arrays, entries),
        likeness,
        arrays['whitening'],
        Response(x, y, s, arrays['coefficients'], arrays['growth']),
        bins,
        _calibration(entries['calibration']),
        entries['most_contacts'],
        _most_shift_gain(entries),
    )


def _axisymmetric_arrays(readout: AxisymmetricReadout) -> tuple[Arrays, dict[str, Any]]:
    response, correction = readout.response, readout.correction
    arrays = _scaling_arrays(readout.scaling)
    arrays |= {name: np.asarray(getattr(response, name), np.float32) for name in ('profiles', 'places', 'couplings')}
    if response.unsure is not None:
        arrays['unsure'] = response.unsure.astype(np.float16)
    if response.sides is not None:
        arrays['sides'] = response.sides.per_n.astype(np.float16)
    arrays |= {'doubt': np.asarray(readout.doubt, np.float32), 'correction': np.asarray(correction.terms, np.float32)}
    if correction.local is not None:
        arrays['local'] = np.asarray(correction.local, np.float32)
    prior = {}
    if readout.prior is not None:
        arrays['carried'] = np.asarray(readout.prior.terms, np.float32)
        prior = {'carried': list(readout.prior.presses)}
    return arrays, {
        **_entries(readout.kind, readout.scaling, None),
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


def _axisymmetric(arrays: Mapping[str, np.ndarray], entries: Mapping[str, Any], bins: BinGrid) -> AxisymmetricReadout:
    _require_within(entries)
    _require_within(entries['correction'])
    profiles, places, couplings = (arrays[name].astype(float) for name in ('profiles', 'places', 'couplings'))
    numbers = entries['hardest_n'], places, couplings, entries['width'], entries['softness']
    smear = RadialSmear(**entries.get('streak', {}))
    unsure = arrays['unsure'].astype(float) if 'unsure' in arrays else None
    sides = BySides(PatchGrid(bins), arrays['sides'].astype(np.float32)) if 'sides' in arrays else None
    local = arrays['local'].astype(float) if 'local' in arrays else None
    prior = ErrorPrior(tuple(entries['carried']), arrays['carried'].astype(float)) if 'carried' in entries else None
    return AxisymmetricReadout(
        _scaling(arrays, entries),
        AxisymmetricResponse(profiles, entries['lateral'], *numbers, smear, unsure, sides),
        arrays['doubt'].astype(float),
        Correction(arrays['correction'].astype(float), **entries['correction'], local=local),
        bins,
        _calibration(entries['calibration']),
        entries['most_contacts'],
        prior,
        entries.get('pressed_n', 0.0),
    )


def _field_arrays(readout: FieldReadout) -> tuple[Arrays, dict[str, Any]]:
    """Arrays of a field. 16-bit floats are precise enough for the response; the arrays of `tips` have a prefix."""
    arrays = {
        **_scaling_arrays(readout.scaling),
        'field': readout.response.astype(np.float16),
        'surface': readout.surface,
    }
    parts: dict[str, Any] = {}
    if readout.tips is not None:
        inner, entries = _axisymmetric_arrays(readout.tips)
        arrays |= {TIPS + name: each for name, each in inner.items()}
        parts['tips'] = entries
    if readout.refinement is not None:
        parts[LIMITS] = list(readout.refinement.limits)
        layers = zip(readout.refinement.kernels, readout.refinement.biases, strict=True)
        for number, (kernel, bias) in enumerate(layers):
            arrays |= {f'{REFINEMENT}{number}.kernel': kernel, f'{REFINEMENT}{number}.bias': bias}
    numbers = {name: getattr(readout, name) for name in (*FIELD_NUMBERS, 'passes')}
    spread = {'spread': {'response': readout.spread.response, 'place_mm': readout.spread.place[1]}}
    return arrays, {**_entries(readout.kind, readout.scaling, None), **numbers, **spread, **parts}


def _field(arrays: Mapping[str, np.ndarray], entries: Mapping[str, Any], bins: BinGrid) -> FieldReadout:
    _require_within(entries)
    own = {name.removeprefix(TIPS): each for name, each in arrays.items() if name.startswith(TIPS)}
    tips = _axisymmetric(own, entries['tips'], bins) if 'tips' in entries else None
    numbers: dict[str, Any] = {name: float(entries[name]) for name in FIELD_NUMBERS}
    response, surface = arrays['field'].astype(np.float32), arrays.get('surface', STILL)
    known = {'place_mm': 0.0, **entries['spread']}  # older models have no place
    spread = FieldSpread(response=float(known['response'])).placed(float(known['place_mm']))
    return FieldReadout(
        _scaling(arrays, entries), response, bins, spread=spread, tips=tips, surface=surface,
        passes=int(entries.get('passes', 1)), refinement=_refinement(arrays, entries), **numbers,
    )  # fmt: skip


def _refinement(arrays: Mapping[str, np.ndarray], entries: Mapping[str, Any]) -> Refinement | None:
    """The refinement of a field; None if it has none, as older models."""
    count = sum(name.startswith(REFINEMENT) for name in arrays) // 2
    if not count:
        return None
    parts = ([arrays[f'{REFINEMENT}{k}.{part}'].astype(np.float32) for k in range(count)] for part in LAYER)
    kernels, biases = (tuple(each) for each in parts)
    inputs = [INPUTS, *(len(each) for each in kernels)]
    fits = all(each.shape[1:] == (inputs[k], 3, 3) for k, each in enumerate(kernels))
    if not fits or inputs[-1] != 3 or any(each.shape != (len(kernels[k]),) for k, each in enumerate(biases)):
        raise ValueError('the layers of the refinement do not fit each other')
    least, most = map(float, entries.get(LIMITS, KEPT))
    if not 0 < least <= most < math.inf:
        raise ValueError(f'{LIMITS} of the refinement must be positive and in order, not {least:g} and {most:g}')
    return Refinement(kernels, biases, (least, most))


def _require_within(entries: Mapping[str, Any]) -> None:
    for name in RANGES.keys() & entries.keys():
        low, high = RANGES[name]
        if not low <= entries[name] <= high:
            raise ValueError(f'{name} is {entries[name]!r:.40}, but must be from {low:g} to {high:g}')


def _calibration(entries: Mapping[str, Any]) -> Calibration:
    plain: dict[str, Any] = {name: tuple(each) if isinstance(each, list) else each for name, each in entries.items()}
    return Calibration(**plain)


def _entries(kind: str, scaling: InputScaling, likeness: Likeness | None) -> dict[str, Any]:
    limits = None if likeness is None else {'floor': likeness.floor, 'share': likeness.share}
    return {'kind': kind, 'confidence_floor': scaling.confidence_floor, 'likeness': limits}


def _scaling_arrays(scaling: InputScaling) -> Arrays:
    return {'input.mean': scaling.mean, 'input.gain': scaling.gain, 'input.trusted': scaling.trusted}


def _scaling(arrays: Mapping[str, np.ndarray], entries: Mapping[str, Any]) -> InputScaling:
    return InputScaling(
        arrays['input.mean'], arrays['input.gain'], arrays['input.trusted'], float(entries['confidence_floor'])
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
