"""Programs made of nodes: they end when asked to, soon, and say why when they end by themselves."""

from __future__ import annotations

import gc
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import psutil
import pytest
from agents import until
from programs import Program, Ready

from tactile_nodes.bus.node import runtime
from tactile_nodes.bus.node.arguments import NodeArguments
from tactile_nodes.bus.node.node import Node
from tactile_nodes.bus.node.runtime import run_nodes, settle
from tactile_nodes.bus.protocol import Bus
from tactile_nodes.errors import NOT_AGAIN, ModelError

AT_ALL_S = 30.0
"""Each program sees to it by itself that it ends in time, or its status says that it did not (`_END_WITHIN_S`)."""
Launch = Callable[..., Program]


@pytest.fixture
def launch(folder: Path) -> Iterator[Launch]:
    programs: list[Program] = []

    def make(*names: str, argv: tuple[str, ...] = (), **environment: str) -> Program:
        programs.append(Program(folder, list(names), list(argv), environment))
        return programs[-1]

    yield make
    for program in programs:
        program.process.kill()
        program.process.join()


def _running(program: Program, times: int = 1) -> Program:
    until(lambda: program.output.count('running') >= times, 'the program to run')
    return program


@pytest.mark.parametrize(
    ('names', 'number', 'run', 'closed'),
    [
        *((['Ready'], number, 1, 1) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)),
        pytest.param(['Ready', 'Second'], signal.SIGINT, 2, 2, id='two nodes'),
        pytest.param(['Ready', 'Waiting'], signal.SIGINT, 1, 1, id='a node still waits before it begins'),
    ],
)
def test_signal_ends_a_program_cleanly(
    launch: Launch, names: list[str], number: signal.Signals, run: int, closed: int
) -> None:
    program = _running(launch(*names), run)
    program.signal(number)
    assert program.ended(AT_ALL_S) == 0
    assert program.output.count('closed') == closed
    assert 'Traceback' not in program.output
    assert 'asked' not in program.output


def test_what_is_not_made_yet_when_a_program_is_asked_to_end_is_not_made(launch: Launch) -> None:
    """On a busy computer a model takes longer to load than a program may take to end."""
    program = launch('AskedToEnd', 'SlowToStart')
    assert program.ended(30.0) == 0
    assert 'closed' in program.output
    assert 'running' not in program.output


def test_signal_ends_a_program_within_two_seconds_although_a_callback_is_busy(launch: Launch) -> None:
    program = _running(launch('Busy', 'Ready'), 2)
    program.signal(signal.SIGINT)
    assert program.ended(AT_ALL_S) == 1
    assert runtime._FINISH_WITHIN_S < runtime._END_WITHIN_S < 2.0
    assert 'a callback is still busy; not waiting for it' in program.output
    assert program.output.count('closed') == 1  # the one that could be


@pytest.mark.parametrize(('name', 'status'), [('SlowToClose', 1), ('SlowToStart', 0)])
def test_signal_ends_a_program_within_two_seconds_although_a_device_hangs(
    launch: Launch, name: str, status: int
) -> None:
    """A node that was still being made has not failed: on a busy computer that takes longer than it may take to end."""
    program = _running(launch(name))
    program.signal(signal.SIGTERM)
    assert program.ended(AT_ALL_S) == status
    assert runtime._END_WITHIN_S == 1.8
    assert ('not ended within 1.8 s after the request; giving up' in program.output) == bool(status)


def test_a_program_that_stands_still_while_it_ends_is_given_its_time_all_the_same(launch: Launch) -> None:
    """On a busy computer it would leave its device open, and its bag without an end."""
    program = _running(launch('StandsStill'))
    program.signal(signal.SIGINT)
    process = psutil.Process(program.process.pid)
    until(lambda: process.status() == psutil.STATUS_STOPPED, 'it to stand still')
    time.sleep(2.0)
    program.signal(signal.SIGCONT)
    assert program.ended(AT_ALL_S) == 0


def test_second_signal_ends_a_program_at_once(launch: Launch) -> None:
    program = _running(launch('MayBeSlowToClose'))
    program.signal(signal.SIGINT)
    until(lambda: 'closed' in program.output)
    until(lambda: program.signal(signal.SIGINT) or program.ended(0.05) is not None)
    assert program.ended(0.0) == 128 + signal.SIGINT


@pytest.mark.parametrize(('name', 'pause_s'), [('Ready', 0.0), ('TakesAMomentToClose', 0.4)])
def test_signal_that_comes_twice_at_once_or_from_terminal_and_launcher_is_taken_for_one(
    launch: Launch, name: str, pause_s: float
) -> None:
    program = _running(launch(name))
    program.signal(signal.SIGINT)
    time.sleep(pause_s)  # a busy launcher sends its own late
    program.signal(signal.SIGINT)
    assert program.ended(AT_ALL_S) == 0
    assert 'closed' in program.output


def test_signal_that_does_not_wake_the_main_thread_ends_a_program(launch: Launch) -> None:
    """One that comes just before it begins to wait does not either."""
    assert launch('SignalsItsThread').ended(AT_ALL_S) == 0


def test_bug_in_a_callback_ends_the_program_with_its_traceback_in_the_log(launch: Launch) -> None:
    program = launch('Buggy', 'Ready')
    assert program.ended(AT_ALL_S) == 1
    assert '[FATAL]' in program.output
    assert 'ZeroDivisionError: the bug' in program.output
    assert 'programs.py' in program.output
    assert program.output.count('closed') == 2


def test_trouble_of_a_device_in_a_callback_does_not_end_the_program(launch: Launch) -> None:
    program = _running(launch('Troubled'))
    until(lambda: 'the camera is gone; plug it in' in program.output)
    assert program.ended(0.2) is None
    program.signal(signal.SIGINT)
    assert program.ended(AT_ALL_S) == 0
    assert 'Traceback' not in program.output


def test_node_that_cannot_start_is_one_sentence_and_closes_those_that_could(launch: Launch) -> None:
    program = launch('Ready', 'NoDevice')
    assert program.ended(AT_ALL_S) == 1
    assert 'nodevice: there is no camera 7; see: tactile doctor' in program.output
    assert 'closed' in program.output
    assert 'Traceback' not in program.output


@pytest.mark.parametrize(
    ('environment', 'sentence'),
    [
        ({'ROS_DOMAIN_ID': 'home'}, "ROS_DOMAIN_ID is 'home'; set it to a number from 0 to 232\n"),
        ({'TACTILE_RUN_DIR': '/proc/nothing'}, 'cannot use /proc/nothing for the sockets of the bus'),
        ({'TACTILE_RUN_DIR': '/tmp/' + 'x' * 100}, 'is too long for sockets'),
    ],
)
def test_bus_that_cannot_be_joined_is_one_sentence(launch: Launch, environment: dict[str, str], sentence: str) -> None:
    program = launch('Ready', **environment)
    assert program.ended(AT_ALL_S) in {1, NOT_AGAIN}
    assert sentence in program.output
    assert program.output.count('\n') == 1


@pytest.mark.parametrize(
    ('argv', 'sentence'),
    [
        (['--ros-args', '--nonsense'], "'--nonsense' is not a flag"),
        (['rate:=3'], "'rate:=3' is not a known argument"),
        (['--ros-args', '--params-file', 'none.yaml'], 'cannot read the parameter file none.yaml'),
        (['--ros-args', '-p'], '-p needs a value'),
    ],
)
def test_wrong_command_line_is_one_sentence(argv: list[str], sentence: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_nodes([Ready], argv) == NOT_AGAIN
    error = capsys.readouterr().err
    assert sentence in error
    assert error.count('\n') == 1


def test_a_model_that_is_not_there_ends_a_program_for_good(capsys: pytest.CaptureFixture[str]) -> None:
    """By its status a launch knows that another start would not help, however slow the machine was to find out."""

    def node(bus: Bus, arguments: NodeArguments) -> Node:
        raise ModelError("there is no model 'nosuch'")

    assert run_nodes([node], []) == NOT_AGAIN
    assert capsys.readouterr().err == "node: there is no model 'nosuch'\n"


def test_what_is_there_when_frames_begin_is_never_looked_through_for_garbage() -> None:
    before: list[object] = [[]]
    try:
        settle()
        after: list[object] = [[]]
        looked_through = {id(each) for each in gc.get_objects()}
        assert id(before) not in looked_through and id(after) in looked_through
    finally:
        gc.unfreeze()


BUSY_IN_A_LIBRARY = """
import os, signal, sys, threading
import cv2, numpy
from tactile_nodes.bus.node.node import Node
from tactile_nodes.bus.node.runtime import run_nodes

class Busy(Node):
    def __init__(self, *arguments):
        super().__init__(*arguments)
        if sys.argv[1] == 'callback':
            self.post(self.compute)
        else:
            self.run_beside('computing', self.compute)

    def compute(self):
        threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGINT)).start()
        while True:
            cv2.GaussianBlur(numpy.zeros((2000, 2000), numpy.uint8), (31, 31), 0)

sys.exit(run_nodes([Busy], []))
"""


@pytest.mark.parametrize(('busy', 'status'), [('callback', 1), ('thread', 0)])
def test_signal_does_not_abort_a_program_of_which_a_thread_is_busy_in_a_library(
    folder: Path, busy: str, status: int
) -> None:
    """Python's own end would end the thread as it returns into C++, which calls that an error: SIGABRT."""
    words, environment = [sys.executable, '-c', BUSY_IN_A_LIBRARY, busy], {**os.environ, 'TACTILE_RUN_DIR': str(folder)}
    ended = subprocess.run(words, env=environment, stderr=subprocess.PIPE, text=True, timeout=60.0, check=False)
    assert ended.returncode == status, ended.stderr
