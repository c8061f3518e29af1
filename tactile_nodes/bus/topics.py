"""The table of all topics. Topic names are written nowhere else.

Names are relative: the node's namespace is put in front and remaps apply, as in ROS 2. Names with a leading slash are
the same in a whole domain.
"""

from __future__ import annotations

from dataclasses import dataclass

from tactile_nodes.bus.protocol import Qos


@dataclass(frozen=True)
class Topic:
    """A topic's name, type, quality of service and usual rate, and whether bags record it by default.

    `frame` is the default frame of its headers. `holds` gives units, signs and content. `lost` says what a bag is good
    for if some of these messages are missing.
    """

    name: str
    type_name: str
    description: str
    qos: Qos
    rate_hz: float | None = None
    recorded: bool = True
    frame: str = ''
    holds: str = ''
    lost: str = 'the rest can be used'


_REPLAYED = 'tactile launch replay computes them again from the images'
_PRESSED = 'presses in the gap are left out of data sets'
_CAMERA = 'gel_camera_optical_frame'
_SURFACE = 'gel_surface'
_SENSOR = 'force_torque_sensor'
_MACHINE = 'rig'
_PARENT = 'tactile_sensor'
_HAND = 'hand'
_RECORDER = 'of the recorder'

_LATEST = Qos('latest', 1)
_LATCHED = Qos('latest', 1, latched=True)
# Subscribers need much less time for these messages than was needed to make them: a short pause delays frames and loses
# none. In overload, images are dropped first, so that nothing piles up here.
_RECENT = Qos('latest', 4)

IMAGE = Topic(
    'image_raw',
    'sensor_msgs/msg/Image',
    'the camera image, cropped and grey (mono8), stamped at capture',
    _LATEST,
    60.0,
    frame=_CAMERA,
    holds='grey levels 0 to 255, mono8',
    lost='the forces of those pictures cannot be computed again',
)
CAMERA_INFO = Topic(
    'camera_info',
    'sensor_msgs/msg/CameraInfo',
    'size and region of interest of each image, with its stamp',
    _LATEST,
    60.0,
    frame=_CAMERA,
    holds='px: size of the whole image, and the rectangle cut from it; intrinsics of a described sensor',
)
REFERENCE_IMAGE = Topic(
    'reference_image',
    'sensor_msgs/msg/Image',
    'the rest image that motion is measured against',
    _LATCHED,
    frame=_CAMERA,
    holds='grey levels 0 to 255, mono8',
    lost='forces cannot be computed again from this bag: record another one',
)
FLOW_FEATURES = Topic(
    'flow_features',
    'tactile_nodes/msg/FlowFeatures',
    'motion averaged over a grid of regions',
    _RECENT,
    60.0,
    frame=_CAMERA,
    holds='px: mean motion of the markers in each region, x right and y down; what the model reads',
    lost=_REPLAYED,
)
FORCE_DISTRIBUTION = Topic(
    'force_distribution',
    'tactile_nodes/msg/ForceDistribution',
    'normal force on each bin of the surface [N]',
    _LATEST,
    60.0,
    frame=_SURFACE,
    holds='N on each bin, positive into the gel; contacts, sums, status, what it was computed with',
    lost=_REPLAYED,
)
FORCE_FIELD = Topic(
    'force_field',
    'tactile_nodes/msg/ForceField',
    'pressure and shear on a fine grid of the surface, of models that know [Pa]; made only for subscribers',
    _LATEST,
    60.0,
    frame=_SURFACE,
    holds='Pa on each cell, positive into the gel, shear along x and y, standard deviations; empty: not known',
    lost=_REPLAYED,
)
WRENCH = Topic(
    'wrench',
    'geometry_msgs/msg/WrenchStamped',
    'net force on the gel in the surface frame [N, N m]; made only for subscribers',
    _LATEST,
    60.0,
    frame=_SURFACE,
    holds='N and N·m, force on the sensor, so pressing is −z; torque about the origin of the frame; no status',
    lost=_REPLAYED,
)
HAND_WRENCH = Topic(
    'hand_wrench',
    'tactile_nodes/msg/HandWrench',
    'total force and torque on all sensors of a hand, in its frame, and the slip margin of each contact [N, N m]',
    _LATEST,
    60.0,
    frame=_HAND,
    holds='N and N·m of sensors whose pictures were captured within a frame time, with covariance; margins to slip',
    lost='it can be computed again from the forces of the sensors',
)
HELD = Topic(
    'held',
    'tactile_nodes/msg/SimulatedTouch',
    'what a simulated gripper does to the gel of a simulated camera',
    Qos('queue', 50),
    200.0,
    recorded=False,
    frame=_SURFACE,
    holds='m: place, depth in the gel, drag since it touched',
)
GRIPPER_COMMAND = Topic(
    'gripper_command',
    'std_msgs/msg/Float64',
    'target opening of a gripper: the distance of its fingers at rest [m]',
    _LATEST,
    holds='m',
)
JOINT_STATES = Topic(
    'joint_states',
    'sensor_msgs/msg/JointState',
    'opening of a gripper: the distance of its fingers at rest [m]',
    _RECENT,
    100.0,
    holds='m',
)
# Topics for other visualization tools; the node force_views publishes each only while it has subscribers.
FORCE_MAP = Topic(
    'force_map',
    'sensor_msgs/msg/Image',
    'the force on each bin as a picture of 32FC1, rows along y [N]',
    _LATEST,
    60.0,
    frame=_SURFACE,
    holds='N, 32FC1, a pixel a bin, rows along y, positive into the gel; NaN while the force is invalid',
)
PRESSURE_MAP = Topic(
    'pressure_map',
    'sensor_msgs/msg/Image',
    'the pressure on each cell of force_field as a picture of 32FC1, rows along y [Pa]; of models that know',
    _LATEST,
    60.0,
    frame=_SURFACE,
    holds='Pa, 32FC1, a pixel a cell, rows along y, positive into the gel; NaN while the force is invalid',
)
FORCE_POINTS = Topic(
    'force_points',
    'sensor_msgs/msg/PointCloud2',
    'the centre of each bin and its normal_force [m, N]',
    _LATEST,
    60.0,
    frame=_SURFACE,
    holds='x, y, z in m and normal_force in N, positive into the gel, float32; empty while the force is invalid',
)
CONTACT = Topic(
    'contact',
    'geometry_msgs/msg/PointStamped',
    'the place of the largest contact, while there is one [m]',
    _LATEST,
    frame=_SURFACE,
    holds='m; nothing is sent without contact, or while the force is invalid',
)
CONTACT_MARKERS = Topic(
    'contact_markers',
    'visualization_msgs/msg/MarkerArray',
    'an arrow along the force of each contact, 20 mm a newton, and the outline of the contact',
    _LATEST,
    60.0,
    frame=_SURFACE,
    holds='head of each arrow on the gel, shear included where it is known; green, orange when degraded',
)
TF_STATIC = Topic(
    '/tf_static',
    'tf2_msgs/msg/TFMessage',
    "where the gel's surface is on the sensor",
    Qos('queue', 100, latched=True),
    frame=_PARENT,
    holds='m and quaternion: where the surface stands in the parent frame',
)
TRUE_FORCE = Topic(
    'true_force_distribution',
    'tactile_nodes/msg/ForceDistribution',
    'the true contact force, from the simulator',
    _LATEST,
    60.0,
    frame=_SURFACE,
    holds='as force_distribution; only the simulated camera publishes it',
)
MODEL_IN_USE = Topic(
    'model_in_use',
    'tactile_nodes/msg/Provenance',
    'the model that forces are computed with from now on',
    _LATCHED,
    holds='names and hashes of model, calibration and gel',
)
CALIBRATION_IMAGE = Topic(
    'calibration_image',
    'sensor_msgs/msg/Image',
    'the rest image that the model in use was calibrated with; empty if its file holds none',
    _LATCHED,
    holds='grey levels 0 to 255, mono8; the frame field holds the id of the model',
)
CALIBRATION_STATE = Topic(
    'calibration_state',
    'tactile_nodes/msg/CalibrationState',
    'whether the calibration is still valid, and what to do if not',
    _LATCHED,
    0.5,
    holds='px and shares; level, reasons and a sentence',
)
DIAGNOSTICS = Topic(
    '/diagnostics',
    'diagnostic_msgs/msg/DiagnosticArray',
    'status of each node',
    Qos('queue', 100),
    1.0,
    holds='level, sentence and values of each part of each node',
)
ROSOUT = Topic(
    '/rosout',
    'rcl_interfaces/msg/Log',
    'log messages of each node',
    Qos('queue', 1000),
    holds='level, text and node',
)
CLOCK = Topic(
    '/clock',
    'rosgraph_msgs/msg/Clock',
    'the time while a bag is replayed',
    _LATEST,
    recorded=False,
    holds='s since 1970',
)
FORCE_TORQUE = Topic(
    'force_torque',
    'geometry_msgs/msg/WrenchStamped',
    'every sample of the force/torque sensor, untared, in its own axes [N, N m]',
    Qos('queue', 10000),
    1000.0,
    frame=_SENSOR,
    holds='N and N·m in the axes of the sensor, untared, by its own sign; NaN: not measured',
    lost='presses in the gap keep their forces, unless the clock of the samples has to be corrected',
)
FORCE_TORQUE_COUNTS = Topic(
    'force_torque_counts',
    'tactile_nodes/msg/ForceTorqueCounts',
    'what the force/torque sensor itself said: counts, status and sequence of every sample',
    Qos('queue', 1000),
    10.0,
    frame=_SENSOR,
    holds="the sensor's own units, before any tare; samples of 0.1 s in a message",
)
SERIAL_TRAFFIC = Topic(
    'serial_traffic',
    'tactile_nodes/msg/SerialTraffic',
    "every byte between the computer and the pressing machine's controller, both ways",
    Qos('queue', 10000),
    50.0,
    frame=_MACHINE,
    holds='bytes as they were written or read at once',
)
PRESS_IMAGE = Topic(
    'press_image',
    'sensor_msgs/msg/Image',
    'the images of a press, taken while everything is at rest',
    Qos('queue', 100),
    frame=_CAMERA,
    holds='grey levels 0 to 255, mono8',
    lost=_PRESSED,
)
PRESS = Topic(
    'press',
    'tactile_nodes/msg/Press',
    'each press of a plan, after its end',
    Qos('queue', 100),
    frame=_SURFACE,
    holds='m, N and N·m: where and how deep was pressed; force on the gel, so pressing is −z',
    lost=_PRESSED,
)
RIG_STATE = Topic(
    'rig_state',
    'tactile_nodes/msg/RigState',
    'position of the pressing machine',
    Qos('queue', 100),
    10.0,
    frame=_MACHINE,
    holds='m: place of the tip, and its depth in the gel',
)
SYNC_EDGE = Topic(
    'sync_edge',
    'tactile_nodes/msg/SyncEdge',
    'edges of the digital line',
    Qos('queue', 1000),
    frame=_RECORDER,
    holds='s: time and level of an edge, by the clock of the recorder that saw it',
    lost='clocks are matched by the remaining edges; see tactile bag sync',
)

TOPICS = {
    topic.name: topic
    for topic in (
        IMAGE, CAMERA_INFO, REFERENCE_IMAGE, FLOW_FEATURES, FORCE_DISTRIBUTION, FORCE_FIELD, WRENCH, TRUE_FORCE,
        MODEL_IN_USE, CALIBRATION_IMAGE, CALIBRATION_STATE, DIAGNOSTICS, ROSOUT, CLOCK, FORCE_TORQUE,
        FORCE_TORQUE_COUNTS, SERIAL_TRAFFIC, PRESS_IMAGE, PRESS, RIG_STATE, SYNC_EDGE, FORCE_MAP, PRESSURE_MAP,
        FORCE_POINTS, CONTACT, CONTACT_MARKERS, TF_STATIC, HAND_WRENCH, HELD, GRIPPER_COMMAND, JOINT_STATES,
    )
}  # fmt: skip


def in_table(topic: str) -> Topic | None:
    """The table entry of a full topic name; None if there is none."""
    return TOPICS.get(topic) or TOPICS.get(topic.rpartition('/')[2])


def default_qos(topic: str) -> Qos:
    """The quality of service in the table for a full topic name; a queue of 100 if there is no entry."""
    found = in_table(topic)
    return found.qos if found else Qos('queue', 100)
