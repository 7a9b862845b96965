from typing import Any

import numpy.typing as npt

def version() -> str: ...
def commit() -> str: ...
def compiler() -> str: ...
def opencv_version() -> str: ...

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
