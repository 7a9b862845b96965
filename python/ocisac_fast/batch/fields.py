"""Columns of the tables: those of ``--json``, with types, units and meanings."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from ocisac_fast.cli.pictures import PictureOptions
from ocisac_fast.files.extras import pyarrow


class Field(NamedTuple):
    """A column. ``kind``: an Arrow type, a list of one (``[string]``), or the fields of a list of objects."""

    name: str
    kind: str | tuple[Field, ...]
    unit: str
    text: str


def _tone(prefix: str = "") -> tuple[Field, ...]:
    return (
        Field(f"{prefix}frequency_hz", "float64", "Hz", "frequency"),
        Field(f"{prefix}frequency_std_hz", "float64", "Hz", "its standard error; null for a given frequency"),
        Field(f"{prefix}gain", "float64", "", "normalised gain"),
        Field(f"{prefix}gain_std", "float64", "", "its standard error"),
    )


_BOX = (
    Field("x", "int64", "px", "left edge in the stored picture"),
    Field("y", "int64", "px", "top edge in the stored picture"),
    Field("width", "int64", "px", "width"),
    Field("height", "int64", "px", "height"),
)
_SNR = Field("snr_db", "float64", "dB", "signal-to-noise ratio")
_MEAN = Field("mean", "float64", "DN", "mean light above dark and background")
_FLAGS = Field("flags", "[string]", "", "names of `ocisac_fast.Flag`")
_FRAME = Field("frame", "int64", "", "index of the frame, from 0")
_AXIS = Field("scan_axis", "string", "", "direction in which rows are read, given or found")
_SIZE = (
    Field("rows", "int64", "", "rows of the camera in the picture"),
    Field("columns", "int64", "", "columns used"),
)
_THEORY = Field("theory", "float64", "", "\\|sinc(f T_e)\\|")
_PHASE = Field("phase_rad", "float64", "rad", "phase of the light at the end of row 0's exposure")
_GIVEN = Field("background_given", "bool", "", "true if a background was given")

_LIGHT = (
    *_BOX,
    Field("probability", "float64", "", "probability that it is a light"),
    *_tone(),
    _PHASE,
    _MEAN,
    _SNR,
    Field("carries_data", "bool", "", "true if its period is not constant"),
    Field("reflection_of", "int64", "", "index of the light that it reflects"),
    Field("reason", "string", "", "why it is a reflection or a merged light"),
    _FLAGS,
    Field("light", "int64", "", "its number: in a frame here, in the recording by `ocisac detect`"),
    Field("searched", "bool", "", "true if the whole frame was searched, false if lights were followed"),
)

_REGION = (
    *_BOX,
    Field("kind", "string", "", "light, moving, still or unknown"),
    Field("frequency_hz", "float64", "Hz", "frequency in a column"),
    Field("frequency_std_hz", "float64", "Hz", "its standard error"),
    Field("motion_frequency_hz", "float64", "Hz", "f_x v"),
    Field("motion_frequency_std_hz", "float64", "Hz", "its standard error"),
    Field("motion_candidates_hz", "[float64]", "Hz", "all values of f_x v that fit"),
    Field("direction", "int64", "", "+1 with the read-out, −1 against it, 0 unknown"),
    Field("gain", "float64", "", "contrast gain, eq. 16"),
    Field("gain_std", "float64", "", "its standard error"),
    Field("frames_gain", "float64", "", "the same from the course over the frames"),
    Field("frames_gain_std", "float64", "", "its standard error"),
    _THEORY,
    Field("contrast", "float64", "", "amplitude of the fundamental over the mean"),
    Field("contrast_range", "float64", "", "(max − min)/(max + min) of the fitted rows"),
    _MEAN,
    _GIVEN,
    Field("speed_m_s", "float64", "m/s", "speed perpendicular to the stripes"),
    Field("speed_std_m_s", "float64", "m/s", "its standard error"),
    Field("spatial_frequency_per_m", "float64", "1/m", "spatial frequency along the motion"),
    Field("spatial_frequency_std_per_m", "float64", "1/m", "its standard error"),
    Field("cycles_per_column", "float64", "", "cycles per column along a row, signed"),
    Field("cycles_per_frame", "float64", "", "advance from frame to frame"),
    _SNR,
    _FLAGS,
)

FIELDS: Mapping[str, tuple[Field, ...]] = {
    "gain": (
        Field("frame", "int64", "", "index of the frame, from 0; null: no tone was found"),
        *_tone(),
        _THEORY,
        _SNR,
        *_SIZE,
        _FLAGS,
        _PHASE,
        _MEAN,
        _GIVEN,
        Field("colour", "int64", "", "index of the colour used; null: there is one only"),
        _AXIS,
    ),
    "receive": (
        _FRAME,
        Field("source", "int64", "", "index of the light; 0: the strongest of the frame"),
        Field("colour", "int64", "", "index of the colour that shows the light best; null: there is one only"),
        Field("rows", "int64", "", "rows of the camera in the picture"),
        Field("region", "[int64]", "px", "x, y, width, height of the light"),
        Field("first_row", "float64", "rows", "row at which the first chip begins"),
        Field("end_row", "float64", "rows", "row at which the last chip ends"),
        Field("bits", "string", "", "chips in time order, 1 = bright"),
        Field("rows_per_chip", "float64", "rows", "rows per chip"),
        Field("chip_rate_hz", "float64", "Hz", "chips per second"),
        _SNR,
        Field("exposure_s", "float64", "s", "exposure of a row"),
        Field("error_rate", "float64", "", "expected share of wrong chips"),
        Field("outcome", "string", "", "of the frame"),
        Field("symbol", "int64", "", "index of the tone (CM-FSK)"),
        Field("tone_hz", "float64", "Hz", "the tone (CM-FSK)"),
        Field("frames_missing", "int64", "", "frames missing before this one"),
        Field("packet_outcome", "string", "", "of the packet in this frame"),
        Field("packet_blocks", "int64", "", "blocks found"),
        Field("packet_bytes", "int64", "", "bytes found"),
        Field("packet_cut", "int64", "", "bytes cut by the frame's edges"),
        Field("packet_doubtful", "int64", "", "bytes in doubt"),
        Field("packet_share", "float64", "", "share of the bytes that a payload needs"),
        Field("packet_inverted", "bool", "", "the light is dark for 1"),
        Field("packet_lack", "string", "", "what the chips lack for a payload"),
        Field("packet", "int64", "", "number of the completed packet"),
        Field("payload", "string", "", "its payload as text"),
        Field("payload_base64", "string", "", "its payload"),
        *_tone(),
        Field("gain_snr_db", "float64", "dB", "signal-to-noise ratio of the gain"),
        Field("gain_flags", "[string]", "", "flags of the gain"),
        Field("suggested_exposure_s", "float64", "s", "best exposure for this light"),
        _FLAGS,
        _AXIS,
    ),
    "detect": (
        _FRAME,
        Field("frames", "int64", "", "frames that the recording announces"),
        Field("sources", _LIGHT, "", "the lights, the most probable first"),
        _AXIS,
    ),
    "sense": (
        Field("frames", "int64", "", "frames used"),
        *_SIZE,
        Field("regions", _REGION, "", "the regions"),
        _AXIS,
    ),
    "calibrate": (
        Field("row_time_s", "float64", "s", "row time"),
        Field("row_time_std_s", "float64", "s", "its standard error"),
        Field("probability", "float64", "", "probability that the tone is a light"),
        Field("cycles", "float64", "", "cycles of the light in a frame"),
        Field("frames", "int64", "", "frames used"),
        *_SIZE,
        _FLAGS,
        _AXIS,
    ),
    "clean": (
        _FRAME,
        Field("model", "string", "", "tone, chips or rows"),
        Field("frequency_hz", "float64", "Hz", "frequency of the light"),
        Field("share", "float64", "", "share of the light that is modulated"),
        Field("toe", "float64", "", "toe of the tone curve"),
        Field("saturated", "float64", "", "share of the pixels"),
        Field("too_dark", "float64", "", "share of the pixels that could not be restored"),
        Field("light_left", "float64", "", "swing of the row light after cleaning, over that before"),
        Field("texture_change_db", "float64", "dB", "energy of texture after cleaning, over that before"),
        Field("slow_bands", "float64", "", "amplitude of bands above 128 rows that are left, over the light"),
        Field("unchanged", "string", "", "why the frame stayed as it was, or empty"),
        Field("remark", "string", "", "what is likely wrong with the result, or empty"),
        _AXIS,
        Field("cleaned", "string", "", "path of the file written"),
    ),
}
PATH = Field("path", "string", "", "path of the recording")
FAILURE = (PATH, Field("message", "string", "", "why it could not be read"))

_ROW_UNITS = {"Hz": "cycles per row", "s": "rows"}


def columns(command: str, picture: PictureOptions) -> tuple[Field, ...]:
    """Columns of a command's table; without a row time, rates are per row and times in rows."""
    found = FIELDS[command]
    return (PATH, *(found if command == "calibrate" else _in_units(found, picture)))


def _in_units(fields: Iterable[Field], picture: PictureOptions) -> tuple[Field, ...]:
    renamed = picture.in_units({field.name: field for field in fields})
    return tuple(
        field._replace(
            name=name,
            unit=field.unit if name == field.name else _ROW_UNITS[field.unit],
            kind=field.kind if isinstance(field.kind, str) else _in_units(field.kind, picture),
        )
        for name, field in renamed.items()
    )


def _type(kind: str | tuple[Field, ...]) -> Any:
    arrow = pyarrow()
    if isinstance(kind, tuple):
        return arrow.list_(arrow.struct([_arrow(field) for field in kind]))
    if kind.startswith("["):
        return arrow.list_(_type(kind[1:-1]))
    return {"int64": arrow.int64, "float64": arrow.float64, "bool": arrow.bool_, "string": arrow.string}[kind]()


def _arrow(field: Field) -> Any:
    metadata = {"unit": field.unit, "description": field.text.replace("\\", "")}
    return pyarrow().field(field.name, _type(field.kind), metadata=metadata)


def schema(fields: Iterable[Field]) -> Any:
    """Arrow schema; the metadata of each column are ``unit`` and ``description``."""
    return pyarrow().schema([_arrow(field) for field in fields])


def table(rows: Sequence[Mapping[str, Any]], fields: Sequence[Field]) -> Any:
    """Arrow table of JSON objects; a key that is no column is an error."""
    _require_known(rows, fields)
    return pyarrow().Table.from_pylist(rows, schema=schema(fields))


def _require_known(rows: Iterable[Mapping[str, Any]], fields: Iterable[Field]) -> None:
    kinds = {field.name: field.kind for field in fields}
    for row in rows:
        if unknown := set(row) - set(kinds):
            raise KeyError(f"no column for {', '.join(sorted(unknown))}")
        for name, value in row.items():
            kind = kinds[name]
            if isinstance(kind, tuple):
                _require_known(value, kind)


def documentation() -> str:
    """A table of the columns of each command, for the reference."""
    text = []
    for command, fields in FIELDS.items():
        text += [f"## {command}", "", "| column | type | unit | meaning |", "|---|---|---|---|"]
        for name, kind, unit, meaning in _flat((PATH, *fields)):
            text.append(f"| `{name}` | {kind} | {unit} | {meaning} |")
        text.append("")
    return "\n".join(text)


def _flat(fields: Iterable[Field], prefix: str = "") -> Iterable[tuple[str, str, str, str]]:
    for field in fields:
        nested = isinstance(field.kind, tuple)
        yield prefix + field.name, "[object]" if nested else str(field.kind), field.unit, field.text
        if isinstance(field.kind, tuple):
            yield from _flat(field.kind, f"{prefix}{field.name}[].")
