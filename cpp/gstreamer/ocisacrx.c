/* ocisacrx: passes video through; what the receiver of ocisac/ocisac.h finds in a frame goes to the bus (one element
 * message a light, named "ocisac") and to the frame's GstOcisacMeta. Without logic of its own. */
#include "ocisacrx.h"

#include <math.h>
#include <ocisac/ocisac.h>

#include "shared.h"

struct _OcisacRx {
  GstBaseTransform parent;
  OcisacCamera camera;
  ocisac_options options; /* the other properties: unknown times and rates are 0 */
  gboolean no_bits, no_gain, post_messages;
  GstVideoInfo info;         /* of the caps */
  ocisac_receiver* receiver; /* from the first frame after caps, seek or jump on */
  gint64 next;               /* number of the next frame */
  double last_time;          /* s, of the last frame; NaN: it had no stamp */
};

G_DEFINE_TYPE(OcisacRx, ocisac_rx, GST_TYPE_BASE_TRANSFORM)

#define FIELD(name) G_STRUCT_OFFSET(OcisacRx, name)

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
  if (text != NULL && *text != '\0' && !parse_region(text, &region)) {
    g_warning("region: got %s, allowed: x,y,w,h in pixels, w and h above 0", text);
    return;
  }
  GST_OBJECT_LOCK(self);
  self->options.region = region;
  GST_OBJECT_UNLOCK(self);
}

static gchar* region_text(OcisacRx* self) {
  GST_OBJECT_LOCK(self);
  const ocisac_region region = self->options.region;
  GST_OBJECT_UNLOCK(self);
  return region.width == 0 ? NULL : g_strdup_printf("%u,%u,%u,%u", region.x, region.y, region.width, region.height);
}

static void set_property(GObject* object, guint property, const GValue* value, GParamSpec* spec) {
  if (property == FIELD(options.region))
    set_region(OCISAC_RX(object), g_value_get_string(value));
  else
    ocisac_set_property(object, property, value, spec);
}

static void get_property(GObject* object, guint property, GValue* value, GParamSpec* spec) {
  if (property == FIELD(options.region))
    g_value_take_string(value, region_text(OCISAC_RX(object)));
  else
    ocisac_get_property(object, property, value, spec);
}

/* The options, completed by the caps. */
static ocisac_options stream_options(OcisacRx* self) {
  GST_OBJECT_LOCK(self);
  ocisac_options options = self->options;
  OCISAC_SET_CAMERA(options, self->camera, &self->info);
  options.want_data = !self->no_bits;
  options.want_gain = !self->no_gain;
  GST_OBJECT_UNLOCK(self);
  double* const unknown[] = {&options.exposure, &options.frequency, &options.chip_rate, &options.sense_frequency};
  for (guint k = 0; k < G_N_ELEMENTS(unknown); ++k)
    if (*unknown[k] == 0) *unknown[k] = NAN;
  return options;
}

/* Luma; UYVY is YUYV whose first luma is a byte further. */
static ocisac_frame frame_of(const GstVideoFrame* video, gint64 number) {
  const gint32 small = GST_VIDEO_FRAME_COMP_PSTRIDE(video, 0) == 2 ? OCISAC_YUYV : OCISAC_GRAY8;
  const ocisac_frame frame = {
      GST_VIDEO_FRAME_COMP_DATA(video, 0),   GST_VIDEO_FRAME_COMP_DEPTH(video, 0) > 8 ? OCISAC_GRAY16 : small,
      (guint32)GST_VIDEO_FRAME_WIDTH(video), (guint32)GST_VIDEO_FRAME_HEIGHT(video),
      GST_VIDEO_FRAME_COMP_STRIDE(video, 0), number};
  return frame;
}

static gboolean set_caps(GstBaseTransform* transform, GstCaps* in, GstCaps* out) {
  OcisacRx* self = OCISAC_RX(transform);
  (void)out;
  if (!gst_video_info_from_caps(&self->info, in)) return FALSE;
  if (!ocisac_is_progressive(GST_ELEMENT(self), &self->info)) return FALSE;
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
    if (post) ocisac_post(GST_ELEMENT(self), gst_structure_copy(structure));
    GValue light = G_VALUE_INIT;
    g_value_init(&light, GST_TYPE_STRUCTURE);
    g_value_take_boxed(&light, structure);
    gst_value_list_append_and_take_value(&lights, &light);
  }
  GstCustomMeta* meta = gst_buffer_add_custom_meta(buffer, OCISAC_META);
  gst_structure_take_value(gst_custom_meta_get_structure(meta), "lights", &lights);
}

static GstFlowReturn transform_ip(GstBaseTransform* transform, GstBuffer* buffer) {
  OcisacRx* self = OCISAC_RX(transform);
  ocisac_stamp stamp;
  ocisac_stamp_init(&stamp);
  stamp.time = ocisac_time_of(buffer);
  if (self->receiver != NULL && !ocisac_goes_on(stamp.time, self->last_time)) forget(self);
  if (self->receiver == NULL) {
    const ocisac_options options = stream_options(self);
    if (ocisac_create(&options, &self->receiver) != OCISAC_OK) return ocisac_fail(GST_ELEMENT(self));
    self->next = 0;
  }
  GstVideoFrame video;
  if (!gst_video_frame_map(&video, &self->info, buffer, GST_MAP_READ)) {
    GST_ELEMENT_ERROR(self, STREAM, FAILED, ("frame without readable pixels"), (NULL));
    return GST_FLOW_ERROR;
  }
  const ocisac_frame frame = frame_of(&video, self->next);
  const int code = ocisac_push_stamped(self->receiver, &frame, &stamp);
  gst_video_frame_unmap(&video);
  if (code != OCISAC_OK) return ocisac_fail(GST_ELEMENT(self));
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
  self->last_time = NAN;
}

static void install_numbers(GObjectClass* class) {
  ocisac_install_camera(class, FIELD(camera));
  static const struct {
    gsize field;
    const gchar *name, *text;
    double most, otherwise;
  } numbers[] = {
      {FIELD(options.exposure), "exposure", "Exposure time of a row, s; 0: unknown", 10, 0},
      {FIELD(options.frequency), "frequency", "Frequency of the tone, Hz; 0: estimated", G_MAXDOUBLE, 0},
      {FIELD(options.duty), "duty", "Bright share of a square wave", 1, 0.5},
      {FIELD(options.background), "background", "Light that is not the source's, DN above dark", G_MAXDOUBLE, 0},
      {FIELD(options.sense_frequency), "sense",
       "Frequency of the moving scene, Hz, for the suggested exposure; 0: none", G_MAXDOUBLE, 0},
      {FIELD(options.chip_rate), "chip-rate", "Chips per second; 0: estimated", G_MAXDOUBLE, 0},
  };
  for (guint k = 0; k < G_N_ELEMENTS(numbers); ++k)
    ocisac_install_number(class, numbers[k].field, numbers[k].name, numbers[k].text, 0, numbers[k].most,
                          numbers[k].otherwise);
}

static void install_properties(GObjectClass* class) {
  static const GEnumValue waveforms[] = {
      {OCISAC_TONE, "Cosine", "tone"}, {OCISAC_SQUARE, "Square wave", "square"}, {0, NULL, NULL}};
  static const GEnumValue codes[] = {{OCISAC_NONE, "None", "none"},
                                     {OCISAC_MANCHESTER, "Manchester", "manchester"},
                                     {OCISAC_4B6B, "4B6B", "4b6b"},
                                     {OCISAC_8B10B, "8B10B", "8b10b"},
                                     {0, NULL, NULL}};
  const GParamFlags flags = ocisac_property_flags;
  install_numbers(class);
  ocisac_install_choice(class, FIELD(options.waveform), "waveform", "Waveform of the light", "OcisacWaveform",
                        waveforms, OCISAC_TONE);
  ocisac_install_choice(class, FIELD(options.line_code), "line-code", "Line code of packets", "OcisacLineCode", codes,
                        OCISAC_MANCHESTER);
  ocisac_install(
      class, FIELD(options.region),
      g_param_spec_string("region", NULL, "Box of the light in stored pixels, x,y,w,h; detected when not given", NULL,
                          flags));
  ocisac_install(class, FIELD(options.max_lights),
                 g_param_spec_uint("sources", NULL, "Max. number of lights", 1, 64, 8, flags));
  ocisac_install(class, FIELD(options.block_bytes),
                 g_param_spec_uint("block-bytes", NULL, "Coded bytes of a packet's block", 1, 255, 16, flags));
  ocisac_install_switch(class, FIELD(options.lengthened), "lengthened", "Packets with the lengthened preamble", FALSE);
  ocisac_install_switch(class, FIELD(no_bits), "no-bits", "Gain only", FALSE);
  ocisac_install_switch(class, FIELD(no_gain), "no-gain", "Bits and payload only", FALSE);
  ocisac_install_switch(class, FIELD(post_messages), "post-messages", "Post an element message for each light", TRUE);
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
  ocisac_add_pads(element, GST_VIDEO_CAPS_MAKE("{ " OCISAC_LUMA_FORMATS " }"));

  GstBaseTransformClass* transform = GST_BASE_TRANSFORM_CLASS(class);
  transform->set_caps = set_caps;
  transform->transform_ip = transform_ip;
  transform->prepare_output_buffer = prepare_output_buffer;
  transform->sink_event = sink_event;
  transform->stop = stop;
}
