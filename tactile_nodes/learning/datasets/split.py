"""Splits presses into a training set, a validation set that stops training, and a test set.

`by_sample` is the paper's split: a fifth of the presses is set aside, so a position of the test set occurs in training
at other depths. `by_position` sets whole positions aside, so no position of the test was seen at any depth.

A split depends on the presses and its seed alone. All samples of one press are in the same set.
"""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass

import numpy as np

from tactile_nodes.errors import TooFewPressesError
from tactile_nodes.shapes import Float, Int

TEST_SHARE = 0.2
VALIDATION_SHARE = 0.1
KINDS = ('sample', 'position')
MOST_DEPTHS = 16
"""A plan with more different depths than this is treated as one of random depths."""


@dataclass(frozen=True)
class Split:
    """Indices of samples, each in rising order. Every sample is in exactly one of the three sets."""

    train: Int[np.ndarray, ' train']
    validation: Int[np.ndarray, ' validation']
    test: Int[np.ndarray, ' test']

    @property
    def split_id(self) -> str:
        """Twelve hexadecimal digits over the three lists."""
        digest = hashlib.sha256()
        for part in (self.train, self.validation, self.test):
            digest.update(len(part).to_bytes(8, 'little') + part.astype('<i8').tobytes())
        return digest.hexdigest()[:12]


def by_sample(
    press: Int[np.ndarray, ' samples'],
    depth_mm: Float[np.ndarray, ' samples'],
    *,
    seed: int,
    test: float = TEST_SHARE,
    validation: float = VALIDATION_SHARE,
) -> Split:
    """The paper's split over presses, stratified by depth.

    Of 10952 presses 2191 (a fifth, rounded up) are the test set, and nine tenths of the others, rounded down, train:
    7884, the number that the paper gives. Samples with the same number in `press` stay together.

    Raises:
        TooFewPressesError: too few presses for three parts.
    """
    _, first, member = np.unique(press, return_index=True, return_inverse=True)
    deepest = np.asarray(depth_mm, np.float64)[first]
    np.maximum.at(deepest, member, depth_mm)  # the depth of the press, not of the frames before it
    return _split(member, depth_strata(deepest), seed, test, validation)


def by_position(
    position_mm: Float[np.ndarray, 'samples 2'],
    *,
    seed: int,
    test: float = TEST_SHARE,
    validation: float = VALIDATION_SHARE,
) -> Split:
    """A split of positions: no position of the test set occurs in training or validation, at any depth.

    Of the paper's 1369 positions 274 are the test set (2192 presses), 985 train.

    Raises:
        TooFewPressesError: too few positions for three parts.
    """
    member = position_ids(position_mm)
    return _split(member, np.zeros(int(member.max(initial=-1)) + 1, np.int64), seed, test, validation)


def position_ids(position_mm: Float[np.ndarray, 'samples 2']) -> Int[np.ndarray, ' samples']:
    """A number for each position. Positions within half a micrometre count as one."""
    micrometres = np.round(np.asarray(position_mm, np.float64) * 1e3).astype(np.int64)
    numbers: np.ndarray = np.unique(micrometres, axis=0, return_inverse=True)[1]
    return numbers.reshape(-1)


def depth_strata(depth_mm: Float[np.ndarray, ' presses']) -> Int[np.ndarray, ' presses']:
    """A number for each depth of a plan; for random depths, a number for each eighth of the presses."""
    depths, strata = np.unique(np.round(depth_mm, 3), return_inverse=True)
    if len(depths) > MOST_DEPTHS:
        strata = np.argsort(np.argsort(depth_mm, kind='stable'), kind='stable') * 8 // len(depth_mm)
    return strata.reshape(-1)


def _split(
    member: Int[np.ndarray, ' samples'], stratum: Int[np.ndarray, ' groups'], seed: int, test: float, validation: float
) -> Split:
    groups = len(stratum)
    tested = math.ceil(groups * test - 1e-9)
    trained = math.floor((groups - tested) * (1 - validation) + 1e-9)
    if min(tested, trained, groups - tested - trained) < 1:
        raise TooFewPressesError(
            f'{groups} presses or positions are too few for a test share of {test:g} and a validation share of '
            f'{validation:g}; record more (if simulated: --presses)'
        )
    random = np.random.default_rng(seed)
    side = np.zeros(groups, np.int64)
    side[_draw(np.arange(groups), stratum, tested, random)] = 2
    left = np.flatnonzero(side == 0)
    side[_draw(left, stratum[left], len(left) - trained, random)] = 1
    train, held_out, put_aside = (np.flatnonzero(side[member] == part) for part in range(3))
    return Split(train, held_out, put_aside)


def _draw(candidates: np.ndarray, stratum: np.ndarray, count: int, random: np.random.Generator) -> np.ndarray:
    """`count` of the candidates, in proportion from each stratum."""
    names, sizes = np.unique(stratum, return_counts=True)
    drawn = [
        random.permutation(candidates[stratum == name])[:share]
        for name, share in zip(names, apportioned(sizes, count), strict=True)
    ]
    return np.concatenate(drawn)


def apportioned(sizes: Int[np.ndarray, ' parts'], count: int) -> Int[np.ndarray, ' parts']:
    """`count` seats in proportion to sizes, by largest remainder: 10 seats for (5, 3, 3) are (4, 3, 3)."""
    exact = sizes * (count / sizes.sum())
    seats: np.ndarray = np.floor(exact + 1e-9).astype(np.int64)
    order = np.argsort(seats - exact, kind='stable')
    seats[order[: count - int(seats.sum())]] += 1
    return seats
