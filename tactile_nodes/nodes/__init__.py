"""The nodes: one file each, a thin shell around what computes. They meet on the bus, never in an import."""

from __future__ import annotations

import os
import signal
import sys
from pathlib import Path

if Path(sys.argv[0]).name.endswith('_node'):
    # This process is a node's program, and still imports: asked to end now, it ends. By no exception, which an import
    # can turn into another or, in the callback of a weak reference, lose. From its start on, `bus.runtime` answers
    # signals.
    for _number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(_number, lambda *_: os._exit(0))
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})  # what came before waits: `launching.processes`
