"""The choice of the camera for a SOURCE; docs/camera.md has a table of them."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

from tactile_nodes.clock import Clock
from tactile_nodes.drivers.camera.contract import SERIAL, SIMULATED, Camera, CameraSettings
from tactile_nodes.errors import ConfigurationError, DeviceNotFoundError


def open_camera(settings: CameraSettings, clock: Clock, on_progress: Callable[[str], None] | None = None) -> Camera:
    """The camera of `settings.source`, open; a live one reconnects by itself (`LiveCamera`).

    `on_progress` receives messages of the simulated camera while opening takes long.

    Raises:
        ConfigurationError: the source is not a kind of camera.
        DeviceError, ImageError: as `Camera.open`.
    """
    camera = _camera(settings, clock, on_progress)
    camera.open()
    return camera


def _camera(settings: CameraSettings, clock: Clock, on_progress: Callable[[str], None] | None) -> Camera:
    source = settings.source.strip()
    if not source:
        raise ConfigurationError('the camera source is empty; name a device, a file or an address, or "simulated"')
    if source == SIMULATED:
        from tactile_nodes.drivers.camera.simulated import SimulatedCamera

        return SimulatedCamera(settings, clock, on_progress)
    if (scheme := re.match(r'([a-zA-Z][\w+.-]*)://', source)) is not None:
        return _stream(scheme.group(1).lower(), settings, clock)
    if source.isdigit() or source.startswith(('/dev/', SERIAL)):
        from tactile_nodes.drivers.camera.v4l2 import v4l2_camera

        return v4l2_camera(settings, clock)
    return _recording(Path(source).expanduser(), settings, clock)


def _stream(scheme: str, settings: CameraSettings, clock: Clock) -> Camera:
    if scheme in {'http', 'https'}:
        from tactile_nodes.drivers.camera.mjpeg import mjpeg_camera

        return mjpeg_camera(settings, clock)
    if scheme in {'rtsp', 'rtsps'}:
        from tactile_nodes.drivers.camera.rtsp import rtsp_camera

        return rtsp_camera(settings, clock)
    raise ConfigurationError(
        f'cannot read pictures from {settings.source}: the scheme {scheme}:// is not supported; '
        'use http://, https:// (MJPEG) or rtsp://'
    )


def _recording(path: Path, settings: CameraSettings, clock: Clock) -> Camera:
    from tactile_nodes.drivers.camera.file import FileCamera, ImageFolder, VideoFile

    if path.is_dir():
        return FileCamera(settings, clock, ImageFolder(path, settings.fps))
    if path.exists():
        return FileCamera(settings, clock, VideoFile(path, settings.fps))
    raise DeviceNotFoundError(
        f'no camera, video or folder of images is named {str(path)!r}; the source may be a device '
        '(/dev/video0, serial:NUMBER), a file, a folder, an http:// or rtsp:// address, or "simulated"'
    )
