"""Links between vehicles against distance, ambient light, speed and number of lamps; figures that others published."""

from studies.distance.links import Link as Link, LinkResult as LinkResult, measure_link as measure_link
from studies.distance.published import (
    correlation_after_exposure as correlation_after_exposure,
    long_exposure_errors as long_exposure_errors,
    one_row_symbol_errors as one_row_symbol_errors,
    simultaneous_lights as simultaneous_lights,
)
from studies.distance.sweeps import SWEEPS as SWEEPS, Sweep as Sweep, draw as draw, measure as measure
