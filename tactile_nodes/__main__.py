"""``python -m tactile_nodes`` is ``tactile``."""

import sys

from tactile_nodes.cli.main import main

sys.exit(main())
