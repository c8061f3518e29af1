"""The simulated camera: it renders the shared scene at its frame rate.

The scene is a function of time, and the time is the frame's stamp on the host's time base. So another process that
builds the same scene (`build_scene`) knows the truth of every frame from its stamp alone.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping

import numpy as np

from tactile_nodes.clock import NS_PER_S, Clock
from tactile_nodes.contact_tables.gel_tables import contact_table, load_gel, tip_table
from tactile_nodes.contact_tables.touch_tables import USUAL, Contact, ready_contacts, solved_contact, usual_contact
from tactile_nodes.drivers.camera.contract import Camera, CameraSettings, Frame, SceneSettings, check_size
from tactile_nodes.drivers.health import Health, Level
from tactile_nodes.errors import ConfigurationError, DeviceError, DeviceTimeoutError
from tactile_nodes.sensing.geometry import BinGrid
from tactile_nodes.sensors import Sensor, load_sensor
from tactile_nodes.simulation import worlds
from tactile_nodes.simulation.described import gel_of
from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.optics import Press
from tactile_nodes.simulation.scene import Scene, TouchSchedule, Truth, WorldScene
from tactile_nodes.simulation.touch.table import TouchTable

NAME = 'the simulated camera'
TIP, MIXED, HELD = 'tip', 'mixed', 'held'
REST_BEFORE_FIRST_PRESS_NS = NS_PER_S
REST_FRAMES = 32
"""A rest image needs an untouched gel: for a second, and for twice the frames that a live launch uses."""

OnProgress = Callable[[str], None]
"""Receives progress messages while a scene is built."""


class Untouched:
    """The schedule before the shared world exists: no contact."""

    def press_at(self, time_ns: int) -> Press:  # noqa: ARG002
        """The tip above the centre."""
        return Press(0.0, 0.0, -1.0)


class SimulatedCamera(Camera):
    """Renders a frame when its time has come. Frames that were not read in time are lost, as with a real camera.

    A camera of a shared world (`scene.world`) shows the gel of that world as soon as it exists.
    """

    def __init__(self, settings: CameraSettings, clock: Clock, on_progress: OnProgress | None = None) -> None:
        self._settings = settings
        self._clock = clock
        self._on_progress = on_progress
        self._scene: Scene | None = None
        self._world: worlds.SharedWorld | None = None
        self._driven_world: worlds.InterpolatedWorld | None = None
        self._start_ns = 0
        self._sequence = -1
        self._dropped = 0

    @property
    def description(self) -> Mapping[str, str]:
        base = {'source': self._settings.source, 'kind': 'simulated camera', 'stamps': 'capture'}
        if self._scene is None:
            return base
        gel = self._scene.gel
        size = f'{gel.image_width}x{gel.image_height}'
        return {**base, 'gel': gel.gel_id, 'size': size, 'frames/s': f'{self._settings.fps:g}'}

    @property
    def health(self) -> Health:
        if self._scene is None:
            return Health(Level.STALE, f'{NAME} is not open')
        return Health(Level.OK, f'rendering, frames lost: {self._dropped}')

    def open(self) -> None:
        """Build the scene and render once, so that the first frame comes as fast as later ones.

        A new gel or contact shape is solved first, which takes some ten seconds and is reported.
        """
        if self._settings.fps <= 0:
            raise ConfigurationError(f'{NAME} needs a frame rate above 0; set fps')
        scene = build_scene(self._settings.scene, self._on_progress, self._settings.sensor)
        check_size(scene.render(0), self._settings, NAME)
        self._start_ns = self._clock.now_ns()
        if self._settings.scene.start_ns == 0:
            begins_ns = max(self._start_ns + REST_BEFORE_FIRST_PRESS_NS, self._due_ns(REST_FRAMES))
            scene.schedule = _schedule(self._settings.scene, begins_ns, scene)
        if self._settings.scene.world:
            scene.schedule = Untouched()
        if self._settings.scene.contact == HELD:
            self._driven_world, scene = _held(scene)
        self._scene, self._world = scene, None
        self._sequence, self._dropped = -1, 0

    @property
    def driven_world(self) -> worlds.InterpolatedWorld | None:
        """Where to store the state of a simulated gripper, if that touches the gel."""
        return self._driven_world

    @property
    def bins(self) -> BinGrid:
        return self._open_scene().bins

    def truth(self, stamp_ns: int) -> Truth:
        return self._open_scene().truth(stamp_ns)

    def read(self, timeout_s: float) -> Frame:
        """The next frame when it is due; if several are overdue, the newest."""
        scene = self._open_scene()
        now_ns = self._clock.now_ns()
        newest = int((now_ns - self._start_ns) * self._settings.fps / NS_PER_S)
        sequence = max(newest, self._sequence + 1)
        stamp_ns, deadline_ns = self._due_ns(sequence), now_ns + round(timeout_s * NS_PER_S)
        self._clock.sleep_until(min(stamp_ns, deadline_ns))
        if stamp_ns > deadline_ns:
            raise DeviceTimeoutError(f'{NAME} has no frame due within {timeout_s:g} s at its rate')
        self._dropped += sequence - self._sequence - 1
        self._sequence = sequence
        return Frame(np.asarray(scene.render(stamp_ns)), stamp_ns, sequence, self._dropped)

    def close(self) -> None:
        self._scene = None

    def _open_scene(self) -> Scene:
        if self._scene is None:
            raise DeviceError(f'{NAME} is closed; open it before reading')
        if self._settings.scene.world and (world := worlds.find(self._settings.scene.world)) is not self._world:
            self._scene, self._world = (self._scene if world is None else WorldScene(world)), world
        return self._scene

    def _due_ns(self, sequence: int) -> int:
        return self._start_ns + round(sequence * NS_PER_S / self._settings.fps)


def build_scene(settings: SceneSettings, on_progress: OnProgress | None = None, sensor: str = '') -> Scene:
    """The gel and the contacts; the same settings give the same world in every process.

    Raises:
        ConfigurationError: an invalid gel or sensor, or a contact that cannot be solved.
    """
    described = load_sensor(sensor) if sensor else Sensor()
    gel = _gel(settings, described)
    rows, cols = described.bins.rows, described.bins.cols
    bins = BinGrid(rows, cols, *gel.sides_mm) if settings.gel else BinGrid.of_sensor(described)
    table = tip_table(gel, on_progress and _progress('the tip', on_progress))
    scene = Scene(gel, bins=bins, table=table, bodies=_bodies(settings.contact, gel, on_progress))
    scene.schedule = _schedule(settings, settings.start_ns, scene)
    return scene


def _held(scene: Scene) -> tuple[worlds.InterpolatedWorld, WorldScene]:
    """A world that a gripper moves. The shear response is solved now, not at the first pull."""
    world = worlds.InterpolatedWorld(scene.gel, contact_table(scene.gel))
    held_scene = WorldScene(world, scene.bins)
    world.put(1, Press(0.0, 0.0, 0.1, shift_mm=(0.1, 0.0)))
    held_scene.render(1)
    world.put(2, Press(0.0, 0.0, -1.0))
    return world, held_scene


def _bodies(contact: str, gel: Gel, on_progress: OnProgress | None) -> dict[str, TouchTable]:
    """The bodies that touch the gel besides the tip; a new contact shape takes some ten seconds to solve."""
    if contact in ('', TIP, HELD):
        return {}
    if contact == MIXED:
        return ready_contacts(gel)
    wanted = usual_contact(gel, contact) if contact in USUAL else Contact.named(contact)
    return {contact: solved_contact(gel, wanted, on_progress and _progress(contact, on_progress))}


def _progress(contact: str, on_progress: OnProgress) -> Callable[[int, int], None]:
    def tell(done: int, stages: int) -> None:
        on_progress(f'solving the gel deformation under {contact} (only once): {done} of {stages} stages')

    return tell


def _schedule(settings: SceneSettings, start_ns: int, scene: Scene) -> TouchSchedule:
    """Tips press as close to the rim as in the paper, 13.5 of 16 mm from the centre, other bodies half as far out."""
    to_rim_mm = scene.gel.rim.inner_mm
    return TouchSchedule(
        seed=settings.seed,
        start_ns=start_ns,
        period_s=settings.period_s,
        shallowest_mm=min(settings.shallowest_mm, settings.deepest_mm),
        deepest_mm=settings.deepest_mm,
        reach_mm=13.5 / 16 * to_rim_mm,
        touch_reach_mm=0.5 * to_rim_mm,
        bodies=tuple((name, table.presses, table.stages) for name, table in scene.bodies.items()),
        every=2 if settings.contact == MIXED else 1,
    )


def _gel(settings: SceneSettings, sensor: Sensor) -> Gel:
    gel = load_gel(settings.gel) if settings.gel else gel_of(sensor)
    return gel if settings.gel_seed < 0 else dataclasses.replace(gel, seed=settings.gel_seed)
