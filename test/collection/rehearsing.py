"""A whole run of a small plan in simulated time, with something to go wrong in the midst of it."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

from tactile_nodes.collection.campaign import Campaign, Outlet
from tactile_nodes.collection.cycle import Record
from tactile_nodes.collection.journal import Journal
from tactile_nodes.collection.order import ordered
from tactile_nodes.collection.plan import Plan, PlanSettings, make_plan
from tactile_nodes.collection.rehearsal import Rehearsal
from tactile_nodes.collection.settings import CollectionSettings, SurfaceSettings
from tactile_nodes.drivers.cnc import CncSettings
from tactile_nodes.emulators.world import World, WorldSettings
from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.mechanics import solve

SAFE_Z_MM = -26.0
PLAN = PlanSettings(columns=3, rows=2, pitch_mm=4.0, depths_mm=(0.5, 1.5))
SETTINGS = CollectionSettings(surface=SurfaceSettings(top_mm=-29.8, corners=3, repeats=1))
TABLE = solve(Gel())


def changed(**blocks: dict[str, object]) -> CollectionSettings:
    """The settings with some of a block changed: changed(limits={'force_n': 1.0})."""
    given = {name: dataclasses.replace(getattr(SETTINGS, name), **values) for name, values in blocks.items()}
    return dataclasses.replace(SETTINGS, **given)


class Run:
    """One process's life: everything is new but the journal. `at` does something when so many presses are told."""

    def __init__(
        self,
        folder: Path,
        settings: CollectionSettings = SETTINGS,
        plan: PlanSettings = PLAN,
        world: WorldSettings | None = None,
    ) -> None:
        self.plan: Plan = make_plan(plan)
        self.world = World(world, table=TABLE)
        self.rig = Rehearsal(self.world, settings, CncSettings(safe_z_mm=SAFE_Z_MM), rate_hz=100.0, fps=20.0)
        self.told: list[Record] = []
        self.said: list[str] = []
        self.rests: list[int] = []
        self._acts: dict[int, Callable[[], None]] = {}
        self.journal = Journal(folder / 'journal.jsonl', self.plan)
        outlet = Outlet(self._record, lambda image, at_ns: self.rests.append(at_ns), self.said.append, lambda: None)
        order = ordered(self.plan, plan)
        self.campaign = Campaign(self.plan, order, self.journal, self.rig.hands, settings, SAFE_Z_MM, outlet)

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

    @property
    def recorded(self) -> list[int]:
        return [record.point.press for record in self.told if not record.reason]

    @property
    def height_mm(self) -> float:
        return self.world.tip_at(self.rig.clock.now_ns())[2]

    def _record(self, record: Record) -> None:
        self.told.append(record)
        if (act := self._acts.pop(len(self.told), None)) is not None:
            act()
