"""Inputs that no model was made for, to see what it says of them.

Each disturbance is rendered anew: another gel from the start, or the model's own gel whose rest image was taken in
order, and then the camera was knocked, the light failed, the lens was covered or another body pressed.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tactile_nodes import paths
from tactile_nodes.contact_tables.gel_tables import contact_table, load_gel
from tactile_nodes.learning.config import TrainConfig
from tactile_nodes.learning.datasets.plans import random_presses
from tactile_nodes.learning.datasets.simulated import Dataset, recipe_id
from tactile_nodes.learning.progress import Progress
from tactile_nodes.learning.tasks import Arrays, make_files
from tactile_nodes.sensing.geometry import centre_crop
from tactile_nodes.sensing.rest.reference import average
from tactile_nodes.simulation.disturbances import dimmed, knocked, other_markers
from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.indenter import INDENTERS
from tactile_nodes.simulation.mechanics import ContactTable
from tactile_nodes.simulation.optics import Optics, Press, mix

RECIPE = 2
"""Raised when the code below gives other samples for the same configuration."""

COVERED_GREY = 3
"""What a camera sees where something lies on the lens: its own noise."""


@dataclass(frozen=True)
class Disturbance:
    """One way in which the world differs from the training's.

    `gel` is another gel altogether. What changes after the rest image: `knock_px` is how far the middle of the image
    moves (the camera tilts), `light` a factor on it, `covered` the share of the image, from its left, that turns
    dark. Another `indenter` presses with the forces with which the tip would.
    """

    name: str
    gel: Callable[[Gel], Gel] | None = None
    knock_px: float = 0.0
    light: float = 1.0
    covered: float = 0.0
    indenter: str = 'tip'

    def gel_before(self, gel: Gel) -> Gel:
        return gel if self.gel is None else self.gel(gel)

    def gel_after(self, gel: Gel) -> Gel:
        """The gel as the camera sees it once the rest image has been taken."""
        return dimmed(knocked(self.gel_before(gel), self.knock_px), self.light)


def _stiff(_: Gel) -> Gel:
    return load_gel('stiff')


def _thin(_: Gel) -> Gel:
    return load_gel('thin')


UNDISTURBED = Disturbance('as trained')
DISTURBANCES = (
    UNDISTURBED,
    Disturbance('the same gel, other markers', gel=other_markers),
    Disturbance('another gel, half as hard again', gel=_stiff),
    Disturbance('another gel, 4 mm thin', gel=_thin),
    Disturbance('camera knocked by 0.3 px', knock_px=0.3),
    Disturbance('camera knocked by 1 px', knock_px=1.0),
    Disturbance('camera knocked by 3 px', knock_px=3.0),
    Disturbance('lens covered by a tenth', covered=0.1),
    Disturbance('lens covered by a quarter', covered=0.25),
    Disturbance('light dimmer by 30 %', light=0.7),
    Disturbance('ball of 6 mm instead of the tip', indenter='ball'),
    Disturbance('flat punch of 3 mm instead of the tip', indenter='punch'),
)


def possible(config: TrainConfig) -> tuple[Disturbance, ...]:
    """The disturbances that can be simulated: a linear gel knows no other indenter than its tip."""
    linear = config.gel.mechanics == 'linear'
    return tuple(each for each in DISTURBANCES if not (linear and each.indenter != 'tip'))


def disturbed_samples(config: TrainConfig, progress: Progress) -> dict[str, Dataset]:
    """Samples of every disturbance, by name; the presses are the same for all. What was made before is read."""
    disturbances = possible(config)
    folder = paths.cache_directory() / 'datasets' / 'unlike'
    folder.mkdir(parents=True, exist_ok=True)
    files = {each.name: folder / f'{_key(config, each)}.npz' for each in disturbances}
    jobs = [(files[each.name], (config, each)) for each in disturbances]
    make_files(_render, jobs, config.data.processes, progress, 'rendering novel inputs')
    return {name: _load(file) for name, file in files.items()}


def _key(config: TrainConfig, disturbance: Disturbance) -> str:
    gels = disturbance.gel_before(config.gel).gel_id, disturbance.gel_after(config.gel).gel_id
    what = [RECIPE, recipe_id(config), config.data.presses, *gels, disturbance.covered, disturbance.indenter]
    return hashlib.sha256(json.dumps(what).encode()).hexdigest()[:16]


def _render(job: tuple[TrainConfig, Disturbance]) -> Arrays:
    """The samples of one disturbance (in a process of its own)."""
    config, disturbance = job
    before, after = disturbance.gel_before(config.gel), disturbance.gel_after(config.gel)
    tip = contact_table(before)
    others = {name: contact_table(before, name) for name in INDENTERS if name == disturbance.indenter}
    flow, encoding = config.make_flow(), config.make_encoding()
    first, size = mix(config.data.seed), config.data.crop
    plain = Optics(before, tip)
    frames = [plain.render((), first + number) for number in range(config.data.frames_per_rest_image)]
    rest = average([centre_crop(image, size, size) for image in frames])
    flow.set_reference(rest)
    encoding.set_reference(rest)
    optics = Optics(after, tip, others)
    features, presses, confidence = [], [], []
    for number, planned in enumerate(random_presses(config.data, 0, config.data.presses)):
        force_n = tip.force_at(planned.depth_mm)
        press = _pressed(planned, disturbance.indenter, others, force_n)
        image = centre_crop(optics.render((press,), first + len(frames) + number), size, size)
        encoded = encoding.encode(flow.displacement(_covered(image, disturbance.covered)))
        features.append(encoded.values.astype(np.float16))
        confidence.append(encoded.confidence)
        presses.append((press.x_mm, press.y_mm, press.depth_mm, force_n))
    # A flow may judge every frame, so that each has a confidence of its own: a covered lens shows there.
    return {
        'features': np.stack(features),
        'presses': np.array(presses, np.float32),
        'confidence': np.stack(confidence),
    }


def _pressed(planned: Press, indenter: str, others: dict[str, ContactTable], force_n: float) -> Press:
    """The press as planned, or by another indenter as deep as the same force takes."""
    if indenter not in others or planned.depth_mm <= 0:
        return planned
    return dataclasses.replace(planned, indenter=indenter, depth_mm=others[indenter].depth_at(force_n))


def _covered(image: np.ndarray, part: float) -> np.ndarray:
    """The image with its left part dark; noise does not matter where nothing is seen."""
    if part == 0:
        return image
    covered: np.ndarray = image.copy()
    covered[:, : round(part * image.shape[1])] = COVERED_GREY
    return covered


def _load(file: Path) -> Dataset:
    with np.load(file, allow_pickle=False) as arrays:
        features, presses, confidence = (arrays[name] for name in ('features', 'presses', 'confidence'))
    return Dataset(features, presses, np.arange(len(presses)), confidence, file.stem)
