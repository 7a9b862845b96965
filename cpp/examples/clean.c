/* Raw 8-bit grey frames on standard input, without the bands of flickering light on standard output:
 *
 *   ffmpeg -i lamp.mkv -f rawvideo -pix_fmt gray - | clean 1920 1080 22.2e-6 30 | ffmpeg -f rawvideo -pix_fmt gray \
 *     -s 1920x1080 -r 30 -i - clean.mkv
 *
 * arguments: width, height, row time (s), frames per second
 */
#include <math.h>
#include <ocisac/ocisac.h>
#include <stdio.h>
#include <stdlib.h>

static int fail(const char* what) {
  fprintf(stderr, "clean: %s\n", what);
  return 2;
}

int main(int count, char** arguments) {
  if (count != 5) return fail("arguments: width height row_time frame_rate");
  ocisac_plane plane = {0};
  plane.width = (uint32_t)strtoul(arguments[1], NULL, 10);
  plane.height = (uint32_t)strtoul(arguments[2], NULL, 10);
  plane.stride = (ptrdiff_t)plane.width;
  plane.pixel_stride = 1;
  plane.format = OCISAC_GRAY8;

  ocisac_cleaner_options options;
  ocisac_cleaner_options_init(&options);
  options.row_time = atof(arguments[3]);
  options.frame_time = 1 / atof(arguments[4]);
  ocisac_cleaner* cleaner;
  if (ocisac_cleaner_create(&options, &cleaner) != OCISAC_OK) return fail(ocisac_last_error());

  const size_t bytes = (size_t)plane.width * plane.height;
  plane.pixels = malloc(bytes > 0 ? bytes : 1);
  if (plane.pixels == NULL) return fail("out of memory");
  int code = OCISAC_OK;
  for (long frame = 0; bytes > 0 && fread(plane.pixels, 1, bytes, stdin) == bytes; ++frame) {
    ocisac_cleaned cleaned;
    ocisac_cleaned_init(&cleaned);
    code = ocisac_cleaner_push(cleaner, &plane, 1, &cleaned);
    if (code != OCISAC_OK) break;
    fprintf(stderr, "frame %ld: %s", frame, *cleaned.unchanged != '\0' ? cleaned.unchanged : "cleaned");
    if (!isnan(cleaned.frequency)) fprintf(stderr, ", %.3g Hz", cleaned.frequency);
    fprintf(stderr, ", %.2g of the light left\n", cleaned.light_left);
    fwrite(plane.pixels, 1, bytes, stdout);
  }
  if (code != OCISAC_OK) fail(ocisac_last_error());
  free(plane.pixels);
  ocisac_cleaner_destroy(cleaner);
  return code != OCISAC_OK ? 2 : 0;
}
