/* How far a long job is, on stderr; and an ear for Ctrl-C. */
#ifndef CHIARO_PROGRESS_H
#define CHIARO_PROGRESS_H

#include <signal.h>
#include <stdbool.h>
#include <time.h>

typedef struct Progress {
    const char *program;
    bool quiet, terminal;
    struct timespec start;
    double told;   /* seconds at the last bar */
    int told_tens; /* of percent, at the last line */
    sigset_t stop_signals, old_signals;
} Progress;

/* From here to progress_end() SIGINT and SIGTERM do not kill: progress_tell() hears them. Begin before other threads
 * do. With `quiet` nothing is printed. */
void progress_begin(Progress *progress, const char *program, bool quiet);

/* A bar on a terminal, a line every tenth elsewhere. False if somebody asked to stop. Takes a Progress. */
bool progress_tell(float done, void *user);

/* Clears the bar. Returns the seconds since the beginning. */
double progress_end(Progress *progress);

#endif
