"""Arguments and parameters of the live launch for one sensor of a hand."""

from __future__ import annotations

from pathlib import Path

from tactile_nodes.params import load_parameter_file, normal_pattern, parameter_file_text
from tactile_nodes.paths import share_directory
from tactile_nodes.sensors import Hand, HandSensor


def parameter_text(sensor: HandSensor, hand: Hand, *, open_within_s: float) -> str:
    """A parameter file with the sensor's own parameters, the rate, and its frame names.

    The camera may take `open_within_s` to open. If it delivers more pictures than the rate, the excess is skipped.
    The node of the whole hand publishes the transforms, so the views of single sensors do not.

    Raises:
        ConfigurationError: the sensor's own parameter file is not valid.
    """
    blocks: dict[str, dict[str, object]] = {}
    for block in load_parameter_file(sensor.config or share_directory() / 'config' / 'live.yaml'):
        named = blocks.setdefault(normal_pattern(block.pattern), {})
        named.update({name: located.value for name, located in block.values.items()})
    frame, of_pictures = sensor.frames
    parameters: dict[str, dict[str, object]] = {
        'camera': {
            'fps': hand.fps,
            'open_within_s': open_within_s,
            'surface_frame_id': frame,
            'frame_id': of_pictures,
        },
        'flow_features': {'most_hz': hand.fps},
        'force_estimator': {'frame_id': frame},
        'force_views': {'frame_id': frame, 'parent_frame_id': ''},
    }
    for node, values in parameters.items():
        blocks.setdefault(f'/**/{node}', {}).update(values)
    return parameter_file_text(blocks)


def arguments_of(sensor: HandSensor, namespace: str, parameters: Path) -> dict[str, str]:
    """Launch arguments; there is one page for the whole hand."""
    return {
        'namespace': f'{namespace.rstrip("/")}/{sensor.name}',
        'source': sensor.source,
        'sensor': sensor.sensor,
        'model': sensor.model,
        'contact': sensor.contact,
        'config': str(parameters),
        'page': 'false',
    }
