"""From what the caller has to what the core reads: one place for the conversion of arrays."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

Columns = npt.NDArray[Any]

_KINDS = {np.dtype(np.uint8), np.dtype(np.uint16), np.dtype(np.float32), np.dtype(np.float64)}


def as_columns(columns: npt.ArrayLike, name: str = "columns") -> Columns:
    """An array that the core can view: the caller's own memory where its type and alignment allow it.

    Args:
        columns: (rows,), (rows, columns) or (frames, rows, columns), rows in time order, none of them empty.
            uint8, uint16, float32 and float64 with any strides are taken without a copy; other real types, foreign
            byte order and unaligned memory are copied.
        name: the argument's name in messages.

    Raises:
        ValueError: not a real-valued array of 1 to 3 dimensions, or without rows or columns.
    """
    array = np.asarray(columns)
    if array.dtype.kind not in "buif":
        raise ValueError(f"{name}: got dtype {array.dtype}, allowed: real numbers (uint8, uint16, float32, float64)")
    if not 1 <= array.ndim <= 3:
        raise ValueError(
            f"{name}: got {array.ndim} dimensions, allowed: (rows,), (rows, columns) or (frames, rows, columns)"
        )
    if array.size == 0:
        raise ValueError(f"{name}: got shape {array.shape}, allowed: at least one frame, row and column")
    flags = array.flags
    if array.dtype in _KINDS and flags.aligned and (flags.c_contiguous or _whole_strides(array)):
        return array
    return np.array(array, dtype=np.float64 if array.dtype not in _KINDS else array.dtype.newbyteorder("="))


def _whole_strides(array: Columns) -> bool:
    return all(stride % array.itemsize == 0 for stride in array.strides)
