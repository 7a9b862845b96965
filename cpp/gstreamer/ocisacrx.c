/* ocisacrx: passes video through; what the receiver of ocisac/ocisac.h finds in a frame goes to the bus (one element
 * message a light, named "ocisac") and to the frame's GstOcisacMeta. Without logic of its own. */
#include "ocisacrx.h"

#include <gst/base/gstbasetransform.h>
#include <gst/video/video.h>
#include <math.h>
#include <ocisac/ocisac.h>

#define READ_FORMATS "{ GRAY8, GRAY16_LE, I420, YV12, NV12, NV21, Y42B, Y444, YUY2, YVYU }"

GST_DEBUG_CATEGORY_STATIC(ocisacrx_debug);
#define GST_CAT_DEFAULT ocisacrx_debug

/* Properties, named as the options of ocisac-rx. */
enum {
  PROP_ROW_TIME = 1,
  PROP_EXPOSURE,
  PROP_FRAME_RATE,
  PROP_TONE_CURVE,
  PROP_GAMMA,
  PROP_DARK_LEVEL,
  PROP_WHITE_LEVEL,
  PROP_SCAN_AXIS,
  PROP_REGION,
  PROP_SOURCES,
  PROP_FREQUENCY,
  PROP_WAVEFORM,
  PROP_DUTY,
  PROP_BACKGROUND,
  PROP_SENSE,
  PROP_CHIP_RATE,
  PROP_LINE_CODE,
  PROP_BLOCK_BYTES,
  PROP_LENGTHENED,
  PROP_NO_BITS,
  PROP_NO_GAIN,
  PROP_POST_MESSAGES
};

struct _OcisacRx {
  GstBaseTransform parent;
  ocisac_options options; /* the properties: unknown times and rates are 0, levels by the caps -1 */
  double frame_rate;      /* Hz; 0: by the caps */
  gboolean post_messages;
  GstVideoInfo info;         /* of the caps */
  ocisac_receiver* receiver; /* from the first frame after caps, seek or jump on */
  gint64 next;               /* number of the next frame */
  double last_time;          /* s, of the last frame; NaN: it had no stamp */
};

G_DEFINE_TYPE(OcisacRx, ocisac_rx, GST_TYPE_BASE_TRANSFORM)

static GType choice_type(const gchar* name, const GEnumValue* values) {
  const GType known = g_type_from_name(name);
  return known != 0 ? known : g_enum_register_static(name, values);
}

static GType tone_curve_type(void) {
  static const GEnumValue values[] = {{OCISAC_LINEAR, "Values in proportion to light", "linear"},
                                      {OCISAC_SRGB, "sRGB", "srgb"},
                                      {OCISAC_GAMMA, "Power of the property gamma", "gamma"},
                                      {0, NULL, NULL}};
  return choice_type("OcisacToneCurve", values);
}

static GType scan_axis_type(void) {
  static const GEnumValue values[] = {{OCISAC_DOWN, "Rows are exposed downwards", "y"},
                                      {OCISAC_UP, "Upwards", "-y"},
                                      {OCISAC_RIGHT, "To the right", "x"},
                                      {OCISAC_LEFT, "To the left", "-x"},
                                      {0, NULL, NULL}};
  return choice_type("OcisacScanAxis", values);
}

static GType waveform_type(void) {
  static const GEnumValue values[] = {
      {OCISAC_TONE, "Cosine", "tone"}, {OCISAC_SQUARE, "Square wave", "square"}, {0, NULL, NULL}};
  return choice_type("OcisacWaveform", values);
}

static GType line_code_type(void) {
  static const GEnumValue values[] = {{OCISAC_NONE, "None", "none"},
                                      {OCISAC_MANCHESTER, "Manchester", "manchester"},
                                      {OCISAC_4B6B, "4B6B", "4b6b"},
                                      {OCISAC_8B10B, "8B10B", "8b10b"},
                                      {0, NULL, NULL}};
  return choice_type("OcisacLineCode", values);
}

/* The next frame begins a new stream. */
static void forget(OcisacRx* self) {
  ocisac_destroy(self->receiver);
  self->receiver = NULL;
  self->last_time = NAN;
}

static gboolean parse_region(const gchar* text, ocisac_region* region) {
  guint32* const fields[] = {&region->x, &region->y, &region->width, &region->height};
  gchar** parts = g_strsplit(text, ",", -1);
  gboolean good = g_strv_length(parts) == G_N_ELEMENTS(fields);
  for (guint k = 0; good && k < G_N_ELEMENTS(fields); ++k) {
    guint64 value = 0;
    good = g_ascii_string_to_unsigned(g_strstrip(parts[k]), 10, k < 2 ? 0 : 1, G_MAXUINT32, &value, NULL);
    *fields[k] = (guint32)value;
  }
  g_strfreev(parts);
  return good;
}

static void set_region(OcisacRx* self, const gchar* text) {
  ocisac_region region = {0, 0, 0, 0};
  if (text != NULL && *text != '\0' && !parse_region(text, &region))
    g_warning("region: got %s, allowed: x,y,w,h in pixels, w and h above 0", text);
  else
    self->options.region = region;
}

/* The field of a number property; NULL for others. */
static double* number_of(OcisacRx* self, guint property) {
  switch (property) {
    case PROP_ROW_TIME: return &self->options.row_time;
    case PROP_EXPOSURE: return &self->options.exposure;
    case PROP_FRAME_RATE: return &self->frame_rate;
    case PROP_GAMMA: return &self->options.gamma;
    case PROP_DARK_LEVEL: return &self->options.dark_level;
    case PROP_WHITE_LEVEL: return &self->options.white_level;
    case PROP_FREQUENCY: return &self->options.frequency;
    case PROP_DUTY: return &self->options.duty;
    case PROP_BACKGROUND: return &self->options.background;
    case PROP_SENSE: return &self->options.sense_frequency;
    case PROP_CHIP_RATE: return &self->options.chip_rate;
    default: return NULL;
  }
}

/* The field of a choice; NULL for others. */
static gint32* choice_of(OcisacRx* self, guint property) {
  switch (property) {
    case PROP_TONE_CURVE: return &self->options.tone_curve;
    case PROP_SCAN_AXIS: return &self->options.scan_axis;
    case PROP_WAVEFORM: return &self->options.waveform;
    case PROP_LINE_CODE: return &self->options.line_code;
    default: return NULL;
  }
}

static void set_property(GObject* object, guint property, const GValue* value, GParamSpec* spec) {
  OcisacRx* self = OCISAC_RX(object);
  GST_OBJECT_LOCK(self);
  double* const number = number_of(self, property);
  gint32* const choice = choice_of(self, property);
  if (number != NULL) {
    *number = g_value_get_double(value);
  } else if (choice != NULL) {
    *choice = g_value_get_enum(value);
  } else {
    switch (property) {
      case PROP_REGION: set_region(self, g_value_get_string(value)); break;
      case PROP_SOURCES: self->options.max_lights = g_value_get_uint(value); break;
      case PROP_BLOCK_BYTES: self->options.block_bytes = g_value_get_uint(value); break;
      case PROP_LENGTHENED: self->options.lengthened = g_value_get_boolean(value); break;
      case PROP_NO_BITS: self->options.want_data = !g_value_get_boolean(value); break;
      case PROP_NO_GAIN: self->options.want_gain = !g_value_get_boolean(value); break;
      case PROP_POST_MESSAGES: self->post_messages = g_value_get_boolean(value); break;
      default: G_OBJECT_WARN_INVALID_PROPERTY_ID(object, property, spec);
    }
  }
  GST_OBJECT_UNLOCK(self);
}

static void get_property(GObject* object, guint property, GValue* value, GParamSpec* spec) {
  OcisacRx* self = OCISAC_RX(object);
  GST_OBJECT_LOCK(self);
  const double* const number = number_of(self, property);
  const gint32* const choice = choice_of(self, property);
  const ocisac_region* const region = &self->options.region;
  if (number != NULL) {
    g_value_set_double(value, *number);
  } else if (choice != NULL) {
    g_value_set_enum(value, *choice);
  } else {
    switch (property) {
      case PROP_REGION:
        g_value_take_string(value, region->width == 0 ? NULL
                                                      : g_strdup_printf("%u,%u,%u,%u", region->x, region->y,
                                                                        region->width, region->height));
        break;
      case PROP_SOURCES: g_value_set_uint(value, self->options.max_lights); break;
      case PROP_BLOCK_BYTES: g_value_set_uint(value, self->options.block_bytes); break;
      case PROP_LENGTHENED: g_value_set_boolean(value, self->options.lengthened); break;
      case PROP_NO_BITS: g_value_set_boolean(value, !self->options.want_data); break;
      case PROP_NO_GAIN: g_value_set_boolean(value, !self->options.want_gain); break;
      case PROP_POST_MESSAGES: g_value_set_boolean(value, self->post_messages); break;
      default: G_OBJECT_WARN_INVALID_PROPERTY_ID(object, property, spec);
    }
  }
  GST_OBJECT_UNLOCK(self);
}

/* The options, completed by the caps. */
static ocisac_options stream_options(OcisacRx* self) {
  GST_OBJECT_LOCK(self);
  ocisac_options options = self->options;
  const double frame_rate = self->frame_rate;
  GST_OBJECT_UNLOCK(self);
  const GstVideoInfo* info = &self->info;
  const gboolean limited = GST_VIDEO_INFO_IS_YUV(info) && info->colorimetry.range != GST_VIDEO_COLOR_RANGE_0_255;
  if (options.dark_level < 0) options.dark_level = limited ? 16 : 0;
  if (options.white_level < 0) options.white_level = limited ? 235 : 0;
  if (frame_rate > 0)
    options.frame_time = 1 / frame_rate;
  else if (GST_VIDEO_INFO_FPS_N(info) > 0)
    options.frame_time = (double)GST_VIDEO_INFO_FPS_D(info) / GST_VIDEO_INFO_FPS_N(info);
  double* const unknown[] = {&options.exposure, &options.frequency, &options.chip_rate, &options.sense_frequency};
  for (guint k = 0; k < G_N_ELEMENTS(unknown); ++k)
    if (*unknown[k] == 0) *unknown[k] = NAN;
  return options;
}

static gint32 pixels_of(const GstVideoInfo* info) {
  switch (GST_VIDEO_INFO_FORMAT(info)) {
    case GST_VIDEO_FORMAT_GRAY16_LE: return OCISAC_GRAY16;
    case GST_VIDEO_FORMAT_YUY2:
    case GST_VIDEO_FORMAT_YVYU: return OCISAC_YUYV;
    default: return OCISAC_GRAY8; /* the plane of luma */
  }
}

static gboolean set_caps(GstBaseTransform* transform, GstCaps* in, GstCaps* out) {
  OcisacRx* self = OCISAC_RX(transform);
  (void)out;
  if (!gst_video_info_from_caps(&self->info, in)) return FALSE;
  if (GST_VIDEO_INFO_IS_INTERLACED(&self->info)) {
    GST_ELEMENT_ERROR(self, STREAM, FORMAT, ("interlaced video: fields are read out one after the other"),
                      ("deinterlace by separating the fields"));
    return FALSE;
  }
  forget(self);
  return TRUE;
}

static void add_flags(GstStructure* structure, const gchar* field, guint32 flags) {
  GValue names = G_VALUE_INIT;
  gst_value_array_init(&names, 0);
  for (guint32 bit = 1; bit != 0; bit <<= 1) {
    const char* const known = flags & bit ? ocisac_flag_name(bit) : NULL;
    if (known == NULL) continue;
    GValue name = G_VALUE_INIT;
    g_value_init(&name, G_TYPE_STRING);
    g_value_set_string(&name, known);
    gst_value_array_append_and_take_value(&names, &name);
  }
  gst_structure_take_value(structure, field, &names);
}

static double decibels(double ratio) { return ratio > 0 ? 10 * log10(ratio) : NAN; }

/* One light of a frame, with the keys of ocisac-rx's lines. */
static GstStructure* structure_of(const ocisac_result* result, GstClockTime pts) {
  GstStructure* structure = gst_structure_new(
      "ocisac", "frame", G_TYPE_INT64, result->frame, "pts", GST_TYPE_CLOCK_TIME, pts, "source", G_TYPE_UINT,
      result->source, "x", G_TYPE_UINT, result->region.x, "y", G_TYPE_UINT, result->region.y, "width", G_TYPE_UINT,
      result->region.width, "height", G_TYPE_UINT, result->region.height, "bits", G_TYPE_STRING, result->bits,
      "rows_per_chip", G_TYPE_DOUBLE, result->rows_per_chip, "chip_rate_hz", G_TYPE_DOUBLE, result->chip_rate, "snr_db",
      G_TYPE_DOUBLE, decibels(result->data_snr), "exposure_s", G_TYPE_DOUBLE, result->exposure, "error_rate",
      G_TYPE_DOUBLE, result->error_rate, "packet_share", G_TYPE_DOUBLE, result->packet_share, "frequency_hz",
      G_TYPE_DOUBLE, result->frequency, "frequency_std_hz", G_TYPE_DOUBLE, result->frequency_std, "gain", G_TYPE_DOUBLE,
      result->gain, "gain_std", G_TYPE_DOUBLE, result->gain_std, "gain_snr_db", G_TYPE_DOUBLE,
      decibels(result->gain_snr), "suggested_exposure_s", G_TYPE_DOUBLE, result->suggested_exposure, NULL);
  add_flags(structure, "flags", result->data_flags);
  add_flags(structure, "gain_flags", result->gain_flags);
  if (result->payload != NULL) {
    GBytes* payload = g_bytes_new(result->payload, result->payload_bytes);
    gst_structure_set(structure, "packet", G_TYPE_UINT, result->packet, "payload", G_TYPE_BYTES, payload, NULL);
    g_bytes_unref(payload);
  }
  return structure;
}

/* Takes the lights of the frame from the receiver to the bus and to the buffer. */
static void publish(OcisacRx* self, GstBuffer* buffer) {
  GValue lights = G_VALUE_INIT;
  gst_value_list_init(&lights, 1);
  GST_OBJECT_LOCK(self);
  const gboolean post = self->post_messages;
  GST_OBJECT_UNLOCK(self);
  ocisac_result result;
  ocisac_result_init(&result);
  while (ocisac_poll(self->receiver, &result) == OCISAC_OK) {
    GstStructure* structure = structure_of(&result, GST_BUFFER_PTS(buffer));
    if (post)
      gst_element_post_message(GST_ELEMENT(self),
                               gst_message_new_element(GST_OBJECT(self), gst_structure_copy(structure)));
    GValue light = G_VALUE_INIT;
    g_value_init(&light, GST_TYPE_STRUCTURE);
    g_value_take_boxed(&light, structure);
    gst_value_list_append_and_take_value(&lights, &light);
  }
  GstCustomMeta* meta = gst_buffer_add_custom_meta(buffer, OCISAC_META);
  gst_structure_take_value(gst_custom_meta_get_structure(meta), "lights", &lights);
}

/* The receiver's error ends the stream. */
static GstFlowReturn fail(OcisacRx* self) {
  GST_ELEMENT_ERROR(self, STREAM, FAILED, ("%s", ocisac_last_error()), (NULL));
  return GST_FLOW_ERROR;
}

static GstFlowReturn transform_ip(GstBaseTransform* transform, GstBuffer* buffer) {
  OcisacRx* self = OCISAC_RX(transform);
  ocisac_stamp stamp;
  ocisac_stamp_init(&stamp);
  if (GST_BUFFER_PTS_IS_VALID(buffer)) stamp.time = (double)GST_BUFFER_PTS(buffer) / GST_SECOND;
  /* Time that stands still, goes back, begins or ends: another stream. */
  if (self->receiver != NULL && !(stamp.time > self->last_time) && !(isnan(stamp.time) && isnan(self->last_time)))
    forget(self);
  if (self->receiver == NULL) {
    const ocisac_options options = stream_options(self);
    if (ocisac_create(&options, &self->receiver) != OCISAC_OK) return fail(self);
    self->next = 0;
  }
  GstVideoFrame video;
  if (!gst_video_frame_map(&video, &self->info, buffer, GST_MAP_READ)) {
    GST_ELEMENT_ERROR(self, STREAM, FAILED, ("frame without readable pixels"), (NULL));
    return GST_FLOW_ERROR;
  }
  const ocisac_frame frame = {GST_VIDEO_FRAME_PLANE_DATA(&video, 0),   pixels_of(&self->info),
                              (guint32)GST_VIDEO_FRAME_WIDTH(&video),  (guint32)GST_VIDEO_FRAME_HEIGHT(&video),
                              GST_VIDEO_FRAME_PLANE_STRIDE(&video, 0), self->next};
  const int code = ocisac_push_stamped(self->receiver, &frame, &stamp);
  gst_video_frame_unmap(&video);
  if (code != OCISAC_OK) return fail(self);
  ++self->next;
  self->last_time = stamp.time;
  publish(self, buffer);
  return GST_FLOW_OK;
}

/* Metadata need a buffer that is writable; its memory is shared with the given one. */
static GstFlowReturn prepare_output_buffer(GstBaseTransform* transform, GstBuffer* in, GstBuffer** out) {
  (void)transform;
  *out = gst_buffer_is_writable(in) ? in : gst_buffer_copy(in);
  return GST_FLOW_OK;
}

static gboolean sink_event(GstBaseTransform* transform, GstEvent* event) {
  if (GST_EVENT_TYPE(event) == GST_EVENT_FLUSH_STOP) forget(OCISAC_RX(transform));
  return GST_BASE_TRANSFORM_CLASS(ocisac_rx_parent_class)->sink_event(transform, event);
}

static gboolean stop(GstBaseTransform* transform) {
  forget(OCISAC_RX(transform));
  return TRUE;
}

static void finalize(GObject* object) {
  forget(OCISAC_RX(object));
  G_OBJECT_CLASS(ocisac_rx_parent_class)->finalize(object);
}

static void ocisac_rx_init(OcisacRx* self) {
  ocisac_options_init(&self->options);
  self->options.exposure = self->options.frequency = self->options.chip_rate = self->options.sense_frequency = 0;
  self->options.dark_level = self->options.white_level = -1;
  self->options.max_lights = 8;
  self->last_time = NAN;
  self->post_messages = TRUE;
}

static void install(GObjectClass* class, guint property, GParamSpec* spec) {
  g_object_class_install_property(class, property, spec);
}

static void install_properties(GObjectClass* class) {
  const GParamFlags flags = G_PARAM_READWRITE | G_PARAM_STATIC_STRINGS | GST_PARAM_MUTABLE_READY;
  static const struct {
    guint property;
    const gchar *name, *text;
    double least, most, otherwise;
  } numbers[] = {
      {PROP_ROW_TIME, "row-time", "Time from row to row, s; must be set", 0, 1, 0},
      {PROP_EXPOSURE, "exposure", "Exposure time, s; 0: unknown", 0, 10, 0},
      {PROP_FRAME_RATE, "frame-rate", "Frames a second; 0: by the caps", 0, G_MAXDOUBLE, 0},
      {PROP_GAMMA, "gamma", "Exponent of tone-curve=gamma", 1e-3, 1e3, 2.2},
      {PROP_DARK_LEVEL, "dark-level", "DN of no light; -1: by the caps' range", -1, 65535, -1},
      {PROP_WHITE_LEVEL, "white-level", "DN of full light; -1: by the caps' range", -1, 65535, -1},
      {PROP_FREQUENCY, "frequency", "Of the tone, Hz; 0: estimated", 0, G_MAXDOUBLE, 0},
      {PROP_DUTY, "duty", "Bright share of a square wave", 0, 1, 0.5},
      {PROP_BACKGROUND, "background", "Light that is not the source's, DN above dark", 0, G_MAXDOUBLE, 0},
      {PROP_SENSE, "sense", "Frequency of the moving scene, Hz, for the suggested exposure; 0: none", 0, G_MAXDOUBLE,
       0},
      {PROP_CHIP_RATE, "chip-rate", "Chips a second; 0: estimated", 0, G_MAXDOUBLE, 0},
  };
  for (guint k = 0; k < G_N_ELEMENTS(numbers); ++k)
    install(class, numbers[k].property,
            g_param_spec_double(numbers[k].name, NULL, numbers[k].text, numbers[k].least, numbers[k].most,
                                numbers[k].otherwise, flags));
  install(class, PROP_TONE_CURVE,
          g_param_spec_enum("tone-curve", NULL, "From light to values", tone_curve_type(), OCISAC_LINEAR, flags));
  install(class, PROP_SCAN_AXIS,
          g_param_spec_enum("scan-axis", NULL, "How rows go in time", scan_axis_type(), OCISAC_DOWN, flags));
  install(class, PROP_WAVEFORM,
          g_param_spec_enum("waveform", NULL, "Of the tone", waveform_type(), OCISAC_TONE, flags));
  install(class, PROP_LINE_CODE,
          g_param_spec_enum("line-code", NULL, "Of packets", line_code_type(), OCISAC_MANCHESTER, flags));
  install(class, PROP_REGION,
          g_param_spec_string("region", NULL, "x,y,w,h of the light in stored pixels; detected when not given", NULL,
                              flags));
  install(class, PROP_SOURCES, g_param_spec_uint("sources", NULL, "Lights, at most", 1, 64, 8, flags));
  install(class, PROP_BLOCK_BYTES,
          g_param_spec_uint("block-bytes", NULL, "Coded bytes of a packet's block", 1, 255, 16, flags));
  install(class, PROP_LENGTHENED,
          g_param_spec_boolean("lengthened", NULL, "Packets with the lengthened preamble", FALSE, flags));
  install(class, PROP_NO_BITS, g_param_spec_boolean("no-bits", NULL, "Gain only", FALSE, flags));
  install(class, PROP_NO_GAIN, g_param_spec_boolean("no-gain", NULL, "Bits and payload only", FALSE, flags));
  install(class, PROP_POST_MESSAGES,
          g_param_spec_boolean("post-messages", NULL, "Post an element message for each light", TRUE, flags));
}

static void add_pads(GstElementClass* element) {
  GstCaps* caps = gst_caps_from_string(GST_VIDEO_CAPS_MAKE(READ_FORMATS));
  gst_element_class_add_pad_template(element, gst_pad_template_new("sink", GST_PAD_SINK, GST_PAD_ALWAYS, caps));
  gst_element_class_add_pad_template(element, gst_pad_template_new("src", GST_PAD_SRC, GST_PAD_ALWAYS, caps));
  gst_caps_unref(caps);
}

static void ocisac_rx_class_init(OcisacRxClass* class) {
  GObjectClass* object = G_OBJECT_CLASS(class);
  object->set_property = set_property;
  object->get_property = get_property;
  object->finalize = finalize;
  install_properties(object);

  GstElementClass* element = GST_ELEMENT_CLASS(class);
  gst_element_class_set_static_metadata(element, "Optical camera receiver", "Filter/Analyzer/Video",
                                        "Posts gains, bits and payloads of modulated lights in frames of a "
                                        "rolling-shutter camera",
                                        "the authors of ocisac_fast");
  add_pads(element);

  GstBaseTransformClass* transform = GST_BASE_TRANSFORM_CLASS(class);
  transform->set_caps = set_caps;
  transform->transform_ip = transform_ip;
  transform->prepare_output_buffer = prepare_output_buffer;
  transform->sink_event = sink_event;
  transform->stop = stop;
  GST_DEBUG_CATEGORY_INIT(ocisacrx_debug, "ocisacrx", 0, "optical camera receiver");
}
