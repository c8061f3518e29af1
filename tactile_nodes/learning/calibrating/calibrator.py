"""An incremental calibration: each press is measured and estimated as it comes, and the fit is renewed in between.

Presses from a running rig and from bags are treated the same. It needs no bus and no clock.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import scipy.optimize

from tactile_nodes.errors import DatasetError, ModelError
from tactile_nodes.learning.calibrating.files import require_source, transferred
from tactile_nodes.learning.datasets.recordings import RecordedPresses
from tactile_nodes.learning.field.alone import centre_of, centres
from tactile_nodes.learning.field.calibration import Pressed
from tactile_nodes.learning.progress import Progress
from tactile_nodes.learning.recorded.bags import RecordedPress
from tactile_nodes.learning.recorded.building import Builder, BuildOptions, reasons
from tactile_nodes.learning.recorded.measuring import Measurer
from tactile_nodes.learning.recorded.samples import Sample
from tactile_nodes.learning.transfer.fit import Transfer
from tactile_nodes.model_file import LoadedModel
from tactile_nodes.params import parameter
from tactile_nodes.sensing.picture.change import PictureComparison
from tactile_nodes.shapes import Float

POWERS = tuple(0.25 * step for step in range(1, 9))
"""Exponents that are tried: 0.5 is that of averaged noise, 2 that of a curve that flattens early."""
LEAST_POINTS = 3


@dataclass(frozen=True)
class Curve:
    """The error expected with n presses: floor + gain / n^power, in the unit of the errors that it was fitted to.

    With a floor of 2, a gain of 40 and a power of 1, 20 presses give 4 and 40 presses give 3.
    """

    floor: float
    gain: float
    power: float

    def at(self, presses: float) -> float:
        """The error expected with this number of presses."""
        return float(self.floor + self.gain / presses**self.power)

    def falls(self, presses: float) -> float:
        """The relative decrease of the expected error if the number of presses is doubled."""
        now = self.at(presses)
        return 1 - self.at(2 * presses) / now if now > 0 else 0.0

    @classmethod
    def fit(cls, presses: Sequence[float], errors: Sequence[float]) -> Curve | None:
        """The curve that fits measured errors best; None with fewer than three points.

        Neither the floor nor the gain is negative. Points are weighted by their relative standard error: an error
        measured on n presses is known to 1 / sqrt(2 n).
        """
        n, measured = np.asarray(presses, float), np.asarray(errors, float)
        if len(n) < LEAST_POINTS or not (measured > 0).all():
            return None
        weight = np.sqrt(2 * n) / measured
        tried = [(*_at_power(n, measured, weight, power), power) for power in POWERS]
        _, floor, gain, power = min(tried, key=lambda each: each[0])
        return cls(floor, gain, power)


def _at_power(
    n: Float[np.ndarray, ' n'], errors: Float[np.ndarray, ' n'], weight: Float[np.ndarray, ' n'], power: float
) -> tuple[float, float, float]:
    """Residual norm, floor and gain for one power."""
    design = np.column_stack([np.ones_like(n), n**-power])
    (floor, gain), left = scipy.optimize.nnls(design * weight[:, None], errors * weight)
    return float(left), float(floor), float(gain)


UNTOUCHED = 0.5
"""One image of the untouched gel for each press: they give the new gel's own mean and noise at rest."""
GROWTH = 1.25
"""The fit is renewed after a quarter more presses, so that its points lie evenly on the curve."""


@dataclass(frozen=True)
class StopRule:
    """When to stop: if twice as many presses are expected to lower the held-out errors by little."""

    least: int = parameter(30, 'least number of presses', minimum=5)
    most: int = parameter(100, 'greatest number of presses', minimum=5)
    worth: float = parameter(
        0.1, 'go on while twice the presses are expected to lower an error by this share', minimum=0.0
    )
    agree: int = parameter(3, 'fits in a row that must expect less, to end', minimum=1)
    first: int = parameter(5, 'presses after which the first fit is tried', minimum=5)

    def reason(self, presses: int, fits: Sequence[Fitted]) -> str:
        """Why this number of presses is enough, by the fits so far; empty if it is not."""
        if presses >= self.most:
            return f'the greatest number of {presses} presses is reached'
        if presses < self.least or len(fits) < self.agree:
            return ''
        gains = [expected_gain(fits[: len(fits) - back]) for back in range(self.agree)]
        if max(gains) >= self.worth:
            return ''
        return (
            f'twice the presses are expected to lower the errors by at most {100 * gains[0]:.0f} %, less than the '
            f'required {100 * self.worth:.0f} %'
        )


@dataclass(frozen=True)
class Fitted:
    """One renewal of the fit: held-out errors (medians) with this number of presses."""

    presses: int
    force_n: float
    place_mm: float


def curves(fits: Sequence[Fitted]) -> tuple[Curve, Curve] | None:
    """Error of force (N) and place (mm) over presses; None while there are too few fits."""
    presses = [point.presses for point in fits]
    force = Curve.fit(presses, [point.force_n for point in fits])
    place = Curve.fit(presses, [point.place_mm for point in fits])
    return (force, place) if force and place else None


def expected_gain(fits: Sequence[Fitted]) -> float:
    """Expected relative decrease of the error with twice as many presses: of force or place, whichever is larger."""
    found = curves(fits)
    return 1.0 if found is None else max(curve.falls(fits[-1].presses) for curve in found)


@dataclass(frozen=True)
class Reading:
    """The error of one press: force in N, place in mm; NaN if it cannot be estimated."""

    off_n: float
    off_mm: float


@dataclass(frozen=True)
class PressRead:
    """A press, estimated before any fit has seen it: without calibration, and with the present one, if any."""

    number: int
    force_n: float
    before: Reading
    after: Reading | None


class Calibrator:
    """Takes presses in their order; `calibration` is the one so far, `objection` says why there is none.

    `left_out` says why the last unusable press cannot be used. `live_rest` is the rest image of the running sensor, if
    there is one.

    Args:
        loaded: the model to begin with.
        gel: what is known of the gel, at least its id.
        rule: when to stop.
        progress: shown during a fit.
        pressed: the pressing body, if the model does not name it.
        forced: accept a calibration that is no better on held-out presses than the model, or than their mean.
        curve: whether a fit of the force field alone also reports errors with fewer presses.

    Raises:
        ModelError: the model is a calibration for this gel already.
        DatasetError: the cache of features cannot be used.
    """

    def __init__(
        self,
        loaded: LoadedModel,
        gel: Mapping[str, Any],
        rule: StopRule | None = None,
        progress: Progress | None = None,
        pressed: Pressed | None = None,
        *,
        forced: bool = False,
        curve: bool = False,
    ) -> None:
        require_source(loaded, str(gel['id']))
        self.loaded, self.gel, self.rule, self.progress = loaded, dict(gel), rule or StopRule(), progress
        self._centre = centres(loaded, pressed or Pressed())
        self.pressed, self.forced, self.curve = pressed, forced, curve
        options = replace(BuildOptions.of_model(loaded, frames='each'), gel=self.gel, without_contact=UNTOUCHED)
        self._measurer = Measurer(options.flow, options.encoding, options.crop)
        self._builder = Builder(options, self._measurer)
        self._rest: PictureComparison | None = None
        self._rests: set[str] = set()
        self.live_rest: np.ndarray | None = None
        self._live_rest_seen: np.ndarray | None = None
        self.asked_to_finish = False
        self.read: list[PressRead] = []
        self.fits: list[Fitted] = []
        self._fitted = b''
        self.calibration: Transfer | None = None
        self.recordings: RecordedPresses | None = None
        self.objection = 'no fit was tried yet'
        self.left_out = ''
        self._next = self.rule.first

    @property
    def presses(self) -> int:
        """The number of usable presses so far."""
        return self._builder.presses

    @property
    def all_left_out(self) -> str:
        """The number of attempts left out for each reason, as text; empty if there are none."""
        return reasons(self._builder.left_out) if self._builder.left_out else ''

    def take(self, press: RecordedPress, bag: int = 0) -> PressRead | None:
        """Measure and estimate one press with the present fit; None if it cannot be used (see `left_out`).

        Raises:
            DatasetError: it shows another gel than earlier presses.
            ModelError: its image has another size than the model needs.
        """
        left_out_before = len(self._builder.left_out)
        samples = [sample for sample in self._builder.take(bag, press) if sample.contact]
        if not samples:
            out = self._builder.left_out[left_out_before:]
            why = f'{out[-1].reason} ({out[-1].detail})' if out else press.message.reason
            self.left_out = f'press {press.message.press}: {why}'
            return None
        self._require_fitting(press, samples[0].reference_id)
        self.require_live_gel()
        sample = samples[0]
        before = self._reading(self.loaded.model.readout, sample)
        after = self._reading(self.calibration.readout, sample) if self.calibration else None
        self.read.append(PressRead(self.presses, sample.force_n, before, after))
        return self.read[-1]

    def require_gel(self, picture: np.ndarray, name: str) -> None:
        """Refuse an image that shows another gel than the presses.

        Raises:
            DatasetError: says so.
            ImageError: the image has another size than the rest images of the presses.
        """
        if self._rest is not None and not self._rest.of(picture).same:
            raise DatasetError(
                f'{name} shows other markers than the rest image of the first press: it is another gel, or the camera '
                'was moved far; calibrate each gel with its own presses'
            )

    @property
    def due(self) -> bool:
        """Whether the fit should be renewed now."""
        return self.presses >= self._next

    def fit(self, entries: Sequence[Mapping[str, Any]], bags: Sequence[Path] = (), command: str = '') -> None:
        """Renew the calibration if its presses have changed; `objection` then says what speaks against it.

        Args:
            entries: the card's entry for each bag.
            bags: their paths.
            command: the command line.
        """
        self._next = max(self.presses + 5, math.ceil(GROWTH * self.presses))
        try:
            self.recordings = self._builder.recordings(entries, bags, command=command)
            attempts = _attempts(self.recordings)
            if self.calibration is None or attempts != self._fitted:
                self.calibration = transferred(
                    self.loaded, self.recordings, self.progress, self.pressed, forced=self.forced, curve=self.curve
                )
                self.objection = ''
                after, self._fitted = self.calibration.after, attempts
                self.fits.append(Fitted(self.presses, after.force_median_n, after.place_median_mm))
        except DatasetError as error:
            self.calibration, self.objection = None, str(error)

    @property
    def enough(self) -> str:
        """Why no more presses are needed; empty while they are."""
        if self.asked_to_finish:
            return 'asked to finish'
        return self.rule.reason(self.presses, self.fits if self.calibration else [])

    def close(self) -> None:
        """Save the measurements."""
        self._measurer.close()

    def _reading(self, readout: Any, sample: Sample) -> Reading:
        found = readout.read(sample.features.astype(np.float32), self._builder.shelf.confidence(sample))
        (right, down), (x_mm, y_mm) = self._centre(sample.force_n, sample.indenter), sample.position_mm
        x, y, force_n = centre_of(found.contacts)
        return Reading(force_n - sample.force_n, math.hypot(x - x_mm - right, y - y_mm - down))

    def _require_fitting(self, press: RecordedPress, reference: str) -> None:
        assert press.reference is not None  # otherwise it could not have been measured
        came, needed = (f'{width}x{height}' for width, height in (self._measurer.size, self.loaded.image_size))
        if came != needed:
            raise ModelError(
                f'the images of the presses have {came} pixels, but model {self.loaded.model_id} needs {needed}; set '
                'the camera as the model needs it'
            )
        if reference in self._rests:
            return
        if self._rest is None:
            self._rest = PictureComparison(press.reference.image)
        self.require_gel(press.reference.image, f'the rest image of press {press.message.press}')
        self._rests.add(reference)

    def require_live_gel(self) -> None:
        """Refuse presses on another gel than the running sensor sees, once its rest image has arrived.

        Raises:
            DatasetError: says so.
        """
        picture = self.live_rest  # another thread may replace it during the comparison
        if self._rest is not None and picture is not None and picture is not self._live_rest_seen:
            self.require_gel(picture, 'the running sensor')
            self._live_rest_seen = picture


def _attempts(recordings: RecordedPresses) -> bytes:
    """A key of the presses' attempts. It can change at the same number of presses: a later attempt may replace one."""
    each = recordings
    return np.column_stack([each.bag, each.plan, each.press, each.attempt, each.window_ns]).tobytes()
