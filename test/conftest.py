"""What all tests share."""

from __future__ import annotations

import functools
import gc
import os
import signal
import sys
import tempfile
import threading
import warnings
from collections.abc import Callable, Generator, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import before_imports  # noqa: F401
import hypothesis
import pytest
import shape_checks
from found_examples import FoundExamples
from hypothesis import strategies as st
from hypothesis.internal.conjecture import providers
from hypothesis.internal.constants_ast import Constants

from tactile_nodes.clock import monotonic_s

if TYPE_CHECKING:
    from tactile_nodes.bus.node.node import Node

TICK_S = 0.05
LONG_S = 0.25
"""Shorter than the time after which a driver takes its device for silent (0.3 s)."""


class Pauses(threading.Thread):
    """How long this process got no processor: what is tested in real time fails then through no fault of its own.

    Wakes up twenty times a second and notes by how much it is late.
    """

    def __init__(self) -> None:
        super().__init__(name='pauses', daemon=True)
        self.longest_s = 0.0
        self._over = threading.Event()

    def run(self) -> None:
        last_s = monotonic_s()
        while not self._over.wait(TICK_S):
            now_s = monotonic_s()
            self.longest_s = max(self.longest_s, now_s - last_s - TICK_S)
            last_s = now_s

    def were_long(self) -> bool:
        """Whether one since `longest_s` was last set to zero may have failed a test."""
        return self.longest_s > LONG_S

    def close(self) -> None:
        """End."""
        self._over.set()
        self.join()


PAUSES = Pauses()

TESTS = Path(__file__).parent

# All that is imported and collected stays to the end. To look again and again for what of it is no longer used takes a
# fifth of the time of collection, and part of that of every test.
gc.disable()

# Whoever starts the tests in the background may have them ignore SIGINT, and their children with them. What `nohup` has
# them ignore they still do, but not their children, who get no handler of ours.
signal.signal(signal.SIGINT, signal.default_int_handler)
if signal.getsignal(signal.SIGHUP) == signal.SIG_IGN:
    signal.signal(signal.SIGHUP, lambda *_: None)

# Shapes and types of arrays are checked in the tests of these packages. Elsewhere it would double the time of many.
CHECKED = ('sensing', 'simulation')
CHECKED_TESTS = [TESTS / package for package in CHECKED]
shape_checks.install([f'tactile_nodes.{package}' for package in CHECKED])

# The suite tries the same examples on every run. `make fuzz` tries others each time, from a seed that it prints, and
# keeps what it finds.
SEED = int(os.environ.get('TACTILE_SEED', '0'))
FOUND = FoundExamples(Path(os.environ.get('TACTILE_FOUND') or TESTS.parent / '.hypothesis' / 'found'), SEED)
hypothesis.settings.register_profile('suite', database=None, deadline=None, derandomize=True, print_blob=True)
hypothesis.settings.register_profile('fuzz', database=FOUND.database, deadline=None, print_blob=True)
PROFILE = os.environ.get('TACTILE_HYPOTHESIS', 'suite')
hypothesis.settings.load_profile(PROFILE)

# Hypothesis also tries numbers and texts of those of our modules that are imported. Which these are hangs on the tests
# that a worker has run before, and it takes each worker some 10 s to read them all.
NO_CONSTANTS = Constants()
providers._get_local_constants = lambda: NO_CONSTANTS

LONGEST_ARGUMENT = 3000
"""Characters of an argument as a failure of a random test shows it; more would hide the example that was found."""


@pytest.hookimpl(wrapper=True)
def pytest_pyfunc_call(pyfuncitem: pytest.Function) -> Generator[None, object, object]:
    """A random test gets no fixture, and draws nothing, that would fill its report."""
    if not pyfuncitem.get_closest_marker('hypothesis'):
        return (yield)
    require_short({name: pyfuncitem.funcargs[name] for name in pyfuncitem._fixtureinfo.argnames})
    handle = pyfuncitem.obj.hypothesis
    inner = handle.inner_test

    @functools.wraps(inner)
    def checked(*values: object, **named: object) -> object:
        require_short({**dict(enumerate(values)), **named})
        return inner(*values, **named)

    handle.inner_test = checked
    try:
        return (yield)
    finally:
        handle.inner_test = inner


def require_short(given: Mapping[object, object]) -> None:
    """Of a random test's arguments."""
    long = [name for name, value in given.items() if len(repr(value)) > LONGEST_ARGUMENT]
    assert not long, f'{long}: give a path or a seed, draw what it is made of, or keep what it holds out of its repr'


def short_draw(data: st.DataObject, strategy: st.SearchStrategy[Any], label: Any = None) -> Any:
    """What is drawn in the midst of a test stands in its report, too."""
    drawn = draw_any(data, strategy, label)
    require_short({label or 'what is drawn': drawn})
    return drawn


draw_any, st.DataObject.draw = st.DataObject.draw, short_draw  # type: ignore[method-assign]


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, object, object]:
    """Switch the checks on or off, fixtures included; begin to look for pauses anew."""
    shape_checks.switch(on=any(map(item.path.is_relative_to, CHECKED_TESTS)))
    PAUSES.longest_s = 0.0
    return (yield)


@pytest.hookimpl(trylast=True)
def pytest_configure(config: pytest.Config) -> None:
    """Look for pauses of the machine; have each worker count the tries of its own tests.

    Else each test asks the process that started its worker, and one that kills its worker gets another try.
    """
    PAUSES.start()
    if PROFILE == 'fuzz':
        config.pluginmanager.register(FOUND)
    if hasattr(config, 'workerinput') and config.pluginmanager.hasplugin('rerunfailures'):
        from pytest_rerunfailures import StatusDB

        config.failures_db.sock.close()
        config.failures_db = StatusDB()


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup() -> None:
    """Collect what a failed test left open, silently: else it would fail a later test, or its own second run."""
    if hasattr(sys, 'last_value'):
        del sys.last_type, sys.last_value, sys.last_traceback
        vars(sys).pop('last_exc', None)
        said, sys.unraisablehook = sys.unraisablehook, lambda _: None
        with warnings.catch_warnings():
            warnings.simplefilter('error')  # else a context of ZeroMQ would wait for its sockets to be closed
            gc.collect()
        sys.unraisablehook = said


def pytest_unconfigure() -> None:
    """No longer."""
    PAUSES.close()


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """A test that failed while the machine stood still is run once more, and the report says so.

    Not where other examples are tried: that would hide for minutes, or for good, what one of them found.
    """
    if config.pluginmanager.hasplugin('rerunfailures') and PROFILE == 'suite':
        for item in items:
            item.add_marker(pytest.mark.flaky(reruns=1, condition=PAUSES.were_long))


@pytest.hookimpl(tryfirst=True)
def pytest_runtestloop() -> None:
    """From here on memory is looked through as ever, but not what is there already."""
    gc.freeze()
    gc.enable()


@pytest.fixture(scope='session', autouse=True)
def _own_run_directory() -> Iterator[None]:
    """Sockets of the tests meet nobody else's. The folder's name is short, because a socket's must be."""
    with tempfile.TemporaryDirectory(prefix='tt') as folder:
        os.environ['TACTILE_RUN_DIR'] = folder
        os.environ['XDG_STATE_HOME'] = folder
        os.environ['TACTILE_GELS'] = str(Path(folder) / 'gels.sqlite')  # and not the list of whoever runs the tests
        os.environ.pop('ROS_DOMAIN_ID', None)
        yield


@pytest.fixture(scope='session')
def shared_data() -> Path:
    """The recordings of other people that lie beside some checkouts."""
    folder = Path(__file__).resolve().parents[2] / 'shared' / 'data'
    if not folder.is_dir():
        pytest.skip('the recordings of other people are not beside this checkout')
    return folder


@pytest.fixture
def spinning() -> Iterator[Callable[[Node], Node]]:
    """Have nodes spin, each in a thread of its own. Ask for it after their bus, so that they end first."""
    running: list[tuple[Node, threading.Thread]] = []

    def start(node: Node) -> Node:
        thread = threading.Thread(target=node.spin)
        thread.start()
        running.append((node, thread))
        return node

    yield start
    for node, thread in running:
        node.stop()
        thread.join(60.0)
        node.close()


@pytest.fixture(scope='module')
def own_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Nothing is known of earlier measurements."""
    folder = tmp_path_factory.mktemp('cache')
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv('XDG_CACHE_HOME', str(folder))
        yield folder


@pytest.fixture(scope='session')
def first_model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The model that ships for calibrations, on a quarter of its regions, as that of a gel named first."""
    from coarse_model import coarse_model

    return coarse_model(tmp_path_factory.mktemp('models') / 'first.safetensors', 'first')


@pytest.fixture(scope='session')
def first_field(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same of the model of any contact."""
    from coarse_model import coarse_field

    return coarse_field(tmp_path_factory.mktemp('models') / 'field.safetensors')


@pytest.fixture(scope='session')
def other_bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Ten presses on another gel: half as hard again, other markers, the camera 0.7 mm aside."""
    from press_bags import OTHER, Sensor, spread_collection

    return spread_collection(tmp_path_factory.mktemp('bags') / 'other', Sensor(OTHER), 10)
