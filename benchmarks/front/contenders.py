"""The contenders in the chart of speed against accuracy: flow methods, grids, and readouts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np

from benchmarks.front.flows import (
    DenseFlow,
    OtherFlow,
    PhaseCorrelation,
    PyramidalLk,
    SmallPixels,
    farneback,
    tv_l1,
)  # fmt: skip
from tactile_nodes.learning.config import Choice, NetworkConfig, ResponseConfig, TrainConfig, TrainingConfig
from tactile_nodes.sensing.features import FeatureEncoding, Features, make_encoding
from tactile_nodes.sensing.flow.choice import make_flow
from tactile_nodes.sensing.flow.methods import FlowMethod

OURS = 'inverse_compositional'
GRIDS = (10, 20, 40)


@dataclass(frozen=True)
class Way:
    """One method to measure an image: a flow, made for a grid (0: for all grids), or no flow at all."""

    name: str
    make: Callable[[int], FlowMethod | SmallPixels]
    grids: Sequence[int] = GRIDS
    by_grid: bool = False
    encodings: Sequence[str] = ('cartesian_mean',)
    slow: bool = False


def _dis(**options: object) -> Callable[[int], FlowMethod]:
    return lambda _: make_flow('dis', options)


def _ours(scale: int) -> Callable[[int], FlowMethod]:
    return lambda regions: make_flow(OURS, {'rows': regions, 'cols': regions, 'finest_scale': scale})


WAYS = (
    Way('DIS ultrafast, scale 2', _dis(preset='ultrafast', finest_scale=2)),
    Way('DIS ultrafast, scale 1', _dis(preset='ultrafast', finest_scale=1)),
    Way('DIS ultrafast, halved', lambda _: OtherFlow(make_flow('dis', {'finest_scale': 0}))),
    Way('DIS fast, scale 1', _dis(preset='fast', finest_scale=1)),
    Way('DIS medium, scale 1', _dis(preset='medium', finest_scale=1), encodings=('cartesian_mean', 'polar_mean')),
    Way('DIS medium, scale 0', _dis(preset='medium', finest_scale=0)),
    Way('DIS medium, halved', lambda _: OtherFlow(make_flow('dis', {'preset': 'medium', 'finest_scale': 0}))),
    Way('Farneback', lambda _: DenseFlow('farneback', farneback)),
    Way('Farneback, halved', lambda _: DenseFlow('farneback', farneback, 1)),
    Way('TV-L1, halved', lambda _: DenseFlow('tv_l1', tv_l1, 1), slow=True),
    Way('TV-L1, quartered', lambda _: DenseFlow('tv_l1', tv_l1, 2), slow=True),
    Way('pyramidal LK', lambda regions: PyramidalLk(regions, 1.2, 11), by_grid=True),
    Way('phase correlation', lambda regions: PhaseCorrelation(regions, 1.2, 32), (10, 20), by_grid=True),
    Way('small pixels', SmallPixels, (20, 40), by_grid=True),
    Way('ours, full size', _ours(0), by_grid=True),
    Way('ours, half size', _ours(1), by_grid=True),
    Way('ours, quarter size', _ours(2), (10, 20), by_grid=True),
)
AXISYMMETRIC = (('ours, full size', 20), ('DIS ultrafast, scale 1', 20))
"""Methods and grids that are also tested with the readout `axisymmetric`: those of `portable`, and with the flow of
`paper`."""


@dataclass(frozen=True)
class Contender:
    """A method on a grid, with an encoding and a readout."""

    way: str
    regions: int
    encoding: str
    readout: str = 'response'

    @property
    def name(self) -> str:
        """Its name in tables."""
        polar = ', polar' if self.encoding == 'polar_mean' else ''
        readout = '' if self.readout == 'response' else f', {self.readout}'
        return f'{self.way}, {self.regions}x{self.regions}{polar}{readout}'

    def config(self) -> TrainConfig:
        """The configuration for its readout: a response as in the profiles, or a smaller network than the paper's."""
        fine = self.regions > 10
        return TrainConfig(
            readout=self.readout,
            encoding=Choice(self.encoding, {'rows': self.regions, 'cols': self.regions}),
            response=ResponseConfig(components=64 if fine else 40, spacing_mm=1.75 if fine else 2.0),
            network=NetworkConfig(hidden=(400, 200, 200), activation='relu', dropout=0.05),
            training=TrainingConfig(loss='mse', epochs=150, patience=20, threads=1, device='cpu', batch=50),
        )


def contenders(ways: Sequence[Way], networks: bool) -> list[Contender]:
    """All contenders of some methods, by grid and encoding; other readouts than `response` for a few features only."""
    made = [
        Contender(way.name, regions, encoding)
        for way in ways for regions in way.grids for encoding in way.encodings
        if encoding == 'cartesian_mean'  # the response needs additive motion; magnitude and angle are not additive
    ]  # fmt: skip
    names = {way.name for way in ways}
    made += [Contender(*each, 'cartesian_mean', 'axisymmetric') for each in AXISYMMETRIC if each[0] in names]
    if networks:
        asked = [('DIS medium, scale 1', 40, 'polar_mean'), ('DIS medium, scale 1', 40, 'cartesian_mean')]
        asked += [('ours, half size', regions, 'cartesian_mean') for regions in (10, 20)]
        made += [Contender(*each, 'network') for each in asked if each[0] in names]
    return made


@dataclass
class Measuring:
    """A method with its rest image: one flow for all grids if it is dense, otherwise one flow per grid."""

    way: Way
    wanted: Sequence[tuple[int, str]]
    _flows: dict[int, FlowMethod | SmallPixels] = field(default_factory=dict)
    _encodings: dict[tuple[int, str], FeatureEncoding] = field(default_factory=dict)

    def __post_init__(self) -> None:
        grids = sorted({regions for regions, _ in self.wanted})
        self._flows = {regions: self.way.make(regions) for regions in (grids if self.way.by_grid else [0])}
        self._encodings = {each: make_encoding(each[1], {'rows': each[0], 'cols': each[0]}) for each in self.wanted}

    def set_reference(self, image: np.ndarray) -> None:
        """Set the rest image, and compute everything that does not depend on a frame."""
        for each in (*self._flows.values(), *self._encodings.values()):
            each.set_reference(image)

    def flows(self) -> list[tuple[int, Callable[[np.ndarray], object]]]:
        """The functions that measure an image, by grid (0: once for all grids)."""
        return [
            (regions, each if isinstance(each, SmallPixels) else each.displacement)
            for regions, each in self._flows.items()
        ]

    def encode(self, regions: int, encoding: str, measured: object) -> Features:
        """Features on a grid, from the measurement for that grid."""
        if isinstance(measured, Features):
            return measured
        return self._encodings[regions, encoding].encode(measured)  # type: ignore[arg-type]


def one_thread() -> None:
    """Set OpenCV to one thread."""
    cv2.setNumThreads(1)
