"""Flow methods by name: ``make_flow('dis', {'preset': 'ultrafast', 'finest_scale': 1})``.

To add one, write a class with the two methods of `FlowMethod` and a line in `FLOW_METHODS`.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.sensing.flow.dots import DotsFlow, DotsOptions
from tactile_nodes.sensing.flow.inverse_compositional import InverseCompositionalFlow, InverseCompositionalOptions
from tactile_nodes.sensing.flow.methods import DisFlow, DisOptions, FlowMethod, checked_options

SENSING, MEASURING = Path(__file__).parents[1], ('flow/*.py', 'features.py')
"""Code that measures: patterns of files below the folder of `sensing`."""


@cache
def code_id(folder: Path = SENSING, measuring: tuple[str, ...] = MEASURING) -> str:
    """Sixteen hexadecimal digits of a hash over the code that measures, in files of these patterns.

    Features that other code has measured would not fit the response of a model, which this code computes.
    """
    files = [file for pattern in measuring for file in sorted(folder.glob(pattern))]
    return hashlib.sha256(b''.join(file.read_bytes() for file in files)).hexdigest()[:16]


def _make_dis(options: Mapping[str, object], compiled: bool) -> FlowMethod:
    del compiled  # it is OpenCV's
    return DisFlow(DisOptions(**checked_options('dis', DisOptions, options)))  # type: ignore[arg-type]


def _make_inverse_compositional(options: Mapping[str, object], compiled: bool) -> FlowMethod:
    checked = checked_options(InverseCompositionalFlow.name, InverseCompositionalOptions, options)
    return InverseCompositionalFlow(InverseCompositionalOptions(**checked), compiled=compiled)  # type: ignore[arg-type]


def _make_dots(options: Mapping[str, object], compiled: bool) -> FlowMethod:
    del compiled  # a few dozen dots take little time
    return DotsFlow(DotsOptions(**checked_options(DotsFlow.name, DotsOptions, options)))  # type: ignore[arg-type]


FLOW_METHODS: dict[str, Callable[[Mapping[str, object], bool], FlowMethod]] = {
    'dis': _make_dis,
    'dots': _make_dots,
    'inverse_compositional': _make_inverse_compositional,
}


def make_flow(name: str, options: Mapping[str, object] | None = None, *, compiled: bool = False) -> FlowMethod:
    """The flow method of that name; `compiled` selects compiled loops if the method has them.

    Raises:
        ConfigurationError: there is no such method, or it has no such option.
    """
    if name not in FLOW_METHODS:
        raise ConfigurationError(f'there is no flow method {name!r}; use one of: {", ".join(FLOW_METHODS)}')
    return FLOW_METHODS[name](options or {}, compiled)
