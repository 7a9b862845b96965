"""Scenes as TOML files: the keys are the arguments of the classes, a `kind` names the class where there is a choice.

Poses are written as `position` and `rotation` of their object.
"""

from __future__ import annotations

import dataclasses
import os
import re
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ocisac_fast.camera.camera import Camera
from ocisac_fast.light.waveforms import Chips, Constant, Product, Samples, SquareWave, Sum, Tone
from ocisac_fast.scene.description import Ambient, Scene, Sensor
from ocisac_fast.scene.geometry import Disc, Pinhole, Pose, Rectangle, Ring
from ocisac_fast.scene.objects import Cosine, Grating, Mask, PathLoss, Picture, Plain, Source, Surface

Kinds = Mapping[str, Callable[..., Any]]
Keys = tuple[str | int, ...]

_SHAPES: Kinds = {"rectangle": Rectangle, "disc": Disc, "ring": Ring}
_PATTERNS: Kinds = {"plain": Plain, "cosine": Cosine, "grating": Grating, "picture": Picture}
_WAVEFORMS: Kinds = {
    "constant": Constant,
    "tone": Tone,
    "square": SquareWave,
    "chips": Chips,
    "samples": Samples,
    "sum": Sum,
    "product": Product,
}
_CHOICES: dict[str, Kinds] = {"shape": _SHAPES, "pattern": _PATTERNS, "waveform": _WAVEFORMS, "parts": _WAVEFORMS}
_NAMES = {maker: name for kinds in _CHOICES.values() for name, maker in kinds.items()}
_TABLES: Kinds = {"camera": Camera, "lens": Pinhole, "sensor": Sensor, "ambient": Ambient}
_LISTS: Kinds = {"sources": Source, "surfaces": Surface, "masks": Mask}


class SceneFileError(ValueError):
    """A file that does not describe a scene; says the file, the line and the key."""


class _BadKey(ValueError):
    def __init__(self, keys: Keys, problem: str) -> None:
        super().__init__(problem)
        self.keys = keys
        self.problem = problem


def load_scene(path: str | os.PathLike[str]) -> Scene:
    """A scene from a TOML file.

    Raises:
        SceneFileError: a ValueError: not TOML, unknown or missing keys, bad values; names the file, line and key.
        OSError: the file cannot be read.
    """
    if sys.version_info >= (3, 11):
        import tomllib
    else:
        import tomli as tomllib
    text = Path(path).read_text(encoding="utf-8")
    try:
        return _scene(tomllib.loads(text), Path(path).parent)
    except tomllib.TOMLDecodeError as error:
        raise SceneFileError(f"{os.fspath(path)}: {error}") from error
    except _BadKey as error:
        line = _line_of(text, error.keys)
        raise SceneFileError(f"{os.fspath(path)}:{line}: {_dotted(error.keys)}: {error.problem}") from error


def save_scene(scene: Scene, path: str | os.PathLike[str]) -> None:
    """Writes a scene to a TOML file that `load_scene` reads; what has its default value is left out.

    Raises:
        ImportError: tomli-w is not there: pip install 'ocisac-fast[scene]'.
        OSError: the file cannot be written.
    """
    import tomli_w

    from ocisac_fast.files import atomic_path

    tables = {name: _plain(getattr(scene, name)) for name in _TABLES}
    lists = {name: [_plain(item) for item in getattr(scene, name)] for name in _LISTS}
    held = {name: value for name, value in {**tables, **lists}.items() if value}
    with atomic_path(path) as temporary:
        temporary.write_text(tomli_w.dumps(held), encoding="utf-8")


def _dotted(keys: Keys) -> str:
    return "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in keys).lstrip(".")


def _line_of(text: str, keys: Keys) -> int:
    """Line of a key, or of the table that lacks it: the first after its table's header that has the name."""
    lines = text.splitlines()
    counts: dict[str, int] = {}
    section: Keys = ()
    best, depth = 1, -1
    for number, line in enumerate(lines, 1):
        header = re.match(r"\s*\[(\[?)\s*([\w.\-\s]+?)\s*\]", line)
        if header:
            names: Keys = tuple(name.strip() for name in header[2].split("."))
            if header[1]:
                counts[header[2]] = counts.get(header[2], -1) + 1
            # a list's header, or a table within the list's last item
            head = str(names[0])
            section = (head, counts[head], *names[1:]) if head in counts else names
        if section != keys[: len(section)]:
            continue
        found = len(section) if header else -1
        for place in range(len(section), len(keys)):
            key = keys[place]
            if isinstance(key, str) and re.search(rf"(^|[{{,\s]){re.escape(key)}\s*=", line):
                found = place + 1
            elif isinstance(key, str) and place >= depth:
                break  # an inner key counts only after those around it
        if found > depth:
            best, depth = number, found
    return best


def _scene(document: dict[str, Any], folder: Path) -> Scene:
    values: dict[str, Any] = {}
    for name, value in document.items():
        if name in _TABLES:
            values[name] = _made(_TABLES[name], value, (name,), folder)
        elif name in _LISTS:
            if not isinstance(value, list):
                raise _BadKey((name,), f"got a table, allowed: a list, [[{name}]]")
            values[name] = [_made(_LISTS[name], item, (name, index), folder) for index, item in enumerate(value)]
        else:
            raise _BadKey((name,), f"unknown key, allowed: {', '.join([*_TABLES, *_LISTS])}")
    for name in ("lens", "camera", "sensor"):
        if name not in values:
            raise _BadKey((name,), "missing")
    try:
        return Scene(**values)
    except ValueError as error:
        raise _of_argument(error, ()) from error


def _of_argument(error: ValueError, keys: Keys) -> _BadKey:
    """An error "argument: got ..." at the argument's key."""
    name, _, problem = str(error).partition(": ")
    parts = re.findall(r"\w+", name) if re.fullmatch(r"[\w.\[\]]+", name) else []
    own = tuple(int(part) if part.isdigit() else part for part in parts)
    if own == ("exposure",) and not keys:
        own = ("camera", "exposure")
    return _BadKey((*keys, *own), problem) if own else _BadKey(keys, str(error))


def _fields(maker: Callable[..., Any]) -> dict[str, dataclasses.Field[Any]]:
    if maker in (Sum, Product):
        held = {item.name: item for item in dataclasses.fields(maker)}
        return {"parts": held["parts"]}
    return {item.name: item for item in dataclasses.fields(maker) if item.init}  # type: ignore[arg-type]


def _made(maker: Callable[..., Any], table: Any, keys: Keys, folder: Path) -> Any:
    """An object from its table."""
    if not isinstance(table, dict):
        raise _BadKey(keys, f"got {table!r}, allowed: a table")
    fields = _fields(maker)
    posed = "pose" in fields
    allowed = [name for name in fields if name != "pose"] + (["position", "rotation"] if posed else [])
    if maker is Picture:
        allowed.append("file")
    values: dict[str, Any] = {}
    for name, value in table.items():
        if name not in allowed:
            raise _BadKey((*keys, name), f"unknown key, allowed: {', '.join(allowed)}")
        values[name] = _value(fields.get(name), name, value, (*keys, name), folder)
    if posed:
        pose = {name: values.pop(name) for name in ("position", "rotation") if name in values}
        try:
            values["pose"] = Pose(**pose)
        except ValueError as error:
            raise _of_argument(error, keys) from error
    if "file" in values:
        values["levels"] = values.pop("file")
    for name, item in fields.items():
        if item.default is dataclasses.MISSING and item.default_factory is dataclasses.MISSING and name not in values:
            if maker is Chips or maker is Samples:
                continue  # their own defaults
            raise _BadKey((*keys, name), "missing")
    try:
        return maker(**values)
    except ValueError as error:
        raise _of_argument(error, keys) from error
    except TypeError as error:
        raise _BadKey(keys, str(error)) from error


def _value(item: dataclasses.Field[Any] | None, name: str, value: Any, keys: Keys, folder: Path) -> Any:
    if name == "parts" and isinstance(value, list):
        return [_choice(name, part, (*keys, index), folder) for index, part in enumerate(value)]
    if name in _CHOICES:
        return _choice(name, value, keys, folder)
    if name == "path_loss":
        return _made(PathLoss, value, keys, folder)
    if name == "file":
        return _picture(value, keys, folder)
    kind = str(item.type) if item else "list"
    numeric = isinstance(value, (int, float)) and not isinstance(value, bool)
    if kind in ("float", "float | None") and not numeric:
        raise _BadKey(keys, f"got {value!r}, allowed: a number")
    if kind == "str" and not isinstance(value, str):
        raise _BadKey(keys, f"got {value!r}, allowed: a string")
    return value


def _choice(name: str, table: Any, keys: Keys, folder: Path) -> Any:
    kinds = _CHOICES[name]
    if not isinstance(table, dict) or table.get("kind") not in kinds:
        got = table.get("kind") if isinstance(table, dict) else table
        raise _BadKey((*keys, "kind"), f"got {got!r}, allowed: {', '.join(kinds)}")
    rest = {key: value for key, value in table.items() if key != "kind"}
    return _made(kinds[table["kind"]], rest, keys, folder)


def _picture(name: Any, keys: Keys, folder: Path) -> Any:
    """Grey levels of a picture file beside the scene, 0 to 1, as they are stored."""
    from ocisac_fast.files.extras import pillow

    if not isinstance(name, str):
        raise _BadKey(keys, f"got {name!r}, allowed: the name of a picture")
    try:
        with pillow().open(folder / name) as picture:
            return np.asarray(picture.convert("L"), np.float64) / 255
    except OSError as error:
        raise _BadKey(keys, f"got {name!r}: {error}") from error


def _plain(item: Any) -> Any:
    """An object as TOML has it."""
    if isinstance(item, np.ndarray):
        return item.tolist()
    if isinstance(item, tuple):
        return [_plain(part) for part in item]
    if not dataclasses.is_dataclass(item):
        return item
    maker: Any = type(item)
    table: dict[str, Any] = {"kind": _NAMES[maker]} if maker in _NAMES else {}
    for name, field in _fields(maker).items():
        value = getattr(item, name)
        if value is None or (field.default is not dataclasses.MISSING and _same(value, field.default)):
            continue
        if name == "pose":
            table |= {key: list(getattr(value, key)) for key in ("position", "rotation") if any(getattr(value, key))}
        else:
            table[name] = _plain(value)
    return table


def _same(value: Any, default: Any) -> bool:
    return type(value) is type(default) and bool(value == default)
