"""The force of a steady contact, averaged over the last frames while the picture is unlike those of the training.

How far back frames may be looked at is the rule of Goldenshluger and Nemirovski (Mathematical Methods of Statistics 6,
1997) and Katkovnik (IEEE Transactions on Signal Processing 47, 1999): windows grow back from now; each gives an
estimate, by a straight line through its frames, and an interval of confidence about it; the last window is used whose
interval has a point in common with those of all shorter ones. Force and place of every contact must all agree.

A straight line follows a force that grows, and of one that stands still it is twice as noisy as the mean. So the slope
is shrunk towards none by how surely there is one (James and Stein, 1961, of one number): of a steady contact the mean
is nearly all that is left, and a slope of several times its own noise counts in full.
"""

from __future__ import annotations

import itertools
import math
from collections import deque
from collections.abc import Hashable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from tactile_nodes.sensing.explain.measured.picture_noise import noise_between
from tactile_nodes.sensing.explain.model import ForceMap
from tactile_nodes.sensing.explain.reading import UNKNOWN, Contact, spread_over_bins
from tactile_nodes.sensing.geometry import BinGrid

NS_PER_S = 1_000_000_000
LONGEST_NS, MOST_FRAMES = 400_000_000, 8
"""How far back a window may go: nobody should have to wait longer for a force that changes too slowly to be seen."""

INTERVAL = 0.8
"""Standard deviations that an interval of confidence reaches to either side. With more a step or a turn of the force is
taken for noise for longer, and its error exceeds that of a single frame; with less steady forces gain less."""

SHRUNK_BY = 3.0
"""A slope loses so many times its variance over its square of itself; one that is smaller than that goes."""

TINY = 1e-12


@dataclass(frozen=True)
class _Frame:
    """One frame: place and force (x, y in mm, N) of each contact, and the noise seen between it and the one before."""

    stamp_ns: int
    found: ForceMap
    contacts: tuple[Contact, ...]
    noise: float

    @property
    def numbers(self) -> Float[np.ndarray, ' n']:
        return np.array([(each.x_mm, each.y_mm, each.force_n) for each in self.contacts]).reshape(-1)


class SteadyForce:
    """Averages the force maps of a contact that does not change, frame by frame."""

    def __init__(self) -> None:
        self._frames: deque[_Frame] = deque(maxlen=MOST_FRAMES)
        self._beside: Hashable = None

    def forget(self) -> None:
        """Begin anew with the next frame: contact began or ended, or a force may not be used."""
        self._frames.clear()

    def averaged(
        self, stamp_ns: int, found: ForceMap, bins: BinGrid, beside: Hashable = None
    ) -> tuple[ForceMap, float]:
        """The map of a frame in which something touches, averaged, and over which time, in s (0: it is as it was).

        The sum of the bins, total, peak and contacts are those of one another; the total's uncertainty is that of the
        frame less what the mean takes away of its noise.

        Args:
            stamp_ns: of the frame. It begins anew with one that is older than the one before; the same stamp again is
                the same frame, and counts once.
            bins: of the map.
            beside: what the motion was measured beside and read by; with another it begins anew.
        """
        if found.left_over is None:
            self.forget()
            return found, 0.0
        self._take(stamp_ns, found, beside)
        noise = self._noise()
        if not math.isfinite(noise):  # that of a first frame is not known
            return found, 0.0
        back_s = np.array([stamp_ns - each.stamp_ns for each in self._frames]) / NS_PER_S
        numbers = np.stack([each.numbers for each in self._frames])
        now = self._frames[0].contacts
        sigma = noise * np.array([(each.noise_mm, each.noise_mm, each.noise_n) for each in now]).reshape(-1)
        count, estimate, left = steady(back_s, numbers, sigma)
        moved = _moved(found, now, estimate, bins)
        gone = float(np.square(sigma[2::3]) @ (1 - left[2::3]))
        sigma_n = math.sqrt(max(found.total_sigma_n**2 - gone, found.total_sigma_n**2 * float(left[2::3].max())))
        return replace(moved, total_sigma_n=sigma_n), float(back_s[count - 1])

    def _take(self, stamp_ns: int, found: ForceMap, beside: Hashable) -> None:
        """As the first of the frames kept, the newest of which come first."""
        kept = self._frames
        if kept and kept[0].stamp_ns == stamp_ns:
            kept.popleft()
        if beside != self._beside or (kept and not self._goes_on(stamp_ns, found)):
            self.forget()
        self._beside = beside
        while kept and stamp_ns - kept[-1].stamp_ns > LONGEST_NS:
            kept.pop()
        before = kept[0] if kept else None
        contacts = found.contacts if before is None else _in_order(found.contacts, before.contacts)
        kept.appendleft(_Frame(stamp_ns, found, contacts, _noise(found, before)))

    def _goes_on(self, stamp_ns: int, found: ForceMap) -> bool:
        last = self._frames[0]
        return stamp_ns > last.stamp_ns and len(found.contacts) == len(last.contacts)

    def _noise(self) -> float:
        """The middle one of those seen, or the lesser of two: between frames a contact may have begun."""
        seen = sorted(each.noise for each in self._frames if math.isfinite(each.noise))
        return seen[(len(seen) - 1) // 2] if seen else UNKNOWN


def steady(
    back_s: Float[np.ndarray, ' frames'], numbers: Float[np.ndarray, 'frames n'], sigma: Float[np.ndarray, ' n']
) -> tuple[int, Float[np.ndarray, ' n'], Float[np.ndarray, ' n']]:
    """Over how many of the frames, the newest first, numbers are averaged, what comes of it, and which share of a
    frame's variance by noise is left of each.

    Args:
        back_s: how long ago each frame was taken; the first one is now.
        sigma: standard deviation of each number in one frame.
    """
    if len(numbers) == 1:
        return 1, numbers[0], np.ones_like(sigma)
    mean, rise, rise_sigma = _lines(back_s, numbers - numbers[0])
    many = np.arange(2, len(numbers) + 1)
    spread = INTERVAL * sigma * np.hypot(1 / np.sqrt(many), rise_sigma)[:, None]
    low, high = (mean + rise - spread, mean + rise + spread)
    agree = np.maximum.accumulate(low) <= np.minimum.accumulate(high)
    last = int(np.logical_and.accumulate(agree.all(axis=1)).sum()) - 1
    if last < 0:  # of a noise that is not known
        return 1, numbers[0], np.ones_like(sigma)
    size = np.square(rise[last] / np.maximum(rise_sigma[last] * sigma, TINY))
    kept = np.maximum(1 - SHRUNK_BY / np.maximum(size, TINY), 0.0)
    left = 1 / many[last] + np.square(kept * rise_sigma[last])
    return last + 2, numbers[0] + mean[last] + rise[last] * kept, np.minimum(left, 1.0)


def _lines(
    back_s: Float[np.ndarray, ' frames'], numbers: Float[np.ndarray, 'frames n']
) -> tuple[Float[np.ndarray, 'lines n'], Float[np.ndarray, 'lines n'], Float[np.ndarray, ' lines']]:
    """Straight lines through the first two frames, three, and so on: their means, what each has more than that now, and
    how noisy the latter is where a number has a noise of 1."""
    many = np.arange(2, len(numbers) + 1)
    middle_s = np.cumsum(back_s)[1:] / many
    square = np.cumsum(np.square(back_s))[1:] - many * np.square(middle_s)
    sums = np.cumsum(numbers, axis=0)[1:]
    along = middle_s[:, None] * sums - np.cumsum(back_s[:, None] * numbers, axis=0)[1:]
    return sums / many[:, None], along * (middle_s / square)[:, None], middle_s / np.sqrt(square)


def _noise(now: ForceMap, before: _Frame | None) -> float:
    if before is None or now.left_over is None or before.found.left_over is None:
        return UNKNOWN
    return noise_between(now.left_over, before.found.left_over)


def _in_order(contacts: tuple[Contact, ...], before: tuple[Contact, ...]) -> tuple[Contact, ...]:
    """Each where it was before: of two that press alike now the one is the stronger and now the other."""
    if len(contacts) == 1:
        return contacts
    return min(itertools.permutations(contacts), key=lambda some: _way_mm(some, before))


def _way_mm(some: tuple[Contact, ...], before: tuple[Contact, ...]) -> float:
    return sum(math.dist((a.x_mm, a.y_mm), (b.x_mm, b.y_mm)) for a, b in zip(some, before, strict=True))


def _moved(found: ForceMap, contacts: tuple[Contact, ...], numbers: Float[np.ndarray, ' n'], bins: BinGrid) -> ForceMap:
    """The map with other numbers of its contacts; none pulls."""
    moved = [
        replace(each, x_mm=x, y_mm=y, force_n=max(force, 0.0))
        for each, (x, y, force) in zip(contacts, numbers.reshape(-1, 3).tolist(), strict=True)
    ]
    strongest = tuple(sorted(moved, key=lambda each: -each.force_n))
    forces_n = spread_over_bins(strongest, bins)
    return replace(
        found,
        normal_force_n=forces_n,
        total_n=float(forces_n.sum(dtype=np.float64)),
        peak_n=float(forces_n.max()),
        contact_mm=(strongest[0].x_mm, strongest[0].y_mm),
        contacts=strongest,
        position_sigma_mm=strongest[0].sigma_mm,
    )
