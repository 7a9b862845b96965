/* The receiver for C, and for whatever calls C: a light found once and followed, its gain and data frame by frame.
 *
 *   ocisac_options options;
 *   ocisac_options_init(&options);
 *   options.row_time = 22.2e-6;
 *   ocisac_receiver *receiver;
 *   if (ocisac_create(&options, &receiver) != OCISAC_OK) puts(ocisac_last_error());
 *   for each frame: ocisac_push(receiver, &frame); while (ocisac_poll(receiver, &result) == OCISAC_OK) ...
 *   ocisac_destroy(receiver);
 *
 * One receiver is used by one thread at a time; different receivers do not know of each other. No function throws.
 * Fields may be added to the ends of the structs: `size`, which the _init functions fill in, tells which ones a program
 * knows. Numbers that are not known are NaN. Times are in s, frequencies in Hz.
 */
#ifndef OCISAC_OCISAC_H
#define OCISAC_OCISAC_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { /* what functions return */
       OCISAC_OK = 0,
       OCISAC_NOTHING = 1,       /* poll: no result waits */
       OCISAC_BAD_ARGUMENT = -1, /* a value without meaning: ocisac_last_error() names it */
       OCISAC_NO_MEMORY = -2,
       OCISAC_FAILED = -3
};

enum { OCISAC_GRAY8 = 0, OCISAC_GRAY16 = 1 }; /* pixels; 16 bits in the machine's own byte order */
enum { OCISAC_TONE = 0, OCISAC_SQUARE = 1 };  /* waveforms */
enum { OCISAC_NONE = 0, OCISAC_MANCHESTER = 1, OCISAC_4B6B = 2, OCISAC_8B10B = 3 }; /* line codes */

typedef struct ocisac_receiver ocisac_receiver;

typedef struct ocisac_region { /* pixels; width 0: none */
  uint32_t x, y, width, height;
} ocisac_region;

typedef struct ocisac_options {
  size_t size;
  double row_time;        /* must be set */
  double exposure;        /* NaN: not known */
  double frame_time;      /* NaN: not known; packets are then not joined over frames */
  double frequency;       /* of the tone; NaN: found */
  double chip_rate;       /* of the data; NaN: found, which takes an exposure below a chip */
  double sense_frequency; /* of the moving scene, for the suggested exposure; NaN: none */
  double dark_level;      /* DN of no light: 0 */
  double white_level;     /* DN of full light; 0: the largest number of the pixels' type */
  double background;      /* light that is not the source's, DN above dark: 0 */
  double duty;            /* bright share of a square wave: 0.5 */
  int32_t waveform;       /* OCISAC_TONE */
  int32_t line_code;      /* OCISAC_MANCHESTER */
  uint32_t block_bytes;   /* of packets: 16 */
  int32_t lengthened;     /* packets with the lengthened preamble: 0 */
  int32_t want_gain;      /* 1 */
  int32_t want_data;      /* 1 */
  ocisac_region region;   /* of the light; none: searched */
} ocisac_options;

typedef struct ocisac_frame {
  const void* pixels; /* of the first row in time order */
  int32_t format;     /* OCISAC_GRAY8 or OCISAC_GRAY16 */
  uint32_t width, height;
  ptrdiff_t stride; /* bytes from row to row; negative where rows go up in time */
  int64_t number;   /* ascending; frames may be missing */
} ocisac_frame;

typedef struct ocisac_result {
  size_t size;
  int64_t frame;
  ocisac_region region;            /* that was read */
  int32_t searched;                /* the light was looked for in the whole picture */
  uint32_t gain_flags, data_flags; /* bits of ocisac/estimation/flags.hpp */
  double frequency, gain, gain_std, gain_snr;
  double chip_rate, data_snr, error_rate;
  double suggested_exposure;
  /* Of the receiver; they stay until the next push. */
  const char* bits; /* bit_count times '0' or '1', 1 = bright, and an end of string; "" where nothing was received */
  size_t bit_count;
  const uint8_t* payload; /* NULL unless one came whole with this frame */
  size_t payload_bytes;
  uint32_t packet; /* number of the payload's packet */
} ocisac_result;

void ocisac_options_init(ocisac_options* options);
void ocisac_result_init(ocisac_result* result);

/* A new receiver into *receiver; NULL there where it fails. */
int ocisac_create(const ocisac_options* options, ocisac_receiver** receiver);

/* Takes a frame; its pixels are not needed after. All frames of one size and format. */
int ocisac_push(ocisac_receiver* receiver, const ocisac_frame* frame);

/* The result of the last frame, once: OCISAC_OK, then OCISAC_NOTHING. One that was not polled before the next push is
 * lost. */
int ocisac_poll(ocisac_receiver* receiver, ocisac_result* result);

/* NULL is let pass. */
void ocisac_destroy(ocisac_receiver* receiver);

/* What was wrong with this thread's last call that failed: "argument: got VALUE, allowed: ...". */
const char* ocisac_last_error(void);

/* "MAJOR.MINOR.PATCH". */
const char* ocisac_version(void);

#ifdef __cplusplus
}
#endif

#endif
