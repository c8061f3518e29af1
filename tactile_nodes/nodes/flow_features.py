"""From images to features of the gel's motion relative to the rest image.

Subscribes to ``image_raw`` (and ``reference_image`` if the rest image comes from there); publishes
``flow_features`` and the latched ``reference_image``. Services: ``~/capture_reference``, ``~/save_reference`` and
``~/save_overlay``.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from tactile_nodes import conversions
from tactile_nodes.bus import topics
from tactile_nodes.bus.node.arguments import NodeArguments
from tactile_nodes.bus.node.diagnostics import Level
from tactile_nodes.bus.node.node import Node, NodeParams
from tactile_nodes.bus.node.runtime import run_node
from tactile_nodes.bus.protocol import Bus, Received
from tactile_nodes.clock import NS_PER_S, Clock
from tactile_nodes.drivers.camera.pictures import read_grey, write_png
from tactile_nodes.errors import ConfigurationError, ImageError, TactileError
from tactile_nodes.messages import decode, encode, stamp_ns, types
from tactile_nodes.params import parameter
from tactile_nodes.pipeline.following import Following, FollowingParams
from tactile_nodes.pipeline.loop_choice import choose
from tactile_nodes.pipeline.methods import image_size
from tactile_nodes.sensing.geometry import described_part, middle_part
from tactile_nodes.sensing.rest.reference import content_id
from tactile_nodes.sensors import load_sensor

_KEPT, _MEMORY = 'rest_image', 'memory'
KEEP_NS = NS_PER_S
"""Learned state is saved for a restart at most this often."""
ANOTHER_TIME_NS = NS_PER_S
"""A rest image from the topic that came so long before a picture applies to it, whatever its stamp."""

SOONEST = 0.75
"""Fraction of the frame interval: of a camera whose pictures come sooner after each other, some are skipped."""
CHECK_PERIOD_S = 1.0
SILENT_NS = 2 * NS_PER_S


@dataclass(frozen=True)
class FlowFeaturesParams(FollowingParams, NodeParams):
    reference: str = parameter('capture', 'where the rest image comes from', choices=('capture', 'file', 'topic'))
    compiled: bool = parameter(True, 'compute with loops compiled by numba, as force_estimator does')
    sensor: str = parameter(
        '', 'sensor description (name or file): pictures of its size are cropped as it says, others are not'
    )
    crop: int = parameter(
        0,
        'side of the central square crop of each picture [px], used without `sensor`; 0: as in the model, and square '
        'pictures whole if the model reads squares',
        minimum=0,
    )
    most_hz: float = parameter(0.0, 'most pictures per second that are processed; 0: all', minimum=0.0, maximum=1e6)
    skip_frames: int = parameter(0, 'frames to skip before the capture at start', minimum=0)
    reference_file: str = parameter(
        '', 'PNG file to read the rest image from, or to save it to (empty: named by node)', read_only=False
    )
    overlay_folder: str = parameter(
        '', 'folder for pictures of the motion, named by node and number; empty: the working folder', read_only=False
    )
    overlay_every: int = parameter(
        0, 'save a picture of the motion every N frames; 0: only on request', minimum=0, read_only=False
    )


class FlowFeaturesNode(Node):
    """Turns each image into features; its messages carry the image's stamp."""

    NAME = 'flow_features'
    PARAMS = FlowFeaturesParams

    def __init__(self, bus: Bus, arguments: NodeArguments | None = None, clock: Clock | None = None) -> None:
        super().__init__(bus, arguments, clock)
        compiled = choose(self.given('compiled'), self.log.info, self.log.warn)
        self._following = Following(self.params, compiled=compiled)
        self._features = self.create_publisher(topics.FLOW_FEATURES)
        self._frames = self._seen_ns = self._kept_ns = 0
        self._learned: tuple[object, ...] = ()
        self._came, self._size = '', image_size(self.params.model)
        self._described = load_sensor(self.params.sensor).image if self.params.sensor else None
        self._received_ns = self._apart_ns = 0
        self._about: tuple[Level, str] | None = None
        self._trouble = ''
        self._rest: tuple[Level, str] | None = None
        self._drawn: tuple[Path | None, int] = None, 0  # the folder of drawings, and the last number before this start
        self._coming: list[Received] = []  # rest images from the topic, for pictures that are still to come
        self._renewed = '', 0  # id and stamp of the last rest image that this node renewed itself
        self._begin(self.params)
        self.create_subscription(topics.IMAGE, self._on_image)
        self.create_trigger('~/capture_reference', self._capture_again)
        self.create_trigger('~/save_reference', self._save_reference)
        self.create_trigger('~/save_overlay', self._save_overlay)
        self.create_timer(CHECK_PERIOD_S, self._check_pictures)

    def _begin(self, chosen: FlowFeaturesParams) -> None:
        if chosen.reference == 'topic':
            self.create_subscription(topics.REFERENCE_IMAGE, self._coming.append)
            return
        self._reference = self.create_publisher(topics.REFERENCE_IMAGE)
        if self._restored():
            return
        if chosen.reference == 'file':
            image = self._read(chosen.reference_file)
            self._following.use_reference(image, conversions.header(self.clock.now_ns(), ''))
            self._tell_reference()
        else:
            if chosen.reference_file and Path(chosen.reference_file).exists():
                self.log.warn(f'{chosen.reference_file} is not read, a rest image is captured; add reference:=file')
            self._following.begin_capture(skip=chosen.skip_frames)

    def _read(self, file: str) -> np.ndarray:
        """The rest image in a file. Raises ConfigurationError: it is none of the described sensor."""
        image = self._cropped(read_grey(file))
        if (described := self._described) and image.shape[::-1] != described.crop_px:
            raise ConfigurationError(
                f'the rest image {file} has {image.shape[1]}x{image.shape[0]} pixels, but image of '
                f'{self.params.sensor} says {described.width}x{described.height}; give a picture of this sensor at rest'
            )
        return image

    def _restored(self) -> bool:
        """Continue with the rest image from before a restart within this launch: something may touch the gel now."""
        if (data := self.kept.get(_KEPT)) is None:
            return False
        try:
            message = decode(data, topics.REFERENCE_IMAGE.type_name)
            self._following.use_reference(np.array(conversions.image_array(message)), message.header)
        except TactileError as error:
            self.report('rest image', Level.WARN, f'the rest image from before the restart cannot be used: {error}')
            return False
        self._go_on()  # also with what speaks against the rest image
        self._tell_reference()
        return True

    def _go_on(self) -> None:
        """Continue with all state from before the restart if it is usable; else with the rest image alone."""
        if (data := self.kept.get(_MEMORY)) is None:
            return
        try:
            self._following.memory.recall(data)
        except TactileError as error:
            self.log.warn(f'only the rest image was restored after the restart: {error}')

    def _keep(self) -> None:
        """Save what was learned from many frames, for a restart; rarely, as parts of it change in every frame."""
        learned, now_ns = self._following.memory.learned, self.clock.now_ns()
        if self.params.reference == 'topic' or learned == self._learned:
            return
        if 0 <= now_ns - self._kept_ns < KEEP_NS:  # less than 0 when a bag begins again
            return
        self._learned, self._kept_ns = learned, now_ns
        self.kept.put(_MEMORY, self._following.memory.saved())

    def _on_image(self, received: Received) -> None:
        now_ns = self.clock.now_ns()
        self._apart_ns, self._received_ns = now_ns - (self._received_ns or now_ns), now_ns
        if self._too_soon(stamp_ns(received.message.header.stamp)):
            return
        self._take_reference(received)
        image, head = self._picture(received.message), received.message.header
        acquire_s = math.nan if self.params.use_sim_time else (received.source_ns - stamp_ns(head.stamp)) * 1e-9
        features = self._following.answer(image, head, acquire_s=acquire_s, waited_s=self.age_s(received))
        self._features.publish(features)
        self._tell_reference()
        if not features.reasons & types.ForceDistribution.REASON_NO_REFERENCE:
            self._frames += 1
            self._keep()
            every = self.params.overlay_every
            if every and self._frames % every == 1 % every:
                self._save_overlay()

    def _too_soon(self, at_ns: int) -> bool:
        """Whether the camera delivers more frames than are wanted, and there was one in this frame interval.

        Intervals are counted from zero, so that a replay chooses the pictures of the live run, wherever it begins.
        """
        before_ns, self._seen_ns = self._seen_ns, at_ns
        if not self.params.most_hz:
            return False
        frame_ns: int = round(NS_PER_S / self.params.most_hz)
        return 0 <= at_ns - before_ns < SOONEST * frame_ns and at_ns // frame_ns == before_ns // frame_ns

    def _picture(self, message: types.Image) -> np.ndarray:
        """The picture, cropped; pictures of our camera node are cropped already, those of other nodes are not."""
        picture = self._cropped(conversions.image_array(message))
        came = f'{message.width}x{message.height} {message.encoding}'
        if came != self._came:
            self._came = came
            self._tell_picture(came, picture)
        return picture

    def _cropped(self, picture: np.ndarray) -> np.ndarray:
        if self._described is None:
            return middle_part(picture, self.params.crop, self._size)
        return described_part(picture, self._described)

    def _tell_picture(self, came: str, picture: np.ndarray) -> None:
        taken, image = f'{picture.shape[1]}x{picture.shape[0]}', self._described
        whole = came.startswith(f'{taken} ')
        how = 'used whole' if whole else f'the central {taken} are used (parameter {"sensor" if image else "crop"})'
        text, say, level = f'{self.names.resolve(topics.IMAGE.name)} has {came}: {how}', self.log.info, Level.OK
        if image and picture.shape[::-1] != image.crop_px:
            text += (
                f', but sensor {self.params.sensor} is described with {image.width}x{image.height}; set the camera so'
            )
            say, level = self.log.warn, Level.WARN
        self._about = level, text
        self.diagnostics.report('pictures', level, text)
        say(text)

    def _check_pictures(self) -> None:
        """A camera process or a network that hangs does not report it itself."""
        silent_ns = self.clock.now_ns() - self._received_ns
        if self._about is None:
            return
        if silent_ns > max(SILENT_NS, 3 * self._apart_ns):
            self.report('pictures', Level.WARN, 'no more pictures; check the camera and its node')
        else:
            self.report('pictures', *self._about)

    def _take_reference(self, picture: Received) -> None:
        """Use the last rest image from the topic that was captured before this picture.

        In a replay, a rest image arrives while many earlier pictures still wait. After `ANOTHER_TIME_NS` its stamp does
        not count any more, since it may be of another time base. A rest image that was renewed live has been renewed
        here from the same pictures: taken again, it would lose what is known of the camera's motion.
        """
        due = [each for each in self._coming if _is_before(each, picture)]
        if not due:
            return
        del self._coming[: self._coming.index(due[-1]) + 1]
        try:
            image, head = np.array(conversions.image_array(due[-1].message)), due[-1].message.header
            if (content_id(image), stamp_ns(head.stamp)) != self._renewed:
                self._following.use_reference(image, head)
        except TactileError as error:  # the picture is measured against the rest image before
            self.report('rest image', Level.WARN, str(error))

    def _tell_reference(self) -> None:
        before, self._trouble = self._trouble, self._following.trouble
        if self._trouble:
            self.report('rest image', Level.WARN, self._trouble)
        elif before and self._rest is not None:
            self.report('rest image', *self._rest)
        if (message := self._following.announced()) is None:
            return
        if self.params.reference != 'topic':
            self._reference.publish(message)
            self.post(lambda: self.kept.put(_KEPT, encode(message)))  # not now: a full disk is no reason to end
        if self._following.renewed:
            self._renewed = self._following.reference_id, stamp_ns(message.header.stamp)
        how = 'renewed (no contact)' if self._following.renewed else 'new'
        text = f'{self._following.reference_id}, {message.width}x{message.height}'
        if self._following.doubtful:
            text += ', but the picture never was still: do not touch the gel, then call capture_reference'
            self.log.warn(f'{how} rest image {text}')
        else:
            self.log.info(f'{how} rest image {self._following.reference_id}')
        self._rest = Level.WARN if self._following.doubtful else Level.OK, text
        self.report('rest image', *self._rest)

    def _capture_again(self) -> str:
        if self.params.reference == 'topic':
            raise ConfigurationError('the rest image comes from a topic; publish a new one there')
        self._following.begin_capture()
        return f'capturing the rest image from the next {self.params.reference_frames} frames; do not touch the gel'

    @property
    def _file_name(self) -> str:
        """The beginning of the names of files, as nodes of several sensors may write into one folder."""
        return self.full_name[1:].replace('/', '.')

    def _save_reference(self) -> str:
        if self._following.reference is None:
            raise ImageError('there is no rest image yet; capture one first')
        file = Path(self.params.reference_file or f'{self._file_name}_reference.png')
        return f'saved {write_png(file, self._following.reference)}'

    def _save_overlay(self) -> str:
        folder = Path(self.params.overlay_folder or '.')
        mine = self._file_name
        if folder != self._drawn[0]:
            self._drawn = folder, _last_number(folder, mine)
        file = folder / f'{mine}_{self._drawn[1] + self._frames:06d}.png'
        return f'saved {write_png(file, self._following.overlay())}'


def _is_before(reference: Received, picture: Received) -> bool:
    """Whether a rest image applies to a picture; not yet to that of its stamp, which was the last it was made from."""
    captured_ns, at_ns = (stamp_ns(each.message.header.stamp) for each in (reference, picture))
    return captured_ns < at_ns or picture.received_ns - reference.received_ns > ANOTHER_TIME_NS


def _last_number(folder: Path, mine: str) -> int:
    """The highest number of a node's drawings in a folder; 0 if there are none.

    Raises:
        ConfigurationError: the folder cannot be read.
    """
    try:
        there = [each.name for each in folder.glob(f'{mine}_*.png')]
    except OSError as error:  # of another user, or on a disk that is gone
        raise ConfigurationError(f'cannot read {folder} ({error.strerror}); choose another folder') from error
    found = (re.fullmatch(rf'{re.escape(mine)}_([0-9]+)\.png', each) for each in there)
    return max((int(each[1]) for each in found if each), default=0)


main = partial(run_node, FlowFeaturesNode)
