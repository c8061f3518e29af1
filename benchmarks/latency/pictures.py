"""Pictures of a pressed gel, made before the measurement: in memory, or in a folder for a camera."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from tactile_nodes.contact_tables.gel_tables import contact_table, load_gel
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.sensing.geometry import centre_crop
from tactile_nodes.simulation.optics import Optics, Press

REST_FRAMES, PRESSES = 40, 4
DOWN, HELD, BETWEEN = 10, 10, 12
"""Frames in which the tip moves down, stays, and is away; it moves up as fast as down."""
CONFIG = """\
/**/camera: {ros__parameters: {fps: 60.0, crop: 440, wait_s: 2.0, loop: true}}
/**/flow_features: {ros__parameters: {reference_frames: 16}}
/**/force_estimator: {ros__parameters: {least_confidence: 0.85}}
"""


def pressed_pictures(side: int, rests: int, count: int, every: int) -> list[np.ndarray]:
    """The gel at rest, `rests` times, then `count` more: one in `every` with a press anywhere, the others at rest.

    All pictures are different, because each has its own noise, as from a camera.
    """
    optics, random = _optics(), np.random.default_rng(3)
    made = [optics.render((), number) for number in range(rests)]
    for number in range(count):
        x_mm, y_mm, depth_mm = random.uniform((-12.0, -12.0, 0.3), (12.0, 12.0, 1.8)).tolist()
        presses = (Press(x_mm, y_mm, depth_mm),) if number % every == 0 else ()
        made.append(optics.render(presses, rests + number))
    return [np.ascontiguousarray(centre_crop(image, side, side)) for image in made]


def recorded_camera(folder: Path) -> tuple[str, str]:
    """Write pictures of presses into `folder`; returns launch arguments of a camera that reads them in a loop.

    Raises:
        ConfigurationError: a picture cannot be written.
    """
    pictures, config = folder / 'pictures', folder / 'live.yaml'
    pictures.mkdir()
    config.write_text(CONFIG, encoding='ascii')
    optics, random = _optics(), np.random.default_rng(4)
    shown: list[tuple[Press, ...]] = [()] * REST_FRAMES
    for _ in range(PRESSES):
        x_mm, y_mm, depth_mm = random.uniform((-12.0, -12.0, 0.5), (12.0, 12.0, 1.8)).tolist()
        coming = [(Press(x_mm, y_mm, depth_mm * (step + 1) / DOWN),) for step in range(DOWN)]
        shown += [*coming, *coming[-1:] * HELD, *coming[::-1], *[()] * BETWEEN]
    for number, presses in enumerate(shown):
        if not cv2.imwrite(str(pictures / f'{number:04d}.pgm'), optics.render(presses, number)):
            raise ConfigurationError(f'cannot write pictures to {pictures}; is the disk full?')
    return f'source:={pictures}', f'config:={config}'


def _optics() -> Optics:
    gel = load_gel('paper')
    return Optics(gel, contact_table(gel))
