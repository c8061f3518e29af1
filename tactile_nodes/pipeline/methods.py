"""Which flow method and features a node uses: by its parameters, or as a model was trained."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import ClassVar

from tactile_nodes.model_file import find_model, load_model
from tactile_nodes.params import parameter
from tactile_nodes.sensing.features import make_encoding
from tactile_nodes.sensing.flow.choice import make_flow
from tactile_nodes.sensing.flow.dots import DotsFlow
from tactile_nodes.sensing.flow.methods import FlowMethod
from tactile_nodes.sensing.picture.quality import MARKED_SHARE
from tactile_nodes.sensing.picture.stillness import StillnessOptions
from tactile_nodes.sensing.rest.prepared import Measuring


@dataclass(frozen=True)
class DisParams:
    """Options of the flow method ``dis``."""

    preset: str = parameter('ultrafast', 'where the other options start from', choices=('ultrafast', 'fast', 'medium'))
    finest_scale: int = parameter(1, 'finest pyramid level; 0 is full size', minimum=0, maximum=5)
    threads: int = parameter(1, 'threads of OpenCV; another number gives other last digits', minimum=1)


@dataclass(frozen=True)
class InverseCompositionalParams:
    """Options of the flow method ``inverse_compositional``, which has a patch for each region."""

    finest_scale: int = parameter(1, 'scale that is measured at: 0 is full size, 1 half', minimum=0, maximum=3)
    window: float = parameter(1.2, 'width of a patch in units of its distance to the next', minimum=0.5, maximum=4.0)


@dataclass(frozen=True)
class MethodParams:
    """How motion is measured and summed up."""

    READ_ONLY: ClassVar[bool] = True

    model: str = parameter(
        '', 'take flow and features from this model (name or file) instead of the parameters below', read_only=True
    )
    method: str = parameter(
        'inverse_compositional',
        'how motion is measured',
        choices=('dis', 'dots', 'inverse_compositional'),
        read_only=True,
    )
    dis: DisParams = field(default_factory=DisParams)
    inverse_compositional: InverseCompositionalParams = field(default_factory=InverseCompositionalParams)
    encoding: str = parameter('cartesian_mean', 'how motion is summed up by region', read_only=True)
    rows: int = parameter(10, 'regions along y', minimum=1, read_only=True)
    cols: int = parameter(10, 'regions along x', minimum=1, read_only=True)


@dataclass(frozen=True)
class StillnessParams:
    """How frames in which nothing touches are told, and answered without measuring motion."""

    check: bool = parameter(True, 'answer frames in which nothing touches without measuring motion', read_only=True)
    limit: float = parameter(
        3.8, 'motion, in units of what noise makes of it, from which something may touch', minimum=0.1, read_only=True
    )
    most_noise_grey: float = parameter(
        3.0, 'noise of a pixel (standard deviation, grey levels) from which every frame is measured', minimum=0.1,
        read_only=True,
    )  # fmt: skip
    full_every: int = parameter(
        32, 'of frames in which nothing touches one in so many is measured all the same; 1: all', minimum=1,
        read_only=True,
    )  # fmt: skip


@dataclass(frozen=True)
class RegistrationParams:
    """How the motion of the whole picture is taken out: a knocked camera is no force."""

    check: bool = parameter(True, 'take out how far the whole picture moved', read_only=True)
    most_px: float = parameter(8.0, 'motion (root mean square) that is still taken out', minimum=0.1, read_only=True)
    most_turn_deg: float = parameter(2.5, 'turn that is still taken out', minimum=0.1, read_only=True)
    follow_s: float = parameter(
        5.0, 'time in which slow motion is followed while nothing touches', minimum=0.1, read_only=True
    )


def stillness_options(params: StillnessParams) -> StillnessOptions | None:
    """What parameters ask for; None where every frame is to be measured."""
    return StillnessOptions(params.limit, params.most_noise_grey, params.full_every) if params.check else None


def make_measuring(
    params: MethodParams,
    *,
    compiled: bool = False,
    check: StillnessOptions | None = None,
    registers: bool = False,
    marked_share: float = MARKED_SHARE,
) -> Measuring:
    """What parameters ask for, `compiled` loops included; the rest as `Measuring` has it.

    The motion of the whole picture is followed by patches of texture, and between printed dots there is none: what
    touches a few dozen moves most of them, so beside them nothing `registers`.

    Raises:
        ConfigurationError: no such method or option.
        ModelError: the model cannot be used.
    """
    if params.model:
        loaded = load_model(find_model(params.model))
        flow, encoding = make_flow(*loaded.flow, compiled=compiled), make_encoding(*loaded.encoding)
    else:
        regions = {'rows': params.rows, 'cols': params.cols}
        options = {
            'dis': asdict(params.dis),
            'dots': regions,
            'inverse_compositional': {**asdict(params.inverse_compositional), **regions},
        }[params.method]
        flow = make_flow(params.method, options, compiled=compiled)
        encoding = make_encoding(params.encoding, regions)
    registers = registers and not isinstance(flow, DotsFlow)
    return Measuring(flow, encoding, compiled, check, registers, marked_share)


def image_size(params: MethodParams) -> tuple[int, int] | None:
    """Width and height of the pictures that the model reads; None without one, or of one that does not say it."""
    loaded = load_model(find_model(params.model)) if params.model else None
    return loaded.image_size if loaded and 'crop_px' in loaded.card else None


def told(flow: FlowMethod) -> str:
    """A flow method in words, such as ``dis(preset=medium)``; of a list, how many it names."""
    options = {name: len(value) if isinstance(value, tuple) else value for name, value in flow.options.items()}
    return f'{flow.name}({", ".join(f"{name}={value}" for name, value in options.items() if value is not None)})'
