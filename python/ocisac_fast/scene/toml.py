"""Scenes as TOML files: keys are the arguments of the classes; `kind` names the class where several are possible.

`position` and `rotation` of an object define its pose.
"""

from __future__ import annotations

import dataclasses
import os
import re
import sys
import tomllib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ocisac_fast.camera.camera import Camera
from ocisac_fast.core.checks import checked, shown
from ocisac_fast.files import FileError, atomic_path
from ocisac_fast.files.pictures import grey_levels
from ocisac_fast.files.raw import read_whole
from ocisac_fast.light.waveforms import Chips, Constant, Product, Samples, SquareWave, Sum, Tone, TriangleWave
from ocisac_fast.scene.description import Ambient, Sensor
from ocisac_fast.scene.geometry import Disc, Pinhole, Pose, Rectangle, Ring
from ocisac_fast.scene.objects import Cosine, Grating, Mask, PathLoss, Picture, Plain, Source, Surface
from ocisac_fast.scene.plan import Scene

Kinds = Mapping[str, Callable[..., Any]]
Keys = tuple[str | int, ...]

_MAX_PICTURE_PIXELS = 1 << 26  # 512 MiB as float64

_SHAPES: Kinds = {"rectangle": Rectangle, "disc": Disc, "ring": Ring}
_PATTERNS: Kinds = {"plain": Plain, "cosine": Cosine, "grating": Grating, "picture": Picture}
_WAVEFORMS: Kinds = {
    "constant": Constant,
    "tone": Tone,
    "square": SquareWave,
    "triangle": TriangleWave,
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
    """A file that does not describe a scene; the message names file, line and key."""


@dataclasses.dataclass(frozen=True)
class _Folder:
    """Folder of a scene's pictures, and those that were read."""

    path: Path
    any_folder: bool
    read: list[Path] = dataclasses.field(default_factory=list)


# Separators of a dotted key, terminators, and tokens whose dots are not separators: strings and comments.
_KEY_TOKEN = re.compile(r"""#[^\n]*|"(?:[^"\\\n]|\\.)*"|'[^'\n]*'|[.,\[\]{}=\n]""")
_MAX_KEY_PARTS = 100


def _document(text: str) -> dict[str, Any]:
    """Parse; dotted keys of absurd length are rejected: the parser's time grows with the square of their parts."""
    parts = 1
    for token in _KEY_TOKEN.finditer(text):
        if token[0] == ".":
            parts += 1
        elif token[0] in ",[]{}=\n":
            parts = 1
        if parts > _MAX_KEY_PARTS:
            line = text.count("\n", 0, token.start()) + 1
            raise _BadKey((), f"line {line}: a key of more than {_MAX_KEY_PARTS} parts")
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        raise
    except ValueError as error:  # Python's limit of digits
        long = re.search(rf"[0-9_]{{{sys.get_int_max_str_digits()},}}", text)
        line = text.count("\n", 0, long.start() if long else 0) + 1
        raise _BadKey((), f"line {line}: an integer of too many digits") from error


class _BadKey(ValueError):
    def __init__(self, keys: Keys, problem: str) -> None:
        super().__init__(problem)
        self.keys = keys
        self.problem = problem


@checked
def load_scene(path: str | os.PathLike[str], *, any_folder: bool = False) -> Scene:
    """Load a scene from a TOML file.

    Args:
        path: of the file.
        any_folder: allow pictures (``file = "..."``) in any folder; otherwise only in the folder of ``path`` and below,
            so that an untrusted scene cannot read other files.

    Raises:
        SceneFileError: a ValueError: not TOML, unknown or missing keys, bad values; names the file, line and key.
        OSError: the file cannot be read.
    """
    return load_scene_of(path, any_folder)[0]


def load_scene_of(path: str | os.PathLike[str], any_folder: bool) -> tuple[Scene, list[Path]]:
    """`load_scene`, and the pictures that the scene has read."""
    folder = _Folder(Path(path).parent, any_folder)
    with open(path, "rb") as file:
        try:
            data = read_whole(file)
        except FileError as error:
            raise SceneFileError(f"{os.fspath(path)}: {error}") from error
    try:
        text = data.decode("utf-8")
        return _scene(_document(text), folder), folder.read
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise SceneFileError(f"{os.fspath(path)}:{line}: byte {data[error.start]:#x}, allowed: UTF-8") from error
    except tomllib.TOMLDecodeError as error:
        raise SceneFileError(f"{os.fspath(path)}: {error}") from error
    except RecursionError as error:
        raise SceneFileError(f"{os.fspath(path)}: tables or lists nested too deeply") from error
    except _BadKey as error:
        where = f"{_line_of(text, error.keys)}: {_dotted(error.keys)}: " if error.keys else " "
        raise SceneFileError(f"{os.fspath(path)}:{where}{error.problem}") from error


@checked
def save_scene(path: str | os.PathLike[str], scene: Scene) -> None:
    """Write a scene to a TOML file that `load_scene` reads; arguments with their default value are omitted.

    Raises:
        ImportError: tomli-w is missing: pip install tomli-w.
        OSError: the file cannot be written.
    """
    import tomli_w

    tables = {name: _plain(getattr(scene, name)) for name in _TABLES}
    lists = {name: [_plain(item) for item in getattr(scene, name)] for name in _LISTS}
    held = {name: value for name, value in {**tables, **lists}.items() if value}
    with atomic_path(path) as temporary:
        temporary.write_text(tomli_w.dumps(held), encoding="utf-8")


def _dotted(keys: Keys) -> str:
    return "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in keys).lstrip(".")


def _line_of(text: str, keys: Keys) -> int:
    """Line of a key, or of the table that lacks it: the first line with the name after the table's header."""
    counts: dict[Keys, int] = {}  # number of items so far in the list of tables at these keys
    section: Keys = ()
    best, depth = 1, -1
    for number, line in enumerate(text.splitlines(), 1):
        header = line.lstrip().startswith("[")
        if header:
            section = _section(line.strip(), counts)
        if section != keys[: len(section)]:
            continue
        found = len(section) if header else -1
        for place in range(len(section), len(keys)):
            key = keys[place]
            if isinstance(key, str) and re.search(rf"(^|[{{,\s]){re.escape(key)}\s*=", line):
                found = place + 1
            elif isinstance(key, str) and place >= depth:
                break  # an inner key counts only after its outer keys
        if found > depth:
            best, depth = number, found
    return best


def _section(header: str, counts: dict[Keys, int]) -> Keys:
    """Keys of the table that [header] or [[header]] opens; names of lists denote their last item."""
    of_list = header.startswith("[[")
    names = [name.strip(" \t\"'") for name in header.lstrip("[").partition("]")[0].split(".")]
    keys: Keys = ()
    for place, name in enumerate(names):
        keys = (*keys, name)
        if of_list and place == len(names) - 1:
            counts[keys] = counts.get(keys, -1) + 1
        if keys in counts:
            keys = (*keys, counts[keys])
    return keys


def _scene(document: dict[str, Any], folder: _Folder) -> Scene:
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
    """Attach an error "argument: got ..." to the key of the argument."""
    name, _, problem = str(error).partition(": ")
    parts = re.findall(r"\w+", name) if re.fullmatch(r"[\w.\[\]]+", name) else []
    own = tuple(int(part) if part.isdigit() else part for part in parts)
    if own == ("exposure",) and not keys:
        own = ("camera", "exposure")
    return _BadKey((*keys, *own), problem) if own else _BadKey(keys, str(error))


def _fields(maker: Callable[..., Any]) -> dict[str, dataclasses.Field[Any]]:
    return {item.name: item for item in dataclasses.fields(maker) if item.init}  # type: ignore[arg-type]


def _made(maker: Callable[..., Any], table: Any, keys: Keys, folder: _Folder) -> Any:
    """Construct an object from its table."""
    if not isinstance(table, dict):
        raise _BadKey(keys, f"got {shown(table)}, allowed: a table")
    fields = _fields(maker)
    posed = "pose" in fields
    allowed = [name for name in fields if name != "pose"] + (["position", "rotation"] if posed else [])
    if maker is Picture:
        allowed.append("file")
    values: dict[str, Any] = {}
    for name, value in table.items():
        if name not in allowed:
            raise _BadKey((*keys, name), f"unknown key, allowed: {', '.join(allowed)}")
        values[name] = _value(name, value, (*keys, name), folder)
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
            raise _BadKey((*keys, name), "missing")
    try:
        return maker(**values)
    except ValueError as error:
        raise _of_argument(error, keys) from error
    except TypeError as error:
        raise _BadKey(keys, str(error)) from error


def _value(name: str, value: Any, keys: Keys, folder: _Folder) -> Any:
    if name == "parts" and isinstance(value, list):
        return [_choice(name, part, (*keys, index), folder) for index, part in enumerate(value)]
    if name in _CHOICES:
        return _choice(name, value, keys, folder)
    if name == "path_loss":
        return _made(PathLoss, value, keys, folder)
    if name == "file":
        return _picture(value, keys, folder)
    return value


def _choice(name: str, table: Any, keys: Keys, folder: _Folder) -> Any:
    kinds = _CHOICES[name]
    if not isinstance(table, dict) or table.get("kind") not in kinds:
        got = table.get("kind") if isinstance(table, dict) else table
        raise _BadKey((*keys, "kind"), f"got {shown(got)}, allowed: {', '.join(kinds)}")
    rest = {key: value for key, value in table.items() if key != "kind"}
    return _made(kinds[table["kind"]], rest, keys, folder)


def _picture(name: Any, keys: Keys, folder: _Folder) -> Any:
    """Grey levels, 0 to 1, of a picture file of the scene."""
    if not isinstance(name, str):
        raise _BadKey(keys, f"got {shown(name)}, allowed: the name of a picture")
    path = Path(os.path.realpath(folder.path / name))
    if not (folder.any_folder or path.is_relative_to(os.path.realpath(folder.path))):
        raise _BadKey(keys, f"got {shown(name)}, allowed: a picture in the scene's folder or below it")
    if path.exists() and not path.is_file():
        raise _BadKey(keys, f"got {shown(name)}, allowed: a file")
    folder.read.append(path)
    try:
        return grey_levels(path, _MAX_PICTURE_PIXELS)
    except (OSError, ValueError) as error:
        raise _BadKey(keys, f"got {shown(name)}: {error}") from error


def _plain(item: Any) -> Any:
    """Convert an object to TOML types."""
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
