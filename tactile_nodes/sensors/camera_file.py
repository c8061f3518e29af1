"""Calibrations of cameras as their makers write them: OpenCV's YAML, ROS's camera_info file, or the message printed.

Nothing in such a file is made an object of: tags as ``!!opencv-matrix`` are read past, numbers are taken as numbers.
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
"""Names of entries, in small letters and without what joins words."""

MODELS = {
    'plumb_bob': 'pinhole', 'radtan': 'pinhole', 'rational_polynomial': 'pinhole',
    'equidistant': 'fisheye', 'fisheye': 'fisheye',
}  # fmt: skip
LENS_NUMBERS, FISHEYE_NUMBERS = 5, 4
"""Of a description, and of OpenCV's fisheye."""
BINNED = 'binningx', 'binningy'
SAY_LENS = 'add the line distortion_model: equidistant (a fisheye) or distortion_model: plumb_bob (a pinhole) to it'


def read_camera_file(path: Path, model: str = '') -> dict[str, Value]:
    """What a calibration says, by the dotted names of a sensor's description; `model` is the lens if it does not.

    Raises:
        ConfigurationError: no such file, none of these formats, or a lens that no description can hold.
    """
    file = _CameraFile(path)
    file.require_whole()
    (fx, skew, u, *_), (_, fy, v, *_), _ = (file.matrix()[row : row + 3] for row in (0, 3, 6))
    model = file.model(model)
    lens = file.lens(model)
    if skew or not (fx > 0 and fy > 0):
        raise file.refusal('its camera matrix is no [fx 0 cx; 0 fy cy; 0 0 1] with fx and fy above 0')
    told: dict[str, Value] = {'camera.model': model, 'camera.centre_px': [u, v], 'camera.distortion': lens}
    if model == 'fisheye':
        told |= {'camera.focal_px_per_rad': fx, 'camera.focal_ratio': fy / fx}
    else:
        told['camera.focal_px'] = [fx, fy]
    return told | file.size()


class _CameraFile:
    """The entries of a file, found by any of the names that are usual."""

    def __init__(self, path: Path) -> None:
        self._path = path
        try:
            text = read_text(path)
        except (OSError, UnicodeDecodeError) as error:
            raise ConfigurationError(f'cannot read the calibration {path}: {error}') from error
        # OpenCV begins with a line that is no YAML, and `ros2 topic echo` ends each message with one.
        text = text.split('\n', 1)[-1] if text.startswith('%YAML:') else text
        root = compose(text.rstrip().removesuffix('---'), str(path))
        if not isinstance(root, yaml.MappingNode):
            raise self.refusal('it is no OpenCV or camera_info YAML; save it as .yml, not as .xml or .json')
        self._entries = {
            key.value.lower().replace('_', ''): value for key, value in root.value if isinstance(key, yaml.ScalarNode)
        }

    def refusal(self, text: str) -> ConfigurationError:
        return ConfigurationError(f'the calibration {self._path} cannot be used: {text}')

    def matrix(self) -> list[float]:
        """Row by row."""
        numbers = self._numbers(MATRIX)
        if numbers is None or len(numbers) != 9 or numbers[6:] != [0.0, 0.0, 1.0]:
            raise self.refusal('it has no camera_matrix (or k) of nine numbers whose last row is 0 0 1')
        return numbers

    def model(self, wanted: str) -> str:
        """Which lens it is: as the file says, or else as wanted."""
        told = self._text('distortionmodel')
        if told and told not in MODELS:
            raise self.refusal(f'its distortion_model {told!r} is none of {", ".join(MODELS)}')
        found = MODELS.get(told, '') or ('fisheye' if self._text('fisheyemodel') in {'1', 'true'} else '')
        if wanted and found and wanted != found:
            raise self.refusal(f'its lens is a {found}, and the description says camera.model: {wanted}; change one')
        if not found:
            self._require_likely(wanted)
        return found or wanted or 'pinhole'

    def _require_likely(self, wanted: str) -> None:
        """Refuse numbers that may be of another lens than is wanted, where the file does not say which."""
        count = len(self._numbers(LENS) or [])
        if wanted == 'fisheye' and count > FISHEYE_NUMBERS:
            raise self.refusal(
                f"its distortion has {count} numbers, and OpenCV's fisheye {FISHEYE_NUMBERS}: it is of a pinhole, or "
                f'{SAY_LENS}'
            )
        if not wanted and self._shape(LENS) == (FISHEYE_NUMBERS, 1):
            raise self.refusal(
                f"its distortion has {FISHEYE_NUMBERS} rows of one number, as OpenCV's fisheye writes it, and it does "
                f'not say which lens that is: {SAY_LENS}'
            )

    def require_whole(self) -> None:
        """Refuse pictures that the driver made smaller than those that were calibrated with, or cut."""
        binned = [self._text(name) not in {'', '0', '1'} for name in BINNED]
        if any(binned):
            raise self.refusal(
                'its pictures are binned (binning_x, binning_y), and its numbers are those of whole ones; switch the '
                'binning off, or calibrate with pictures as they are used'
            )
        roi = self._inner('roi')
        size = {'width': next(filter(None, map(self._text, WIDTH)), ''),
                'height': next(filter(None, map(self._text, HEIGHT)), '')}  # fmt: skip
        if any(roi.get(name, '0') not in {'0', size.get(name, '0')} for name in (*size, 'x_offset', 'y_offset')):
            raise self.refusal(
                'its pictures are cut (roi), and its numbers are those of whole ones; calibrate with pictures as they '
                'are used'
            )

    def lens(self, model: str) -> list[float]:
        """Five numbers, as a description has them."""
        numbers = self._numbers(LENS) or []
        kept = FISHEYE_NUMBERS if model == 'fisheye' else LENS_NUMBERS
        if any(numbers[kept:]):
            raise self.refusal(
                f'its distortion has {len(numbers)} numbers, and a {model} here has {kept}; calibrate without '
                'rational, thin prism or tilted terms'
            )
        return [*numbers[:kept], *[0.0] * (LENS_NUMBERS - len(numbers[:kept]))]

    def size(self) -> dict[str, Value]:
        """Of the pictures that were calibrated with, if it says that."""
        told = {}
        for name, names in (('image.width', WIDTH), ('image.height', HEIGHT)):
            text = next(filter(None, map(self._text, names)), '')
            if text.isdigit() and int(text):
                told[name] = int(text)
        return dict(told) if len(told) == 2 else {}

    def _text(self, name: str) -> str:
        node = self._entries.get(name)
        return str(node.value) if isinstance(node, yaml.ScalarNode) else ''

    def _inner(self, *names: str) -> dict[str, str]:
        """Plain entries of an entry by any of these names."""
        node = next((self._entries[name] for name in names if name in self._entries), None)
        if not isinstance(node, yaml.MappingNode):
            return {}
        return {str(key.value): str(value.value) for key, value in node.value if isinstance(value, yaml.ScalarNode)}

    def _shape(self, names: Sequence[str]) -> tuple[int, int]:
        """Rows and columns of a matrix; 0 of a list."""
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
            raise self.refusal(f'its {names[0]} holds what is no number') from error
        if not all(map(math.isfinite, found)):
            raise self.refusal(f'its {names[0]} holds a number that is not finite')
        return found
