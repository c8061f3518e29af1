"""Recorded pictures as a camera: a video file, or a folder of images.

Neither contains capture times. An AVI file holds only a frame rate, and a folder not even that. So frame k is stamped
``start + k / fps``, which is nominal and not measured.

At a `rate` above 0, frame k is delivered no earlier than ``start + k / (fps * rate)``; a reader that falls behind
catches up, and no frame is skipped. At a rate of 0, frames come as fast as they are read and are stamped when they are
read, because a stamp in the future would make all latencies computed from it wrong.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tactile_nodes import opencv
from tactile_nodes.clock import NS_PER_S, Clock
from tactile_nodes.decoding import open_video, read_picture
from tactile_nodes.drivers.camera.contract import Camera, CameraSettings, Frame, Picture, check_size
from tactile_nodes.drivers.health import Health, Level
from tactile_nodes.errors import ConfigurationError, DeviceError, DeviceTimeoutError, ImageError
from tactile_nodes.files import open_plain
from tactile_nodes.paths import OF_PICTURES

FASTEST_CLAIM = 1000.0  # broken headers state 90000 frames per second and more


class FileCamera(Camera):
    """A recording played as a camera, again from its start if it loops."""

    def __init__(self, settings: CameraSettings, clock: Clock, recording: VideoFile | ImageFolder) -> None:
        self._settings = settings
        self._clock = clock
        self._recording = recording
        self._waiting: Picture | None = None
        self._shape: tuple[int, ...] = ()
        self._open = False
        self._start_ns = 0
        self._last_ns = 0
        self._sequence = 0
        self._ended_ns: int | None = None

    @property
    def description(self) -> Mapping[str, str]:
        """The recording, its size, and how its frames are timed."""
        return {
            **self._recording.description,
            'size': 'x'.join(map(str, reversed(self._shape[:2]))),
            'played at': self._pace,
            'stamps': 'start + index / fps (nominal)' if self._settings.rate > 0 else 'time of reading',
            'loop': str(self._settings.loop).lower(),
        }

    @property
    def health(self) -> Health:
        """OK while it plays, WARN after its last picture, with the time since then and how to restart it."""
        if not self._open:
            return Health(Level.STALE, f'{self._recording.name} is not open')
        if self._ended_ns is None:
            return Health(Level.OK, f'playing {self._recording.name}')
        since_s = (self._clock.now_ns() - self._ended_ns) // NS_PER_S
        ago = f' {since_s} s ago' if since_s else ''  # the log keeps the first message
        return Health(
            Level.WARN,
            f'recording ended{ago}; start again or set loop:=true to play it again'
            f'{self._recording.advice} ({self._sequence} pictures at {self._pace}, {self._recording.name})',
        )

    @property
    def _pace(self) -> str:
        rate = self._settings.rate
        return f'{self._recording.fps * rate:g} frames/s' if rate > 0 else 'full speed'

    def open(self) -> None:
        """Read the first picture, and refuse the recording if there is none."""
        self._recording.start()
        self._waiting = self._recording.next()
        if self._waiting is None:
            self._recording.stop()
            raise ImageError(f'{self._recording.name} contains no picture; use another file or folder')
        check_size(self._waiting, self._settings, self._recording.name)
        self._shape = self._waiting.shape
        self._start_ns = self._clock.now_ns()
        self._last_ns = self._start_ns - 1
        self._ended_ns = None
        self._open = True

    def read(self, timeout_s: float) -> Frame | None:
        """The next picture when it is due; None after the last one, unless it loops.

        Raises:
            ConfigurationError: a picture that cannot be read, or of another size than the first.
        """
        if not self._open:
            raise DeviceError(f'{self._recording.name} is closed; open it before reading')
        if self._waiting is None and (picture := self._next()) is not None:
            self._waiting = picture
        if self._waiting is None:
            self._ended_ns = self._ended_ns or self._clock.now_ns()
            return None
        stamp_ns = self._wait_until_due(timeout_s)
        frame = Frame(self._waiting, stamp_ns, self._sequence, 0)
        self._waiting, self._last_ns = None, stamp_ns
        self._sequence += 1
        return frame

    def close(self) -> None:
        if self._open:
            self._open = False
            self._recording.stop()

    def _wait_until_due(self, timeout_s: float) -> int:
        if self._settings.rate == 0:
            return max(self._clock.now_ns(), self._last_ns + 1)
        due_ns = self._start_ns + round(self._sequence * NS_PER_S / (self._recording.fps * self._settings.rate))
        deadline_ns = self._clock.now_ns() + round(timeout_s * NS_PER_S)
        self._clock.sleep_until(min(due_ns, deadline_ns))
        if due_ns > deadline_ns:
            raise DeviceTimeoutError(f'the next picture of {self._recording.name} is not due within {timeout_s:g} s')
        return due_ns

    def _next(self) -> Picture | None:
        try:
            picture = self._recording.next()
            if picture is None and self._settings.loop:
                self._recording.start()
                picture = self._recording.next()
        except ImageError as error:  # it would come to the same picture when played again
            raise ConfigurationError(str(error)) from error
        if picture is not None and picture.shape[:2] != self._shape[:2]:
            raise ConfigurationError(
                f'{self._recording.name} contains pictures of {self._shape[1]}x{self._shape[0]} and of '
                f'{picture.shape[1]}x{picture.shape[0]}; put each size into its own folder'
            )
        return picture


class VideoFile:
    """A video, read through FFmpeg.

    Args:
        path: the file.
        fps: assumed rate if the file has no rate or an absurd one.
    """

    advice = ''

    def __init__(self, path: Path, fps: float) -> None:
        self.name = str(path)
        self.fps = fps
        self._path = path
        self._claimed = 0.0
        self._video: Any = None
        self._count = 0

    @property
    def time_s(self) -> float:
        """Time of the last frame since the start of the video: as the file states, or index / fps if it states none."""
        stated_s: float = self._video.get(opencv.load().CAP_PROP_POS_MSEC) / 1e3
        return stated_s if stated_s > 0 else (self._count - 1) / self.fps

    @property
    def description(self) -> Mapping[str, str]:
        """The file and its stated rate."""
        return {'source': self.name, 'kind': 'video file', 'frames/s of the file': f'{self._claimed:g}'}

    def start(self) -> None:
        """Open the file at its first frame.

        Reopens instead of seeking: seeking to frame 0 goes elsewhere in files without an index.
        """
        cv2 = opencv.load()
        self.stop()
        _check_readable(self._path)
        try:
            self._video = open_video(self.name)
        except OSError as error:
            raise ImageError(f'cannot read the video {self.name} ({error.strerror}); make it smaller') from error
        if self._video is None:
            raise ImageError(f'{self.name} cannot be read as a video; convert it, e.g. to MP4 or AVI')
        self._claimed = self._video.get(cv2.CAP_PROP_FPS)
        if 0 < self._claimed <= FASTEST_CLAIM:
            self.fps = self._claimed
        _check_rate(self.fps, self.name)
        self._count = 0

    def next(self) -> Picture | None:
        """The next frame, (h, w, 3)."""
        good, image = self._video.read()
        self._count += good
        return image if good else None

    def stop(self) -> None:
        if self._video is not None:
            self._video.release()
            self._video = None


class ImageFolder:
    """The images of a folder: ``2.png`` before ``10.png``; other files are ignored.

    Args:
        path: the folder.
        fps: their rate.
    """

    advice = '; fps sets the pace of a folder, e.g. fps:=2.0'

    def __init__(self, path: Path, fps: float) -> None:
        self.name = str(path)
        self.fps = fps
        self._path = path
        self._files: list[Path] = []
        self._next = 0

    @property
    def description(self) -> Mapping[str, str]:
        """The folder and the number of its images."""
        return {'source': self.name, 'kind': 'folder of images', 'images': str(len(self._files))}

    def start(self) -> None:
        """List the folder."""
        try:
            files = [file for file in self._path.iterdir() if file.suffix.lower() in OF_PICTURES]
        except OSError as error:
            raise ImageError(f'cannot list the folder {self.name} ({error.strerror})') from error
        if not files:
            supported = ' '.join(sorted(OF_PICTURES))
            raise ImageError(f'the folder {self.name} contains no images; supported: {supported}')
        _check_rate(self.fps, self.name)
        self._files = sorted(files, key=lambda file: natural_key(file.name))
        self._next = 0

    def next(self) -> Picture | None:
        """The next image: (h, w) if grey, else (h, w, 3); higher bit depths are converted to 8 bits."""
        if self._next == len(self._files):
            return None
        self._next += 1
        return read_image(self._files[self._next - 1])

    def stop(self) -> None:
        """No file is open between two images."""


def natural_key(name: str) -> list[tuple[int, str]]:
    """Sort key for natural order: ``frame2`` before ``frame10``.

    >>> sorted(['frame10', 'frame2', 'Frame1'], key=natural_key)
    ['Frame1', 'frame2', 'frame10']
    """
    return [(int(part), '') if part.isdigit() else (-1, part.lower()) for part in re.split(r'([0-9]+)', name)]


def read_image(path: Path) -> Picture:
    """The image in a file, (h, w) or (h, w, 3) blue-green-red, uint8.

    Raises:
        ImageError: it cannot be read, contains no image, or one that is too large.
    """
    try:
        return read_picture(path, grey=False)
    except OSError as error:
        raise ImageError(f'cannot read the image {path} ({error.strerror}); remove it or save it again') from error


def _check_readable(path: Path) -> None:
    try:
        str(path).encode()  # FFmpeg crashes on another name
        with open_plain(path):
            pass
    except UnicodeEncodeError as error:
        raise ImageError(f'cannot read the video {path}: its name is not UTF-8; rename it') from error
    except OSError as error:
        raise ImageError(f'cannot read the video {path} ({error.strerror}); check its permissions') from error


def _check_rate(fps: float, name: str) -> None:
    if fps <= 0:
        raise ImageError(f'{name} has no frame rate; set fps of the camera')
