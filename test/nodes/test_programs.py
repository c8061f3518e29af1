"""Programs of nodes, before they run."""

from __future__ import annotations

import subprocess
import sys

import pytest

from tactile_nodes.errors import NOT_AGAIN
from tactile_nodes.nodes import composed


def ended(code: str) -> subprocess.CompletedProcess[str]:
    """A program that ran this code."""
    return subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=False)


# In the callbacks of weak references, of which every import has one, no exception gets out.
IN_A_CALLBACK = (
    'import weakref\n'
    'class Thing: pass\n'
    'thing = Thing()\n'
    'kept = weakref.ref(thing, lambda _: os.kill(os.getpid(), signal.SIGINT) or len("handled here"))\n'
    'del thing\n'
)


@pytest.mark.parametrize(
    'asked',
    ['os.kill(os.getpid(), signal.SIGINT)\n', 'os.kill(os.getpid(), signal.SIGTERM)\n', IN_A_CALLBACK],
    ids=['SIGINT', 'SIGTERM', 'in a callback'],
)
def test_a_program_that_is_asked_to_end_while_it_imports_ends_quietly(asked: str) -> None:
    before = 'import os, signal, sys; sys.argv = ["/bin/camera_node"]; import tactile_nodes.nodes\n'
    program = ended(f'{before}{asked}print("went on")')
    assert (program.returncode, program.stdout, program.stderr) == (0, '', '')


@pytest.mark.parametrize('name', ['SIGINT', 'SIGTERM'])
def test_a_program_that_is_asked_to_end_while_it_ends_keeps_its_exit_status(name: str) -> None:
    code = (
        'import atexit, os, signal, sys; sys.argv = ["/bin/camera_node"]; '
        f'atexit.register(os.kill, os.getpid(), signal.{name}); import tactile_nodes.nodes; sys.exit(3)'
    )
    program = ended(code)
    assert (program.returncode, program.stderr) == (3, '')


def test_whoever_else_imports_nodes_keeps_its_signals() -> None:
    code = (
        'import signal; before = signal.getsignal(signal.SIGINT); import tactile_nodes.nodes; '
        'assert signal.getsignal(signal.SIGINT) is before'
    )
    assert ended(code).returncode == 0


def test_a_wrong_name_to_compose_ends_a_program_for_good(capsys: pytest.CaptureFixture[str]) -> None:
    """Else a launch would start it again for ever."""
    assert composed.run(['flow_featurs']) == NOT_AGAIN
    assert "there is no node 'flow_featurs' to compose; available: bridge, calibrator, " in capsys.readouterr().err
