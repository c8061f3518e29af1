"""Shapes and types of arrays in annotations: ``Float32[np.ndarray, 'rows cols 2']``.

They are those of jaxtyping. Type checkers read them, and the tests check them. Programs do not import jaxtyping, since
that would delay the start of every process.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING or 'jaxtyping' in sys.modules:
    from jaxtyping import (
        Bool,
        Complex,
        Complex64,
        Float,
        Float16,
        Float32,
        Float64,
        Inexact,
        Int,
        Int16,
        Int32,
        Int64,
        UInt8,
    )
else:

    class Float:
        """An array; nobody reads the annotation."""

        def __class_getitem__(cls, _annotation: Any) -> type:
            return cls

    Bool = Complex = Complex64 = Float16 = Float32 = Float64 = Inexact = Int = Int16 = Int32 = Int64 = UInt8 = Float

__all__ = [
    'Bool', 'Complex', 'Complex64', 'Float', 'Float16', 'Float32', 'Float64', 'Inexact', 'Int', 'Int16', 'Int32',
    'Int64', 'UInt8',
]  # fmt: skip
