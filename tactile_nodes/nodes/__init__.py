"""The nodes: one file each, a thin shell around what computes. They meet on the bus, never in an import."""

from __future__ import annotations

import signal
import sys
from pathlib import Path

if Path(sys.argv[0]).name.endswith('_node'):
    # This process is a node's program, and still imports: asked to end now, it ends, without a traceback. From its
    # start on, `bus.runtime` answers signals.
    for _number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(_number, lambda *_: sys.exit(0))
