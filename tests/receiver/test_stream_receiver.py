"""Payloads out of frames: through the gap between them, past frames that are missing, repeated or damaged."""

import base64
import copy
import dataclasses
import io
import itertools
import json
import math
import pickle
import sys

import numpy as np
import pytest

import ocisac_fast as ocisac
from ocisac_fast import Camera, Chips, Flag, integrate_exposure
from ocisac_fast.cleaning import VideoCleaner
from ocisac_fast.packets import PacketAssembler, PacketFormat, transmit
from ocisac_fast.packets.goodput import possible_goodput
from ocisac_fast.receiver import FskReceiver, GainOptions, MultiReceiver, Receiver
from ocisac_fast.scene.simulation import lamp_bar, simulate_frames, texture as scene_texture

ROW_TIME, FRAME_TIME, CHIP_RATE = 22.2e-6, 1 / 30, 8e3
LAMP = Camera(ROW_TIME, 100e-6, frame_time=FRAME_TIME)
PAYLOAD = np.random.default_rng(11).bytes(1000)
KINDS = {3: "dark", 7: "noise", 9: "nan", 12: "shape", 15: "missing", 16: "missing", 17: "missing"}
NUMBERS = ("phase", "rows_per_chip", "rows_per_chip_std", "chip_rate", "exposure", "exposure_std", "snr", "error_rate")


class Light:
    """Rows of a packet's light: a gradient, ambient light, noise (share of the swing), a clock that drifts."""

    def __init__(self, payload, seed, exposure=622e-6, noise=0.04, drift=0.0, rows=1080, number=0, **packet):
        self.random = np.random.default_rng(seed)
        self.format = PacketFormat(**packet)
        self.waveform = ocisac.transmit(payload, format=self.format, number=number).waveform(CHIP_RATE)
        self.camera = Camera(ROW_TIME, exposure, frame_time=FRAME_TIME)
        self.start, self.drift, self.noise, self.rows = self.random.uniform(0, 8), drift, noise, rows

    def frame(self, index):
        start = self.start + index * FRAME_TIME * (1 + self.drift)
        light = ocisac.integrate_exposure(self.waveform, self.camera, self.rows, start=start)
        noisy = light + self.noise * self.random.standard_normal(self.rows)
        return 20 + 100 * np.linspace(1, 0.6, self.rows) * noisy


def until_payload(receiver, frames, payload):
    """Results up to the first one with a payload, which is this one."""
    results = []
    for frame in frames:
        results.append(receiver.push(frame))
        if results[-1].payload is not None:
            assert results[-1].payload.data == payload
            return results
    raise AssertionError(f"no payload in {len(results)} frames; {results[-1]}")


def frames_needed(light, receiver, payload, most=130):
    return len(until_payload(receiver, map(light.frame, range(most)), payload))


def payloads_of(results):
    return {result.payload.data for result in results if result.payload is not None}


def share_of_wrong(result, chips, camera, time, rate=CHIP_RATE, beside=1):
    """Share of wrong bits, at the place where the light's clock has them, or up to so many chips beside it."""
    bits = np.frombuffer(result.bits.encode(), np.uint8) - ord("0")
    first = round((time + result.phase * camera.row_time - camera.exposure / 2) * rate)
    places = first + np.arange(bits.size) + np.arange(-beside, beside + 1)[:, None]
    return np.mean(bits != chips[places % chips.size], axis=1).min()


class FineLight(Light):
    """A light whose rows may be displaced by a share of a row."""

    FINER = 20

    def displaced(self, index, rows):
        """Rows (of the frame, from 60 rows before its first one on) where the frame shows others."""
        fine = Camera(ROW_TIME / self.FINER, self.camera.exposure)
        start = self.start + index * FRAME_TIME - 60 * ROW_TIME
        light = ocisac.integrate_exposure(self.waveform, fine, self.FINER * 1200, start=start)
        noise = self.random.standard_normal(self.rows)
        return 20 + 100 * light[np.rint(self.FINER * (rows + 60)).astype(int)] + noise


@pytest.mark.parametrize(
    ("drift", "rate_error", "exposure_known"),
    [(0.0, 0.0, True), (5e-5, 0.01, True), (-5e-5, -0.01, True), (0.0, 0.005, False)],
)
def test_a_kilobyte_comes_whole_at_an_exposure_of_five_chips(drift, rate_error, exposure_known):
    """The figure asked for: at most 130 frames (83.4 are the floor), locked or drifting, 4 % noise, a gradient."""
    light = Light(PAYLOAD, seed=int(1e6 * (drift + 1)), drift=drift)
    camera = light.camera if exposure_known else Camera(ROW_TIME, None, frame_time=FRAME_TIME)
    assert frames_needed(light, Receiver(camera, chip_rate=CHIP_RATE * (1 + rate_error)), PAYLOAD) <= 118


@pytest.mark.parametrize("line_code", ["none", "4b6b", "8b10b"])
def test_every_line_code_comes_through_blind_at_a_short_exposure(line_code):
    light = Light(PAYLOAD[:300], seed=2, exposure=90e-6, line_code=line_code)
    assert frames_needed(light, Receiver(light.camera, format=light.format), PAYLOAD[:300]) < 60


def test_a_lengthened_preamble_serves_long_exposures():
    light = Light(PAYLOAD[:60], seed=3, exposure=1.1e-3, noise=0.01, block_bytes=4, preamble="lengthened")
    receiver = Receiver(light.camera, chip_rate=CHIP_RATE * 1.005, format=light.format)
    assert frames_needed(light, receiver, PAYLOAD[:60]) < 40


def test_what_a_frame_tells_is_right():
    light = Light(PAYLOAD, seed=4, noise=0.02)
    receiver = Receiver(Camera(ROW_TIME, None, frame_time=FRAME_TIME), chip_rate=8.1e3)
    for index in range(6):
        result = receiver.push(light.frame(index))
    assert (result.outcome, result.frame, result.colour, result.flags) == ("received", 5, 0, 0)
    assert abs(result.chip_rate / CHIP_RATE - 1) < 1e-3
    assert abs(result.exposure - 622e-6) < 5 * result.exposure_std < 1e-5
    assert 400 < result.snr < 900
    assert 0 <= result.error_rate < 1e-6
    # The chips themselves, by the light's own clock: half an exposure and a row's time away.
    start = light.start + 5 * FRAME_TIME + result.phase * ROW_TIME - 311e-6
    first = round(start * CHIP_RATE)
    assert abs(start * CHIP_RATE - first) < 0.1
    levels = light.waveform.levels[(first + np.arange(len(result.bits))) % len(light.waveform.levels)]
    assert result.bits == "".join(str(int(level)) for level in levels)
    assert len(result.llr) == len(result.bits) >= 189


def test_frames_missing_repeated_damaged_and_dark_cost_no_more_than_themselves():
    light, receiver = Light(PAYLOAD[:400], seed=5), Receiver(Light(b"a", 0).camera, chip_rate=CHIP_RATE)
    outcomes, payload = {}, None
    for index in range(120):
        kind = KINDS.get(index % 20)
        rows = light.frame(index)
        if kind == "missing":
            continue
        if kind in ("dark", "noise"):
            rows = 20 + (kind == "noise") * light.random.standard_normal(len(rows))
        if kind == "nan":
            rows[500] = np.nan
        result = receiver.push(rows[:700] if kind == "shape" else rows, number=index)
        outcomes.setdefault(kind, set()).add(result.outcome)
        again = receiver.push(light.frame(index), number=index)
        if kind == "shape":
            assert again.outcome in ("received", "no_signal")
            payload = payload or again.payload
        else:
            assert again.outcome == "repeated"
        assert all(np.isnan(getattr(again, name)) for name in NUMBERS) or again.outcome == "received"
        payload = payload or result.payload
        if payload is not None:
            break
    assert payload is not None
    assert payload.data == PAYLOAD[:400]
    assert index < 75
    assert outcomes["dark"] == outcomes["noise"] == {"no_signal"}
    assert outcomes["nan"] == {"not_finite"}
    assert outcomes["shape"] == {"other_shape"}


def test_another_packet_and_a_jump_of_the_clock():
    receiver = Receiver(Light(b"a", 0).camera, chip_rate=CHIP_RATE)
    got = []
    for number, payload in enumerate((b"first " * 20, b"second" * 25)):
        light = Light(payload, seed=20 + number, number=number)
        for index in range(45):
            if index == 10:
                light.start += 0.77
            result = receiver.push(light.frame(index))
            if result.payload is not None:
                got.append((result.payload.number, result.payload.data))
    assert list(dict.fromkeys(got)) == [(0, b"first " * 20), (1, b"second" * 25)]


def test_never_a_payload_out_of_noise_or_other_light():
    random = np.random.default_rng(7)
    receiver = Receiver(Light(b"a", 0).camera, chip_rate=CHIP_RATE)
    for _ in range(3):
        assert receiver.push(random.standard_normal(1080)).payload is None
    chips = ocisac.Chips(random.integers(0, 2, 4000), CHIP_RATE, repeat=True)
    for index in range(20):
        rows = ocisac.integrate_exposure(chips, Light(b"a", 0).camera, 1080, start=index / 30)
        assert receiver.push(rows + 0.02 * random.standard_normal(1080)).payload is None


@pytest.mark.parametrize("kind", ["tone", "mains", "random chips"])
def test_light_that_violates_the_line_code_has_no_bits_without_a_flag(kind):
    """Edges off the chip clock fit a tone as well; the words of Manchester code do not."""
    camera, rows = Camera(22.2e-6, 622e-6, frame_time=1 / 30), 22.2e-6 * np.arange(1080)[:, np.newaxis]
    read = 0
    for seed in range(4):
        random, receiver = np.random.default_rng([seed, 4]), Receiver(camera, chip_rate=8e3)
        frequency, chips = random.uniform(300, 3000), random.integers(0, 2, 4000)
        for k in range(15):
            times = k / 30 + rows
            exposed = [chips[(8e3 * (times - late)).astype(int)] for late in np.linspace(0, 622e-6, 51)]
            light = {
                "tone": 0.5 + 0.4 * np.sin(2 * np.pi * frequency * times),
                "mains": 0.5 + 0.5 * np.abs(np.sin(2 * np.pi * 50 * times)),
                "random chips": np.mean(exposed, axis=0),
            }[kind]
            picture = 60 + 100 * light + random.normal(0, 2, (1080, 64))
            frame = receiver.push(np.clip(np.rint(picture), 0, 255).astype(np.uint8))
            read += bool(frame.bits)
            assert frame.flags or not frame.bits
    assert read > 0


def test_a_stream_that_begins_anew_is_believed_after_eight_frames():
    """A count from 0 again, and another picture size: neither may leave the receiver deaf."""
    light = Light(b"anew", seed=9, noise=0.01)
    receiver = Receiver(light.camera, chip_rate=CHIP_RATE)
    assert receiver.push(light.frame(0), number=1000).outcome == "received"
    outcomes = [receiver.push(light.frame(1 + index), number=index) for index in range(9)]
    assert [result.outcome for result in outcomes] == ["repeated"] * 7 + ["received"] * 2
    assert outcomes[7].missing == 0
    light.rows = 900
    outcomes = [receiver.push(light.frame(10 + index)) for index in range(9)]
    assert [result.outcome for result in outcomes] == ["other_shape"] * 7 + ["received"] * 2
    assert [result.frame for result in outcomes] == list(range(9, 18))
    assert receiver.push(light.frame(22), number=21).missing == 3


def test_searches_in_vain_become_rare_and_the_light_is_found_again():
    light = Light(b"later", seed=10, noise=0.01)
    receiver = Receiver(light.camera, chip_rate=CHIP_RATE)
    fences = np.diff(light.random.standard_normal(40 * 1080 + 1)).reshape(40, 1080)  # opposite from row to row
    outcomes = [receiver.push(rows).outcome for rows in fences]
    assert set(outcomes) == {"no_signal", "unsearched"}
    assert 5 <= outcomes.count("no_signal") <= 10
    outcomes = [receiver.push(light.frame(index)).outcome for index in range(10)]
    assert "received" in outcomes[:8]
    assert outcomes[8:] == ["received", "received"]


def test_frames_below_the_dark_level_do_not_scale_the_exposure():
    light = Light(PAYLOAD, seed=12, noise=0.01)
    receiver = Receiver(light.camera, chip_rate=CHIP_RATE)
    for index in range(3):
        assert receiver.push(light.frame(index)).outcome == "received"
    for index in range(3, 9):
        receiver.push(light.frame(index) - 5 + np.sin(np.arange(1080) / 7))
    assert "received" in [receiver.push(light.frame(index)).outcome for index in range(9, 18)]


def test_rows_displaced_by_a_stabiliser_are_received():
    """A sine of two cycles in the frame, one row high, of another phase in each frame."""
    light, row = FineLight(b"displaced", seed=13), np.arange(1080)

    def frame(index):
        warp = np.sin(2 * np.pi * (2 * row / 1080 + light.random.uniform()))
        return light.displaced(index, row + warp)

    results = until_payload(Receiver(light.camera, chip_rate=CHIP_RATE), map(frame, range(10)), b"displaced")
    assert {(result.outcome, result.flags) for result in results} == {("received", 0)}


def test_bright_rows_of_a_defective_sensor_are_left_out():
    light = Light(b"defects", seed=19, noise=0.01)
    hot = 70 * (np.random.default_rng(3).random(1080) < 0.03)
    receiver = Receiver(light.camera, chip_rate=CHIP_RATE)
    assert payloads_of(receiver.push(light.frame(index) + hot) for index in range(12)) == {b"defects"}


@pytest.mark.parametrize("share", [0.03, 0.08])
def test_rows_pulled_inwards_by_a_lens_correction_are_received(share):
    """The phase is that of the rows as shown; once found, the displacement serves the frames after it."""
    light, row = FineLight(b"a lens", seed=23), np.arange(1080)
    receiver = Receiver(light.camera, chip_rate=CHIP_RATE)
    read = row + share * 540 * ((row - 539.5) / 540) ** 3
    results = [receiver.push(light.displaced(index, read)) for index in range(18)]
    for index, result in enumerate(results):
        if result.flags == 0:
            edge = np.interp(result.phase, row, read) * ROW_TIME - light.camera.exposure / 2
            chips = (light.start + index * FRAME_TIME + edge) * CHIP_RATE
            assert abs(chips - round(chips)) < 0.2
    assert payloads_of(results) == {b"a lens"}


@pytest.mark.parametrize(("pause", "every"), [(2, 128), (1, 64), (3, 150), (1, 128)])
def test_short_pauses_of_the_read_out_are_no_pauses_of_the_sender(pause, every):
    """Rows are longer on average: the clock is whole chips off in each frame, as it is where a sender pauses."""
    rows = np.arange(1080)
    read = rows + pause * (rows // every)
    light = Light(bytes(range(100)), seed=3, noise=0.01, rows=read[-1] + 1)
    frames = (light.frame(index)[read] for index in range(20))
    until_payload(Receiver(light.camera, chip_rate=CHIP_RATE), frames, bytes(range(100)))


def test_a_lamp_behind_rain_is_received():
    """Streaks of 3 columns and up to 150 rows in front of 64 columns, other ones in each frame."""
    light = Light(bytes(range(60)), seed=6, noise=0.0)
    random, lamp = light.random, np.exp(-(((np.arange(64) - 32) / 14) ** 2))

    def frame(index):
        rain = 20 + (light.frame(index) - 20)[:, None] * lamp + 2 * random.standard_normal((1080, 64))
        for _ in range(20):
            row, column = random.integers(-100, 1080), random.integers(0, 62)
            rain[max(row, 0) : row + random.integers(30, 150), column : column + 3] += random.uniform(20, 90)
        return rain

    until_payload(Receiver(light.camera, chip_rate=CHIP_RATE), map(frame, range(16)), bytes(range(60)))


@pytest.mark.parametrize(("line_code", "longest"), [("manchester", 2), ("4b6b", 4), ("8b10b", 5)])
@pytest.mark.parametrize(("top", "bottom"), [(0, 432), (24, 456), (48, 480)])
def test_dark_rows_that_end_a_lamp_are_no_chips(line_code, longest, top, bottom):
    """They are fewer than a run of chips that stand still, and more than the line code has."""
    packets = PacketFormat(line_code=line_code)
    read = 0
    for seed in range(8):
        random = np.random.default_rng(seed)
        rate = 1 / (random.uniform(4, 7) * 22.2e-6)
        camera = Camera(22.2e-6, 0.5 / rate, 1 / 30)
        sent = transmit(random.bytes(12), format=packets).chips
        light = integrate_exposure(Chips(sent, rate, repeat=True), camera, 480, frames=6)
        light[:, :top] = light[:, bottom:] = 0
        noise = random.normal(0, 2, (6, 480, 40))
        receiver = Receiver(camera, chip_rate=rate, format=packets)
        for pixels in np.clip(np.rint(10 + 100 * light[:, :, None] + noise), 0, 255).astype(np.uint8):
            found = receiver.push(pixels)
            if not found.bits or found.flags:
                continue
            read += 1
            chips, errors = "".join(map(str, sent)) * 3, []
            for begin in range(len(sent)):
                window = chips[begin : begin + len(found.bits)]
                errors.append(sum(a != b for a, b in zip(found.bits, window, strict=True)))
            assert min(errors) <= longest * ((top > 0) + (bottom < 480))
    assert read > 24


@pytest.mark.parametrize(("share", "veil"), [(0.3, 0.06), (0.4, 0.12), (0.3, 0.0)])
def test_a_lamp_in_a_veil_of_its_light_is_read_in_its_own_rows(share, veil):
    """Beside another lamp, 36 rows above, where there is no veil."""
    light, other = (Light(b"a veil", seed, noise=0.0, block_bytes=4) for seed in (4, 5))
    off = np.arange(1080) - 539.5
    lit, above = np.abs(off) < 540 * share, np.abs(off + 360) < 540 * share
    receiver, results = Receiver(light.camera, chip_rate=CHIP_RATE, format=light.format), []
    for index in range(40):
        frame = 20 + (np.where(lit, 1, veil) * (light.frame(index) - 20))
        frame += 0.0 if veil else 0.5 * above * (other.frame(index) - 20)
        results.append(receiver.push(frame + 0.3 * light.random.standard_normal(1080)))
    assert payloads_of(results) == {b"a veil"}


@pytest.mark.parametrize("pause", [5, 17, 20])
def test_a_pause_of_the_read_out_in_the_middle_of_the_picture_is_found(pause):
    """Chips after it are in doubt until their number is known from several frames, and right then."""
    light = Light(b"a pause", seed=30, noise=0.01, rows=1080 + pause)
    receiver = Receiver(light.camera, chip_rate=CHIP_RATE)
    sent, lost = np.asarray(ocisac.transmit(b"a pause").chips), np.arange(540, 540 + pause)
    results = [receiver.push(np.delete(light.frame(index), lost)) for index in range(16)]
    for index, result in enumerate(results):
        wrong = share_of_wrong(result, sent, light.camera, light.start + index * FRAME_TIME, beside=0)
        assert wrong < 0.01 or result.error_rate > 0.05
    assert payloads_of(results) == {b"a pause"}
    assert sum(result.flags == 0 for result in results) >= 4


@pytest.mark.parametrize(("pause", "kind"), [(15, "rows"), (12, "curve")])
def test_a_pause_of_the_read_out_beside_another_misfit_is_never_silent(pause, kind):
    """The row time is 1.5 % longer than stated, or a tone curve is not: chips after the pause were of other numbers."""
    light = Light(b"a pause", seed=30, noise=0.01, rows=1080 + pause)
    camera = dataclasses.replace(light.camera, row_time=ROW_TIME * (0.985 if kind == "rows" else 1))
    receiver = Receiver(camera, chip_rate=CHIP_RATE)
    sent, lost = np.asarray(ocisac.transmit(b"a pause").chips), np.arange(540, 540 + pause)
    for index in range(16):
        frame = np.delete(light.frame(index), lost)
        result = receiver.push(frame if kind == "rows" else 255 * (frame.clip(0, 255) / 255) ** 1.5)
        wrong = share_of_wrong(result, sent, light.camera, light.start + index * FRAME_TIME)
        assert wrong < 0.05 or result.error_rate > 0.01


def edges_moved(chips, late, fine=20):
    """The waveform of chips that repeat, each of whose edges comes ``late`` chips after its time."""
    begins = np.rint((np.arange(chips.size) + late) * fine).astype(int)
    lasts = np.diff(begins, append=begins[0] + fine * chips.size)
    return ocisac.Chips(np.roll(np.repeat(chips, lasts), begins[0]), fine * CHIP_RATE, repeat=True)


@pytest.mark.parametrize("kind", ["jitter", "late falls", "late rises", "chopped"])
@pytest.mark.parametrize("exposure", [370e-6, 622e-6])
def test_a_sender_whose_edges_lie_off_its_clock_is_received(kind, exposure):
    light = Light(b"edges off the clock", seed=5, exposure=exposure, noise=0.003)
    chips = ocisac.transmit(b"edges off the clock").chips.astype(float)
    falls, time = chips < np.roll(chips, 1), np.arange(chips.size)
    late = {
        "jitter": light.random.uniform(-0.2, 0.2, chips.size),
        "late falls": 0.4 * falls,
        "late rises": 0.4 * ~falls,
        "chopped": 0.2 * np.abs(2 * np.mod(1.61 * time, 1) - 1) - 0.1,  # as by a wave of 1.61 cycles a chip
    }[kind]
    light.waveform = edges_moved(chips, late)
    receiver = Receiver(light.camera, chip_rate=CHIP_RATE)
    assert until_payload(receiver, map(light.frame, range(12)), b"edges off the clock")[-1].flags == 0


@pytest.mark.parametrize("share", [0.3, 0.5])
def test_frames_that_show_a_share_of_the_one_before_are_received(share):
    """y_k = (1 - share)·s_k + share·y_(k-1), as after noise reduction over time; the first frame shows none."""
    light = Light(b"before", seed=17)
    shown = itertools.accumulate(map(light.frame, range(10)), lambda last, now: (1 - share) * now + share * last)
    results = until_payload(Receiver(light.camera, chip_rate=CHIP_RATE), shown, b"before")
    assert {(result.outcome, result.flags) for result in results} == {("received", 0)}


@pytest.mark.parametrize(
    ("texture", "spot", "light", "tone", "most"),
    [
        (0.1, 1e9, {"rise": 0.4, "fall": 0.4}, (100, 0.0), 16),
        (0.1, 1e9, {}, (100, 0.3), 18),
        (0.15, 1e9, {}, (100, 0.0), 14),
        (0.0, 230, {}, (100, 0.1), 22),
        (0.0, 230, {}, (100, 0.2), 22),
        (0.0, 240, {}, (1270, 0.06), 26),
    ],
    ids=["rise and fall", "hum", "alone", "spot beside hum", "spot beside more hum", "spot beside a lamp"],
)
def test_a_profile_is_learned_beside_other_disturbances(texture, spot, light, tone, most):
    """The limit of frames is that of 100 bytes in a clean stream (11 to 13; round spots 17), and some to learn from."""
    chips = ocisac.transmit(PAYLOAD[:100]).chips
    frames = simulate_frames(
        ocisac.Chips(chips, CHIP_RATE, repeat=True, **light),
        Camera(ROW_TIME, 622e-6, frame_time=FRAME_TIME),
        *(1080, 64, most),
        swing=100,
        dark_level=20,
        noise=2,
        start=0.7,
        lamp=lamp_bar(1080, 64, 26) * np.exp(-0.5 * ((np.arange(1080)[:, None] - 540) / spot) ** 2),
        ambient=ocisac.Tone(tone[0], amplitude=tone[1]),
        reflectance=scene_texture(1080, 64, texture, seed=3),
        seed=3,
    )
    receiver = Receiver(Camera(ROW_TIME, 622e-6, frame_time=FRAME_TIME), chip_rate=CHIP_RATE)
    assert payloads_of(map(receiver.push, frames)) == {PAYLOAD[:100]}


def test_a_search_ends_where_its_passes_are_used_up():
    light = Light(PAYLOAD, seed=3)
    frame = light.frame(0)
    for passes, outcome in ((1, "no_signal"), (5000, "received"), (None, "received"), (np.inf, "received")):
        assert Receiver(light.camera, chip_rate=CHIP_RATE, search_passes=passes).push(frame).outcome == outcome
    lights = MultiReceiver(light.camera, chip_rate=CHIP_RATE, search_passes=1)
    assert lights.push(np.repeat(frame[:, np.newaxis], 8, axis=1))[0].received.outcome == "no_signal"


def lit_rows(random):
    """A lamp over a third of the rows, blurred by a row."""
    steps = [
        [math.erf((n - end) / math.sqrt(2)) for n in range(1080)]
        for end in np.add((360, 719), random.uniform(-1, 1, 2))
    ]
    return 0.5 * np.subtract(*steps)


@pytest.mark.parametrize("seed", range(4))
def test_a_lamp_that_ends_within_a_row_inverts_no_chip(seed):
    """Its first rows leave residuals as large as the light."""
    rate, camera = 20e3, Camera(15e-6, 150e-6, frame_time=FRAME_TIME)
    packet = ocisac.transmit(bytes(range(16)), format=PacketFormat(block_bytes=1))
    waveform, random = packet.waveform(rate), np.random.default_rng(seed)
    receiver, lit = Receiver(camera, chip_rate=rate, format=packet.format), lit_rows(random)
    for index in range(30):
        light = ocisac.integrate_exposure(waveform, camera, 1080, start=index * FRAME_TIME)
        frame = receiver.push(10 + 180 * lit * light + 0.5 * random.standard_normal(1080))
        assert share_of_wrong(frame, packet.chips, camera, index * FRAME_TIME, rate) <= 0.05


@pytest.mark.parametrize("seed", [0, 3])
def test_a_veil_about_a_lamp_is_not_read_as_the_lamp(seed):
    """A tenth of the light of a lamp over a third of the rows in all others: no sure chips are wrong."""
    packet = ocisac.transmit(bytes(range(16)), format=PacketFormat(block_bytes=4))
    camera, waveform = Camera(ROW_TIME, 622e-6, frame_time=FRAME_TIME), packet.waveform(CHIP_RATE)
    receiver, random = Receiver(camera, chip_rate=CHIP_RATE, format=packet.format), np.random.default_rng(seed)
    lit, results = 0.1 + lit_rows(random), []
    for index in range(60):
        light = ocisac.integrate_exposure(waveform, camera, 1080, start=index * FRAME_TIME)
        results.append(receiver.push(20 + 120 * lit * light + 0.3 * random.standard_normal(1080)))
        if results[-1].bits and results[-1].error_rate < 0.01:
            assert share_of_wrong(results[-1], packet.chips, camera, index * FRAME_TIME) <= 0.05
    assert payloads_of(results) == {bytes(range(16))}


def test_what_the_gap_and_the_code_leave():
    camera = Camera(ROW_TIME, frame_time=FRAME_TIME)
    possible = possible_goodput(1000, camera, chip_rate=CHIP_RATE, rows=1080)
    assert possible.sent == 4000
    assert possible.gap == pytest.approx(4000 * 1080 * 22.2e-6 * 30)
    assert possible.gap_frames == pytest.approx(83.4, abs=0.05)
    in_blocks = 16 * 16 / (14 + 18 * 16)  # 12 codewords of 84 bytes hold the payload
    assert possible.code == pytest.approx(possible.gap * in_blocks * 1000 / (12 * 84))
    assert possible.code_frames == pytest.approx(8000 / possible.code * 30)


@pytest.mark.parametrize("rows", [1, 2, 3, 7])
def test_tiny_frames_hold_no_signal(rows):
    receiver = Receiver(Camera(ROW_TIME, 1e-4, frame_time=FRAME_TIME), chip_rate=CHIP_RATE)
    assert receiver.push(np.arange(float(rows))).outcome == "no_signal"


def test_the_command_gives_payloads(tmp_path, run, monkeypatch):
    light = Light(b"over the air", seed=8)
    frames = np.stack([light.frame(index) for index in range(14)])[:, :, np.newaxis]
    frames = frames + light.random.standard_normal((14, 1080, 8))
    path = tmp_path / "frames.npy"
    np.save(path, np.clip(np.rint(frames), 0, 255).astype(np.uint8))
    options = ("--row-time", "22.2us", "--exposure", "622us", "--frame-rate", 30, "--chip-rate", "8kHz")
    coded = (*options, "--line-code", "manchester")

    def told(source, *words):
        code, out, _ = run("receive", source, *coded, *words, "--json")
        assert code == 0
        return [json.loads(line) for line in out]

    found = told(path)
    assert [fact["frame"] for fact in found] == list(range(14))
    payloads = [fact for fact in found if "payload" in fact]
    assert payloads
    assert {fact["payload"] for fact in payloads} == {"over the air"}
    assert base64.b64decode(payloads[0]["payload_base64"]) == b"over the air"
    for words, stored in [([], path.read_bytes()), (["--raw", "8x1080"], np.load(path).tobytes())]:
        monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(stored)))
        assert told("-", *words) == found
    for words, shown in [
        (coded, "over the air"),
        ((*options, "--packets"), "over the air"),  # the sender's default code is the receiver's
        ((*coded, "--block-bytes", 200), "a block of 200 bytes is 3246 chips, a frame shows 191: smaller"),
    ]:
        code, out, _ = run("receive", path, *words)
        assert code == 0
        assert shown in " ".join(out)
    code, _, err = run("receive", path, "--frame-rate", 30, "--packets")
    assert code == 2
    assert "--frame-rate: needs --row-time" in err[-1]


@pytest.mark.parametrize("share", [1 / 4, 1 / 3, 1 / 2])
def test_lamps_that_begin_and_end_on_the_same_rows_are_several_streams(share):
    """The columns have the lamps' ends in common, which are steps larger than those of the chips."""
    rate, camera = 20e3, Camera(15e-6, 150e-6, frame_time=FRAME_TIME)
    packets = [ocisac.transmit(name, format=PacketFormat(block_bytes=1)) for name in (b"a", b"b", b"c")]
    random, rows = np.random.default_rng(34), round(1080 * share)
    receiver = MultiReceiver(camera, chip_rate=rate, format=packets[0].format)
    for index in range(4):
        picture = np.full((1080, 240), 10.0)
        for k, packet in enumerate(packets):
            start = index * FRAME_TIME + 0.3 * k
            light = ocisac.integrate_exposure(packet.waveform(rate), camera, rows, start=start)
            picture[400 : 400 + rows, 30 + 80 * k : 50 + 80 * k] += 180 * light[:, np.newaxis]
        noisy = picture + 2 * random.standard_normal(picture.shape)
        results = receiver.push(np.clip(noisy, 0, 255).astype(np.uint8))
    places = sorted(result.region.x + result.region.width / 2 for result in results)
    assert places == pytest.approx([40, 120, 200], abs=8)


def test_the_gain_of_a_light_is_measured_with_the_given_options():
    tone = ocisac.integrate_exposure(ocisac.SquareWave(500.0, amplitude=200.0), Camera(ROW_TIME, 622e-6), 720)
    picture = np.full((720, 40), 10.0) + tone[:, np.newaxis]
    options = GainOptions(frequency=500.0, waveform="square", background=10.0)
    assert pickle.loads(pickle.dumps(options)) == options
    receiver = MultiReceiver(Camera(ROW_TIME, 622e-6), data=False, gain=options, sense_frequency=350.0)
    (light,) = receiver.push(picture)
    assert light.gain.gain == pytest.approx(np.sinc(500.0 * 622e-6), rel=1e-3)
    assert light.suggestion.exposure > 0.0
    (plain,) = MultiReceiver(Camera(ROW_TIME, 622e-6), data=False).push(picture)
    assert plain.gain is None


def test_lights_that_are_all_lost_do_not_multiply():
    """One light of several that come back takes the place of the nearest."""
    camera, random = Camera(ROW_TIME, 100e-6), np.random.default_rng(5)
    picture = np.full((480, 80), 10.0)
    for left, frequency in ((5, 700.0), (50, 1100.0)):
        wave = ocisac.SquareWave(frequency, amplitude=150.0)
        picture[:, left : left + 20] += ocisac.integrate_exposure(wave, camera, 480)[:, None]
    right = picture.copy()
    right[:, :40] = 10.0
    receiver = MultiReceiver(camera, data=False, max_sources=2)

    def lights(pixels):
        return receiver.push(np.clip(pixels + random.normal(0, 1, pixels.shape), 0, 255).astype(np.uint8))

    for _ in range(6):
        results = lights(picture)
    assert len(results) == 2
    for _ in range(400):
        assert len(lights(np.full_like(picture, 10.0))) <= 2
    for _ in range(150):
        results = lights(right)
    assert max(result.region.x for result in results) >= 40
    assert len(results) <= 2


def test_the_rows_of_a_noisy_lamp_are_not_one_run_of_large_swings():
    """Exposed for 3.3 chips, noise an eighth of the swing: no light is detected, all rows with swings are received."""
    random, rate, camera = np.random.default_rng(6), 10.1e3, Camera(22e-6, 327e-6)
    bits = random.integers(0, 2, 400)
    light = ocisac.integrate_exposure(ocisac.Chips(bits, rate), camera, 1080, start=0.01)
    picture = 80 + 90 * light[:, None] + random.normal(0, 26, (1080, 6))
    receiver = MultiReceiver(camera, chip_rate=rate, format=PacketFormat(line_code="none"))
    (found,) = receiver.push(np.clip(picture, 0, 255).astype(np.uint8))
    assert found.region.height > 900


@pytest.mark.parametrize(
    "stream",
    [
        Receiver(LAMP),
        MultiReceiver(LAMP),
        FskReceiver(LAMP, (1e3, 2e3, 3e3, 4e3)),
        PacketAssembler(),
        VideoCleaner(LAMP),
    ],
)
def test_no_copy_shares_the_state_of_a_stream(stream):
    with pytest.raises(TypeError, match="cannot pickle"):
        copy.copy(stream)


def test_chips_read_at_twice_their_rate_are_flagged():
    """Through a stated exposure of more than a chip, without a chip rate: each chip is read twice."""
    doubled = 0
    for seed in range(24):
        random = np.random.default_rng(seed)
        rows_per_chip = random.uniform(6, 12)
        camera = Camera(22.2e-6, random.uniform(1.2, 4.5) * rows_per_chip * 22.2e-6, 1 / 30)
        chips = Chips(random.integers(0, 2, 400), 1 / (rows_per_chip * camera.row_time))
        light = integrate_exposure(chips, camera, 720, start=40 * rows_per_chip * camera.row_time)
        pixels = np.rint(16 + 90 * light[:, None] + random.normal(0, 0.6, (720, 16))).astype(np.uint8)
        got = Receiver(camera, format=PacketFormat(line_code="none")).push(pixels)
        if got.bits and abs(got.rows_per_chip / rows_per_chip - 0.5) < 0.01:
            doubled += 1
            assert got.flags & Flag.MODEL_MISFIT
    assert doubled > 0


@pytest.mark.parametrize("code", ["none", "manchester", "4b6b", "8b10b"])
@pytest.mark.parametrize("times", [1, 2, 3])
def test_chips_of_a_rate_given_several_times_too_high_are_flagged(times, code):
    """Each is read so many times; few words of a line code tell, and of low frames several together."""
    camera, form = Camera(22e-6, 1e-4, 1 / 30), PacketFormat(line_code=code)
    chips = Chips(transmit(b"Hello world", format=form).chips, 4000.0, repeat=True)
    for rows, least in ((480, 0.9), (140, 0.6)):
        flags = []
        for seed in range(6):
            random = np.random.default_rng(seed)
            receiver = Receiver(camera, chip_rate=4000.0 * times, format=form)
            for frame in range(8):
                light = integrate_exposure(chips, camera, rows, start=frame / 30 + 0.1 * seed)
                pixels = np.rint(10 + 200 * light[:, None] + random.normal(0, 1, (rows, 8))).astype(np.uint8)
                flags.append(bool(receiver.push(pixels).flags & Flag.MODEL_MISFIT))
        assert np.mean(flags) == 0 if times == 1 else np.mean(flags) > least


@pytest.mark.parametrize(
    ("rows_per_chip", "exposure", "seed"), [(10.05, 0.2, 0), (10.05, 0.2, 1), (6, 1.5, 3), (9.6, 0.26, 1)]
)
def test_a_gradient_is_found_with_an_exposure_that_is_not_given(rows_per_chip, exposure, seed):
    random = np.random.default_rng(seed)
    chip_time = rows_per_chip * 22.2e-6
    exposed = Camera(22.2e-6, exposure * chip_time)
    data = random.integers(0, 2, 2000)
    chips = Chips(np.column_stack([data, 1 - data]).ravel(), 1 / chip_time)
    receiver = Receiver(Camera(22.2e-6, frame_time=14e-3), chip_rate=1.002 / chip_time)
    for number in range(4):
        light = integrate_exposure(chips, exposed, 480, start=0.05 + 1e-4 * seed + 14e-3 * number)
        found = receiver.push(30 + 100 * np.linspace(1, 0.8, 480) * light + random.normal(0, 0.5, 480))
        assert not found.flags & Flag.MODEL_MISFIT
        assert found.exposure == pytest.approx(exposed.exposure, rel=0.02)


@pytest.mark.parametrize(
    ("rows_per_chip", "exposure", "seed"), [(12.7, 0.8, 0), (12.7, 0.8, 1), (10.9, 0.8, 4), (8, 0.8, 2)]
)
def test_chips_read_at_three_halves_of_their_rate_are_flagged(rows_per_chip, exposure, seed):
    """Half of the edges lie on that clock, the others in the middle between."""
    random = np.random.default_rng(seed)
    chip_time = rows_per_chip * ROW_TIME
    camera = Camera(ROW_TIME, exposure * chip_time, frame_time=FRAME_TIME)
    chips = Chips(random.integers(0, 2, 9000), 1 / chip_time)
    receiver = Receiver(camera, chip_rate=1.5 / chip_time, format=PacketFormat(line_code="none"))
    for number in range(5):
        light = integrate_exposure(chips, camera, 900, start=0.05 + number * FRAME_TIME)
        found = receiver.push(30 + 100 * light + random.normal(0, 1, 900))
        assert found.flags & Flag.MODEL_MISFIT or not found.bits
