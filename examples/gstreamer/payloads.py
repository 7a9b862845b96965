#!/usr/bin/python3
"""Prints the payloads of lamps, from a video file or a camera, by the element ocisacrx.

usage: payloads.py FILE|/dev/videoN PROPERTY=VALUE...    for example: payloads.py lamp.mkv row-time=22.2e-6 chip-rate=15000

Needs PyGObject and the plugin: apt-get install python3-gi gir1.2-gstreamer-1.0; GST_PLUGIN_PATH names the plugin's folder.
"""

import sys

import gi

gi.require_version("Gst", "1.0")
from gi.repository import GLib, Gst  # noqa: E402


def main() -> int:
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    Gst.init(None)
    camera = sys.argv[1].startswith("/dev/")
    source = "v4l2src ! videoconvert" if camera else "filesrc ! decodebin"
    try:
        pipeline = Gst.parse_launch(f"{source} ! ocisacrx no-gain=true {' '.join(sys.argv[2:])} ! fakesink sync=false")
    except GLib.Error as problem:
        sys.exit(f"payloads.py: {problem.message}")
    reader = pipeline.get_by_name("v4l2src0" if camera else "filesrc0")
    reader.set_property("device" if camera else "location", sys.argv[1])
    try:
        return print_payloads(pipeline)
    except (KeyboardInterrupt, BrokenPipeError):
        return 0
    finally:
        pipeline.set_state(Gst.State.NULL)


def print_payloads(pipeline: Gst.Pipeline) -> int:
    """Until the stream ends; exit status 3 without a payload."""
    pipeline.set_state(Gst.State.PLAYING)
    wanted = Gst.MessageType.EOS | Gst.MessageType.ERROR | Gst.MessageType.ELEMENT
    found = False
    while True:
        message = pipeline.get_bus().timed_pop_filtered(Gst.CLOCK_TIME_NONE, wanted)
        if message.type == Gst.MessageType.EOS:
            return 0 if found else 3
        if message.type == Gst.MessageType.ERROR:
            print(f"payloads.py: {message.parse_error()[0].message}", file=sys.stderr)
            return 1
        light = message.get_structure()
        if light.get_name() == "ocisac" and light.has_field("payload"):
            print(light.get_value("payload").get_data().decode(errors="replace"), flush=True)
            found = True


if __name__ == "__main__":
    sys.exit(main())
