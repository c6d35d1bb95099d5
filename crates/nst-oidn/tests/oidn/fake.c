/* A library with the functions of Open Image Denoise 2 that nst uses. It appends a line to the
   file LOG for each call, and says FAULT there for what the real one need not survive. Its filter
   returns 2 color + albedo + 10 normal; with the macro REACH, means over blocks of TILE_ALIGNMENT
   rows and a little of the REACH rows around each, times the mean colour if the scale is not set.

   Macros make it fail: FAIL is the name of a function that fails, at its call number FAIL_AT.
   HOW is what that means: 0, an error and no object; 1, no object and no error; 2, an error and
   an object; 3, an error without a message. */

#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#ifndef FAIL
#define FAIL ""
#endif
#ifndef FAIL_AT
#define FAIL_AT 1
#endif
#ifndef HOW
#define HOW 0
#endif
#ifndef VERSION
#define VERSION 20501
#endif
#ifndef TILE_ALIGNMENT
#define TILE_ALIGNMENT 16
#endif
#ifndef TILE_OVERLAP
#define TILE_OVERLAP 96
#endif
#ifndef TYPE
#define TYPE 1
#endif

static int error_code = 0;
static int failing_calls = 0;
static int last_id = 0;

static void say(const char *line) {
  FILE *file = fopen(LOG, "a");
  if (!file) abort();
  fprintf(file, "%s\n", line);
  fclose(file);
}

#define SAY(...)                                     \
  do {                                               \
    char line[256];                                  \
    snprintf(line, sizeof line, __VA_ARGS__);        \
    say(line);                                       \
  } while (0)

/* Whether a call of this function fails; it then leaves the error, unless an older one is there. */
static bool fails(const char *name) {
  if (strcmp(name, FAIL) != 0 || ++failing_calls != FAIL_AT) return false;
  if (HOW != 1 && error_code == 0) error_code = 4;
  return true;
}

/* Whether a function that fails returns an object all the same. */
static bool returns_object(const char *name) { return !fails(name) || HOW == 2; }

/* Objects are never freed, so that their use after the release is seen. */
typedef struct {
  char kind;
  int id;
  bool alive;
  bool committed;
  size_t bytes;
  float *values;
  float scale;
  struct Image {
    const char *name;
    float *values;
    size_t width, height;
  } images[4];
} Object;

static Object *new_object(char kind) {
  Object *object = calloc(1, sizeof(Object));
  object->kind = kind;
  object->id = ++last_id;
  object->alive = true;
  return object;
}

static int checked(const Object *object, char kind) {
  if (!object || object->kind != kind || !object->alive) {
    say("FAULT: not an object of this kind");
    return 0;
  }
  return object->id;
}

static void release(Object *object, const char *name, char kind) {
  SAY("%s %d", name, checked(object, kind));
  object->alive = false;
}

Object *oidnNewDevice(int type) {
  Object *device = returns_object("oidnNewDevice") ? new_object('d') : NULL;
  SAY("oidnNewDevice %d = %d", type, device ? device->id : 0);
  return device;
}

void oidnCommitDevice(Object *device) {
  SAY("oidnCommitDevice %d", checked(device, 'd'));
  device->committed = !fails("oidnCommitDevice");
}

int oidnGetDeviceInt(Object *device, const char *name) {
  SAY("oidnGetDeviceInt %d %s", checked(device, 'd'), name);
  if (fails("oidnGetDeviceInt")) return 0;
  if (strcmp(name, "version") == 0) return VERSION;
  if (strcmp(name, "type") == 0) return TYPE;
  say("FAULT: unknown parameter");
  return 0;
}

/* Not in the log: it may be called at any time. */
int oidnGetDeviceError(Object *device, const char **message) {
  if (device) checked(device, 'd');
  const int code = error_code;
  error_code = 0;
  *message = HOW == 3 ? NULL : code ? "it fell on the floor" : "";
  return code;
}

void oidnReleaseDevice(Object *device) { release(device, "oidnReleaseDevice", 'd'); }

Object *oidnNewBuffer(Object *device, size_t bytes) {
  const int id = checked(device, 'd');
  if (!device->committed) say("FAULT: the device is not committed");
  Object *buffer = NULL;
  if (returns_object("oidnNewBuffer")) {
    buffer = new_object('b');
    buffer->bytes = bytes;
    buffer->values = malloc(bytes);
    /* What is not written differs from zero. */
    for (size_t i = 0; i < bytes / sizeof(float); i++) buffer->values[i] = NAN;
  }
  SAY("oidnNewBuffer %d %zu = %d", id, bytes, buffer ? buffer->id : 0);
  return buffer;
}

void oidnWriteBuffer(Object *buffer, size_t offset, size_t bytes, const void *values) {
  SAY("oidnWriteBuffer %d %zu %zu", checked(buffer, 'b'), offset, bytes);
  if (offset + bytes > buffer->bytes) say("FAULT: more than the buffer");
  else if (!fails("oidnWriteBuffer")) memcpy((char *)buffer->values + offset, values, bytes);
}

void oidnReadBuffer(Object *buffer, size_t offset, size_t bytes, void *values) {
  SAY("oidnReadBuffer %d %zu %zu", checked(buffer, 'b'), offset, bytes);
  if (offset + bytes > buffer->bytes) say("FAULT: more than the buffer");
  else if (!fails("oidnReadBuffer")) memcpy(values, (char *)buffer->values + offset, bytes);
}

void oidnReleaseBuffer(Object *buffer) { release(buffer, "oidnReleaseBuffer", 'b'); }

Object *oidnNewFilter(Object *device, const char *type) {
  const int id = checked(device, 'd');
  if (!device->committed) say("FAULT: the device is not committed");
  Object *filter = returns_object("oidnNewFilter") ? new_object('f') : NULL;
  SAY("oidnNewFilter %d %s = %d", id, type, filter ? filter->id : 0);
  return filter;
}

static const char *const NAMES[4] = {"color", "albedo", "normal", "output"};

void oidnSetFilterImage(Object *filter, const char *name, Object *buffer, int format, size_t width,
                        size_t height, size_t offset, size_t pixel_stride, size_t row_stride) {
  SAY("oidnSetFilterImage %d %s %d format %d, %zu x %zu, %zu %zu %zu", checked(filter, 'f'), name,
      checked(buffer, 'b'), format, width, height, offset, pixel_stride, row_stride);
  if (fails("oidnSetFilterImage")) return;
  if (format != 3 || offset + 12 * width * height > buffer->bytes) say("FAULT: not in the buffer");
  for (int i = 0; i < 4; i++)
    if (strcmp(NAMES[i], name) == 0)
      filter->images[i] = (struct Image){NAMES[i], buffer->values, width, height};
}

void oidnSetFilterBool(Object *filter, const char *name, bool value) {
  SAY("oidnSetFilterBool %d %s %d", checked(filter, 'f'), name, value);
  fails("oidnSetFilterBool");
}

void oidnSetFilterInt(Object *filter, const char *name, int value) {
  SAY("oidnSetFilterInt %d %s %d", checked(filter, 'f'), name, value);
  fails("oidnSetFilterInt");
}

void oidnSetFilterFloat(Object *filter, const char *name, float value) {
  SAY("oidnSetFilterFloat %d %s %g", checked(filter, 'f'), name, value);
  if (!fails("oidnSetFilterFloat") && strcmp(name, "inputScale") == 0) filter->scale = value;
}

int oidnGetFilterInt(Object *filter, const char *name) {
  SAY("oidnGetFilterInt %d %s", checked(filter, 'f'), name);
  if (!filter->committed) say("FAULT: the filter is not committed");
  if (fails("oidnGetFilterInt")) return 0;
  if (strcmp(name, "tileAlignment") == 0) return TILE_ALIGNMENT;
  if (strcmp(name, "tileOverlap") == 0) return TILE_OVERLAP;
  say("FAULT: unknown parameter");
  return 0;
}

void oidnCommitFilter(Object *filter) {
  SAY("oidnCommitFilter %d", checked(filter, 'f'));
  if (!filter->images[0].values || !filter->images[3].values) say("FAULT: an image is missing");
  filter->committed = !fails("oidnCommitFilter");
}

void oidnExecuteFilter(Object *filter) {
  SAY("oidnExecuteFilter %d", checked(filter, 'f'));
  if (!filter->committed) say("FAULT: the filter is not committed");
  if (fails("oidnExecuteFilter")) return;
  const float factors[3] = {2, 1, 10};
  const struct Image output = filter->images[3];
  for (size_t i = 0; i < 3 * output.width * output.height; i++) {
    output.values[i] = 0;
    for (int k = 0; k < 3; k++)
      if (filter->images[k].values) output.values[i] += factors[k] * filter->images[k].values[i];
#ifdef REACH
    const size_t row = 3 * output.width, y = i / row, block = y / TILE_ALIGNMENT * TILE_ALIGNMENT;
    const size_t end = block + TILE_ALIGNMENT + REACH, last = output.height;
    float near = 0, rows = 0, far = 0, mean = 0;
    for (size_t k = block > REACH ? block - REACH : 0; k < (end < last ? end : last); k++) {
      const float value = filter->images[0].values[k * row + i % row];
      const bool is_near = block <= k && k < block + TILE_ALIGNMENT;
      near += is_near ? value : 0;
      rows += is_near ? 1 : 0;
      far += value;
    }
    for (size_t k = 0; filter->scale == 0 && k < row * last; k++)
      mean += filter->images[0].values[k] / (row * last);
    output.values[i] = (near / rows + 0.0001f * far) * (filter->scale == 0 ? mean : 1);
#endif
#ifdef RUBBISH
    if (i % 5 == 1) output.values[i] = NAN;
#endif
  }
}

void oidnReleaseFilter(Object *filter) { release(filter, "oidnReleaseFilter", 'f'); }

#ifdef CRASH
__attribute__((constructor)) static void crash(void) { abort(); }
#endif
