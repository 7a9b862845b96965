/* The plugin "ocisac" of GStreamer. */
#include <gst/gst.h>
#include <ocisac/ocisac.h>

#include "ocisacclean.h"
#include "ocisacrx.h"

#define PACKAGE "ocisac"

static gboolean plugin_init(GstPlugin* plugin) {
  static const gchar* tags[] = {NULL};
  gst_meta_register_custom(OCISAC_META, tags, NULL, NULL, NULL);
  return gst_element_register(plugin, "ocisacrx", GST_RANK_NONE, OCISAC_TYPE_RX) &&
         gst_element_register(plugin, "ocisacclean", GST_RANK_NONE, OCISAC_TYPE_CLEAN);
}

GST_PLUGIN_DEFINE(GST_VERSION_MAJOR, GST_VERSION_MINOR, ocisac, "Optical camera receiver, and removal of bands",
                  plugin_init, OCISAC_VERSION, "MIT/X11", "ocisac_fast", "Unknown package origin")
