"""The one table of topics. No topic is spelt anywhere else.

Names are relative: the node's namespace goes in front and remaps apply, as in ROS 2. Those that start with a slash are
the same for a whole domain.
"""

from __future__ import annotations

from dataclasses import dataclass

from tactile_nodes.bus.protocol import Qos


@dataclass(frozen=True)
class Topic:
    """A topic's name, type and quality of service, its usual rate, and whether bags record it unless told otherwise."""

    name: str
    type_name: str
    description: str
    qos: Qos
    rate_hz: float | None = None
    recorded: bool = True


_LATEST = Qos('latest', 1)
_LATCHED = Qos('latest', 1, latched=True)
# What is answered in a fraction of the time that it took to make: a short pause delays frames and loses none. Overload
# is shed before, at the images, so that nothing piles up here.
_RECENT = Qos('latest', 4)

IMAGE = Topic(
    'image_raw',
    'sensor_msgs/msg/Image',
    'the camera image, cropped and grey (mono8), stamped at capture',
    _LATEST,
    60.0,
)
CAMERA_INFO = Topic(
    'camera_info',
    'sensor_msgs/msg/CameraInfo',
    'size and region of interest of each image, with its stamp',
    _LATEST,
    60.0,
)
REFERENCE_IMAGE = Topic(
    'reference_image', 'sensor_msgs/msg/Image', 'the rest image that motion is measured against', _LATCHED
)
FLOW_FEATURES = Topic(
    'flow_features', 'tactile_nodes/msg/FlowFeatures', 'motion averaged over a grid of regions', _RECENT, 60.0
)
FORCE_DISTRIBUTION = Topic(
    'force_distribution',
    'tactile_nodes/msg/ForceDistribution',
    'normal force on each bin of the surface [N]',
    _LATEST,
    60.0,
)
WRENCH = Topic(
    'wrench', 'geometry_msgs/msg/WrenchStamped', 'net force on the gel in the surface frame [N, N m]', _LATEST, 60.0
)
# What other tools draw; made by the node force_views, each only while somebody listens to it.
FORCE_MAP = Topic(
    'force_map', 'sensor_msgs/msg/Image', 'the force on each bin as a picture of 32FC1, rows along y [N]', _LATEST, 60.0
)
FORCE_POINTS = Topic(
    'force_points',
    'sensor_msgs/msg/PointCloud2',
    'the centre of each bin and its normal_force [m, N]',
    _LATEST,
    60.0,
)
CONTACT = Topic(
    'contact',
    'geometry_msgs/msg/PointStamped',
    'the place of the largest contact, while there is one [m]',
    _LATEST,
    60.0,
)
CONTACT_MARKERS = Topic(
    'contact_markers', 'visualization_msgs/msg/MarkerArray', 'an arrow for each contact, 20 mm a newton', _LATEST, 60.0
)
TF_STATIC = Topic(
    '/tf_static', 'tf2_msgs/msg/TFMessage', "where the gel's surface is on the sensor", Qos('queue', 100, latched=True)
)
TRUE_FORCE = Topic(
    'true_force_distribution',
    'tactile_nodes/msg/ForceDistribution',
    'what really presses, as the simulator knows it',
    _LATEST,
    60.0,
)
MODEL_IN_USE = Topic(
    'model_in_use', 'tactile_nodes/msg/Provenance', 'the model that forces are computed with from now on', _LATCHED
)
CALIBRATION_IMAGE = Topic(
    'calibration_image',
    'sensor_msgs/msg/Image',
    'the rest image that the model in use was calibrated with; of no size where its file holds none',
    _LATCHED,
)
CALIBRATION_STATE = Topic(
    'calibration_state',
    'tactile_nodes/msg/CalibrationState',
    'whether the calibration still holds, and what to do where it does not',
    _LATCHED,
    1.0,
)
DIAGNOSTICS = Topic('/diagnostics', 'diagnostic_msgs/msg/DiagnosticArray', 'how each node is', Qos('queue', 100), 1.0)
ROSOUT = Topic('/rosout', 'rcl_interfaces/msg/Log', 'what each node says', Qos('queue', 1000))
CLOCK = Topic('/clock', 'rosgraph_msgs/msg/Clock', 'the time while a bag is replayed', _LATEST, recorded=False)
FORCE_TORQUE = Topic(
    'force_torque',
    'geometry_msgs/msg/WrenchStamped',
    'every sample of the force/torque sensor, untared, in its own axes [N, N m]',
    Qos('queue', 10000),
    1000.0,
)
PRESS_IMAGE = Topic(
    'press_image',
    'sensor_msgs/msg/Image',
    'the images of a press, taken while everything is at rest',
    Qos('queue', 100),
)
PRESS = Topic('press', 'tactile_nodes/msg/Press', 'each press of a plan, when it is over', Qos('queue', 100))
RIG_STATE = Topic('rig_state', 'tactile_nodes/msg/RigState', 'where the pressing machine is', Qos('queue', 100), 10.0)
SYNC_EDGE = Topic('sync_edge', 'tactile_nodes/msg/SyncEdge', 'edges of the digital line', Qos('queue', 1000))

TOPICS = {
    topic.name: topic
    for topic in (
        IMAGE, CAMERA_INFO, REFERENCE_IMAGE, FLOW_FEATURES, FORCE_DISTRIBUTION, WRENCH, TRUE_FORCE, MODEL_IN_USE,
        CALIBRATION_IMAGE, CALIBRATION_STATE, DIAGNOSTICS, ROSOUT, CLOCK, FORCE_TORQUE, PRESS_IMAGE, PRESS, RIG_STATE,
        SYNC_EDGE, FORCE_MAP, FORCE_POINTS, CONTACT, CONTACT_MARKERS, TF_STATIC,
    )
}  # fmt: skip


def default_qos(topic: str) -> Qos:
    """The quality of service of a full topic name by the table; a queue of 100 for a topic that is not in it."""
    short = topic.rpartition('/')[2]
    found = TOPICS.get(topic) or TOPICS.get(short)
    return found.qos if found else Qos('queue', 100)
