"""Drift monitor: whether a calibration still holds, what changed since it was made, and what to do about it.

It answers two questions. Did the picture move since the rest image was captured? Then the rest image is outdated and
must be captured again. Did the rest image itself change since the calibration? Then the regions see other parts of the
gel than those that were calibrated, and the sensor must be calibrated again. The limits follow from the measurements
in `docs/drift.md`.
"""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass

import numpy as np

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.sensing.judge.drift_alarm import NS_PER_S, Alarm, Level
from tactile_nodes.sensing.judge.drift_verdict import Reason, Verdict
from tactile_nodes.sensing.judge.force_check import (
    ContactFrames,
    ContactSplitter,
    ForceComparison,
    ForceRatio,
    Scale,
    UnlikeContacts,
)
from tactile_nodes.sensing.picture.change import PictureChange, PictureComparison
from tactile_nodes.sensing.picture.dead_pixels import DeadPixels
from tactile_nodes.sensing.picture.motion import PictureMotion, Straightening
from tactile_nodes.sensing.picture.quality import FAINT_LIGHT, FAR_LIGHT
from tactile_nodes.sensing.picture.rolling_bands import RollingBands
from tactile_nodes.shapes import UInt8

STANDARD_GRAVITY = 9.80665
SOONER = 0.25
"""While something seems wrong, the time between two checks is multiplied by this."""
STRAIGHT_PX = 0.1
"""Dead pixels are searched only while the corrected motion is below this. So small a motion is mostly chance."""
WEIGHED_WITHIN_S = 1.0
"""A weight is compared only while forces come: the last one is no older than this."""
PLAIN_CONTRAST = 0.3
"""Below this share of its contrast, a picture is dim or covered. Above it, an unmatched picture shows another gel."""


@dataclass(frozen=True)
class Limits:
    """Limits for ageing and invalid; docs/drift.md has the force errors that they correspond to.

    Motion is in px (root mean square over the picture), contrast a ratio to the former one (or its inverse), lost
    regions a share, forces |ln ratio|.
    """

    moved_px: tuple[float, float] = (0.02, 0.1)
    since_calibration_px: tuple[float, float] = (0.5, 4.0)
    dented_px: tuple[float, float] = (0.05, 0.2)
    contrast: tuple[float, float] = (FAR_LIGHT[0], FAINT_LIGHT)
    lost: tuple[float, float] = (0.08, 0.2)
    moved_clearly_px: float = 0.15
    """Less median motion counts only at rest. On the simulated sensor two 6 mm balls, 1.5 mm deep, cause 0.03 px."""
    moved_share: float = 0.5
    """Median motion below this share of the largest independent motion also counts only at rest. On a gel that is thick
    for its size, a touch moves everything by 0.5 px and more, but only 0.2 times as far as single patches (under 25 N
    0.4 times)."""
    quiet_only: bool = False
    """Whether motion and lost regions are judged only in quiet pictures. On a gel of a few dozen dots, a touch moves
    most of them and hides a third."""
    unlike: float = 0.5
    force: tuple[float, float] = (0.05, 0.15)

    @classmethod
    def of_flow(cls, name: str, *, novelty_checked: bool = False) -> Limits:
        """The limits for a model that measures motion by the flow method `name`.

        Dense inverse search mistakes light for motion: in a picture 30 % darker it measures 0.6 of the motion. Patches
        fit the light as well. If a network is `novelty_checked`, a force in another light counts only if the novelty
        check agrees. Light hardly disturbs that check.
        """
        if name == 'dots':
            return cls(quiet_only=True)
        return cls(contrast=(0.9, 0.75)) if name == 'dis' and not novelty_checked else cls()


class DriftMonitor:
    """Takes stamped pictures and forces, and gives its verdict at any time.

    In a quiet picture no part moved on its own; this is decided without the force. If the gel is never released, only
    gross changes are detected. `quiet_ns` is the stamp of the last quiet picture.
    """

    def __init__(self, limits: Limits | None = None) -> None:
        self.limits = limits = limits or Limits()
        self._moved = Alarm(*limits.moved_px, plain=True)
        self._calibrated = Alarm(*limits.since_calibration_px)
        self._dented = Alarm(*limits.dented_px)
        self._light = Alarm(*(-math.log(each) for each in limits.contrast), plain=True)
        self._lost = Alarm(*limits.lost, plain=True)
        self._other = Alarm(0.5, 0.5, plain=True)
        self._other_since_calibration = Alarm(0.5, 0.5)
        self._unlike = Alarm(limits.unlike)
        self._force = Alarm(*limits.force)
        self._rest: PictureComparison | None = None
        self._calibration: PictureComparison | None = None
        self._last_rest: np.ndarray | None = None
        self._first_stands_in = True
        self._bands: RollingBands | None = None
        self._dead = DeadPixels(looks=1, seldom=1)
        self._since_rest: PictureChange | None = None
        self._since_calibration: PictureChange | None = None
        self._splitter, self._comparison = ContactSplitter(), ForceComparison()
        self._unlike_contacts, self._scale = UnlikeContacts(), Scale()
        self._ratio: ForceRatio | None = None
        self._quiet_ns: int | None = None
        self._looked_ns = 0
        self._is_calibrated = True

    def use_calibration(self, picture: UInt8[np.ndarray, 'h w'] | None, *, calibrated: bool = True) -> None:
        """Take the rest image of the calibration, and forget what was measured with another calibration.

        If it is None, the next rest image is used instead, and again the first one of another size. If not
        `calibrated`, the model follows from a description alone, and the verdict says so while nothing is wrong.
        """
        self._is_calibrated = calibrated
        for alarm in (self._calibrated, self._dented, self._other_since_calibration, self._unlike, self._force):
            alarm.clear()
        self._comparison.clear()
        self._unlike_contacts.clear()
        self._ratio = self._since_calibration = None
        self._first_stands_in = picture is None
        self._calibration = None if picture is None else PictureComparison(picture)
        if self._last_rest is not None:
            self._compare_rest(self._last_rest)

    def rest(self, picture: UInt8[np.ndarray, 'h w']) -> None:
        """Take a new rest image, and forget what was measured against the previous one.

        Raises:
            ImageError: it cannot be compared with the rest image of the calibration.
        """
        for alarm in (self._moved, self._light, self._lost, self._other):
            alarm.clear()
        self._since_rest = self._quiet_ns = None
        self._rest = None
        self._rest = PictureComparison(picture)
        if self._first_stands_in and self._last_rest is not None and self._last_rest.shape != picture.shape:
            self._calibration = None
        self._last_rest = np.array(picture)
        self._bands = RollingBands(self._last_rest)
        self._dead.beside(self._last_rest)
        self._compare_rest(picture)

    def saved(self) -> bytes:
        """The evidence so far, for a monitor that is started again."""
        alarms = {name: (int(each.level), each.value) for name, each in self._alarms.items()}
        found = (self._since_rest, self._since_calibration, self._ratio)
        state = {'alarms': alarms, 'found': [each and asdict(each) for each in found]}
        return json.dumps({**state, 'unlike': self._unlike_contacts.last}).encode()

    def recall(self, data: bytes) -> None:
        """Go on with the evidence that `saved` returned, which was found with the same calibration and rest image.

        Raises:
            ValueError, KeyError, TypeError: the data are damaged.
        """
        state = json.loads(data)
        for name, (level, value) in state['alarms'].items():
            self._alarms[name].level, self._alarms[name].value = Level(level), float(value)
        rest, calibration, ratio = state['found']
        self._since_rest, self._since_calibration = (
            each and PictureChange(**{**each, 'shift_px': tuple(each['shift_px'])}) for each in (rest, calibration)
        )
        self._ratio = ratio and ForceRatio(**ratio)
        self._unlike_contacts = UnlikeContacts(state['unlike'])

    @property
    def _alarms(self) -> dict[str, Alarm]:
        return {name: each for name, each in vars(self).items() if isinstance(each, Alarm)}

    def is_due(self, stamp_ns: int, every_s: float) -> bool:
        """Whether to check a picture now. While something seems wrong, pictures are checked four times as often.

        A fault and its end are then reported early, and a gel that is pressed often is still seen at rest.
        """
        alarms = self._moved, self._light, self._lost, self._other
        share = SOONER if any(each.suspects for each in alarms) else 1.0
        if self._rest is None or 0 <= stamp_ns - self._looked_ns < share * every_s * NS_PER_S:
            return False
        self._looked_ns = stamp_ns
        return True

    def frame(self, stamp_ns: int, picture: UInt8[np.ndarray, 'h w'], taken_out: PictureMotion | None = None) -> None:
        """Take a picture of the gel, touched or not. Pictures before the first rest image are ignored.

        Motion of the whole picture (`taken_out`) is corrected in the forces, so only the remaining motion counts.
        Rolling bands are removed and dead pixels filled in; they do not count either.
        """
        if self._rest is None or self._last_rest is None:
            return
        straight = taken_out is None or max(map(abs, taken_out.terms)) < STRAIGHT_PX
        picture = self._without_dead(picture, self._rest, straight=straight)
        if taken_out is not None and picture.shape == self._last_rest.shape:
            picture = Straightening(taken_out, picture.shape)(picture, self._last_rest)
        if self._bands is not None and picture.shape == self._last_rest.shape:
            picture = self._bands.without(picture)
        self.change(stamp_ns, self._rest.of(picture))

    def _without_dead(
        self, picture: UInt8[np.ndarray, 'h w'], rest: PictureComparison, *, straight: bool
    ) -> UInt8[np.ndarray, 'h w']:
        """The picture with dead pixels filled in. New dead pixels are searched only if it is `straight`."""
        mended = self._dead.mended(picture)
        if not straight or self._last_rest is None or picture.shape != self._last_rest.shape:
            return mended
        return self._dead.mended(picture) if self._dead.look(mended, lambda each: rest.of(each).quiet) else mended

    def change(self, stamp_ns: int, since_rest: PictureChange) -> None:
        """Take how a picture differs from the rest image."""
        self._since_rest = since_rest
        quiet = since_rest.quiet
        if quiet:
            self._quiet_ns = stamp_ns
        tells = quiet or not self.limits.quiet_only
        clearly_px = max(self.limits.moved_clearly_px, self.limits.moved_share * since_rest.left_px)
        if quiet or (tells and since_rest.middle_px >= clearly_px):
            self._moved.feed(stamp_ns, since_rest.size_px)
        if tells:
            self._lost.feed(stamp_ns, 1 - since_rest.found)
        self._light.feed(stamp_ns, abs(math.log(max(since_rest.contrast, 1e-3))))
        self._other.feed(stamp_ns, float(_shows_another(since_rest)))

    def force(self, stamp_ns: int, total_n: float, unlikeness: float, *, in_contact: bool, usable: bool = True) -> None:
        """Take the gel's force. Frames that are not `usable` for another reason are not compared with other forces."""
        self._scale.feed(stamp_ns, total_n, in_contact=in_contact and usable)
        ended = self._splitter.feed(stamp_ns, total_n, unlikeness, in_contact=in_contact, usable=usable)
        if ended is not None:
            self._contact(ended)

    def independent_force(self, stamp_ns: int, force_n: tuple[float, float, float]) -> None:
        """Take the force of another sensor in the same contacts, in any axes, tared or not."""
        self._comparison.independent(stamp_ns, force_n)

    def weigh(self, weight_g: float, silent_s: float = 0.0) -> str:
        """Compare the force of the last seconds with a known weight on the gel, and return the result as text.

        `silent_s` is the time since the last force came.

        Raises:
            ConfigurationError: the load is not steady, or no forces come.
        """
        if silent_s > WEIGHED_WITHIN_S:
            raise ConfigurationError(
                f'the last force came {silent_s:.0f} s ago; check the camera and the force estimator, and try again'
            )
        if (steady := self._scale.steady_n) is None:
            raise ConfigurationError(
                'the load on the gel was not steady for the last second, or the frames were not ok; put the '
                'weight down gently, wait two seconds and try again'
            )
        (mean_n, spread_n), weight_n = steady, weight_g * 1e-3 * STANDARD_GRAVITY
        self._take(ForceRatio(mean_n / weight_n, spread_n / mean_n, 1))
        return f'the gel reads {mean_n:.3f} N of {weight_n:.3f} N; calibration: {self.verdict.text}'

    @property
    def verdict(self) -> Verdict:
        """The verdict over all evidence."""
        levels = self._levels()
        reasons = Reason(sum(reason for reason, level in levels.items() if level > Level.VALID))
        known = self._rest is not None or bool(reasons)
        level = max(levels.values()) if known else Level.UNKNOWN
        return Verdict(
            level=level,
            reasons=reasons,
            since_rest=self._since_rest,
            since_calibration=self._since_calibration,
            moved_px=self._moved.value,
            lost=self._lost.value,
            other_since_calibration=self._other_since_calibration.level > Level.VALID,
            ratio=self._ratio,
            unlike_share=self._unlike_contacts.share,
            quiet_ns=self._quiet_ns,
            calibrated=self._is_calibrated,
        )

    def _levels(self) -> dict[Reason, Level]:
        other = max(self._other.level, self._other_since_calibration.level)
        explained = self._other.level > Level.VALID  # then no region is found again, which is no second fault
        return {
            Reason.PICTURE_MOVED: self._moved.level,
            Reason.MOVED_SINCE_CALIBRATION: self._calibrated.level,
            Reason.LIGHT: self._light.level,
            Reason.LOST_REGIONS: Level.VALID if explained else self._lost.level,
            Reason.OTHER_GEL: other,
            Reason.UNLIKE_CONTACTS: self._unlike.level,
            Reason.FORCE_RATIO: self._force.level,
            Reason.DENTED_REST: self._dented.level,
        }

    def _compare_rest(self, picture: np.ndarray) -> None:
        if self._calibration is None:
            self._calibration = PictureComparison(picture)
        self._since_calibration = change = self._calibration.of(picture)
        if change.same:
            self._calibrated.set(change.size_px)
            self._dented.set(change.dented_px)
        else:
            self._calibrated.clear()
            self._dented.clear()
        self._other_since_calibration.set(float(_shows_another(change)))

    def _contact(self, contact: ContactFrames) -> None:
        if self._moved.level > Level.VALID or self._other.level > Level.VALID:
            return  # that already explains any force error
        self._unlike_contacts.contact(contact)
        self._unlike.set(self._unlike_contacts.at_least)
        if (ratio := self._comparison.contact(contact)) is not None:
            self._take(ratio)

    def _take(self, ratio: ForceRatio) -> None:
        self._ratio = ratio
        self._force.set(ratio.off)


def _shows_another(change: PictureChange) -> bool:
    return not change.same and PLAIN_CONTRAST < change.contrast < 1 / PLAIN_CONTRAST
