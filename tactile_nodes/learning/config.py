"""The YAML file that describes a whole training run. Unknown keys are errors that name file and line.

::

    output: models/paper.safetensors
    data: {presses: 20000, seed: 1}
    flow: {name: dis, options: {preset: ultrafast, finest_scale: 1}}
    encoding: {name: polar_mean, options: {rows: 40, cols: 40}}
    gel: {seed: 1}
    readout: network
    network: {hidden: [800, 400, 400], dropout: 0.15}
    training: {batch: 200, learning_rate: 0.001}

`resolved` returns the whole run as such a mapping, with every default filled in.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from tactile_nodes.params import Located, from_mapping, load_mapping, parameter
from tactile_nodes.paths import described_in
from tactile_nodes.sensing.features import FeatureEncoding, make_encoding
from tactile_nodes.sensing.flow.choice import make_flow
from tactile_nodes.sensing.flow.methods import FlowMethod
from tactile_nodes.sensing.geometry import BinGrid
from tactile_nodes.simulation.gel import Gel


@dataclass(frozen=True)
class DataConfig:
    """Which presses are simulated, or the file of recorded presses, and which of them are set aside.

    The plan `random` has presses anywhere, and none is set aside: the test uses other random presses. The plan `paper`
    is the paper's grid (37 x 37 places 0.75 mm apart, eight depths from 0.25 to 2 mm: 10952 presses). `jittered` moves
    each of those presses at random within its cell and its step of depth. `coarse` has every fourth place along x and
    along y: 800 presses. `spread` has presses at random depths, each placed as far as possible from those before it, as
    in a calibration. The presses of all plans but `random` are split as recorded presses are.
    """

    plan: str = parameter('random', 'kind of plan', choices=('random', 'paper', 'jittered', 'coarse', 'spread'))
    presses: int = parameter(20000, 'presses of a random plan; most presses of another', minimum=1)
    seed: int = parameter(1, 'seed of places, depths and noise', minimum=0)
    reach_mm: float = parameter(14.0, 'random presses lie within plus and minus this along x and y', minimum=0.0)
    shallowest_mm: float = parameter(0.0, 'smallest depth of a random press', minimum=0.0)
    deepest_mm: float = parameter(2.1, 'largest depth of a random press', minimum=0.0, maximum=2.5)
    without_contact: float = parameter(0.05, 'share of frames in which nothing touches', minimum=0.0, maximum=0.9)
    presses_per_rest_image: int = parameter(250, 'frames measured against one rest image; 0: all of them', minimum=0)
    frames_per_rest_image: int = parameter(16, 'frames averaged into a rest image', minimum=1)
    processes: int = parameter(2, 'processes that render at the same time', minimum=1)
    crop: int = parameter(440, 'side of the square cut from the middle of the image, px', minimum=32)
    file: str = parameter('', 'data set of recorded presses, instead of simulated ones; see tactile dataset build')
    split: str = parameter('sample', 'how the test set is split off', choices=('sample', 'position'))
    split_seed: int = parameter(1, 'seed of the split', minimum=0)
    test: float = parameter(0.2, 'share of the test set', minimum=0.01, maximum=0.9)

    def simulated(self) -> dict[str, object]:
        """The settings that determine simulated presses, and the number of presses."""
        of_splits = ('file', 'split', 'split_seed', 'test')
        return {name: value for name, value in asdict(self).items() if name not in of_splits}


INPUT_SCALINGS = 'features as they are, or minus mean and over spread, of each channel or of each feature'
INITIAL_WEIGHTS = "Glorot's, or four times those with biases that balance each logistic unit"
OUTPUT_UNITS = 'unit of the outputs: 1 N, or the root mean square of all labels'


@dataclass(frozen=True)
class NetworkConfig:
    """Layers between features and bins, how features enter the network, and the unit of its forces."""

    hidden: tuple[int, ...] = parameter((800, 400, 400), 'units of the hidden layers')
    activation: str = parameter('logistic', 'activation of the hidden units', choices=('logistic', 'relu'))
    dropout: float = parameter(0.15, 'share of hidden units left out in training', minimum=0.0, maximum=0.9)
    input_scaling: str = parameter('feature', INPUT_SCALINGS, choices=('none', 'channel', 'feature'))
    confidence_floor: float = parameter(0.5, 'regions of lower confidence are set to zero', minimum=0.0, maximum=1.0)
    channel_gains: tuple[float, ...] = parameter((), 'factor on each channel after scaling; empty: 1')
    initial_weights: str = parameter('balanced', INITIAL_WEIGHTS, choices=('glorot', 'balanced'))
    output_unit: str = parameter('rms', OUTPUT_UNITS, choices=('newton', 'rms'))
    rows: int = parameter(9, 'bins along y', minimum=1)
    cols: int = parameter(9, 'bins along x', minimum=1)


@dataclass(frozen=True)
class TrainingConfig:
    """The optimiser and the stopping rule."""

    batch: int = parameter(200, 'samples per step', minimum=1)
    learning_rate: float = parameter(0.001, "Nadam's step size", minimum=0.0)
    loss: str = parameter('armse', 'loss after the warm-up', choices=('armse', 'mse'))
    warm_up_epochs: int = parameter(10, 'epochs with squared error before that loss', minimum=0)
    decay: float = parameter(1.0, 'factor on the step size per epoch', minimum=0.5, maximum=1.0)
    rest_repeats: int = parameter(1, 'how often an epoch shows each frame without contact; 0: never', minimum=0)
    epochs: int = parameter(1000, 'most epochs', minimum=1)
    patience: int = parameter(50, 'epochs without a better validation loss before stopping', minimum=1)
    validation: float = parameter(0.1, 'share of the presses held back for validation', minimum=0.01, maximum=0.5)
    plateau: str = parameter('restart', 'what to do if the network only predicts zero', choices=('restart', 'wait'))
    plateau_epochs: int = parameter(40, 'epochs on the all-zero answer before a restart', minimum=1)
    seed: int = parameter(1, 'seed of initial weights, order and dropout', minimum=0)
    threads: int = parameter(2, 'processor threads; the result depends on it in the last digits', minimum=1)
    device: str = parameter('auto', 'where to train; auto: CUDA when there is one', choices=('auto', 'cpu', 'cuda'))
    checkpoint_s: float = parameter(20.0, 'seconds between checkpoints', minimum=0.0)


@dataclass(frozen=True)
class TipsConfig:
    """Which regions count, and how many tips explain a frame."""

    trusted_floor: float = parameter(
        0.5, 'regions below this confidence in most frames are not used', minimum=0.0, maximum=1.0
    )
    confidence_floor: float = parameter(
        0.1, 'regions below this confidence in a frame are not used for it', minimum=0.0, maximum=1.0
    )
    most_contacts: int = parameter(3, 'most contacts used to explain one frame', minimum=1, maximum=8)
    contact_threshold_n: float = parameter(0.015, 'least force reported as a contact', minimum=0.0)


@dataclass(frozen=True)
class ResponseConfig(TipsConfig):
    """How finely the response is measured."""

    components: int = parameter(48, 'principal components of the features', minimum=3)
    spacing_mm: float = parameter(2.0, 'distance between the knots along x and y', minimum=0.25)
    levels: int = parameter(6, 'intervals between the knots along the force', minimum=1)
    smoothing: tuple[float, ...] = parameter(
        (1e-4, 1e-3, 1e-2, 1e-1, 1.0), 'weights of the curvature penalty; the best one is used'
    )
    seed: int = parameter(1, 'seed of the presses held out to choose smoothing and uncertainty', minimum=0)


@dataclass(frozen=True)
class AxisymmetricConfig(TipsConfig):
    """How the profiles of an axisymmetric response are measured."""

    lateral: int = parameter(2, 'profiles of motion away from the press', minimum=1, maximum=4)
    vertical: int = parameter(2, 'profiles of vertical motion', minimum=1, maximum=4)
    levels: int = parameter(3, 'intervals between the knots along the force', minimum=1)
    turns: int = parameter(10, 'number of alternating fits of regions and profiles', minimum=4)
    presses_per_turn: int = parameter(600, 'presses used in each turn', minimum=50)
    most_presses: int = parameter(3000, 'most presses used in the last turn', minimum=50)
    seed: int = parameter(1, 'seed of the presses used in each turn, and of those held out', minimum=0)
    other_gels: int = parameter(0, 'simulated gels for the prior of calibration errors', minimum=0)


@dataclass(frozen=True)
class FieldConfig:
    """The starting values of a readout for any contact."""

    sensor: str = parameter('simulated', 'description of the sensor: a shipped one, or a YAML file')
    tips: str = parameter('portable', 'axisymmetric model for frames in which only tips press')
    body: str = parameter('ball:0.6', 'body that presses, as for tactile calibrate --body')
    contact_threshold_n: float = parameter(0.015, 'least force reported as a contact', minimum=0.0)
    touches: int = parameter(0, 'simulated bodies to learn a refinement of the forces from', minimum=0)


TIPS = 'axisymmetric', 'response'
READOUTS = 'network', *TIPS, 'tips', 'field'
"""`tips`: the first of `TIPS`, unless the other reads the validation presses clearly better."""


@dataclass(frozen=True)
class _Blocks:
    readout: str = parameter('network', 'readout that turns features into forces', choices=READOUTS)
    data: DataConfig = field(default_factory=DataConfig)
    network: NetworkConfig = field(default_factory=NetworkConfig)
    response: ResponseConfig = field(default_factory=ResponseConfig)
    axisymmetric: AxisymmetricConfig = field(default_factory=AxisymmetricConfig)
    field: FieldConfig = dataclasses.field(default_factory=FieldConfig)
    training: TrainingConfig = dataclasses.field(default_factory=TrainingConfig)


@dataclass(frozen=True)
class _Run(_Blocks):
    output: str = parameter('model.safetensors', 'file to write')


@dataclass(frozen=True)
class Choice:
    """A method by name, with its options."""

    name: str
    options: Mapping[str, object] = field(default_factory=dict)


@dataclass(frozen=True)
class TrainConfig(_Blocks):
    """A training run."""

    output: Path = Path('model.safetensors')
    flow: Choice = field(default_factory=lambda: Choice('dis'))
    encoding: Choice = field(default_factory=lambda: Choice('polar_mean'))
    gel: Gel = field(default_factory=Gel)
    recorded_bins: BinGrid | None = None
    stated: frozenset[str] = frozenset()
    """Dotted names of the keys given in the run's file. A file of recorded presses may decide the others."""

    @property
    def bins(self) -> BinGrid:
        if self.recorded_bins is not None:
            return self.recorded_bins
        return BinGrid(self.network.rows, self.network.cols, *self.gel.sides_mm)

    def resolved(self) -> dict[str, Any]:
        """The run in the form that `load_train_config` reads, with every default that its readout uses filled in."""
        readouts = TIPS if self.readout == 'tips' else [self.readout]
        names = dict.fromkeys(['data', 'gel', 'network', 'training', *readouts])
        blocks = {name: asdict(getattr(self, name)) for name in names}
        if isinstance(blocks['data']['crop'], list):  # width and height, which only a file of recorded presses gives
            del blocks['data']['crop']
        methods: dict[str, FlowMethod | FeatureEncoding] = {'flow': self.make_flow(), 'encoding': self.make_encoding()}
        named = {block: {'name': method.name, 'options': _stated(method.options)} for block, method in methods.items()}
        plain: dict[str, Any] = json.loads(json.dumps({'readout': self.readout, **named, **blocks}))
        return {'output': str(self.output), **plain}

    def make_flow(self) -> FlowMethod:
        return make_flow(self.flow.name, self.flow.options)

    def make_encoding(self) -> FeatureEncoding:
        return make_encoding(self.encoding.name, self.encoding.options)


def _stated(options: Mapping[str, object]) -> dict[str, object]:
    """Leave out options that are None: parameter files have no null, and leaving the option out means the same."""
    return {name: value for name, value in options.items() if value is not None}


def load_train_config(path: Path | str) -> TrainConfig:
    """Read a run's YAML file, or the one of this name that ships.

    Raises:
        ConfigurationError: it is missing, is not YAML, or has an unknown key or a value of the wrong type.
    """
    path = described_in('train', path, 'training run')
    written = load_mapping(path)
    blocks = from_mapping(
        _Run,
        {name: value for name, value in written.items() if name.split('.')[0] not in ('flow', 'encoding', 'gel')},
        source=str(path),
        exact=False,
    )
    return TrainConfig(
        flow=_choice('flow', 'dis', written, str(path)),
        encoding=_choice('encoding', 'polar_mean', written, str(path)),
        gel=Gel.from_mapping(_under('gel', written), str(path)),
        stated=frozenset(written),
        **{**vars(blocks), 'output': Path(blocks.output)},
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
