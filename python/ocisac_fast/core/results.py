"""Base of all results: a short text, a table in a notebook, a dictionary, a data frame."""

from __future__ import annotations

import dataclasses
import html
import itertools
import reprlib
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from ocisac_fast.core.flags import Flag, Named

if TYPE_CHECKING:
    import pandas

_WIDTH, _LINES, _VALUE = 80, 12, 48  # characters, lines, and characters of one value
_FEW = 4  # elements of an array that are shown
_MANY = 1_000_000  # elements of which the range is not sought
_SHORT = reprlib.Repr()
_SHORT.maxstring = _SHORT.maxother = _VALUE


class Result:
    """Base of frozen dataclasses that the library returns."""

    __slots__ = ()

    def __init_subclass__(cls) -> None:
        cls.__eq__, cls.__hash__ = Result.__eq__, Result.__hash__  # type: ignore[method-assign] # not for arrays

    def __eq__(self, other: object) -> bool:
        if type(other) is not type(self):
            return NotImplemented
        return all(_is_same(one, getattr(other, name)) for name, one in _fields(self))

    def __hash__(self) -> int:
        return hash((type(self), *(one for _, one in _fields(self) if isinstance(one, (str, int)))))

    def __repr__(self) -> str:
        return "\n".join(_wrapped(type(self).__name__, [f"{name}={text}" for name, text in self._shown()]))

    def _repr_html_(self) -> str:
        rows = "".join(f"<tr><th>{name}</th><td>{html.escape(text)}</td></tr>" for name, text in self._shown())
        return f"<table><caption>{type(self).__name__}</caption>{rows}</table>"

    def _shown(self) -> Iterator[tuple[str, str]]:
        for name, value in _fields(self):
            is_mask = name == "flags" and isinstance(value, np.ndarray)
            yield name, _text(Flag(int(np.bitwise_or.reduce(value, axis=None))) if is_mask else value)

    def to_dict(self) -> dict[str, Any]:
        """The attributes by name, exactly; results in them are dictionaries too, arrays are not copied."""
        return {name: _plain(value) for name, value in _fields(self)}

    def to_pandas(self) -> pandas.DataFrame:
        """A data frame; needs pandas, which is no dependency.

        Where all arrays have one shape, each element is a row (by its position) and other values are repeated; else
        there is one row, whose cells hold the arrays.
        """
        import pandas

        values = self.to_dict()
        shapes = {value.shape for value in values.values() if isinstance(value, np.ndarray)}
        if len(shapes) != 1 or shapes == {()}:
            return pandas.DataFrame([values])
        (shape,) = shapes
        positions = list(np.ndindex(*shape)) if len(shape) > 1 else range(shape[0])
        index = pandas.MultiIndex.from_tuples(positions) if len(shape) > 1 else pandas.RangeIndex(shape[0])
        columns = {
            name: value.ravel() if isinstance(value, np.ndarray) else [value] * len(positions)
            for name, value in values.items()
        }
        return pandas.DataFrame(columns, index=index)


def _fields(result: Any) -> Iterator[tuple[str, Any]]:
    for field in dataclasses.fields(result):
        if not field.name.startswith("_"):
            yield field.name, getattr(result, field.name)


def _is_same(one: Any, other: Any) -> bool:
    """True for equal values; unknown ones, NaN, are the same."""
    if isinstance(one, (list, tuple)) and type(one) is type(other):
        return len(one) == len(other) and all(map(_is_same, one, other))
    if isinstance(one, np.ndarray) or isinstance(other, np.ndarray):
        one, other = np.asarray(one), np.asarray(other)
        return one.dtype == other.dtype and np.array_equal(one, other, equal_nan=one.dtype.kind in "fc")
    return bool(one == other or (one != one and other != other))


def _plain(value: Any) -> Any:
    if isinstance(value, Result):
        return value.to_dict()
    if type(value) in (list, tuple):
        return type(value)(map(_plain, value))
    return value


def _text(value: Any) -> str:
    """A value on one line of at most 48 characters; of large arrays, texts and lists the size."""
    if isinstance(value, np.ndarray):
        return _array_text(value) if value.ndim else _text(value[()])
    if isinstance(value, (float, np.floating)):
        return f"{value:.6g}"
    if isinstance(value, Result):
        return f"{type(value).__name__}(…)"
    if type(value) in (list, tuple) and len(value) > _FEW:
        return f"{len(value)} of {type(value[0]).__name__}"
    if type(value) in (list, tuple):
        inner = ", ".join(map(_text, value))
        text = f"({inner})" if isinstance(value, tuple) else f"[{inner}]"
        return text if len(text) <= _VALUE else f"{len(value)} of {type(value[0]).__name__}"
    if isinstance(value, (str, bytes)) and len(value) > _VALUE:
        return f"{value[: _VALUE // 2]!r}… of {len(value)}"
    text = " ".join((str(value) if isinstance(value, Named) else _SHORT.repr(value)).split())
    return text if len(text) <= _VALUE else f"{text[: _VALUE - 1]}…"


def _array_text(array: np.ndarray[Any, Any]) -> str:
    if array.ndim <= 1 and array.size <= _FEW:
        return np.array2string(array, precision=6, separator=", ", max_line_width=_VALUE).replace("\n", "")
    size = "×".join(map(str, array.shape))
    has_range = array.size <= _MANY and array.dtype.kind in "uif"
    known = array[np.isfinite(array)] if has_range else array[:0]
    if known.size:
        return f"<{size} {array.dtype}, {known.min():.4g} to {known.max():.4g}>"
    return f"<{size} {array.dtype}>"


def _wrapped(name: str, texts: list[str]) -> Iterator[str]:
    """Lines of at most 80 columns: all on one where they fit, else several values a line."""
    whole = f"{name}({', '.join(texts)})"
    if len(whole) <= _WIDTH:
        yield whole
        return
    lines = [f"{name}("]
    for text, end in itertools.zip_longest(texts, [","] * (len(texts) - 1), fillvalue=")"):
        fits = len(lines) > 1 and len(lines[-1]) + len(text) + 2 <= _WIDTH
        if fits:
            lines[-1] += f" {text}{end}"
        else:
            lines.append(f"    {text}{end}")
    yield from lines if len(lines) <= _LINES else [*lines[: _LINES - 1], "    …)"]
