"""``tactile reference``: renew those parts of the documentation that are made from the code."""

from __future__ import annotations

import argparse
import importlib
import sys

from tactile_nodes.cli.bench import checkout

DESCRIPTION = """\
Renew those parts of the documentation that are made from the code: topics, parameters, launch arguments, commands,
folders and their order. Runs from a checkout of the source.
In a page each stands between two comments: one that begins it, as the pages have it, and "end of NAME".
"""
EPILOG = """\
examples:
  tactile reference                     renew the pages in docs/
  tactile reference --check             change nothing; the exit status is 1 if a page is not current
  tactile reference --print parameters  print a part
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of the verb, as `reference.command` of the checkout has them."""
    sys.path.insert(0, str(checkout()))
    importlib.import_module('reference.command').add_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    """Renew, check or print; 1 if a page that was checked is not current."""
    status: int = importlib.import_module('reference.command').run(arguments)
    return status
