"""Checks of arguments that all rooms share; every message reads ``name: got VALUE, allowed: …``."""

from __future__ import annotations

import copy
import dataclasses
import functools
import inspect
import json
import math
import os
import reprlib
import sys
import types
import typing
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal, ParamSpec, TypeVar

import numpy as np
import numpy.typing as npt

_Parameters = ParamSpec("_Parameters")
_Result = TypeVar("_Result")
_Class = TypeVar("_Class")

_NUMBERS = (float, int, np.floating, np.integer)
_WHOLE = (int, np.integer)
_MOST_SHOWN = 80
_SHORT = reprlib.Repr()
_SHORT.maxstring = _SHORT.maxother = _SHORT.maxlong = _MOST_SHOWN
_SHORT.maxlist = _SHORT.maxtuple = _SHORT.maxdict = _SHORT.maxset = _SHORT.maxarray = 24  # items


def shown(value: Any) -> str:
    """A value as messages show it: on one line, at most 80 characters."""
    text = " ".join((str(value) if isinstance(value, _NUMBERS) else _SHORT.repr(value)).split())
    return text if len(text) <= _MOST_SHOWN else f"{text[: _MOST_SHOWN - 3]}..."


def one_of(texts: Iterable[str]) -> str:
    """Alternatives as messages list them: ``a, b or c``."""
    *others, last = dict.fromkeys(texts)
    return f"{', '.join(others)} or {last}" if others else last


def count(name: str, value: Any, minimum: int, maximum: int = 255) -> int:
    """Return a whole number in the range from ``minimum`` to ``maximum``, else raise ValueError."""
    if isinstance(value, bool) or not isinstance(value, _WHOLE) or not minimum <= value <= maximum:
        raise ValueError(f"{name}: got {shown(value)}, allowed: {minimum} to {maximum}")
    return int(value)


def broadcast(names: str, *arrays: npt.ArrayLike) -> tuple[npt.NDArray[np.float64], ...]:
    """The arrays in one shape, else ValueError."""
    every = [np.asarray(array, dtype=np.float64) for array in arrays]
    try:
        return tuple(np.broadcast_arrays(*every))
    except ValueError:
        raise ValueError(f"{names}: got {[each.shape for each in every]}, allowed: shapes that broadcast") from None


@dataclass(frozen=True)
class Within:
    """The range of a number, for annotations that :func:`checked` reads; an infinite end is not within it."""

    low: float = -math.inf  # ends of the range
    high: float = math.inf
    above: bool = False  # the lower end is not within it, with below the upper one
    below: bool = False

    def __contains__(self, value: float) -> bool:
        low = value > self.low if self.above else value >= self.low
        high = value < self.high if self.below else value <= self.high
        return low and high and math.isfinite(value)

    def __str__(self) -> str:
        low, high = (f"{end:.10g}" for end in (self.low, self.high))
        if self.high == math.inf:
            return f" above {low}" if self.above else f", {low} or above" if self.low > -math.inf else ""
        if self.above:
            return f"above {low} {'and below' if self.below else 'up to'} {high}"
        return f"{low} to {'below ' if self.below else ''}{high}"


Finite = Annotated[float, Within()]
Positive = Annotated[float, Within(0.0, above=True)]
Invertible = Annotated[float, Within(1e-300)]  # its reciprocal is finite
NotNegative = Annotated[float, Within(0.0)]
Share = Annotated[float, Within(0.0, 1.0)]
ShareAboveZero = Annotated[float, Within(0.0, 1.0, above=True)]
ShareBelowOne = Annotated[float, Within(0.0, 1.0, below=True)]
InnerShare = Annotated[float, Within(0.0, 1.0, above=True, below=True)]
Count = Annotated[int, Within(1)]
Threads = Annotated[int, Within(1, 1024)]


def _with_errors(text: str | None) -> str | None:
    """A docstring that says what is raised where it names no errors of its own."""
    if text is None or "Raises:" in text:
        return text
    error = "ValueError: an argument outside its range or of a wrong type or shape; the message names it."
    return f"{inspect.cleandoc(text)}\n\nRaises:\n    {error}\n"


def checked(function: Callable[_Parameters, _Result]) -> Callable[_Parameters, _Result]:
    """Raise a ValueError that names the argument if its type is not the annotated one, or the number out of its range.

    Numbers, texts, paths, arrays, sequences and classes are checked before the call. Arrays must be of real numbers;
    a masked array may mask none of them. The docstring says so, unless it has a section of errors.
    """
    names = tuple(inspect.signature(function).parameters)
    tests: dict[str, _Test] = {}

    @functools.wraps(function)
    def wrapped(*args: _Parameters.args, **kwargs: _Parameters.kwargs) -> _Result:
        if not tests:
            tests.update(_tests_of(function, names, args[:1]))
        for name, value in zip(names, args):  # noqa: B905 (strict=False takes 0.5 us)
            tests[name](name, value)
        for name, value in kwargs.items():
            if name in tests:
                tests[name](name, value)
        return function(*args, **kwargs)

    wrapped.__doc__ = _with_errors(function.__doc__)
    return wrapped


@functools.cache
def _tests_of_function(function: Callable[..., Any]) -> dict[str, _Test]:
    return _tests_of(function, tuple(inspect.signature(function).parameters), ())


def check_arguments(function: Callable[..., Any], arguments: Mapping[str, Any]) -> None:
    """Test the arguments of a call as :func:`checked` does, for a function whose core takes most as given."""
    for name, test in _tests_of_function(function).items():
        test(name, arguments[name])


def checked_class(kind: type[_Class]) -> type[_Class]:
    """:func:`checked` for the arguments of the constructor; copies of what is no value share no state."""
    if not dataclasses.is_dataclass(kind):
        kind.__copy__ = copy.deepcopy  # type: ignore[attr-defined]
    kind.__init__ = checked(kind.__init__)  # type: ignore[method-assign]
    kind.__doc__ = _with_errors(kind.__doc__)
    return kind


_Test = Callable[[str, Any], None]
_Rule = tuple[Callable[[Any], bool], str]


class _RealArray:
    """Stands for ``npt.ArrayLike`` in annotations."""


_TYPING = types.SimpleNamespace(ArrayLike=_RealArray, DTypeLike=Any, NDArray=npt.NDArray)


def _tests_of(function: Callable[..., Any], names: tuple[str, ...], owner: tuple[Any, ...]) -> dict[str, _Test]:
    known: dict[str, Any] = {}
    if owner and names[0] == "self":  # inherited fields are annotated in the names of their own module
        for base in reversed(type(owner[0]).__mro__):
            known |= vars(sys.modules[base.__module__])
    known |= getattr(inspect.unwrap(function), "__globals__", {}) | {"npt": _TYPING}
    hints = typing.get_type_hints(function, known, include_extras=True)
    return {name: _test_of(hints.get(name, Any)) for name in names}


def _test_of(hint: Any) -> _Test:
    rule = _rule_of(hint)
    if rule is None:
        return lambda name, value: None
    fits, text = rule
    by_value = _is_by_value(hint)
    accepted: set[type] = set()  # types of which every value fits

    def test(name: str, value: Any) -> None:
        kind = type(value)
        if kind in accepted:
            return
        if not fits(value):
            got = f"dtype {value.dtype}" if isinstance(value, np.ndarray) else shown(value)
            if np.ma.is_masked(value):
                got = "a masked array"
            raise ValueError(f"{name}: got {got}, allowed: {text}")
        if not by_value and kind not in _EXAMINED and (kind in _ALIKE or kind.__module__.startswith("ocisac_fast")):
            accepted.add(kind)

    return test


def _rule_of(hint: Any) -> _Rule | None:
    """A predicate and its description; None where every value is accepted."""
    origin, inner = typing.get_origin(hint), typing.get_args(hint)
    if origin in (typing.Union, types.UnionType):
        return _any_of([_rule_of(option) for option in inner])
    if origin is Annotated:
        return _in_range(*inner)
    if hint in _SIMPLE:
        return _SIMPLE[hint]
    if origin is Literal:
        kinds = tuple({type(option) for option in inner})
        return (lambda value: isinstance(value, kinds) and value in inner), one_of(map(repr, inner))
    if origin is np.ndarray:
        return (lambda value: isinstance(value, (np.ndarray, np.floating)) and _is_real(np.asanyarray(value))), _NUMPY
    if origin is os.PathLike:
        return (lambda value: isinstance(value, os.PathLike)), "a path"
    if origin is tuple and inner and Ellipsis not in inner:
        return _each(inner)
    if origin in (list, Sequence, Iterable) or (origin is tuple and inner):
        return _sequence_of(inner[0], origin is Iterable)
    if origin is Callable:
        return callable, "a function"
    if origin is Mapping:
        return (lambda value: isinstance(value, Mapping)), "a dictionary"
    if inspect.isclass(hint) and hint.__module__.startswith("ocisac_fast"):
        return (lambda value: isinstance(value, hint)), f"a {hint.__name__}"
    return None


def _is_by_value(hint: Any) -> bool:
    return typing.get_origin(hint) in (Annotated, Literal) or any(map(_is_by_value, typing.get_args(hint)))


def _in_range(kind: Any, span: Within) -> _Rule:
    fits, _ = _SIMPLE[kind]
    text = f"a {'whole' if kind is int else 'finite'} number{span}" if span.high == math.inf else str(span)
    return (lambda value: fits(value) and float(value) in span), text


def _any_of(rules: list[_Rule | None]) -> _Rule | None:
    known = [rule for rule in rules if rule is not None]
    if len(known) < len(rules):
        return None
    return (lambda value: any(fits(value) for fits, _ in known)), one_of(text for _, text in known)


def _each(options: tuple[Any, ...]) -> _Rule | None:
    """Of a tuple whose items have types of their own."""
    rules = [_rule_of(option) or _TRUE for option in options]
    kind = "numbers" if set(options) <= {float, int, Finite} else f"values, each {rules[0][1]}"

    def fits(value: Any) -> bool:
        return _is_sized(value) and len(value) == len(rules) and all(map(_fit, rules, value))

    return fits, f"{len(rules)} {kind}"


def _fit(rule: _Rule, value: Any) -> bool:
    return rule[0](value)


def _sequence_of(option: Any, once: bool) -> _Rule | None:
    if option in (float, int):
        return (lambda value: _is_sized(value) and is_real_array(value) and np.ndim(value) == 1), "numbers"
    rule = _rule_of(option) or _TRUE
    if once:  # iterators end: their items are checked where they are used
        return (
            lambda value: isinstance(value, Iterator) or (_is_sized(value) and all(rule[0](each) for each in value))
        ), f"an iterable, each {rule[1]}"
    return (lambda value: _is_sized(value) and all(rule[0](each) for each in value)), f"a sequence, each {rule[1]}"


def _is_sized(value: Any) -> bool:
    """True for sequences and arrays with a dimension; texts and sets are none."""
    if isinstance(value, np.ndarray):
        return value.ndim > 0
    return isinstance(value, Sequence) and not isinstance(value, (str, bytes))


def _is_number(value: Any) -> bool:
    if isinstance(value, int):
        return -_LARGEST <= value <= _LARGEST
    if isinstance(value, _NUMBERS):
        return True
    return isinstance(value, np.ndarray) and value.ndim == 0 and value.dtype.kind in "uif"


def _is_whole(value: Any) -> bool:
    return isinstance(value, _WHOLE) and not isinstance(value, bool) and -(2**63) <= int(value) < 2**63


def parsed_json(text: str | bytes) -> Any:
    """The value of a JSON text.

    Raises:
        ValueError: no JSON, or nested more deeply than Python's parser follows.
    """
    try:
        return json.loads(text)
    except RecursionError:
        raise ValueError("lists or objects nested too deeply") from None


def is_real_array(value: Any) -> bool:
    """True for what NumPy converts to real numbers of which none is masked."""
    try:
        return _is_real(value if isinstance(value, np.ndarray) else np.asarray(value))
    except (TypeError, ValueError, OverflowError):  # ragged, an object that is no array
        return False


def _is_real(array: npt.NDArray[Any]) -> bool:
    if array.dtype.kind not in "buif":
        return False
    return type(array) is np.ndarray or not np.ma.is_masked(array)


_ALIKE = {float, bool, str, type(None)}  # the rules treat all their values alike
_EXAMINED = {np.ndarray, int}  # each value is examined
_NUMPY = "a NumPy array of real numbers"
_LARGEST = int(np.finfo(np.float64).max)
_TRUE: _Rule = (lambda value: True), "any value"
_SIMPLE: dict[Any, _Rule] = {
    float: (_is_number, "a number"),
    int: (_is_whole, "a whole number"),
    bool: ((lambda value: isinstance(value, (bool, np.bool_))), "True or False"),
    str: ((lambda value: isinstance(value, str)), "a text"),
    bytes: ((lambda value: isinstance(value, bytes)), "bytes"),
    type(None): ((lambda value: value is None), "None"),
    _RealArray: (is_real_array, "real numbers"),
}
