"""Figures with their limits, as a table or as JSON."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence
from typing import Any


@dataclasses.dataclass(frozen=True)
class Figure:
    """A measured figure, with its limit if it has one.

    undisturbed: of a ratio of times, that of the fastest tenth of both calls; the difference shows other load.
    """

    name: str
    value: float
    unit: str = ""
    limit: float | None = None
    at_most: bool = True
    milliseconds: float | None = None
    undisturbed: float | None = None

    @property
    def reached(self) -> bool | None:
        """True if the limit is reached; None without a limit."""
        if self.limit is None:
            return None
        return bool(self.value <= self.limit if self.at_most else self.value >= self.limit)

    def record(self) -> dict[str, Any]:
        """For JSON."""
        return {**dataclasses.asdict(self), "reached": self.reached}


def print_table(figures: Sequence[Figure]) -> None:
    """Print a table."""
    width = max(len(figure.name) for figure in figures)
    for f in figures:
        limit = "" if f.limit is None else f"{'at most' if f.at_most else 'at least'} {f.limit:g}"
        verdict = {None: "", True: "reached", False: "NOT REACHED"}[f.reached]
        took = "" if f.milliseconds is None else f"{f.milliseconds:8.3f} ms"
        best = "" if f.undisturbed is None else f"({f.undisturbed:.2f})"
        value = f"{f.value:7.2f}" if f.unit else f"{f.value:7.4g}"
        print(f"{f.name:{width}}  {value} {best:>8} {f.unit:3}  {took:11}  {limit:13}  {verdict}", flush=True)


def missed(figures: Iterable[Figure]) -> bool:
    """True where a limit is not reached."""
    return any(figure.reached is False for figure in figures)
