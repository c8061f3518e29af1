"""A light before a camera as a sync input: it follows the digital line, so the camera's own stamps tell its edges."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_nodes.params import parameter
from tactile_nodes.sensing.geometry import grey
from tactile_nodes.sensing.sync.light import LightEdges, LightWatch


@dataclass(frozen=True)
class LightSettings:
    """Where the light is in the whole image, before anything is cut from it."""

    x: int = parameter(0, 'left edge of a region that holds the light and little else [px]', minimum=0)
    y: int = parameter(0, 'upper edge of the region [px]', minimum=0)
    width: int = parameter(0, 'of the region [px]; 0: no light is watched', minimum=0)
    height: int = parameter(0, 'of the region [px]; 0: no light is watched', minimum=0)
    contrast: float = parameter(20.0, 'grey levels between dark and lit, at least', minimum=1.0)
    exposure_ms: float = parameter(0.0, 'exposure time; 0: the one asked of the camera, or not known', minimum=0.0)
    lead_ms: float = parameter(0.0, 'from the beginning of the exposure to the stamp of the frame', minimum=0.0)


class CameraLight:
    """Takes every frame of a camera.

    Args:
        settings: where the light is.
        exposure_ms: that of the camera; 0: not known.
    """

    def __init__(self, settings: LightSettings, exposure_ms: float) -> None:
        self._settings = settings
        self._watch = LightWatch((settings.exposure_ms or exposure_ms) / 1000, settings.contrast)
        self.edges = 0

    @property
    def watched(self) -> bool:
        """Whether there is a light."""
        return self._settings.width > 0 and self._settings.height > 0

    def take(self, image: np.ndarray, stamp_ns: int) -> LightEdges:
        """The edges that are certain with this frame, on the clock that stamped it."""
        s = self._settings
        part = image[s.y : s.y + s.height, s.x : s.x + s.width]
        brightness = float(grey(part).mean()) if part.size else 0.0
        found = self._watch.take(stamp_ns - round(s.lead_ms * 1e6), brightness)
        self.edges += len(found.stamp_ns)
        return found
