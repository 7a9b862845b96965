/* Element ocisacclean. */
#ifndef OCISAC_GSTREAMER_OCISACCLEAN_H
#define OCISAC_GSTREAMER_OCISACCLEAN_H

#include <gst/video/gstvideofilter.h>

G_BEGIN_DECLS

#define OCISAC_TYPE_CLEAN (ocisac_clean_get_type())
G_DECLARE_FINAL_TYPE(OcisacClean, ocisac_clean, OCISAC, CLEAN, GstVideoFilter)

G_END_DECLS

#endif
