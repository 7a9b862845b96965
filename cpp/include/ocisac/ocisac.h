/* The receiver for C and languages that call C. It searches lights, tracks them, and estimates their gains and data in
 * every frame. ocisac_detect(), ocisac_calibrate() and ocisac_find_frequency() answer for a single picture,
 * ocisac_advise_exposure() without one.
 *
 *   ocisac_options options;
 *   ocisac_options_init(&options);
 *   options.row_time = 22.2e-6;
 *   ocisac_receiver *receiver;
 *   if (ocisac_create(&options, &receiver) != OCISAC_OK) puts(ocisac_last_error());
 *   for each frame: ocisac_push(receiver, &frame); while (ocisac_poll(receiver, &result) == OCISAC_OK) ...
 *   ocisac_destroy(receiver);
 *
 * One receiver is used by one thread at a time; different receivers are independent. No function throws. A call used up
 * to 240 kB of its thread's stack (x86-64, pictures of up to 4096x3000): threads need 512 kB, more than some systems
 * give (musl: 128 kB).
 * Fields may be added to the ends of the structs: `size`, set by the _init functions, identifies the version that a
 * program was compiled with. Unknown numbers are NaN. Times are in s, frequencies in Hz.
 */
#ifndef OCISAC_OCISAC_H
#define OCISAC_OCISAC_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { /* return values */
       OCISAC_OK = 0,
       OCISAC_NOTHING = 1,       /* poll: no result available */
       OCISAC_BAD_ARGUMENT = -1, /* invalid value, named by ocisac_last_error() */
       OCISAC_NO_MEMORY = -2,
       OCISAC_FAILED = -3
};

/* Pixels; 16 bits in the machine's own byte order, YUYV: luma in every second byte. Of planar formats the first plane
 * is OCISAC_GRAY8. */
enum { OCISAC_GRAY8 = 0, OCISAC_GRAY16 = 1, OCISAC_YUYV = 2 };
/* Direction in which rows are exposed, in the stored picture. */
enum { OCISAC_DOWN = 0, OCISAC_UP = 1, OCISAC_RIGHT = 2, OCISAC_LEFT = 3 };
enum { OCISAC_TONE = 0, OCISAC_SQUARE = 1 };                                        /* waveforms */
enum { OCISAC_LINEAR = 0, OCISAC_SRGB = 1, OCISAC_GAMMA = 2 };                      /* tone curves */
enum { OCISAC_NONE = 0, OCISAC_MANCHESTER = 1, OCISAC_4B6B = 2, OCISAC_8B10B = 3 }; /* line codes */

enum { OCISAC_MODEL_AUTO = 0, OCISAC_MODEL_TONE = 1, OCISAC_MODEL_CHIPS = 2, OCISAC_MODEL_ROWS = 3 }; /* of a light */

typedef struct ocisac_receiver ocisac_receiver;
typedef struct ocisac_cleaner ocisac_cleaner;

typedef struct ocisac_region { /* stored pixels; width 0: none */
  uint32_t x, y, width, height;
} ocisac_region;

typedef struct ocisac_options {
  size_t size;
  double row_time;        /* must be set */
  double exposure;        /* NaN: unknown */
  double frame_time;      /* NaN: unknown, and packets are not joined over frames */
  double frequency;       /* of the tone; NaN: estimated */
  double chip_rate;       /* of the data; NaN: estimated, which requires an exposure below a chip */
  double sense_frequency; /* of the moving scene, for the suggested exposure; NaN: none */
  double dark_level;      /* DN without light; default 0 */
  double white_level;     /* DN of full light; default 0: the maximum of the pixel type */
  double background;      /* other light, DN above dark; default 0 */
  double duty;            /* bright fraction of a square wave; default 0.5 */
  int32_t waveform;       /* default OCISAC_TONE */
  int32_t line_code;      /* default OCISAC_MANCHESTER */
  uint32_t block_bytes;   /* of packets; default 16 */
  int32_t lengthened;     /* 1: packets with the lengthened preamble; default 0 */
  int32_t want_gain;      /* default 1 */
  int32_t want_data;      /* default 1 */
  ocisac_region region;   /* of the light; none: lights are searched */
  uint32_t max_lights;    /* searched, the strongest first; default 1 */
  int32_t tone_curve;     /* of the pixels; default OCISAC_LINEAR */
  double gamma;           /* exponent of OCISAC_GAMMA; default 2.2 */
  int32_t scan_axis;      /* default OCISAC_DOWN */
} ocisac_options;

typedef struct ocisac_frame {
  const void* pixels; /* the first row */
  int32_t format;     /* OCISAC_GRAY8, OCISAC_GRAY16 or OCISAC_YUYV */
  uint32_t width, height;
  ptrdiff_t stride; /* bytes from row to row; may be negative */
  int64_t number;   /* ascending; frames may be missing */
} ocisac_frame;

typedef struct ocisac_stamp { /* what the camera states of a frame; NaN: not stated */
  size_t size;
  double time;     /* s, of the first row, from any origin, ascending; of all frames or of none */
  double exposure; /* s, instead of that of the options */
  double gain;     /* factor of the pixels' values */
} ocisac_stamp;

typedef struct ocisac_result {
  size_t size;
  int64_t frame;
  ocisac_region region;            /* received */
  int32_t searched;                /* 1: the light was searched in the whole picture */
  uint32_t gain_flags, data_flags; /* bits of ocisac/core/flags.hpp */
  double frequency, gain, gain_std, gain_snr;
  double chip_rate, data_snr, error_rate;
  double suggested_exposure;
  /* Memory of the receiver, valid until the next push. */
  const char* bits; /* bit_count characters '0' or '1' (1 = bright), null-terminated; "" without reception */
  size_t bit_count;
  const uint8_t* payload; /* NULL unless this frame completed one */
  size_t payload_bytes;
  uint32_t packet; /* number of the payload's packet */
  uint32_t source; /* number of the light in order of detection, from 0 */
  double frequency_std, rows_per_chip;
  double exposure;     /* given or estimated */
  double packet_share; /* bytes of the packet so far over those that its payload needs */
  double first_bit; /* row, in order of time, at which the first bit begins; half an exposure after the light's edge */
} ocisac_result;

/* A modulated light in a picture. */
typedef struct ocisac_light {
  size_t size;
  ocisac_region box;
  double probability; /* that it is a light */
  double frequency, frequency_std;
  double gain, gain_std, snr; /* all light in the box attributed to the source */
  double phase;               /* rad, at the end of row 0's exposure */
  int32_t carries_data;       /* 1: not periodic */
  int32_t reflection_of;      /* index of the light that it reflects; -1: of none */
  uint32_t flags;
} ocisac_light;

/* The row time, from a lamp of known frequency. */
typedef struct ocisac_calibration {
  size_t size;
  double row_time, row_time_std;
  uint32_t flags;
} ocisac_calibration;

/* The tone of a picture's columns, and their spectrum. */
typedef struct ocisac_tone {
  size_t size;
  /* Set by the caller: places for `rows` and for 2·rows + 1 numbers, NULL if not wanted. rows: those of the region, in
   * order of time. */
  double* column;    /* mean of the columns that show the tone, linear light, DN above dark */
  double* amplitude; /* of the column over its mean, 1 for a tone of full depth; at multiples of `step` from 0 on */
  double* response;  /* |sinc(f·exposure)| at the same frequencies; NaN without an exposure in the options */
  size_t rows;
  /* Answers */
  double step; /* Hz */
  double frequency, frequency_std, gain, gain_std, phase, mean, snr;
  double theory; /* |sinc(frequency·exposure)| */
  uint32_t columns;
  uint32_t flags;
} ocisac_tone;

/* A light that must leave no bands; any phase. */
typedef struct ocisac_flicker {
  size_t size;
  double frequency;   /* must be set */
  double uncertainty; /* half width of the interval that contains the frequency, Hz; default 0 */
  double duty;        /* bright share of a PWM period; NaN: a raised cosine, the default */
  double depth;       /* (max − min)/(max + min) of the light; default 1 */
} ocisac_flicker;

/* The best exposure for communication and sensing (maximum of |sin(πf_c T)|/(πf_c) + |sin(πf_s T)|/(πf_s)), or without
 * bands of lights. */
typedef struct ocisac_exposure_request {
  size_t size;
  double comm_frequency, sense_frequency; /* f_c, f_s; NaN: none, the default */
  double comm_weight, sense_weight;       /* of the sum; default 1 */
  double shortest, longest; /* s; NaN, the default: 0 to 1/min(f_c, f_s), with lights to avoid 0 to 0.1 s */
  double step;              /* s: whole multiples only; NaN, the default: any */
  double below;             /* bound of the modulation (max − min)/(max + min) of lights to avoid; default 0.02 */
  double near;              /* s: the nearest without bands instead of the shortest; default NaN */
  double min_gain;          /* of f_c beside lights to avoid; default NaN */
} ocisac_exposure_request;

typedef struct ocisac_exposure_advice {
  size_t size;
  double exposure;   /* s */
  double objective;  /* the sum at that exposure, s; NaN if it was not maximised */
  double gain;       /* |sinc(f_c·exposure)|; NaN without f_c */
  double modulation; /* the largest of the lights to avoid; NaN without any */
  int32_t holds;     /* 0: no exposure satisfies the bound and the gain, this one comes closest */
} ocisac_exposure_advice;

/* The removal of bands from the frames of a stream. */
typedef struct ocisac_cleaner_options {
  size_t size;
  double row_time;   /* must be set */
  double frame_time; /* NaN: unknown */
  double noise;      /* standard deviation of a pixel, DN; NaN, the default: estimated */
  double toe; /* of the tone curve, 0 to 1: light x is stored as x^2/(x + toe*white); NaN, the default: estimated */
  double max_gain;    /* rows that need a larger one are too dark, and amplified by this one; default 8 */
  double dark_level;  /* DN without light; default 0 */
  double white_level; /* DN of full light; default 0: the maximum of the pixel type */
  double gamma;       /* exponent of OCISAC_GAMMA; default 2.2 */
  int32_t tone_curve; /* of the pixels; default OCISAC_LINEAR */
  int32_t scan_axis;  /* default OCISAC_DOWN */
  int32_t model;      /* of the light; default OCISAC_MODEL_AUTO */
  int32_t mean_level; /* 1: the picture is as bright as its rows are in the mean; default 0: as the brightest are */
} ocisac_cleaner_options;

typedef struct ocisac_plane { /* one colour of a picture, or its luma */
  void* pixels;               /* of the first row; overwritten with the cleaned ones */
  int32_t format;             /* OCISAC_GRAY8 or OCISAC_GRAY16 */
  uint32_t width, height;
  ptrdiff_t stride;       /* bytes from row to row; may be negative */
  ptrdiff_t pixel_stride; /* bytes from pixel to pixel; may be negative */
} ocisac_plane;

typedef struct ocisac_cleaned {
  size_t size;
  int32_t model;         /* found, of the first plane */
  double frequency;      /* of the tone, or the chip rate; NaN for other rows */
  double light_left;     /* swing of the row light in the columns after cleaning, over that before */
  double texture_change; /* energy of texture after cleaning over that before, dB */
  double slow_bands;     /* amplitude, relative to the light, of bands above 128 rows per cycle that are left */
  const char* unchanged; /* why the frame is left as it was; "" for a cleaned one. Valid until the next call */
} ocisac_cleaned;

void ocisac_options_init(ocisac_options* options);
void ocisac_result_init(ocisac_result* result);
void ocisac_stamp_init(ocisac_stamp* stamp);
void ocisac_light_init(ocisac_light* light);
void ocisac_calibration_init(ocisac_calibration* calibration);
void ocisac_tone_init(ocisac_tone* tone);
void ocisac_flicker_init(ocisac_flicker* light);
void ocisac_exposure_request_init(ocisac_exposure_request* request);
void ocisac_exposure_advice_init(ocisac_exposure_advice* advice);
void ocisac_cleaner_options_init(ocisac_cleaner_options* options);
void ocisac_cleaned_init(ocisac_cleaned* cleaned);

/* Stores a new receiver in *receiver, NULL on failure. */
int ocisac_create(const ocisac_options* options, ocisac_receiver** receiver);

/* Processes a frame; the pixels may be freed afterwards. All frames have one size and format. A number not above that
 * of the last frame is no error: the frame counts as repeated, and its result states nothing of the light. From the
 * eighth such frame in a row whose numbers ascend, the count has begun again, and all before it is forgotten. */
int ocisac_push(ocisac_receiver* receiver, const ocisac_frame* frame);

/* The same with a stamp: its time joins frames instead of their numbers, exposure and gain begin the estimates. */
int ocisac_push_stamped(ocisac_receiver* receiver, const ocisac_frame* frame, const ocisac_stamp* stamp);

/* Returns the results of the last frame (OCISAC_OK), one light a call, the strongest first, then OCISAC_NOTHING. The
 * next push discards them. */
int ocisac_poll(ocisac_receiver* receiver, ocisac_result* result);

/* Finds the modulated lights of one picture, the most probable first, and copies up to `capacity` of them to `lights`,
 * each initialised. *found: number of all. Uses row_time, exposure and the tone curve of the options. */
int ocisac_detect(const ocisac_options* options, const ocisac_frame* frame, ocisac_light* lights, size_t capacity,
                  size_t* found);

/* Estimates the row time from one picture of a lamp of this frequency (Hz), below half the row rate. Uses dark and
 * white level of the options; the row time is not read. */
int ocisac_calibrate(const ocisac_options* options, const ocisac_frame* frame, double frequency,
                     ocisac_calibration* calibration);

/* Fits the tone of one picture, in the region of the options or in all of it: at their frequency, or at the estimated
 * one. Uses row_time, exposure, waveform, duty, background, scan axis and tone curve too. */
int ocisac_find_frequency(const ocisac_options* options, const ocisac_frame* frame, ocisac_tone* tone);

/* Chooses an exposure. `lights`: `count` lights to avoid, each initialised; NULL with 0. */
int ocisac_advise_exposure(const ocisac_exposure_request* request, const ocisac_flicker* lights, size_t count,
                           ocisac_exposure_advice* advice);

/* Chips that transmit a payload as packet `number`, 0 to 255, sent repeatedly: '0' and '1', 1 = bright, not
 * null-terminated. Copies up to `capacity` of them to `chips`. *count: number of all. Uses line_code, block_bytes and
 * lengthened of the options. */
int ocisac_packet_chips(const ocisac_options* options, const uint8_t* payload, size_t payload_bytes, uint32_t number,
                        char* chips, size_t capacity, size_t* count);

/* Stores a new cleaner of streams in *cleaner, NULL on failure. It is used as a receiver is: by one thread at a time.
 */
int ocisac_cleaner_create(const ocisac_cleaner_options* options, ocisac_cleaner** cleaner);

/* Removes the bands from the next frame, in place: `count` planes of one size and format, 1 to 4. A frame that cleaning
 * would make worse stays, and cleaned->unchanged gives the reason; `cleaned`: NULL if not wanted. After an error the
 * pixels are as before. */
int ocisac_cleaner_push(ocisac_cleaner* cleaner, const ocisac_plane* planes, size_t count, ocisac_cleaned* cleaned);

/* The same with a stamp, whose time tells the frames that are missing: the phase of a slow light advances meanwhile. */
int ocisac_cleaner_push_stamped(ocisac_cleaner* cleaner, const ocisac_plane* planes, size_t count,
                                const ocisac_stamp* stamp, ocisac_cleaned* cleaned);

/* Cleans the next frame without what is known of those before, as after a seek. */
int ocisac_cleaner_forget(ocisac_cleaner* cleaner);

/* NULL is allowed. */
void ocisac_cleaner_destroy(ocisac_cleaner* cleaner);

/* Name of one bit of gain_flags, data_flags or flags; NULL for a bit without meaning. */
const char* ocisac_flag_name(uint32_t bit);

/* NULL is allowed. */
void ocisac_destroy(ocisac_receiver* receiver);

/* Message of this thread's last failed call: "argument: got VALUE, allowed: ...". */
const char* ocisac_last_error(void);

/* "MAJOR.MINOR.PATCH". */
const char* ocisac_version(void);

#ifdef __cplusplus
}
#endif

#endif
