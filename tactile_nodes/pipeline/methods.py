"""How a node measures: with the flow method and features that a model was trained with, and the node's parameters."""

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
    """How untouched frames are detected, and answered without measuring motion."""

    check: bool = parameter(True, 'answer frames in which nothing touches without measuring motion')
    limit: float = parameter(
        3.8, 'motion from which on something may touch, in units of the motion that noise causes', minimum=0.1
    )
    most_noise_grey: float = parameter(
        3.0, 'noise of a pixel (standard deviation, grey levels) from which on every frame is measured', minimum=0.1
    )
    full_every: int = parameter(32, 'one in this many untouched frames is measured all the same; 1: all', minimum=1)


@dataclass(frozen=True)
class RegistrationParams:
    """How the motion of the whole image is removed: a knocked camera is not a force."""

    check: bool = parameter(True, 'remove the motion of the whole image')
    most_px: float = parameter(8.0, 'largest motion (root mean square) that is removed', minimum=0.1)
    most_turn_deg: float = parameter(2.5, 'largest rotation that is removed', minimum=0.1)
    follow_s: float = parameter(
        5.0, 'time constant with which slow motion is followed while nothing touches', minimum=0.1
    )


def stillness_options(params: StillnessParams) -> StillnessOptions | None:
    """The options that the parameters ask for; None if every frame is to be measured."""
    return StillnessOptions(params.limit, params.most_noise_grey, params.full_every) if params.check else None


def make_measuring(
    model: str,
    *,
    compiled: bool = False,
    check: StillnessOptions | None = None,
    registers: bool = False,
    marked_share: float = MARKED_SHARE,
) -> Measuring:
    """The method that a model (name or file) was trained with; `compiled` selects compiled loops.

    Patches of texture follow the motion of the whole image (`registers`). Between printed dots there is no texture; the
    motion of the whole image follows from the dots.

    Raises:
        ConfigurationError: no such method or option.
        ModelError: the model cannot be used.
    """
    loaded = load_model(find_model(model))
    flow, encoding = make_flow(*loaded.flow, compiled=compiled), make_encoding(*loaded.encoding)
    return Measuring(flow, encoding, compiled, check, registers and not isinstance(flow, DotsFlow), marked_share)


def image_size(model: str) -> tuple[int, int]:
    """Width and height of the images that a model reads."""
    return load_model(find_model(model)).image_size


def describe_flow(flow: FlowMethod) -> str:
    """A flow method as text, such as ``dis(preset=medium)``; a list is given by its number of entries."""
    options = {name: len(value) if isinstance(value, tuple) else value for name, value in flow.options.items()}
    return f'{flow.name}({", ".join(f"{name}={value}" for name, value in options.items() if value is not None)})'
