"""Shapes and types of arrays, checked while tests run: each function once for each kind of arguments and answers.

Whether a value fits its annotation hangs on its type alone, and that of an array on its shape and dtype too. What was
found right is therefore not looked at again: to do so took a quarter of the time of the tests that are checked.
"""

from __future__ import annotations

import functools
import inspect
import threading
from collections.abc import Callable, Hashable
from typing import Any

import jaxtyping
import numpy as np

AT_ONCE = jaxtyping.jaxtyped


def install(packages: list[str]) -> None:
    """Check what is imported of these packages from now on."""
    jaxtyping.jaxtyped = jaxtyping._decorator.jaxtyped = when_called
    jaxtyping.install_import_hook(packages, 'beartype.beartype')


def switch(*, on: bool) -> None:
    """For all functions that are checked."""
    jaxtyping.config.update('jaxtyping_disable', not on)


def when_called(function: Any = None, **options: Any) -> Any:
    """What jaxtyping makes of a function, made when it is first called with checks: most never are."""
    if function is None:
        return functools.partial(when_called, **options)
    return Checked(function, options).wrapper() if inspect.isfunction(function) else AT_ONCE(function, **options)


class Checked:
    """A function and the kinds of arguments for which it was found right, each with those of its answers."""

    def __init__(self, function: Callable[..., Any], options: dict[str, Any]) -> None:
        functools.update_wrapper(self, function)
        self.__globals__ = function.__globals__
        self._function, self._options = function, options
        self._known: dict[Hashable, set[Hashable]] = {}
        self._answered = threading.local()

    def __call__(self, *values: Any, **named: Any) -> Any:
        """Called by jaxtyping, between its checks of the arguments and of the answer."""
        answer = vars(self._answered).pop('answer', self)
        return self._function(*values, **named) if answer is self else answer

    @functools.cached_property
    def _checked(self) -> Callable[..., Any]:
        return AT_ONCE(self, **self._options)

    def wrapper(self) -> Callable[..., Any]:
        """It looks like the function itself."""
        function, known = self._function, self._known

        @functools.wraps(function)
        def call(*values: Any, **named: Any) -> Any:
            __tracebackhide__ = True
            if jaxtyping.config.jaxtyping_disable:
                return function(*values, **named)
            given = (*map(kind, values), *((name, kind(value)) for name, value in named.items()))
            if (right := known.get(given)) is None:
                answer = self._checked(*values, **named)
                known[given] = {kind(answer)}
                return answer
            answer = function(*values, **named)
            if kind(answer) not in right:
                self._answered.answer = answer
                self._checked(*values, **named)
                right.add(kind(answer))
            return answer

        return call


def kind(value: object) -> Hashable:
    """What a check hangs on. What holds any number of values is of a kind of its own, since one of them may not fit."""
    of = type(value)
    if isinstance(value, np.ndarray):
        return of, value.shape, value.dtype
    if of is tuple:
        return tuple(map(kind, value))
    return object() if issubclass(of, (list, dict, set, frozenset)) else of
