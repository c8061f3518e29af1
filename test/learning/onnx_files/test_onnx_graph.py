"""Formulas as ONNX nodes: what they compute, in onnxruntime."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

pytest.importorskip('onnx')
pytest.importorskip('onnxruntime')

import onnxruntime

from tactile_nodes.learning.onnx_files.graph import Value, Writer


def computed(writer: Writer, result: Value, **inputs: Any) -> np.ndarray:
    writer.output('result', result, (), 'of the test')
    content = writer.model('a test', {}).SerializeToString()
    session = onnxruntime.InferenceSession(content, providers=['CPUExecutionProvider'])
    found: np.ndarray = session.run(None, {name: np.array(value, np.float64) for name, value in inputs.items()})[0]
    return found


@pytest.fixture
def writer() -> Writer:
    return Writer()


def scalar(writer: Writer, name: str = 'x') -> Value:
    return writer.input(name, np.float64, (), 'a number')


def test_formulas_mean_what_they_do_in_numpy(writer: Writer) -> None:
    x = scalar(writer)
    assert computed(writer, (2 * x - 1) / (1 - x) + 6 / x**2, x=3) == pytest.approx(-2.5 + 2 / 3)


def test_an_array_may_begin_a_formula(writer: Writer) -> None:
    x = scalar(writer)
    vector = np.array([1.0, 2.0]) * x
    assert computed(writer, np.array([10.0, 1.0]) @ vector, x=3) == 36


@pytest.mark.parametrize(('x', 'expected'), [(1, 10), (-1, -100)])
def test_a_condition_chooses_a_branch(writer: Writer, x: float, expected: float) -> None:
    value = scalar(writer)
    assert computed(writer, writer.choose(value >= 0, lambda: value * 10, lambda: value * 100), x=x) == expected


@pytest.mark.parametrize(('most', 'expected'), [(50, 128), (3, 8)])
def test_a_loop_ends_by_itself_or_after_its_turns(writer: Writer, most: int, expected: float) -> None:
    """1 is doubled until 100 is reached."""
    (result,) = writer.loop(most, [scalar(writer)], lambda value: ((doubled := value * 2) < 100, [doubled]))
    assert computed(writer, result, x=1) == expected


def test_a_loop_may_not_begin_at_all(writer: Writer) -> None:
    start = scalar(writer)
    (result,) = writer.loop(5, [start], lambda value: (value < 100, [value * 2]), start < 0)
    assert computed(writer, result, x=3) == 3


def test_equal_constants_are_kept_once(writer: Writer) -> None:
    assert writer.constant(np.ones(3)) is writer.constant(np.ones(3))
    assert writer.constant(np.ones(3)) is not writer.constant(np.ones(3, np.float32))
