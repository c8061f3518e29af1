"""How a node measures: by the flow method and features that a model was trained with, and by its parameters."""

from __future__ import annotations

from dataclasses import dataclass

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
    model: str,
    *,
    compiled: bool = False,
    check: StillnessOptions | None = None,
    registers: bool = False,
    marked_share: float = MARKED_SHARE,
) -> Measuring:
    """As a model (name or file) was trained, by `compiled` loops if asked for; the rest as `Measuring` has it.

    The motion of the whole picture is followed by patches of texture, and between printed dots there is none: what
    touches a few dozen moves most of them, so beside them nothing `registers`.

    Raises:
        ConfigurationError: no such method or option.
        ModelError: the model cannot be used.
    """
    loaded = load_model(find_model(model))
    flow, encoding = make_flow(*loaded.flow, compiled=compiled), make_encoding(*loaded.encoding)
    registers = registers and not isinstance(flow, DotsFlow)
    return Measuring(flow, encoding, compiled, check, registers, marked_share)


def image_size(model: str) -> tuple[int, int] | None:
    """Width and height of the pictures that a model reads; None of one that does not say it."""
    loaded = load_model(find_model(model))
    return loaded.image_size if 'crop_px' in loaded.card else None


def told(flow: FlowMethod) -> str:
    """A flow method in words, such as ``dis(preset=medium)``; of a list, how many it names."""
    options = {name: len(value) if isinstance(value, tuple) else value for name, value in flow.options.items()}
    return f'{flow.name}({", ".join(f"{name}={value}" for name, value in options.items() if value is not None)})'
