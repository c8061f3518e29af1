"""The format of data for the page: one binary WebSocket message per update, decoded by js/packet.js.

::

    uint32                length of the JSON text, little-endian
    JSON, UTF-8           numbers and words; `sections` lists name and length [bytes] of the sections
    the sections          bins (float32 [N]), surface (float32 per cell of a force field: pressure, shear x, shear y
                          [kPa], pressure over half of the maximum of its contact), motion (float32 per region: dx,
                          dy, confidence), image (JPEG)
    samples               the rest: stamp (float64 [s]), total and true total (float32 [N]) each

The samples come last because they differ between viewers: a viewer that was skipped gets the samples that it missed.
"""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

_LENGTH = struct.Struct('<I')
_SAMPLE = struct.Struct('<dff')


@dataclass(frozen=True)
class Packet:
    """The same `body` for all viewers, and the new samples of the force since the previous packet."""

    body: bytes
    samples: bytes = b''


def body(fields: Mapping[str, Any], sections: Mapping[str, bytes]) -> bytes:
    """JSON and sections as above; NaN and infinities become null."""
    lengths = [[name, len(data)] for name, data in sections.items()]
    text = json.dumps(finite({**fields, 'sections': lengths}), separators=(',', ':'), ensure_ascii=False).encode()
    return b''.join((_LENGTH.pack(len(text)), text, *sections.values()))


def samples(found: Iterable[tuple[float, float, float]]) -> bytes:
    """(stamp [s], total [N], true total [N] or NaN) of each frame."""
    return b''.join(_SAMPLE.pack(*each) for each in found)


def finite(value: Any) -> Any:
    """`value` without NaN and infinities, which JSON does not have.

    >>> finite({'force': [1.5, math.nan]})
    {'force': [1.5, None]}
    """
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {key: finite(each) for key, each in value.items()}
    if isinstance(value, (list, tuple)):
        return [finite(each) for each in value]
    return value
