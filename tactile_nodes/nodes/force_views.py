"""The force as standard messages that RViz, Foxglove and other robot software display.

Subscribes to ``force_distribution``; publishes ``force_map``, ``force_points``, ``contact`` and ``contact_markers``,
each only while it has subscribers, and once ``/tf_static``: the pose of the gel surface on the sensor. While
``pressure_map`` has subscribers, it subscribes to ``force_field``, which costs the estimator computing time.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar

from tactile_nodes.bus import topics
from tactile_nodes.bus.node.arguments import NodeArguments
from tactile_nodes.bus.node.diagnostics import Level
from tactile_nodes.bus.node.node import Node, NodeParams
from tactile_nodes.bus.node.runtime import run_node
from tactile_nodes.bus.protocol import Bus, Publisher, Received
from tactile_nodes.bus.subscription import Subscription
from tactile_nodes.clock import Clock
from tactile_nodes.params import parameter
from tactile_nodes.sensors import mounting_of
from tactile_nodes.viewing import force_shapes
from tactile_nodes.viewing.state import checked

REPORT_PERIOD_S = 1.0
LOOK_PERIOD_S = 0.5


@dataclass(frozen=True)
class ForceViewsParams(NodeParams):
    READ_ONLY: ClassVar[bool] = True

    sensor: str = parameter('', 'sensor description; its `frame` is used unless the next four are given')
    frame_id: str = parameter('', 'frame of the forces; empty: that of `sensor`, or gel_surface')
    parent_frame_id: str = parameter(
        'tactile_sensor', 'parent frame of the surface on /tf_static; empty: not published'
    )
    xyz_m: tuple[float, ...] = parameter((0.0, 0.0, 0.0), 'origin of the surface in the parent frame [m]')
    rpy_rad: tuple[float, ...] = parameter(
        (0.0, 0.0, 0.0), 'roll, pitch and yaw of the surface about the fixed axes of the parent frame [rad]'
    )

    def __post_init__(self) -> None:
        for name in ('xyz_m', 'rpy_rad'):
            if len(given := getattr(self, name)) != 3:
                raise ValueError(f'{name} takes three numbers, got {len(given)}')


class ForceViewsNode(Node):
    """Each view carries the stamp of its image; views without subscribers are not computed."""

    NAME = 'force_views'
    PARAMS = ForceViewsParams

    def __init__(self, bus: Bus, arguments: NodeArguments | None = None, clock: Clock | None = None) -> None:
        super().__init__(bus, arguments, clock)
        self._views = [
            (self.create_publisher(topics.FORCE_MAP), force_shapes.force_map),
            (self.create_publisher(topics.FORCE_POINTS), force_shapes.force_points),
            (self.create_publisher(topics.CONTACT), force_shapes.contact_point),
            (self.create_publisher(topics.CONTACT_MARKERS), force_shapes.contact_markers),
        ]
        self._pressure = self.create_publisher(topics.PRESSURE_MAP)
        self._field: Subscription | None = None
        self._published = {publisher.topic: 0 for publisher in self._publishers}
        self._transforms = self.create_publisher(topics.TF_STATIC)
        self._tell_transform()
        self.create_subscription(topics.FORCE_DISTRIBUTION, self._on_force)
        self._report()
        self.create_timer(REPORT_PERIOD_S, self._report)
        self.create_timer(LOOK_PERIOD_S, self._look)

    @property
    def _publishers(self) -> list[Publisher]:
        return [*(publisher for publisher, _ in self._views), self._pressure]

    def _on_force(self, received: Received) -> None:
        force = checked(received.message)
        for publisher, shape in self._views:
            if publisher.listeners and (view := shape(force)) is not None:
                publisher.publish(view)
                self._published[publisher.topic] += 1

    def _look(self) -> None:
        """Whether anyone subscribes to the field, which is computed only for subscribers."""
        wanted = self._pressure.listeners > 0
        if wanted and self._field is None:
            self._field = self.create_subscription(topics.FORCE_FIELD, self._on_field)
        elif not wanted and self._field is not None:
            self.end_subscription(self._field)
            self._field = None

    def _on_field(self, received: Received) -> None:
        self._pressure.publish(force_shapes.pressure_map(received.message))
        self._published[self._pressure.topic] += 1

    def _report(self) -> None:
        publishers = self._publishers
        wanted = sum(publisher.listeners > 0 for publisher in publishers)
        self.report('views', Level.OK, f'{wanted} of {len(publishers)} views have subscribers', **self._published)

    def _tell_transform(self) -> None:
        described = mounting_of(self.params.sensor)
        parent = self._given_or('parent_frame_id', described.parent)
        if parent:
            child = self.params.frame_id or described.id
            xyz_m, rpy_rad = self._given_or('xyz_m', described.xyz_m), self._given_or('rpy_rad', described.rpy_rad)
            transform = force_shapes.surface_transform(parent, child, xyz_m, rpy_rad, self.clock.now_ns())
            self._transforms.publish(transform)

    def _given_or(self, name: str, described: Any) -> Any:
        return described if (given := self.given(name)) is None else given


main = partial(run_node, ForceViewsNode)
