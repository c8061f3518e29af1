"""A whole run of a small plan in simulated time, with something to go wrong in the midst of it."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from benchmarks.devices.rehearsal import Rehearsal
from tactile_nodes.collection.machine_record import MachineRecord
from tactile_nodes.collection.plan.journal import MISSING, Entry, Journal
from tactile_nodes.collection.plan.order import ordered
from tactile_nodes.collection.plan.plan import Plan, PlanSettings, Point, make_plan
from tactile_nodes.collection.press import cycle
from tactile_nodes.collection.press.cycle import Record
from tactile_nodes.collection.run.campaign import Campaign
from tactile_nodes.collection.run.outlet import Outlet
from tactile_nodes.collection.run.person import Person
from tactile_nodes.collection.settings import (
    AnchorSettings,
    CollectionSettings,
    MotionSettings,
    PressSettings,
    SurfaceSettings,
    SyncSettings,
)
from tactile_nodes.contact_tables.gel_tables import contact_table
from tactile_nodes.drivers.cnc.contract import CncSettings
from tactile_nodes.emulators.world import World, WorldSettings, Wrench
from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.optics import Press

SAFE_Z_MM, GEL_Z_MM = -8.0, -10.0
PLAN = PlanSettings(columns=2, rows=2, pitch_mm=4.0, depths_mm=(0.5, 1.5))
ALL = list(range(1, 9))
"""The numbers of its presses."""
WORLD = WorldSettings(start_mm=(-14.0, -14.0, -5.0), gel_x_mm=-12.0, gel_y_mm=-12.0, gel_z_mm=GEL_Z_MM)
"""A gel near the end switches."""
SETTINGS = CollectionSettings(
    motion=MotionSettings(press_mm_min=120.0, standoff_mm=0.2),
    press=PressSettings(tare_s=0.2),
    surface=SurfaceSettings(
        gel_x_mm=WORLD.gel_x_mm, gel_y_mm=WORLD.gel_y_mm, top_mm=-9.8, bottom_mm=-11.5, reach_mm=4.0,
        corners=3, feed_mm_min=60.0, repeats=1,
    ),
    anchor=AnchorSettings(every=0),
    sync=SyncSettings(pulses=1),
    reference_frames=4,
)  # fmt: skip
"""A short search for the surface and short patterns, as each run has them, and quick presses."""
TABLE = contact_table(Gel())
UNBEARABLE: Wrench = (0.0, 0.0, 6.0, 0.0, 0.0, 0.0)  # limits.bearable_n is 5 N


def changed(**blocks: dict[str, object]) -> CollectionSettings:
    """The settings with some of a block changed: changed(limits={'force_n': 1.0})."""
    given = {name: dataclasses.replace(getattr(SETTINGS, name), **values) for name, values in blocks.items()}
    return dataclasses.replace(SETTINGS, **given)


def reject(monkeypatch: pytest.MonkeyPatch, is_bad: Callable[[Point], bool], reason: str) -> None:
    """Presses at these points are good until the end, and rejected then."""
    judge = cycle._judge

    def strict(record: Record, *others: Any) -> None:
        judge(record, *others)
        if is_bad(record.point):
            raise cycle.RejectedError(reason)

    monkeypatch.setattr(cycle, '_judge', strict)


class Dots:
    """A camera that sees spots on the gel give way to the tip: 160x160 pixels, five to a millimetre."""

    SIDE, PX_PER_MM, REACH_MM = 160, 5.0, 3.0

    def __init__(self) -> None:
        spots = np.random.default_rng(1).uniform(0, 255, (self.SIDE, self.SIDE)).astype(np.float32)
        soft = cv2.GaussianBlur(spots, (0, 0), 1.5)
        self._rest = cv2.normalize(soft, None, 20, 230, cv2.NORM_MINMAX)
        self._y, self._x = (np.mgrid[: self.SIDE, : self.SIDE] - (self.SIDE - 1) / 2).astype(np.float32)
        self._last: tuple[Press, np.ndarray] | None = None

    def see(self, press: Press) -> np.ndarray:
        if press.depth_mm <= 0:
            press = Press(0.0, 0.0, 0.0)
        if self._last is None or self._last[0] != press:
            self._last = press, self._moved(press)
        return self._last[1]

    def _moved(self, press: Press) -> np.ndarray:
        """Outwards from the tip, most at 3 mm from it: 0.3 mm for a millimetre of depth."""
        x, y = self._x / self.PX_PER_MM - press.x_mm, self._y / self.PX_PER_MM - press.y_mm
        share = 0.3 * press.depth_mm / self.REACH_MM * np.exp((1 - (x**2 + y**2) / self.REACH_MM**2) / 2)
        middle = (self.SIDE - 1) / 2
        columns, rows = (there - share * way * self.PX_PER_MM + middle for there, way in ((self._x, x), (self._y, y)))
        image = cv2.remap(self._rest, columns.astype(np.float32), rows.astype(np.float32), cv2.INTER_LINEAR)
        return image.round().astype(np.uint8)


class Run:
    """One process's life: everything is new but the journal and the record of the machine.

    `at` does something when so many presses are published.
    """

    def __init__(
        self,
        folder: Path,
        settings: CollectionSettings = SETTINGS,
        plan: PlanSettings = PLAN,
        world: WorldSettings = WORLD,
        dots: Dots | None = None,
        unasked: bool = True,
        machine: Path | None = None,
        rate_hz: float = 50.0,
    ) -> None:
        self.plan: Plan = make_plan(plan)
        self.world = World(world, table=TABLE)
        camera = None if dots is None else lambda time_ns: dots.see(self.world.press_at(time_ns))
        cnc = CncSettings(safe_z_mm=SAFE_Z_MM)
        self.rig = Rehearsal(self.world, settings, cnc, camera, rate_hz, fps=20.0, tick_s=0.02)
        self.published: list[Record] = []
        self.printed: list[str] = []
        self.rests: list[int] = []
        self._acts: dict[int, Callable[[], None]] = {}
        self.journal = Journal(folder / 'journal.jsonl', self.plan)
        self.machine = MachineRecord(machine or folder / 'machine.record')
        self.suspects: list[tuple[int, int]] = []
        self.earlier: list[Record] = []
        self.unrecorded: set[int] = set()
        self.recorder = True
        self.person = Person('answer', self.printed.append, self.rig.clock)
        outlet = Outlet(
            record=self._record,
            rest_image=lambda image, at_ns: self.rests.append(at_ns),
            suspect=lambda entry, reason: self.suspects.append((entry.press, entry.attempt)),
            recall=self._recall,
            say=self.printed.append,
            require_recorder=lambda: self.recorder,
            missing=self._missing,
            person=self.person,
        )
        order = ordered(self.plan, plan)
        self.campaign = Campaign(
            self.plan, order, self.journal, self.machine, self.rig.hands, settings, SAFE_Z_MM, outlet, unasked=unasked
        )

    def at(self, presses: int, act: Callable[[], None]) -> None:
        self._acts[presses] = act

    def in_the_gel(self, act: Callable[[], None]) -> Callable[[], None]:
        """Do it once the tip is next 0.3 mm deep."""

        def arm() -> None:
            done = []

            def look() -> None:
                if not done and self.world.press_at(self.rig.clock.now_ns()).depth_mm > 0.3:
                    done.append(True)
                    act()

            self.rig.clock.every(0.01, look)

        return arm

    def after(self, seconds: float, act: Callable[[], None]) -> None:
        done = []

        def once() -> None:
            if not done:
                done.append(True)
                act()

        self.rig.clock.every(seconds, once)

    def pause(self, seconds: float) -> None:
        self.campaign.paused = True
        self.after(seconds, lambda: setattr(self.campaign, 'paused', False))

    def push(self, seconds: float, wrench: Wrench = UNBEARABLE) -> None:
        """Something leans on the tool, or hits it."""
        felt = self.world.wrench_at
        self.world.wrench_at = lambda _: wrench  # type: ignore[method-assign]
        self.after(seconds, lambda: setattr(self.world, 'wrench_at', felt))

    @property
    def machine_steps(self) -> list[str]:
        """What the record of the machine says became of it."""
        lines = (self.journal.path.parent / 'machine.record').read_text(encoding='ascii').splitlines()
        return [json.loads(line)['step'] for line in lines]

    @property
    def recorded(self) -> list[int]:
        return [record.point.press for record in self.published if not record.reason]

    @property
    def height_mm(self) -> float:
        return self.world.tip_at(self.rig.clock.now_ns())[2]

    def _recall(self, entry: Entry) -> Record | None:
        wanted = (entry.press, entry.attempt)
        return next((each for each in self.earlier if (each.point.press, each.attempt) == wanted), None)

    def _missing(self) -> int:
        """The presses of `unrecorded` were published while nobody recorded."""
        lost, self.unrecorded = self.unrecorded, set()
        for press in lost:
            attempt = self.journal.next_attempt(press) - 1
            self.journal.note(press, attempt, MISSING, self.rig.clock.now_ns(), 'not in the bag')
        return len(lost)

    def _record(self, record: Record) -> None:
        self.published.append(record)
        if (act := self._acts.pop(len(self.published), None)) is not None:
            act()
