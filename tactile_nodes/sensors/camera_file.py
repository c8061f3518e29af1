"""Reads camera calibrations: OpenCV's YAML, ROS's camera_info file, or a printed camera_info message.

No objects are created from such a file: tags such as ``!!opencv-matrix`` are ignored, and numbers are read as numbers.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import yaml

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.files import read_text
from tactile_nodes.params import Value, compose

MATRIX = 'cameramatrix', 'k'
LENS = 'distortioncoefficients', 'distcoeffs', 'd'
WIDTH, HEIGHT = ('imagewidth', 'width'), ('imageheight', 'height')
"""Names of entries, in lower case and without underscores."""

MODELS = {
    'plumb_bob': 'pinhole', 'radtan': 'pinhole', 'rational_polynomial': 'pinhole',
    'equidistant': 'fisheye', 'fisheye': 'fisheye',
}  # fmt: skip
LENS_NUMBERS, FISHEYE_NUMBERS = 5, 4
"""Number of distortion coefficients: in a description, and in OpenCV's fisheye model."""
BINNED = 'binningx', 'binningy'
SAY_LENS = 'add the line distortion_model: equidistant (a fisheye) or distortion_model: plumb_bob (a pinhole)'


def read_camera_file(path: Path, model: str = '') -> dict[str, Value]:
    """The values of a calibration, by the dotted names of a sensor's description.

    `model` is the lens model if the file does not state one.

    Raises:
        ConfigurationError: there is no such file, it has none of these formats, or no description can hold its lens.
    """
    file = _CameraFile(path)
    file.require_whole()
    (fx, skew, u, *_), (_, fy, v, *_), _ = (file.matrix()[row : row + 3] for row in (0, 3, 6))
    model = file.model(model)
    lens = file.lens(model)
    if skew or not (fx > 0 and fy > 0):
        raise file.refusal('its camera matrix must be [fx 0 cx; 0 fy cy; 0 0 1] with fx and fy above 0')
    values: dict[str, Value] = {'camera.model': model, 'camera.centre_px': [u, v], 'camera.distortion': lens}
    if model == 'fisheye':
        values |= {'camera.focal_px_per_rad': fx, 'camera.focal_ratio': fy / fx}
    else:
        values['camera.focal_px'] = [fx, fy]
    return values | file.size()


class _CameraFile:
    """The entries of a file, found by any of their usual names."""

    def __init__(self, path: Path) -> None:
        self._path = path
        try:
            text = read_text(path, encoding='utf-8-sig')  # some editors write a byte order mark
        except (OSError, UnicodeDecodeError) as error:
            raise ConfigurationError(f'cannot read the calibration {path}: {error}') from error
        # OpenCV begins with a line that is not YAML, and `ros2 topic echo` ends each message with one.
        text = text.split('\n', 1)[-1] if text.startswith('%YAML:') else text
        root = compose(text.rstrip().removesuffix('---'), str(path))
        if not isinstance(root, yaml.MappingNode):
            raise self.refusal('it is not a YAML file of OpenCV or camera_info; save it as .yml, not as .xml or .json')
        self._entries = {
            key.value.lower().replace('_', ''): value for key, value in root.value if isinstance(key, yaml.ScalarNode)
        }

    def refusal(self, text: str) -> ConfigurationError:
        return ConfigurationError(f'the calibration {self._path} cannot be used: {text}')

    def matrix(self) -> list[float]:
        """The nine numbers of the camera matrix, row by row."""
        numbers = self._numbers(MATRIX)
        if numbers is None or len(numbers) != 9 or numbers[6:] != [0.0, 0.0, 1.0]:
            raise self.refusal('it has no camera_matrix (or k) of nine numbers whose last row is 0 0 1')
        return numbers

    def model(self, wanted: str) -> str:
        """The lens model: as the file states, or else as wanted."""
        named = self._text('distortionmodel')
        if named and named not in MODELS:
            raise self.refusal(f'its distortion_model {named!r} must be one of {", ".join(MODELS)}')
        found = MODELS.get(named, '') or ('fisheye' if self._text('fisheyemodel') in {'1', 'true'} else '')
        if wanted and found and wanted != found:
            raise self.refusal(f'its lens is a {found}, but the description says camera.model: {wanted}; change one')
        if not found:
            self._require_likely(wanted)
        return found or wanted or 'pinhole'

    def _require_likely(self, wanted: str) -> None:
        """Refuse numbers that may belong to another lens model than the wanted one, if the file does not state it."""
        count = len(self._numbers(LENS) or [])
        if wanted == 'fisheye' and count > FISHEYE_NUMBERS:
            raise self.refusal(
                f"its distortion has {count} numbers, but OpenCV's fisheye has {FISHEYE_NUMBERS}: it belongs to a "
                f'pinhole; otherwise {SAY_LENS}'
            )
        if not wanted and self._shape(LENS) == (FISHEYE_NUMBERS, 1):
            raise self.refusal(
                f"its distortion has {FISHEYE_NUMBERS} rows of one number, as OpenCV's fisheye writes it, but it does "
                f'not state the lens model: {SAY_LENS}'
            )

    def require_whole(self) -> None:
        """Refuse a calibration whose images the driver binned or cropped."""
        binned = [self._text(name) not in {'', '0', '1'} for name in BINNED]
        if any(binned):
            raise self.refusal(
                'its images are binned (binning_x, binning_y), but its numbers hold for full images; switch binning '
                'off, or calibrate with images as they are used'
            )
        roi = self._inner('roi')
        size = {'width': next(filter(None, map(self._text, WIDTH)), ''),
                'height': next(filter(None, map(self._text, HEIGHT)), '')}  # fmt: skip
        if any(roi.get(name, '0') not in {'0', size.get(name, '0')} for name in (*size, 'x_offset', 'y_offset')):
            raise self.refusal(
                'its images are cropped (roi), but its numbers hold for full images; calibrate with images as they are '
                'used'
            )

    def lens(self, model: str) -> list[float]:
        """The five distortion coefficients of a description."""
        numbers = self._numbers(LENS) or []
        kept = FISHEYE_NUMBERS if model == 'fisheye' else LENS_NUMBERS
        if any(numbers[kept:]):
            raise self.refusal(
                f'its distortion has {len(numbers)} numbers, but a {model} has {kept} here; calibrate without '
                'rational, thin prism or tilted terms'
            )
        return [*numbers[:kept], *[0.0] * (LENS_NUMBERS - len(numbers[:kept]))]

    def size(self) -> dict[str, Value]:
        """The size of the images used for the calibration, if the file states it."""
        size = {}
        for name, names in (('image.width', WIDTH), ('image.height', HEIGHT)):
            text = next(filter(None, map(self._text, names)), '')
            if text.isdigit() and int(text):
                size[name] = int(text)
        return dict(size) if len(size) == 2 else {}

    def _text(self, name: str) -> str:
        node = self._entries.get(name)
        return str(node.value) if isinstance(node, yaml.ScalarNode) else ''

    def _inner(self, *names: str) -> dict[str, str]:
        """The scalar entries of an entry with any of these names."""
        node = next((self._entries[name] for name in names if name in self._entries), None)
        if not isinstance(node, yaml.MappingNode):
            return {}
        return {str(key.value): str(value.value) for key, value in node.value if isinstance(value, yaml.ScalarNode)}

    def _shape(self, names: Sequence[str]) -> tuple[int, int]:
        """Rows and columns of a matrix; 0 for a list."""
        rows, cols = (self._inner(*names).get(name, '') for name in ('rows', 'cols'))
        return (int(rows), int(cols)) if rows.isdigit() and cols.isdigit() else (0, 0)

    def _numbers(self, names: Sequence[str]) -> list[float] | None:
        """A list, or the `data` of a matrix."""
        node = next((self._entries[name] for name in names if name in self._entries), None)
        if isinstance(node, yaml.MappingNode):
            node = next((value for key, value in node.value if key.value == 'data'), None)
        if not isinstance(node, yaml.SequenceNode):
            return None
        try:
            found = [float(each.value) for each in node.value]
        except (TypeError, ValueError) as error:
            raise self.refusal(f'its {names[0]} holds an entry that is not a number') from error
        if not all(map(math.isfinite, found)):
            raise self.refusal(f'its {names[0]} holds a number that is not finite')
        return found
