"""Where a film ends and a further one begins in the same bytes, as of files joined by ``cat``."""

from __future__ import annotations

import math
import re
from typing import Any

_PIECE, _BOX_HEAD = 4096, 24  # bytes
_RIFF = b"RIFF"
_ASF = bytes.fromhex("3026b2758e66cf11a6d900aa0062ce6c")  # the identifier of its header
BEGINNING = rb"\x1a\x45\xdf\xa3[\1-\xff]|\0\0..ftyp|RIFF....AVI |" + re.escape(_ASF)  # Matroska, MP4; a pattern
_FILM = re.compile(BEGINNING, re.DOTALL)


class FirstFilm:
    """A file up to its second film, which FFmpeg would leave out, or read with the index of the first.

    The boxes of MP4 (ISO 14496-12), the objects of ASF and the parts of AVI are followed by their sizes: those of a
    file when it is opened, those of a pipe as its bytes pass.
    """

    def __init__(self, file: Any, is_searched: bool = True) -> None:
        self._file, self._seekable = file, file.seekable()
        self._next: float = 0  # place of the next box; infinity where none can follow
        self._second: int | None = None
        self._kind = b""  # the first bytes of ASF and AVI
        self._place, self._tail = 0, b""  # of a pipe: bytes read, the last of them
        if self._seekable and is_searched:
            self._search()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)

    def read(self, size: int) -> bytes:
        if self._seekable:
            left = size if self._second is None else max(self._second - self._file.tell(), 0)
            return bytes(self._file.read(min(size, left)))
        data, begin = b"" if self._second is not None else bytes(self._file.read(size)), self._place
        self._place += len(data)
        if self._next < math.inf:
            self._follow(self._tail + data, begin - len(self._tail))
            self._tail = (self._tail + data)[1 - _BOX_HEAD :]
        return data if self._second is None else data[: max(self._second - begin, 0)]

    @property
    def is_followed(self) -> bool:
        """True if a further film follows, of which the rest of a pipe is asked."""
        while not self._seekable and self._next < math.inf and self.read(_PIECE):
            pass
        return self._second is not None

    def _search(self) -> None:
        begin = self._file.tell()
        while self._next < math.inf:
            self._file.seek(place := int(self._next))
            self._follow(self._file.read(_PIECE), place)
            if self._next == place:  # the end of the file
                break
        self._file.seek(begin)

    def _follow(self, piece: bytes, begin: int) -> None:
        """Go on from box to box within the bytes from ``begin`` on."""
        while begin <= self._next <= begin + len(piece) - _BOX_HEAD:
            place = int(self._next)
            head = piece[place - begin : place - begin + _BOX_HEAD]
            is_film = _FILM.match(head) is not None
            if place == 0:
                self._kind = next((kind for kind in (_ASF, _RIFF) if head.startswith(kind)), b"")
            elif is_film:
                self._second = place
            self._next += self._size_of(head) if is_film == (place == 0) else math.inf

    def _size_of(self, head: bytes) -> float:
        """Bytes of a box; infinity where it has the rest of the file, or is none."""
        if self._kind == _ASF:
            return int.from_bytes(head[16:], "little") or math.inf
        if self._kind == _RIFF:
            size = int.from_bytes(head[4:8], "little")
            return 8 + size + size % 2 if head.startswith(_RIFF) else math.inf
        size = int.from_bytes(head[:4], "big")
        size = int.from_bytes(head[8:16], "big") if size == 1 else size
        return size if size >= 8 and head[4:8].isalnum() else math.inf
