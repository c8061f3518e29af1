"""A whole collection in simulated time, with simulated devices, the code of a real collection, and a real bag.

The clock skips waiting times, and only images that are used are rendered. With the same folder and plan an interrupted
collection continues with the next press, as with `tactile launch collect`.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import signal
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.collection.bag import CollectionBag
from benchmarks.collection.page import page_text
from benchmarks.devices.rehearsal import Rehearsal
from benchmarks.harness.declaration import RIG, SIMULATED, Benchmark, Result, argument
from benchmarks.harness.report import surroundings
from benchmarks.harness.running import Run
from tactile_nodes.bag.mcap_file import COMPRESSIONS
from tactile_nodes.clock import NS_PER_S, monotonic_s
from tactile_nodes.collection.machine_record import MachineRecord
from tactile_nodes.collection.plan.audit import audit
from tactile_nodes.collection.plan.journal import Journal
from tactile_nodes.collection.plan.order import ordered
from tactile_nodes.collection.plan.plan import PlanSettings, Point, load_plan_settings, make_plan, plan_path
from tactile_nodes.collection.plan.progress import duration
from tactile_nodes.collection.press.cycle import Record
from tactile_nodes.collection.readings import Picture
from tactile_nodes.collection.run.campaign import Campaign
from tactile_nodes.collection.run.estimate import estimate
from tactile_nodes.collection.run.outlet import Outlet
from tactile_nodes.collection.run.person import Person
from tactile_nodes.collection.run.recall import recalled
from tactile_nodes.collection.settings import CollectionSettings, SurfaceSettings
from tactile_nodes.drivers.cnc.contract import CncSettings, CncStatus, Switched
from tactile_nodes.emulators.world import World, WorldSettings
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.paths import write_whole
from tactile_nodes.sensing.geometry import Crop
from tactile_nodes.simulation.indenter import INDENTERS, indenter_name
from tactile_nodes.simulation.scene import WorldScene

BEGIN_NS = 946_684_800 * NS_PER_S
"""Simulated time begins with the year 2000, so that every run is the same."""
PAUSE_NS = 60 * NS_PER_S  # in simulated time, between a session and the one that goes on
CROP_PX = 440
SAFE_Z_MM = -26.0
CNC = CncSettings(safe_z_mm=SAFE_Z_MM)
SETTINGS = CollectionSettings(surface=SurfaceSettings(top_mm=-29.7))
RESULT = 'result.json'
TELL_S = 5.0


@dataclass(frozen=True)
class Session:
    """What to collect, and how.

    Attributes:
        folder: folder for the journal and the bags.
        plan: the presses.
        world: gel, indenter and place.
        rate_hz: rate of the force samples; fps: that of the camera.
        compression: compression of the bag.
        most: stop after this number of presses; 0: never.
    """

    folder: Path
    plan: PlanSettings
    world: WorldSettings = field(default_factory=WorldSettings)
    rate_hz: float = 200.0
    fps: float = 60.0
    compression: str = 'zstd'
    most: int = 0


def measured(arguments: argparse.Namespace, _: Run) -> Result:
    """Collect; the result is stored in the folder of the collection, session by session."""
    session = Session(
        arguments.folder,
        load_plan_settings(plan_path(arguments.plan)),
        WorldSettings(gel=arguments.gel, indenter=arguments.indenter),
        arguments.rate,
        arguments.fps,
        arguments.compression,
        arguments.presses,
    )
    return Collection(session, tell=_tell).run()


def named(indenter: str) -> CollectionSettings:
    """The settings with the name of the indenter, which determines how its force begins to grow."""
    return dataclasses.replace(SETTINGS, press=dataclasses.replace(SETTINGS.press, indenter=indenter))


class Collection:
    """One session of a run.

    Args:
        session: the settings of the session.
        tell: called with the progress every few seconds of real time.

    Raises:
        ConfigurationError: the journal belongs to another plan, or is in use.
        BagError: the bag cannot be written.
    """

    def __init__(self, session: Session, tell: Callable[[str], None] | None = None) -> None:
        self._session, self._tell = session, tell
        self._plan = make_plan(session.plan)
        self._order = ordered(self._plan, session.plan)
        self._started_s = self._reported_s = monotonic_s()
        self._surroundings = surroundings(' '.join(['tactile', *sys.argv[1:]]))
        self._asked = estimate(self._plan.plan_id, self._order, SETTINGS, CNC, session.world.gel_z_mm, session.fps)
        self._journal = Journal(session.folder / f'{self._plan.plan_id}.jsonl', self._plan)
        self._begin_ns = self._begins_ns()
        audit(self._journal, self._plan.plan_id, session.folder, self._begin_ns)
        world = World(session.world)
        self._scene = WorldScene(world)
        indenter = indenter_name(world.gel.tip_radius_mm, session.world.indenter)
        settings = named(indenter)
        self._rig = self._open_rig(world, settings)
        place = (session.world.gel_x_mm, session.world.gel_y_mm)
        self._bag = CollectionBag(
            self._new_folder(), self._rig.clock, self._plan.plan_id, indenter, place, session.compression
        )
        self._rig.sensor.listen(self._bag.sample)
        outlet = Outlet(
            self._on_record, self._bag.rest_image, self._bag.say, lambda: True, self._bag.suspect,
            lambda entry: recalled(session.folder, self._plan.plan_id, entry), lambda: 0,
            Person('nothing: it is simulated', self._bag.say, self._rig.clock),
        )  # fmt: skip
        self._campaign = Campaign(
            self._plan, self._order, self._journal, MachineRecord(None), self._rig.hands, settings, SAFE_Z_MM, outlet,
            unasked=True,
        )  # fmt: skip

    def _open_rig(self, world: World, settings: CollectionSettings) -> Rehearsal:
        gel, session = self._scene.gel, self._session
        self._crop = Crop.centred(gel.image_width, gel.image_height, CROP_PX, CROP_PX)
        return Rehearsal(
            world, settings, CNC, self._picture, session.rate_hz, session.fps,
            self._begin_ns, self._on_status, self._on_switch,
        )  # fmt: skip

    def run(self) -> dict[str, Any]:
        """Run to the end of the plan, or until Ctrl-C; returns the result, which is also stored in the folder."""
        before = signal.signal(signal.SIGINT, lambda *_: self._stop())
        try:
            ended = self._campaign.run()
        finally:
            signal.signal(signal.SIGINT, before)
            self._bag.close()
            self._journal.close()
        return self._keep(ended)

    def _picture(self, time_ns: int) -> Picture:
        return np.ascontiguousarray(self._crop.apply(self._scene.render(time_ns)))

    def _on_status(self, status: CncStatus) -> None:
        now = self._campaign.now
        self._bag.press, self._bag.surface = (now.press if now is not None else 0), self._campaign.surface
        self._bag.status(status)

    def _on_switch(self, switched: Switched) -> None:
        self._bag.switched(switched)

    def _on_record(self, record: Record) -> None:
        self._bag.record(record)
        progress = self._campaign.progress
        if self._session.most and progress.done + 1 - progress.before >= self._session.most:
            self._stop()
        if monotonic_s() - self._reported_s > TELL_S:
            self._reported_s = monotonic_s()
            self._keep('not ended yet')
            if self._tell is not None:
                self._tell(self._line(record.point))

    def _line(self, point: Point) -> str:
        """The run's progress line, whose times are simulated, with the remaining real time."""
        progress, real_s = self._campaign.progress, monotonic_s() - self._started_s
        each_s = real_s / max(1, progress.done - progress.before)
        left = duration(each_s * (progress.presses - progress.done))
        return f'{progress.line(point)} of simulated time, {left} of real time'

    def _stop(self) -> None:
        self._rig.hands.asked_to_stop = True

    def _begins_ns(self) -> int:
        """The start time: after all entries of earlier sessions."""
        entries = (self._journal.last(point.press) for point in self._plan.points)
        last_ns = max((entry.stamp_ns for entry in entries if entry is not None), default=0)
        return max(BEGIN_NS, last_ns + PAUSE_NS)

    def _new_folder(self) -> Path:
        number = len(list(self._session.folder.glob('collected_*'))) + 1
        return self._session.folder / f'collected_{number}'

    def _keep(self, ended: str) -> dict[str, Any]:
        """Store the result of all sessions so far; a killed session keeps its last stored state."""
        file = self._session.folder / RESULT
        earlier = [each for each in _sessions(file) if each['begin_ns'] != self._begin_ns]
        progress, clock, gel = self._campaign.progress, self._rig.clock, self._scene.gel
        own = {
            'begin_ns': self._begin_ns,
            'ended': ended,
            'recorded': progress.done - progress.before,
            'rejected': progress.rejected,
            'simulated_s': (clock.now_ns() - self._begin_ns) / NS_PER_S,
            'real_s': monotonic_s() - self._started_s,
            'messages': dict(self._bag.counts),
            'payload_bytes': dict(self._bag.bytes),
        }
        result = {
            **self._surroundings,
            'plan': self._plan.plan_id,
            'presses': progress.presses,
            'gel': gel.gel_id,
            **{name: getattr(self._session, name) for name in ('rate_hz', 'fps', 'compression')},
            'estimated_s': self._asked.seconds,
            'machine_s': self._asked.machine_s,
            'disk_bytes': sum(each.stat().st_size for each in self._session.folder.glob('*/*.mcap')),
            'sessions': [*earlier, own],
        }  # fmt: skip
        write_whole(file, f'{json.dumps(result, indent=1)}\n'.encode())
        return result


def _sessions(file: Path) -> list[dict[str, Any]]:
    try:
        found: list[dict[str, Any]] = json.loads(file.read_text(encoding='utf-8'))['sessions']
    except FileNotFoundError:
        return []
    except (OSError, ValueError, KeyError) as error:
        raise ConfigurationError(f'cannot read the earlier result {file}: {error}; take it away') from error
    return found


def _tell(line: str) -> None:
    terminal = sys.stderr.isatty()
    print(f'\r\033[K{line}' if terminal else line, end='' if terminal else '\n', file=sys.stderr, flush=True)


BENCHMARK = Benchmark(
    name='collection',
    about=__doc__,
    sources=(
        'benchmarks/collection/**',
        'benchmarks/devices/**',
        'tactile_nodes/bag/**',
        'config/plans/**',
        *RIG,
        *SIMULATED,
    ),
    page=page_text,
    measure=measured,
    files=('collection.md', 'collection.png'),
    by_hand=True,
    keeps=False,
    arguments=(
        argument('--plan', default='quick', help='YAML file, or a name in config/plans (default: quick)'),
        argument('-o', '--folder', type=Path, required=True, help='folder for journal, bags and result.json'),
        argument('--gel', default='', help="YAML file, or a name in config/gels (default: the paper's)"),
        argument('--indenter', default='tip', choices=('tip', *INDENTERS), help='shape of the indenter (default: tip)'),
        argument('--rate', type=float, default=200.0, help='force samples a second (default: 200)'),
        argument('--fps', type=float, default=60.0, help='images a second (default: 60)'),
        argument('--presses', type=int, default=0, help='stop after this number of presses (default: all)'),
        argument(
            '--compression', choices=sorted(COMPRESSIONS), default='zstd', help='compression of the bag (default: zstd)'
        ),
    ),
    example='example: tactile bench collection -o collected',
)
