"""The page in Chromium: files dropped, the camera, offline, refusals, cancelling; its numbers against Python.

``make web`` builds the page and runs these tests; OCISAC_SITE is its folder.
"""

from __future__ import annotations

import base64
import functools
import http.server
import io
import json
import os
import shutil
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from ocisac_fast import Camera, Chips, MultiReceiver, Tone, calibrate, detect_sources, integrate_exposure, tone_gain
from ocisac_fast.exposure import FlickeringLight, best_exposure, flicker_free_exposure
from ocisac_fast.packets import PacketFormat, transmit
from ocisac_fast.tones import find_frequency

SITE = os.environ.get("OCISAC_SITE")
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
pytestmark = pytest.mark.skipif(SITE is None or CHROMIUM is None, reason="make web builds the page and runs these")

ROW_TIME, EXPOSURE = 22.2e-6, 100e-6
Pixels = npt.NDArray[np.uint8]
_FLAGS = ["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking"]
_FLAGS += ["--disable-component-update", "--disable-sync", "--use-fake-ui-for-media-stream"]


class _Quiet(http.server.SimpleHTTPRequestHandler):
    extensions_map = {  # noqa: RUF012
        **http.server.SimpleHTTPRequestHandler.extensions_map,
        ".mjs": "text/javascript",
        ".wasm": "application/wasm",
    }

    def log_message(self, *_: Any) -> None:
        pass


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, Path]]:
    """Address and folder of the page; files put into the folder are served, too."""
    folder = tmp_path_factory.mktemp("site") / "page"
    assert SITE is not None
    shutil.copytree(SITE, folder)
    handler = functools.partial(_Quiet, directory=str(folder))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}/", folder
        server.shutdown()


@pytest.fixture(scope="module")
def playwright() -> Iterator[Any]:
    with pytest.importorskip("playwright.sync_api").sync_playwright() as started:
        yield started


@pytest.fixture(scope="module")
def browser(playwright: Any) -> Iterator[Any]:
    chromium = playwright.chromium.launch(executable_path=CHROMIUM, args=_FLAGS)
    yield chromium
    chromium.close()


def until(page: Any, condition: str, timeout: float = 60.0) -> None:
    """Wait for an expression; the page's policy forbids the evaluation that Playwright's own waiting needs."""
    end = time.monotonic() + timeout
    while not page.evaluate(condition):
        assert time.monotonic() < end, f"{condition}: {page.inner_text('main')[:600]}"
        page.wait_for_timeout(50)


@pytest.fixture
def page(browser: Any, site: tuple[str, Path]) -> Iterator[Any]:
    """The page, ready; a phone's screen. Errors of its scripts fail the test."""
    context = browser.new_context(viewport={"width": 412, "height": 915})
    opened = context.new_page()
    errors: list[str] = []
    opened.on("pageerror", lambda error: errors.append(str(error)))
    opened.goto(site[0])
    until(opened, "document.getElementById('status').textContent === 'Ready.'")
    yield opened
    context.close()
    assert errors == []


def two_lamps(rows: int = 480, columns: int = 160, seed: int = 1) -> Pixels:
    """A tone of 900 Hz and one of 1700 Hz side by side."""
    camera = Camera(ROW_TIME, EXPOSURE)
    x = np.arange(columns)
    light = np.full((rows, columns), 14.0)
    for frequency, centre in ((900.0, 0.25), (1700.0, 0.75)):
        profile = np.exp(-(((x / columns - centre) / 0.1) ** 2))
        light += 180.0 * np.outer(integrate_exposure(Tone(frequency), camera, rows), profile)
    light += np.random.default_rng(seed).normal(scale=1.0, size=light.shape)
    return np.clip(np.rint(light), 0, 255).astype(np.uint8)


def packet_frames(count: int, rows: int = 720, columns: int = 64) -> Pixels:
    """Frames of a lamp that sends "lamp 7" at 15 kHz."""
    camera = Camera(ROW_TIME, EXPOSURE, 1 / 30)
    chips = Chips(transmit(b"lamp 7", format=PacketFormat(block_bytes=8)).chips, 15e3, repeat=True)
    profile = np.exp(-(((np.arange(columns) - columns / 2) / (columns / 6)) ** 2))
    random = np.random.default_rng(2)
    frames = [
        12.0 + 200.0 * np.outer(integrate_exposure(chips, camera, rows, start=k / 30), profile) for k in range(count)
    ]
    return np.clip(np.rint(np.array(frames) + random.normal(size=np.shape(frames))), 0, 255).astype(np.uint8)


def png(pixels: npt.NDArray[Any]) -> bytes:
    from PIL import Image

    stored = io.BytesIO()
    Image.fromarray(pixels).save(stored, "png")
    return stored.getvalue()


def npy(array: npt.NDArray[Any]) -> bytes:
    stored = io.BytesIO()
    np.save(stored, array)
    return stored.getvalue()


def drop(page: Any, name: str, content: bytes, kind: str = "") -> None:
    """Drop a file of these bytes on the page, as a person does."""
    page.evaluate(
        """([name, bytes, type]) => {
          const transfer = new DataTransfer();
          transfer.items.add(new File([Uint8Array.from(atob(bytes), (c) => c.charCodeAt(0))], name, { type }));
          const target = document.getElementById("drop");
          for (const event of ["dragenter", "dragover", "drop"])
            target.dispatchEvent(new DragEvent(event, { dataTransfer: transfer, bubbles: true, cancelable: true }));
        }""",
        [name, base64.b64encode(content).decode(), kind],
    )


def finished(page: Any, timeout: float = 120.0) -> str:
    """The status once nothing is measured any more."""
    until(page, "document.getElementById('cancel').hidden", timeout)
    return str(page.inner_text("#status"))


def settings(page: Any, **values: str) -> None:
    page.evaluate("document.querySelector('details').open = true")
    for name, value in values.items():
        field = page.locator(f"[name={name}]")
        if field.evaluate("field => field.tagName") == "SELECT":
            field.select_option(value)
        else:
            field.fill(value)


def library(page: Any, script: str, *values: Any) -> Any:
    """Run a script in the page with the library, its file readers and values; NaN arrives as None."""
    return page.evaluate(
        """async (values) => {
          const { load } = await import("./ocisac.js");
          const files = await import("./files.js");
          const fetched = async (name) => new File([await (await fetch(name)).blob()], name);
          const gray = (p) => p.channels === 1 ? { ...p } :
            { width: p.width, height: p.height, pixels: p.pixels.filter((_, k) => k % 4 === 1) };
          const run = async (ocisac) => {SCRIPT};
          const plain = (_, v) => ArrayBuffer.isView(v) ? Array.from(v) : Number.isNaN(v) ? null : v;
          return JSON.parse(JSON.stringify(await run(await load()), plain));
        }""".replace("SCRIPT", script),
        list(values),
    )


class TestEqualPixels:
    @pytest.fixture(params=["png", "npy", "npy16"])
    def stored(self, request: pytest.FixtureRequest, site: tuple[str, Path]) -> tuple[str, npt.NDArray[Any]]:
        pixels: npt.NDArray[Any] = two_lamps()
        if request.param == "npy16":
            pixels = pixels.astype(np.uint16) * 257
        name = f"lamps-{request.param}.{request.param[:3]}"
        (site[1] / name).write_bytes(png(pixels) if request.param == "png" else npy(pixels))
        return name, pixels

    def test_numbers_agree_with_python(self, page: Any, stored: tuple[str, npt.NDArray[Any]]) -> None:
        name, pixels = stored
        camera = Camera(ROW_TIME, EXPOSURE)
        found = library(
            page,
            """const file = await fetched(values[0]);
            const stored = values[0].endsWith("png") ? [await files.readPicture(file)] : await files.readArray(file);
            const frame = gray(stored[0]);
            const options = { rowTime: values[1], exposure: values[2] };
            const lights = ocisac.detect(frame, options);
            const tones = lights.map((light) => ocisac.findFrequency(frame, { ...options, region: light.box }));
            const row = ocisac.calibrate({ ...frame }, 900, options);
            return { lights, tones, row };""",
            name,
            ROW_TIME,
            EXPOSURE,
        )
        expected = detect_sources(pixels, camera)
        assert len(found["lights"]) == len(expected) == 2
        for light, tone, source in zip(found["lights"], found["tones"], expected, strict=True):
            box = source.region
            assert light["box"] == {"x": box.x, "y": box.y, "width": box.width, "height": box.height}
            for name in ("frequency", "frequency_std", "gain", "gain_std", "probability"):
                assert light[name.replace("_std", "Std")] == pytest.approx(getattr(source, name), rel=1e-9), name
            part = pixels[box.y : box.y + box.height, box.x : box.x + box.width]
            fitted = find_frequency(part, camera)
            measured = tone_gain(part[:, fitted.columns.used], camera, fitted.frequency, pooled=True)
            assert tone["frequency"] == pytest.approx(fitted.frequency, rel=1e-9)
            assert tone["gain"] == pytest.approx(float(measured.gain), rel=1e-9)
            assert tone["gainStd"] == pytest.approx(float(measured.gain_std), rel=1e-9)
            column = part[:, fitted.columns.used].mean(axis=1)
            assert tone["column"] == pytest.approx(column, rel=1e-9)
        row = calibrate(pixels, 900.0)
        assert found["row"]["rowTime"] == pytest.approx(row.row_time, rel=1e-9)
        assert found["row"]["rowTimeStd"] == pytest.approx(row.row_time_std, rel=1e-9)

    def test_bits_and_payloads(self, page: Any, site: tuple[str, Path]) -> None:
        frames = packet_frames(10)
        (site[1] / "packet.npy").write_bytes(npy(frames))
        found = library(
            page,
            """const receiver = ocisac.receiver({ rowTime: values[0], exposure: values[1], frameTime: 1 / 30,
              chipRate: 15e3, blockBytes: 8, maxLights: 1 });
            const all = (await files.readArray(await fetched("packet.npy"))).map((frame, number) =>
              receiver.push({ ...frame, number })[0]);
            receiver.free();
            return all;""",
            ROW_TIME,
            EXPOSURE,
        )
        receiver = MultiReceiver(
            Camera(ROW_TIME, EXPOSURE, 1 / 30), chip_rate=15e3, format=PacketFormat(block_bytes=8), max_sources=1
        )
        payloads = []
        for number, (frame, result) in enumerate(zip(frames, found, strict=True)):
            received = receiver.push(frame, number=number)[0].received
            assert received is not None
            assert result["bits"] == received.bits
            assert result["rowsPerChip"] == pytest.approx(received.rows_per_chip, rel=1e-9)
            assert result["dataSnr"] == pytest.approx(received.snr, rel=1e-6)
            if result["payload"]:
                payloads.append(bytes(result["payload"]))
        assert payloads
        assert set(payloads) == {b"lamp 7"}

    def test_exposure_advice(self, page: Any) -> None:
        best, free = library(
            page,
            """return [ocisac.adviseExposure({ commFrequency: 700, senseFrequency: 175 }),
              ocisac.adviseExposure({}, [{ frequency: 100, uncertainty: 1 }, { frequency: 120 }])];""",
        )
        assert best["exposure"] == pytest.approx(float(best_exposure(700, 175).exposure), rel=1e-12)
        expected = flicker_free_exposure([FlickeringLight(100.0, uncertainty=1.0), FlickeringLight(120.0)], 0.02)
        assert free["exposure"] == pytest.approx(expected.exposure, rel=1e-12)
        assert free["holds"] == expected.holds

    def test_refusals_are_lines(self, page: Any) -> None:
        script = """const frame = { pixels: new Uint8Array(64), width: 8, height: 8 };
          const tried = [() => ocisac.detect(frame, { rowTime: -1 }),
            () => ocisac.detect(frame, { rowTime: 1, what: 1 }),
            () => ocisac.detect({ ...frame, width: 9 }, { rowTime: 1 }), () => ocisac.adviseExposure({}),
            () => ocisac.findFrequency(frame, { rowTime: 1, scanAxis: "sideways" })];
          return tried.map((call) => { try { call(); return null; } catch (problem) { return problem.message; } });"""
        expected = ["row_time: got -1", "options: got what", "pixels: got 64", "request: got neither"]
        for line, begin in zip(library(page, script), [*expected, "scanAxis: got sideways"], strict=True):
            assert line.startswith(begin), line


class TestFiles:
    def test_a_picture(self, page: Any) -> None:
        settings(page, rowTime="22.2", exposure="100")
        drop(page, "lamps.png", png(two_lamps()), "image/png")
        assert finished(page) == "2 lights were found."
        rows = page.locator("#lights tr").all_inner_texts()
        assert len(rows) == 2
        assert sorted(float(row.split("\t")[1].split(" ")[0]) for row in rows) == pytest.approx([900, 1700], abs=2)
        gains = {
            round(float(row.split("\t")[1].split(" ")[0]), -2): float(row.split("\t")[2].split(" ")[0]) for row in rows
        }
        for source in detect_sources(two_lamps(), Camera(ROW_TIME, EXPOSURE)):
            assert gains[round(source.frequency, -2)] == pytest.approx(source.gain, rel=1e-4)
        assert "Best exposure for this light" in page.inner_text("#facts")
        assert "Light 1: the fit" in page.inner_text("#spectrum-text")
        assert "2 boxes" in page.get_attribute("#picture", "aria-label")

    def test_a_known_lamp_gives_the_row_time(self, page: Any) -> None:
        settings(page, known="900")
        drop(page, "lamp.png", png(two_lamps()[:, :80]), "image/png")
        finished(page)
        facts = page.inner_text("#facts")
        assert float(facts.split("Row time")[1].split("±")[0]) == pytest.approx(22.2, abs=0.02)

    def test_a_jpeg_has_the_same_lights(self, page: Any) -> None:
        from PIL import Image

        pixels, stored = two_lamps(), io.BytesIO()
        Image.fromarray(pixels).save(stored, "jpeg", quality=92)
        settings(page, rowTime="22.2", exposure="100")
        drop(page, "lamps.jpg", stored.getvalue(), "image/jpeg")
        assert finished(page) == "2 lights were found."

    def test_a_video_and_an_array(self, page: Any, tmp_path: Path) -> None:
        frames = packet_frames(16)
        settings(page, rowTime="22.2", exposure="100", chipRate="15000", blockBytes="8")
        drop(page, "packet.npy", npy(frames))
        assert "1 payload whole." in finished(page)
        assert "“lamp 7”" in page.inner_text("#data")

        av = pytest.importorskip("av")
        path = tmp_path / "packet.mp4"
        with av.open(str(path), "w") as container:
            stream = container.add_stream("libx264", rate=30, options={"crf": "12"})
            stream.width, stream.height, stream.pix_fmt = frames.shape[2], frames.shape[1], "yuv420p"
            for frame in frames:
                picture = av.VideoFrame.from_ndarray(np.repeat(frame[..., None], 3, axis=2), format="rgb24")
                for coded in stream.encode(picture):
                    container.mux(coded)
            for coded in stream.encode():
                container.mux(coded)
        page.evaluate("document.getElementById('data').replaceChildren()")
        drop(page, "packet.mp4", path.read_bytes(), "video/mp4")
        assert "1 payload whole." in finished(page)
        assert "“lamp 7”" in page.inner_text("#data")

    @pytest.mark.parametrize(
        ("name", "content", "kind", "message"),
        [
            ("torn.png", png(two_lamps())[:3000], "image/png", "torn.png: this browser cannot read it"),
            ("torn.npy", npy(two_lamps())[:3000], "", "torn.npy: ends before its last frame"),
            ("text.npy", b"no array at all, but text", "", "text.npy: is no .npy array"),
            ("floats.npy", npy(np.zeros((9, 9))), "", "floats.npy: got <f8 values"),
            ("torn.mp4", b"\0\0\0\x18ftypmp42 and then nothing", "video/mp4", "torn.mp4: this browser cannot play it"),
        ],
    )
    def test_a_damaged_file_is_one_line(self, page: Any, name: str, content: bytes, kind: str, message: str) -> None:
        drop(page, name, content, kind)
        assert finished(page) == "Nothing was measured."
        assert page.inner_text("#problem").startswith(message)
        drop(page, "lamps.png", png(two_lamps()), "image/png")
        assert "lights were found" in finished(page)
        assert page.inner_text("#problem") == ""

    def test_wrong_settings_are_named(self, page: Any) -> None:
        settings(page, rowTime="soon")
        drop(page, "lamps.png", png(two_lamps()), "image/png")
        assert finished(page) == "Nothing was measured."
        assert page.inner_text("#problem").startswith("Row time (µs): got soon")


@pytest.mark.parametrize("name", ["laser_square_00.png", "no_light_board.jpg", "underwater_0.jpeg"])
def test_recorded_pictures(page: Any, recordings: Path, name: str) -> None:
    drop(page, name, (recordings / name).read_bytes(), "image/png" if name.endswith("png") else "image/jpeg")
    status = finished(page, 400.0)
    assert page.inner_text("#problem") == ""
    assert status.endswith("found.") or status.startswith("No modulated light")


def test_a_recorded_video(page: Any, recordings: Path) -> None:
    """The first frames of a phone's film; the rest is cancelled."""
    drop(page, "phone_video.mp4", (recordings / "phone_video.mp4").read_bytes(), "video/mp4")
    until(page, "/^Frame [3-9] of/.test(document.getElementById('status').textContent)", 400.0)
    assert page.is_visible("#results")
    page.click("#cancel")
    assert finished(page) == "Cancelled."


class TestDemo:
    def test_one_click(self, page: Any) -> None:
        page.click("#demo")
        assert "1 payload whole." in finished(page)
        assert "“Hello from a lamp”" in page.inner_text("#data")
        assert page.locator("#lights tr").count() == 2
        assert "carries data" in page.inner_text("#lights")
        tones = [line for line in page.inner_text("#data").splitlines() if " Hz, gain " in line]
        assert len(tones) == 1  # not the strongest line of the other lamp's chips
        assert tones[0].startswith("900 Hz")

    def test_offline_once_loaded(self, browser: Any, site: tuple[str, Path]) -> None:
        context = browser.new_context()
        page = context.new_page()
        page.goto(f"{site[0]}style.css")
        page.evaluate("Promise.all(['another page', 'ocisac 0'].map((name) => caches.open(name))).then(() => true)")
        page.goto(site[0])
        page.evaluate("navigator.serviceWorker.ready.then(() => true)")
        until(page, "navigator.serviceWorker.controller !== null", 30.0)
        kept = page.evaluate("caches.keys()")
        assert "another page" in kept  # of the same origin
        assert len([name for name in kept if name.startswith("ocisac ")]) == 1
        context.set_offline(True)
        page.reload()
        until(page, "document.getElementById('status').textContent === 'Ready.'")
        page.click("#demo")
        assert "1 payload whole." in finished(page)
        page.goto(f"{site[0]}send.html")
        until(page, "!document.getElementById('start').disabled")
        context.close()

    def test_cancel(self, page: Any) -> None:
        """At the first frame, however fast the others would follow."""
        page.evaluate(
            """() => {
              const status = document.getElementById("status");
              new MutationObserver((_, observer) => {
                if (!status.textContent.startsWith("Frame")) return;
                observer.disconnect();
                document.getElementById("cancel").click();
              }).observe(status, { childList: true });
            }"""
        )
        drop(page, "long.npy", npy(np.tile(packet_frames(2), (40, 1, 1))))
        assert finished(page) == "Cancelled."
        assert page.inner_text("#problem") == ""
        page.click("#demo")
        assert "1 payload whole." in finished(page)


def test_the_camera(playwright: Any, site: tuple[str, Path], tmp_path: Path) -> None:
    """Chromium's fake camera shows a recording again and again."""
    rows, columns = 480, 640
    lamp = two_lamps(rows, columns, seed=3)
    path = tmp_path / "camera.y4m"
    with path.open("wb") as file:
        file.write(f"YUV4MPEG2 W{columns} H{rows} F20:1 Ip C420jpeg\n".encode())
        for _ in range(3):
            file.write(b"FRAME\n" + lamp.tobytes() + bytes([128]) * (rows * columns // 2))
    flags = [*_FLAGS, "--use-fake-device-for-media-stream", f"--use-file-for-fake-video-capture={path}"]
    browser = playwright.chromium.launch(executable_path=CHROMIUM, args=flags)
    page = browser.new_context(permissions=["camera"]).new_page()
    page.goto(site[0])
    until(page, "document.getElementById('status').textContent === 'Ready.'")
    settings(page, rowTime="22.2", exposure="100")
    page.click("#camera")
    until(page, "/Camera: [3-9] frames/.test(document.getElementById('status').textContent)", 120.0)
    frequencies = [float(row.split("\t")[1].split(" ")[0]) for row in page.locator("#lights tr").all_inner_texts()]
    page.click("#cancel")
    assert finished(page) == "Cancelled."
    assert page.is_hidden("#video")
    browser.close()
    assert sorted(frequencies) == pytest.approx([900, 1700], rel=0.01)


class TestAccess:
    def test_keyboard_alone(self, page: Any) -> None:
        """Tab reaches every control in order; Enter starts the demo; the focus goes to what was found."""
        reached = []
        for _ in range(5):
            page.keyboard.press("Tab")
            reached.append(page.evaluate("document.activeElement.id || document.activeElement.tagName.toLowerCase()"))
        assert reached == ["a", "file", "camera", "demo", "summary"]
        page.focus("#demo")
        page.keyboard.press("Enter")
        finished(page)
        assert page.evaluate("document.activeElement.id") == "results-title"

    @pytest.mark.parametrize("name", ["", "send.html"])
    def test_names_and_languages(self, page: Any, site: tuple[str, Path], name: str) -> None:
        """What a screen reader needs: names of controls and pictures, headings in order, a language, live regions."""
        page.goto(site[0] + name)
        problems = page.evaluate(
            """() => {
              const problems = [];
              const named = (e) => e.getAttribute("aria-label") || e.getAttribute("aria-labelledby") ||
                e.labels?.length || e.textContent.trim();
              for (const e of document.querySelectorAll("input, select, button, a, nav, dialog")) if (!named(e))
                problems.push(`${e.tagName} ${e.id || e.name} has no name`);
              const levels = [...document.querySelectorAll("h1, h2, h3")].map((h) => Number(h.tagName[1]));
              levels.forEach((level, k) => {
                if (level > (levels[k - 1] ?? 0) + 1) problems.push(`heading ${k} skips`);
              });
              if (!document.documentElement.lang) problems.push("no language");
              for (const role of ["status", "alert"])
                if (!document.querySelector(`[role=${role}]`)) problems.push(`no ${role}`);
              if (document.documentElement.scrollWidth > innerWidth) problems.push("wider than a phone");
              return problems;
            }"""
        )
        assert problems == []


class TestSending:
    def test_the_screen_flashes_the_chips(self, page: Any, site: tuple[str, Path]) -> None:
        page.goto(f"{site[0]}send.html")
        until(page, "!document.getElementById('start').disabled")
        page.fill("[name=text]", "lamp 7")
        page.fill("[name=blockBytes]", "8")
        page.fill("[name=pictures]", "2")
        expected = "".join(map(str, transmit(b"lamp 7", format=PacketFormat(block_bytes=8)).chips))
        assert page.inner_text("#plan").startswith(f"{len(expected)} chips, 30.0 a second")
        page.evaluate(
            """() => {
              window.seen = "";
              const flash = document.getElementById("flash");
              document.getElementById("start").click();
              const look = () => {  // after the page's own change for this picture of the screen
                if (!flash.open) return;
                window.seen += flash.style.background.includes("255") ? "1" : "0";
                requestAnimationFrame(look);
              };
              requestAnimationFrame(look);
            }"""
        )
        until(page, "window.seen.length >= 100")
        page.keyboard.press("Escape")
        assert page.is_hidden("#flash")
        seen = page.evaluate("window.seen")
        assert seen[0:100:2] == expected[: len(seen[0:100:2])]

    def test_what_has_no_chips_is_refused(self, page: Any, site: tuple[str, Path]) -> None:
        page.goto(f"{site[0]}send.html")
        until(page, "!document.getElementById('start').disabled")
        page.fill("[name=text]", "")
        assert page.is_disabled("#start")
        assert page.inner_text("#problem").startswith("payload: got 0 bytes")


def test_the_package_has_types_and_a_version() -> None:
    assert SITE is not None
    package = Path(SITE).parent / "package"
    told = json.loads((package / "package.json").read_text())
    assert told["private"]
    for name in told["files"]:
        assert (package / name).exists(), name
    for folder in (package, Path(SITE)):
        assert {path.name for path in (folder / "licenses").iterdir()} == {"Eigen.txt", "Emscripten.txt", "Highway.txt"}
    root = Path(__file__).parents[2]
    assert f"project(ocisac VERSION {told['version']} " in (root / "cpp" / "CMakeLists.txt").read_text()
