"""Recording and playing in a terminal until Ctrl-C, with a progress line."""

from __future__ import annotations

import argparse
import os
import re
import select
import sys
import termios
import threading
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial

from tactile_nodes.bag.recording import describe
from tactile_nodes.bus.node.arguments import NodeArguments, Remap
from tactile_nodes.bus.node.node import Node
from tactile_nodes.bus.node.runtime import run_until
from tactile_nodes.cli.running.session import ended_by_signals, joined
from tactile_nodes.clock import NS_PER_S
from tactile_nodes.errors import BagError
from tactile_nodes.nodes.player import PlayerNode
from tactile_nodes.nodes.recorder import RecorderNode
from tactile_nodes.params import Located, NodeParameters, Value

_LOOK_EVERY_S = 0.2
_MEGABYTE = 1_000_000
_RECORDER = 'bag_recorder'  # a launch has a `recorder`, whose services the buttons of its page call


def record(arguments: argparse.Namespace) -> int:
    """Record until Ctrl-C, or for ``--duration``; 1 if not everything that was received could be written."""
    parameters: dict[str, Value] = {
        'bag': arguments.output,
        'topics': arguments.topics,
        'all': arguments.all,
        'regex': arguments.regex,
        'exclude': arguments.exclude,
        'compression': arguments.compression,
        'queue_mb': max(1, arguments.max_cache_size // _MEGABYTE),
        'max_file_bytes': arguments.max_bag_size,
        'max_file_s': arguments.max_bag_duration,
    }
    with ended_by_signals() as done, joined() as bus:
        node = RecorderNode(bus, _node_arguments(parameters, Remap('__node', _RECORDER)))
        most_s = arguments.duration or float('inf')

        def is_over() -> bool:
            return node.failure is not None or node.recorded_s >= most_s

        with _watched(done, lambda: _recording_line(node), is_over):
            return run_until([node], done)  # the node has logged the reason


def play(arguments: argparse.Namespace) -> int:
    """Play to the end or until Ctrl-C; 1 if the bag could not be read to its end."""
    parameters: dict[str, Value] = {
        'bag': arguments.bag,
        'rate': arguments.rate,
        'loop': arguments.loop,
        'paused': arguments.start_paused,
        'delay': arguments.delay,
        'start_offset': arguments.start_offset,
        'clock_hz': arguments.clock,
        'topics': arguments.topics,
        'remap': arguments.remap,
    }
    with ended_by_signals() as done, joined() as bus:
        node = PlayerNode(bus, _node_arguments(parameters))
        with _keys(node, done), _watched(done, lambda: _playing_line(node)):
            return run_until([node], done)  # the node has logged the reason


def _node_arguments(parameters: dict[str, Value], *remaps: Remap) -> NodeArguments:
    located = {name: Located(value, 'command line') for name, value in parameters.items()}
    return NodeArguments(remaps, (NodeParameters('/**', located),))


def _recording_line(node: RecorderNode) -> str:
    writer = node.writer  # the node's own thread may release it meanwhile
    if writer is None:
        return ''
    totals = writer.totals
    lost = totals.dropped + node.tally.missed + node.tally.unfit
    return f'{writer.folder}: {describe(totals)}' + (f', {lost} lost' if lost else '')


def _playing_line(node: PlayerNode) -> str:
    line, extent = node.playback.timeline, node.reader.extent
    at_ns = min(max(line.bag_ns(node.clock.now_ns()) - extent.start_ns, 0), extent.duration_ns)
    state = 'paused' if line.paused else f'{line.rate:g}x'
    return f'{node.reader.path}: {at_ns / NS_PER_S:.1f} of {extent.duration_ns / NS_PER_S:.1f} s, {state}'


@contextmanager
def _watched(
    done: threading.Event, line: Callable[[], str], is_over: Callable[[], bool] = lambda: False
) -> Iterator[None]:
    """Within the context, rewrite `line` on the terminal again and again; set `done` when `is_over` returns true."""

    def watch() -> None:
        while not done.wait(_LOOK_EVERY_S):
            if sys.stderr.isatty():
                sys.stderr.write(f'\r\x1b[K{line()}\r')
                sys.stderr.flush()
            if is_over():
                done.set()

    thread = threading.Thread(target=watch, name='status', daemon=True)
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join()
        if sys.stderr.isatty():
            sys.stderr.write('\r\x1b[K')


@contextmanager
def _keys(node: PlayerNode, done: threading.Event) -> Iterator[None]:
    """Within the context, let the terminal's keys control `node`.

    Not in the background, where reading from the terminal would stop the process.
    """
    if not sys.stdin.isatty() or os.tcgetpgrp(sys.stdin.fileno()) != os.getpgrp():
        yield
        return
    terminal = sys.stdin.fileno()
    before = termios.tcgetattr(terminal)
    tty.setcbreak(terminal)
    thread = threading.Thread(target=_follow_keys, args=(terminal, node, done), name='keys', daemon=True)
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join()
        termios.tcsetattr(terminal, termios.TCSADRAIN, before)


def _follow_keys(terminal: int, node: PlayerNode, done: threading.Event) -> None:
    playback = node.playback
    actions: dict[bytes, Callable[[], object]] = {
        b' ': node.toggle_paused,
        b'\x1b[C': node.play_next,
        b'\x1b[A': lambda: playback.set_rate(playback.timeline.rate * 1.1),
        b'\x1b[B': lambda: playback.set_rate(playback.timeline.rate / 1.1),
    }
    while not done.is_set():
        if select.select([terminal], [], [], _LOOK_EVERY_S)[0]:
            for key in re.findall(rb'\x1b\[.|.', os.read(terminal, 64)):  # an ssh connection passes on several at once
                if key in actions:
                    node.post(partial(_do, node, actions[key]))


def _do(node: Node, action: Callable[[], object]) -> None:
    try:
        action()
    except BagError as error:
        node.log.info(str(error))
