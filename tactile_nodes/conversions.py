"""Converts between computed values (arrays, millimetres) and messages (SI units)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from tactile_nodes.errors import ImageError, MessageError
from tactile_nodes.messages import stamp_ns, time_from_ns, types
from tactile_nodes.sensing.elasticity.patches import PatchGrid
from tactile_nodes.sensing.explain.reading import Acting, Contact, Region, SurfaceField
from tactile_nodes.sensing.features import Features
from tactile_nodes.sensing.geometry import BinGrid, Crop, grey
from tactile_nodes.sensing.picture.motion import TERMS, PictureMotion
from tactile_nodes.shapes import Float, Float32, UInt8

if TYPE_CHECKING:
    from tactile_nodes.sensing.judge.drift_verdict import Verdict
    from tactile_nodes.sensors import Sensor
    from tactile_nodes.simulation.optics import Press
    from tactile_nodes.simulation.scene import Truth

MILLI = 1e-3
PASCALS = 1e6
"""Pascals in a megapascal."""
SI = np.array([1.0, 1.0, 1.0, MILLI, MILLI, MILLI])
"""Factors from N and N mm to the SI units of force and torque."""

EXPLANATIONS = {
    'nothing': types.ForceDistribution.EXPLANATION_NOTHING,
    'tips': types.ForceDistribution.EXPLANATION_TIPS,
    'field': types.ForceDistribution.EXPLANATION_FIELD,
}
REGION_FIELDS = (
    'shear_x', 'shear_y', 'shear_sigma', 'torsion', 'torsion_sigma', 'area', 'length', 'width', 'angle', 'slip_share',
)  # fmt: skip

_CHANNELS = {'mono8': 1, 'bgr8': 3, 'rgb8': 3}
_PIXELS = {
    'mono8': ('uint8', 1), '8UC1': ('uint8', 1), 'bgr8': ('uint8', 3), 'rgb8': ('uint8', 3),
    'mono16': ('uint16', 1), '16UC1': ('uint16', 1), '32FC1': ('float32', 1),
}  # fmt: skip


def header(stamp_ns: int, frame_id: str) -> types.Header:
    return types.Header(stamp=time_from_ns(stamp_ns), frame_id=frame_id)


def image_message(image: UInt8[np.ndarray, 'h w'], head: types.Header) -> types.Image:
    """A grey image as sensor_msgs/Image; the pixels are copied once, into the message."""
    height, width = image.shape
    data = np.ascontiguousarray(image).reshape(-1)
    if data.base is not None or not data.flags.owndata:
        data = data.copy()  # the message freezes its arrays, but the camera owns its buffer
    return types.Image(header=head, height=height, width=width, encoding='mono8', step=width, data=data)


def camera_info(
    head: types.Header, width: int, height: int, crop: Crop, sensor: Sensor | None = None
) -> types.CameraInfo:
    """The CameraInfo of an image and its crop; intrinsics of a described sensor, else 0, as in ROS."""
    roi = types.RegionOfInterest(x_offset=crop.x, y_offset=crop.y, width=crop.width, height=crop.height)
    intrinsics: dict[str, Any] = {'distortion_model': 'equidistant'}
    if sensor is not None:
        k = np.array(sensor.camera.matrix)
        intrinsics = {
            'distortion_model': sensor.camera.distortion_model, 'd': np.array(sensor.camera.lens), 'k': k.ravel(),
            'r': np.eye(3).ravel(), 'p': np.column_stack([k, np.zeros(3)]).ravel(),
        }  # fmt: skip
    return types.CameraInfo(header=head, width=width, height=height, roi=roi, **intrinsics)


def image_array(message: types.Image) -> UInt8[np.ndarray, 'h w']:
    """The grey image in a sensor_msgs/Image: a view of its bytes for mono8, the luma for bgr8 and rgb8.

    Raises:
        ImageError: another encoding, or fewer bytes than its size and step require.
    """
    if message.encoding not in _CHANNELS:
        raise ImageError(
            f'received an image with encoding {message.encoding!r}; set the camera to one of {", ".join(_CHANNELS)}'
        )
    channels = _CHANNELS[message.encoding]
    picture = _rows(message, message.width * channels)
    if channels == 1:
        return picture
    return grey(picture.reshape(message.height, message.width, channels), message.encoding[:3])


def image_pixels(message: types.Image) -> np.ndarray:
    """The unconverted image in a sensor_msgs/Image: h by w, or h by w by 3 in the order red, green, blue.

    Raises:
        ImageError: an unknown encoding, or fewer bytes than its size and step require.
    """
    if message.encoding not in _PIXELS:
        raise ImageError(
            f'an image with encoding {message.encoding!r} cannot be stored; supported: {", ".join(_PIXELS)}'
        )
    dtype, channels = np.dtype(_PIXELS[message.encoding][0]), _PIXELS[message.encoding][1]
    rows = _rows(message, message.width * channels * dtype.itemsize)
    stored = dtype.newbyteorder('>' if message.is_bigendian else '<')
    picture: np.ndarray = np.ascontiguousarray(rows).view(stored).astype(dtype, copy=False)
    if channels == 1:
        return picture
    coloured: np.ndarray = picture.reshape(message.height, message.width, channels)
    return coloured[..., ::-1] if message.encoding == 'bgr8' else coloured


def _rows(message: types.Image, row_bytes: int) -> UInt8[np.ndarray, 'h row_bytes']:
    """The bytes of each row, without those that only fill it up. Raises ImageError."""
    if message.step < row_bytes or len(message.data) < message.step * message.height:
        raise ImageError(
            f'an image of {message.width}x{message.height} {message.encoding} has {len(message.data)} bytes with a '
            f'step of {message.step}; check the node that publishes it'
        )
    rows = np.asarray(message.data[: message.step * message.height]).reshape(message.height, message.step)
    return rows[:, :row_bytes]


def features_array(message: types.FlowFeatures) -> Features:
    """The features in a message.

    Raises:
        MessageError: the lengths of the arrays do not match rows, cols and channels.
    """
    rows, cols, channels = message.rows, message.cols, message.channels
    if len(message.values) != rows * cols * channels or len(message.confidence) != rows * cols:
        raise MessageError(
            f'features of {rows}x{cols}x{channels} have {len(message.values)} values and '
            f'{len(message.confidence)} confidences'
        )
    values = message.values.reshape(rows, cols, channels)
    return Features(message.encoding, values, message.confidence.reshape(rows, cols), message.noise)


def picture_motion(message: types.FlowFeatures) -> PictureMotion | None:
    """The motion of the whole image that was subtracted from the features in a message; None if none was."""
    terms = message.picture_motion.tolist()
    return PictureMotion(tuple(terms)) if len(terms) == TERMS else None


def feature_fields(features: Features) -> dict[str, Any]:
    """The fields of a FlowFeatures that hold the features themselves."""
    rows, cols, channels = features.values.shape
    return {
        'rows': rows,
        'cols': cols,
        'channels': channels,
        'encoding': features.encoding,
        'values': features.values.reshape(-1).copy(),
        'confidence': features.confidence.reshape(-1).copy(),
        'noise': features.noise_px,
    }


def force_fields(
    forces_n: Float32[np.ndarray, 'rows cols'],
    bins: BinGrid,
    contacts: Sequence[Contact] = (),
    *,
    total_sigma_n: float = math.nan,
    unlikeness: float = math.nan,
    acting: Acting | None = None,
) -> dict[str, Any]:
    """The fields of a ForceDistribution with forces and contacts; without contact the position is NaN."""
    width_mm, height_mm = bins.bin_size_mm
    listed = [_contact_message(each) for each in contacts]
    return {
        'rows': bins.rows,
        'cols': bins.cols,
        'bin_width': width_mm * 1e-3,
        'bin_height': height_mm * 1e-3,
        'origin': types.Point(x=bins.origin_mm[0] * 1e-3, y=bins.origin_mm[1] * 1e-3),
        'normal_force': np.ascontiguousarray(forces_n, np.float32).reshape(-1).copy(),
        'total': float(forces_n.sum(dtype=np.float64)),
        'peak': float(forces_n.max()),
        'total_sigma': total_sigma_n,
        'in_contact': bool(listed),
        'contact': listed[0].position if listed else types.Point(x=math.nan, y=math.nan, z=math.nan),
        'contacts': listed,
        'unlikeness': unlikeness,
        **(_acting_fields(acting) if acting is not None else _pressing_fields(forces_n, bins)),
    }


def _acting_fields(acting: Acting) -> dict[str, Any]:
    return {
        'normal_force_sigma': _flat(acting.normal_sigma_n),
        'shear_force_x': _flat(acting.shear_n[..., 0]),
        'shear_force_y': _flat(acting.shear_n[..., 1]),
        'explanation': EXPLANATIONS[acting.explanation],
        'wrench': _wrench(acting.wrench * SI),
        'wrench_covariance': (acting.wrench_covariance * SI * SI[:, None]).reshape(-1),
    }


def _pressing_fields(forces_n: Float32[np.ndarray, 'rows cols'], bins: BinGrid) -> dict[str, Any]:
    """The wrench of a readout with normal forces only: each acts at the centre of its bin, r x F = (-y f, x f, 0).

    If a force is NaN, the whole wrench is NaN.
    """
    x, y = _levers(bins)
    forces = forces_n.reshape(-1).astype(float)
    none = 0.0 * float(forces.sum())
    torque = -float(y @ forces), float(x @ forces), none
    covariance = np.zeros(36)
    covariance[0] = -1.0
    return {
        'wrench': _wrench(np.array([none, none, -float(forces.sum()), *torque])),
        'wrench_covariance': covariance,
    }


@lru_cache(16)
def _levers(bins: BinGrid) -> Float[np.ndarray, '2 bins']:
    """x and y of the centre of each bin (m)."""
    levers: np.ndarray = bins.centres_mm.reshape(-1, 2).T * MILLI
    return levers


def _wrench(numbers: Float[np.ndarray, ' 6']) -> types.Wrench:
    x, y, z, about_x, about_y, about_z = numbers.tolist()
    return types.Wrench(force=types.Vector3(x=x, y=y, z=z), torque=types.Vector3(x=about_x, y=about_y, z=about_z))


def _flat(values: np.ndarray) -> Float32[np.ndarray, ' values']:
    """A flattened copy in row-major order; a copy, because a message freezes its arrays."""
    return np.array(values, np.float32).reshape(-1)


def field_message(field: SurfaceField | None, bins: BinGrid, force: types.ForceDistribution) -> types.ForceField:
    """Pressure and shear on fine cells, with its force distribution; None: not known in this frame."""
    rows, cols = PatchGrid(bins).shape if field is None else field.pressure_mpa.shape
    return types.ForceField(
        header=force.header,
        rows=rows,
        cols=cols,
        cell_width=bins.width_mm / cols * MILLI,
        cell_height=bins.height_mm / rows * MILLI,
        origin=force.origin,
        **({} if field is None else _maps(field)),
        status=force.status,
        reasons=force.reasons,
        explanation=force.explanation,
        provenance=force.provenance,
    )


def _maps(field: SurfaceField) -> dict[str, np.ndarray]:
    maps = {
        'pressure': field.pressure_mpa,
        'shear_x': field.shear_mpa[..., 0],
        'shear_y': field.shear_mpa[..., 1],
        'pressure_sigma': field.pressure_sigma_mpa,
        'shear_sigma': field.shear_sigma_mpa,
    }
    return {name: _flat(values * PASCALS) for name, values in maps.items()}


def _contact_message(contact: Contact) -> types.Contact:
    return types.Contact(
        position=types.Point(x=contact.x_mm * 1e-3, y=contact.y_mm * 1e-3, z=0.0),
        position_sigma=contact.sigma_mm * 1e-3,
        force=contact.force_n,
        force_sigma=contact.sigma_n,
        **_region_fields(contact.region),
    )


def _region_fields(region: Region | None) -> dict[str, float]:
    if region is None:
        return dict.fromkeys(REGION_FIELDS, math.nan)
    numbers = (
        *region.shear_n, region.shear_sigma_n, region.torsion_n_mm * MILLI, region.torsion_sigma_n_mm * MILLI,
        region.area_mm2 * MILLI**2, region.length_mm * MILLI, region.width_mm * MILLI, region.angle_rad,
        region.slip_share,
    )  # fmt: skip
    return dict(zip(REGION_FIELDS, map(float, numbers), strict=True))


def touch_message(stamp_ns: int, frame_id: str, press: Press) -> types.SimulatedTouch:
    """The press on a simulated gel, as a message to its camera."""
    return types.SimulatedTouch(
        header=header(stamp_ns, frame_id), x=press.x_mm * MILLI, y=press.y_mm * MILLI, depth=press.depth_mm * MILLI,
        drag_x=press.shift_mm[0] * MILLI, drag_y=press.shift_mm[1] * MILLI,
    )  # fmt: skip


def press_of(message: types.SimulatedTouch) -> tuple[int, Press]:
    """The reverse of `touch_message`: the time and the press."""
    from tactile_nodes.simulation.optics import Press  # here, because few processes simulate

    x_mm, y_mm, depth_mm, *drag_mm = (
        each / MILLI for each in (message.x, message.y, message.depth, message.drag_x, message.drag_y)
    )
    return stamp_ns(message.header.stamp), Press(x_mm, y_mm, depth_mm, shift_mm=(drag_mm[0], drag_mm[1]))


def gripper_state(stamp_ns: int, opening_mm: float) -> types.JointState:
    return types.JointState(header=header(stamp_ns, ''), name=['gripper'], position=np.array([opening_mm * MILLI]))


def opening_mm(state: types.JointState) -> float | None:
    """The opening of a gripper; None if the message does not hold exactly one number."""
    return float(state.position[0]) / MILLI if len(state.position) == 1 else None


def truth_fields(truth: Truth, bins: BinGrid) -> dict[str, Any]:
    """The fields of a ForceDistribution with the true forces: one contact with all of them, shear included."""
    whole = Region(truth.shear_n, 0.0, truth.torsion_n_mm, 0.0, *5 * (math.nan,))
    contacts = (Contact(*truth.position_mm, truth.total_n, 0.0, 0.0, whole),) if truth.in_contact else ()
    x, y = truth.position_mm
    along_x, along_y = truth.shear_n
    torque = -y * truth.total_n, x * truth.total_n, truth.torsion_n_mm + x * along_y - y * along_x
    acting = Acting(
        explanation=truth.explanation,
        shear_n=truth.shear_force_n,
        normal_sigma_n=np.zeros_like(truth.normal_force_n),
        wrench=np.array([along_x, along_y, -truth.total_n, *torque]),
        wrench_covariance=np.zeros((6, 6)),
    )
    fields = force_fields(truth.normal_force_n, bins, contacts, total_sigma_n=0.0, acting=acting)
    return {**fields, 'stages': types.StageTimes(*5 * (math.nan,))}


def calibration_fields(verdict: Verdict) -> dict[str, Any]:
    """The fields of a CalibrationState that hold the verdict itself."""
    rest, calibration, ratio = verdict.since_rest, verdict.since_calibration, verdict.ratio
    return {
        'level': types.CalibrationState.LEVEL_UNCALIBRATED if verdict.uncalibrated else int(verdict.level),
        'reasons': int(verdict.reasons),
        'text': verdict.text,
        'moved': verdict.moved_px,
        'contrast': math.nan if rest is None else rest.contrast,
        'lost': verdict.lost,
        'since_calibration_moved': math.nan if calibration is None else calibration.size_px,
        'since_calibration_contrast': math.nan if calibration is None else calibration.contrast,
        'since_calibration_lost': math.nan if calibration is None else 1 - calibration.found,
        'force_ratio': math.nan if ratio is None else ratio.ratio,
        'force_ratio_sigma': math.nan if ratio is None else ratio.sigma,
        'force_ratio_contacts': 0 if ratio is None else ratio.contacts,
        'unlike_share': verdict.unlike_share,
        'untouched': time_from_ns(verdict.quiet_ns or 0),
    }


def wrench_message(force: types.ForceDistribution) -> types.WrenchStamped:
    """The net force on the gel and the torque about the frame's origin; pressing is -z, since z points out of the gel.

    For an invalid distribution all values are NaN, because a wrench has no status field.
    """
    if force.status == types.ForceDistribution.STATUS_INVALID:
        nothing = types.Vector3(x=math.nan, y=math.nan, z=math.nan)
        return types.WrenchStamped(header=force.header, wrench=types.Wrench(force=nothing, torque=nothing))
    return types.WrenchStamped(header=force.header, wrench=force.wrench)
