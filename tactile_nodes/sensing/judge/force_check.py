"""Compares the gel's force with an independent one per contact, the only way to detect that a gel has stiffened.

The hardness of a soft layer scales the force but not the motion, so no picture shows it. A force/torque sensor in the
rig or in a robot's wrist shows it, and so does a known weight.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from tactile_nodes.shapes import Float

NS_PER_S = 1_000_000_000
REMEMBERED_S = 40.0
LONGEST_CONTACT_S = 30.0
ENDED_S = 0.2
"""A contact is over after so long without contact."""
BEFORE_S = (0.6, 0.1)
"""The zero of the independent sensor is its mean over this time before each contact, so it needs no tare."""
LEAST_N, LEAST_PEAK_N, LEAST_SAMPLES = 0.1, 0.15, 5
CONTACTS = 20
LEAST_CONTACTS = 5
UNUSABLE_SHARE = 0.2
STANDARD_ERRORS = 3.0
WEIGHED_S, WEIGHED_LEAST_S, STEADY_SHARE = 2.0, 1.0, 0.05


@dataclass
class ContactFrames:
    """The frames of one contact: stamps, total force, novelty, and which frames were usable.

    `continued`: the contact is longer than 30 s and was cut, and this is not its first part.
    """

    stamps_ns: list[int] = field(default_factory=list)
    total_n: list[float] = field(default_factory=list)
    unlikeness: list[float] = field(default_factory=list)
    usable: list[bool] = field(default_factory=list)
    continued: bool = False

    def add(self, stamp_ns: int, total_n: float, unlikeness: float, usable: bool) -> None:
        """Take one frame."""
        self.stamps_ns.append(stamp_ns)
        self.total_n.append(total_n)
        self.unlikeness.append(unlikeness)
        self.usable.append(usable)


class ContactSplitter:
    """Cuts the frames into contacts."""

    def __init__(self) -> None:
        self._open: ContactFrames | None = None
        self._cut = False

    def feed(
        self, stamp_ns: int, total_n: float, unlikeness: float, *, in_contact: bool, usable: bool
    ) -> ContactFrames | None:
        """Take a frame, and return the contact if this frame ends one."""
        if self._open is not None and stamp_ns < self._open.stamps_ns[-1]:
            self._open = None  # a recording began again
        if in_contact:
            self._open = self._open or ContactFrames(continued=self._cut)
            self._open.add(stamp_ns, total_n, unlikeness, usable)
        if self._open is None or not self._over(self._open, stamp_ns):
            return None
        ended, self._open, self._cut = self._open, None, in_contact
        return ended

    def _over(self, contact: ContactFrames, stamp_ns: int) -> bool:
        silent_s = (stamp_ns - contact.stamps_ns[-1]) / NS_PER_S
        return silent_s >= ENDED_S or stamp_ns - contact.stamps_ns[0] > LONGEST_CONTACT_S * NS_PER_S


@dataclass(frozen=True)
class ForceRatio:
    """The gel's force divided by an independent one: 0.8 means a fifth too little, so the gel has stiffened.

    `sigma` is the standard error, `contacts` the number of contacts (1 for a weight).
    """

    ratio: float
    sigma: float
    contacts: int

    @property
    def off(self) -> float:
        """The error as |ln ratio|, or 0 while chance explains it."""
        away = abs(math.log(self.ratio)) if self.ratio > 0 else math.inf
        return away if away > STANDARD_ERRORS * self.sigma else 0.0


class ForceComparison:
    """Ratios of the last contacts. It takes the independent force as it arrives, and each contact when it is over."""

    def __init__(self) -> None:
        self._stamps_ns: deque[int] = deque()
        self._vectors: deque[tuple[float, float, float]] = deque()
        self._ratios: deque[float] = deque(maxlen=CONTACTS)

    def independent(self, stamp_ns: int, force_n: tuple[float, float, float]) -> None:
        """Take a sample of the independent sensor, tared or not, in any axes; NaN for axes that are not measured."""
        if all(map(math.isnan, force_n)):
            return
        if self._stamps_ns and stamp_ns < self._stamps_ns[-1]:
            self._stamps_ns.clear()
            self._vectors.clear()
        self._stamps_ns.append(stamp_ns)
        self._vectors.append(force_n)
        while stamp_ns - self._stamps_ns[0] > REMEMBERED_S * NS_PER_S:
            self._stamps_ns.popleft()
            self._vectors.popleft()

    def contact(self, contact: ContactFrames) -> ForceRatio | None:
        """The ratio over the last contacts, this one included. None: too few contacts, or the sensor is silent.

        The ratio of one contact is a least-squares fit through the origin. A delay between the two sensors biases it
        little, as the errors of loading and unloading cancel.
        """
        ratio = self._ratio_of(contact)
        if ratio is None:
            return None
        self._ratios.append(ratio)
        if len(self._ratios) < LEAST_CONTACTS:
            return None
        return ForceRatio(*_middle(self._ratios), len(self._ratios))

    def clear(self) -> None:
        """Forget the contacts, as another model measured them."""
        self._ratios.clear()

    def _ratio_of(self, contact: ContactFrames) -> float | None:
        if contact.continued or not self._stamps_ns or np.mean(contact.usable) < 1 - UNUSABLE_SHARE:
            return None  # before a continued contact there is no zero
        stamps, vectors = _measured(np.array(self._stamps_ns), np.array(self._vectors))
        begins = contact.stamps_ns[0]
        before = (stamps >= begins - BEFORE_S[0] * NS_PER_S) & (stamps <= begins - BEFORE_S[1] * NS_PER_S)
        if before.sum() < LEAST_SAMPLES or stamps[-1] < contact.stamps_ns[-1]:
            return None
        beside = np.linalg.norm(
            _at(np.array(contact.stamps_ns), stamps, vectors - vectors[before].mean(axis=0)), axis=1
        )
        chosen = (beside >= LEAST_N) & np.array(contact.usable)
        if chosen.sum() < LEAST_SAMPLES or beside.max() < LEAST_PEAK_N:
            return None
        gel = np.array(contact.total_n)
        return float((gel[chosen] * beside[chosen]).sum() / np.square(beside[chosen]).sum())


def _measured(
    stamps_ns: np.ndarray, vectors: Float[np.ndarray, 'n 3']
) -> tuple[np.ndarray, Float[np.ndarray, 'm axes']]:
    """The axes that are measured, in the samples in which none of them is NaN."""
    vectors = vectors[:, ~np.isnan(vectors).all(axis=0)]
    whole = ~np.isnan(vectors).any(axis=1)
    return stamps_ns[whole], vectors[whole]


def _at(
    wanted_ns: np.ndarray, stamps_ns: np.ndarray, vectors: Float[np.ndarray, 'n axes']
) -> Float[np.ndarray, 'm axes']:
    first = stamps_ns[0]
    wanted, known = (wanted_ns - first).astype(float), (stamps_ns - first).astype(float)
    return np.column_stack([np.interp(wanted, known, column) for column in vectors.T])


def _middle(ratios: Iterable[float]) -> tuple[float, float]:
    """Median and its relative standard error, from the median deviation: 1.2533 * 1.4826 * MAD / sqrt(n)."""
    values = np.array(list(ratios))
    middle = float(np.median(values))
    spread = 1.2533 * 1.4826 * float(np.median(np.abs(values - middle))) / math.sqrt(len(values))
    return middle, spread / max(middle, 1e-9)


class Scale:
    """The gel as a scale: the force of the last two seconds."""

    def __init__(self) -> None:
        self._read: deque[tuple[int, float, bool]] = deque()

    def feed(self, stamp_ns: int, total_n: float, *, in_contact: bool) -> None:
        """Take a frame."""
        if self._read and stamp_ns < self._read[-1][0]:
            self._read.clear()
        self._read.append((stamp_ns, total_n, in_contact))
        while stamp_ns - self._read[0][0] > WEIGHED_S * NS_PER_S:
            self._read.popleft()

    @property
    def steady_n(self) -> tuple[float, float] | None:
        """Mean and standard deviation of the force of a steady load, or None without one."""
        if not self._read or not all(touching for *_, touching in self._read):
            return None
        span_s = (self._read[-1][0] - self._read[0][0]) / NS_PER_S
        read = np.array([total for _, total, _ in self._read])
        mean, spread = float(read.mean()), float(read.std())
        return (mean, spread) if span_s >= WEIGHED_LEAST_S and spread <= STEADY_SHARE * mean else None


class UnlikeContacts:
    """The share of contacts unlike the training data, and a lower bound that chance exceeds once in 200 times."""

    KEPT, LEAST, DEVIATIONS = 50, 20, 2.6

    def __init__(self, last: Iterable[bool] = ()) -> None:
        self._unlike: deque[bool] = deque(last, maxlen=self.KEPT)

    @property
    def last(self) -> list[bool]:
        """Of each of the last contacts, whether it was unlike the training data."""
        return list(self._unlike)

    def contact(self, contact: ContactFrames) -> None:
        """Take a contact, judged by the median novelty of its frames."""
        known = [each for each in contact.unlikeness if math.isfinite(each)]
        if known:
            self._unlike.append(float(np.median(known)) > 1)

    @property
    def share(self) -> float:
        """Share of the last contacts. NaN before the first."""
        return sum(self._unlike) / len(self._unlike) if self._unlike else math.nan

    @property
    def at_least(self) -> float:
        """Wilson's lower bound: 0.75 if all of 20 contacts are unlike, 0 with fewer contacts."""
        count, z = len(self._unlike), self.DEVIATIONS
        if count < self.LEAST:
            return 0.0
        share = self.share
        middle = share + z * z / (2 * count)
        width = z * math.sqrt(share * (1 - share) / count + z * z / (4 * count * count))
        return max(0.0, (middle - width) / (1 + z * z / count))

    def clear(self) -> None:
        """Forget all contacts."""
        self._unlike.clear()
