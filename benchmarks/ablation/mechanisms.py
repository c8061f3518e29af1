"""The mechanisms of sensing and learning, and how each is switched off alone.

A switch replaces a part of the package temporarily, so the package itself needs no option for it. Mechanisms that were
removed are no longer here, but still in the stored result.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from tactile_nodes.model_file import LoadedModel, load_model

PACKAGE, PIPELINE = 'tactile_nodes', 'tactile_nodes.pipeline'
SENSING, LEARNING, EXPLAIN = f'{PACKAGE}.sensing', f'{PACKAGE}.learning', f'{PACKAGE}.sensing.explain'
SMEAR = f'{EXPLAIN}.axisymmetric.radial_smear:RadialSmear'
Switch = Callable[[], AbstractContextManager[Any]]

CORE = 'none', 'blur 1', 'noise 4', 'brightness 0.7', 'camera shifted 1', 'markers gone 20'
"""Streams of the stability benchmark with which every mechanism of picture processing is tested."""


@dataclass(frozen=True)
class Mechanism:
    """One mechanism: its purpose, its files (relative to the package's folder), and its switch.

    `profiles` process the `streams` of the stability benchmark; `field` estimates `contacts`; `transfer` calibrates
    `portable` for other gels. `stays` is the reason to keep it if no figure here needs it.
    """

    name: str
    does: str
    files: tuple[str, ...]
    off: Switch
    streams: tuple[str, ...] = ()
    profiles: tuple[str, ...] = ('fast', 'field')
    contacts: bool = False
    transfer: bool = False
    stays: str = ''

    def lines(self, root: Path) -> int:
        """Number of lines in its files, including those of compiled variants."""
        return sum(len((root / PACKAGE / each).read_text(encoding='utf-8').splitlines()) for each in self.files)


def instead(place: str, made: Any) -> Switch:
    """A switch that replaces `place`, a module and a name in it: 'package.module:Class.method'."""
    module, _, name = place.partition(':')

    def switch() -> AbstractContextManager[Any]:
        return patch(f'{module}.{name}', made)

    return switch


def all_of(*switches: Switch) -> Switch:
    """A switch for several switches at once."""

    @contextmanager
    def switch() -> Iterator[None]:
        with ExitStack() as stack:
            for each in switches:
                stack.enter_context(each())
            yield

    return switch


def without(change: Callable[[Any], Any]) -> Switch:
    """A switch that changes the readout of every model when it is loaded."""

    def read(path: Path) -> LoadedModel:
        loaded = load_model(path)
        return dataclasses.replace(
            loaded, model=dataclasses.replace(loaded.model, readout=change(loaded.model.readout))
        )

    return all_of(*(instead(f'{PIPELINE}.{module}:load_model', read) for module in ('methods', 'ready_model')))


def _first(*given: Any, **_: Any) -> Any:
    """The first argument."""
    return given[0]


def _never(*_: Any, **__: Any) -> bool:
    return False


def _uncalibrated(self: Any, _: Any) -> Any:
    """A zero polynomial, so that nothing is added to the linear estimates."""
    return np.zeros((2, 9, len(self._basis)), np.float32)


def _nothing(*_: Any, **__: Any) -> None:
    return None


def _field(readout: Any, **changes: Any) -> Any:
    return dataclasses.replace(readout, **changes) if readout.kind == 'field' else readout


def _without_check(readout: Any) -> Any:
    return dataclasses.replace(readout, novelty_check=None) if readout.kind == 'network' else readout


def _tips(change: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """Apply a change to the readout of tips: `portable`, or the tips of `field`."""

    def changed(readout: Any) -> Any:
        if readout.kind == 'field':
            return dataclasses.replace(readout, tips=change(readout.tips))
        return change(readout) if readout.kind == 'axisymmetric' else readout

    return changed


def _uncorrected(tips: Any) -> Any:
    none = dataclasses.replace(tips.correction, terms=np.zeros_like(tips.correction.terms), local=None)
    return dataclasses.replace(tips, correction=none)


def _of_one_contact(readout: Any) -> Any:
    return dataclasses.replace(readout, most_contacts=1) if readout.kind in ('response', 'axisymmetric') else readout


def _by_noise_alone() -> AbstractContextManager[Any]:
    from tactile_nodes.sensing.explain.field import solver

    def weights(motion: np.ndarray, confidence: np.ndarray, noise_px: float, doubt: float) -> np.ndarray:
        even: np.ndarray = 1 / (noise_px**2 + doubt**2 * np.square(motion).sum(axis=-1))
        found: np.ndarray = np.where(confidence < 0.1, 1e-3, 1.0)
        return np.asarray(found * even)

    return patch.object(solver, 'region_weights', weights)


MECHANISMS = (
    Mechanism(
        'look at stillness', 'skips the measurement of motion in frames in which nothing touches',
        ('sensing/picture/stillness.py', 'sensing/picture/touch_places.py', 'sensing/loops/stillness.py'),
        instead(f'{PIPELINE}.following:stillness_options', _nothing), CORE,
    ),
    Mechanism(
        'registration', 'removes the motion of the whole picture',
        ('sensing/picture/registration.py', 'sensing/picture/knocks.py', 'sensing/picture/motion.py',
         'sensing/picture/quietness.py'),
        instead(f'{PIPELINE}.following:Registration', _nothing),
        (*CORE, 'camera shifted 3', 'camera turned 1', 'gel re-seated 1'),
    ),
    Mechanism(
        'rest image taken anew', 'renews the rest image if light or sharpness changed, while nothing touches',
        ('sensing/rest/renewal.py', 'sensing/rest/coming.py', 'sensing/rest/prepared.py'),
        instead(f'{PIPELINE}.rest_images:_offer_renewal', _nothing),
        (*CORE, 'brightness 1.3', 'gel re-seated 1', 'dirt on the lens 10'),
    ),
    Mechanism(
        'a new rest image refined', 'averages a new rest image over more frames at rest',
        (), instead(f'{SENSING}.rest.renewal:Renewal._refined', _nothing),
        ('none', 'blur 1', 'brightness 0.7', 'markers gone 20', 'gel re-seated 1', 'camera shifted 1'),
    ),
    Mechanism(
        'what patches are off by after a knock',
        'averages the offset of each patch over the first frames at rest, and subtracts it',
        (), instead(f'{SENSING}.picture.registration:Registration._take_offset', _nothing),
        ('none', 'camera shifted 1', 'camera turned 1', 'gel re-seated 0.1', 'gel swollen 0.1'),
    ),
    Mechanism(
        'calibrated patches', 'corrects the linear estimate of each patch with a polynomial',
        (), instead(f'{SENSING}.flow.patches:Templates._calibrated', _uncalibrated),
        ('none', 'camera shifted 1'), contacts=True,
    ),
    Mechanism(
        'dead pixels', 'replaces dead pixels by their neighbours',
        ('sensing/picture/dead_pixels.py',),
        all_of(
            instead(f'{SENSING}.picture.dead_pixels:DeadPixels.look', _never),
            instead(f'{SENSING}.picture.dead_pixels:DeadPixels.captured', lambda _, image: image),
        ),
        ('none', 'lost pixels 0.1', 'stuck pixels 0.1'),
    ),
    Mechanism(
        'rolling bands', 'removes bands from the picture',
        ('sensing/picture/rolling_bands.py',),
        instead(f'{PIPELINE}.measure:_bands_begin', _never),
        ('none', 'rolling bands 3', 'rolling bands 30'),
    ),
    Mechanism(
        'dented rest image', 'detects a dented rest image from the motion in the first frames after it',
        ('sensing/picture/dented_rest.py',),
        instead(f'{SENSING}.picture.dented_rest:DentedRest._take', _nothing),
        ('none', 'taken while touched 0.1', 'taken while touched 0.3', 'touched in its first frames 2'),
    ),
    Mechanism(
        'width of a contact, and drag', 'raises the uncertainty of contacts that are wider than usual or drag the skin',
        ('sensing/explain/measured/contact_shape.py', 'sensing/loops/shape.py'),
        all_of(
            instead(f'{EXPLAIN}.measured.readout:with_usual_width', lambda _, fit, __: fit),
            instead(f'{EXPLAIN}.measured.readout:in_doubt', lambda fit, *__: np.zeros((len(fit.contacts), 3))),
        ),
        ('none', 'dragged 0.3', 'dragged 1', 'ball of 6 mm 1', 'flat punch of 3 mm 1', 'camera shifted 1'),
        ('fast',),
    ),
    Mechanism(
        'witness of the network', 'compares the network with a response that was fitted to the same presses',
        ('sensing/explain/novelty_check.py', 'learning/network/novelty_check_fit.py'),
        without(_without_check),
        (*CORE, 'two contacts 7', 'ball of 6 mm 1', 'deeper than trained 2.5'), ('paper',),
    ),
    Mechanism(
        "the network's own novelty",
        'the part of the input that the principal directions of the training do not explain',
        ('sensing/explain/likeness.py',),
        without(lambda readout: dataclasses.replace(readout, likeness=None) if readout.kind == 'network' else readout),
        (*CORE, 'two contacts 7', 'ball of 6 mm 1', 'deeper than trained 2.5'), ('paper',),
        stays='the only novelty check of a network that is calibrated for another gel',
    ),
    Mechanism(
        'second and third tip', 'fits two or three tips if one leaves a large residual',
        (), without(_of_one_contact), ('none', 'two contacts 7', 'two contacts 14'), ('fast', 'portable'),
    ),
    Mechanism(
        'correction of tips',
        'corrects by a polynomial of place and force, and by the residuals at calibration presses',
        ('sensing/explain/axisymmetric/correction.py',), without(_tips(_uncorrected)), ('none',), ('portable', 'field'),
    ),
    Mechanism(
        'drift monitor', 'puts changes since the calibration into the status',
        ('sensing/judge/drift.py', 'sensing/judge/drift_verdict.py', 'sensing/judge/drift_alarm.py'),
        instead('benchmarks.stability.chain:calibration_reasons', lambda _: 0),
        ('none', 'gel swollen 0.3', 'gel re-seated 1', 'another gel put in 1'),
        stays='it detects a gel that stiffens or wears over weeks, longer than these streams: results/drift.md',
    ),
    Mechanism(
        'tips within the field', 'explains one to three tips by their own response',
        ('sensing/explain/axisymmetric/readout.py', 'sensing/explain/axisymmetric/response.py'),
        without(lambda readout: _field(readout, tips=None)), CORE, ('field',), contacts=True,
    ),
    Mechanism(
        'forces where the surface is now', 'moves forces along with the surface under shear',
        ('sensing/explain/field/where_now.py',),
        instead(f'{EXPLAIN}.field.sums:moved_along', _first), (), ('field',), contacts=True,
    ),
    Mechanism(
        'weights by what is explained', 'reduces the weight of regions whose pattern changes',
        (), _by_noise_alone, ('none', 'blur 1', 'noise 4'), ('field',), contacts=True,
    ),
    Mechanism(
        "the camera's motion in the field", "estimates the camera's motion together with the forces",
        (), instead(f'{EXPLAIN}.field.weights:CAMERA_PX', 1e-6), ('none', 'camera shifted 1', 'camera turned 1'),
        ('field',), contacts=True,
    ),
    Mechanism(
        'patches held down', 'adds a reweighted l1 regularization',
        (), instead(f'{EXPLAIN}.field.solver:HELD', 0.0), (), ('field',), contacts=True,
    ),
    Mechanism(
        'refinement of the field', 'moves solved forces to where they act, by a network',
        ('sensing/explain/field/refinement.py', 'learning/field/refining.py', 'learning/field/refinement_fit.py',
         'learning/field/random_touches.py', 'simulation/touch/random_bodies.py'),
        without(lambda readout: _field(readout, refinement=None)), CORE, ('field',), contacts=True,
    ),
    Mechanism(
        'smear of the markers', 'models that regions with an oblique view see a press at a shifted place',
        ('sensing/explain/axisymmetric/radial_smear.py',),
        all_of(
            instead(f'{SMEAR}.shown', lambda _, away, __: away),
            instead(f'{SMEAR}.slopes', lambda _, away, __: np.zeros_like(away)),
        ),
        transfer=True,
    ),
    Mechanism(
        'prior of the errors', 'subtracts errors that calibrations of other gels have in common',
        ('sensing/explain/axisymmetric/prior.py', 'learning/transfer/prior.py'),
        without(_tips(lambda tips: dataclasses.replace(tips, prior=None))), transfer=True,
    ),
    Mechanism(
        'covariance of the regions', 'weights each region by the covariance of its parameters',
        ('learning/axisymmetric/unsure.py',),
        instead(f'{LEARNING}.transfer.fit:with_unsure', _first), transfer=True,
    ),
    Mechanism(
        'residuals at own presses',
        'interpolates residuals at the calibration presses over the surface, and subtracts them',
        ('learning/axisymmetric/local.py', 'sensing/explain/axisymmetric/correction.py'),
        instead(f'{LEARNING}.transfer.fit:with_local', _first), transfer=True,
        stays='over ten gels with 100 presses each, the place error is 11 % larger without it',
    ),
)  # fmt: skip
"""In the order in which a picture passes them; then those of learning."""

BY_NAME = {each.name: each for each in MECHANISMS}
