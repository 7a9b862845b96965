"""The camera that a file states: the same in Python and on the command line, for each kind of file."""

from __future__ import annotations

import dataclasses
import json

import av
import numpy as np
import pytest
from PIL import Image

from ocisac_fast import Camera, Tone, exposure_response, integrate_exposure, tone_gain
from ocisac_fast.files import read_frames

ROWS, COLUMNS = 720, 64
TIMING = {"row_time": 22.2e-6, "exposure": 622e-6}
GAIN = ("--row-time", "22.2us", "--exposure", "622us", "--frequency", "500", "--scan-axis", "y")
THEORY = abs(exposure_response(500.0, 622e-6))
LIGHT = np.repeat(integrate_exposure(Tone(500.0), Camera(**TIMING), ROWS)[:, np.newaxis], COLUMNS, axis=1)


def write_film(path, *, codec="libx264", pixels="yuv420p", limits=0, transfer=2):
    """Three frames of a tone of 500 Hz, stored linearly in the luma's range."""
    deep = "10" in pixels
    unit, dtype = (4, "<u2") if deep else (1, "u1")
    dark, span = (0, 255) if limits == 2 else (16, 219)
    luma = np.rint(unit * (dark + 0.9 * span * LIGHT)).astype(dtype)
    with av.open(str(path), "w") as container:
        options = {"libx264": {"qp": "0"}, "libx265": {"x265-params": "log-level=none:lossless=1"}}
        stream = container.add_stream(codec, rate=25, options=options.get(codec, {}))
        stream.width, stream.height, stream.pix_fmt = COLUMNS, ROWS, pixels
        stream.codec_context.color_range, stream.codec_context.color_trc = limits, transfer
        for k in range(3):
            frame = av.VideoFrame(COLUMNS, ROWS, pixels)
            for plane in frame.planes[1:]:
                plane.update(np.full(plane.buffer_size // luma.itemsize, 128 * unit, dtype).tobytes())
            frame.planes[0].update(luma.tobytes())
            frame.pts = k
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))


DEEP = {"codec": "libx265", "pixels": "yuv420p10le", "limits": 1}
FILMS = {
    "limited.mp4": {"limits": 1, "transfer": 8},
    "full.mp4": {"limits": 2, "transfer": 8, "pixels": "yuvj420p"},
    "untold.mp4": {},
    "untold.mkv": {"codec": "ffv1"},
    "hlg.mp4": {**DEEP, "transfer": 18},
    "pq.mov": {**DEEP, "transfer": 16},
}
TAKEN = {"untold.mp4": "gamma:1.95", "untold.jpg": "srgb"}  # other files without a statement are linear


@pytest.fixture(params=[*FILMS, "untold.png", "untold.jpg", "untold.tif", "frames.npy"])
def path(request, tmp_path):
    """A recording of the tone; all are linear, whatever they state."""
    path = tmp_path / request.param
    if path.name in FILMS:
        write_film(path, **FILMS[path.name])
    elif path.suffix == ".npy":
        np.save(path, np.rint(230 * LIGHT).astype(np.uint8))
    else:
        Image.fromarray(np.rint(230 * LIGHT).astype(np.uint8)).save(path)
    return path


def test_python_takes_the_camera_of_the_command_line(path, run):
    code, out, err = run("gain", path, *GAIN, "--json")
    recording, taken = read_frames(path), TAKEN.get(path.name)
    camera = recording.camera(**TIMING)
    kind = recording.response.assumed_for
    assert bool(kind) == ("untold" in path.name or path.suffix == ".npy")
    said = f"ocisac: no tone curve is stated: {taken} is taken, as usual for {kind} (--tone-curve)"
    wrong = camera.tone_curve != "linear"  # the light is stored as it is
    assert (code, err[: len(err) - wrong]) == (0, [] if taken is None else [said])
    assert ("contradicts --exposure, --waveform or --dark-level" in err[-1] if err else False) == wrong
    assert camera.tone_curve == (taken or {"hlg.mp4": "hlg", "pq.mov": "pq"}.get(path.name, "linear")).split(":")[0]
    assert recording.camera(**TIMING, dark_level=7.5) == dataclasses.replace(camera, dark_level=7.5)
    assert camera.frame_time == (1 / recording.frame_rate if recording.frame_rate else None)
    gain = tone_gain(recording.frames, camera, 500.0, pooled=True).gain.mean()
    assert json.loads(out[0])["gain"] == pytest.approx(gain, abs=2e-4)
    assert (abs(gain - THEORY) < 3e-3) == (camera.tone_curve == "linear")
    code, out, err = run("gain", path, *GAIN, "--tone-curve", "linear", "--json")
    assert (code, err) == (0, [])
    assert json.loads(out[0])["gain"] == pytest.approx(THEORY, abs=3e-3)


def test_webp_is_a_photograph_as_jpeg_is(tmp_path, run):
    Image.fromarray(np.rint(230 * LIGHT).astype(np.uint8)).save(tmp_path / "a.webp")
    assert read_frames(tmp_path / "a.webp").camera().tone_curve == "srgb"
    _, _, err = run("gain", tmp_path / "a.webp", *GAIN, "--json")
    assert err[0] == "ocisac: no tone curve is stated: srgb is taken, as usual for WEBP (--tone-curve)"


def test_clean_takes_srgb_for_png(tmp_path, run):
    Image.fromarray(np.rint(230 * LIGHT).astype(np.uint8)).save(tmp_path / "a.png")
    code, _, err = run("clean", tmp_path / "a.png", tmp_path / "b.png", "--row-time", "22.2us", "--scan-axis", "y")
    assert (code, err) == (0, ["ocisac: no tone curve is stated: srgb is taken, as usual for PNG (--tone-curve)"])
