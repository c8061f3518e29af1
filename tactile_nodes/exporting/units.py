"""Units, signs and frame of exported columns, as the message definitions state them."""

from __future__ import annotations

from fnmatch import fnmatchcase

_WRENCH = {'*force.[xyz]': 'N', '*torque.[xyz]': 'N m'}
_UNITS: dict[str, dict[str, str]] = {
    'tactile_nodes/msg/ForceDistribution': {
        'bin_*': 'm', 'origin.*': 'm', 'contact.[xyz]': 'm', 'strongest.position_sigma': 'm', 'strongest.force*': 'N',
        'normal_force': 'N', 'total': 'N', 'total_sigma': 'N', 'peak': 'N', 'confidence': '0 to 1',
        'stages.*': 's', 'normal_force_sigma': 'N', 'shear_force_[xy]': 'N', 'strongest.shear_*': 'N',
        'strongest.torsion*': 'N m', 'strongest.area': 'm²', 'strongest.length': 'm', 'strongest.width': 'm',
        'strongest.angle': 'rad', 'strongest.slip_share': '0 to 1', **_WRENCH,
    },
    'tactile_nodes/msg/ForceField': {'cell_*': 'm', 'origin.*': 'm', 'pressure*': 'Pa', 'shear_*': 'Pa'},
    'geometry_msgs/msg/WrenchStamped': _WRENCH,
    'tactile_nodes/msg/HandWrench': {
        'margins.*.position.[xyz]': 'm', 'margins.*.normal': 'N', 'margins.*.shear': 'N',
        'margins.*.slip_share': '0 to 1', **_WRENCH,
    },
    'tactile_nodes/msg/RigState': {'position.*': 'm', 'depth': 'm'},
    'tactile_nodes/msg/Press': {
        **_WRENCH, 'tare.force.*': 'N', 'position.*': 'm', 'depth': 'm', 'depth_reported': 'm', 'force_rate': 'N/s',
    },
    'tactile_nodes/msg/CalibrationState': {'moved': 'px', 'since_calibration_moved': 'px'},
    'tactile_nodes/msg/SyncEdge': {'uncertainty': 's', 'device_rate': 'Hz'},
    'sensor_msgs/msg/JointState': {
        'position': 'rad or m', 'velocity': 'rad/s or m/s', 'effort': 'N m or N',
    },
    'geometry_msgs/msg/PoseStamped': {'pose.position.*': 'm', 'pose.orientation.*': 'quaternion'},
    'geometry_msgs/msg/TwistStamped': {'twist.linear.*': 'm/s', 'twist.angular.*': 'rad/s'},
}  # fmt: skip

SIGNS = (
    'normal_force, pressure, total and peak: positive presses into the gel. shear_*: shear on the gel along x and y. '
    'wrench: force on the gel, so pressing is -z; its torque is about the origin. '
    'gel_surface: origin in the middle, x to the right and y down in the image, z out of the gel.'
)
STATUS = {'0': 'ok', '1': 'degraded: less certain than usual', '2': 'invalid: do not use the numbers; reasons says why'}


def unit_of(type_name: str, column: str) -> str:
    """The unit of a column; empty if it has none or the type is unknown."""
    if column.endswith('_ns'):
        return 'ns'
    patterns = _UNITS.get(type_name, {})
    return next((unit for pattern, unit in patterns.items() if fnmatchcase(column, pattern)), '')
