"""The buttons of the page: they call services of the nodes and report the result."""

from __future__ import annotations

from dataclasses import dataclass

from tactile_nodes.bus.protocol import Bus, Graph
from tactile_nodes.errors import TactileError
from tactile_nodes.messages import services, types
from tactile_nodes.web.recording import RECORDER

REST_IMAGE, START, STOP = 'rest_image', 'recording_start', 'recording_stop'
_SERVICES = {
    REST_IMAGE: 'flow_features/capture_reference',
    START: f'{RECORDER}/start',
    STOP: f'{RECORDER}/stop',
}
TIMEOUT_S = 5.0


@dataclass(frozen=True)
class Outcome:
    """Whether it was done, and a sentence. `insistable`: it was refused, but the person may insist."""

    done: bool
    text: str
    insistable: bool = False


class Controls:
    """The actions of the nodes in one namespace; each is a std_srvs/Trigger service."""

    def __init__(self, bus: Bus, namespace: str = '/') -> None:
        self._bus = bus
        self._services = {action: f'{namespace.rstrip("/")}/{name}' for action, name in _SERVICES.items()}

    def available(self, graph: Graph) -> dict[str, bool]:
        """The actions whose service exists."""
        served = {end.name for end in graph.services() if end.type_name == services.TRIGGER}
        return {action: name in served for action, name in self._services.items()}

    def act(self, action: str, touching_n: float | None = None, *, insist: bool = False) -> Outcome:
        """Do `action`, from any thread; a rest image is refused during contact, unless a person insists."""
        if action not in self._services:
            return Outcome(False, f'There is no action {action!r}.')
        if action == REST_IMAGE and touching_n is not None and not insist:
            text = f'Something seems to touch the gel ({touching_n:.3f} N). Remove it first.'
            return Outcome(False, text, insistable=True)
        try:
            answer = self._bus.call(
                self._services[action], services.TRIGGER, types.Trigger_Request(), timeout_s=TIMEOUT_S
            )
        except TactileError as error:
            return Outcome(False, str(error))
        return Outcome(bool(answer.success), answer.message)
