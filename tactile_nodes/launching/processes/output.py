"""Where lines go: the screen, the log file of the launch, and log files of single processes.

The formats are those of ``ros2 launch``: ``[INFO] [launch]: text`` for lines of the launcher, ``[camera_node-1] text``
for lines of a process; in ``launch.log`` each line begins with the time.
"""

from __future__ import annotations

import os
import re
import socket
import sys
import threading
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TextIO

from tactile_nodes import clock
from tactile_nodes.errors import ConfigurationError

_LOGGED = re.compile(r'\[(DEBUG|INFO|WARN|ERROR|FATAL)\] \[[\d.]+\] (?=\[)')
# output option -> (where stdout goes, where stderr goes)
_ROUTES: dict[str, tuple[set[str], set[str]]] = {
    'log': ({'log'}, {'log', 'screen'}),
    'screen': ({'screen'}, {'screen'}),
    'both': ({'log', 'screen'}, {'log', 'screen'}),
    'own_log': ({'own'}, {'own'}),
    'full': ({'log', 'screen', 'own'}, {'log', 'screen', 'own'}),
}


@dataclass(frozen=True)
class Line:
    """One line of output.

    Attributes:
        source: writer of the line: ``launch``, ``launch.user`` (the action `log`), or a process, ``camera_node-1``.
        text: the line, without line break.
        level: DEBUG, INFO, WARNING or ERROR; empty for output of a process.
        stream: ``stdout`` or ``stderr`` of a process; empty for lines of the launcher.
    """

    source: str
    text: str
    level: str = ''
    stream: str = ''

    @property
    def complains(self) -> bool:
        """Whether the line reports what went wrong: an error of a node, or the last line of a traceback."""
        logged = _LOGGED.match(self.text)
        return self.stream == 'stderr' and bool(self.text.strip()) and (not logged or logged[1] in {'ERROR', 'FATAL'})

    def __str__(self) -> str:
        return f'[{self.level}] [{self.source}]: {self.text}' if self.level else f'[{self.source}] {self.text}'


Screen = Callable[[Line], None]


def print_line(line: Line) -> None:
    """The default screen; a letter that the terminal lacks is shown as its code."""
    encoding = sys.stdout.encoding
    sys.stdout.write(f'{line}\n'.encode(encoding, 'backslashreplace').decode(encoding))
    sys.stdout.flush()


def make_log_folder(base: Path) -> Path:
    """A new folder for the logs of one launch; the link ``latest`` beside it points there.

    Raises:
        ConfigurationError: the folder cannot be written.
    """
    moment = datetime.fromtimestamp(clock.wall_ns() / 1e9).strftime('%Y-%m-%d-%H-%M-%S-%f')
    folder = base.expanduser() / f'{moment}-{socket.gethostname()}-{os.getpid()}'
    try:
        folder.mkdir(parents=True)
        _point(folder.parent / 'latest', folder)
    except OSError as error:
        raise ConfigurationError(
            f'cannot create the log folder {folder} ({error.strerror}); set ROS_LOG_DIR to a folder that you own'
        ) from error
    return folder


def _point(link: Path, folder: Path) -> None:
    if link.exists() and not link.is_symlink():
        return
    draft = folder.with_name(f'.{folder.name}')
    draft.symlink_to(folder, target_is_directory=True)
    draft.replace(link)


class LaunchLog:
    """Receives the lines of all processes, from their threads, and of the launcher."""

    def __init__(self, folder: Path, screen: Screen, *, debug: bool = False) -> None:
        self.folder = folder
        self._screen: Screen | None = screen
        self._debug = debug
        self._closed = False
        self._files: dict[str, TextIO | None] = {}
        self._complaints: dict[str, str] = {}
        self._lock = threading.RLock()

    def say(self, level: str, source: str, text: str) -> None:
        """A line of the launcher: to launch.log, and, unless it is a debug line, to the screen."""
        line = Line(source, text, level=level)
        with self._lock:
            if level != 'DEBUG' or self._debug:
                self._show(line)
            self._write('launch.log', f'{_seconds()} {line}')

    def take(self, line: Line, output: str) -> None:
        """A line of a process: to where its output option sends it."""
        with self._lock:
            if line.complains:
                self._complaints[line.source] = _LOGGED.sub('', line.text)
            routes = set() if self._closed else _ROUTES[output][line.stream == 'stderr']
            if 'screen' in routes:
                self._show(line)
            if 'log' in routes:
                self._write('launch.log', f'{_seconds()} {line}')
            if 'own' in routes:
                self._write(f'{line.source}-{line.stream}.log', str(line))
                self._write(f'{line.source}.log', str(line))

    def last_complaint(self, source: str) -> str:
        """The last error that a process reported since its start; empty if none."""
        with self._lock:
            return self._complaints.get(source, '')

    def forget_complaint(self, source: str) -> None:
        """A process starts again: what it reported before is not why this run ends."""
        with self._lock:
            self._complaints.pop(source, None)

    def close(self) -> None:
        """Close the files; later output of a process that could not be stopped is lost."""
        with self._lock:
            self._closed = True
            for file in self._files.values():
                if file is not None:
                    file.close()
            self._files.clear()

    def _show(self, line: Line) -> None:
        try:
            if self._screen is not None:
                self._screen(line)
        except OSError:
            self._screen = None  # the terminal or pipe has closed: the processes still have to be ended

    def _write(self, name: str, text: str) -> None:
        try:
            if name not in self._files:
                # A path that is not UTF-8 has letters that cannot be encoded.
                opened = (self.folder / name).open('a', encoding='utf-8', errors='backslashreplace', buffering=1)
                self._files[name] = opened
            if (file := self._files[name]) is not None:
                file.write(f'{text}\n')
        except OSError as error:
            self._files[name] = None
            self._show(Line('launch', f'can no longer write {name}: {error.strerror}', level='ERROR'))


def _seconds() -> str:
    return f'{clock.wall_ns() / 1e9:.7f}'
