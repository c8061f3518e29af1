"""Features in, force in newtons out.

Subscribes ``flow_features``; publishes ``force_distribution`` and ``wrench``.
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass, replace
from pathlib import Path

from tactile_nodes import conversions
from tactile_nodes.bus import topics
from tactile_nodes.bus.arguments import NodeArguments
from tactile_nodes.bus.diagnostics import Level
from tactile_nodes.bus.node import Node, NodeParams
from tactile_nodes.bus.protocol import Bus, Received
from tactile_nodes.bus.runtime import run_node
from tactile_nodes.clock import Clock, perf_ns
from tactile_nodes.messages import types
from tactile_nodes.model_file import find_model, load_model
from tactile_nodes.params import parameter
from tactile_nodes.sensing.model import ForceEstimator, ForceMap
from tactile_nodes.sensing.quality import ContactDetector
from tactile_nodes.sensing.reading import Contact

_INVALID = (
    types.ForceDistribution.REASON_DARK_IMAGE
    | types.ForceDistribution.REASON_SATURATED_IMAGE
    | types.ForceDistribution.REASON_OTHER_IMAGE
    | types.ForceDistribution.REASON_NOT_FINITE
)


@dataclass(frozen=True)
class ForceEstimatorParams(NodeParams):
    """Parameters of the force estimator node."""

    model: str = parameter('fast', 'name of a model that ships, or path of a model file', read_only=True)
    frame_id: str = parameter('gel_surface', 'frame of the forces')
    least_confidence: float = parameter(
        0.85, 'share of the known regions that must show markers', minimum=0.0, maximum=1.0
    )


class ForceEstimatorNode(Node):
    """Applies the model; its messages carry the stamp of the image and what they were computed with."""

    NAME = 'force_estimator'
    PARAMS = ForceEstimatorParams

    def __init__(self, bus: Bus, arguments: NodeArguments | None = None, clock: Clock | None = None) -> None:
        super().__init__(bus, arguments, clock)
        file: Path = find_model(self.params.model)
        loaded = load_model(file)
        self._estimator = ForceEstimator(loaded.model)
        self._image_size = loaded.image_size
        self._contact = ContactDetector(loaded.model.contact_threshold_n)
        self._provenance = types.Provenance(model=file.stem, model_id=loaded.model_id, gel=loaded.gel)
        self.report('model', Level.OK, f'{file.stem} ({loaded.model_id})', gel=loaded.gel, layout=loaded.model.layout)
        self._force = self.create_publisher(topics.FORCE_DISTRIBUTION)
        self._wrench = self.create_publisher(topics.WRENCH)
        self.create_subscription(topics.FLOW_FEATURES, self._on_features)

    def _on_features(self, received: Received) -> None:
        message: types.FlowFeatures = received.message
        start_ns = perf_ns()
        found = self._estimator.predict(conversions.features_array(message))
        predict_s = (perf_ns() - start_ns) * 1e-9
        force = self._message(message, found, predict_s, self.age_s(received))
        self._force.publish(force)
        self._wrench.publish(conversions.wrench_message(force))

    def _message(
        self, features: types.FlowFeatures, found: ForceMap, predict_s: float, since_s: float
    ) -> types.ForceDistribution:
        reasons = int(features.reasons | self._reasons(features, found))
        touching = not reasons & _INVALID and self._contact.update(found.total_n)
        bins = self._estimator.model.bins
        stages: types.StageTimes = features.stages
        return types.ForceDistribution(
            header=types.Header(stamp=features.header.stamp, frame_id=self.params.frame_id),
            status=_status(reasons),
            reasons=reasons,
            provenance=replace(self._provenance, reference_id=features.reference_id),  # type: ignore[type-var]
            stages=types.StageTimes(
                acquire=stages.acquire,
                flow=stages.flow,
                features=stages.features,
                predict=predict_s,
                transport=stages.transport + max(0.0, since_s - predict_s),
            ),
            **conversions.force_fields(
                found.normal_force_n,
                bins,
                self._touching(found) if touching else (),
                total_sigma_n=found.total_sigma_n,
                unlikeness=found.unlikeness,
            ),
        )

    def _touching(self, found: ForceMap) -> tuple[Contact, ...]:
        """The strongest contact, and the others that are above the threshold."""
        least_n = self._contact.threshold_n
        return (found.contacts[0], *(each for each in found.contacts[1:] if each.force_n >= least_n))

    def _reasons(self, features: types.FlowFeatures, found: ForceMap) -> int:
        kind = types.ForceDistribution
        faults = {
            kind.REASON_NOT_FINITE: not math.isfinite(found.total_n),
            kind.REASON_LOW_CONFIDENCE: found.confidence < self.params.least_confidence,
            kind.REASON_UNLIKE_TRAINING: found.unlikeness > 1,
            kind.REASON_OTHER_IMAGE: (features.image_width, features.image_height) != self._image_size,
        }
        return sum(bit for bit, present in faults.items() if present)


def _status(reasons: int) -> int:
    if reasons & _INVALID:
        return types.ForceDistribution.STATUS_INVALID
    return types.ForceDistribution.STATUS_DEGRADED if reasons else types.ForceDistribution.STATUS_OK


def main() -> int:
    """The program ``force_estimator_node``."""
    return run_node(ForceEstimatorNode)


if __name__ == '__main__':
    sys.exit(main())
