"""OpenCV, loaded on first use and set up for cameras.

OpenCV reads parts of its environment only once, when it is loaded, so the wishes stand here and nowhere else;
a person's own setting of the same variable wins.
"""

from __future__ import annotations

import os
from functools import cache
from types import ModuleType

_WISHES = {
    # A stalled V4L2 device blocks grab() this many seconds; OpenCV's own ten would outlast every shutdown.
    'OPENCV_VIDEOIO_V4L_SELECT_TIMEOUT': '2',
    # FFmpeg complains straight to the terminal, past every handler; the errors raised here say the same.
    'OPENCV_FFMPEG_LOGLEVEL': '-8',
    # Over UDP, its default for RTSP, a lost packet smears the picture instead of delaying it.
    'OPENCV_FFMPEG_CAPTURE_OPTIONS': 'rtsp_transport;tcp',
}


@cache
def load() -> ModuleType:
    """The module `cv2`, silent unless ``OPENCV_LOG_LEVEL`` is set."""
    for name, value in _WISHES.items():
        os.environ.setdefault(name, value)
    import cv2

    if 'OPENCV_LOG_LEVEL' not in os.environ:
        cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    return cv2
