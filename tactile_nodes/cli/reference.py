"""``tactile reference``: update the parts of the documentation that are generated from the code."""

from __future__ import annotations

import argparse
import importlib
import sys

from tactile_nodes.cli.bench import checkout

DESCRIPTION = """\
Update the parts of the documentation that are generated from the code: topics, parameters, launch arguments, commands,
folders and their order. Needs a checkout of the source.
In a page, each part stands between two comments: one that begins it, as in the pages, and "end of NAME".
"""
EPILOG = """\
examples:
  tactile reference                     update the pages in docs/
  tactile reference --check             change nothing; the exit status is 1 if a page is not current
  tactile reference --print parameters  print a part
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `reference.command` in the checkout."""
    sys.path.insert(0, str(checkout()))
    importlib.import_module('reference.command').add_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    status: int = importlib.import_module('reference.command').run(arguments)
    return status
