"""The simulated gel of a described sensor."""

from __future__ import annotations

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.sensors import Sensor
from tactile_nodes.simulation.gel import Gel

DARK = {'background_grey': 140.0, 'marker_grey': -100.0}
"""Grey levels of a bright gel with dark markers."""


def gel_of(sensor: Sensor) -> Gel:
    """The gel of a description; for the shipped simulated sensor this is the default gel.

    Raises:
        ConfigurationError: its layers differ; the simulator supports one modulus only.
    """
    camera, gel, image, pattern = sensor.camera, sensor.gel, sensor.image, sensor.pattern
    if len({*zip(gel.moduli_mpa, gel.poisson_ratios, strict=True)}) > 1:
        raise ConfigurationError(f'{sensor.name} has different layers, but the simulator supports one modulus only')
    focal_px, down_px = camera.focal_lengths_px
    high, low = gel.markers_mm
    right, up, away = camera.position_mm
    across, down = camera.centre_px
    return Gel(**{
        'size_mm': gel.width_mm, 'height_mm': 0.0 if gel.height_mm == gel.width_mm else gel.height_mm,
        'skin_mm': high, 'soft_mm': gel.depth_mm - high,
        'markers_thickness_mm': 0.0 if low >= gel.depth_mm - 1e-9 else low - high,
        'shear_modulus_mpa': gel.moduli_mpa[0], 'poisson_ratio': gel.poisson_ratios[0],
        'camera': camera.model, 'focal_px_per_rad': focal_px, 'focal_ratio': down_px / focal_px,
        'distortion': camera.distortion,
        'camera_shift_mm': (right, up), 'camera_tilt_deg': camera.tilt_deg, 'camera_roll_deg': camera.roll_deg,
        'centre_shift_px': (across - (image.width - 1) / 2, down - (image.height - 1) / 2),
        'pupil_below_markers_mm': -away - gel.depth_mm,
        'image_width': image.width, 'image_height': image.height,
        'outline': gel.outline_mm, 'dome_radius_mm': gel.dome_radius_mm, 'sides': gel.sides,
        'pattern': pattern.kind, 'pitch_mm': pattern.pitch_mm, 'dot_mm': pattern.dot_mm,
        'marker_count': pattern.count, 'marker_diameter_mm': pattern.diameter_mm, **(DARK if pattern.dark else {}),
    })  # type: ignore[arg-type]  # fmt: skip
