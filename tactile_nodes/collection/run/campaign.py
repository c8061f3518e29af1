"""The whole run: home, find the surface, press after press, and the handling of faults (docs/collection.md).

In all cases the tip first goes straight up, if the machine still obeys. After a run that was cut off, the position of
the tip is unknown: before the next run moves anything, a person is asked.
"""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from functools import partial

from tactile_nodes.clock import NS_PER_S
from tactile_nodes.collection.hands import Hands, InterruptedRunError, TrippedError
from tactile_nodes.collection.machine_record import MachineRecord
from tactile_nodes.collection.plan.journal import (
    ASIDE,
    BROKEN_OFF,
    ENDED,
    NO_PRESS,
    PATTERN,
    RECORDED,
    REJECTED,
    STARTED,
    Journal,
)
from tactile_nodes.collection.plan.plan import Plan, Point
from tactile_nodes.collection.plan.progress import Progress
from tactile_nodes.collection.press.cycle import Ground, Record, press_cycle
from tactile_nodes.collection.press.rest import await_recovery, breath, go_to_gel, image_noise, rest_frames, zero
from tactile_nodes.collection.press.speed import check_speeds
from tactile_nodes.collection.press.surface import (
    Corner,
    Surface,
    check_safe_height,
    check_search_depth,
    corners,
    feel_corner,
    surface_through,
)
from tactile_nodes.collection.press.sync_pattern import pattern_gaps, sync_pattern
from tactile_nodes.collection.press.workspace import check_depths, check_workspace, forceful, named
from tactile_nodes.collection.readings import Frame
from tactile_nodes.collection.run.anchors import anchor_press
from tactile_nodes.collection.run.outlet import Outlet
from tactile_nodes.collection.run.recovery import TOO_GREAT, Recovery
from tactile_nodes.collection.run.trust import Trust
from tactile_nodes.collection.safety import FORCE, PASSING
from tactile_nodes.collection.settings import CollectionSettings
from tactile_nodes.errors import BusError, ConfigurationError, DeviceError, DeviceFaultError
from tactile_nodes.sensing.rest.reference import average


class Campaign:
    """A run of a plan.

    Args:
        plan: what to press.
        order: all of its points, in the order in which they are done.
        journal: of this plan; presses that it lists as done are not repeated.
        record: of the machine, for the process that uses it next.
        hands: the machine.
        settings: limits and requirements.
        safe_z_mm: height for sideways motion.
        outlet: receives results and messages.
        period_s: sample period of the force/torque sensor.
        unasked: whether a person has allowed in advance to continue after a run that was cut off.

    Raises:
        ConfigurationError: a plan or search that is too deep or outside the workspace, a feed too fast to be stopped
            in time, or a safe height that is perhaps in the gel.
    """

    def __init__(
        self,
        plan: Plan,
        order: Sequence[Point],
        journal: Journal,
        record: MachineRecord,
        hands: Hands,
        settings: CollectionSettings,
        safe_z_mm: float,
        outlet: Outlet,
        period_s: float = 0.0,
        unasked: bool = False,
    ) -> None:
        check_depths(plan.points, settings)
        check_workspace(plan.points, settings, hands.cnc.limits)
        check_speeds(settings, hands.cnc, period_s)
        check_safe_height(settings, safe_z_mm)
        check_search_depth(settings)
        self._plan_id = plan.plan_id
        self._order = order
        self._journal = journal
        self._hands = hands
        self._settings = settings
        self._safe_z_mm = safe_z_mm
        self._outlet = outlet
        self._unasked = unasked
        self._begun = False
        self._ground: Ground | None = None
        self._since_reference = 0
        self._since_pattern = self._patterns = 0
        self._in_a_row = 0
        self._repairs = 0
        self._trust = Trust(settings, order, journal, hands.clock, outlet, self._anchor_press, self._press_again)
        self._recovery = Recovery(hands, settings, record, outlet, self._trust.shaken)
        self.paused = self.stands = False
        """`paused`: whether it is asked to pause; `stands`: whether it does, so that nothing moves."""
        self.surface: Surface | None = None
        self.now: Point | None = None
        self.progress = Progress(len(plan.points), journal.done)

    def run(self) -> str:
        """Do the rest of the plan; returns a sentence about the result. Ends with the tip at the safe height.

        Raises:
            DeviceError: a device needs a person.
            TactileError: the journal or the recorder cannot store the measurements.
        """
        hands, limits = self._hands, self._settings.limits
        ended = ''
        try:
            self._prepare()
            end_ns = self._recovery.unwaited_ns + round(limits.hours * 3600 * NS_PER_S)
            while not ended and (left := self._left()):
                self.progress.start(hands.clock.now_ns())
                ended = self._round(left, end_ns)
            self._check_trust(at_end=True)
            if self._since_pattern:
                self._pattern()
            self._wait_while_paused()
            if self._fails:
                raise DeviceFaultError(ended)
        except InterruptedRunError:
            ended = 'stopped on request'
        except TrippedError as tripped:
            self._recovery.write_down(tripped)
            raise DeviceFaultError(f'stopped: {tripped.trip.reason}') from tripped
        finally:
            self.now = None
            not_up = self._leave()
        if not_up:
            raise DeviceFaultError(not_up)
        whole = self._journal.done == len(self._order)
        done = f'the plan is done{"" if whole else " except for presses that were set aside or rejected each time"}'
        return f'{ended or done}: {self.progress.summary(self._journal)}'

    def _left(self) -> list[Point]:
        """The remaining presses; if there are none, the presses that are missing in the bags.

        Raises:
            BusError: they were made again as often as allowed, and are still missing.
        """
        most = self._settings.limits.attempts
        left = self._journal.left(self._order, most)
        if left or not (missing := self._outlet.missing()):
            return left
        if self._repairs == most:
            raise BusError(
                f'no bag of the folder holds {missing} presses, although they were made {most} times more; check that '
                'the recorder writes there, press_image included, and its disk'
            )
        self._repairs += 1
        self._outlet.say(f'presses in no bag: {missing}, perhaps because no recorder was running; doing them again')
        self.progress.done = self._journal.done
        return self._journal.left(self._order, most)

    def _round(self, left: Sequence[Point], end_ns: int) -> str:
        """Each of these once; returns why it ended before the last, if it did."""
        for point in left:
            self._wait_while_paused()
            if self._recovery.unwaited_ns > end_ns:
                return f'stopped after {self._settings.limits.hours:g} hours'
            self._await_recorder()
            if self._since_reference >= self._settings.reference_every:
                self._reference()
            if not self._patterns or 0 < self._settings.sync.every <= self._since_pattern:
                self._pattern()
            self._check_trust()
            self._press(point)
            self._trust.pressed()
            self._since_reference += 1
            self._since_pattern += 1
            if self._fails:
                return (
                    f'{self._in_a_row} presses in a row were rejected, the last because {self.progress.last_reason}; '
                    'check gel, tip and sensors, then start again: recorded presses are kept'
                )
        return ''

    @property
    def _fails(self) -> bool:
        return self._in_a_row >= self._settings.limits.rejects_in_a_row

    def _press(self, point: Point) -> None:
        """One attempt, reported and written down."""
        assert self._ground is not None
        journal, clock = self._journal, self._hands.clock
        record = Record(point, journal.next_attempt(point.press))
        begun_ns = clock.now_ns()
        journal.note(point.press, record.attempt, STARTED, begun_ns)
        self.now = point
        try:
            self._hands.run(press_cycle(record, self._ground, self._settings))
        except TrippedError as tripped:
            self._recovery.write_down(tripped)
            self._up_then_tell(record, begun_ns, tripped.trip.reason)
            self._recovery.go_on_after(tripped)
        except DeviceError as error:
            with contextlib.suppress(DeviceError):  # the final retract meets the same error and reports it
                self._up_then_tell(record, begun_ns, str(error), doubted=True)
            raise
        else:
            self._recovery.tare = record.tare or self._recovery.tare
            self._tell(record, begun_ns)
        finally:
            self.now = None

    def _up_then_tell(self, record: Record, begun_ns: int, reason: str, doubted: bool = False) -> None:
        self._put_aside(record)
        try:
            self._recovery.up(record.tare, doubted)
        finally:
            self._put_aside(record)
            trip = self._hands.safety.trip
            record.reason = reason if trip is None else trip.reason
            self._tell(record, begun_ns)

    def _put_aside(self, record: Record) -> None:
        """Note a press with too large a force before the tip goes up, so that no other process presses there again."""
        trip = self._hands.safety.trip
        if trip is None or trip.kind not in TOO_GREAT or record.aside:
            return
        record.aside = True
        self._journal.note(record.point.press, record.attempt, ASIDE, self._hands.clock.now_ns(), trip.reason)

    def _tell(self, record: Record, begun_ns: int) -> None:
        """First the recorder, then the journal: an attempt cut off between the two is found in the bag (`audit`)."""
        self._outlet.record(record)
        now_ns = self._hands.clock.now_ns()
        if not record.aside:
            trip = self._hands.safety.trip
            silent = trip is not None and trip.kind in PASSING
            step = RECORDED if not record.reason else BROKEN_OFF if silent else REJECTED
            self._journal.note(record.point.press, record.attempt, step, now_ns, record.reason)
        self._in_a_row = self._in_a_row + 1 if record.reason else 0
        self.progress.note(record.reason, begun_ns, now_ns)
        if record.reason:
            done = 'was set aside' if record.aside else 'was rejected'
            self._outlet.say(f'press {record.point.press} {done}: {record.reason}')

    def _reference(self) -> None:
        frames = self._rest_frames()
        self._outlet.rest_image(average([frame.image for frame in frames]), frames[-1].stamp_ns)
        self._since_reference = 0

    def _rest_frames(self) -> Sequence[Frame]:
        return self._recovery.patiently(lambda: rest_frames(self._settings, self._safe_z_mm), tip_is_up=True)

    def _pattern(self) -> None:
        """Make edges at irregular times, to which the clocks of other recorders are fitted."""
        gaps = list(pattern_gaps(self._plan_id, self._journal.patterns, 2 * self._settings.sync.pulses))
        self._journal.note_run(PATTERN, self._hands.clock.now_ns())
        self._recovery.patiently(lambda: sync_pattern(gaps, self._settings, self._safe_z_mm), tip_is_up=True)
        self._patterns += 1
        self._since_pattern = 0

    def _check_trust(self, at_end: bool = False) -> None:
        try:
            self._trust.check(at_end)
        finally:
            self.progress.done = self._journal.done

    def _anchor_press(self, point: Point) -> Record:
        self._wait_while_paused()
        ground = self._ground
        assert ground is not None
        return self._recovery.patiently(lambda: anchor_press(point, ground, self._settings))

    def _press_again(self, point: Point) -> Record:
        """A press of the plan, to compare it with an earlier attempt; `reason` says why it cannot be, if so."""
        again = point._replace(press=NO_PRESS)
        try:
            return self._anchor_press(again)
        except TrippedError as tripped:
            if tripped.trip.kind != FORCE:
                raise
            self._recovery.up()
            self._recovery.go_on_after(tripped)
            return Record(again, 0, reason=tripped.trip.reason, aside=True)

    def _leave(self) -> str:
        """Bring the tip up, unless nothing has moved; empty, or why it is not up. Homing takes it no further down."""
        if not self._begun:
            return ''
        not_up = self._recovery.end()
        if not not_up:
            self._journal.note_run(ENDED, self._hands.clock.now_ns())
        return not_up if self._ground is not None else ''

    def _wait_while_paused(self) -> None:
        if not self.paused:
            return
        self._outlet.say('paused; nothing moves until it is resumed')
        unwaited_ns = self._recovery.unwaited_ns
        try:
            while self.paused:  # a sensor drifts in a long pause, so what is no force is measured again and again
                self.stands = True
                still = breath if self._recovery.tare is None else partial(zero, self._settings)
                self._recovery.tare = self._recovery.patiently(still, tip_is_up=True)
        finally:
            self.stands = False
            self._recovery.waited_ns += self._recovery.unwaited_ns - unwaited_ns

    def _await_recorder(self) -> None:
        while not self._outlet.require_recorder():
            self._recovery.patiently(breath, tip_is_up=True)

    # Before the first press.

    def _prepare(self) -> None:
        hands = self._hands
        self._recovery.ask_first(self._unasked)
        self._wait_while_paused()  # a rig that was killed while paused
        self._await_recorder()
        hands.safety.watch(hands.clock.now_ns(), camera=True)
        await_recovery(hands, self._settings.limits)
        self._recovery.begin(f'plan {self._plan_id} in {self._journal.path.parent}')
        self._begun = True
        self._outlet.say('homing')
        self._home()
        tare = self._recovery.tare = self._recovery.patiently(lambda: go_to_gel(self._settings, self._safe_z_mm))
        self._ground = Ground(Surface(self._safe_z_mm), self._safe_z_mm, tare, 0.0)
        noise = image_noise(self._rest_frames())
        self._reference()
        self._outlet.say('searching for the surface of the gel')
        self.surface = surface = self._feel_for_surface()
        self._check_safe_height(surface)
        check_workspace(self._order, self._settings, hands.cnc.limits, surface)
        self._ground = Ground(surface, self._safe_z_mm, tare, noise)
        self._outlet.say(
            f'the surface is at z {surface.z_mm:.3f} mm, with a slope of {surface.slope_x:.4f} along x '
            f'and {surface.slope_y:.4f} along y'
        )
        if many := forceful(self._order, self._settings, surface):
            most_n = self._settings.limits.force_n
            self._outlet.say(f'presses expected to exceed limits.force_n, {most_n:g} N: {len(many)} ({named(many)})')
        self._trust.begin()
        self.progress.done = self._journal.done

    def _feel_for_surface(self) -> Surface:
        felt: list[Corner] = []
        for at in corners(self._settings):
            self._wait_while_paused()
            feel = partial(feel_corner, self._settings, self._safe_z_mm, at, felt, [])
            felt.append(self._recovery.patiently(feel))
        return surface_through(felt, self._settings)

    def _home(self) -> None:
        """Find the end switches; this moves up and off the gel."""
        try:
            self._home_patiently()
        finally:
            self._hands.safety.watching_machine = True

    def _home_patiently(self) -> None:
        """Home; retry if sensor or camera failed meanwhile, because the machine is then locked until it is homed."""
        for _ in range(self._settings.limits.rejects_in_a_row - 1):
            try:
                return self._hands.home()
            except TrippedError as tripped:
                if tripped.trip.kind not in PASSING:
                    raise
                self._hands.safety.watching_machine = False
                self._outlet.say(f'{tripped.trip.reason}; homing again when it has recovered')
                await_recovery(self._hands, self._settings.limits, tripped.trip.reason)
        return self._hands.home()

    def _check_safe_height(self, surface: Surface) -> None:
        highest = max(surface.height_mm(point.x_mm, point.y_mm) for point in self._order)
        if self._safe_z_mm < highest + self._settings.motion.standoff_mm:
            raise ConfigurationError(
                f'the safe height, {self._safe_z_mm:g} mm, is less than {self._settings.motion.standoff_mm:g} mm above '
                f'the gel, whose surface is at {highest:.3f} mm; raise cnc.safe_z_mm'
            )
