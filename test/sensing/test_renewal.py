"""When a rest image is taken anew: never of a touch, at once after a change of light, slowly otherwise."""

from __future__ import annotations

import numpy as np

from tactile_nodes.sensing.renewal import Renewal, RenewalOptions, Rested

S = 1_000_000_000
IMAGE = np.full((4, 4), 90, np.uint8)
STILL = Rested(surely=True, maybe=True, like=True, changed=False)
DIMMER = Rested(surely=False, maybe=True, like=False, changed=True)
TOUCHED = Rested(surely=False, maybe=False, like=False, changed=True)
CREPT = Rested(surely=True, maybe=True, like=False, changed=False)


def renewed(frames: list[Rested], fps: float = 30.0) -> list[int]:
    """Numbers of the frames that completed a rest image."""
    renewal = Renewal(RenewalOptions(frames=8, least_s=0.2, after_s=60.0))
    renewal.taken(0, renewed=False)
    stamps = [round((number + 1) / fps * S) for number in range(len(frames))]
    offered = [renewal.offer(IMAGE, at_ns, each) for at_ns, each in zip(stamps, frames, strict=True)]
    return [number for number, image in enumerate(offered) if image is not None]


def test_another_light_renews_the_rest_image_once_eight_frames_show_it() -> None:
    assert renewed([STILL] * 4 + [DIMMER] * 8) == [11]


def test_a_touch_begins_the_count_anew_and_ends_the_calm() -> None:
    assert renewed([STILL] * 4 + [DIMMER] * 4 + [TOUCHED] + [DIMMER] * 20) == []
    assert renewed([STILL] * 4 + [TOUCHED] + [STILL] + [DIMMER] * 8) == [13]


def test_what_creeps_is_renewed_after_a_minute_and_only_while_it_is_surely_at_rest() -> None:
    assert renewed([CREPT] * 80, fps=1.0)[0] == 66  # the 60th s is frame 59, and it takes eight
    assert renewed([Rested(surely=False, maybe=True, like=False, changed=False)] * 80, fps=1.0) == []


def test_a_picture_like_the_rest_image_renews_nothing() -> None:
    assert renewed([STILL] * 200, fps=1.0) == []
