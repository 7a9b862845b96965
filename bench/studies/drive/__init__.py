"""The exposure controller in a closed loop: a simulated drive past a modulated light."""

from studies.drive.drawing import draw as draw
from studies.drive.simulation import (
    NOISE_LEVEL as NOISE_LEVEL,
    POLICIES as POLICIES,
    RANGE as RANGE,
    Drive as Drive,
    drive_past_light as drive_past_light,
)
