"""The command line on recordings of real cameras, judged by the score.py that lies beside them."""

import importlib.util
import json
import shlex
import sys

import pytest

pytest.importorskip("click")
pytest.importorskip("rich")
pytest.importorskip("PIL.Image")

COMMAND = f"{shlex.quote(sys.executable)} -m ocisac_fast.cli"
LINES = [
    ("calibrate", "gyroflow_nikon1j1_1khz.png"),
    ("calibrate", "nikon_z7_500hz.jpg"),
    *(("tone", f"laser_square_{k:02}.png") for k in range(6)),
    *(("receive", f"laser_pattern_{k:02}.png") for k in range(2, 7)),
    ("receive", "laser_check.png"),
    ("receive", "underwater_0.jpeg"),
    ("receive", "underwater_2.jpeg"),
    ("detect", "luxapose_rig_a.jpg"),
    ("detect", "no_light_board.jpg"),
    ("detect", "luxapose_chandelier_a.jpg"),
]


@pytest.fixture(scope="session")
def score(recordings):
    spec = importlib.util.spec_from_file_location("score", recordings / "score.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="session")
def manifest(recordings):
    return {entry["file"]: entry for entry in json.loads((recordings / "recordings.json").read_text())}


@pytest.mark.parametrize(("line", "file"), LINES)
def test_line_of_the_score_holds(recordings, score, manifest, line, file):
    holds, text, _ = getattr(score, line)(COMMAND, recordings / file, manifest[file])
    assert holds, text


def test_luma_of_a_phone_video_is_of_limited_range(recordings):
    pytest.importorskip("av")
    from ocisac_fast.files import open_recording

    with open_recording(recordings / "phone_video.mp4") as stream:
        assert next(iter(stream)).shape == (1920, 1080)
        assert (stream.response.dark_level, stream.response.white_level) == (16, 235)
        assert (stream.frame_count, round(stream.frame_rate)) == (90, 30)


@pytest.mark.parametrize(("file", "shape"), [("luxapose_rig_a.jpg", (1, 4352, 7712, 3))])
def test_a_phone_still_says_that_it_is_srgb(recordings, file, shape):
    from ocisac_fast.files import read_frames

    recording = read_frames(recordings / file)
    assert recording.frames.shape == shape
    assert (recording.response.tone_curve, recording.response.stated_by) == ("srgb", "EXIF ColorSpace")
