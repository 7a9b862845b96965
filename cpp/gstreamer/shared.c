#include "shared.h"

#include <math.h>
#include <ocisac/ocisac.h>

const GParamFlags ocisac_property_flags =
    G_PARAM_READWRITE | G_PARAM_CONSTRUCT | G_PARAM_STATIC_STRINGS | GST_PARAM_MUTABLE_READY;

OcisacCamera ocisac_completed_camera(const OcisacCamera* given, const GstVideoInfo* info) {
  OcisacCamera camera = *given;
  const gboolean limited = GST_VIDEO_INFO_IS_YUV(info) && info->colorimetry.range != GST_VIDEO_COLOR_RANGE_0_255;
  if (camera.dark_level < 0) camera.dark_level = limited ? 16 : 0;
  if (camera.white_level < 0) camera.white_level = limited ? 235 : 0;
  if (camera.frame_rate == 0) camera.frame_rate = (double)GST_VIDEO_INFO_FPS_N(info) / GST_VIDEO_INFO_FPS_D(info);
  return camera;
}

void ocisac_install(GObjectClass* class, gsize field, GParamSpec* spec) {
  g_object_class_install_property(class, (guint)field, spec);
}

void ocisac_install_number(GObjectClass* class, gsize field, const gchar* name, const gchar* text, gdouble least,
                           gdouble most, gdouble otherwise) {
  ocisac_install(class, field, g_param_spec_double(name, NULL, text, least, most, otherwise, ocisac_property_flags));
}

void ocisac_install_choice(GObjectClass* class, gsize field, const gchar* name, const gchar* text, const gchar* type,
                           const GEnumValue* values, gint otherwise) {
  GType known = g_type_from_name(type);
  if (known == 0) known = g_enum_register_static(type, values);
  ocisac_install(class, field, g_param_spec_enum(name, NULL, text, known, otherwise, ocisac_property_flags));
}

void ocisac_install_switch(GObjectClass* class, gsize field, const gchar* name, const gchar* text, gboolean otherwise) {
  ocisac_install(class, field, g_param_spec_boolean(name, NULL, text, otherwise, ocisac_property_flags));
}

void ocisac_install_camera(GObjectClass* class, gsize field) {
  static const GEnumValue curves[] = {{OCISAC_LINEAR, "Values in proportion to light", "linear"},
                                      {OCISAC_SRGB, "sRGB", "srgb"},
                                      {OCISAC_GAMMA, "Power of the property gamma", "gamma"},
                                      {0, NULL, NULL}};
  static const GEnumValue axes[] = {{OCISAC_DOWN, "Rows are exposed downwards", "y"},
                                    {OCISAC_UP, "Upwards", "-y"},
                                    {OCISAC_RIGHT, "To the right", "x"},
                                    {OCISAC_LEFT, "To the left", "-x"},
                                    {0, NULL, NULL}};
#define FIELD(name) (field + G_STRUCT_OFFSET(OcisacCamera, name))
  ocisac_install_number(class, FIELD(row_time), "row-time", "Time from one row to the next, s; must be set", 0, 1, 0);
  ocisac_install_number(class, FIELD(frame_rate), "frame-rate", "Frame rate, Hz; 0: by the caps", 0, G_MAXDOUBLE, 0);
  ocisac_install_number(class, FIELD(gamma), "gamma", "Exponent of tone-curve=gamma", 1e-3, 1e3, 2.2);
  ocisac_install_number(class, FIELD(dark_level), "dark-level", "Stored value of no light; -1: by the caps' range", -1,
                        65535, -1);
  ocisac_install_number(class, FIELD(white_level), "white-level", "Stored value of full light; -1: by the caps' range",
                        -1, 65535, -1);
  ocisac_install_choice(class, FIELD(tone_curve), "tone-curve", "Tone curve", "OcisacToneCurve", curves, OCISAC_LINEAR);
  ocisac_install_choice(class, FIELD(scan_axis), "scan-axis", "Direction in which rows are read out", "OcisacScanAxis",
                        axes, OCISAC_DOWN);
#undef FIELD
}

static gpointer field_of(GObject* object, guint property) { return (guint8*)object + property; }

void ocisac_set_property(GObject* object, guint property, const GValue* value, GParamSpec* spec) {
  const gpointer field = field_of(object, property);
  GST_OBJECT_LOCK(object);
  switch (G_TYPE_FUNDAMENTAL(spec->value_type)) {
    case G_TYPE_DOUBLE: *(gdouble*)field = g_value_get_double(value); break;
    case G_TYPE_ENUM: *(gint*)field = g_value_get_enum(value); break;
    case G_TYPE_UINT: *(guint*)field = g_value_get_uint(value); break;
    case G_TYPE_BOOLEAN: *(gboolean*)field = g_value_get_boolean(value); break;
    default: G_OBJECT_WARN_INVALID_PROPERTY_ID(object, property, spec);
  }
  GST_OBJECT_UNLOCK(object);
}

void ocisac_get_property(GObject* object, guint property, GValue* value, GParamSpec* spec) {
  const gpointer field = field_of(object, property);
  GST_OBJECT_LOCK(object);
  switch (G_TYPE_FUNDAMENTAL(spec->value_type)) {
    case G_TYPE_DOUBLE: g_value_set_double(value, *(const gdouble*)field); break;
    case G_TYPE_ENUM: g_value_set_enum(value, *(const gint*)field); break;
    case G_TYPE_UINT: g_value_set_uint(value, *(const guint*)field); break;
    case G_TYPE_BOOLEAN: g_value_set_boolean(value, *(const gboolean*)field); break;
    default: G_OBJECT_WARN_INVALID_PROPERTY_ID(object, property, spec);
  }
  GST_OBJECT_UNLOCK(object);
}

void ocisac_add_pads(GstElementClass* class, const gchar* text) {
  GstCaps* caps = gst_caps_from_string(text);
  gst_element_class_add_pad_template(class, gst_pad_template_new("sink", GST_PAD_SINK, GST_PAD_ALWAYS, caps));
  gst_element_class_add_pad_template(class, gst_pad_template_new("src", GST_PAD_SRC, GST_PAD_ALWAYS, caps));
  gst_caps_unref(caps);
}

gboolean ocisac_is_progressive(GstElement* element, const GstVideoInfo* info) {
  if (!GST_VIDEO_INFO_IS_INTERLACED(info)) return TRUE;
  GST_ELEMENT_ERROR(element, STREAM, FORMAT, ("interlaced video: fields are read out one after the other"),
                    ("deinterlace by separating the fields"));
  return FALSE;
}

double ocisac_time_of(const GstBuffer* buffer) {
  return GST_BUFFER_PTS_IS_VALID(buffer) ? (double)GST_BUFFER_PTS(buffer) / GST_SECOND : NAN;
}

gboolean ocisac_goes_on(double time, double last) { return time > last || (isnan(time) && isnan(last)); }

GstFlowReturn ocisac_fail(GstElement* element) {
  GST_ELEMENT_ERROR(element, STREAM, FAILED, ("%s", ocisac_last_error()), (NULL));
  return GST_FLOW_ERROR;
}

void ocisac_post(GstElement* element, GstStructure* structure) {
  gst_element_post_message(element, gst_message_new_element(GST_OBJECT(element), structure));
}
