"""Conversion of the caller's arrays to the arrays that the core reads."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from ocisac_fast import _core
from ocisac_fast.core.checks import shown
from ocisac_fast.core.regions import Region

Columns = npt.NDArray[Any]
Float64s = npt.NDArray[np.float64]

_MAX_UINT16 = 65535
_COLOURS = 4  # maximum number of colours of a picture
_KINDS = {np.dtype(np.uint8), np.dtype(np.uint16), np.dtype(np.float32), np.dtype(np.float64)}


def as_columns(columns: npt.ArrayLike, *, name: str = "columns", scan_axis: str = "y") -> Columns:
    """Return an array that the core can view; it shares the caller's memory where type and alignment allow.

    Args:
        columns: (rows,), (rows, columns) or (frames, rows, columns), rows in time order, no empty dimension.
            uint8, uint16, float32 and float64 with any strides are not copied; foreign byte order and unaligned memory
            are. Other integers are read as uint16, whose white level counts, where all fit; else, as all other real
            types, as float64, which has no level of saturation.
        name: the argument's name in messages.
        scan_axis: ``scan_axis`` of the camera. The result is a view with rows in time order along axis -2; a (rows,)
            array is already in time order.

    Raises:
        ValueError: not a real-valued array of 1 to 3 dimensions, or without rows or columns.
    """
    array = columns if type(columns) is np.ndarray else _as_array(columns, name)
    if not _core.is_viewable(array):
        array = _viewable_copy(array, name)
    if not _is_axis(scan_axis):
        raise ValueError(f"scan_axis: got {shown(scan_axis)}, allowed: y, -y, x, -x")
    return array if scan_axis == "y" else in_time_order(array, scan_axis)


def _viewable_copy(array: Columns, name: str) -> Columns:
    if array.dtype.kind not in "buif":
        raise ValueError(f"{name}: got dtype {array.dtype}, allowed: real numbers (uint8, uint16, float32, float64)")
    if not 1 <= array.ndim <= 3:
        raise ValueError(
            f"{name}: got {array.ndim} dimensions, allowed: (rows,), (rows, columns) or (frames, rows, columns)"
        )
    if array.size == 0:
        raise ValueError(f"{name}: got shape {array.shape}, allowed: at least one frame, row and column")
    return np.array(array, dtype=_read_type(array))


def _read_type(array: Columns) -> np.dtype[Any]:
    """The type in which the core reads an array's values: each is kept, and integers stay integers where they fit."""
    native = array.dtype.newbyteorder("=")
    if native in _KINDS:
        return native
    fits = native.kind in "ui" and array.min() >= 0 and array.max() <= _MAX_UINT16
    return np.dtype(np.uint16 if fits else np.float64)


def _as_array(values: npt.ArrayLike, name: str) -> npt.NDArray[Any]:
    try:
        array = np.asarray(values)
    except ValueError:  # rows of different lengths
        raise ValueError(f"{name}: got {shown(values)}, allowed: rows of one length") from None
    if np.ma.is_masked(values):
        raise ValueError(f"{name}: got masked values, allowed: an array without them")
    return array


def as_frames(frames: npt.ArrayLike, name: str = "frames", scan_axis: str = "y", *, single: bool = False) -> Columns:
    """Return (frames, rows, columns, colours) with rows in time order; a view where the core can read one.

    Args:
        frames: (rows,), (rows, columns), (frames, rows, columns) or (frames, rows, columns, colours). Three dimensions
            with a last one of 3 or 4 are ambiguous (one colour picture or a stack of grey frames) and are rejected.
        name: the argument's name in messages.
        scan_axis: ``scan_axis`` of the camera.
        single: accept one frame only; (rows, columns, colours) with at most 4 colours is then unambiguous.

    Raises:
        ValueError: a wrong shape or type; the message gives the unambiguous form.
    """
    array = np.asarray(frames)
    shape = array.shape
    is_several = (array.ndim == 4 and shape[0] != 1) or (array.ndim == 3 and shape[2] > _COLOURS and shape[0] != 1)
    if single and (array.ndim > 4 or is_several):
        raise ValueError(
            f"{name}: got shape {shape}, allowed: one frame, (rows,), (rows, columns) or (rows, columns, colours)"
        )
    if array.ndim == 3 and shape[2] <= _COLOURS and single:
        array = array[np.newaxis]
    elif array.ndim == 3 and shape[2] in (3, 4):
        raise ValueError(
            f"{name}: got shape {shape}, allowed: {name}[np.newaxis] for one picture of {shape[2]} colours, or "
            f"{name}[..., np.newaxis] for grey frames of {shape[2]} columns"
        )
    if array.ndim == 4:
        if array.size == 0:
            raise ValueError(f"{name}: got shape {array.shape}, allowed: at least one frame, row, column and colour")
        if array.dtype.kind not in "buif":
            as_columns(array[0], name=name)  # refuses it
        read_type = _read_type(array)
        has_whole_strides = all(stride % array.itemsize == 0 for stride in array.strides)
        if read_type != array.dtype or not array.flags.aligned or not has_whole_strides:
            array = np.array(array, dtype=read_type)
    else:
        array = as_columns(array, name=name)
        array = array.reshape((1, -1, 1)) if array.ndim == 1 else array
        array = (array[np.newaxis] if array.ndim == 2 else array)[..., np.newaxis]
    if scan_axis == "y" or len(shape) == 1:
        return array
    return np.moveaxis(in_time_order(np.moveaxis(array, -1, 1), scan_axis), 1, -1)


def as_grey_frames(
    frames: npt.ArrayLike, name: str = "frames", scan_axis: str = "y", *, single: bool = False
) -> Columns:
    """Return (frames, rows, columns) of one colour; arguments as in :func:`as_frames`."""
    stack = as_frames(frames, name, scan_axis, single=single)
    if stack.shape[3] != 1:
        raise ValueError(f"{name}: got {stack.shape[3]} colours, allowed: one of them, {name}[..., colour]")
    return stack[..., 0]


def split_colours(stack: Columns, colour: int | None) -> list[Columns]:
    """Split (frames, rows, columns, colours) into (frames, rows, columns) of each colour, or of ``colour`` alone."""
    if colour is None:
        return [stack[..., index] for index in range(stack.shape[3])]
    if not 0 <= colour < stack.shape[3]:
        raise ValueError(f"colour: got {colour}, allowed: 0 to {stack.shape[3] - 1}")
    return [stack[..., colour]]


def _is_axis(value: Any) -> bool:
    return isinstance(value, str) and value in ("y", "-y", "x", "-x")


def in_time_order(array: Columns, scan_axis: str) -> Columns:
    """View (..., height, width) as stored with rows in time order along axis -2; (rows,) is unchanged."""
    if array.ndim < 2:
        return array
    view = array.swapaxes(-1, -2) if scan_axis.endswith("x") else array
    return view[..., ::-1, :] if scan_axis.startswith("-") else view


def in_stored_order(array: Columns, scan_axis: str) -> Columns:
    """The inverse of :func:`in_time_order`."""
    if array.ndim < 2:
        return array
    view = array[..., ::-1, :] if scan_axis.startswith("-") else array
    return view.swapaxes(-1, -2) if scan_axis.endswith("x") else view


def stored_box(box: Region, shape: tuple[int, ...], scan_axis: str) -> Region:
    """Convert a region with rows in time order to pixels as stored.

    ``shape``: rows and columns in time order.
    """
    column, row, columns, rows = box
    first = shape[0] - row - rows if scan_axis.startswith("-") else row
    return Region(first, column, rows, columns) if scan_axis.endswith("x") else Region(column, first, columns, rows)


def box_in_time_order(box: Region, shape: tuple[int, ...], scan_axis: str) -> Region:
    """The inverse of :func:`stored_box`; ``shape`` is in time order too."""
    x, y, width, height = (box[1], box[0], box[3], box[2]) if scan_axis.endswith("x") else box
    return Region(x, shape[0] - y - height if scan_axis.startswith("-") else y, width, height)
