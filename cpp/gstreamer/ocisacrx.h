/* Element ocisacrx. */
#ifndef OCISAC_GSTREAMER_OCISACRX_H
#define OCISAC_GSTREAMER_OCISACRX_H

#include <gst/base/gstbasetransform.h>

G_BEGIN_DECLS

/* Custom metadata of a frame: the field "lights", a list with a structure for each light. */
#define OCISAC_META "GstOcisacMeta"

#define OCISAC_TYPE_RX (ocisac_rx_get_type())
G_DECLARE_FINAL_TYPE(OcisacRx, ocisac_rx, OCISAC, RX, GstBaseTransform)

G_END_DECLS

#endif
