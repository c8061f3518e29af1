"""Runs the command `tactile` as ``python -m tactile_nodes``."""

import sys

from tactile_nodes.cli.main import main

sys.exit(main())
