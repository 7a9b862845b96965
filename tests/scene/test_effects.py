"""Each effect does what its sentence says."""

import numpy as np
import pytest

from ocisac_fast import Camera, Chips, Tone, integrate_exposure
from ocisac_fast.scene.effects import EFFECTS, Effects
from ocisac_fast.scene.simulation import simulate_frames

CAMERA = Camera(2e-5, 2e-4, frame_time=1 / 30)
BITS = np.random.default_rng(0).integers(0, 2, 40)
LAMP = Chips(BITS, 8e3, repeat=True)
ROWS = 256


def film(effects=None, frames=2, lamp=LAMP, **options):
    known = {"swing": 100.0, "dark_level": 40.0, "start": 0.01, **options}
    return np.array(list(simulate_frames(lamp, CAMERA, ROWS, 8, frames, effects=effects, **known)), float)


def exposed(lamp=LAMP, rows=ROWS, start=0.01, exposure=2e-4):
    return 40 + 100 * integrate_exposure(lamp, Camera(2e-5, exposure), rows, start=start)


@pytest.mark.parametrize("name", sorted(EFFECTS))
def test_an_effect_changes_the_picture_and_is_repeatable(name):
    level = EFFECTS[name].most if name in ("inverted", "hot-rows") else min(EFFECTS[name].most, 1.0) / 2
    level = {"chopping": 2e4, "sender-pause": 5, "rain": 9, "row-groups": 4, "row-pause": 9}.get(name, level)
    level = {"exposure-pairs": 2, "local-tone": 4, "sharpen": 1, "curve": 2}.get(name, level)
    changed = film({name: level}, noise=1.0)
    assert np.abs(changed - film(noise=1.0)).max() > 10
    assert np.array_equal(changed, film({name: level}, noise=1.0))


def test_the_lamp_of_a_sender_follows_its_chips():
    """A sampled light is within half a sample of 32 a chip."""
    longer = np.concatenate([BITS, np.zeros(10)])
    for effects, lamp in (
        ({"inverted": 1}, Chips(1 - BITS, 8e3, repeat=True)),
        ({"sender-pause": 10}, Chips(longer, 8e3, repeat=True)),
        ({"edge-jitter": 1e-9}, LAMP),
    ):
        np.testing.assert_allclose(film(effects)[0, :, 0], exposed(lamp), atol=2.0)
    mean = film({"long-runs": 0.4}).mean()
    runs = np.count_nonzero(np.diff(np.append(BITS, BITS[0])) < 0)
    assert mean == pytest.approx(40 + 100 * (BITS.mean() + 0.4 * runs / BITS.size), abs=2.5)


def test_rows_are_read_at_their_times():
    """The picture of the rows is the light at those times."""
    even = film({"late-frames": 0.0})[0, :, 0]
    np.testing.assert_allclose(even, exposed(), atol=2.0)
    grouped = film({"row-groups": 4})[0, :, 0]
    np.testing.assert_allclose(grouped, np.repeat(exposed()[::4], 4), atol=2.0)
    paused = film({"row-pause": 9})[0, :, 0]
    np.testing.assert_allclose(paused, np.concatenate([exposed()[:128], exposed(rows=ROWS + 9)[137:]]), atol=2.0)
    pulled = Effects({"lens": 0.1}, CAMERA, ROWS).read_rows()
    assert pulled[0] == pytest.approx(-0.1 * ROWS / 2, abs=0.5)
    assert pulled[ROWS // 2] == pytest.approx(ROWS / 2, abs=0.01)
    pairs = film({"exposure-pairs": 4})[0, :, 0]
    short = np.arange(ROWS) // 2 % 2 == 1
    np.testing.assert_allclose(pairs[short], exposed(exposure=5e-5)[short], atol=4.0)
    np.testing.assert_allclose(pairs[~short], exposed()[~short], atol=2.0)


def test_frames_come_late_one_after_the_other():
    device, delays = Effects({"late-frames": 0.5}, CAMERA, ROWS, 3), []
    delays = np.array([device.delay() for _ in range(200)])
    assert (np.diff(delays) >= 0).all()
    assert np.diff(delays).mean() == pytest.approx(0.25 / 30, rel=0.15)


def test_pictures_are_processed():
    plain = film(noise=5.0, frames=3)
    mixed = film({"denoise": 0.5}, noise=5.0, frames=3)
    want = [plain[0]]
    for frame in plain[1:]:
        want.append(0.5 * (frame + want[-1]))
    np.testing.assert_allclose(mixed, want, atol=1.0)
    curved = film({"curve": 2})
    np.testing.assert_allclose(curved, 255 * np.sqrt(film() / 255), atol=1.5)
    hot = film({"hot-rows": 0.1}) - film()
    assert set(np.unique(np.rint(hot))) == {0.0, 60.0}
    assert (film({"daylight": 0.2}, frames=4)[3] - film(frames=4)[3]).mean() == pytest.approx(20, abs=0.6)
    gain = film({"auto-gain": 0.2}, frames=3)[2] / film(frames=3)[2]
    assert gain.mean() == pytest.approx(1 + 0.2 * np.sin(0.4 * np.pi), abs=0.01)


@pytest.mark.parametrize(
    ("effects", "options", "message"),
    [
        ({"haze": 1}, {}, "effects: got 'haze', allowed: edge-jitter, "),
        ({"lens": 0.3}, {}, "effects: lens: got 0.3, allowed: 0 to 0.2"),
        ({"lens": float("nan")}, {}, "effects: lens: got nan"),
        ({"ripple": 0.5}, {"lamp": Tone(500.0)}, "effects: ripple: got another light, allowed: chips that repeat"),
        ({"curve": 2}, {"dtype": float}, "dtype: got float64, allowed: uint8 or uint16 with effects"),
    ],
)
def test_other_effects_are_refused(effects, options, message):
    with pytest.raises(ValueError, match=message):
        film(effects, **options)
