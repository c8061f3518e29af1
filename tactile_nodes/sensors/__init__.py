"""Sensors as data: image, camera, gel and bins in one YAML file that all parts of the package read."""

from tactile_nodes.sensors.covering import MaskSettings
from tactile_nodes.sensors.description import (
    MOST_SLENDER,
    SIDES,
    BinSettings,
    CameraDescription,
    GelDescription,
    ImageSettings,
    PatternDescription,
    Sensor,
)
from tactile_nodes.sensors.dome import Dome
from tactile_nodes.sensors.hand import Hand, HandSensor, load_gripper, load_hand
from tactile_nodes.sensors.loading import load_sensor, mounting_of
from tactile_nodes.sensors.mounting import Mounting
from tactile_nodes.sensors.outline import Outline

__all__ = [
    'MOST_SLENDER',
    'SIDES',
    'BinSettings',
    'CameraDescription',
    'Dome',
    'GelDescription',
    'Hand',
    'HandSensor',
    'ImageSettings',
    'MaskSettings',
    'Mounting',
    'Outline',
    'PatternDescription',
    'Sensor',
    'load_gripper',
    'load_hand',
    'load_sensor',
    'mounting_of',
]
