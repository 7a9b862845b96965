"""Checks of arguments that all rooms share; every message reads ``name: got VALUE, allowed: …``."""

from __future__ import annotations

import functools
import inspect
import types
import typing
from collections.abc import Callable, Iterable
from typing import Any, Literal, ParamSpec, TypeVar

import numpy as np

_Parameters = ParamSpec("_Parameters")
_Result = TypeVar("_Result")
_Class = TypeVar("_Class")

_NUMBERS = (float, int, np.floating, np.integer)
_WHOLE = (int, np.integer)


def count(name: str, value: Any, minimum: int, maximum: int = 255) -> int:
    """Return a whole number in the range from ``minimum`` to ``maximum``, else raise ValueError."""
    if isinstance(value, bool) or not isinstance(value, _WHOLE) or not minimum <= value <= maximum:
        raise ValueError(f"{name}: got {value!r}, allowed: {minimum} to {maximum}")
    return int(value)


def checked(function: Callable[_Parameters, _Result]) -> Callable[_Parameters, _Result]:
    """Raise a ValueError that names the argument if its type is not the annotated one.

    Numbers, booleans, strings, tuples of numbers and classes are checked before the call. Array-likes are checked after
    the call has failed, since the function converts them.
    """
    names = tuple(inspect.signature(function).parameters)
    tests: dict[str, _Test] = {}

    @functools.wraps(function)
    def wrapped(*args: _Parameters.args, **kwargs: _Parameters.kwargs) -> _Result:
        if not tests:
            tests.update(_tests_of(function, names))
        for name, value in zip(names, args, strict=False):
            tests[name](name, value)
        for name, value in kwargs.items():
            if name in tests:
                tests[name](name, value)
        try:
            return function(*args, **kwargs)
        except (TypeError, ValueError) as error:
            if ": got " not in str(error):
                _refuse_arrays(function, {**dict(zip(names, args, strict=False)), **kwargs})
            raise

    return wrapped


def checked_class(kind: type[_Class]) -> type[_Class]:
    """:func:`checked` for the arguments of the constructor."""
    kind.__init__ = checked(kind.__init__)  # type: ignore[method-assign]
    return kind


_Test = Callable[[str, Any], None]


def _tests_of(function: Callable[..., Any], names: Iterable[str]) -> dict[str, _Test]:
    hints = typing.get_type_hints(function)
    return {name: _test_of(hints.get(name, Any)) for name in names}


def _test_of(hint: Any) -> _Test:
    options = typing.get_args(hint) if _is_union(hint) else (hint,)
    fits, allowed = [], []
    for option in options:
        rule = _rule_of(option)
        if rule is None:
            return lambda name, value: None
        fits.append(rule[0])
        allowed.append(rule[1])
    text = " or ".join(dict.fromkeys(allowed))

    def test(name: str, value: Any) -> None:
        for fit in fits:
            if fit(value):
                return
        raise ValueError(f"{name}: got {value!r:.80}, allowed: {text}")

    return test


def _is_union(hint: Any) -> bool:
    return typing.get_origin(hint) in (typing.Union, types.UnionType)


def _rule_of(hint: Any) -> tuple[Callable[[Any], bool], str] | None:
    """A predicate and its description; None where every value is accepted."""
    origin, inner = typing.get_origin(hint), typing.get_args(hint)
    if hint is float:
        return _is_number, "a number"
    if hint is int:
        return (lambda value: isinstance(value, _WHOLE) and not isinstance(value, bool)), "a whole number"
    if hint is bool:
        return (lambda value: isinstance(value, (bool, np.bool_))), "True or False"
    if hint is type(None):
        return (lambda value: value is None), "None"
    if origin is Literal:
        kinds = tuple({type(option) for option in inner})
        return (lambda value: isinstance(value, kinds)), " or ".join(repr(option) for option in inner)
    if origin is tuple and inner and Ellipsis not in inner and set(inner) <= {int, float}:
        return (lambda value: _is_row_of_numbers(value, len(inner))), f"{len(inner)} numbers"
    if inspect.isclass(hint) and (hint is str or hint.__module__.startswith("ocisac_fast")):
        return (lambda value: isinstance(value, hint)), "a text" if hint is str else f"a {hint.__name__}"
    return None


def _is_number(value: Any) -> bool:
    if isinstance(value, _NUMBERS):
        return True
    return isinstance(value, np.ndarray) and value.ndim == 0 and value.dtype.kind in "uif"


def _is_row_of_numbers(value: Any, length: int) -> bool:
    try:
        return len(value) == length and all(_is_number(each) for each in value)
    except TypeError:
        return False


def _refuse_arrays(function: Callable[..., Any], given: dict[str, Any]) -> None:
    """Raise a ValueError for the first argument that NumPy cannot convert to real numbers."""
    for name, hint in typing.get_type_hints(function).items():
        if name in given and _is_array(str(inspect.signature(function).parameters[name].annotation)):
            value = given[name]
            if value is None or hint is None:
                continue
            try:
                kind = np.asarray(value).dtype.kind
            except ValueError:
                kind = "O"
            if kind not in "buif":
                raise ValueError(f"{name}: got {value!r:.80}, allowed: real numbers") from None


def _is_array(annotation: str) -> bool:
    return "ArrayLike" in annotation or "Sequence[float]" in annotation
