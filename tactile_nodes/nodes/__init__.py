"""The nodes: one file each, a thin layer around the computing code. They communicate over the bus, not by imports."""

from __future__ import annotations

import atexit
import os
import signal
import sys
from pathlib import Path

if Path(sys.argv[0]).name.endswith('_node'):
    # This process runs a node's program and is still importing. If it is asked to end now, it exits at once. It raises
    # no exception, because an import can convert it, and the callback of a weak reference can lose it. Once the node
    # runs, `bus.runtime` handles signals.
    for _number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(_number, lambda *_: os._exit(0))
        atexit.register(signal.signal, _number, signal.SIG_IGN)  # it ends by itself then, with its own exit status
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})  # earlier signals are pending: `launching.processes`
