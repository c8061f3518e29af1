"""OpenCV, loaded on first use and set up for cameras.

OpenCV reads some environment variables only when it is loaded, so they are all set here. A value set by the user takes
precedence.
"""

from __future__ import annotations

import os
from functools import cache
from types import ModuleType

_WISHES = {
    # A stalled V4L2 device blocks grab() for this many seconds; OpenCV's default of ten is longer than any shutdown.
    'OPENCV_VIDEOIO_V4L_SELECT_TIMEOUT': '2',
    # FFmpeg logs directly to the terminal, past all handlers; the errors raised here give the same information.
    'OPENCV_FFMPEG_LOGLEVEL': '-8',
    # Over UDP, the default for RTSP, a lost packet smears the image instead of delaying it.
    'OPENCV_FFMPEG_CAPTURE_OPTIONS': 'rtsp_transport;tcp',
}

SILENT = 0
"""OpenCV's least level of log output."""


@cache
def load() -> ModuleType:
    """The module `cv2`, without log output unless ``OPENCV_LOG_LEVEL`` is set."""
    for name, value in _WISHES.items():
        os.environ.setdefault(name, value)
    import cv2

    if 'OPENCV_LOG_LEVEL' not in os.environ:
        named_so_in_4_11 = hasattr(cv2, 'setLogLevel')
        (cv2 if named_so_in_4_11 else cv2.utils.logging).setLogLevel(SILENT)
    return cv2
