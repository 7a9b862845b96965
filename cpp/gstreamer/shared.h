/* What the elements share: properties, what the caps state, the course of time, errors. */
#ifndef OCISAC_GSTREAMER_SHARED_H
#define OCISAC_GSTREAMER_SHARED_H

#include <gst/gst.h>
#include <gst/video/video.h>

G_BEGIN_DECLS

/* With luma of 8 bits, or of 16 in the machine's own byte order. */
#define OCISAC_LUMA_FORMATS "GRAY8, " GST_VIDEO_NE(GRAY16) ", I420, YV12, NV12, NV21, Y42B, Y444, YUY2, YVYU, UYVY"

/* The camera, as its properties are set; of what is unset, the caps tell. */
typedef struct OcisacCamera {
  double row_time;                /* s */
  double frame_rate;              /* Hz; 0: by the caps */
  double gamma;                   /* exponent of the tone curve gamma */
  double dark_level, white_level; /* DN; -1: by the range of the caps */
  gint tone_curve, scan_axis;
} OcisacCamera;

/* Writes the camera, completed by the caps, to ocisac_options or ocisac_cleaner_options: a macro since C has no
 * templates. */
#define OCISAC_SET_CAMERA(options, given, info)                                      \
  do {                                                                               \
    const OcisacCamera completed_ = ocisac_completed_camera(&(given), info);         \
    (options).row_time = completed_.row_time;                                        \
    (options).gamma = completed_.gamma;                                              \
    (options).dark_level = completed_.dark_level;                                    \
    (options).white_level = completed_.white_level;                                  \
    (options).tone_curve = completed_.tone_curve;                                    \
    (options).scan_axis = completed_.scan_axis;                                      \
    if (completed_.frame_rate > 0) (options).frame_time = 1 / completed_.frame_rate; \
  } while (0)

/* With the levels of the caps' range (white 0: the maximum of the pixels) and their frame rate (0: not stated). */
OcisacCamera ocisac_completed_camera(const OcisacCamera* given, const GstVideoInfo* info);

/* Installs a property that is a field of the element, and gets its default at construction. The property's identifier
 * is the field's offset in the element. Types: double, enum, uint, boolean; other types need functions of their own. */
void ocisac_install(GObjectClass* class, gsize field, GParamSpec* spec);
void ocisac_install_number(GObjectClass* class, gsize field, const gchar* name, const gchar* text, gdouble least,
                           gdouble most, gdouble otherwise);
/* `values`: static, ended by one without a name. `type`: the choice's name among GLib's types. */
void ocisac_install_choice(GObjectClass* class, gsize field, const gchar* name, const gchar* text, const gchar* type,
                           const GEnumValue* values, gint otherwise);
void ocisac_install_switch(GObjectClass* class, gsize field, const gchar* name, const gchar* text, gboolean otherwise);
void ocisac_install_camera(GObjectClass* class, gsize field);

extern const GParamFlags ocisac_property_flags;

/* Of GObjectClass, for such properties. */
void ocisac_set_property(GObject* object, guint property, const GValue* value, GParamSpec* spec);
void ocisac_get_property(GObject* object, guint property, GValue* value, GParamSpec* spec);

/* Both pads have these caps. */
void ocisac_add_pads(GstElementClass* class, const gchar* caps);

/* False for interlaced video, after an error message. */
gboolean ocisac_is_progressive(GstElement* element, const GstVideoInfo* info);

/* s; NaN without a time stamp. */
double ocisac_time_of(const GstBuffer* buffer);

/* False where time stands still, goes back, begins or ends: another stream. `last`: of the frame before. */
gboolean ocisac_goes_on(double time, double last);

/* Posts the message of the last failed call of ocisac.h on this thread; the stream ends. */
GstFlowReturn ocisac_fail(GstElement* element);

/* A message with this structure, which it takes. */
void ocisac_post(GstElement* element, GstStructure* structure);

G_END_DECLS

#endif
