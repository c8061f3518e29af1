"""``tactile launch --view``: the launch in the background, the view in the foreground; both end together."""

from __future__ import annotations

import re
import sys
import threading
from collections import deque
from typing import TYPE_CHECKING

from tactile_nodes.bus.names import absolute_namespace
from tactile_nodes.cli import view
from tactile_nodes.cli.running.session import joined

if TYPE_CHECKING:
    from collections.abc import Callable

    from tactile_nodes.launching.processes.output import Line
    from tactile_nodes.launching.service import LaunchService

_LOG_LINE = re.compile(r'\[(DEBUG|INFO|WARN|ERROR|FATAL)\] \[')


class Notes:
    """Collects important output of the launcher and its processes until the view can show it.

    Log lines of nodes are left out, because the view receives the important ones from /rosout.
    """

    def __init__(self) -> None:
        self.lines: deque[str] = deque(maxlen=20)
        self.tell: Callable[[str], None] | None = None

    def __call__(self, line: Line) -> None:
        """Take a line; may be called from any thread."""
        if not is_worth_seeing(line):
            return
        text = str(line)
        self.lines.append(text)
        if self.tell is not None:
            self.tell(text)


def is_worth_seeing(line: Line) -> bool:
    """Warnings and errors of the launcher, and output on a process's stderr that is not a log line."""
    if line.level:
        return line.level in {'WARNING', 'ERROR'}
    return line.stream == 'stderr' and line.text.strip() != '' and not _LOG_LINE.match(line.text)


def run(service: LaunchService, notes: Notes, namespace: str = '') -> int:
    """Run `service` with `notes` as its screen and the view in the foreground; returns the launch's exit status.

    Raises:
        LaunchFileError: the file has an error; nothing was started.
    """
    service.load()
    stop = threading.Event()
    statuses: list[int] = []

    def launch() -> None:
        try:
            statuses.append(service.run())
        finally:
            stop.set()

    thread = threading.Thread(target=launch, name='launch')
    with joined() as bus:
        state = view.new_state(bus, absolute_namespace(namespace))
        state.advice = 'its nodes are starting'
        notes.tell = state.add_note
        thread.start()
        try:
            view.run_view(bus, state, plain=not view.can_draw(sys.stdout), stop=stop)
        finally:
            service.shutdown('the view has ended')
            thread.join()
        status = statuses[0] if statuses else 1
        if status == 0 or state.frames:
            view.print_summary(state, bus.clock.now_ns())
    print(f'logs: {service.log_folder}', flush=True)
    if status != 0:  # the last line gives the cause; print nothing after it
        print('\n'.join(notes.lines), file=sys.stderr)
    return status
