/* Payloads of a light out of raw 8-bit grey frames on standard input:
 *
 *   ffmpeg -i lamp.mkv -f rawvideo -pix_fmt gray - | receive 1920 1080 22.2e-6 12000 30
 *
 * arguments: width, height, row time (s), chip rate (Hz), frames per second
 */
#include <ocisac/ocisac.h>
#include <stdio.h>
#include <stdlib.h>

static int fail(const char* what) {
  fprintf(stderr, "receive: %s\n", what);
  return 2;
}

int main(int count, char** arguments) {
  if (count != 6) return fail("arguments: width height row_time chip_rate frame_rate");
  ocisac_frame frame = {0};
  frame.width = (uint32_t)strtoul(arguments[1], NULL, 10);
  frame.height = (uint32_t)strtoul(arguments[2], NULL, 10);
  frame.stride = (ptrdiff_t)frame.width;
  frame.format = OCISAC_GRAY8;

  ocisac_options options;
  ocisac_options_init(&options);
  options.row_time = atof(arguments[3]);
  options.chip_rate = atof(arguments[4]);
  options.frame_time = 1 / atof(arguments[5]);
  options.want_gain = 0;
  ocisac_receiver* receiver;
  if (ocisac_create(&options, &receiver) != OCISAC_OK) return fail(ocisac_last_error());

  const size_t bytes = (size_t)frame.width * frame.height;
  unsigned char* pixels = malloc(bytes > 0 ? bytes : 1);
  if (pixels == NULL) return fail("out of memory");
  frame.pixels = pixels;
  int code = OCISAC_OK;
  while (code >= 0 && bytes > 0 && fread(pixels, 1, bytes, stdin) == bytes) {
    code = ocisac_push(receiver, &frame);
    ++frame.number;
    ocisac_result result;
    ocisac_result_init(&result);
    while (code >= 0 && (code = ocisac_poll(receiver, &result)) == OCISAC_OK) {
      fprintf(stderr, "frame %ld: %zu bits\n", (long)result.frame, result.bit_count);
      if (result.payload != NULL) fwrite(result.payload, 1, result.payload_bytes, stdout);
    }
  }
  if (code < 0) fail(ocisac_last_error());
  free(pixels);
  ocisac_destroy(receiver);
  return code < 0 ? 2 : 0;
}
