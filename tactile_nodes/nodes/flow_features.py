"""Images in, features of the gel's motion against the rest image out.

Subscribes ``image_raw`` (and ``reference_image`` when told to take the rest image from there); publishes
``flow_features`` and the latched ``reference_image``. Services: ``~/capture_reference``, ``~/save_reference`` and
``~/save_overlay``.
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from tactile_nodes import conversions
from tactile_nodes.bus import topics
from tactile_nodes.bus.arguments import NodeArguments
from tactile_nodes.bus.diagnostics import Level
from tactile_nodes.bus.node import Node, NodeParams
from tactile_nodes.bus.protocol import Bus, Received
from tactile_nodes.bus.runtime import run_node
from tactile_nodes.clock import Clock, perf_ns
from tactile_nodes.drivers.pictures import read_grey, write_png
from tactile_nodes.errors import ConfigurationError, ImageError
from tactile_nodes.messages import stamp_ns, types
from tactile_nodes.methods import MethodParams, StillnessParams, make_check, make_methods, told
from tactile_nodes.params import parameter
from tactile_nodes.sensing.flow import DisplacementField
from tactile_nodes.sensing.quality import picture_faults
from tactile_nodes.sensing.tracking import FeatureTracker, overlay

_DARK = types.ForceDistribution.REASON_DARK_IMAGE
_SATURATED = types.ForceDistribution.REASON_SATURATED_IMAGE


@dataclass(frozen=True)
class FlowFeaturesParams(MethodParams, NodeParams):
    """Parameters of the flow features node."""

    reference: str = parameter(
        'capture', 'where the rest image comes from', choices=('capture', 'file', 'topic'), read_only=True
    )
    reference_frames: int = parameter(10, 'frames averaged into a captured rest image', minimum=1)
    skip_frames: int = parameter(0, 'frames left out before the capture at start', minimum=0)
    marked_share: float = parameter(
        0.1, 'share of regions that must show a pattern in a rest image', minimum=0.0, maximum=1.0
    )
    reference_file: str = parameter('', 'picture (PNG) that a rest image is read from or saved to')
    overlay_folder: str = parameter('', 'where pictures of the motion are saved; empty: the working folder')
    overlay_every: int = parameter(
        0, 'save a picture of the motion every so many frames; 0: only when asked', minimum=0
    )
    stillness: StillnessParams = field(default_factory=StillnessParams)


class FlowFeaturesNode(Node):
    """Turns each image into features; its messages carry the image's stamp."""

    NAME = 'flow_features'
    PARAMS = FlowFeaturesParams

    def __init__(self, bus: Bus, arguments: NodeArguments | None = None, clock: Clock | None = None) -> None:
        super().__init__(bus, arguments, clock)
        chosen: FlowFeaturesParams = self.params
        flow, encoding = make_methods(chosen)
        self._method = told(flow)
        self._tracker = FeatureTracker(
            flow,
            encoding,
            rest_frames=chosen.reference_frames,
            marked_share=chosen.marked_share,
            check=make_check(chosen.stillness),
        )
        self._features = self.create_publisher(topics.FLOW_FEATURES)
        self._frames = 0
        self._last: tuple[np.ndarray, DisplacementField] | None = None
        self._begin(chosen)
        self.create_subscription(topics.IMAGE, self._on_image)
        self.create_trigger('~/capture_reference', self._capture_again)
        self.create_trigger('~/save_reference', self._save_reference)
        self.create_trigger('~/save_overlay', self._save_overlay)

    def _begin(self, chosen: FlowFeaturesParams) -> None:
        if chosen.reference == 'topic':
            self.create_subscription(topics.REFERENCE_IMAGE, self._on_reference)
            return
        self._reference = self.create_publisher(topics.REFERENCE_IMAGE)
        if chosen.reference == 'file':
            self._tracker.use_reference(read_grey(chosen.reference_file))
            self._announce_reference(conversions.header(self.clock.now_ns(), ''))
        else:
            self._tracker.begin_capture(skip=chosen.skip_frames)

    def _on_image(self, received: Received) -> None:
        image = conversions.image_array(received.message)
        if self._tracker.capturing:
            self._offer_rest(image, received.message.header)
        elif self._tracker.reference is not None:
            self._track(image, received)

    def _offer_rest(self, image: np.ndarray, head: types.Header) -> None:
        try:
            if self._tracker.offer_rest(image):
                self._announce_reference(head)
        except ImageError as error:
            self.report('rest image', Level.WARN, str(error))

    def _track(self, image: np.ndarray, received: Received) -> None:
        start_ns = perf_ns()
        field_px = self._tracker.field(image)
        flow_ns = perf_ns()
        features = self._tracker.features(field_px)
        features_ns = perf_ns()
        head = received.message.header
        stages = types.StageTimes(
            acquire=math.nan if self.params.use_sim_time else (received.source_ns - stamp_ns(head.stamp)) * 1e-9,
            flow=(flow_ns - start_ns) * 1e-9,
            features=(features_ns - flow_ns) * 1e-9,
            predict=math.nan,
            transport=max(0.0, self.age_s(received) - (features_ns - start_ns) * 1e-9),
        )
        faults = picture_faults(image)
        self._features.publish(
            types.FlowFeatures(
                header=head,
                image_width=image.shape[1],
                image_height=image.shape[0],
                method=self._method,
                reference_id=self._tracker.reference_id,
                image_level=faults.level,
                untouched=self._tracker.untouched(field_px),
                reasons=faults.dark * _DARK | faults.saturated * _SATURATED,
                stages=stages,
                **conversions.feature_fields(features),
            )
        )
        self._last = (image, field_px)
        self._frames += 1
        if self.params.overlay_every and self._frames % self.params.overlay_every == 1 % self.params.overlay_every:
            self._save_overlay()

    def _on_reference(self, received: Received) -> None:
        self._tracker.use_reference(np.array(conversions.image_array(received.message)))
        self._report_reference()

    def _announce_reference(self, head: types.Header) -> None:
        assert self._tracker.reference is not None
        self._reference.publish(conversions.image_message(self._tracker.reference, head))
        self._report_reference()

    def _report_reference(self) -> None:
        assert self._tracker.reference is not None
        height, width = self._tracker.reference.shape
        self.log.info(f'new rest image {self._tracker.reference_id}')
        self.report('rest image', Level.OK, f'{self._tracker.reference_id}, {width}x{height}')

    def _capture_again(self) -> str:
        if self.params.reference == 'topic':
            raise ConfigurationError('the rest image comes from a topic here; publish another one there')
        self._tracker.begin_capture()
        return f'capturing the rest image from the next {self.params.reference_frames} frames; touch nothing'

    def _save_reference(self) -> str:
        if self._tracker.reference is None:
            raise ImageError('there is no rest image yet; capture one first')
        file = Path(self.params.reference_file or 'reference.png')
        return f'saved {write_png(file, self._tracker.reference)}'

    def _save_overlay(self) -> str:
        if self._last is None:
            raise ImageError('no frame has been measured yet; is the camera running?')
        image, field_px = self._last
        file = Path(self.params.overlay_folder or '.') / f'flow_{self._frames:06d}.png'
        return f'saved {write_png(file, overlay(np.array(image), field_px.displacement_px))}'


def main() -> int:
    """The program ``flow_features_node``."""
    return run_node(FlowFeaturesNode)


if __name__ == '__main__':
    sys.exit(main())
