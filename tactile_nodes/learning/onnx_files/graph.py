"""Writes ONNX graphs as formulas: values add, multiply and compare as in numpy, with one node per operation.

writer = Writer()
x = writer.input('x', np.float32, (3,), 'px, along x, y and z')
writer.output('y', (2 * x + 1) @ matrix, (4,), 'N')
model = writer.model('an example', {'units': 'px to N'})
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Union

import numpy as np

from tactile_nodes import __version__
from tactile_nodes.errors import from_extra

with from_extra('onnx', 'making ONNX files'):
    import onnx
    from onnx import helper, numpy_helper

OPSET = 17
"""From 2022: old enough for every runtime in use. Its file format is version 8."""
FILE_VERSION = 8

Operand = Union['Value', float, np.ndarray]


@dataclass(frozen=True, eq=False)
class Value:
    """A tensor of the graph. Other operands of a formula, numbers and arrays, become constants of its type."""

    writer: Writer
    name: str
    dtype: np.dtype[Any]

    __array_ufunc__ = None
    """Prevents numpy from evaluating formulas that begin with an array."""

    def __add__(self, other: Operand) -> Value:
        return self.writer.op('Add', self, other)

    def __sub__(self, other: Operand) -> Value:
        return self.writer.op('Sub', self, other)

    def __mul__(self, other: Operand) -> Value:
        return self.writer.op('Mul', self, other)

    def __truediv__(self, other: Operand) -> Value:
        return self.writer.op('Div', self, other)

    def __pow__(self, other: Operand) -> Value:
        return self.writer.op('Pow', self, other)

    def __matmul__(self, other: Operand) -> Value:
        return self.writer.op('MatMul', self, other)

    def __radd__(self, other: Operand) -> Value:
        return self + other

    def __rmul__(self, other: Operand) -> Value:
        return self * other

    def __rsub__(self, other: Operand) -> Value:
        return self.writer.op('Sub', self.writer.like(self, other), self)

    def __rtruediv__(self, other: Operand) -> Value:
        return self.writer.op('Div', self.writer.like(self, other), self)

    def __rmatmul__(self, other: Operand) -> Value:
        return self.writer.op('MatMul', self.writer.like(self, other), self)

    def __lt__(self, other: Operand) -> Value:
        return self.writer.op('Less', self, other, dtype=bool)

    def __ge__(self, other: Operand) -> Value:
        return self.writer.op('GreaterOrEqual', self, other, dtype=bool)

    def __and__(self, other: Value) -> Value:
        return self.writer.op('And', self, other)

    def __invert__(self) -> Value:
        return self.writer.op('Not', self)

    def __getitem__(self, place: int) -> Value:
        """One entry along the first axis."""
        return self.writer.op('Gather', self, self.writer.constant(np.int64(place)), axis=0)

    def least(self, other: Operand) -> Value:
        """Element-wise minimum."""
        return self.writer.op('Min', self, other)

    def most(self, other: Operand) -> Value:
        """Element-wise maximum."""
        return self.writer.op('Max', self, other)

    def sqrt(self) -> Value:
        return self.writer.op('Sqrt', self)

    def sum(self) -> Value:
        """Sum of all entries: a scalar."""
        return self.writer.op('ReduceSum', self, keepdims=0)

    def mean(self) -> Value:
        """Mean of all entries: a scalar."""
        return self.writer.op('ReduceMean', self, keepdims=0)

    def max(self) -> Value:
        """Maximum of all entries: a scalar."""
        return self.writer.op('ReduceMax', self, keepdims=0)

    def reshape(self, *shape: int) -> Value:
        return self.writer.op('Reshape', self, self.writer.constant(np.array(shape, np.int64)))

    def times_transposed(self, other: Value) -> Value:
        """The matrix product with the transpose of `other`.

        Without `Transpose`: onnxruntime 1.20 to 1.23 fuses it with `MatMul`, and cannot compute that of 64-bit numbers.
        """
        return self.writer.op('Gemm', self, other, transB=1)

    def transposed_times(self, other: Value) -> Value:
        """The matrix product of the transpose of this with `other`."""
        return self.writer.op('Gemm', self, other, transA=1)

    def take(self, places: np.ndarray) -> Value:
        """Entries of a vector, in the shape of `places`."""
        return self.writer.op('Gather', self, self.writer.constant(places.astype(np.int64)), axis=0)

    def cast(self, dtype: type) -> Value:
        to = helper.np_dtype_to_tensor_dtype(np.dtype(dtype))
        return self.writer.op('Cast', self, dtype=dtype, to=to)

    def where(self, yes: Value, no: Operand) -> Value:
        """`yes` where this is true, else `no`."""
        return self.writer.op('Where', self, yes, self.writer.like(yes, no), dtype=yes.dtype)


class Writer:
    """Collects the nodes of a graph. Nodes of a branch or a loop go into a subgraph."""

    def __init__(self) -> None:
        self._open: list[list[onnx.NodeProto]] = [[]]
        self._constants: dict[tuple[str, tuple[int, ...], bytes], Value] = {}
        self._initializers: list[onnx.TensorProto] = []
        self._inputs: list[onnx.ValueInfoProto] = []
        self._outputs: list[onnx.ValueInfoProto] = []
        self._count = 0

    def input(self, name: str, dtype: type, shape: Sequence[int], meaning: str) -> Value:
        """A named input of the model."""
        output = Value(self, name, np.dtype(dtype))
        self._inputs.append(_info(output, shape, meaning))
        return output

    def output(self, name: str, value: Value, shape: Sequence[int], meaning: str) -> None:
        """Make a value a named output of the model."""
        self._add('Identity', [value.name], [name])
        self._outputs.append(_info(Value(self, name, value.dtype), shape, meaning))

    def constant(self, array: np.ndarray | np.generic) -> Value:
        """A constant of the graph. Equal constants are stored once."""
        array = np.asarray(array, order='C')
        key = (array.dtype.str, array.shape, array.tobytes())
        if key not in self._constants:
            output = Value(self, self._name('constant'), array.dtype)
            self._initializers.append(numpy_helper.from_array(array, output.name))
            self._constants[key] = output
        return self._constants[key]

    def like(self, value: Value, other: Operand) -> Value:
        """An operand as a value of the other's type."""
        return other if isinstance(other, Value) else self.constant(np.asarray(other, value.dtype))

    def op(
        self, kind: str, first: Value, *others: Operand, dtype: type | np.dtype[Any] | None = None, **more: Any
    ) -> Value:
        """One node with one output, by default of the first operand's type."""
        operands = [first, *(self.like(first, each) for each in others)]
        output = Value(self, self._name(kind), np.dtype(dtype or first.dtype))
        self._add(kind, [each.name for each in operands], [output.name], **more)
        return output

    def concat(self, *parts: Value) -> Value:
        """Concatenate scalars or vectors."""
        return self.op('Concat', *(each.reshape(-1) for each in parts), axis=0)

    def split(self, value: Value, *sizes: int) -> list[Value]:
        """Consecutive parts along the first axis."""
        outputs = [Value(self, self._name('part'), value.dtype) for _ in sizes]
        self._add('Split', [value.name, self.constant(np.array(sizes)).name], [each.name for each in outputs], axis=0)
        return outputs

    def choose(self, condition: Value, yes: Callable[[], Value], no: Callable[[], Value]) -> Value:
        """The result of one of two branches. Only that branch is computed."""
        graphs = {'then_branch': self._branch(yes), 'else_branch': self._branch(no)}
        dtype = np.dtype(graphs['then_branch'][1])
        output = Value(self, self._name('If'), dtype)
        self._add('If', [condition.name], [output.name], **{name: graph for name, (graph, _) in graphs.items()})
        return output

    def loop(
        self,
        most: int,
        state: Sequence[Value],
        step: Callable[..., tuple[Value, list[Value]]],
        begin: Value | None = None,
    ) -> list[Value]:
        """Repeat `step(*state) -> go on?, state` while true, at most `most` times; never if `begin` is false."""
        inside = [Value(self, self._name('state'), each.dtype) for each in state]
        counter = Value(self, self._name('turn'), np.dtype(np.int64))
        condition = Value(self, self._name('condition'), np.dtype(bool))
        self._open.append([])
        go_on, changed = step(*inside)
        results = [self.op('Identity', each) for each in (go_on, *changed)]
        scalars = [_info(each, ()) for each in (counter, condition)]
        body = helper.make_graph(
            self._open.pop(), self._name('body'), [*scalars, *(_info(each, None) for each in inside)],
            [_info(each, None) for each in results],
        )  # fmt: skip
        outputs = [Value(self, self._name('Loop'), each.dtype) for each in state]
        first = begin or self.constant(np.True_)
        turns = self.constant(np.int64(most))
        self._add('Loop', [each.name for each in (turns, first, *state)], [each.name for each in outputs], body=body)
        return outputs

    def model(self, meaning: str, properties: Mapping[str, str]) -> onnx.ModelProto:
        """The finished model, checked.

        Raises:
            onnx.checker.ValidationError, onnx.shape_inference.InferenceError: the graph is not valid.
        """
        graph = helper.make_graph(self._open[0], 'tactile_nodes', self._inputs, self._outputs, self._initializers)
        model = helper.make_model(
            graph, opset_imports=[helper.make_opsetid('', OPSET)], ir_version=FILE_VERSION,
            producer_name='tactile_nodes', producer_version=__version__, doc_string=meaning,
        )  # fmt: skip
        helper.set_model_props(model, dict(properties))
        onnx.checker.check_model(model, full_check=True)
        return model

    def _branch(self, compute: Callable[[], Value]) -> tuple[onnx.GraphProto, np.dtype[Any]]:
        self._open.append([])
        result = self.op('Identity', compute())
        graph = helper.make_graph(self._open.pop(), self._name('branch'), [], [_info(result, None)])
        return graph, result.dtype

    def _name(self, kind: str) -> str:
        self._count += 1
        return f'{kind.lower()}_{self._count}'

    def _add(self, kind: str, inputs: list[str], outputs: list[str], **attributes: Any) -> None:
        self._open[-1].append(helper.make_node(kind, inputs, outputs, **attributes))


def _info(value: Value, shape: Sequence[int] | None, meaning: str = '') -> onnx.ValueInfoProto:
    kind = helper.np_dtype_to_tensor_dtype(value.dtype)
    return helper.make_tensor_value_info(value.name, kind, shape, doc_string=meaning)
