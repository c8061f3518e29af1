"""Whether presses were at the positions that the machine reports. A later anchor that is not displaced confirms them.

Presses that no anchor has confirmed are suspect if the next anchor is displaced, and are done again. The same holds for
presses left by an interrupted run, unless the last of them, pressed again after homing, gives the recorded image: lost
steps stay lost, so a press that is right at the end was right before.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from tactile_nodes.clock import Clock
from tactile_nodes.collection.plan.journal import ANCHORED, ASIDE, SUSPECT, Entry, Journal
from tactile_nodes.collection.plan.plan import Point
from tactile_nodes.collection.press.cycle import Record
from tactile_nodes.collection.run.anchors import Anchors, Shift
from tactile_nodes.collection.run.outlet import Outlet
from tactile_nodes.collection.settings import CollectionSettings
from tactile_nodes.errors import ConfigurationError, DeviceFaultError, ImageError

DEEP = 0.5  # of the anchor's depth: a press this deep shows its position in the image


class Trust:
    """Presses anchors, and updates the journal with what they confirm.

    Args:
        settings: `anchor.every` of 0 trusts the machine without checking.
        order: the points of the plan.
        journal: of the plan.
        clock: for the journal.
        outlet: receives suspect presses, and returns recorded presses of earlier runs.
        press: makes a press, or gives it up for a `reason`.
        again: likewise, a press of the plan.

    Raises:
        ConfigurationError: the anchor is deeper than the limit.
    """

    def __init__(
        self,
        settings: CollectionSettings,
        order: Sequence[Point],
        journal: Journal,
        clock: Clock,
        outlet: Outlet,
        press: Callable[[Point], Record],
        again: Callable[[Point], Record],
    ) -> None:
        every, depth_mm, deepest_mm = settings.anchor.every, settings.anchor.depth_mm, settings.limits.depth_mm
        if every and depth_mm > deepest_mm:
            raise ConfigurationError(
                f'anchor.depth_mm is {depth_mm:g}, but limits.depth_mm allows {deepest_mm:g}; change one of them'
            )
        self._every = every
        self._deep_mm = depth_mm * DEEP
        self._order = order
        self._journal = journal
        self._clock = clock
        self._outlet = outlet
        self._anchors = Anchors(settings.anchor, press)
        self._again = again
        self._since = 0

    def begin(self) -> None:
        """Set up the anchor, and check the presses that an interrupted run has left.

        Raises:
            DeviceFaultError: the image does not follow the machine.
        """
        if not self._every:
            return
        self._outlet.say('pressing the anchor')
        shift = self._anchors.begin()
        self._outlet.say(f'two presses of the anchor are {shift.describe()} apart')
        if self._journal.unconfirmed():
            self._look_back()

    def pressed(self) -> None:
        """Count one more press since the last anchor."""
        self._since += 1

    def shaken(self) -> None:
        """Press an anchor next: steps may be lost, for example in a collision."""
        self._since = self._every

    def check(self, at_end: bool = False) -> None:
        """Press the anchor if it is due, or at the end of a run if presses wait to be confirmed.

        Raises:
            DeviceFaultError: the anchor is displaced.
        """
        due = bool(self._journal.unconfirmed()) if at_end else self._since >= self._every
        if not self._every or not due:
            return
        self._since = 0
        shift = self._anchors.look()
        if not self._anchors.is_beside(shift):
            self._confirm(shift)
            return
        reason = f'the anchor is displaced by {shift.describe()} from the first one'
        count = self._doubt(self._journal.unconfirmed(), reason)
        raise DeviceFaultError(
            f'the tip is not where the machine reports: {reason}; all presses since the last good anchor ({count}) are '
            'suspect and will be done again. Check which axis sticks or loses steps, then start again'
        )

    def _look_back(self) -> None:
        """Repeat the last press that is deep enough to show its position; presses after it become suspect."""
        unconfirmed = self._journal.unconfirmed()
        points = {point.press: point for point in self._order}
        deep = [entry for entry in unconfirmed if points[entry.press].depth_mm >= self._deep_mm]
        earlier = self._outlet.recall(deep[-1]) if deep else None
        if earlier is None:
            self._doubt(unconfirmed, 'the run was cut off before an anchor, and left no image for comparison')
            return
        last = deep[-1]
        later = self._again(points[last.press])
        if later.reason:
            reason = f'press {last.press} cannot be made now: {later.reason}'
            self._doubt(unconfirmed, f'the run was cut off before an anchor, and {reason}')
            if later.aside:
                self._journal.note(last.press, last.attempt, ASIDE, self._clock.now_ns(), reason)
            return
        try:
            shift = self._anchors.between(earlier, later)
        except ImageError as error:
            self._doubt(unconfirmed, f'the run was cut off before an anchor, and {error}')
            return
        if self._anchors.is_beside(shift):
            self._doubt(
                unconfirmed,
                f'before the run was cut off, press {last.press} was displaced by {shift.describe()}',
            )
            return
        late = unconfirmed[unconfirmed.index(last) + 1 :]
        if late:
            self._doubt(late, 'the run was cut off before an anchor')
        self._confirm(shift)

    def _confirm(self, shift: Shift) -> None:
        self._journal.note_run(ANCHORED, self._clock.now_ns(), shift.describe())

    def _doubt(self, entries: Sequence[Entry], reason: str) -> int:
        """Mark these as suspect; returns how many they are."""
        for entry in entries:
            self._outlet.suspect(entry, reason)
            self._journal.note(entry.press, entry.attempt, SUSPECT, self._clock.now_ns(), reason)
        self._outlet.say(f'suspect presses, which will be done again: {len(entries)} ({reason})')
        return len(entries)
