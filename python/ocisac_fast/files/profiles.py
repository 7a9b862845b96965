"""Range and tone curve that a picture or video file states.

PNG states the curve in its cICP (and the range), sRGB or gAMA chunk, JPEG and TIFF in EXIF's ColorSpace, all in an ICC
profile, a video in its transfer characteristics. Without a statement JPEG and WebP are sRGB, and a video of a lossy
codec has the curve of BT.709, since cameras write them so; other files are linear, as sensor values are: a wrong curve
biases every gain.
"""

from __future__ import annotations

import dataclasses
import struct
from typing import TYPE_CHECKING, Any

from ocisac_fast.files.recording import LightResponse

if TYPE_CHECKING:
    from PIL.Image import Image

_CICP = "PNG cICP chunk"
_EXIF_IFD, _EXIF_COLOR_SPACE, _EXIF_SRGB = 0x8769, 0xA001, 1

_SRGB = LightResponse("srgb")
# Transfer characteristics of ITU-T H.273. The camera curve of BT.709, BT.601 and BT.2020 is a power of 0.45 after a
# linear segment. Its inverse is approximated by a power of 1.95 (error below 0.013 of full light).
_BT709 = LightResponse("gamma", 1.95)
_TRANSFERS = {
    1: _BT709,
    4: LightResponse("gamma", 2.2),
    5: LightResponse("gamma", 2.8),
    6: _BT709,
    8: LightResponse("linear"),
    13: _SRGB,
    14: _BT709,
    15: _BT709,
    16: LightResponse("pq"),
    18: LightResponse("hlg"),
}
_LOSSY = 2  # FFmpeg's AV_CODEC_PROP_LOSSY


def response_of_picture(image: Image, chunks: bytes, bits: int, kind: str) -> LightResponse:
    """Tone curve and levels that an opened picture states, else those of its kind.

    Args:
        image: the picture.
        chunks: of a PNG file.
        bits, kind: of its samples; ``"u"``, ``"i"`` or ``"f"``.
    """
    _, _, cicp = chunks.partition(b"\0\0\0\4cICP")
    curve = _curve_of_picture(image, cicp)
    stated = curve.stated_by
    if cicp[3:4] == b"\0":  # limited range
        unit = 2.0 ** (bits - 8)
        return dataclasses.replace(curve, dark_level=16 * unit, white_level=235 * unit, stated_by=stated or _CICP)
    if image.format != "TIFF" or kind == "f" or (bits, kind) == (8, "u"):
        return curve
    stated += (", " if stated else "") + "TIFF BitsPerSample"
    return dataclasses.replace(curve, white_level=2.0 ** (bits - (kind == "i")) - 1, stated_by=stated)


def _curve_of_picture(image: Image, cicp: bytes) -> LightResponse:
    if cicp and cicp[1] in _TRANSFERS:  # which goes before all other statements
        return dataclasses.replace(_TRANSFERS[cicp[1]], stated_by=_CICP)
    profile = image.info.get("icc_profile")
    if profile:
        response = _response_of_icc(profile)
        if response is not None:
            return response
    if "srgb" in image.info:
        return LightResponse("srgb", stated_by="PNG sRGB chunk")
    if image.info.get("gamma"):
        return _power(1.0 / float(image.info["gamma"]), "PNG gAMA chunk")
    if image.getexif().get_ifd(_EXIF_IFD).get(_EXIF_COLOR_SPACE) == _EXIF_SRGB:
        return LightResponse("srgb", stated_by="EXIF ColorSpace")
    return LightResponse("srgb" if image.format in ("JPEG", "MPO", "WEBP") else "linear", assumed_for=str(image.format))


def _power(gamma: float, stated_by: str) -> LightResponse:
    if abs(gamma - 1.0) < 0.005:
        return LightResponse("linear", stated_by=stated_by)
    return LightResponse("gamma", gamma, stated_by=stated_by)


def _response_of_icc(profile: bytes) -> LightResponse | None:
    """The curve of an ICC profile if it is linear, a power or sRGB; None if it is another or unreadable."""
    try:
        (count,) = struct.unpack_from(">I", profile, 128)
        tags = {}
        for k in range(min(count, 100)):
            name, offset, size = struct.unpack_from(">4sII", profile, 132 + 12 * k)
            tags[name] = profile[offset : offset + size]
        text = tags.get(b"desc", b"")
        if b"sRGB" in text or "sRGB".encode("utf-16-be") in text:
            return LightResponse("srgb", stated_by="ICC profile")
        curve = tags.get(b"gTRC", tags.get(b"kTRC", b""))
        if curve[:4] == b"curv":
            (points,) = struct.unpack_from(">I", curve, 8)
            if points <= 1:
                return _power(struct.unpack_from(">H", curve, 12)[0] / 256 if points else 1.0, "ICC profile")
        if curve[:4] == b"para" and struct.unpack_from(">H", curve, 8)[0] == 0:
            return _power(struct.unpack_from(">i", curve, 12)[0] / 65536, "ICC profile")
    except struct.error:
        pass
    return None


def response_of_video(context: Any, dark: float, white: float | None, stated_range: str = "") -> LightResponse:
    """The curve that a video's stream states, else that of its codec, between these levels."""
    curve, assumed_for = _TRANSFERS.get(transfer_of(context)), ""
    details = [stated_range] if stated_range else []
    if curve is not None:
        details.append("transfer characteristics")
    elif context.name == "mjpeg":
        curve, assumed_for = _SRGB, "JPEG"
    else:
        curve = _BT709 if int(context.codec.properties) & _LOSSY else LightResponse()
        assumed_for = context.name
    return LightResponse(curve.tone_curve, curve.gamma, dark, white, ", ".join(details), assumed_for)


def transfer_stating(response: LightResponse) -> int:
    """The transfer characteristics of values with this response; 2, unspecified, where no number states its curve.

    A PNG file that states none is sRGB, as ``clean`` takes it.
    """
    curve = _SRGB if response.assumed_for == "PNG" else response
    power = curve.gamma if curve.tone_curve == "gamma" else None
    found = (n for n, of in _TRANSFERS.items() if of.tone_curve == curve.tone_curve and power in (None, of.gamma))
    return next(found, 2)


def transfer_of(context: Any) -> int:
    """The transfer characteristics of a video stream (ITU-T H.273); 2 if unspecified."""
    value = getattr(context, "color_trc", None)
    return 2 if value is None else int(value)
