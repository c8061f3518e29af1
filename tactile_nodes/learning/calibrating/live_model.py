"""Read and change the model of a running force estimator through the bus."""

from __future__ import annotations

from pathlib import Path

from tactile_nodes.bus.node.parameter_client import ParameterClient
from tactile_nodes.bus.protocol import Bus
from tactile_nodes.errors import BusError, ConfigurationError, ModelError
from tactile_nodes.learning.calibrating.files import Source

TIMEOUT_S = 10.0


class LiveModel:
    """The model of the force estimator of this full name; calls wait for answers, so not in a node's own thread."""

    def __init__(self, bus: Bus, estimator: str) -> None:
        self._bus, self._estimator = bus, estimator

    @property
    def present(self) -> bool:
        """Whether the estimator runs."""
        return bool(self._bus.graph().services(f'{self._estimator}/set_parameters'))

    def in_use(self, output: Path) -> dict[str, str]:
        """The entry for the replaced model on the card of a calibration in `output`.

        Raises:
            BusError: the estimator does not answer.
            ModelError: its model's file no longer exists.
        """
        return Source.find(str(self._client().values(['model'])['model'])).card_entry(output)

    def use(self, file: Path) -> None:
        """Let the estimator load a model.

        Raises:
            BusError: it does not answer.
            ModelError: it refuses; says why.
        """
        try:
            self._client().set('model', str(file.resolve()))
        except ConfigurationError as error:
            raise ModelError(f'{self._estimator} did not change its model: {error}') from error

    def _client(self) -> ParameterClient:
        if not self.present:
            raise BusError(f'{self._estimator} is not running, so no node uses the calibration')
        return ParameterClient(self._bus, self._estimator, TIMEOUT_S)
