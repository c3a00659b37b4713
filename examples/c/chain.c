// A chain of 32 rings that hangs from the first one and is pulled at the last one, watched live.
//
//     linkwatch watch --service chain     in one terminal
//     chain chain 0.02                             in another one: every link is intact
//     chain chain 0.2                              a step that is too large: the chain breaks
//     chain chain 0.2 --roll-back                  goes on with smaller steps, and stays intact
//
// Neighbours are rigid rings in orthogonal planes. They are linked as long as their centres are
// nearer than a diameter. A spring keeps them apart once they touch. It is unstable if the step is
// too large. Exit codes: 0 intact, 1 broken, 2 an error.

#include <linkwatch.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { RINGS = 32, POINTS = 24, FRAMES = 300 };
static const double CONTACT = 1.6, STIFFNESS = 100, FORCE = 8, DAMPING = 1;

// Centres of the rings along the chain, and their velocities.
struct chain { double x[RINGS], v[RINGS]; };

// Moves the rings by one step of `dt` seconds.
static void step(struct chain *c, double dt) {
  double force[RINGS] = {0};
  for (int k = 1; k < RINGS; k++) {
    const double stretch = c->x[k] - c->x[k - 1] - CONTACT;
    const double spring = stretch > 0 ? STIFFNESS * stretch : 0;
    force[k] -= spring;
    force[k - 1] += spring;
  }
  force[RINGS - 1] += FORCE;
  for (int k = 1; k < RINGS; k++) {
    c->v[k] += dt * (force[k] - DAMPING * c->v[k]);
    c->x[k] += dt * c->v[k];
  }
}

// Writes the points of all rings.
static void write_points(const struct chain *c, float *to) {
  for (int k = 0; k < RINGS; k++) {
    for (int p = 0; p < POINTS; p++) {
      const double angle = 2 * acos(-1) * (p + 0.5 * (k % 2)) / POINTS;
      *to++ = (float)(c->x[k] + cos(angle));
      *to++ = k % 2 == 0 ? (float)sin(angle) : 0;
      *to++ = k % 2 == 0 ? 0 : (float)sin(angle);
    }
  }
}

static int fail(void) {
  fprintf(stderr, "error: %s\n", lw_last_error());
  return 2;
}

int main(int argc, char **argv) {
  if (argc < 3) {
    fprintf(stderr, "usage: %s SERVICE STEP [--roll-back]\n", argv[0]);
    return 2;
  }
  double dt = atof(argv[2]);
  const int roll_back = argc > 3 && strcmp(argv[3], "--roll-back") == 0;
  struct chain chain = {{0}, {0}}, last;
  for (int k = 0; k < RINGS; k++) chain.x[k] = 1.5 * k;

  int32_t counts[RINGS];
  for (int k = 0; k < RINGS; k++) counts[k] = -POINTS; // negative: closed
  const lw_options options = {.lockstep = true};
  lw_client *client = lw_open(argv[1], &options);
  if (!client) return fail();
  if (lw_describe(client, LW_POLYLINE, LW_FLOAT, counts, RINGS) != LW_OK) return fail();
  const lw_status came = lw_wait_for_watcher(client, 10);
  if (came == LW_ERROR) return fail();
  if (came == LW_NOTHING) fprintf(stderr, "no watcher came in time\n");

  double time = 0;
  int move = 0; // the first frame, and the one after a roll back, are published without a step
  for (int frame = 0; frame < FRAMES; frame++) {
    last = chain;
    if (move) {
      step(&chain, dt);
      time += dt;
    }
    move = 1;
    float *points = lw_begin_float(client, time);
    if (!points) return fail();
    write_points(&chain, points);
    uint64_t seq;
    lw_verdict verdict;
    if (lw_publish(client, &seq) != LW_OK) return fail();
    if (lw_wait(client, seq, 10, &verdict) != LW_OK) {
      const int failed = fail();
      lw_close(client);
      return failed;
    }
    if (verdict.verdict == LW_INTACT) continue;
    printf("%s\n", verdict.text);
    if (!roll_back || dt < 1e-4) {
      lw_finish(client, 10, NULL);
      return 1;
    }
    // Two rings almost touch at the safe fraction, so the chain goes on from half of it.
    const double fraction = verdict.safe_fraction > 0 ? 0.5 * verdict.safe_fraction : 0;
    for (int k = 0; k < RINGS; k++) {
      chain.x[k] = last.x[k] + fraction * (chain.x[k] - last.x[k]);
      chain.v[k] = 0;
    }
    time -= (1 - fraction) * dt;
    dt /= 4;
    printf("rolled back; the step is now %g seconds\n", dt);
    lw_resume(client);
    move = 0;
  }
  lw_verdict end;
  const lw_status status = lw_finish(client, 10, &end);
  if (status == LW_OK) printf("%s\n", end.text);
  printf("every link is intact\n");
  return status == LW_ERROR ? fail() : 0;
}
