"""A receiver carries a light's profile from frame to frame, and drops it where it holds no longer.

A round lamp before a still texture: its profile along the rows is learned. Then something changes.
"""

import signal

import numpy as np
import pytest

from ocisac_fast import Camera, Chips, integrate_exposure
from ocisac_fast.packets import PacketFormat, transmit
from ocisac_fast.receiver import MultiReceiver, Receiver
from ocisac_fast.scene.simulation import texture as reflectance_of

ROWS, COLUMNS, ROW_TIME, FRAME_TIME, CHIP_RATE = 1080, 160, 22.2e-6, 1 / 30, 8e3
CAMERA = Camera(ROW_TIME, 5 / CHIP_RATE, FRAME_TIME)
PAYLOAD = np.random.default_rng(3).bytes(60)
SENT = transmit(PAYLOAD, format=PacketFormat(block_bytes=8))
CHANGED, FRAMES, LEARNED = 26, 62, 20
OLDER = 6  # frames after the change that may complete the payload of those before it
LATER = 16  # frames until the payload, beyond those from the change on alone: six to notice it, eight to learn from


def texture(random):
    cells = random.normal(size=(ROWS // 40, COLUMNS // 20))
    return 70 + 12 * np.kron(cells, np.ones((40, 20)))


def lamp(right=0, down=0):
    """90 DN inside of a circle of 400 rows and as many parts of the columns, with an edge of a tenth."""
    y, x = np.mgrid[:ROWS, :COLUMNS]
    radius = np.hypot((y - ROWS / 2 - down) / 400, (x - COLUMNS / 2 - right) / (0.3 * COLUMNS))
    return 90 * np.clip(10 * (1 - radius), 0, 1)


def filmed(change, seed):
    """(number, frame) of a stream whose scene changes at frame CHANGED."""
    random = np.random.default_rng(seed)
    light = integrate_exposure(Chips(SENT.chips, CHIP_RATE, repeat=True), CAMERA, ROWS, frames=np.arange(FRAMES))
    before, after = texture(random), texture(random)
    rows = np.arange(ROWS) * ROW_TIME
    for number in range(FRAMES):
        changed = number >= CHANGED
        if change == "lost frames" and changed and number % 5 in (1, 2):
            continue
        shape = lamp(0.1 * COLUMNS, 40) if change == "moved lamp" and changed else lamp()
        if change == "other brightness" and changed:
            shape = 0.7 * shape
        picture = shape * light[number][:, None] + (after if change == "cut scene" and changed else before)
        if change == "hum begins" and changed:
            picture += 15 * np.sin(2 * np.pi * 100 * (rows + number * FRAME_TIME + 1e-3))[:, None]
        picture += random.normal(0, 2, picture.shape)
        yield number, np.clip(np.rint(picture), 0, 255).astype(np.uint8)


def wrong_chips(received, number):
    """Count of wrong chips, at the place of the light's chips that the frame's clock tells within one chip."""
    bits = np.frombuffer(received.bits.encode(), np.uint8) - ord("0")
    began = (received.phase * ROW_TIME - CAMERA.exposure / 2 + number * FRAME_TIME) * CHIP_RATE
    first = round(began) + np.arange(-1, 2)[:, None]
    sent = np.asarray(SENT.chips)[(first + np.arange(bits.size)) % len(SENT.chips)]
    return np.count_nonzero(bits != sent, axis=1).min()


def payload_frames(frames):
    """Frames that complete the payload, one after the other; none is another, and no sure chips are wrong."""
    receiver = MultiReceiver(CAMERA, chip_rate=CHIP_RATE, format=SENT.format)
    for number, pixels in frames:
        for light in receiver.push(pixels, number=number):
            got = light.received
            if got.bits:
                wrong = wrong_chips(got, number)
                assert wrong <= 0.05 * len(got.bits) or got.error_rate >= 0.01, number
                assert wrong == 0 or not LEARNED <= number < CHANGED, number
            if got.payload is not None:
                assert got.payload.data == PAYLOAD
                yield number


@pytest.mark.parametrize(
    "change",
    [
        "moved lamp",
        pytest.param("other brightness", marks=pytest.mark.nightly),
        "hum begins",
        "cut scene",
        "lost frames",
    ],
)
def test_a_change_is_noticed_and_costs_no_payload(change):
    carried = payload_frames(filmed(change, seed=1))
    assert next(carried) < CHANGED
    fresh = next(payload_frames(frame for frame in filmed(change, seed=1) if frame[0] >= CHANGED))
    after = next(number for number in carried if number >= CHANGED + OLDER)
    assert after <= fresh + LATER


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_daylight_that_rises_and_falls_is_a_level_of_each_frame(seed):
    """It fills the rows of a lit texture, whose profile is learned, with as much as the lamp or none."""
    random = np.random.default_rng(seed)
    light = integrate_exposure(Chips(SENT.chips, CHIP_RATE, repeat=True), CAMERA, ROWS, frames=np.arange(FRAMES))
    reflectance = reflectance_of(ROWS, 64, 0.1, seed=seed)
    receiver = Receiver(CAMERA, chip_rate=CHIP_RATE, format=SENT.format)
    for number in range(FRAMES):
        daylight = 60 * (1 + 0.5 * np.sin(2 * np.pi * number / (10 + seed)))
        picture = reflectance * (daylight + 80 * light[number][:, None]) + random.normal(0, 2, (ROWS, 64))
        got = receiver.push(np.clip(np.rint(picture), 0, 255).astype(np.uint8))
        if got.payload is not None:
            break
    assert got.payload.data == PAYLOAD
    assert number < 24


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="no timer")
@pytest.mark.parametrize("kind", [Receiver, MultiReceiver])
def test_a_receiver_goes_on_after_frames_that_were_broken_off(kind):
    """It crashed in the next frame, after some 200 of them."""

    def stop(*_):
        raise KeyboardInterrupt

    random, before = np.random.default_rng(0), signal.signal(signal.SIGALRM, stop)
    camera = Camera(22.2e-6, 1.2e-4, frame_time=1 / 30)
    waveform = transmit(b"Hello, world").waveform(chip_rate=1e4)
    frames = [
        60 * integrate_exposure(waveform, camera, 600, start=k / 30)[:, None] + random.normal(20, 1, (600, 120))
        for k in range(8)
    ]
    broken = read = 0
    try:
        for _ in range(250):
            receiver = kind(camera, chip_rate=1e4)
            for number, frame in enumerate(frames):
                try:
                    if number % 2:
                        signal.setitimer(signal.ITIMER_REAL, random.uniform(1e-5, 2e-3))
                    result = receiver.push(frame, number=number)
                    signal.setitimer(signal.ITIMER_REAL, 0)
                except KeyboardInterrupt:
                    signal.setitimer(signal.ITIMER_REAL, 0)
                    broken += 1
                    continue
                received = [result] if kind is Receiver else [light.received for light in result]
                read += broken > 0 and any(one.bits for one in received)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
    assert broken > 50
    assert read > 200


@pytest.mark.parametrize("exposure", [1e-300, 1e60])
def test_an_exposure_of_a_frame_is_one_that_a_camera_has(exposure):
    random, camera = np.random.default_rng(1), Camera(22.2e-6, 1.2e-4, frame_time=1 / 30)
    waveform = transmit(b"Hello, world").waveform(chip_rate=1e4)
    receiver = Receiver(camera, chip_rate=1e4)
    results = []
    for number in range(24):
        frame = 60 * integrate_exposure(waveform, camera, 600, start=number / 30) + random.normal(20, 0.3, 600)
        if exposure > 1 and number == 4:
            with pytest.raises(ValueError, match=r"exposure: got 1e\+60, allowed: 0 to 2.22e\+10 s"):
                receiver.push(frame, number=number, exposure=exposure)
            continue
        results.append(receiver.push(frame, number=number, exposure=exposure if number == 4 else None))
    assert any(result.payload is not None for result in results[6:])


def test_an_exposure_of_a_frame_replaces_that_of_a_camera_of_none():
    """The ratio to an exposure of 0 was no number, which each later frame was refused for."""
    random, camera = np.random.default_rng(1), Camera(22.2e-6, 0.0, frame_time=1 / 30)
    waveform = transmit(b"Hello, world").waveform(chip_rate=1e4)
    receiver = Receiver(camera, chip_rate=1e4)
    payloads = 0
    for number in range(24):
        light = integrate_exposure(waveform, Camera(22.2e-6, 1.2e-4), 600, start=number / 30)
        frame, exposure = 20 + 60 * light + random.normal(0, 0.3, 600), 1.2e-4 if number > 3 else None
        payloads += receiver.push(frame, number=number, exposure=exposure).payload is not None
    assert payloads > 0
