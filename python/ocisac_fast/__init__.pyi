# Public names at the top level, each once; `__init__.py` reads this file.
from ocisac_fast.camera import Camera as Camera
from ocisac_fast.chips import detect_chips as detect_chips
from ocisac_fast.cleaning import remove_bands as remove_bands, subtract_still as subtract_still
from ocisac_fast.core import Flag as Flag
from ocisac_fast.exposure import (
    ExposureController as ExposureController,
    best_exposure as best_exposure,
    exposure_front as exposure_front,
    exposure_objective as exposure_objective,
)
from ocisac_fast.light import (
    Chips as Chips,
    Constant as Constant,
    Product as Product,
    Samples as Samples,
    SquareWave as SquareWave,
    Sum as Sum,
    Tone as Tone,
    TriangleWave as TriangleWave,
    Waveform as Waveform,
    exposure_response as exposure_response,
    integrate_exposure as integrate_exposure,
    sample_waveform as sample_waveform,
)
from ocisac_fast.lights import (
    SourceTracker as SourceTracker,
    calibrate as calibrate,
    detect_sources as detect_sources,
    locate_camera as locate_camera,
    pick_colour as pick_colour,
)
from ocisac_fast.packets import (
    longest_payload as longest_payload,
    merge_receptions as merge_receptions,
    transmit as transmit,
)
from ocisac_fast.receiver import (
    MultiReceiver as MultiReceiver,
    Receiver as Receiver,
    compare_bits as compare_bits,
    receive as receive,
)
from ocisac_fast.scene import Scene as Scene
from ocisac_fast.sensing import (
    background_light as background_light,
    restore_contrast as restore_contrast,
    sense as sense,
    sense_region as sense_region,
)
from ocisac_fast.tones import (
    equalize as equalize,
    find_frequency as find_frequency,
    tone_columns as tone_columns,
    tone_gain as tone_gain,
    varying_tone_gain as varying_tone_gain,
)

__version__: str
__all__: list[str]
