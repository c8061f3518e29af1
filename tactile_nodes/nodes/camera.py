"""Publishes the frames of a camera, cropped and grey, with the stamp of their capture.

Publishes ``image_raw`` and ``camera_info``. A simulated camera also publishes ``true_force_distribution``. A camera
that watches a light on the digital line also publishes ``sync_edge``. Subscribes to ``held`` if it simulates an object
in a simulated gripper.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from tactile_nodes import conversions
from tactile_nodes.bus import topics
from tactile_nodes.bus.node.arguments import NodeArguments
from tactile_nodes.bus.node.diagnostics import Level
from tactile_nodes.bus.node.node import Node, NodeParams
from tactile_nodes.bus.node.priority import overload
from tactile_nodes.bus.node.runtime import run_node
from tactile_nodes.bus.protocol import Bus, Publisher
from tactile_nodes.clock import NS_PER_S, Clock
from tactile_nodes.drivers.camera.contract import CameraSettings, Frame, HasDrivenWorld, KnowsTruth
from tactile_nodes.drivers.camera.opening import open_camera
from tactile_nodes.drivers.sync_input.camera_light import CameraLight, LightSettings
from tactile_nodes.drivers.waiting import opened_within
from tactile_nodes.errors import DeviceError, DeviceTimeoutError, TactileError
from tactile_nodes.messages import types
from tactile_nodes.params import parameter
from tactile_nodes.sensing.geometry import Crop, grey, largest_side
from tactile_nodes.sensing.picture.quality import require_picture
from tactile_nodes.sensors import Mounting, load_sensor

READ_TIMEOUT_S = 0.25
HEALTH_PERIOD_S = 0.5
LINE = 'press'


@dataclass(frozen=True)
class CameraParams(CameraSettings, NodeParams):
    crop: int = parameter(
        440, 'side of the central square crop [px], smaller if the image is smaller; used without `sensor`', minimum=40
    )
    wait_s: float = parameter(
        0.0,
        'longest wait for a subscriber before the source starts; longer on an overloaded machine',
        minimum=0.0,
        maximum=60.0,
    )
    wait_for: str = parameter('', 'node that must subscribe before the source starts; empty: any node')
    open_within_s: float = parameter(
        0.0, 'how long to try to open a source that is missing or does not respond', minimum=0.0, maximum=60.0
    )
    frame_id: str = parameter('gel_camera_optical_frame', 'frame of the images')
    surface_frame_id: str = parameter(
        '', 'frame of the true force of a simulated camera; empty: that of `sensor`, or gel_surface'
    )
    light: LightSettings = field(default_factory=LightSettings)


class CameraNode(Node):
    """Reads in its own thread, so that the node still responds if the camera hangs."""

    NAME = 'camera'
    PARAMS = CameraParams

    def __init__(self, bus: Bus, arguments: NodeArguments | None = None, clock: Clock | None = None) -> None:
        super().__init__(bus, arguments, clock or bus.clock)  # devices do not follow a simulated time
        bus.graph().require_unpublished(self.names.resolve(topics.IMAGE.name))
        self._image = self.create_publisher(topics.IMAGE)
        self._info = self.create_publisher(topics.CAMERA_INFO)
        self._wait_for_listener()
        self._is_slow = False
        self._sensor = load_sensor(self.params.sensor) if self.params.sensor else None
        self._camera = opened_within(
            self.params.open_within_s,
            lambda: open_camera(self._settings(), self.clock, self._opening),
            self.clock,
            self._waiting,
        )
        name = self._camera.description.get('source', self.params.source)
        self.diagnostics.hardware |= dict.fromkeys(('camera', 'picture'), name)
        self._light = CameraLight(self.params.light, self.params.exposure_ms)
        self._edge = self.create_publisher(topics.SYNC_EDGE) if self._light.watched else None
        self._truth = self.create_publisher(topics.TRUE_FORCE) if isinstance(self._camera, KnowsTruth) else None
        if isinstance(self._camera, HasDrivenWorld) and (world := self._camera.driven_world) is not None:
            self.create_subscription(topics.HELD, lambda received: world.put(*conversions.press_of(received.message)))
        self._closing = threading.Event()
        self._frames = 0
        self._reader = self.run_beside('camera', self._read)
        self.create_timer(HEALTH_PERIOD_S, self._report_health)

    def on_close(self) -> None:
        self._closing.set()
        self._reader.join(timeout=2 * READ_TIMEOUT_S)
        self._camera.close()

    def _settings(self) -> CameraSettings:
        """With a description, its size of pictures: a crop of others would show another part of the gel."""
        settings: CameraSettings = self.params
        if self._sensor is None:
            return settings
        return replace(settings, width=self._sensor.image.width, height=self._sensor.image.height)

    def _wait_for_listener(self) -> None:
        if not (wait_s := self.params.wait_s):
            return
        begun_ns = self.clock.now_ns()
        while not self._has_listener():
            now_ns, longest_s = self.clock.now_ns(), wait_s * overload()
            if now_ns - begun_ns >= longest_s * NS_PER_S:
                self.log.warn(
                    f'{self.params.wait_for or "a node"} did not subscribe to {self._image.topic} within '
                    f'{longest_s:.3g} s, '
                    'so it misses the first pictures, which in a recording show the untouched gel: launch it again, or '
                    'set a longer wait_s'
                )
                return
            self.still_wanted()
            self.clock.sleep_until(now_ns + NS_PER_S // 100)

    def _has_listener(self) -> bool:
        if not (self._image.listeners and self.params.wait_for):
            return bool(self._image.listeners)
        wanted = self._image.topic, f'{self.names.namespace.rstrip("/")}/{self.params.wait_for}'
        ends = (end for each in self.bus.graph().participants for end in each.subscriptions)
        return any((end.name, end.node) == wanted for end in ends)

    def _opening(self, progress: str) -> None:
        say = self.log.info if self._is_slow else self.log.warn  # views show warnings, and wait for the first picture
        self._is_slow = True
        say(progress)
        self.still_wanted()

    def _waiting(self, error: DeviceError) -> None:
        self.still_wanted()
        self.log.warn(f'waiting for the camera: {error}', once=type(error).__name__)

    def _read(self) -> None:
        while not self._closing.is_set():
            try:
                frame = self._camera.read(READ_TIMEOUT_S)
            except DeviceTimeoutError:
                continue  # reported by the camera's health
            if frame is None:
                return  # the recording has ended; reported by the camera's health
            try:
                self._publish(frame)
            except TactileError:
                if not self._closing.is_set():
                    raise
                return  # closed meanwhile: on a busy machine, closing does not wait for this frame

    def _publish(self, frame: Frame) -> None:
        self._frames += 1
        height, width = frame.image.shape[:2]
        crop = self._crop(width, height)
        head = conversions.header(frame.stamp_ns, self.params.frame_id)
        picture = grey(crop.apply(frame.image))
        self._image.publish(conversions.image_message(picture, head))
        self._info.publish(conversions.camera_info(head, width, height, crop, self._sensor))
        if self._truth is not None and isinstance(self._camera, KnowsTruth):
            fields = conversions.truth_fields(self._camera.truth(frame.stamp_ns), self._camera.bins)
            surface = conversions.header(frame.stamp_ns, self._surface_frame())
            self._truth.publish(types.ForceDistribution(header=surface, **fields))
        if self._frames % 60 == 1:
            self._report_picture(picture, crop, self._light.complaint(width, height))
        if self._edge is not None:
            self._tell_edges(self._edge, frame)

    def _crop(self, width: int, height: int) -> Crop:
        """The crop of a picture: as in the sensor description, or a square."""
        if self._sensor is not None:
            return Crop.centred(width, height, *self._sensor.image.crop_px)
        side = largest_side(width, height, self.params.crop)
        return Crop.centred(width, height, side, side)

    def _surface_frame(self) -> str:
        described = self._sensor.frame if self._sensor else Mounting()
        return str(self.params.surface_frame_id or described.id)

    def _tell_edges(self, edge: Publisher, frame: Frame) -> None:
        first = self._light.edges + 1
        found = self._light.take(frame.image, frame.stamp_ns)
        edges = zip(found.stamp_ns, found.level, found.uncertainty_s, strict=True)
        for count, (stamp_ns, level, half_s) in enumerate(edges, start=first):
            head = conversions.header(int(stamp_ns), self.params.frame_id)
            message = types.SyncEdge(header=head, line=LINE, level=bool(level), count=count, uncertainty=float(half_s))
            edge.publish(message)

    def _report_picture(self, picture: np.ndarray, crop: Crop, complaint: str) -> None:
        try:
            require_picture(picture)
        except TactileError as error:
            self.report('picture', Level.WARN, str(error))
            return
        taken = f'{crop.width}x{crop.height}'
        if complaint:
            self.report('picture', Level.WARN, complaint)
        elif self._sensor is None and crop.width < self.params.crop:
            warning = f'the image is too small for a crop of {self.params.crop}; using {crop.width}'
            self.report('picture', Level.WARN, warning)
        else:
            self.report('picture', Level.OK, taken)

    def _report_health(self) -> None:
        health = self._camera.health
        described = self._camera.description
        self.report('camera', Level(health.level), health.message, frames=self._frames, **described)


main = partial(run_node, CameraNode)
