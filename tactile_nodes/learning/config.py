"""One YAML file says everything about a training run; unknown keys are errors that name file and line.

::

    output: models/paper.safetensors
    data: {presses: 20000, seed: 1}
    flow: {name: dis, options: {preset: ultrafast, finest_scale: 1}}
    encoding: {name: polar_mean, options: {rows: 40, cols: 40}}
    gel: {seed: 1}
    network: {hidden: [800, 400, 400], dropout: 0.15}
    training: {batch: 200, learning_rate: 0.001}
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path

from tactile_nodes.params import Located, from_mapping, load_mapping, parameter
from tactile_nodes.sensing.features import FeatureEncoding, make_encoding
from tactile_nodes.sensing.flow import FlowMethod, make_flow
from tactile_nodes.sensing.geometry import BinGrid
from tactile_nodes.simulation.gel import Gel


@dataclass(frozen=True)
class DataConfig:
    """Which presses are simulated."""

    presses: int = parameter(20000, 'presses at random places and depths', minimum=1)
    seed: int = parameter(1, 'seed of places, depths and noise')
    reach_mm: float = parameter(14.0, 'presses lie within plus and minus this, along x and y', minimum=0.0)
    shallowest_mm: float = parameter(0.0, 'smallest depth', minimum=0.0)
    deepest_mm: float = parameter(2.1, 'largest depth', minimum=0.0, maximum=2.5)
    without_contact: float = parameter(0.05, 'share of frames in which nothing touches', minimum=0.0, maximum=1.0)
    presses_per_rest_image: int = parameter(250, 'presses measured against one rest image', minimum=1)
    frames_per_rest_image: int = parameter(16, 'frames averaged into a rest image', minimum=1)
    processes: int = parameter(2, 'processes that render at the same time', minimum=1)
    crop: int = parameter(440, 'side of the square cut from the middle of the image, px', minimum=32)
    file: str = parameter('', 'a data set of recorded presses, instead of simulated ones; see tactile dataset build')
    split: str = parameter('sample', 'what is put aside of a file for the test', choices=('sample', 'position'))
    split_seed: int = parameter(1, 'seed of what is put aside')
    test: float = parameter(0.2, 'share of a file that is put aside for the test', minimum=0.01, maximum=0.9)

    def simulated(self) -> dict[str, object]:
        """What simulated presses depend on, and how many there are."""
        of_files = ('file', 'split', 'split_seed', 'test')
        return {name: value for name, value in asdict(self).items() if name not in of_files}


@dataclass(frozen=True)
class NetworkConfig:
    """Layers between features and bins, and how features enter."""

    hidden: tuple[int, ...] = parameter((800, 400, 400), 'units of the hidden layers')
    dropout: float = parameter(0.15, 'share of hidden units left out in training', minimum=0.0, maximum=0.9)
    confidence_floor: float = parameter(0.5, 'regions less certain than this are silenced', minimum=0.0, maximum=1.0)
    channel_gains: tuple[float, ...] = parameter((), 'factor on each channel once it is standardised; none means 1')
    rows: int = parameter(9, 'bins along y', minimum=1)
    cols: int = parameter(9, 'bins along x', minimum=1)


@dataclass(frozen=True)
class TrainingConfig:
    """The optimiser, and when it stops."""

    batch: int = parameter(200, 'samples per step', minimum=1)
    learning_rate: float = parameter(0.001, "Nadam's step size", minimum=0.0)
    loss: str = parameter('armse', 'what is minimised after the warm-up', choices=('armse', 'mse'))
    warm_up_epochs: int = parameter(10, 'epochs with squared error before the loss', minimum=0)
    decay: float = parameter(1.0, 'factor on the step size per epoch', minimum=0.5, maximum=1.0)
    rest_repeats: int = parameter(1, 'how often an epoch shows each frame without contact', minimum=1)
    epochs: int = parameter(1000, 'most epochs', minimum=1)
    patience: int = parameter(50, 'epochs without a better validation loss before stopping', minimum=1)
    validation: float = parameter(0.1, 'share of the presses held back for validation', minimum=0.01, maximum=0.5)
    seed: int = parameter(1, 'seed of initial weights, order and dropout')
    threads: int = parameter(2, 'processor threads; the result depends on it in the last digits', minimum=1)


@dataclass(frozen=True)
class _Blocks:
    output: str = parameter('model.safetensors', 'the file to write')
    data: DataConfig = field(default_factory=DataConfig)
    network: NetworkConfig = field(default_factory=NetworkConfig)
    training: TrainingConfig = field(default_factory=TrainingConfig)


@dataclass(frozen=True)
class Choice:
    """A method by name, with options of its own."""

    name: str
    options: Mapping[str, object] = field(default_factory=dict)


@dataclass(frozen=True)
class TrainConfig:
    """A training run."""

    output: Path = Path('model.safetensors')
    data: DataConfig = field(default_factory=DataConfig)
    flow: Choice = field(default_factory=lambda: Choice('dis'))
    encoding: Choice = field(default_factory=lambda: Choice('polar_mean'))
    gel: Gel = field(default_factory=Gel)
    network: NetworkConfig = field(default_factory=NetworkConfig)
    training: TrainingConfig = field(default_factory=TrainingConfig)
    recorded_bins: BinGrid | None = None
    stated: frozenset[str] = frozenset()
    """Dotted names that the run's file gives itself; what it leaves open, a file of recorded presses may decide."""

    @property
    def bins(self) -> BinGrid:
        if self.recorded_bins is not None:
            return self.recorded_bins
        return BinGrid(self.network.rows, self.network.cols, self.gel.size_mm, self.gel.size_mm)

    def make_flow(self) -> FlowMethod:
        return make_flow(self.flow.name, self.flow.options)

    def make_encoding(self) -> FeatureEncoding:
        return make_encoding(self.encoding.name, self.encoding.options)


def load_train_config(path: Path | str) -> TrainConfig:
    """Read a run's YAML file.

    Raises:
        ConfigurationError: it is missing, no YAML, or has an unknown key or a value of the wrong type.
    """
    written = load_mapping(path)
    blocks = from_mapping(
        _Blocks,
        {name: value for name, value in written.items() if name.split('.')[0] not in ('flow', 'encoding', 'gel')},
        source=str(path),
        exact=False,
    )
    return TrainConfig(
        output=Path(blocks.output),
        data=blocks.data,
        flow=_choice('flow', 'dis', written, str(path)),
        encoding=_choice('encoding', 'polar_mean', written, str(path)),
        gel=Gel.from_mapping(_under('gel', written), str(path)),
        network=blocks.network,
        training=blocks.training,
        stated=frozenset(written),
    )


@dataclass(frozen=True)
class _Named:
    name: str = parameter('')


def _choice(block: str, default: str, written: Mapping[str, Located], source: str) -> Choice:
    options = _under(f'{block}.options', written)
    rest = {
        name.removeprefix(f'{block}.'): value
        for name, value in written.items()
        if name.startswith(f'{block}.') and not name.startswith(f'{block}.options.')
    }
    return Choice(from_mapping(_Named, rest, source=source).name or default, options)


def _under(prefix: str, written: Mapping[str, Located]) -> dict[str, object]:
    return {
        name.removeprefix(f'{prefix}.'): located.value
        for name, located in written.items()
        if name.startswith(f'{prefix}.')
    }
