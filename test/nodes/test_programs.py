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


@pytest.mark.parametrize('name', ['SIGINT', 'SIGTERM'])
def test_a_program_that_is_asked_to_end_while_it_imports_ends_quietly(name: str) -> None:
    code = (
        'import os, signal, sys; sys.argv = ["/bin/camera_node"]; import tactile_nodes.nodes; '
        f'os.kill(os.getpid(), signal.{name}); print("went on")'
    )
    program = ended(code)
    assert (program.returncode, program.stdout, program.stderr) == (0, '', '')


def test_a_program_ends_although_it_is_asked_where_no_exception_gets_out() -> None:
    """As in the callbacks of weak references, of which every import has one."""
    code = (
        'import os, signal, sys, weakref; sys.argv = ["/bin/camera_node"]; import tactile_nodes.nodes\n'
        'class Thing: pass\n'
        'thing = Thing()\n'
        'kept = weakref.ref(thing, lambda _: os.kill(os.getpid(), signal.SIGINT) or len("handled here"))\n'
        'del thing\n'
        'print("went on")'
    )
    program = ended(code)
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
