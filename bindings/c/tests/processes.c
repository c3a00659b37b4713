// Simulators and watchers that are killed, interrupted and restarted, as separate processes.
//
//     processes LINKWATCH FOLDER
//
// LINKWATCH is the command that watches; its output goes to files in FOLDER. The program is the
// simulator, and starts itself as a second one. Exit codes: 0 passed, 1 failed.

#define _POSIX_C_SOURCE 200809L

#include <errno.h>
#include <fcntl.h>
#include <linkwatch.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

// Time limit in seconds of a wait that ends much earlier unless something failed.
static const double PATIENCE = 60;
#define PATIENCE_TEXT "60"

static const char *linkwatch, *folder, *self;
static char service[64], log_path[4096], text[1 << 14];
static pid_t watcher, other;

static void pause_for(double seconds) {
  const struct timespec time = {(time_t)seconds, (long)(fmod(seconds, 1) * 1e9)};
  nanosleep(&time, NULL);
}

// Returns the text of a file.
static const char *read_file(const char *path) {
  FILE *file = fopen(path, "r");
  const size_t length = file ? fread(text, 1, sizeof text - 1, file) : 0;
  if (file) fclose(file);
  text[length] = 0;
  return text;
}

// Returns the output of the watch.
static const char *output(void) { return read_file(log_path); }

// Sends SIGKILL, and waits until the process has ended.
static void stop(pid_t *process) {
  if (*process > 0) {
    kill(*process, SIGKILL);
    waitpid(*process, NULL, 0);
  }
  *process = 0;
}

static void fail(int line, const char *what) {
  fprintf(stderr, "%s:%d: failed: %s\n", __FILE__, line, what);
  fprintf(stderr, "last error: %s\noutput of the watch:\n%s", lw_last_error(), output());
  stop(&watcher);
  stop(&other);
  exit(1);
}

#define CHECK(condition) ((condition) ? (void)0 : fail(__LINE__, #condition))
#define CHECK_TEXT(all, part) (strstr(all, part) ? (void)0 : fail(__LINE__, all))
#define CHECK_ERROR(part) CHECK_TEXT(lw_last_error(), part)

// Starts a program with its output in a file, or in none.
static pid_t start(char *const *args, const char *out) {
  const pid_t child = fork();
  CHECK(child >= 0);
  if (child > 0) return child;
  const int file = open(out ? out : "/dev/null", O_WRONLY | O_CREAT | O_TRUNC, 0600);
  if (file >= 0 && dup2(file, 1) >= 0 && dup2(file, 2) >= 0) execv(args[0], args);
  _exit(127);
}

// Starts a watch of a service that no other test uses. It ends if no simulator comes.
static void watch(const char *name, const char *option) {
  snprintf(service, sizeof service, "linkwatch-c-%ld-%s", (long)getpid(), name);
  snprintf(log_path, sizeof log_path, "%s/%s.txt", folder, name);
  char *const args[] = {(char *)linkwatch, "watch", "--service", service, "--wait", PATIENCE_TEXT,
                        (char *)option, "--motion-limit=5", NULL};
  watcher = start(args, log_path);
}

// Waits until a process has ended, and returns its exit code.
static int end(pid_t *process) {
  int status;
  for (double waited = 0; waited < PATIENCE; waited += 0.01) {
    const pid_t ended = waitpid(*process, &status, WNOHANG);
    CHECK(ended >= 0 || errno == EINTR);
    if (ended > 0) {
      *process = 0;
      return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
    }
    pause_for(0.01);
  }
  fail(__LINE__, "the process ends in time");
  return -1;
}

static lw_client *simulator(void) {
  const lw_options options = {.lockstep = true};
  const int32_t counts[] = {-4, -4};
  lw_client *client = lw_open(service, &options);
  CHECK(client);
  CHECK(lw_describe(client, LW_POLYLINE, LW_FLOAT, counts, 2) == LW_OK);
  return client;
}

static lw_client *watched_simulator(void) {
  lw_client *client = simulator();
  CHECK(lw_wait_for_watcher(client, PATIENCE) == LW_OK);
  return client;
}

static const float SQUARES[] = {-1, -1, 0,  1, -1, 0,  1, 1, 0, -1, 1, 0,
                                0,  0,  -1, 2, 0,  -1, 2, 0, 1, 0,  0, 1};

// Publishes two squares, linked up to a shift of 1, and returns the number of the frame.
static uint64_t publish(lw_client *client, double shift) {
  float *points = lw_begin_float(client, 0);
  CHECK(points);
  memcpy(points, SQUARES, sizeof SQUARES);
  for (int k = 12; k < 24; k += 3) points[k] += (float)shift;
  uint64_t seq;
  CHECK(lw_publish(client, &seq) == LW_OK);
  return seq;
}

// Publishes a frame, and returns the verdict on it.
static lw_verdict step(lw_client *client, double shift) {
  lw_verdict verdict;
  CHECK(lw_wait(client, publish(client, shift), PATIENCE, &verdict) == LW_OK);
  return verdict;
}

// Ends the session and the watch, which returns `code`. Returns the last message.
static lw_verdict finish(lw_client *client, int code) {
  lw_verdict last;
  CHECK(lw_finish(client, PATIENCE, &last) == LW_OK);
  CHECK(end(&watcher) == code);
  return last;
}

// Publishes frames without a verdict: each wait ends because the watcher left in this way.
static void not_verified(lw_client *client, int frames, const char *how) {
  for (int k = 0; k < frames; k++) {
    lw_verdict verdict;
    char words[128];
    const uint64_t seq = publish(client, 0);
    snprintf(words, sizeof words, "no verdict on frame %llu: %s", (unsigned long long)seq, how);
    CHECK(lw_wait(client, seq, PATIENCE, &verdict) == LW_NO_WATCHER);
    CHECK(strcmp(lw_last_error(), words) == 0);
    CHECK(verdict.verdict == LW_NOT_VERIFIED);
    CHECK(lw_silent_for(client) < 0);
  }
}

static void a_watcher_killed_during_a_lockstep_wait_ends_the_wait(void) {
  watch("killed", NULL);
  lw_client *client = watched_simulator();
  CHECK(step(client, 0).verdict == LW_INTACT);
  int status;
  CHECK(kill(watcher, SIGSTOP) == 0);
  CHECK(waitpid(watcher, &status, WUNTRACED) == watcher && WIFSTOPPED(status));
  char command[64];
  snprintf(command, sizeof command, "sleep 0.3; kill -KILL %ld", (long)watcher);
  char *const killer[] = {"/bin/sh", "-c", command, NULL};
  other = start(killer, NULL);
  not_verified(client, 3, "the watcher died without a goodbye");
  CHECK(end(&other) == 0);
  CHECK(end(&watcher) == 128 + SIGKILL);
  // Another watcher takes over, with the next frame as its baseline.
  watch("killed", NULL);
  CHECK(lw_wait_for_watcher(client, PATIENCE) == LW_OK);
  CHECK(step(client, 0).verdict == LW_INTACT);
  CHECK_TEXT(finish(client, 0).text, "linkwatch is done with this session");
}

static void a_watcher_that_is_interrupted_says_goodbye(void) {
  watch("interrupted", NULL);
  lw_client *client = watched_simulator();
  for (int k = 0; k < 3; k++) CHECK(step(client, 0).verdict == LW_INTACT);
  CHECK(kill(watcher, SIGINT) == 0);
  CHECK(end(&watcher) == 0);
  CHECK_TEXT(output(), "stopped by a signal");
  CHECK_TEXT(output(), "3 frames verified");
  not_verified(client, 3, "the watcher said goodbye");
  CHECK(lw_finish(client, PATIENCE, NULL) == LW_NOTHING);
}

// Publishes frames until it is killed, or for about a minute.
static int simulate(const char *name) {
  snprintf(service, sizeof service, "%s", name);
  lw_client *client = watched_simulator();
  for (int frame = 0; frame < 20; frame++) CHECK(step(client, 0).verdict == LW_INTACT);
  puts("20 frames are intact");
  fflush(stdout);
  for (int frame = 0; frame < 30000; frame++) {
    publish(client, 0);
    pause_for(0.002);
  }
  lw_close(client);
  return 0;
}

static void a_killed_simulator_ends_the_watch_and_frees_the_name(void) {
  watch("lost", NULL);
  char *const args[] = {(char *)self, "--simulate", service, NULL};
  char progress[sizeof log_path];
  snprintf(progress, sizeof progress, "%s/simulator.txt", folder);
  remove(progress); // of an earlier run
  other = start(args, progress);
  for (double waited = 0; !strstr(read_file(progress), "intact"); waited += 0.01) {
    CHECK(waited < PATIENCE);
    pause_for(0.01);
  }
  char words[256];
  snprintf(words, sizeof words, "service \"%s\" already has a simulator (process %ld, ", service,
           (long)other);
  CHECK(!lw_open(service, NULL));
  CHECK_ERROR(words);
  CHECK_ERROR("give one of the two another service name");
  stop(&other);
  CHECK(end(&watcher) == 3);
  CHECK_TEXT(output(), "the simulator died without ending the session");

  watch("lost", NULL);
  lw_client *client = watched_simulator();
  CHECK(step(client, 0).verdict == LW_INTACT);
  finish(client, 0);
}

static void a_frame_with_nan_is_rejected_with_its_curve_and_point(void) {
  watch("nan", NULL);
  lw_client *client = watched_simulator();
  CHECK(step(client, 0).verdict == LW_INTACT);
  const lw_verdict verdict = step(client, NAN);
  CHECK(verdict.verdict == LW_REJECTED);
  CHECK(verdict.abort && lw_aborted(client, NULL));
  CHECK(verdict.last_intact == 0);
  CHECK(strcmp(verdict.text, "frame 1: rejected: curve 1, point 0: coordinate x is NaN. "
                             "Stop or roll back: frame 0 is intact") == 0);
  CHECK(lw_resume(client) == LW_OK);
  CHECK(!lw_aborted(client, NULL));
  CHECK(step(client, 0).verdict == LW_INTACT);
  const lw_verdict last = finish(client, 0);
  CHECK(last.frames_verified == 2 && last.frames_rejected == 1);
  CHECK(last.recovered == 1 && !last.abort);
}

static void a_pull_through_is_aborted_once_if_the_simulator_rolls_back(void) {
  watch("rolled-back", "--events");
  lw_client *client = watched_simulator();
  // One square passes through the other one, which no linking number detects.
  static const double SHIFTS[] = {3, 3, 3.001, -5, 3, 3.001, 2.9};
  for (uint64_t frame = 0; frame < 7; frame++) {
    const lw_verdict verdict = step(client, SHIFTS[frame]);
    CHECK(verdict.verdict == (frame == 3 ? LW_CHANGED : LW_INTACT));
    CHECK(verdict.abort == (frame == 3));
    if (frame != 3) continue;
    CHECK(verdict.finding == LW_FINDING_PULL_THROUGH && verdict.pull_throughs == 4);
    CHECK(verdict.i == 0 && verdict.j == 1 && verdict.has_place);
    CHECK(verdict.last_intact == 2);
    CHECK(verdict.safe_fraction > 0 && verdict.safe_fraction < 1);
    CHECK_TEXT(verdict.text, "Stop or roll back: frame 2 is intact, and ");
    CHECK(lw_resume(client) == LW_OK);
  }
  // A jump after a cut is not a pull-through.
  CHECK(lw_cut(client) == LW_OK);
  CHECK(step(client, -5).verdict == LW_INTACT);
  CHECK(!lw_aborted(client, NULL));
  const lw_verdict last = finish(client, 0);
  CHECK(last.frames_verified == 8);
  CHECK(last.recovered == 1 && !last.abort);
  CHECK_TEXT(last.text, "recovered: 1 violation was rolled back");
  CHECK_TEXT(output(), "first violation: frame 3");
}

static void an_accepted_state_is_the_new_baseline(void) {
  watch("accepted", NULL);
  lw_client *client = watched_simulator();
  CHECK(step(client, 0).verdict == LW_INTACT);
  const lw_verdict changed = step(client, 2.5);
  CHECK(changed.verdict == LW_CHANGED && changed.findings == 2);
  CHECK(lw_accept(client) == LW_OK);
  CHECK(!lw_aborted(client, NULL));
  CHECK(step(client, 2.5).verdict == LW_INTACT);
  CHECK(step(client, 0).verdict == LW_CHANGED);
  finish(client, 1);
}

static void a_link_across_the_boundary_of_a_cell_is_lost_with_its_image(void) {
  watch("cell", "--events");
  lw_client *client = watched_simulator();
  double vectors[9] = {10, 0, 0, 0, 10, 0, 0, 0, 0};
  const double corner[3] = {-5, -5, 0};
  CHECK(lw_set_cell(client, vectors, corner) == LW_OK);
  CHECK(step(client, 9.5).verdict == LW_INTACT);
  vectors[0] = 10.5;
  CHECK(lw_set_cell(client, vectors, corner) == LW_OK);
  CHECK(step(client, 10).verdict == LW_INTACT);
  const lw_verdict verdict = step(client, 5);
  CHECK(verdict.verdict == LW_CHANGED && verdict.lost == 1);
  CHECK(verdict.i == 0 && verdict.j == 1);
  CHECK(verdict.image[0] == -1 && verdict.image[1] == 0 && verdict.image[2] == 0);
  CHECK_TEXT(verdict.text, "curve 0 and the image -1,0,0 of curve 1 came apart");
  // All frames of a session have a cell.
  CHECK(lw_set_cell(client, NULL, NULL) == LW_OK);
  CHECK(step(client, 9.5).verdict == LW_REJECTED);
  finish(client, 1);
}

static void a_forked_child_gets_errors_and_leaves_the_session_of_its_parent_alone(void) {
  watch("fork", NULL);
  lw_client *client = watched_simulator();
  CHECK(step(client, 0).verdict == LW_INTACT);
  const int32_t counts[] = {-4, -4};
  const lw_frame frame = {LW_POLYLINE, LW_FLOAT, 2, counts, SQUARES};
  lw_session *session = lw_session_new(NULL);
  lw_verdict verdict;
  CHECK(lw_session_step(session, &frame, 0, &verdict) == LW_OK);
  other = fork();
  CHECK(other >= 0);
  if (other == 0) {
    watcher = 0; // is that of the parent
    CHECK(!lw_begin_float(client, 0));
    CHECK_ERROR("this process was forked");
    CHECK(lw_session_step(session, &frame, 0, &verdict) == LW_ERROR);
    CHECK_ERROR("this process was forked");
    CHECK(!lw_certify(&frame, NULL));
    CHECK_ERROR("this process was forked");
    lw_close(client);
    lw_session_free(session);
    exit(0);
  }
  CHECK(end(&other) == 0);
  CHECK(step(client, 0).verdict == LW_INTACT);
  lw_session_free(session);
  finish(client, 0);
}

int main(int argc, char **argv) {
  if (argc == 3 && strcmp(argv[1], "--simulate") == 0) return simulate(argv[2]);
  if (argc != 3) return fprintf(stderr, "usage: %s LINKWATCH FOLDER\n", argv[0]), 1;
  self = argv[0];
  linkwatch = argv[1];
  folder = argv[2];
  a_watcher_killed_during_a_lockstep_wait_ends_the_wait();
  a_watcher_that_is_interrupted_says_goodbye();
  a_killed_simulator_ends_the_watch_and_frees_the_name();
  a_frame_with_nan_is_rejected_with_its_curve_and_point();
  a_pull_through_is_aborted_once_if_the_simulator_rolls_back();
  an_accepted_state_is_the_new_baseline();
  a_link_across_the_boundary_of_a_cell_is_lost_with_its_image();
  a_forked_child_gets_errors_and_leaves_the_session_of_its_parent_alone();
  puts("8 tests passed");
  return 0;
}
