"""What a case of a benchmark measures, in a file of its own: the processes of tasks then import nothing else."""

from __future__ import annotations

import argparse
from typing import Any


def measured_case(arguments: argparse.Namespace, _: object) -> dict[str, Any]:
    return {'measured': arguments.only}
