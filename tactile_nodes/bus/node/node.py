"""What every node is made of: it subscribes, calls a function, publishes."""

from __future__ import annotations

import contextlib
import heapq
import itertools
import queue
import threading
import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from tactile_nodes import params
from tactile_nodes.bus import topics
from tactile_nodes.bus.node.answering import in_turn, trigger
from tactile_nodes.bus.node.arguments import Names, NodeArguments
from tactile_nodes.bus.node.diagnostics import Diagnostics, Level, RecentErrors
from tactile_nodes.bus.node.keeping import Kept
from tactile_nodes.bus.node.log import Log
from tactile_nodes.bus.node.parameters import ParameterServer, from_message
from tactile_nodes.bus.node.qos_overrides import PREFIX, QosOverrides
from tactile_nodes.bus.node.taking import take
from tactile_nodes.bus.protocol import Bus, Closing, Publisher, Received
from tactile_nodes.bus.subscription import Subscription
from tactile_nodes.bus.topics import Topic
from tactile_nodes.clock import NS_PER_S, Clock, SteppedClock, SystemClock, monotonic_s
from tactile_nodes.errors import AskedToEndError, BusError, MessageError, TactileError
from tactile_nodes.messages import services, stamp_ns, types
from tactile_nodes.params import parameter

DIAGNOSTICS_PERIOD_S = 1.0


@dataclass(frozen=True)
class NodeParams:
    """The parameters that every node has."""

    use_sim_time: bool = parameter(False, 'take the time from /clock instead of the host', read_only=True)


class Node:
    """A node: its callbacks run one after the other in the thread that calls `spin`.

    Subclasses set `NAME` and `PARAMS` (a frozen dataclass that derives from `NodeParams`), and in ``__init__`` create
    their publishers, subscriptions, timers and services. They hold no arithmetic.

    Raises:
        ConfigurationError: parameters that do not fit.
    """

    NAME = 'node'
    PARAMS: type[Any] = NodeParams
    FAILURE_STATUS = 1
    """With which the program ends after `fail`; `errors.NOT_AGAIN` where starting it again would do harm."""

    def __init__(self, bus: Bus, arguments: NodeArguments | None = None, clock: Clock | None = None) -> None:
        arguments = arguments or NodeArguments()
        self.bus = bus
        self.names = Names.of(self.NAME, arguments)
        self.kept = Kept(self.full_name)
        block, self._qos = self._read_parameters(arguments)
        self._parameters = ParameterServer(block, self._apply_parameters, self._qos.descriptions())
        self._work: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        self._timers: list[tuple[int, int, _Timer]] = []
        self._order = itertools.count()
        self._ends: list[Closing] = []
        self._beside: list[threading.Thread] = []
        self._stopping = self._closed = False
        self._ending = arguments.ending
        self.failure: TactileError | None = None
        self.spinning = False
        self.clock: Clock = clock or (SteppedClock() if self.params.use_sim_time else SystemClock())
        self.log = Log(self.full_name, arguments.log_level, self.clock)
        self.diagnostics = Diagnostics(self.full_name)
        self._errors = RecentErrors()
        self._offer_standard_ends()

    @property
    def full_name(self) -> str:
        """'/skin/camera'"""
        return self.names.full_name

    @property
    def params(self) -> Any:
        """The current parameters: an instance of `PARAMS`."""
        return self._parameters.block

    # --- for subclasses -------------------------------------------------------------------------------------

    def given(self, name: str) -> Any:
        """What somebody gave a parameter at the start; None where it has its default."""
        return getattr(self.params, name) if name in self._given else None

    def create_publisher(self, topic: Topic) -> Publisher:
        name = self.names.resolve(topic.name)
        qos = self._qos.of('publisher', name, topic.qos)
        publisher = self.bus.advertise(name, topic.type_name, qos, self.full_name)
        self._ends.append(publisher)
        return publisher

    def create_subscription(self, topic: Topic, callback: Callable[[Received], None]) -> Subscription:
        """Call `callback` with each message of `topic` that is kept; bytes that are no message are counted only."""
        inbox = _Inbox(self, callback)
        name = self.names.resolve(topic.name)
        qos = self._qos.of('subscription', name, topic.qos)
        subscription = self.bus.subscribe(name, topic.type_name, qos, self.full_name, inbox.ready)
        inbox.subscription = subscription
        self._ends.append(subscription)
        return subscription

    def end_subscription(self, subscription: Subscription) -> None:
        """Receive no more of what `create_subscription` began."""
        self._ends.remove(subscription)
        subscription.close()

    def create_timer(self, period_s: float, callback: Callable[[], None]) -> None:
        """Call `callback` every `period_s` by this node's clock; periods that were missed are skipped."""
        timer = _Timer(max(1, round(period_s * NS_PER_S)), callback)
        self._push(timer, self.clock.now_ns() + timer.period_ns)

    def create_service(
        self, name: str, type_name: str, answer: Callable[[Any], Any], first: Callable[[Any], None] | None = None
    ) -> None:
        """Answer calls of `name` with what `answer` makes of the request, in this node's thread.

        `first` is called with the request before that, in a thread of its own: messages do not wait for it.
        """

        handler = in_turn(answer, self.post, first)
        self._ends.append(self.bus.serve(self.names.resolve(name), type_name, handler, self.full_name))

    def create_trigger(self, name: str, act: Callable[[], str], first: Callable[[], None] | None = None) -> None:
        """A std_srvs/Trigger: its message is what `act` returns, or the sentence of the TactileError it raises."""
        self.create_service(name, services.TRIGGER, trigger(act), (lambda _: first()) if first else None)

    def age_s(self, received: Received) -> float:
        """Seconds since a message was published, on the time base of the bus (also while time is simulated)."""
        return (self.bus.clock.now_ns() - received.source_ns) / NS_PER_S

    def prepare_parameters(self, values: Mapping[str, object]) -> None:
        """What takes long about values that are to be set (a file to read), in a thread of its own, before
        `on_parameters`; for subclasses."""

    def on_parameters(self, changed: Any) -> None:
        """Take over new parameters, or refuse them with a ConfigurationError; for subclasses that can change."""

    def report(self, part: str, level: Level, text: str, **values: object) -> None:
        """Say how a part of this node is; when that gets better or worse it is also logged."""
        if self.diagnostics.report(part, level, text, **values) and text:
            {Level.OK: self.log.info, Level.WARN: self.log.warn}.get(level, self.log.error)(f'{part}: {text}')

    def fail(self, part: str, error: TactileError) -> None:
        """End this node, which cannot do its work any more; its program ends with FAILURE_STATUS. From any thread."""
        self.failure = error
        self.report(part, Level.ERROR, str(error))
        self.stop()

    @property
    def outlived(self) -> bool:
        """Whether a thread is still inside a library after `close`.

        Then the process ends without Python's own shutdown, which would end such a thread when it returns, through
        frames of C++ or Rust, and so abort the process ("exception not rethrown", "without an active exception").
        """
        return self.spinning or any(thread.is_alive() for thread in self._beside)

    def run_beside(self, part: str, work: Callable[[], None]) -> threading.Thread:
        """Start `work` in a thread of its own. What it raises ends this node with `fail`: else nobody would know."""

        def watched() -> None:
            try:
                work()
            except TactileError as error:
                self.fail(part, error)
            except Exception:  # noqa: BLE001 - a bug: say all we know, end the node, let the launcher decide
                self.fail(part, TactileError(f'a bug ended this thread:\n{traceback.format_exc()}'))

        thread = threading.Thread(target=watched, name=part, daemon=True)
        self._beside.append(thread)
        thread.start()
        return thread

    def still_wanted(self) -> None:
        """For a constructor that waits: to be asked now and then.

        Raises:
            AskedToEndError: the process is to end.
        """
        if self._ending.is_set():
            raise AskedToEndError(f'{self.full_name} was asked to end before it had started')

    def on_close(self) -> None:
        """Release what the subclass holds."""

    # --- running --------------------------------------------------------------------------------------------

    def spin(self) -> None:
        """Run callbacks until `stop` is called. Errors of ours are logged; anything else is a bug and ends the node."""
        self.spinning = True
        try:
            while self.spin_once(self._wait_s()):
                pass
        finally:
            self.spinning = False

    def spin_once(self, timeout_s: float | None = 0.0) -> bool:
        """Run one callback and the timers that are due; false when the node was stopped."""
        try:
            work = take(self._work, timeout_s)
        except queue.Empty:
            work = _nothing
        if work is None or self._stopping:  # not after all that still waits
            return False
        self._run(work)
        self._run_timers()
        return True

    def post(self, work: Callable[[], None]) -> None:
        """Do something in this node's thread, soon."""
        self._work.put(work)

    def stop(self) -> None:
        """Make `spin` return; from any thread."""
        self._stopping = True
        self._work.put(None)

    def close(self) -> None:
        """Leave the bus; after `spin` has returned. Closing twice is harmless."""
        if self._closed:
            return
        self._closed = True
        try:
            self.on_close()
        finally:
            self.log.publisher = None
            if self.failure is None:
                with contextlib.suppress(BusError):  # the bus was closed before
                    self._statuses.publish(self.diagnostics.farewell(self.clock.now_ns()))
            for end in self._ends:
                end.close()
            self._ends.clear()
            self.bus.remove_node(self.full_name)

    # --- inside ---------------------------------------------------------------------------------------------

    def _read_parameters(self, arguments: NodeArguments) -> tuple[Any, QosOverrides]:
        values = params.resolve_parameters(self.full_name, arguments.parameters)
        qos = QosOverrides({name: values.pop(name) for name in list(values) if name.startswith(PREFIX)})
        names = {entry.name for entry in params.describe(self.PARAMS)}
        exact = params.exact_names(self.full_name, arguments.parameters)
        # What a wildcard sets for others is not for us; what names us and is unknown is a typo.
        mine = {name: value for name, value in values.items() if name in names or name in exact}
        mine |= self.kept.changes
        self._given = frozenset(mine)
        return params.from_mapping(self.PARAMS, mine, source=self.full_name), qos

    def _apply_parameters(self, changed: Any) -> None:
        self.on_parameters(changed)
        before, after = params.to_values(self.params), params.to_values(changed)
        self.post(lambda: self.kept.add_changes(before, after))  # not now: a full disk is no reason to refuse

    def _prepare(self, request: types.SetParameters_Request | types.SetParametersAtomically_Request) -> None:
        self.prepare_parameters({entry.name: from_message(entry.value) for entry in request.parameters})

    def _offer_standard_ends(self) -> None:
        self.bus.add_node(self.full_name)
        self.log.publisher = self.create_publisher(topics.ROSOUT)
        self._statuses, self._told_ns = self.create_publisher(topics.DIAGNOSTICS), 0
        prepare = None if type(self).prepare_parameters is Node.prepare_parameters else self._prepare
        for name, (type_name, answer) in self._parameters.answers().items():
            self.create_service(f'~/{name}', type_name, answer, prepare if name.startswith('set_') else None)
        if self.params.use_sim_time and isinstance(self.clock, SteppedClock):
            self.create_subscription(topics.CLOCK, self._on_clock)
        else:
            self.create_timer(DIAGNOSTICS_PERIOD_S, self._tell_health)

    def _tell_health(self) -> None:
        if self._errors.are_over(monotonic_s()):
            self.report('errors', Level.OK, '')
        self._statuses.publish(self.diagnostics.message(self.clock.now_ns()))

    def _on_clock(self, received: Received) -> None:
        assert isinstance(self.clock, SteppedClock)
        now_ns = stamp_ns(received.message.clock)
        if now_ns < self.clock.now_ns():  # the bag began again: what was due then would never be due now
            timers = [timer for _, _, timer in self._timers]
            self._timers.clear()
            for timer in timers:
                self._push(timer, now_ns + timer.period_ns)
        self.clock.set_ns(now_ns)
        host_ns = self.bus.clock.now_ns()  # a paused player goes on to tell the time, and its listeners are not silent
        if host_ns - self._told_ns >= DIAGNOSTICS_PERIOD_S * NS_PER_S:
            self._told_ns = host_ns
            self._tell_health()

    def _run(self, work: Callable[[], None]) -> None:
        try:
            work()
        except TactileError as error:
            self.diagnostics.report('errors', Level.ERROR, str(error))
            if self._errors.add(str(error), monotonic_s()):
                self.log.error(f'errors: {error}')

    def _run_timers(self) -> None:
        now_ns = self.clock.now_ns()
        while not self._stopping and self._timers and self._timers[0][0] <= now_ns:
            due_ns, _, timer = heapq.heappop(self._timers)
            # From when it was due, not from now: else a 60 Hz timer would tick at less than 60 Hz.
            self._push(timer, due_ns + timer.period_ns * (1 + (now_ns - due_ns) // timer.period_ns))
            self._run(timer.callback)

    def _push(self, timer: _Timer, due_ns: int) -> None:
        heapq.heappush(self._timers, (due_ns, next(self._order), timer))

    def _wait_s(self) -> float | None:
        if not self._timers or not isinstance(self.clock, SystemClock):
            return None  # a stepped clock moves through messages, which wake us
        return max(1e-6, (self._timers[0][0] - self.clock.now_ns()) / NS_PER_S)


class _Inbox:
    """Brings messages from a subscription into the node's thread, one at a time, so that others get their turn."""

    def __init__(self, node: Node, callback: Callable[[Received], None]) -> None:
        self.subscription: Subscription | None = None
        self._node = node
        self._callback = callback
        self._pending = False

    def ready(self) -> None:
        """Something came in; called from any thread, also before `subscription` is set."""
        if not self._pending:
            self._pending = True
            self._node.post(self._deliver)

    def _deliver(self) -> None:
        if self.subscription is None:  # another thread is still in `create_subscription`
            self._node.post(self._deliver)
            return
        self._pending = False  # before taking: what comes in from now on asks again
        received = self.subscription.take()
        if self.subscription.waiting:
            self.ready()
        if received is not None and self._decodes(received):
            self._callback(received)

    def _decodes(self, received: Received) -> bool:
        assert self.subscription is not None
        try:
            return received.message is not None
        except MessageError as error:
            self.subscription.malformed += 1
            topic = self.subscription.topic
            self._node.log.warn(f'dropped a message on {topic}: {error}', once=topic)
            return False


@dataclass(frozen=True)
class _Timer:
    period_ns: int
    callback: Callable[[], None]


def _nothing() -> None:
    """What there is to do when nothing came."""
