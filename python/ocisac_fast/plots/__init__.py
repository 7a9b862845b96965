"""Plots of results (matplotlib)."""

from ocisac_fast.plots.exposure import (
    plot_exposure as plot_exposure,
    plot_front as plot_front,
    plot_pulses as plot_pulses,
)
from ocisac_fast.plots.flicker import (
    plot_flicker_front as plot_flicker_front,
    plot_flicker_indices as plot_flicker_indices,
    plot_lamp as plot_lamp,
    plot_modulation as plot_modulation,
)
from ocisac_fast.plots.picture import (
    BLACK as BLACK,
    BLUE as BLUE,
    GREEN as GREEN,
    ORANGE as ORANGE,
    PURPLE as PURPLE,
    RED as RED,
    SKY as SKY,
    picture as picture,
    series as series,
)
from ocisac_fast.plots.receiver import draw_chips as draw_chips, plot_received as plot_received
from ocisac_fast.plots.regions import plot_regions as plot_regions, plot_sources as plot_sources
from ocisac_fast.plots.tones import plot_gain as plot_gain, plot_recordings as plot_recordings
