"""The session of a person who presses by hand, from the untouched gel to the last press."""

from __future__ import annotations

import math
from collections import deque
from typing import Protocol

import numpy as np

from tactile_nodes.drivers.camera.contract import Camera, Frame
from tactile_nodes.errors import DatasetError, DeviceError, DeviceTimeoutError, ImageError
from tactile_nodes.learning.guided.folder import PressFolder
from tactile_nodes.learning.guided.targets import Target, Wish, digits
from tactile_nodes.learning.guided.watching import HELD, STEADY, UNTOUCHED, Watch
from tactile_nodes.sensing.geometry import grey
from tactile_nodes.sensing.picture.change import PictureComparison
from tactile_nodes.sensing.picture.quality import require_picture
from tactile_nodes.sensing.rest.capture import RestCapture
from tactile_nodes.sensing.rest.reference import average
from tactile_nodes.sensors import Sensor
from tactile_nodes.shapes import UInt8

RESTS = 20
"""Images of the untouched gel: a fifth is held out for a test, and twelve have to remain."""
MOVED_PX = 1.0
"""Motion from which the camera counts as displaced. Less is removed with the image of the untouched gel that is saved
before each press."""
PATIENCE_S = 5.0
UNUSABLE = 60
"""So many images in a row may be dark or damaged: many cameras begin with dark ones."""
NO_PLACE = (math.nan, math.nan)

ASIDE_MM = 5.0
"""A press is not seen farther from its place than this; the camera's estimate is a millimetre or two off."""

Answer = tuple[float, tuple[float, float]]
Picture = UInt8[np.ndarray, 'h w']


class Person(Protocol):
    """The person who presses."""

    def leave_untouched(self) -> None:
        """Ask the person not to touch the gel."""
        ...

    def press(self, target: Target, picture: Picture, done: list[Target]) -> None:
        """Announce the next press."""
        ...

    def sees(self, state: str, place_mm: tuple[float, float]) -> None:
        """Show what the camera sees, and roughly where."""
        ...

    def reading(self, target: Target) -> Answer | None:
        """The scale's reading, in its unit, and the pressed place (mm); None if this press is skipped."""
        ...

    def say(self, text: str) -> None:
        """Show a line of text."""
        ...


class Guide:
    """Guides a person through the wanted presses.

    Args:
        camera: an open one, which looks at the gel.
        person: who presses.
        folder: where presses are saved, with those of earlier sessions.
        wish: the wanted presses.
        sensor: the description of the pressed sensor.
    """

    def __init__(self, camera: Camera, person: Person, folder: PressFolder, wish: Wish, sensor: Sensor) -> None:
        self._camera, self._person, self._folder, self._wish = camera, person, folder, wish
        self._sensor = sensor
        self._skipped: list[Target] = []
        self._untouched = deque[Picture](maxlen=HELD)

    def run(self) -> None:
        """Ask for all presses that are missing; returns when none is.

        Raises:
            DatasetError: the gel or its camera differs from the folder's, or nothing can be written.
            DeviceError: the camera is lost, or its images end.
            ImageError: images that are dark, of another size than described, or without markers.
        """
        watch = Watch(self._sensor, self._rest())
        while (target := self._wish.next(self._folder.done, self._skipped)) is not None:
            self._untouched.append(self._picture())
            self._person.press(target, self._untouched[-1], self._folder.done)
            self._press(watch, target)

    def missing(self) -> str:
        """The presses so far, and those that are missing."""
        done = self._folder.done
        folder, wanted = self._folder, zip(self._wish.forces_n, self._wish.counts(done), strict=True)
        forces = ', '.join(f'{count} of about {digits(force / folder.newton)} {folder.unit}' for force, count in wanted)
        gap = f', largest distance to a press {self._wish.gap_mm(done):.1f} mm' if done else ''
        return f'{len(done)} of {self._wish.presses} presses ({forces}){gap}'

    def _rest(self) -> list[Picture]:
        """Images of the untouched gel as it is now, which must be that of an earlier session."""
        kept = self._folder.rests(RESTS)
        self._person.leave_untouched()
        capture = RestCapture(8)
        while capture.offer(picture := self._picture()) is None:
            if capture.waiting:
                self._person.sees('moving', NO_PLACE)
        if kept:
            self._require_same(average(kept), picture)
        now = [self._picture() for _ in range(RESTS)]
        for each in now[len(kept) :]:
            self._folder.add_rest(each)
        return now

    def _require_same(self, before: Picture, now: Picture) -> None:
        if before.shape != now.shape:
            raise DatasetError(f'the images in {self._folder.folder} have another size than the camera delivers now')
        change = PictureComparison(before).of(now)
        moved_px = max(change.size_px, change.apart_px)
        if not change.same or not moved_px <= MOVED_PX:
            difference = f'the camera has moved by {moved_px:.1f} px' if change.same else 'it sees another gel'
            raise DatasetError(
                f'compared with the untouched images in {self._folder.folder}, {difference}, or something touches '
                'the gel; start another folder, and give both tables to tactile dataset import'
            )

    def _press(self, watch: Watch, target: Target) -> None:
        """One press: wait for it, ask for its reading, save it, and wait until the gel is released."""
        picture = self._until(watch, STEADY)
        before = self._untouched[0]  # the newest may show the beginning of the touch
        self._untouched.clear()
        answer = self._answer(watch, target)
        if answer is None:
            self._skipped.append(target)
            self._person.say('passed over')
        elif not watch.holds(picture, self._picture()):
            self._person.say('the press moved while you read the scale, so it was not kept: hold it until it is kept')
        else:
            reading, place_mm = answer
            self._folder.add_rest(before)
            self._folder.add_press(picture, place_mm, reading)
            self._person.say(f'kept; {self.missing()}. Lift off')
        self._until(watch, UNTOUCHED)

    def _answer(self, watch: Watch, target: Target) -> Answer | None:
        """The person's reading and place; asked again if a reading is impossible, but only once about a place."""
        asked_for_place = False
        while (answer := self._person.reading(target)) is not None:
            off_mm = math.dist(answer[1], watch.place_mm)
            if fault := self._folder.fault(*answer):
                self._person.say(fault)
            elif off_mm > ASIDE_MM and not asked_for_place:
                asked_for_place, (x, y) = True, watch.place_mm
                self._person.say(
                    f'the camera sees it at about x {round(x)}, y {round(y)} mm, {off_mm:.0f} mm away: type the place'
                )
            else:
                break
        return answer

    def _until(self, watch: Watch, state: str) -> Picture:
        """The first image that shows a state."""
        while True:
            picture = self._picture()
            seen = watch.see(picture)
            self._person.sees(seen, watch.place_mm)
            if seen == UNTOUCHED:
                self._untouched.append(picture)
            if seen == state:
                return picture

    def _picture(self) -> Picture:
        """The newest usable image of the camera, in grey, as described."""
        picture = _usable(self._camera)
        image = self._sensor.image
        if picture.shape != (image.height, image.width):
            height, width = picture.shape
            raise ImageError(
                f'the camera delivers images of {width}x{height} pixels, but the description of the sensor says '
                f'{image.width}x{image.height}; set the camera, or correct the description'
            )
        return picture


def _usable(camera: Camera) -> Picture:
    """The next image that is neither dark, overexposed nor damaged. Raises ImageError: none of `UNUSABLE` is."""
    for left in reversed(range(UNUSABLE)):
        try:
            picture = grey(_frame(camera).image)
            require_picture(picture)
        except ImageError:
            if not left:
                raise
        else:
            break
    return picture


def _frame(camera: Camera) -> Frame:
    try:
        frame = camera.read(PATIENCE_S)
    except DeviceTimeoutError as error:
        raise DeviceError(f'{error}; check the camera and start again: the presses are kept') from error
    if frame is None:
        raise DeviceError('the recording has ended; the presses are kept')
    return frame
