"""Recorded presses as arrays: the content of a data set file, its split, and its form for training."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any

import numpy as np

from tactile_nodes.errors import DatasetError
from tactile_nodes.learning.datasets.simulated import Dataset
from tactile_nodes.learning.datasets.split import TEST_SHARE, VALIDATION_SHARE, Split, by_position, by_sample
from tactile_nodes.sensing.geometry import BinGrid
from tactile_nodes.shapes import Float, Float16, Float32, Int, UInt8

CIRCUMSTANCES = ('command', 'made_with', 'bag_names')
"""Entries of the card that describe how the file was made, and do not change its content."""

REST_IMAGE = 'rest_image'
OPTIONAL = (REST_IMAGE,)
"""Arrays that not every data set has."""

RETRIED, NEAR_BORDER, DEPTH_UNREPORTED, UNEVEN_FRAMES = 1, 2, 4, 8
QUALITY = {
    RETRIED: 'not the first attempt',
    NEAR_BORDER: 'the tip touches several bins',
    DEPTH_UNREPORTED: 'the machine did not say how deep it was',
    UNEVEN_FRAMES: 'a gap between the images of the window',
}


@dataclass(frozen=True)
class RecordedPresses:
    """Samples of recorded presses. A sample without contact has the place of the next press.

    Lengths are in mm and places in the surface frame, forces in N (positive into the gel), torques in N m. Wrenches are
    as measured (pressing is negative z). Unknown depths are NaN. `confidence[confidence_row[i]]` belongs to sample i,
    `card['bags'][bag[i]]` is the bag that it came from; plan and indenter are indexed in the same way. `rest_image` is
    the last rest image used as reference, as cropped; older files have none, and give an image without rows.
    """

    features: Float16[np.ndarray, 'samples rows cols channels']
    labels: Float32[np.ndarray, 'samples bins']
    confidence: Float32[np.ndarray, 'kinds rows cols']
    confidence_row: Int[np.ndarray, ' samples']
    contact: np.ndarray
    position_mm: Float[np.ndarray, 'samples 2']
    depth_mm: Float[np.ndarray, ' samples']
    depth_reported_mm: Float[np.ndarray, ' samples']
    force_n: Float[np.ndarray, ' samples']
    force_rate_n_per_s: Float[np.ndarray, ' samples']
    wrench: Float[np.ndarray, 'samples 6']
    wrench_deviation: Float[np.ndarray, 'samples 6']
    stamp_ns: Int[np.ndarray, ' samples']
    window_ns: Int[np.ndarray, 'samples 2']
    frames: Int[np.ndarray, ' samples']
    bag: Int[np.ndarray, ' samples']
    plan: Int[np.ndarray, ' samples']
    press: Int[np.ndarray, ' samples']
    attempt: Int[np.ndarray, ' samples']
    indenter: Int[np.ndarray, ' samples']
    quality: Int[np.ndarray, ' samples']
    reference_id: np.ndarray
    tare_id: np.ndarray
    card: Mapping[str, Any]
    rest_image: UInt8[np.ndarray, 'h w'] = field(default_factory=lambda: np.zeros((0, 0), np.uint8))

    def __len__(self) -> int:
        return len(self.force_n)

    @property
    def bins(self) -> BinGrid:
        return BinGrid.of_card(self.card['labels'])

    @cached_property
    def fingerprint(self) -> str:
        """Sixteen hexadecimal digits that change with any value or meaning in the file."""
        return fingerprint_of(self.arrays(), self.card)

    def arrays(self) -> dict[str, np.ndarray]:
        """All arrays by name; optional ones only if present."""
        names = (*array_names(), *(name for name in OPTIONAL if getattr(self, name).size))
        return {name: np.ascontiguousarray(getattr(self, name)) for name in names}

    @property
    def pictures(self) -> list[str]:
        """Ids of the images of presses that came from tables; bags have none."""
        return [each for bag in self.card['bags'] for each in bag.get('pictures', ())]

    @property
    def press_number(self) -> Int[np.ndarray, ' samples']:
        """A number for each press, the same for all its samples."""
        keys = np.stack([self.bag, self.plan, self.press], axis=1)
        numbers: np.ndarray = np.unique(keys, axis=0, return_inverse=True)[1]
        return numbers.reshape(-1)

    @property
    def hold_number(self) -> Int[np.ndarray, ' samples']:
        """A number for each window of a press measured against one rest image, the same for all its images."""
        rests = np.unique(self.reference_id, return_inverse=True)[1]
        keys = np.column_stack([self.press_number, self.attempt, self.window_ns, self.contact, rests.reshape(-1)])
        numbers: np.ndarray = np.unique(keys, axis=0, return_inverse=True)[1]
        return numbers.reshape(-1)

    def of_indenter(self, name: str) -> RecordedPresses:
        """The presses of one indenter and all samples without contact. No name is needed if there is only one.

        Raises:
            DatasetError: there is no such indenter, or there are several and none is named.
        """
        known = self.card['indenters']
        listed = ', '.join(each or 'one without a name' for each in known)
        if not name and len(known) > 1:
            raise DatasetError(f'the data set holds presses of {listed}, but one must be chosen: use --indenter')
        if name and name not in known:
            raise DatasetError(f'no press of the data set was made with {name!r}; it holds presses of {listed}')
        if len(known) == 1:
            return self
        rows = np.flatnonzero(~self.contact | (self.indenter == known.index(name)))
        chosen: dict[str, Any] = {
            each: values[rows] for each, values in self.arrays().items() if each not in ('confidence', *OPTIONAL)
        }
        return replace(self, **chosen)

    def split(self, kind: str, seed: int, *, test: float = TEST_SHARE, validation: float = VALIDATION_SHARE) -> Split:
        """Training, validation and test set; `kind` is 'sample' or 'position'.

        Raises:
            DatasetError: too few presses.
        """
        if kind == 'position':
            return by_position(self.position_mm, seed=seed, test=test, validation=validation)
        depth = np.where(np.isnan(self.depth_mm), self.force_n, self.depth_mm)  # so that each force has its share
        return by_sample(self.press_number, depth, seed=seed, test=test, validation=validation)

    def as_samples(self, chosen: Int[np.ndarray, ' chosen'] | None = None) -> Dataset:
        """The samples, or some of them, in the form that training and evaluation use."""
        rows = np.arange(len(self)) if chosen is None else chosen
        depth = np.where(self.contact, np.nan_to_num(self.depth_mm, nan=np.inf), -1.0)
        presses = np.column_stack([self.position_mm, depth, self.force_n])[rows]
        return Dataset(
            self.features[rows], presses.astype(np.float32), self.confidence_row[rows], self.confidence,
            self.fingerprint, hold=self.hold_number[rows],
            indenter=np.array(self.card['indenters'])[self.indenter[rows]],
        )  # fmt: skip


def array_names() -> tuple[str, ...]:
    """The names of the arrays that every data set has."""
    return tuple(each.name for each in fields(RecordedPresses) if each.name not in ('card', *OPTIONAL))


def fingerprint_of(arrays: Mapping[str, np.ndarray], card: Mapping[str, Any]) -> str:
    """Sixteen hexadecimal digits over arrays and card."""
    digest = hashlib.sha256()
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        digest.update(f'{name} {array.dtype.str} {array.shape}'.encode())
        digest.update(array.tobytes() if array.dtype.kind == 'U' else array.data)
    meaning = {name: value for name, value in card.items() if name not in CIRCUMSTANCES}
    digest.update(json.dumps(meaning, sort_keys=True).encode())
    return digest.hexdigest()[:16]
