"""Recordings as files: pictures, videos and arrays, read as the camera stored them and written atomically."""

from ocisac_fast.files.reading import open_recording, read_frames
from ocisac_fast.files.recording import FileError, FileWarning, LightResponse, Recording, RecordingStream
from ocisac_fast.files.writing import atomic_path, write_frames

__all__ = [
    "FileError",
    "FileWarning",
    "LightResponse",
    "Recording",
    "RecordingStream",
    "atomic_path",
    "open_recording",
    "read_frames",
    "write_frames",
]
