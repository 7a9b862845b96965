from collections.abc import Callable, Sequence
from typing import Any, overload

import numpy as np
import numpy.typing as npt

def version() -> str: ...
def commit() -> str: ...
def compiler() -> str: ...
def opencv_version() -> str: ...
def simd_target() -> str: ...
def simd_targets() -> list[str]: ...

class Camera:
    def __init__(
        self,
        row_time: float,
        exposure: float | None,
        frame_time: float | None,
        tone_curve: str,
        gamma: float,
        dark_level: float,
        white_level: float | None,
    ) -> None: ...

def exposure_response(frequency: npt.ArrayLike, exposure: npt.ArrayLike) -> Any: ...
def is_viewable(array: object) -> bool: ...
def flag_names(flags: int) -> list[str]: ...
def tone_gain(
    columns: npt.NDArray[Any],
    camera: Camera,
    frequencies: npt.ArrayLike,
    method: str,
    waveform: str,
    duty: float,
    background: npt.ArrayLike,
    efficiency: float,
    threads: int,
    pooled: bool,
) -> tuple[Any, Any, Any, Any, Any, Any]: ...
def tone_gain_as_given(
    columns: npt.ArrayLike,
    camera: Camera,
    frequency: npt.ArrayLike,
    method: str,
    waveform: str,
    duty: float,
    background: npt.ArrayLike,
    efficiency: float,
    threads: int,
    pooled: bool,
    /,
) -> tuple[Any, Any, Any, Any, Any, Any] | None: ...
def varying_tone_gain(
    columns: npt.NDArray[Any],
    camera: Camera,
    frequency: float,
    degree: int,
    waveform: str,
    duty: float,
    background: npt.ArrayLike,
    threads: int,
) -> tuple[Any, Any, Any, Any, Any, Any]: ...

class Waveform:
    def __add__(self, other: Waveform) -> Waveform: ...
    def __mul__(self, other: Waveform) -> Waveform: ...

def constant(level: float) -> Waveform: ...
def tone(frequency: float, amplitude: float, phase: float, depth: float) -> Waveform: ...
def square_wave(frequency: float, duty: float, amplitude: float, phase: float) -> Waveform: ...
def triangle_wave(frequency: float, amplitude: float, phase: float, depth: float) -> Waveform: ...
def chips(
    levels: npt.ArrayLike, chip_rate: float, start: float, repeat: bool, amplitude: float, rise: float, fall: float
) -> Waveform: ...
def samples(values: npt.ArrayLike, sample_rate: float, start: float, repeat: bool) -> Waveform: ...
def integrate_exposure(
    waveform: Waveform,
    camera: Camera,
    rows: npt.NDArray[np.int64],
    start: float,
    frames: npt.NDArray[np.int64],
    out: npt.NDArray[np.float64],
) -> None: ...
def sample_waveform(waveform: Waveform, times: npt.ArrayLike) -> npt.NDArray[np.float64]: ...
def best_exposure(
    frequencies: npt.NDArray[np.float64],
    weights: npt.NDArray[np.float64],
    method: str,
    bounds: tuple[float, float] | None,
    step: float | None,
    points: int,
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]: ...
def exposure_objective(
    exposure: npt.NDArray[np.float64], frequencies: npt.NDArray[np.float64], weights: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]: ...
def exposure_modulation(
    lights: npt.NDArray[np.float64], exposure: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]: ...
def cycles_below(light: npt.NDArray[np.float64], below: float, most: float) -> npt.NDArray[np.float64]: ...
def flicker_free_exposure(
    lights: npt.NDArray[np.float64],
    below: float,
    near: float | None,
    bounds: tuple[float, float],
    step: float | None,
    f_comm: float | None,
    f_sense: float | None,
    min_gain: float | None,
    weights: tuple[float, float],
) -> tuple[float, float, bool, tuple[float, ...], float, float]: ...
def amplitude_spectrum(signal: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]: ...
def equalize(
    columns: npt.NDArray[Any],
    camera: Camera,
    method: str,
    noise: npt.NDArray[np.float64],
    max_boost: float,
    threads: int,
    out: npt.NDArray[np.float64] | npt.NDArray[np.float32],
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], npt.NDArray[np.float64]]: ...
def tone_design(rows: int, cycles_per_row: Sequence[float], trend_degree: int) -> npt.NDArray[np.float64]: ...
def linear_light(values: npt.NDArray[Any], camera: Camera, type_maximum: float) -> npt.NDArray[np.float64]: ...
def stored_value(values: npt.NDArray[Any], camera: Camera, type_maximum: float) -> npt.NDArray[np.float64]: ...
def light_per_step(values: npt.NDArray[Any], camera: Camera, type_maximum: float) -> npt.NDArray[np.float64]: ...
def saturation_level(camera: Camera, type_maximum: float) -> float: ...
def lost_frequencies(camera: Camera, max_boost: float) -> npt.NDArray[np.float64]: ...
def find_frequency(
    columns: npt.NDArray[Any],
    camera: Camera,
    bounds: tuple[float, float] | None,
    waveform: str,
    select_columns: bool,
) -> tuple[float, float, float, int, int, tuple[npt.NDArray[np.bool_], npt.NDArray[np.float64], bool]]: ...
def tone_columns(
    columns: npt.NDArray[Any], camera: Camera, frequency: float
) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.float64], bool]: ...
def receive(
    colours: Sequence[npt.NDArray[Any]], camera: Camera, chip_rate: float | None
) -> list[tuple[int, int, int, str, float, float, float, float, Any, Any, Any, Any, int, Any]]: ...
def expose_chips(
    chips: npt.NDArray[np.float64], first: int, rows: int, rows_per_chip: float, phase: float, exposure_rows: float
) -> npt.NDArray[np.float64]: ...
def fit_channel(
    signal: npt.NDArray[np.float64],
    chips: npt.NDArray[np.float64],
    first: int,
    rows_per_chip: float,
    phase: float,
    exposure_rows: float,
    dark_degree: int,
    swing_degree: int,
    exposure_known: bool,
) -> tuple[Any, ...] | None: ...
def clock_bounds(
    chips: npt.NDArray[np.float64],
    first: int,
    rows_per_chip: float,
    phase: float,
    exposure_rows: float,
    swing: npt.NDArray[np.float64],
    noise: float,
    dark_degree: int,
    swing_degree: int,
    exposure_known: bool,
) -> tuple[int, list[float]] | None: ...
def find_preamble(
    signal: npt.NDArray[np.float64],
    preamble: npt.NDArray[np.float64],
    rows_per_chip: float,
    tolerance: float,
    exposure_rows: float | None,
    max_exposure_chips: float,
    max_matches: int,
) -> list[tuple[tuple[Any, ...], float, float]]: ...
def chip_llr(
    rows: npt.NDArray[np.float64],
    rows_per_chip: float,
    phase: float,
    exposure_rows: float,
    noise: float,
    first: int,
    count: int,
    method: str,
) -> npt.NDArray[np.float64]: ...
def detect_chips(
    columns: npt.NDArray[Any], camera: Camera, channel: tuple[Any, ...], method: str
) -> tuple[npt.NDArray[np.float64], int, str]: ...
def detector_names() -> list[str]: ...
def detector_error_rates(
    rows_per_chip: float, exposure_rows: float, noise: float
) -> tuple[float, float, float, float, float]: ...
def closest_pair_distance(rows_per_chip: float, exposure_rows: float) -> float: ...
def refine_channel(
    signal: npt.NDArray[np.float64],
    start: tuple[Any, ...],
    detect: Callable[..., Any] | None,
    exposure_known: bool,
    highest_degree: int,
    known: npt.NDArray[np.float64],
    known_first: int,
) -> tuple[tuple[Any, ...], npt.NDArray[np.float64], int, bool, bool] | None: ...
def find_channel(
    signal: npt.NDArray[np.float64],
    rows_per_chip: float,
    tolerance: float,
    exposure_rows: float | None,
    max_exposure_chips: float,
    detect: Callable[..., Any] | None,
    exposure_known: bool,
    highest_degree: int,
) -> tuple[tuple[Any, ...], npt.NDArray[np.float64], int, bool, bool] | None: ...

class ClockTracker:
    def __init__(self, frame_rows: float, frame_rows_std: float, drift: float, exposure_wander: float) -> None: ...
    def update(
        self,
        frame: int,
        rows_per_chip: float,
        phase: float,
        exposure_rows: float,
        chip: int,
        covariance: Sequence[float],
    ) -> bool: ...
    def predict(self, frame: int) -> tuple[float, float, float, int, list[float], float] | None: ...
    def reset(self) -> None: ...

def pool_estimates(values: npt.NDArray[np.float64], errors: npt.NDArray[np.float64]) -> tuple[float, float, int]: ...
def detect_sources(
    frames: npt.NDArray[Any],
    camera: Camera,
    false_alarms: float,
    min_cycles: float,
    max_sources: int,
    frame: int | None,
) -> list[tuple[Any, ...]]: ...
def light_candidates(
    frame: npt.NDArray[Any], camera: Camera, data: bool
) -> list[tuple[tuple[int, int, int, int], float, float, float, list[float], bool]]: ...
def follow_sources(
    frame: npt.NDArray[Any],
    camera: Camera,
    expected: Sequence[tuple[tuple[int, int, int, int], float, tuple[int, int, int, int], bool, bool]],
    false_alarms: float,
    min_cycles: float,
) -> list[tuple[Any, ...]]: ...

class KnownLight:
    def __init__(
        self,
        frame: npt.NDArray[Any],
        camera: Camera,
        box: tuple[int, int, int, int],
        frequency: float,
        carries_data: bool,
    ) -> None: ...
    @property
    def first(self) -> tuple[Any, ...]: ...
    def find(self, frame: npt.NDArray[Any], places: Sequence[tuple[int, int]]) -> tuple[Any, ...] | None: ...

class PictureOverview:
    def __init__(self, frame: npt.NDArray[Any]) -> None: ...
    def has_changed(self, now: PictureOverview, lights: Sequence[tuple[int, int, int, int]]) -> bool: ...

def calibrate(
    columns: npt.NDArray[Any],
    frequency: float,
    bounds: tuple[float, float] | None,
    waveform: str,
    select_columns: bool,
) -> tuple[
    float,
    float,
    tuple[float, float, float, int, int, tuple[npt.NDArray[np.bool_], npt.NDArray[np.float64], bool]],
]: ...
def pick_colour(
    colours: list[npt.NDArray[Any]], camera: Camera, bounds: tuple[float, float] | None, waveform: str
) -> int: ...

class RowWeights:
    def __init__(self, weights: npt.ArrayLike, rows: int, row_group: int, limbs: int) -> None: ...

@overload
def project(columns: npt.NDArray[Any], weights: RowWeights) -> tuple[Any, Any, Any, Any]: ...
@overload
def project(
    columns: npt.NDArray[Any], weights: npt.ArrayLike, row_group: int, limbs: int
) -> tuple[Any, Any, Any, Any]: ...
def read_bytes(array: npt.NDArray[np.uint8], threads: int = 1) -> int: ...
def force_simd_target(name: str) -> None: ...
def encode_line_code(bits: npt.NDArray[np.uint8], line_code: str | Sequence[str]) -> npt.NDArray[np.uint8]: ...
def decode_line_code(
    llr: npt.NDArray[np.float64], line_code: str | Sequence[str]
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.uint8]]: ...
def transmit(
    payload: npt.NDArray[np.uint8], line_code: str | Sequence[str], block_bytes: int, preamble: str, number: int
) -> tuple[npt.NDArray[np.uint8], tuple[int, int, int, int]]: ...
def longest_payload(line_code: str | Sequence[str], block_bytes: int, preamble: str) -> int: ...

class PacketAssembler:
    def __init__(self, line_code: str | Sequence[str], block_bytes: int, preamble: str) -> None: ...
    def push(self, first: int, llr: npt.NDArray[np.float64], scatter: float) -> tuple[Any, ...]: ...
    def lose_clock(self) -> None: ...

class Receiver:
    def __init__(
        self,
        *,
        camera: Camera,
        data: bool,
        gain: bool,
        chip_rate: float | None,
        line_code: str | Sequence[str],
        block_bytes: int,
        preamble: str,
        search_passes: float | None,
        frequency: float | None,
        waveform: str,
        duty: float,
        background: float,
        sense_frequency: float | None,
        whole_picture: bool,
        regions: Sequence[tuple[int, int, int, int]],
        max_sources: int,
    ) -> None: ...
    def push(
        self,
        colours: Sequence[npt.NDArray[Any]],
        number: int | None,
        time: float | None,
        exposure: float | None,
        gain: float | None,
    ) -> list[tuple[Any, ...]]: ...

class ScenePart:
    def __init__(
        self,
        *,
        rows: int,
        columns: int,
        top: int,
        left: int,
        height: int,
        width: int,
        phases: int,
        gain: float,
        gains: npt.NDArray[np.float32] | None,
        phase: npt.NDArray[np.uint16] | None,
        spans: npt.NDArray[np.uint32] | None,
    ) -> None: ...

def render_parts(
    parts: Sequence[ScenePart],
    tables: Sequence[npt.NDArray[np.float32]],
    level: float,
    image: npt.NDArray[np.float32] | None,
    white: float,
    threads: int,
    out: npt.NDArray[Any],
) -> None: ...

class CleaningVerdict:
    @property
    def light_left(self) -> float: ...
    @property
    def texture_change(self) -> float: ...
    @property
    def slow_bands(self) -> float: ...

class ModelledLight:
    @property
    def light(self) -> npt.NDArray[np.float64]: ...
    @property
    def full(self) -> float: ...
    @property
    def model(self) -> str: ...
    @property
    def frequency(self) -> float: ...

class StoredScene:
    @property
    def toe(self) -> float: ...
    @property
    def white(self) -> float: ...
    @property
    def by_table(self) -> bool: ...
    def restored(
        self,
        frame: int,
        colour: int,
        share: npt.NDArray[np.float64],
        block_rows: int,
        block_columns: int,
        rows: npt.NDArray[np.float64],
        level: float,
        max_gain: float,
    ) -> tuple[npt.NDArray[Any], npt.NDArray[np.uint8], npt.NDArray[np.float32]]: ...

class SceneLight:
    @property
    def lights(self) -> list[list[ModelledLight]]: ...
    @property
    def verdicts(self) -> list[CleaningVerdict]: ...
    @property
    def unchanged(self) -> str: ...
    def level(self, frame: int, colour: int, full: bool) -> float: ...

def find_scene_light(
    colours: Sequence[npt.NDArray[Any]],
    camera: Camera,
    model: str,
    noise: float | None,
    toe: float | None,
    given: npt.NDArray[np.float64] | None,
    full: float,
) -> tuple[StoredScene, SceneLight, list[tuple[npt.NDArray[np.float64], int, int]]]: ...

class StreamCleaner:
    def __init__(self, camera: Camera, model: str, noise: float | None, toe: float | None) -> None: ...
    def push(
        self, colours: Sequence[npt.NDArray[Any]], time: float | None
    ) -> tuple[StoredScene, SceneLight, list[tuple[npt.NDArray[np.float64], int, int]]]: ...
    def again(
        self, colours: Sequence[npt.NDArray[Any]], ago: int
    ) -> tuple[StoredScene, SceneLight, list[tuple[npt.NDArray[np.float64], int, int]]]: ...
    def forget(self) -> None: ...

def lifted_light(stored: npt.NDArray[np.float64], toe: float, white: float) -> npt.NDArray[np.float64]: ...
def fsk_demodulate(
    camera: Camera, tones: Sequence[float], signal: npt.NDArray[np.float64], amplitude: float | None
) -> tuple[Any, ...]: ...
def fsk_symbol_error_rate(tones: int, snr: float) -> float: ...

class FskReceiver:
    def __init__(self, camera: Camera, tones: Sequence[float], block_bytes: int, preamble: str) -> None: ...
    def push(self, colours: Sequence[npt.NDArray[Any]], frame: int | None) -> tuple[Any, ...]: ...

def best_noisy_exposure(
    frequencies: npt.NDArray[np.float64],
    weights: npt.NDArray[np.float64],
    noise_exposure: float,
    low: float,
    high: float,
    step: float,
) -> tuple[float, float]: ...

class ExposureController:
    def __init__(
        self,
        shortest: float,
        longest: float,
        step: float,
        lowest_gain: float,
        highest_gain: float,
        comm_weight: float,
        sense_weight: float,
        hysteresis: float,
        level_floor: float,
        level_aim: float,
        level_ceiling: float,
        max_saturated: float,
        min_snr: float,
        noise_level: float,
    ) -> None: ...
    def update(
        self,
        tones: npt.NDArray[np.float64],
        exposure: float,
        gain: float,
        level: float,
        peak: float,
        saturated: float,
    ) -> tuple[float, float, float, float, float, float, float, float, float, int]: ...
    def reset(self) -> None: ...
