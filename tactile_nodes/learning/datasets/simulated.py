"""Presses of the simulated sensor as training samples: rendered, measured, stored on disk.

A data set depends on its configuration alone. Every block of presses has its own seed and its own rest image, so
neither the number of processes nor their order changes a byte. Finished blocks are found again by the hash of
everything that they depend on.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path

import cv2
import numpy as np

from tactile_nodes import paths
from tactile_nodes.contact_tables.gel_tables import contact_table
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.learning.config import TrainConfig
from tactile_nodes.learning.datasets.labels import force_labels
from tactile_nodes.learning.datasets.plans import planned_presses, press_count
from tactile_nodes.learning.progress import Progress
from tactile_nodes.learning.tasks import Arrays, make_files
from tactile_nodes.sensing.features import FeatureEncoding, Features
from tactile_nodes.sensing.flow.choice import code_id
from tactile_nodes.sensing.flow.methods import FlowMethod
from tactile_nodes.sensing.geometry import BinGrid, centre_crop
from tactile_nodes.sensing.rest.reference import average
from tactile_nodes.shapes import Bool, Float16, Float32, Int
from tactile_nodes.simulation.optics import Optics, mix

RECIPE = 2
"""Increased when the code below gives other samples for the same configuration."""
TRUSTED_SHARE = 0.9
PRESSES_PER_BLOCK = 250
"""Number of presses rendered at a time if one rest image serves all."""


@dataclass(frozen=True)
class Dataset:
    """Samples of presses: features, place and depth of the tip, force, and confidence of the regions.

    `presses[i]` is x, y, depth (mm; negative: no contact, infinite: unknown) and force (N). `rest[i]` is the row of
    `confidence` for sample i. There is one row for each rest image or, if the flow rates every frame, for each sample.
    Samples with the same number in `hold` are images of one press held still; None: each sample is another press.
    `indenter` names the indenter of each sample as recorded ('': not recorded); None: recorded for no sample.
    """

    features: Float16[np.ndarray, 'samples rows cols channels']
    presses: Float32[np.ndarray, 'samples 4']
    rest: np.ndarray
    confidence: Float32[np.ndarray, 'rests rows cols']
    fingerprint: str
    hold: Int[np.ndarray, ' samples'] | None = field(default=None, kw_only=True)
    indenter: np.ndarray | None = field(default=None, kw_only=True)

    def labels(self, bins: BinGrid) -> Float32[np.ndarray, 'samples bins']:
        """The paper's labels: the whole force in the bin of the indentation's centre."""
        return force_labels(self.presses[:, :2], self.presses[:, 3], bins)

    @property
    def known(self) -> Bool[np.ndarray, ' samples']:
        """Whether a sample's place and force are known."""
        finite: np.ndarray = np.isfinite(self.presses[:, [0, 1, 3]]).all(axis=1)
        return finite

    def trusted(self, floor: float) -> Float32[np.ndarray, 'rows cols']:
        """1 for regions that held markers in nine of ten samples, else 0.

        A region may be lost temporarily where the tip pulls its markers apart. A region at the rim of the gel is always
        lost.
        """
        share = (self.confidence >= floor)[self.rest].mean(axis=0)
        return np.asarray(share >= TRUSTED_SHARE, np.float32)

    def take(self, rows: Int[np.ndarray, ' chosen']) -> Dataset:
        """Some of the samples, with the fingerprint of the whole data set."""
        return replace(
            self, features=self.features[rows], presses=self.presses[rows], rest=self.rest[rows],
            hold=None if self.hold is None else self.hold[rows],
            indenter=None if self.indenter is None else self.indenter[rows],
        )  # fmt: skip


@dataclass(frozen=True)
class Block:
    """Presses that are measured against one rest image, starting at number `first` of the plan."""

    config: TrainConfig
    number: int
    first: int
    presses: int
    file: Path

    @property
    def rest_number(self) -> int:
        """Blocks with the same number share their rest image."""
        return self.number if self.config.data.presses_per_rest_image else 0


def simulate(config: TrainConfig, progress: Progress) -> Dataset:
    """The data set of a configuration. Blocks made before, also by an interrupted run, are read from their files."""
    folder = paths.cache_directory('datasets', recipe_id(config))
    blocks = blocks_of(config, folder)
    render(blocks, _render_block, progress)
    return _load([block.file for block in blocks])


def recipe_id(config: TrainConfig) -> str:
    """Sixteen hexadecimal digits of a hash over everything that a block of samples depends on."""
    # The places of frames without contact in a plan depend on its number of presses. Random presses are made by block.
    whatever = ('presses', 'processes') if config.data.plan == 'random' else ('processes',)
    data = {name: value for name, value in config.data.simulated().items() if name not in whatever}
    chosen = {
        'recipe': [RECIPE, code_id()],
        'opencv': cv2.__version__,
        'data': data,
        'flow': [config.flow.name, config.make_flow().options],
        'encoding': [config.encoding.name, config.make_encoding().options],
        'gel': config.gel.gel_id,
    }
    return hashlib.sha256(json.dumps(chosen, sort_keys=True).encode()).hexdigest()[:16]


def blocks_of(config: TrainConfig, folder: Path) -> list[Block]:
    """All blocks of a plan, with their files in a folder."""
    size, total = config.data.presses_per_rest_image or PRESSES_PER_BLOCK, press_count(config.data)
    counts = [(first, min(size, total - first)) for first in range(0, total, size)]
    return [
        Block(config, number, first, count, folder / f'{number:05}-{count}.npz')
        for number, (first, count) in enumerate(counts)
    ]


def blocks_of_first(config: TrainConfig, presses: int, name: str) -> list[Block]:
    """The blocks with the first presses of a plan. Their folder has this name, beside that of the data set."""
    folder = paths.cache_directory('datasets', recipe_id(config), name)
    return [block for block in blocks_of(config, folder) if block.first < presses]


def render(
    blocks: Sequence[Block], make: Callable[[Block], Arrays], progress: Progress, title: str = 'rendering presses'
) -> None:
    """Make the files of blocks that have none yet. Raises ConfigurationError: the cluster in use cannot be used."""
    if blocks:
        jobs = [(block.file, block) for block in blocks]
        make_files(make, jobs, blocks[0].config.data.processes, progress, title, lambda block: block.presses)


def _load(files: list[Path]) -> Dataset:
    blocks = []
    for file in files:
        with np.load(file) as arrays:
            blocks.append({name: arrays[name] for name in ('features', 'presses', 'confidence')})
    names = ('features', 'presses', 'confidence')
    arrays = {name: np.concatenate([block[name] for block in blocks]) for name in names}
    arrays['rest'] = _confidence_rows([(len(block['presses']), len(block['confidence'])) for block in blocks])
    digest = hashlib.sha256()
    for array in arrays.values():
        digest.update(np.ascontiguousarray(array).data)
    return Dataset(**arrays, fingerprint=digest.hexdigest()[:16])


def _confidence_rows(sizes: list[tuple[int, int]]) -> Int[np.ndarray, ' samples']:
    """Row of confidence for each sample. `sizes` has the samples and confidences (one, or as many) of each block."""
    first = np.cumsum([0, *(confidences for _, confidences in sizes)])
    return np.concatenate([at + np.arange(n) % rests for at, (n, rests) in zip(first, sizes, strict=False)])


def _render_block(block: Block) -> Arrays:
    """The samples of one block (in a separate process)."""
    config = block.config
    table = contact_table(config.gel)
    optics = Optics(config.gel, table)
    measured = measured_by(block, optics)
    seeds = islice(noise_seeds(config.data.seed, block.number), config.data.frames_per_rest_image, None)
    features, presses, confidence = [], [], []
    planned = planned_presses(config.data, block.number, block.first, block.presses)
    if not config.gel.rim.holds(np.array([(press.x_mm, press.y_mm) for press in planned])).all():
        raise ConfigurationError('the plan has presses beside the gel; use the plan random or spread, and set reach_mm')
    for press in planned:
        encoded = measured(optics.render((press,), next(seeds)))
        features.append(encoded.values.astype(np.float16))
        confidence.append(encoded.confidence)
        presses.append((press.x_mm, press.y_mm, press.depth_mm, table.force_at(press.depth_mm)))
    return {
        'features': np.stack(features),
        'presses': np.array(presses, np.float32),
        'confidence': np.stack(confidence if _differ(confidence) else confidence[:1]),
    }


def measured_by(block: Block, optics: Optics) -> Callable[[np.ndarray], Features]:
    """Measures camera images against the rest image of a block."""
    config = block.config
    seeds = islice(noise_seeds(config.data.seed, block.rest_number), config.data.frames_per_rest_image)
    size_px = config.data.crop, config.data.crop
    return measuring(config.make_flow(), config.make_encoding(), size_px, optics, seeds)


def measuring(
    flow: FlowMethod, encoding: FeatureEncoding, size_px: tuple[int, int], optics: Optics, seeds: Iterable[int]
) -> Callable[[np.ndarray], Features]:
    """Measures the middle of camera images against an average of images at rest with these seeds."""
    rest = average([centre_crop(optics.render((), seed), *size_px) for seed in seeds])
    flow.set_reference(rest)
    encoding.set_reference(rest)
    return lambda image: encoding.encode(flow.displacement(centre_crop(image, *size_px)))


def _differ(arrays: list[np.ndarray]) -> bool:
    return any((each != arrays[0]).any() for each in arrays)


def noise_seeds(seed: int, block: int) -> Iterator[int]:
    """Seeds for a block's images: first those of its rest image, then those of its presses."""
    number = mix(seed) ^ mix(block)
    while True:
        number = mix(number)
        yield number
