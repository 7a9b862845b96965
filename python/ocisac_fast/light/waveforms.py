"""Light over time and the light that the rows of a rolling shutter integrate."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable
from dataclasses import KW_ONLY, dataclass, fields
from operator import add, mul
from typing import Any, ClassVar, TypeVar

import numpy as np
import numpy.typing as npt

from ocisac_fast import _core
from ocisac_fast.camera.camera import Camera
from ocisac_fast.core.checks import checked, checked_class, shown

_MAX_VALUES = 2**28


def _as_levels(values: npt.ArrayLike, name: str) -> npt.NDArray[np.float64]:
    """A read-only copy in float64."""
    array = np.asarray(values)
    if array.ndim != 1 or array.size == 0:
        raise ValueError(f"{name}: got shape {array.shape}, allowed: one dimension, at least one level")
    levels = array.astype(np.float64)
    levels.flags.writeable = False
    return levels


def _comparable(value: object) -> object:
    return tuple(value.tolist()) if isinstance(value, np.ndarray) else value


class Waveform:
    """Light over time: immutable base class of all waveforms; ``+`` and ``*`` accept waveforms and numbers."""

    _handle: _core.Waveform
    _made: ClassVar[Callable[..., _core.Waveform]]  # of the arguments; of two parts for a combination
    __array_ufunc__ = None  # NumPy leaves the operators to this class

    def __init__(self) -> None:
        raise TypeError("Waveform: got the base class, allowed: Tone, SquareWave and other waveforms")

    def __post_init__(self) -> None:
        object.__setattr__(self, "_handle", self._made(*self._values().values()))

    def _take(self, **values: object) -> None:
        for name, value in values.items():
            object.__setattr__(self, name, value)

    def _values(self) -> dict[str, Any]:
        """The arguments that construct this waveform."""
        return {item.name: getattr(self, item.name) for item in fields(self)}  # type: ignore[arg-type]

    def __eq__(self, other: object) -> bool:
        if type(self) is not type(other):
            return NotImplemented
        assert isinstance(other, Waveform)
        return all(
            _comparable(a) == _comparable(b)
            for a, b in zip(self._values().values(), other._values().values(), strict=True)
        )

    def __hash__(self) -> int:
        return hash((type(self), *map(_comparable, self._values().values())))

    def __reduce__(self) -> tuple[Callable[[], Waveform], tuple[()]]:
        return functools.partial(type(self), **self._values()), ()

    def __add__(self, other: Waveform | float) -> Waveform:
        return _combined(Sum, self, other)

    def __radd__(self, other: Waveform | float) -> Waveform:
        return _combined(Sum, other, self)

    def __mul__(self, other: Waveform | float) -> Waveform:
        return _combined(Product, self, other)

    def __rmul__(self, other: Waveform | float) -> Waveform:
        return _combined(Product, other, self)


@checked_class
@dataclass(frozen=True, eq=False)
class Constant(Waveform):
    """Steady light of the given level.

    Args:
        level: finite, within 1e100 of 0.
    """

    level: float
    _made = staticmethod(_core.constant)


@checked_class
@dataclass(frozen=True, eq=False)
class Tone(Waveform):
    """A raised cosine: amplitude * (1/2 + depth/2 * cos(2 pi frequency t + phase)), eq. 5 of the paper.

    Args:
        frequency: Hz, 0 (steady light) or above.
        amplitude: the light at the maximum for depth 1; finite, within 1e100 of 0.
        phase: rad at t = 0, finite.
        depth: 0 (steady) to 1 (dark at the minimum).
    """

    frequency: float
    _: KW_ONLY
    amplitude: float = 1.0
    phase: float = 0.0
    depth: float = 1.0
    _made = staticmethod(_core.tone)


@checked_class
@dataclass(frozen=True, eq=False)
class SquareWave(Waveform):
    """A square or PWM wave: bright where frequency * t + phase / (2 pi) is within duty/2 of a whole number, else 0.

    A pulse is centred where the tone of the same phase has its maximum: the fundamental is a positive multiple of
    cos(2 pi frequency t + phase) for any duty.

    Args:
        frequency: Hz, 0 or above.
        duty: bright share of a period, above 0 and below 1.
        amplitude: the light of a pulse; finite, within 1e100 of 0.
        phase: rad at t = 0, finite.
    """

    frequency: float
    _: KW_ONLY
    duty: float = 0.5
    amplitude: float = 1.0
    phase: float = 0.0
    _made = staticmethod(_core.square_wave)


@checked_class
@dataclass(frozen=True, eq=False)
class TriangleWave(Waveform):
    """A triangle wave, such as the ripple of an LED driver: amplitude * (1/2 + depth/2 * (1 - 4 distance)).

    distance: of frequency * t + phase / (2 pi) to the nearest whole number, 0 to 1/2. The maximum is where the tone of
    the same phase has it; the fundamental is 8/pi^2 of that tone's.

    Args:
        frequency: Hz, 0 (steady light) or above.
        amplitude: the light at the maximum for depth 1; finite, within 1e100 of 0.
        phase: rad at t = 0, finite.
        depth: 0 (steady) to 1 (dark at the minimum).
    """

    frequency: float
    _: KW_ONLY
    amplitude: float = 1.0
    phase: float = 0.0
    depth: float = 1.0
    _made = staticmethod(_core.triangle_wave)


@checked_class
@dataclass(frozen=True, eq=False)
class Chips(Waveform):
    """Chips (on-off keying, PAM): amplitude * levels[k] during [start + k/chip_rate, start + (k + 1)/chip_rate).

    Args:
        levels: (chips,) finite, at least one, within 1e100 of 0; or a string of 0 and 1.
            Kept as a read-only float64 copy.
        chip_rate: chips per second, Hz, above 0.
        start: time at which the first chip begins, s, finite.
        repeat: the chips repeat for all time; otherwise the light is 0 before the first and after the last.
        amplitude: finite, within 1e100 of 0.
        rise, fall: time constants of an LED that approaches a brighter or a darker level exponentially, in chips, 0
            (instantly) to 1000. Such chips may be multiplied by steady light only.
    """

    levels: npt.NDArray[np.float64]
    chip_rate: float
    start: float = 0.0
    repeat: bool = False
    amplitude: float = 1.0
    rise: float = 0.0
    fall: float = 0.0
    _made = staticmethod(_core.chips)

    def __init__(
        self,
        levels: str | npt.ArrayLike,
        chip_rate: float,
        *,
        start: float = 0.0,
        repeat: bool = False,
        amplitude: float = 1.0,
        rise: float = 0.0,
        fall: float = 0.0,
    ) -> None:
        if isinstance(levels, str):
            if set(levels) - {"0", "1"}:
                raise ValueError(f"levels: got {shown(levels)}, allowed: a string of 0 and 1")
            levels = [int(level) for level in levels]
        self._take(levels=_as_levels(levels, "levels"), chip_rate=chip_rate, start=start, repeat=bool(repeat))
        self._take(amplitude=amplitude, rise=rise, fall=fall)
        self.__post_init__()


@checked_class
@dataclass(frozen=True, eq=False)
class Samples(Waveform):
    """A sampled waveform: values[k] at start + k/sample_rate, linearly interpolated.

    Args:
        values: (samples,) finite, at least one, within 1e100 of 0. Kept as a read-only float64 copy.
        sample_rate: Hz, above 0.
        start: time of the first sample, s, finite.
        repeat: the samples repeat with the period len(values)/sample_rate, linear from the last to the first;
            otherwise the first and the last value hold before and after.
    """

    values: npt.NDArray[np.float64]
    sample_rate: float
    start: float = 0.0
    repeat: bool = False
    _made = staticmethod(_core.samples)

    def __init__(self, values: npt.ArrayLike, sample_rate: float, *, start: float = 0.0, repeat: bool = False) -> None:
        self._take(values=_as_levels(values, "values"), sample_rate=sample_rate, start=start, repeat=bool(repeat))
        self.__post_init__()


@dataclass(frozen=True, eq=False)
class _Combination(Waveform):
    parts: tuple[Waveform, ...]

    def __init__(self, parts: Iterable[Waveform | float]) -> None:
        held = tuple(part if isinstance(part, Waveform) else Constant(part) for part in parts)
        if not held:
            raise ValueError("parts: got none, allowed: at least one waveform")
        handles = [part._handle for part in held]
        while len(handles) > 1:  # pairwise, to avoid quadratic copying in long sums
            pairs = zip(handles[::2], handles[1::2], strict=False)
            handles = [self._made(a, b) for a, b in pairs] + handles[len(handles) & ~1 :]
        self._take(parts=held, _handle=handles[0])


@checked_class
class Sum(_Combination):
    """The sum of waveforms or numbers (steady light); also written ``a + b``.

    Raises:
        ValueError: no parts, or more than 4096 terms after products are expanded.
    """

    _made = staticmethod(add)


@checked_class
class Product(_Combination):
    """The product of waveforms or numbers, such as light through a filter or off a surface; also written ``a * b``.

    Raises:
        ValueError: no parts, more than 4096 terms after expansion, two factors that are Samples or TriangleWave, light
            above 1e300.
    """

    _made = staticmethod(mul)


_AnyCombination = TypeVar("_AnyCombination", Sum, Product)


def _combined(kind: type[_AnyCombination], *parts: Waveform | float) -> Waveform:
    """Flatten nested combinations of the same kind."""
    flat: list[Waveform | float] = []
    for part in parts:
        if isinstance(part, kind):
            flat.extend(part.parts)
        elif isinstance(part, (Waveform, int, float, np.integer, np.floating)):
            flat.append(part if isinstance(part, Waveform) else float(part))
        else:
            return NotImplemented
    return kind(flat)


def _as_numbers(numbers: int | npt.ArrayLike, name: str) -> npt.NDArray[np.int64]:
    """Row or frame numbers: 0 .. N-1 from N, or the array itself."""
    array = np.asarray(numbers)
    if array.dtype.kind not in "ui":
        raise ValueError(f"{name}: got {shown(numbers)}, allowed: a whole number or an array of whole numbers")
    if array.ndim == 0:
        if not 1 <= array <= _MAX_VALUES:
            raise ValueError(
                f"{name}: got {shown(numbers)}, allowed: from 1 to {_MAX_VALUES}, or an array of whole numbers"
            )
        return np.arange(int(array), dtype=np.int64)
    if array.ndim != 1 or array.size == 0:
        raise ValueError(f"{name}: got shape {array.shape}, allowed: one dimension and at least one number")
    if array.dtype.kind == "u" and array.max() > np.uint64(2**63 - 1):
        raise ValueError(f"{name}: got {array.max()}, allowed: from -2^52 to 2^52")
    return np.ascontiguousarray(array, dtype=np.int64)


def _as_out(out: npt.NDArray[Any] | None, shape: tuple[int, ...]) -> npt.NDArray[np.float64]:
    if out is None:
        return np.empty(shape)
    if out.shape != shape:
        raise ValueError(f"out: got shape {out.shape}, allowed: an array of shape {shape}")
    if out.dtype != np.float64 or not out.flags.aligned:
        raise ValueError(f"out: got dtype {out.dtype}, allowed: float64, native and aligned")
    if not out.flags.writeable:
        raise ValueError("out: got a read-only array, allowed: a writable array")
    return out


@checked
def integrate_exposure(
    waveform: Waveform,
    camera: Camera,
    rows: int | npt.ArrayLike,
    *,
    start: float = 0.0,
    frames: int | npt.ArrayLike | None = None,
    out: npt.NDArray[np.float64] | None = None,
) -> npt.NDArray[np.float64]:
    """Mean light over the exposure of each row (eq. 4 divided by A T_e, so that steady light has gain 1).

    p_n = (1/T_e) * integral of the waveform over [t_n - T_e, t_n], t_n = start + j * frame_time + n * row_time; for
    T_e = 0 the light at t_n. Evaluated by the antiderivative, without oversampling. The error is about 1e-13 of the
    waveform's amplitude for any row number, since t_n is computed in double-double.

    Args:
        waveform: the light.
        camera: gives row time, exposure and, where ``frames`` is given, frame time.
        rows: N for rows 0 .. N-1, or (rows,) whole numbers in any order, negative ones too, within 2^52.
        start: the end of the exposure of row 0 of frame 0, s, finite.
        frames: None for frame 0 alone; J for frames 0 .. J-1, or (frames,) whole numbers in any order.
        out: float64 array of the result's shape, any strides; filled and returned.

    Returns:
        float64 (rows,), or (frames, rows) where frames are given.

    Raises:
        ValueError: the camera's exposure or frame time is unknown, no rows, numbers that are not whole, an ``out``
            of wrong shape or type, or more than 2^50 cycles or chips of the waveform before or in an exposure.
    """
    row_numbers = _as_numbers(rows, "rows")
    frame_numbers = np.zeros(1, np.int64) if frames is None else _as_numbers(frames, "frames")
    if frames is not None and camera.frame_time is None:
        raise ValueError("frame_time: got None, allowed: the frame time of the camera in seconds, needed for frames")
    if row_numbers.size * frame_numbers.size > _MAX_VALUES:
        raise ValueError(f"frames: got {frame_numbers.size} of {row_numbers.size} rows, allowed: {_MAX_VALUES} values")
    shape = (frame_numbers.size, row_numbers.size)
    result = _as_out(out, shape if frames is not None else shape[1:])
    target = result if frames is not None else result[np.newaxis]
    _core.integrate_exposure(waveform._handle, camera._handle, row_numbers, start, frame_numbers, target)
    return result


@checked
def sample_waveform(waveform: Waveform, times: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """The waveform's value at given times.

    Args:
        waveform: the light.
        times: s, any shape, finite.

    Returns:
        float64 array of the shape of ``times``.

    Raises:
        ValueError: a time that is not a finite real number, or one more than 2^50 cycles or chips away.
    """
    return np.asarray(_core.sample_waveform(waveform._handle, np.asarray(times)), dtype=np.float64)
