"""Long runs on dirty streams: frames dropped, doubled, torn, resized, of noise, dark, of another light.

Each part is a stream of its own size, read by ocisac-rx and by Receiver. Both must give no wrong payload, keep their
memory over the second half of a part (64 kB and 1 MiB), and receive within three frames after dirt. Parts are appended
to the state file, from which a later run goes on; a run ends after N frames in all or after M minutes of its own.
"""

from __future__ import annotations

import argparse
import base64
import json
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import numpy.typing as npt

import ocisac_fast as ocisac
from ocisac_fast import Camera, Receiver, transmit

Frame = npt.NDArray[np.uint8]
ROW_TIME, FRAME_RATE, CHIP_ROWS = 2e-5, 100.0, 5.0
KINDS = ("dropped", "doubled", "torn", "resized", "noise", "dark", "other light")
RECOVERY = 3  # frames within which reception is back
GROWTH_PROGRAM, GROWTH_PYTHON = 64, 1024  # kB


def resident(process: int | str) -> int:
    """kB of the process's own memory: pages of programs and libraries that it runs for the first time are none."""
    status = Path(f"/proc/{process}/status").read_text()
    return int(next(line for line in status.splitlines() if line.startswith("RssAnon")).split()[1])


class Light:
    """Frames of a light that repeats a packet."""

    def __init__(self, random: np.random.Generator, rows: int, columns: int) -> None:
        self.payload = random.bytes(int(random.integers(1, 12)))
        self.camera = Camera(ROW_TIME, 2 * ROW_TIME, frame_time=1 / FRAME_RATE)
        self.random, self.shape = random, (rows, columns)
        self.chips = transmit(self.payload).waveform(1 / (CHIP_ROWS * ROW_TIME))

    def frame(self, number: int) -> Frame:
        light = ocisac.integrate_exposure(self.chips, self.camera, self.shape[0], start=number / FRAME_RATE)
        noise = self.random.standard_normal(self.shape)
        return np.clip(30 + 180 * np.asarray(light)[:, None] + 2 * noise, 0, 255).astype(np.uint8)


def two_lights(random: np.random.Generator) -> tuple[Light, Light]:
    shape = int(random.integers(240, 481)), int(random.integers(8, 17))
    return Light(random, *shape), Light(random, *shape)


def dirty(light: Light, other: Light, frames: int) -> Iterator[tuple[int, str, Frame, int]]:
    """Number, kind ("clean", or of the dirt), picture, and clean frames since the last dirt."""
    random, number, clean = light.random, 0, 0
    rows = light.shape[0]
    while number < frames:
        for _ in range(int(random.integers(5, 40))):
            clean += 1
            yield number, "clean", light.frame(number), clean
            number += 1
        kind, clean = str(random.choice(KINDS)), 0
        # Eight frames of another size are no dirt: the receiver goes over to it.
        for _ in range(int(random.integers(1, 8 if kind == "resized" else 12))):
            picture = light.frame(number)
            if kind == "resized":
                picture = picture[: rows // 2]
            elif kind == "noise":
                picture = random.integers(0, 256, light.shape, np.uint8)
            elif kind == "dark":
                picture = np.full(light.shape, 16, np.uint8)
            elif kind == "other light":
                picture = other.frame(number)
            for _ in range({"dropped": 0, "doubled": 2}.get(kind, 1)):
                yield number, kind, picture, 0
            number += 1


def soak_python(seed: int, frames: int) -> dict[str, object]:
    random = np.random.default_rng(seed)
    light, other = two_lights(random)
    sent = (light.payload, other.payload)
    receiver = Receiver(light.camera, chip_rate=1 / (CHIP_ROWS * ROW_TIME))
    wrong = payloads = before = 0
    late: list[str] = []
    received, dirt = True, ""
    for number, kind, picture, clean in dirty(light, other, frames):
        if not before and number >= frames // 2:
            before = resident("self")
        if kind == "torn":
            continue  # ocisac-rx alone sees bytes
        result = receiver.push(picture, number=number)
        received = result.outcome == "received" or (received and clean > 1)
        dirt = dirt if clean else kind
        if clean == RECOVERY and not received:
            late.append(f"{dirt} before {number}")
        if result.payload is not None:
            payloads += 1
            wrong += result.payload.data not in sent
    return {"wrong": wrong, "payloads": payloads, "late": late, "growth_kb": resident("self") - before}


def soak_program(program: str, seed: int, frames: int) -> dict[str, object]:
    random = np.random.default_rng(seed)
    light, other = two_lights(random)
    rows, columns = light.shape
    command = [program, "--row-time", "20us", "--exposure", "40us", "--no-gain", "--chip-rate", "10kHz"]
    command += ["--region", f"0,0,{columns},{rows}"]
    child = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
    assert child.stdin is not None
    assert child.stdout is not None
    output = child.stdout
    lines: list[dict[str, object]] = []
    reader = threading.Thread(target=lambda: lines.extend(json.loads(line) for line in output), daemon=True)
    reader.start()
    child.stdin.write(f"YUV4MPEG2 W{columns} H{rows} F{FRAME_RATE:.0f}:1 Cmono\n".encode())
    before = after = clean_frames = dirts = 0
    for number, kind, picture, clean in dirty(light, other, frames):
        data = picture.tobytes()
        child.stdin.write(b"FRAME\n" + (data[: len(data) // 3] if kind == "torn" else data))
        if not before and number >= frames // 2:
            before = resident(child.pid)
        clean_frames += kind == "clean"
        dirts += clean == 1
        if number % 100 == 99:
            child.stdin.flush()
            after = resident(child.pid)
    child.stdin.close()
    code = child.wait()
    reader.join()
    found = [base64.b64decode(str(line["payload_base64"])) for line in lines if line.get("payload_base64")]
    wrong = sum(payload not in (light.payload, other.payload) for payload in found)
    received = sum(line.get("outcome") == "received" for line in lines)
    missed = max(0, clean_frames - received)
    return {
        "exit": code, "wrong": wrong, "payloads": len(found), "missed": missed, "allowed": RECOVERY * dirts,
        "growth_kb": after - before,
    }  # fmt: skip


def failures(python: dict[str, object], program: dict[str, object]) -> list[str]:
    claims = {
        "Receiver: wrong payload": python["wrong"] == 0,
        "Receiver: no payload": python["payloads"],
        f"Receiver: not received within {RECOVERY} frames": not python["late"],
        "Receiver: memory grows": int(str(python["growth_kb"])) <= GROWTH_PYTHON,
        "ocisac-rx: exit": program["exit"] == 0,
        "ocisac-rx: wrong payload": program["wrong"] == 0,
        "ocisac-rx: no payload": program["payloads"],
        "ocisac-rx: frames missed": int(str(program["missed"])) <= int(str(program["allowed"])),
        "ocisac-rx: memory grows": int(str(program["growth_kb"])) <= GROWTH_PROGRAM,
    }
    return [claim for claim, holds in claims.items() if not holds]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=10_000)
    parser.add_argument("--part", type=int, default=5_000)
    parser.add_argument("--minutes", type=float, default=40.0)
    parser.add_argument("--state", type=Path, default=Path("build/soak.jsonl"))
    parser.add_argument("--fresh", action="store_true", help="without earlier parts")
    parser.add_argument("--program", default="build/make/cpp/apps/ocisac-rx")
    options = parser.parse_args()
    options.state.parent.mkdir(parents=True, exist_ok=True)
    if options.fresh:
        options.state.unlink(missing_ok=True)
    done = [json.loads(line) for line in options.state.read_text().splitlines()] if options.state.exists() else []
    began = time.monotonic()
    while sum(part["frames"] for part in done) < options.frames and time.monotonic() - began < 60 * options.minutes:
        seed = len(done)
        python, program = soak_python(seed, options.part), soak_program(options.program, seed, options.part)
        part = {"seed": seed, "frames": options.part, "python": python, "program": program}
        part["failures"] = failures(python, program)
        done.append(part)
        with options.state.open("a") as state:
            state.write(json.dumps(part) + "\n")
        print(json.dumps(part), flush=True)
    failed = [part for part in done if part["failures"]]
    print(f"{sum(part['frames'] for part in done)} frames, {len(failed)} of {len(done)} parts failed")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
