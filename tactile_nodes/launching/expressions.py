"""The expression of ``$(eval "…")``, computed without letting a file run arbitrary code.

ROS 2 passes it to Python's `eval` with access to `math`. Here the text is parsed, and only arithmetic, comparisons,
``and or not``, conditional expressions, and the functions named below are evaluated; everything else is refused.
"""

from __future__ import annotations

import ast
import math
import operator
from collections.abc import Callable
from typing import Any

from tactile_nodes.launching.template import SubstitutionError

_MAX_LENGTH = 2000
_MAX_SIZE = 10_000  # characters of a repeated string, bits of a power

# Excluded: functions that take long or fill the memory (factorial, comb, perm, prod).
_MATH_NAMES = """
    acos acosh asin asinh atan atan2 atanh ceil copysign cos cosh degrees dist e erf erfc exp expm1 fabs floor fmod
    frexp fsum gamma gcd hypot inf isclose isfinite isinf isnan lcm ldexp lgamma log log10 log1p log2 modf nan pi pow
    radians remainder sin sinh sqrt tan tanh tau trunc
"""
_MATH: dict[str, Any] = {name: getattr(math, name) for name in _MATH_NAMES.split()}


def _round(number: Any, digits: int | None = None) -> Any:
    # For an integer, Python's own function would first compute 10 ** -digits.
    _bound(abs(digits or 0))
    return round(number, digits)


# As in ROS 2, the names of math are available with and without 'math.'; they replace builtins of the same name.
_NAMES: dict[str, Any] = {
    **{f.__name__: f for f in (abs, bool, float, int, len, max, min, str, sum)},
    'round': _round,
    **_MATH,
}
_METHODS = {'endswith', 'lower', 'lstrip', 'rstrip', 'startswith', 'strip', 'upper'}

_BINARY: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.FloorDiv: operator.floordiv,
    ast.Mod: operator.mod,
    ast.Pow: operator.pow,
}
_UNARY: dict[type[ast.unaryop], Callable[[Any], Any]] = {
    ast.UAdd: operator.pos,
    ast.USub: operator.neg,
    ast.Not: operator.not_,
}
_COMPARISONS: dict[type[ast.cmpop], Callable[[Any, Any], Any]] = {
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.In: lambda a, b: a in b,
    ast.NotIn: lambda a, b: a not in b,
    ast.Is: operator.is_,
    ast.IsNot: operator.is_not,
}


def evaluate(text: str) -> str:
    """The value of an expression, as text.

    >>> evaluate("2 * sqrt(16) if 'a' in 'abc' else 0")
    '8.0'

    Raises:
        SubstitutionError: not an expression, not allowed, or without a value (a division by zero).
    """
    if len(text) > _MAX_LENGTH:
        raise SubstitutionError(f'the expression is longer than {_MAX_LENGTH} characters')
    try:
        return str(_value(ast.parse(text.strip(), mode='eval').body))
    except SyntaxError as error:
        raise SubstitutionError(f'{text!r} is not an expression: {error.msg}') from error
    except (TypeError, ValueError, ArithmeticError, LookupError, RecursionError, MemoryError) as error:
        raise SubstitutionError(f'{text!r} has no value: {error}') from error


def _value(node: ast.expr) -> Any:
    kind = type(node)
    if kind not in _KINDS:
        raise SubstitutionError(f'{_shown(node)} is not allowed in an expression of a launch file')
    return _KINDS[kind](node)


def _constant(node: ast.Constant) -> Any:
    if not isinstance(node.value, (bool, int, float, str, type(None))):
        raise SubstitutionError(f'{_shown(node)} is not allowed in an expression of a launch file')
    return node.value


def _name(node: ast.Name) -> Any:
    if node.id not in _NAMES:
        raise SubstitutionError(f"the name '{node.id}' is not known; put strings in quotes: '{node.id}'")
    return _NAMES[node.id]


def _attribute(node: ast.Attribute) -> Any:
    if isinstance(node.value, ast.Name) and node.value.id == 'math' and node.attr in _MATH:
        return _MATH[node.attr]
    if node.attr in _METHODS and isinstance(text := _value(node.value), str):
        return getattr(text, node.attr)
    raise SubstitutionError(f'{_shown(node)} is not allowed in an expression of a launch file')


def _call(node: ast.Call) -> Any:
    function = _value(node.func)
    if node.keywords or not callable(function):
        raise SubstitutionError(f'{_shown(node)} is not allowed in an expression of a launch file')
    arguments = [_value(argument) for argument in node.args]
    return function(*arguments)


def _binary(node: ast.BinOp) -> Any:
    if type(node.op) not in _BINARY:
        raise SubstitutionError(f'{_shown(node)} is not allowed in an expression of a launch file')
    left, right = _value(node.left), _value(node.right)
    _bound(_growth(node.op, left, right))
    return _BINARY[type(node.op)](left, right)


def _growth(kind: ast.operator, left: Any, right: Any) -> int:
    """Upper bound on the size of a result that may exceed its operands: a file must not fill the memory."""
    if isinstance(kind, ast.Pow) and isinstance(left, int) and isinstance(right, int):
        return left.bit_length() * abs(right)
    if isinstance(kind, ast.Mult) and isinstance(left, (str, list, tuple)) and isinstance(right, int):
        return len(left) * right
    if isinstance(kind, ast.Mult) and isinstance(right, (str, list, tuple)) and isinstance(left, int):
        return len(right) * left
    if isinstance(kind, ast.Mod) and isinstance(left, str):
        return _MAX_SIZE + 1  # '%999999999d' % 1
    return 0


def _bound(size: int) -> None:
    if size > _MAX_SIZE:
        raise SubstitutionError('the result of the expression is too large')


def _unary(node: ast.UnaryOp) -> Any:
    if type(node.op) not in _UNARY:
        raise SubstitutionError(f'{_shown(node)} is not allowed in an expression of a launch file')
    return _UNARY[type(node.op)](_value(node.operand))


def _boolean(node: ast.BoolOp) -> Any:
    is_and = isinstance(node.op, ast.And)
    result: Any = is_and
    for operand in node.values:
        result = _value(operand)
        if bool(result) is not is_and:
            break
    return result


def _compare(node: ast.Compare) -> Any:
    left = _value(node.left)
    for kind, operand in zip(node.ops, node.comparators, strict=True):
        right = _value(operand)
        if not _COMPARISONS[type(kind)](left, right):
            return False
        left = right
    return True


def _conditional(node: ast.IfExp) -> Any:
    return _value(node.body) if _value(node.test) else _value(node.orelse)


def _sequence(node: ast.List | ast.Tuple) -> Any:
    items = [_value(item) for item in node.elts]
    return items if isinstance(node, ast.List) else tuple(items)


def _subscript(node: ast.Subscript) -> Any:
    return _value(node.value)[_value(node.slice)]


def _shown(node: ast.AST) -> str:
    return ast.unparse(node)


_KINDS: dict[type[ast.AST], Callable[[Any], Any]] = {
    ast.Attribute: _attribute,
    ast.BinOp: _binary,
    ast.BoolOp: _boolean,
    ast.Call: _call,
    ast.Compare: _compare,
    ast.Constant: _constant,
    ast.IfExp: _conditional,
    ast.List: _sequence,
    ast.Name: _name,
    ast.Subscript: _subscript,
    ast.Tuple: _sequence,
    ast.UnaryOp: _unary,
}
