"""What all tests share."""

from __future__ import annotations

import os
import signal
import tempfile
from collections.abc import Iterator
from pathlib import Path

import jaxtyping
import pytest

# Whoever starts the tests in the background may have them ignore SIGINT, and their children with them.
signal.signal(signal.SIGINT, signal.default_int_handler)

# Shapes and types of arrays are checked wherever tests call a function of these packages.
jaxtyping.install_import_hook(['tactile_nodes.sensing', 'tactile_nodes.simulation'], 'beartype.beartype')


@pytest.fixture(scope='session', autouse=True)
def _own_run_directory() -> Iterator[None]:
    """Sockets of the tests meet nobody else's. The folder's name is short, because a socket's must be."""
    with tempfile.TemporaryDirectory(prefix='tt') as folder:
        os.environ['TACTILE_RUN_DIR'] = folder
        os.environ.pop('ROS_DOMAIN_ID', None)
        yield


@pytest.fixture(scope='session')
def shared_data() -> Path:
    """The recordings of other people that lie beside some checkouts."""
    folder = Path(__file__).resolve().parents[2] / 'shared' / 'data'
    if not folder.is_dir():
        pytest.skip('the recordings of other people are not beside this checkout')
    return folder
