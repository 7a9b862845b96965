"""Recordings as files: pictures, videos and arrays, read as the camera stored them and written atomically."""

from ocisac_fast.files.reading import cut_recording, open_recording, read_frames
from ocisac_fast.files.recording import FileError, FileWarning, LightResponse, Part, Recording, RecordingStream
from ocisac_fast.files.writing import atomic_path, write_frames

__all__ = [
    "FileError",
    "FileWarning",
    "LightResponse",
    "Part",
    "Recording",
    "RecordingStream",
    "atomic_path",
    "cut_recording",
    "open_recording",
    "read_frames",
    "write_frames",
]
