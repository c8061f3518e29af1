"""The verdict of the drift monitor: a level, its reasons, the numbers behind them, and advice as text."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntFlag

from tactile_nodes.sensing.judge.drift_alarm import Level
from tactile_nodes.sensing.judge.force_check import ForceRatio
from tactile_nodes.sensing.picture.change import PictureChange


class Reason(IntFlag):
    """Why a calibration is not fully valid; the bits of CalibrationState.reasons."""

    PICTURE_MOVED = 1
    MOVED_SINCE_CALIBRATION = 2
    LIGHT = 4
    LOST_REGIONS = 8
    OTHER_GEL = 16
    UNLIKE_CONTACTS = 32
    FORCE_RATIO = 64
    DENTED_REST = 128


@dataclass(frozen=True)
class Verdict:
    """The level, its reasons and the numbers behind them (None or NaN: not known yet).

    `since_rest` compares the last picture with the rest image, `since_calibration` the rest image with that of the
    calibration. `moved_px` and `lost` are the medians that were judged. `other_since_calibration`: the rest image
    shows another gel, not the pictures since. `quiet_ns` is the last stamp at which nothing touched the gel.
    """

    level: Level
    reasons: Reason
    since_rest: PictureChange | None
    since_calibration: PictureChange | None
    moved_px: float
    lost: float
    other_since_calibration: bool
    ratio: ForceRatio | None
    unlike_share: float
    quiet_ns: int | None
    calibrated: bool = True
    """Whether there is a calibration. Without one the model follows from a description alone."""

    @property
    def uncalibrated(self) -> bool:
        """Whether there is no calibration and nothing else is wrong."""
        return not self.calibrated and self.level is Level.VALID

    @property
    def sentences(self) -> tuple[str, ...]:
        """What is wrong and what to do, one sentence per reason."""
        sentence_of = {
            Reason.PICTURE_MOVED: self._picture_moved,
            Reason.MOVED_SINCE_CALIBRATION: self._moved_since_calibration,
            Reason.LIGHT: self._light,
            Reason.LOST_REGIONS: self._lost_regions,
            Reason.OTHER_GEL: self._other_gel,
            Reason.UNLIKE_CONTACTS: self._unlike_contacts,
            Reason.FORCE_RATIO: self._force_ratio,
            Reason.DENTED_REST: self._dented_rest,
        }
        return tuple(sentence() for reason, sentence in sentence_of.items() if reason in self.reasons)

    @property
    def text(self) -> str:
        """In one line, the level first."""
        if self.uncalibrated:
            return 'not calibrated: the model was made from a description; calibrate it with a few known forces'
        return ': '.join(each for each in (self.level.name.lower(), '; '.join(self.sentences)) if each)

    def _picture_moved(self) -> str:
        return (
            f'the image moved by {self.moved_px:.2g} px since the rest image was captured; fasten the camera and '
            'capture the rest image again with nothing on the gel'
        )

    def _moved_since_calibration(self) -> str:
        change = self.since_calibration
        assert change is not None
        right, down = change.shift_px
        return (
            f'the rest image is {change.size_px:.2g} px off that of the calibration (right {right:+.2f}, down '
            f'{down:+.2f} px, turned {change.turn_deg:+.2f} degrees, scaled by {1 + change.growth:.4f}); put the '
            'camera back or calibrate again'
        )

    def _light(self) -> str:
        contrast = math.nan if self.since_rest is None else self.since_rest.contrast
        return f'markers have {contrast:.0%} of the contrast that they had in the rest image; check the light'

    def _lost_regions(self) -> str:
        return f'{self.lost:.0%} of the image no longer shows markers; clean the lens, check the gel for damage'

    def _other_gel(self) -> str:
        against = 'calibration' if self.other_since_calibration else 'rest image'
        return f'the markers differ from those of the {against}; put the right gel in, or calibrate this one'

    def _unlike_contacts(self) -> str:
        return (
            f'{self.unlike_share:.0%} of the last contacts are unlike the training; check indenter and gel, then '
            'calibrate again'
        )

    def _force_ratio(self) -> str:
        assert self.ratio is not None
        return (
            f'the gel reads {self.ratio.ratio:.3f} +- {self.ratio.sigma:.3f} of the independent force; its stiffness '
            'changed since the calibration, so calibrate again'
        )

    def _dented_rest(self) -> str:
        assert self.since_calibration is not None
        return (
            f'parts of the rest image moved by {self.since_calibration.left_px:.2g} px since the calibration; capture '
            'it again with nothing on the gel, and calibrate again if that does not help'
        )
