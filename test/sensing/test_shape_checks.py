"""That the tests check shapes and types: of whatever differs from what was found right, and only then."""

from __future__ import annotations

from collections.abc import Callable

import beartype
import jaxtyping
import numpy as np
import pytest
import shape_checks

from tactile_nodes.sensing.metrics import armse
from tactile_nodes.shapes import Float32, UInt8

LINE = np.zeros(3, np.float32)


@shape_checks.when_called(typechecker=beartype.beartype)
def answered(line: Float32[np.ndarray, ' n'], answer: Callable, *more: list[int]) -> Float32[np.ndarray, ' n']:
    return answer(line)


@pytest.mark.parametrize(
    'wrong',
    [
        (LINE.astype(np.float64), lambda line: line),
        (LINE[None], lambda line: line),
        (LINE, lambda line: line[:2]),
        (LINE, lambda line: line.astype(np.float64)),
        (LINE, lambda _: 'a text'),
        (LINE, lambda line: line, ['no number']),
    ],
    ids=['argument of another type', 'another shape', 'answer of another length', 'another type', 'a text', 'a list'],
)
def test_what_does_not_fit_is_refused_also_after_what_fits(wrong: tuple) -> None:
    for _ in range(2):
        assert answered(LINE, lambda line: line) is LINE
        assert answered(LINE, lambda line: line, [1]) is LINE
        with pytest.raises(jaxtyping.TypeCheckError):
            answered(*wrong)


def test_a_function_is_called_once_for_each_call() -> None:
    calls = []

    @shape_checks.when_called(typechecker=beartype.beartype)
    def counted(line: Float32[np.ndarray, ' n'], more: bool) -> UInt8[np.ndarray, ' m']:
        calls.append(more)
        return np.zeros(2 + more, np.uint8)

    for more in (False, True, True, False):
        assert len(counted(LINE, more)) == 2 + more
    assert calls == [False, True, True, False]


def test_the_package_is_checked() -> None:
    with pytest.raises(jaxtyping.TypeCheckError):
        armse(np.zeros((2, 3)), np.zeros((2, 4)))
