"""``ocisac locate``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import click

from ocisac_fast.cli.command import command
from ocisac_fast.cli.output import emit
from ocisac_fast.cli.outputs import InputFile, read_input
from ocisac_fast.cli.units import Parsed
from ocisac_fast.core.checks import parsed_json
from ocisac_fast.lights import locate_camera

_File = InputFile(exists=True, dir_okay=False, path_type=Path)


_NUMBERS = Parsed("TEXT", lambda text: tuple(float(part) for part in text.split(",")), "numbers with commas between")


@command
def locate(
    lights: Annotated[Path, _File],
    seen: Annotated[Path, _File],
    *,
    focal: Annotated[tuple[float, ...], _NUMBERS, "Focal length in pixels; one number or X,Y."],
    centre: Annotated[tuple[float, float], _NUMBERS, "Principal point X,Y in pixels."],
    distortion: Annotated[tuple[float, ...] | None, _NUMBERS, "OpenCV's coefficients k1,k2,p1,p2[,k3]."] = None,
    noise: Annotated[float, "Standard error of a light's position, pixels."] = 1.0,
    inside: Annotated[
        tuple[float, ...] | None, _NUMBERS, "Bounds XMIN,YMIN,ZMIN,XMAX,YMAX,ZMAX of the position, metres."
    ] = None,
    as_json: bool,
) -> None:
    """Locate the camera from three or more LIGHTS at known places and their positions in the picture, SEEN.

    Both files are JSON lines. LIGHTS: light (its ID), x_m, y_m, z_m. SEEN: light, x, y in pixels; with width and height
    (output of detect) x, y are the top left corner of a box. IDs that are in only one file are ignored.
    """
    if len(focal) not in (1, 2):
        raise click.UsageError(f"--focal: got {len(focal)} numbers, allowed: one or X,Y")
    if inside is not None and len(inside) != 6:
        raise click.UsageError(f"--inside: got {len(inside)} numbers, allowed: six")
    places = _read(lights, ("x_m", "y_m", "z_m"))
    pixels = _read(seen, ("x", "y"))
    both = [light for light in places if light in pixels]
    if len(both) < 3:
        raise ValueError(f"{seen}: got {len(both)} of the lights of {lights}, allowed: three or more")
    found = locate_camera(
        [places[light] for light in both],
        [pixels[light] for light in both],
        focal=focal[0] if len(focal) == 1 else (focal[0], focal[1]),
        centre=centre,
        distortion=distortion or (),
        noise=noise,
        inside=None if inside is None else (inside[:3], inside[3:]),
    )
    facts = {
        **dict(zip(("x_m", "y_m", "z_m"), found.position, strict=True)),
        **dict(zip(("x_std_m", "y_std_m", "z_std_m"), found.position_std, strict=True)),
        "rotation": found.rotation,
        "residual_pixels": found.residual,
        "lights": len(both),
        "status": found.status,
        "reason": found.reason,
        "alternatives_m": found.alternatives,
    }
    coordinates = zip("xyz", found.position, found.position_std, strict=True)
    table = {name: f"{value:.4f} m ± {std:.4f} m" for name, value, std in coordinates}
    table |= {"lights": str(len(both)), "residual": f"{found.residual:.2f} pixels", "status": found.status}
    table |= {"reason": found.reason} if found.reason else {}
    also = [", ".join(f"{value:.4f}" for value in place) + " m" for place in found.alternatives]
    table |= {f"or at ({k})": place for k, place in enumerate(also, 1)}
    emit(as_json, facts, table)


def _read(path: Path, names: tuple[str, ...]) -> dict[Any, tuple[float, ...]]:
    """Coordinates by light; the middle of a box if width and height are given."""
    result: dict[Any, tuple[float, ...]] = {}
    for number, line in enumerate(read_input(path).splitlines(), 1):
        if not line.strip():
            continue
        try:
            record = parsed_json(line.decode())
            light = record["light"]
            values = [float(record[name]) for name in names]
            if "width" in record and "height" in record and len(names) == 2:
                values = [values[0] + (float(record["width"]) - 1) / 2, values[1] + (float(record["height"]) - 1) / 2]
            if light in result:
                raise ValueError(f"light {light!r} twice")
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            wanted = ", ".join(("light", *names))
            raise ValueError(
                f"{path}: line {number}: {error}, allowed: an object of its own light with {wanted}"
            ) from error
        result[light] = tuple(values)
    return result
