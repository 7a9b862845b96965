/* ocisacclean: removes the bands from video by the cleaner of ocisac/ocisac.h, in place. What the cleaner says of a
 * frame goes to the bus (an element message named "ocisacclean"). Without logic of its own. */
#include "ocisacclean.h"

#include <math.h>
#include <ocisac/ocisac.h>

#include "shared.h"

#define CLEANED_FORMATS "{ " OCISAC_LUMA_FORMATS ", RGB, BGR, RGBx, BGRx, xRGB, xBGR, RGBA, BGRA, ARGB, ABGR, GBR }"

struct _OcisacClean {
  GstVideoFilter parent;
  OcisacCamera camera;
  gint model, mean_level;
  double max_gain, toe; /* toe -1: estimated */
  gboolean post_messages;
  ocisac_cleaner* cleaner; /* of these caps */
  gint64 next;             /* number of the next frame */
  double last_time;        /* s, of the last frame; NaN: it had no stamp */
};

G_DEFINE_TYPE(OcisacClean, ocisac_clean, GST_TYPE_VIDEO_FILTER)

#define FIELD(name) G_STRUCT_OFFSET(OcisacClean, name)

static const GEnumValue models[] = {{OCISAC_MODEL_AUTO, "The one that fits", "auto"},
                                    {OCISAC_MODEL_TONE, "A tone with harmonics", "tone"},
                                    {OCISAC_MODEL_CHIPS, "Chips of data", "chips"},
                                    {OCISAC_MODEL_ROWS, "Any rows", "rows"},
                                    {0, NULL, NULL}};

/* The next frame begins a new stream. */
static void forget(OcisacClean* self) {
  if (self->cleaner != NULL) ocisac_cleaner_forget(self->cleaner);
  self->next = 0;
  self->last_time = NAN;
}

static void drop_cleaner(OcisacClean* self) {
  ocisac_cleaner_destroy(self->cleaner);
  self->cleaner = NULL;
  forget(self);
}

static ocisac_cleaner_options cleaner_options(OcisacClean* self, const GstVideoInfo* info) {
  ocisac_cleaner_options options;
  ocisac_cleaner_options_init(&options);
  GST_OBJECT_LOCK(self);
  OCISAC_SET_CAMERA(options, self->camera, info);
  options.model = self->model;
  options.mean_level = self->mean_level;
  options.max_gain = self->max_gain;
  if (self->toe >= 0) options.toe = self->toe;
  GST_OBJECT_UNLOCK(self);
  return options;
}

static gboolean set_info(GstVideoFilter* filter, GstCaps* in, GstVideoInfo* in_info, GstCaps* out,
                         GstVideoInfo* out_info) {
  OcisacClean* self = OCISAC_CLEAN(filter);
  (void)in, (void)out, (void)out_info;
  drop_cleaner(self);
  if (!ocisac_is_progressive(GST_ELEMENT(self), in_info)) return FALSE;
  const ocisac_cleaner_options options = cleaner_options(self, in_info);
  return ocisac_cleaner_create(&options, &self->cleaner) == OCISAC_OK || ocisac_fail(GST_ELEMENT(self)) == GST_FLOW_OK;
}

static const gchar* name_of_model(gint32 model) {
  for (const GEnumValue* each = models; each->value_nick != NULL; ++each)
    if (each->value == model) return each->value_nick;
  return "";
}

/* With the keys of `ocisac clean --json`. */
static void post(OcisacClean* self, const ocisac_cleaned* cleaned, const GstBuffer* buffer) {
  GST_OBJECT_LOCK(self);
  const gboolean wanted = self->post_messages;
  GST_OBJECT_UNLOCK(self);
  if (!wanted) return;
  GstStructure* structure = gst_structure_new(
      "ocisacclean", "frame", G_TYPE_INT64, self->next, "pts", GST_TYPE_CLOCK_TIME, GST_BUFFER_PTS(buffer), "model",
      G_TYPE_STRING, name_of_model(cleaned->model), "light_left", G_TYPE_DOUBLE, cleaned->light_left,
      "texture_change_db", G_TYPE_DOUBLE, cleaned->texture_change, "slow_bands", G_TYPE_DOUBLE, cleaned->slow_bands,
      "unchanged", G_TYPE_STRING, cleaned->unchanged, NULL);
  if (!isnan(cleaned->frequency))
    gst_structure_set(structure, "frequency_hz", G_TYPE_DOUBLE, cleaned->frequency, NULL);
  ocisac_post(GST_ELEMENT(self), structure);
}

/* Colours, or luma: chroma of YUV stays. */
static guint planes_of(GstVideoFrame* frame, ocisac_plane* planes) {
  const guint count = GST_VIDEO_INFO_IS_RGB(&frame->info) ? 3 : 1;
  for (guint k = 0; k < count; ++k) {
    const ocisac_plane plane = {GST_VIDEO_FRAME_COMP_DATA(frame, k),
                                GST_VIDEO_FRAME_COMP_DEPTH(frame, k) > 8 ? OCISAC_GRAY16 : OCISAC_GRAY8,
                                (guint32)GST_VIDEO_FRAME_COMP_WIDTH(frame, k),
                                (guint32)GST_VIDEO_FRAME_COMP_HEIGHT(frame, k),
                                GST_VIDEO_FRAME_COMP_STRIDE(frame, k),
                                GST_VIDEO_FRAME_COMP_PSTRIDE(frame, k)};
    planes[k] = plane;
  }
  return count;
}

static GstFlowReturn transform_frame_ip(GstVideoFilter* filter, GstVideoFrame* frame) {
  OcisacClean* self = OCISAC_CLEAN(filter);
  const double time = ocisac_time_of(frame->buffer);
  if (!ocisac_goes_on(time, self->last_time) || GST_BUFFER_IS_DISCONT(frame->buffer)) forget(self);
  ocisac_plane planes[3];
  const guint count = planes_of(frame, planes);
  ocisac_cleaned cleaned;
  ocisac_cleaned_init(&cleaned);
  ocisac_stamp stamp;
  ocisac_stamp_init(&stamp);
  stamp.time = time;
  if (ocisac_cleaner_push_stamped(self->cleaner, planes, count, &stamp, &cleaned) != OCISAC_OK)
    return ocisac_fail(GST_ELEMENT(self));
  post(self, &cleaned, frame->buffer);
  ++self->next;
  self->last_time = time;
  return GST_FLOW_OK;
}

static gboolean sink_event(GstBaseTransform* transform, GstEvent* event) {
  if (GST_EVENT_TYPE(event) == GST_EVENT_FLUSH_STOP) forget(OCISAC_CLEAN(transform));
  return GST_BASE_TRANSFORM_CLASS(ocisac_clean_parent_class)->sink_event(transform, event);
}

/* Late frames are dropped here and no further upstream: from there the frame after a dropped one would come as a
 * discontinuity, be cleaned like a first one, which takes several times as long, and so make more frames late. */
static gboolean src_event(GstBaseTransform* transform, GstEvent* event) {
  if (GST_EVENT_TYPE(event) != GST_EVENT_QOS)
    return GST_BASE_TRANSFORM_CLASS(ocisac_clean_parent_class)->src_event(transform, event);
  gdouble proportion;
  GstClockTimeDiff late;
  GstClockTime time;
  gst_event_parse_qos(event, NULL, &proportion, &late, &time);
  gst_base_transform_update_qos(transform, proportion, late, time);
  gst_event_unref(event);
  return TRUE;
}

static gboolean stop(GstBaseTransform* transform) {
  drop_cleaner(OCISAC_CLEAN(transform));
  return TRUE;
}

static void finalize(GObject* object) {
  drop_cleaner(OCISAC_CLEAN(object));
  G_OBJECT_CLASS(ocisac_clean_parent_class)->finalize(object);
}

static void ocisac_clean_init(OcisacClean* self) { self->last_time = NAN; }

static void install_properties(GObjectClass* class) {
  static const GEnumValue levels[] = {
      {0, "That of the brightest rows", "full"}, {1, "The mean of the rows", "mean"}, {0, NULL, NULL}};
  ocisac_install_camera(class, FIELD(camera));
  ocisac_install_choice(class, FIELD(model), "model", "Of the light", "OcisacCleanModel", models, OCISAC_MODEL_AUTO);
  ocisac_install_choice(class, FIELD(mean_level), "level", "Level of the steady light", "OcisacCleanLevel", levels, 0);
  ocisac_install_number(class, FIELD(max_gain), "max-gain", "Rows that need a larger gain are too dark", 1, G_MAXDOUBLE,
                        8);
  ocisac_install_number(class, FIELD(toe), "toe",
                        "Toe of the tone curve, 0 to 1: dim light is stored darker; -1: estimated", -1, 1, -1);
  ocisac_install_switch(class, FIELD(post_messages), "post-messages", "Post an element message for each frame", TRUE);
}

static void ocisac_clean_class_init(OcisacCleanClass* class) {
  GObjectClass* object = G_OBJECT_CLASS(class);
  object->set_property = ocisac_set_property;
  object->get_property = ocisac_get_property;
  object->finalize = finalize;
  install_properties(object);

  GstElementClass* element = GST_ELEMENT_CLASS(class);
  gst_element_class_set_static_metadata(
      element, "Remover of bands", "Filter/Effect/Video",
      "Removes the bands of flickering lights from frames of a rolling-shutter camera", "the authors of ocisac_fast");
  ocisac_add_pads(element, GST_VIDEO_CAPS_MAKE(CLEANED_FORMATS));

  GstBaseTransformClass* transform = GST_BASE_TRANSFORM_CLASS(class);
  transform->sink_event = sink_event;
  transform->src_event = src_event;
  transform->stop = stop;
  GstVideoFilterClass* filter = GST_VIDEO_FILTER_CLASS(class);
  filter->set_info = set_info;
  filter->transform_frame_ip = transform_frame_ip;
}
