// Cost of a frame for a simulator that does not wait: begin, write and publish, compared with
// writing the same array to memory of its own. Prints medians and their ratio.
//
//     cost [SERVICE]      with `linkwatch watch --service SERVICE` beside it, or without

#define _POSIX_C_SOURCE 200809L
#include <linkwatch.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

enum { RINGS = 14112, POINTS = 15, NUMBERS = 3 * RINGS * POINTS, ROUNDS = 400 };

static double microseconds(void) {
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return 1e6 * (double)t.tv_sec + 1e-3 * (double)t.tv_nsec;
}

static int ascending(const void *a, const void *b) {
  const double x = *(const double *)a, y = *(const double *)b;
  return (x > y) - (x < y);
}

int main(int argc, char **argv) {
  static int32_t counts[RINGS];
  static float from[NUMBERS], own[2][NUMBERS];
  static double copied[ROUNDS], published[ROUNDS];
  for (int k = 0; k < RINGS; k++) counts[k] = -POINTS;
  // Rings apart from one another, because a watcher has much work with a tangle.
  for (int p = 0; p < RINGS * POINTS; p++) {
    const int ring = p / POINTS, k = p % POINTS;
    from[3 * p] = (float)(2 * (ring % 119)) + (k < POINTS / 2 ? 0.1F : 0.2F) * (float)k;
    from[3 * p + 1] = (float)(2 * (ring / 119)) + 0.1F * (float)(k % 3);
    from[3 * p + 2] = 0.01F * (float)(k * k);
  }

  lw_client *client = lw_open(argc > 1 ? argv[1] : "cost", NULL);
  if (!client || lw_describe(client, LW_POLYLINE, LW_FLOAT, counts, RINGS) != LW_OK) {
    fprintf(stderr, "error: %s\n", lw_last_error());
    return 2;
  }
  if (argc > 1) lw_wait_for_watcher(client, 10);
  for (int k = 0; k < ROUNDS; k++) {
    const double start = microseconds();
    memcpy(own[k % 2], from, sizeof from);
    const double middle = microseconds();
    float *points = lw_begin_float(client, k);
    if (!points) return fprintf(stderr, "error: %s\n", lw_last_error()), 2;
    memcpy(points, from, sizeof from);
    lw_publish(client, NULL);
    copied[k] = middle - start;
    published[k] = microseconds() - middle;
  }
  lw_finish(client, 10 * (argc > 1), NULL);
  qsort(copied, ROUNDS, sizeof *copied, ascending);
  qsort(published, ROUNDS, sizeof *published, ascending);
  const double copy = copied[ROUNDS / 2], publish = published[ROUNDS / 2];
  printf("%d coordinates: own memory %.1f us, begin, write and publish %.1f us: %.3f times\n",
         NUMBERS, copy, publish, publish / copy);
  return 0;
}
