/* How far a long job is. Signals are blocked and looked for, not handled: no handler, no global. */
#include "progress.h"

#include <stdio.h>
#include <unistd.h>

enum { BAR_WIDTH = 40 };

static double seconds_since(const struct timespec *start)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)(now.tv_sec - start->tv_sec) + 1e-9 * (double)(now.tv_nsec - start->tv_nsec);
}

void progress_begin(Progress *progress, const char *program, bool quiet)
{
    *progress = (Progress){.program = program, .quiet = quiet, .terminal = isatty(STDERR_FILENO) == 1};
    clock_gettime(CLOCK_MONOTONIC, &progress->start);
    sigemptyset(&progress->stop_signals);
    sigaddset(&progress->stop_signals, SIGINT);
    sigaddset(&progress->stop_signals, SIGTERM);
    pthread_sigmask(SIG_BLOCK, &progress->stop_signals, &progress->old_signals);
}

static void draw_bar(const Progress *progress, float done, double seconds)
{
    int filled = (int)(done * BAR_WIDTH);
    fprintf(stderr, "\r%s [", progress->program);
    for (int i = 0; i < BAR_WIDTH; i++)
        fputc(i < filled ? '#' : ' ', stderr);
    fprintf(stderr, "] %3.0f %%", (double)(100 * done));
    if (done > 0.02f)
        fprintf(stderr, "  %.0f s left ", seconds * (double)(1 - done) / (double)done);
    fflush(stderr);
}

bool progress_tell(float done, void *user)
{
    Progress *progress = user;
    double seconds = seconds_since(&progress->start);
    if (!progress->quiet && progress->terminal && seconds - progress->told > 0.1) {
        progress->told = seconds;
        draw_bar(progress, done, seconds);
    } else if (!progress->quiet && !progress->terminal && (int)(done * 10) > progress->told_tens) {
        progress->told_tens = (int)(done * 10);
        fprintf(stderr, "%s: %d %% after %.1f s\n", progress->program, 10 * progress->told_tens, seconds);
    }
    sigset_t pending;
    sigpending(&pending);
    return !sigismember(&pending, SIGINT) && !sigismember(&pending, SIGTERM);
}

double progress_end(Progress *progress)
{
    double seconds = seconds_since(&progress->start);
    if (!progress->quiet && progress->terminal && progress->told > 0)
        fputs("\r\033[K", stderr);
    /* What came in the meantime was heard; let it not kill now. */
    struct timespec at_once = {0, 0};
    while (sigtimedwait(&progress->stop_signals, NULL, &at_once) > 0)
        ;
    pthread_sigmask(SIG_SETMASK, &progress->old_signals, NULL);
    return seconds;
}
