"""``python -m ocisac_fast.smoke``: check of an installation with NumPy alone.

It simulates a recording, measures the gain and receives the payload. It prints one line and exits with 0, or raises.
"""

from __future__ import annotations

import numpy as np

import ocisac_fast as ocisac
from ocisac_fast.scene.simulation import simulate_frames

_ROW_TIME, _EXPOSURE, _ROWS, _COLUMNS, _DARK_LEVEL = 22.2e-6, 100e-6, 720, 48, 20.0


def _check_gain(camera: ocisac.Camera) -> float:
    light = ocisac.SquareWave(500.0)
    frame = next(iter(simulate_frames(light, camera, _ROWS, _COLUMNS, dark_level=_DARK_LEVEL, noise=2.0)))
    gain = ocisac.tone_gain(frame, camera, 500.0, waveform="square", pooled=True)
    theory = float(abs(ocisac.exposure_response(500.0, _EXPOSURE)))
    error = abs(float(gain.gain) - theory)
    if not error < 0.05:
        raise RuntimeError(f"gain: got {float(gain.gain)}, expected {theory}")
    return error


def _check_payload(camera: ocisac.Camera) -> bytes:
    sent = ocisac.transmit(b"smoke")
    light = ocisac.Chips(sent.chips, 11.7e3, repeat=True)
    receiver = ocisac.Receiver(camera, chip_rate=11.7e3)
    for frame in simulate_frames(light, camera, _ROWS, _COLUMNS, 60, dark_level=_DARK_LEVEL, noise=2.0):
        received = receiver.push(np.asarray(frame))
        if received.payload is not None:
            return bytes(received.payload.data)
    raise RuntimeError("payload: nothing received in 60 frames")


def main() -> None:
    """Run the checks."""
    camera = ocisac.Camera(_ROW_TIME, _EXPOSURE, frame_time=1.0 / 30.0, dark_level=_DARK_LEVEL)
    _check_gain(camera)
    payload = _check_payload(camera)
    if payload != b"smoke":
        raise RuntimeError(f"payload: got {payload!r}, expected b'smoke'")
    build = f"{ocisac.__version__}, OpenCV {ocisac._core.opencv_version()}, {ocisac._core.simd_target()}"
    print(f"ocisac_fast works: {build}, NumPy {np.__version__}")


if __name__ == "__main__":
    main()
