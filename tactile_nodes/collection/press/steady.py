"""Whether force and image have come to rest, within their noise."""

from __future__ import annotations

from collections.abc import Sequence

from tactile_nodes.collection.readings import Frame, change
from tactile_nodes.collection.settings import CollectionSettings
from tactile_nodes.collection.wrench import Tare, pressing_n, slope, slope_noise, wrenches
from tactile_nodes.drivers.force_torque.contract import Sample

NS_PER_S = 1e9
SIGMAS = 4.0
FEWEST = 3


class Settling:
    """Checks the last `steady_s` of force and images.

    Args:
        settings: the criteria.
        tare: with the noise of the sensor.
        image_noise: largest change between two images at rest, in grey levels.
        since_ns: earlier measurements do not count.
    """

    def __init__(self, settings: CollectionSettings, tare: Tare, image_noise: float, since_ns: int) -> None:
        self._settings = settings
        self._tare = tare
        self._image_noise = image_noise
        self._since_ns = since_ns
        self._samples: Sequence[Sample] = ()
        self._frames: Sequence[Frame] = ()
        self.unsteady = 'no measurement yet'

    def start_ns(self, now_ns: int) -> int:
        """The time since which force and image must have been steady."""
        return now_ns - round(self._settings.press.steady_s * NS_PER_S)

    def is_steady(self, now_ns: int, samples: Sequence[Sample], frames: Sequence[Frame]) -> bool:
        """Whether force and image were steady since `start_ns`. Otherwise `unsteady` says what was not."""
        start_ns = self.start_ns(now_ns)
        self._samples = [sample for sample in samples if sample.stamp_ns >= start_ns]
        self._frames = [frame for frame in frames if frame.stamp_ns >= start_ns]
        if start_ns < self._since_ns:
            self.unsteady = 'at rest for too short a time'
        else:
            self.unsteady = self._force() or self._image()
        return not self.unsteady

    def _force(self) -> str:
        if len(self._samples) < FEWEST:
            return 'too few force samples'
        press = self._settings.press
        stamps = [sample.stamp_ns for sample in self._samples]
        rate = slope(stamps, pressing_n(wrenches(self._samples), self._tare, self._settings.mounting))
        limit = press.steady_n_s + SIGMAS * slope_noise(stamps, self._tare.noise_n)
        return f'the force changes by {rate:.2f} N/s, more than {limit:.2f} N/s' if abs(rate) > limit else ''

    def _image(self) -> str:
        if len(self._frames) < 2:
            return 'too few images'
        limit = self._settings.press.steady_grey + self._image_noise
        moved = change(self._frames[0], self._frames[-1])
        return f'the image changes by {moved:.1f} grey levels, more than {limit:.1f}' if moved > limit else ''
