"""``tactile view``: force, latency and node status, updated in place in a terminal or as lines.

If several sensors publish in namespaces of their own, as in a hand, all are shown together.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING, TextIO

from tactile_nodes.bus.names import absolute_namespace
from tactile_nodes.cli.completion import completers
from tactile_nodes.cli.running.session import completed, ended_by_signals, joined, own_name, positive_float

if TYPE_CHECKING:
    from rich.console import Console
    from rich.text import Text

    from tactile_nodes.bus.protocol import Bus
    from tactile_nodes.bus.topics import Topic
    from tactile_nodes.viewing.feeds import Take
    from tactile_nodes.viewing.state import Snapshot, ViewState

DESCRIPTION = 'Show force, latency and node status. Ctrl-C ends it with a summary.'
EPILOG = """\
examples:
  tactile view                          in this terminal, updated in place
  tactile view --plain --duration 10    one line per second for ten seconds, then the summary
  tactile view --namespace /left        only the sensor in namespace /left (default: all sensors of a hand)
  tactile view --scale 0.2              colours for light touches: brightest at 0.2 N per bin
"""
FULL_SCALE_N = 1.0  # the brightest colour; fixed, since a scale that adapts would hide how hard one presses
REDRAW_EVERY_S = 0.1
LINE_EVERY_S = 1.0
_LOOK_EVERY_S = 1.0

Show = Callable[['Snapshot'], None]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        '--plain', action='store_true', help='one line per second; the default if the terminal cannot draw'
    )
    parser.add_argument('--duration', type=positive_float, metavar='S', help='exit after S seconds')
    namespace = parser.add_argument(
        '--namespace', default='/', metavar='/NAME', help='namespace of the sensor (default: /)'
    )
    completed(namespace, completers.namespaces)
    parser.add_argument(
        '--scale',
        type=positive_float,
        default=FULL_SCALE_N,
        metavar='N',
        help='force of the brightest colour (default: 1)',
    )


def run(arguments: argparse.Namespace) -> int:
    """Show until interrupted or the time is over; then print a summary."""
    plain = arguments.plain or not can_draw(sys.stdout)
    with joined() as bus, ended_by_signals() as stop:
        state = new_state(bus, absolute_namespace(arguments.namespace))
        run_view(bus, state, plain=plain, stop=stop, duration_s=arguments.duration, full_scale_n=arguments.scale)
        print_summary(state, bus.clock.now_ns())
    return 0


def can_draw(stream: TextIO, environment: Mapping[str, str] = os.environ) -> bool:
    """Whether `stream` is a terminal that can redraw lines; not with TERM=dumb or without TERM."""
    return stream.isatty() and environment.get('TERM', 'dumb') not in {'', 'dumb', 'unknown'}


def print_summary(state: ViewState, now_ns: int) -> None:
    from tactile_nodes.cli.view import hand, render

    shot = state.summary(now_ns)
    print(hand.summary(shot) if shot.sensors else render.summary(shot), flush=True)


def new_state(bus: Bus, namespace: str = '/') -> ViewState:
    from tactile_nodes.viewing.state import ViewState

    return ViewState(namespace, bus.clock.now_ns())


def run_view(
    bus: Bus,
    state: ViewState,
    *,
    plain: bool,
    stop: threading.Event,
    duration_s: float | None = None,
    full_scale_n: float = FULL_SCALE_N,
    console: Console | None = None,
) -> None:
    """Feed `state` from `bus` and show it, until `stop` is set or `duration_s` has passed.

    It handles no signals; the caller prints the summary of `state`.
    """
    clock = bus.clock
    end_ns = clock.now_ns() + round(duration_s * 1e9) if duration_s is not None else math.inf
    period_s = LINE_EVERY_S if plain else REDRAW_EVERY_S
    with ExitStack() as stack:
        watch = Watch(bus, state)
        stack.callback(watch.close)
        show = _printing() if plain else stack.enter_context(_drawing(full_scale_n, console))
        while (now_ns := clock.now_ns()) < end_ns and not stop.wait(min(period_s, (end_ns - now_ns) / 1e9)):
            now_ns = clock.now_ns()
            watch.drain(now_ns)
            show(state.snapshot(now_ns))
        watch.drain(clock.now_ns())


def _printing() -> Show:
    """Prints each snapshot as a line, followed by the address of a new page and new warnings of nodes."""
    from tactile_nodes.cli.view import hand, render

    before: tuple[str, ...] = ()

    def show(shot: Snapshot) -> None:
        nonlocal before
        told = (*render.pages(shot), *shot.logs)
        print(
            hand.line(shot) if shot.sensors else render.line(shot),
            *(text for text in told if text not in before),
            sep='\n',
            flush=True,
        )
        before = told

    return show


@contextmanager
def _drawing(full_scale_n: float, console: Console | None) -> Iterator[Show]:
    from rich.live import Live

    from tactile_nodes.cli.view import hand, render

    def picture(shot: Snapshot) -> Text:
        return hand.picture(shot) if shot.sensors else render.picture(shot, full_scale_n)

    # Without its own thread, Live draws only our text, when we say so; it also restores the cursor at the end.
    with Live(console=console, auto_refresh=False, redirect_stdout=False, redirect_stderr=False) as live:
        yield lambda shot: live.update(picture(shot), refresh=True)


class Watch:
    """The subscriptions of the view and the nodes present; `drain` hands what arrived to the state."""

    def __init__(self, bus: Bus, state: ViewState) -> None:
        from tactile_nodes.bus import topics
        from tactile_nodes.viewing.feeds import Feeds

        self._bus = bus
        self._state = state
        self._next_look_ns = 0
        self._added: set[str] = set()
        self._force_topic = self._full(topics.FORCE_DISTRIBUTION.name)
        self._feeds = Feeds(bus, own_name(), self._full)
        self._feeds.add(topics.FORCE_DISTRIBUTION, state.add_force)
        self._feeds.add(topics.TRUE_FORCE, state.add_truth)
        self._feeds.add(topics.DIAGNOSTICS, state.add_diagnostics)
        self._feeds.add(topics.ROSOUT, state.add_log)

    def drain(self, now_ns: int) -> None:
        """Hand everything that arrived to the state, and update the list of nodes."""
        self._feeds.drain()
        self._state.malformed = self._feeds.malformed
        if now_ns >= self._next_look_ns:
            self._next_look_ns = now_ns + round(_LOOK_EVERY_S * 1e9)
            graph = self._bus.graph()
            self._state.estimators = tuple(sorted({end.node for end in graph.publishers(self._force_topic)}))
            if not self._state.estimators:
                self._look_elsewhere({end.name for end in graph.publishers()}, now_ns)

    def close(self) -> None:
        self._feeds.close()

    def _look_elsewhere(self, published: set[str], now_ns: int) -> None:
        """Suggest the command that shows the sensor of another namespace.

        Several in this one, or those of a hand, are shown together, also if only one of a hand has started.
        """
        from tactile_nodes.bus import topics

        ending = f'/{self._force_topic.rpartition("/")[2]}'
        there = sorted(name.removesuffix(ending) for name in published if name.endswith(ending))
        inside = [name for name in there if name.startswith(self._full(''))]
        summed = f'/{topics.HAND_WRENCH.name}'
        sums = [name for name in published if name.startswith(self._full('')) and name.endswith(summed)]
        if len(inside) > 1 or sums:
            for namespace in inside:
                take = self._state.add_sensor(namespace, now_ns).add_force
                self._add(topics.FORCE_DISTRIBUTION, f'{namespace}{ending}', take)
            for name in sums if len(sums) == 1 else ():
                self._add(topics.HAND_WRENCH, name, self._state.add_wrench)
        elif there:
            names, first = ', '.join(each or '/' for each in there), (inside or there)[0] or '/'
            self._state.advice = f'sensors are at {names}: tactile view --namespace {first}'

    def _add(self, topic: Topic, name: str, take: Take) -> None:
        if name not in self._added:
            self._added.add(name)
            self._feeds.add(replace(topic, name=name), take)

    def _full(self, name: str) -> str:
        return name if name.startswith('/') else f'{self._state.namespace.rstrip("/")}/{name}'
