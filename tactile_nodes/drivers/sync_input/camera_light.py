"""A light in the camera's view as sync input: it follows the digital line, so frames show the edges."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_nodes.params import parameter
from tactile_nodes.sensing.geometry import grey
from tactile_nodes.sensing.sync.light import LightEdges, LightWatch


@dataclass(frozen=True)
class LightSettings:
    """Region of the light in the whole image, before cropping."""

    x: int = parameter(0, 'left edge of a small region around the light [px]', minimum=0)
    y: int = parameter(0, 'upper edge of the region [px]', minimum=0)
    width: int = parameter(0, 'width of the region [px]; 0: no light is watched', minimum=0)
    height: int = parameter(0, 'height of the region [px]; 0: no light is watched', minimum=0)
    contrast: float = parameter(20.0, 'smallest difference between dark and lit, in grey levels', minimum=1.0)
    exposure_ms: float = parameter(0.0, 'exposure time; 0: as requested from the camera, or unknown', minimum=0.0)
    lead_ms: float = parameter(0.0, 'time from the start of the exposure to the stamp of the frame', minimum=0.0)


class CameraLight:
    """Gets every frame of a camera.

    Args:
        settings: region of the light.
        exposure_ms: exposure of the camera; 0: unknown.
    """

    def __init__(self, settings: LightSettings, exposure_ms: float) -> None:
        self._settings = settings
        self._watch = LightWatch((settings.exposure_ms or exposure_ms) / 1000, settings.contrast)
        self.edges = 0

    @property
    def watched(self) -> bool:
        return self._settings.width > 0 and self._settings.height > 0

    def complaint(self, width: int, height: int) -> str:
        """A message if the light is watched outside pictures of this size, where it has no edges; else empty."""
        if not self.watched or (self._settings.x < width and self._settings.y < height):
            return ''
        return f'the region of the light is outside the image of {width}x{height}; set light.x and light.y'

    def take(self, image: np.ndarray, stamp_ns: int) -> LightEdges:
        """The edges that are certain after this frame, on the clock that stamped it."""
        s = self._settings
        part = image[s.y : s.y + s.height, s.x : s.x + s.width]
        brightness = float(grey(part).mean()) if part.size else 0.0
        found = self._watch.take(stamp_ns - round(s.lead_ms * 1e6), brightness)
        self.edges += len(found.stamp_ns)
        return found
