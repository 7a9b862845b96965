"""Range and tone curve that a picture or video file states.

A file without a statement is treated as linear: raw sensor values are stored so, and a wrong curve would bias every
gain. PNG states the curve in its sRGB or gAMA chunk, JPEG and TIFF in EXIF's ColorSpace, all of them in an ICC profile,
a video in its transfer characteristics.
"""

from __future__ import annotations

import struct
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from ocisac_fast.files.recording import LightResponse

if TYPE_CHECKING:
    from PIL.Image import Image

_EXIF_IFD, _EXIF_COLOR_SPACE, _EXIF_SRGB = 0x8769, 0xA001, 1

# Transfer characteristics of ITU-T H.273. The camera curve of BT.709, BT.601 and BT.2020 is a power of 0.45 after a
# linear segment. Its inverse is approximated by a power of 1.95 (error below 0.013 of full light).
_BT709 = LightResponse("gamma", 1.95)
_TRANSFERS = {
    1: _BT709,
    4: LightResponse("gamma", 2.2),
    5: LightResponse("gamma", 2.8),
    6: _BT709,
    8: LightResponse("linear"),
    13: LightResponse("srgb"),
    14: _BT709,
    15: _BT709,
}


def response_of_picture(image: Image) -> LightResponse:
    """The tone curve that an opened picture states; linear where it states none."""
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
    return LightResponse()


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


def response_of_video(transfer: int, limited: bool, bits: int, shift: int, stated: bool = True) -> LightResponse:
    """Range and curve of luma of ``bits`` bits; ``shift`` above 0: stored in the upper bits of a word.

    Limited range has black at 16 and white at 235, times 2**(bits - 8) (ITU-R BT.709, BT.2100).
    """
    curve = _TRANSFERS.get(int(transfer), LightResponse())
    unit = 2.0 ** (bits - 8)
    dark, white = (16 * unit, 235 * unit) if limited else (0.0, 256 * unit - 1)
    details = [("limited" if limited else "full") + " range"] if stated else []
    if int(transfer) in _TRANSFERS:
        details.append("transfer characteristics")
    scale = 2.0**shift
    return LightResponse(curve.tone_curve, curve.gamma, dark * scale, white * scale, ", ".join(details))


def response_of_colours(transfer: int, limited: bool, bits: int) -> LightResponse:
    """The response of red, green and blue, of 16 bits if ``bits`` is above 8, of a video in a format of ``bits`` bits.

    The scaler's white of 16 bits is 255 * 256 from limited range, else the format's largest value times a power of 2.
    """
    if bits <= 8:
        return response_of_video(transfer, False, 8, 0)
    white = 255.0 * 256 if limited else 65536.0 - 2.0 ** (16 - bits)
    return replace(response_of_video(transfer, False, 16, 0), white_level=white)


def transfer_of(context: Any) -> int:
    """The transfer characteristics of a video stream (ITU-T H.273); 2 if unspecified."""
    value = getattr(context, "color_trc", None)
    return 2 if value is None else int(value)
