"""Drawing of the closed loop."""

from __future__ import annotations

import os

from ocisac_fast.plots import BLACK, BLUE, GREEN, ORANGE, RED, SKY, picture
from studies.drive.simulation import LIGHT_FREQUENCY, Drive

_COLOURS = (RED, ORANGE, SKY)


def draw(path: str | os.PathLike[str], drive: Drive) -> None:
    """Draw the closed loop over time: the scene, exposures, both gains, and the share of the objective of each policy.

    Args:
        path: ``.png``, ``.pdf`` or ``.svg``.
        drive: from ``drive_past_light``.
    """
    labels = ("controller", "closed form (paper)", "best fixed exposure")
    with picture(path, 10.0, 11.0) as figure:
        scene, exposure, comm, sense, objective = figure.subplots(5, sharex=True)
        scene.plot(drive.time, drive.sense_frequency, color=BLACK, lw=1.0, label="texture times speed")
        scene.plot(drive.time, drive.seen[1], ".", color=GREEN, ms=3, label="as measured")
        scene.axhline(LIGHT_FREQUENCY, color=BLUE, lw=1.0, ls="--", label="traffic light")
        scene.set(ylabel="frequency / Hz", title="A car brakes for a modulated traffic light and drives on")
        for k in (2, 1, 0):
            look = {"color": _COLOURS[k], "lw": 1.6 if k == 0 else 1.1, "label": labels[k]}
            exposure.plot(drive.time, drive.exposure[k] * 1e3, **look)
            comm.plot(drive.time, drive.gains[k, 0], **look)
            sense.plot(drive.time, drive.gains[k, 1], **look)
            objective.plot(drive.time, drive.true[k], **look)
        exposure.set(ylabel="exposure / ms", yscale="log")
        low, high = exposure.get_ylim()
        ticks = [tick for tick in (0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0) if low <= tick <= high]
        exposure.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
        comm.set(ylabel="gain of the light", ylim=(0, 1.02))
        sense.set(ylabel="gain of the texture", ylim=(0, 1.02))
        objective.set(ylabel="objective / largest", xlabel="time / s", ylim=(None, 1.02))
        for axes in (scene, exposure):
            axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
