"""Stretches of recordings: their frames are those of the whole, whatever the container and the codec."""

import av
import fsspec
import numpy as np
import pytest

from ocisac_fast.files import FileError, cut_recording, open_recording, read_frames, write_frames

SHAPE = (120, 48, 64)
CODECS = {  # file: codec, its options, pixel format
    "closed.mp4": ("libx264", {"bf": "3"}, "yuv420p"),
    "open.mkv": ("libx264", {"bf": "3", "x264-params": "open-gop=1"}, "yuv420p"),
    "stream.ts": ("libx264", {"bf": "2"}, "yuv420p"),
    "intra.mkv": ("mjpeg", {}, "yuvj420p"),
    "five.mp4": ("libx265", {"x265-params": "log-level=none"}, "yuv420p"),
    "nine.webm": ("libvpx-vp9", {"auto-alt-ref": "1", "lag-in-frames": "16"}, "yuv420p"),
}


@pytest.fixture(scope="module")
def frames():
    rng = np.random.default_rng(5)
    still = rng.integers(0, 120, SHAPE[1:])
    return np.stack([(still + k + rng.integers(0, 9, SHAPE[1:])) for k in range(SHAPE[0])]).astype(np.uint8)


def encode(path, frames, codec, options, pixels):
    if codec not in av.codecs_available:
        pytest.skip(f"FFmpeg without {codec}")
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=30)
        stream.height, stream.width, stream.pix_fmt, stream.options = *frames.shape[1:], pixels, options
        stream.codec_context.gop_size = 12
        for index, frame in enumerate(frames):
            picture = av.VideoFrame.from_ndarray(frame, format="gray").reformat(format=pixels)
            picture.pts = index
            container.mux(stream.encode(picture))
        container.mux(stream.encode(None))


def joined(path, parts, raw=None):
    read = []
    for part in parts:
        with open_recording(path, raw=raw, part=part) as stream:
            read.append(np.stack(list(stream)))
        assert len(read[-1]) == part.stop - part.first
    return np.concatenate(read)


@pytest.mark.parametrize("name", CODECS)
def test_stretches_of_a_video_are_its_frames(name, frames, tmp_path):
    path = tmp_path / name
    encode(path, frames, *CODECS[name])
    parts = cut_recording(path, 30)
    assert len(parts) >= 3
    assert [part.first for part in parts[1:]] == [part.stop for part in parts[:-1]]
    assert np.array_equal(joined(path, parts), read_frames(path).frames)


@pytest.mark.parametrize("name", ["frames.npy", "frames.mkv", "frames.raw"])
def test_stretches_of_what_is_written_here(name, frames, tmp_path):
    path, raw = tmp_path / name, "64x48" if name.endswith("raw") else None
    path.write_bytes(frames.tobytes()) if raw else write_frames(path, frames)
    assert np.array_equal(joined(path, cut_recording(path, 25, raw=raw), raw), frames)
    assert cut_recording(path, len(frames), raw=raw) is None


def test_a_stretch_that_cannot_be_told_from_its_packets_is_refused(frames, tmp_path):
    """Pictures refreshed in pieces: their key frames are none, which only decoding shows."""
    path = tmp_path / "refreshed.mkv"
    encode(path, frames, "libx264", {"x264-params": "intra-refresh=1"}, "yuv420p")
    parts = cut_recording(path, 20)
    with pytest.raises(FileError, match="key frame"):
        joined(path, parts)


def test_a_stretch_that_lacks_frames_is_refused(frames, tmp_path):
    path = tmp_path / "frames.mkv"
    write_frames(path, frames)
    parts = cut_recording(path, 30)
    data = bytearray(path.read_bytes())
    data[len(data) // 2 : len(data) // 2 + 3000] = bytes(3000)
    path.write_bytes(data)
    with pytest.raises(FileError):
        joined(path, parts)


def test_films_of_y4m_are_cut_unless_they_are_truncated(frames, tmp_path):
    rows, columns = frames.shape[1:]
    path = tmp_path / "frames.y4m"
    head = f"YUV4MPEG2 W{columns} H{rows} F30:1 Ip A1:1 Cmono\n".encode()
    path.write_bytes(head + b"".join(b"FRAME\n" + frame.tobytes() for frame in frames))
    parts = cut_recording(path, 20)
    assert len(parts) > 1
    assert np.array_equal(joined(path, parts), frames)
    path.write_bytes(path.read_bytes()[:-1])
    assert cut_recording(path, 20) is None


def test_a_truncated_or_fortran_ordered_recording_is_not_cut(frames, tmp_path):
    video = tmp_path / "frames.mp4"
    write_frames(video, frames)
    video.write_bytes(video.read_bytes()[: video.stat().st_size * 2 // 3])
    assert cut_recording(video, 30) is None
    np.save(tmp_path / "frames.npy", np.asfortranarray(frames))
    assert cut_recording(tmp_path / "frames.npy", 30) is None


@pytest.mark.parametrize("name", ["frames.npy", "frames.mkv", "frames.png"])
def test_paths_of_fsspec_are_read_whole_and_in_stretches(name, frames, tmp_path, monkeypatch):
    write_frames(tmp_path / name, frames if name != "frames.png" else frames[0])
    system = fsspec.filesystem("memory")
    system.pipe_file(f"/files-test/{name}", (tmp_path / name).read_bytes())
    url = f"memory://files-test/{name}"
    whole = read_frames(url).frames
    assert np.array_equal(whole, read_frames(tmp_path / name).frames)
    monkeypatch.setattr("ocisac_fast.files.remote._WHOLE", 0)  # by ranges
    assert np.array_equal(read_frames(url).frames, whole)
    if name != "frames.png":
        assert np.array_equal(joined(url, cut_recording(url, 25)), frames)
    system.rm("/files-test", recursive=True)


def test_a_missing_remote_file_is_an_os_error():
    with pytest.raises(FileNotFoundError):
        read_frames("memory://nothing/there.mkv")
    fsspec.filesystem("memory").mkdirs("/a-folder", exist_ok=True)
    with pytest.raises(IsADirectoryError):
        read_frames("memory://a-folder")
