/* A report: error against run time of a scene, and of what it could be replaced by.
 *
 *   report_scene.c      truth, bakes, pictures and times of one scene; the sweep
 *   report_objects.c    objects: their cubes, neighbours and elements; what each idea does for them
 *   report_motion.c     lights and objects that move under a budget, each frame against the truth of that frame
 *   report_baselines.c  what engines do instead, and the article taken literally
 *   report_lamps.c      lamps where nobody hung one
 *   report_claims.c     what the README claims
 *   report_scaling.c    how cost grows
 *   report_write.c      report.csv, report.json, the table and the choice for a budget
 *   report_html.c       index.html, with its plots
 */
#ifndef CHIARO_REPORT_H
#define CHIARO_REPORT_H

#include "../../src/io/io.h"
#include "../../src/offline/parallel.h"
#include "../../src/offline/rays.h"
#include "../../src/reference/reference.h"
#include "chiaro/chiaro_bake.h"
#include "metrics.h"
#include "options.h"
#include "progress.h"

#include <stdio.h>

enum { REPORT_TEXT = 96, REPORT_POINTS = 48, REPORT_TASKS = 5, REPORT_SERIES = 16, REPORT_VALUES = 32, REPORT_CAUSES = 8,
       REPORT_PICTURES = 12, REPORT_PATH = 1024, REPORT_SPEEDS = 2, REPORT_BUDGETS = 5,
       REPORT_PASSES = 8, REPORT_LAMPS = 2 };

typedef struct ReportTiming {
    double median, p95; /* ms; negative: not measured */
} ReportTiming;

/* One choice of settings, or one baseline. Numbers that do not apply are NAN. */
typedef struct ReportPoint {
    char group[REPORT_TEXT], name[REPORT_TEXT];
    uint32_t links, samples, receivers; /* as they came out; 0: does not apply */
    uint32_t asked_samples, asked_receivers, asked_rays; /* of the baker; 0: its default */
    double bake_s, bytes;
    ReportTiming frame, update; /* on the device: a frame with moving lights, and what update() recorded of it */
    double cpu_ms[REPORT_TASKS]; /* the same update on one core: light on samples, means, gather to them, means, gather
                                    to receivers */
    Metrics indirect, full;
    Metrics objects; /* indirect, of the pixels that show an object */
    double rest;     /* relRMSE of indirect once nothing moves any more: of those pixels; in motion, of all */
    double changed;  /* relRMSE of its picture against the default's at rest; in motion, against what is not late */
    double age;      /* of what is shown, frames */
    uint32_t asked_cubes, asked_edge, asked_format; /* of objects */
    bool chosen, front, baseline;
} ReportPoint;

/* A curve: y over x. Several in one plot are told apart by their names. */
typedef struct ReportSeries {
    char name[REPORT_TEXT], title[REPORT_TEXT], x_label[REPORT_TEXT], y_label[REPORT_TEXT], note[2 * REPORT_TEXT];
    double x[REPORT_VALUES], y[REPORT_VALUES];
    uint32_t count;
    double exponent; /* y ~ x^exponent; NAN: not fitted */
} ReportSeries;

typedef struct ReportCause {
    char name[REPORT_TEXT];
    double relrmse;
} ReportCause;

/* What the README says, with a key behind it in brackets. */
typedef struct ReportClaim {
    const char *key, *says, *unit;
    double claimed, slack; /* NAN: no figure is claimed */
} ReportClaim;

enum { CLAIM_PLUGIN, CLAIM_LINES_DRAW, CLAIM_LINES_LIGHT, CLAIM_DARK, CLAIM_IDLE, CLAIM_AGE, CLAIM_CROWD, CLAIM_FAR,
       CLAIM_WHITE, CLAIM_SUN, CLAIM_LAMPS, REPORT_CLAIMS };

/* Errors of lamps one by one: relRMSE of indirect light where each shines. */
typedef struct ReportLamps {
    const char *name;
    uint32_t count;
    double median, worst, mean_ratio;
} ReportLamps;

typedef struct ReportPicture {
    char title[REPORT_TEXT];
    ChiaroIoImage image; /* ready to be shown: 0 .. 1, tone mapped */
} ReportPicture;

typedef struct ReportScene {
    const char *input;
    ChiaroIoScene read;
    ChiaroCamera camera;
    ChiaroLight *lights;
    uint32_t light_count;
    ChiaroIoImage truth[CHIARO_COMPONENT_COUNT];
    double noise[CHIARO_COMPONENT_COUNT];
    ReportPoint points[REPORT_POINTS];
    uint32_t point_count, cause_count, picture_count;
    ReportCause causes[REPORT_CAUSES];
    ReportPicture pictures[REPORT_PICTURES];
    float exposure; /* of all of them, stops */
    uint32_t object_count, motion_count;
    ReportPoint objects[REPORT_POINTS]; /* settings for objects, and last of them what costs nothing */
    ReportPoint motion[REPORT_SPEEDS * REPORT_BUDGETS];
    double moment_noise, motion_noise;     /* of their truths, at most */
    double object_noise;                   /* of the pixels that show an object, at most */
    ReportSeries budgets[REPORT_SPEEDS];   /* error against the part of all work that a frame may do, for each speed */
    ReportSeries frames[REPORT_BUDGETS];   /* error frame by frame, at the greatest speed */
    ReportLamps lamps[REPORT_LAMPS];
} ReportScene;

typedef struct Report {
    SceneOptions options;
    const char *folder, *device_name; /* NULL: any device */
    bool quick, sweep, scaling;
    double suggest_ms; /* 0: not asked for */
    ChiaroSky sky;
    ReportScene *scenes;
    uint32_t scene_count, series_count;
    ReportSeries series[REPORT_SERIES];
    double measured[REPORT_CLAIMS]; /* of the README; NAN: not measured here */
    char device[256];
} Report;

/* --- report_steps.c --- */
double report_now(void);       /* s */
double report_core_time(void); /* s that this thread had a core: what else the machine does is not in it */
/* A long job with its bar. SIGINT is heard by report_continue() and by what bakes and traces, and ends the program with one
 * line; files that are there stay as they are. */
typedef struct ReportStep {
    const Report *report;
    char name[2 * REPORT_TEXT];
    Progress progress;
} ReportStep;
void report_begin(const Report *report, const char *name, ReportStep *step);
/* `done`: 0 .. 1. */
void report_continue(ReportStep *step, double done);
uint32_t report_threads(const Report *report);
/* Work on [0, count) on all cores, a part of a step. What comes out must not depend on which thread ran what. */
void report_each(ReportStep *step, uint32_t count, ChiaroRangeFunc body, void *user);
/* One line to stderr: what was done, and how long it took. @return seconds. */
double report_end(ReportStep *step);
void *report_alloc(const Report *report, size_t count, size_t size);
/* A point in which nothing applies yet. */
ReportPoint report_new_point(const char *group, const char *name);
/* A bake with its bar, as a step. Ends the program with one line on failure. @return seconds. */
double report_bake(const Report *report, const ReportScene *scene, const ChiaroBakeDesc *desc, const char *name,
                   ChiaroBlob *blob, ChiaroTransport *transport);
/* A scene in this light, as a step. */
typedef struct ReportView {
    const char *name; /* NULL: part of a longer step */
    uint32_t width, height, spp;
    uint32_t passes; /* of so many paths, at most, until there is little noise */
    uint32_t half;   /* 1, 2: of two that are independent, with half the paths each; their mean has little noise */
} ReportView;
void report_trace(const Report *report, const ReportScene *scene, const ChiaroScene *what, const ChiaroLight *lights,
                  const ReportView *view, ChiaroReferenceImages *images);
/* Median and 95th of a hundred; sorts them. */
ReportTiming report_summarize(double *values, uint32_t count);

/* --- report_scene.c --- */
/* Bakes of the sweep, pictures, times, causes, baselines, motion. Ends the program with one line on failure. */
void report_scene(Report *report, ReportScene *scene);
ReportPoint *report_add_point(const Report *report, ReportScene *scene, const char *group, const char *name);
/* relRMSE and so on of a picture against the scene's truth. */
Metrics report_compare(const Report *report, const ReportScene *scene, const ChiaroIoImage *picture,
                       ChiaroComponent component);
/* The same, of two pictures. */
Metrics report_differ(const Report *report, const ChiaroIoImage *picture, const ChiaroIoImage *truth,
                      const ChiaroIoImage *mask);
/* A tone-mapped copy for the page. */
void report_add_picture(const Report *report, ReportScene *scene, const ChiaroIoImage *picture, const char *title);
/* Its error, in false colours. */
void report_add_error_picture(const Report *report, ReportScene *scene, const ChiaroIoImage *picture,
                              const ChiaroIoImage *truth, const char *title);

/* --- report_baselines.c --- */
/* `direct`: radiosity of the samples of `t` straight from lights; `rays`: of the scene. */
void report_baselines(Report *report, ReportScene *scene, const ChiaroTransport *t, const ChiaroRays *rays);

/* --- report_objects.c --- */
typedef struct ReportDevice ReportDevice;
/* Objects of the file and the options that move over the static scene, if there are any. `size`: of the scene, m. */
void report_objects(Report *report, ReportScene *scene, ReportDevice *device, const ChiaroTransport *t, float size);

/* --- report_motion.c --- */
void report_motion(Report *report, ReportScene *scene, ReportDevice *device, const ChiaroTransport *t,
                   const ChiaroRays *rays, float size);

/* --- report_lamps.c --- */
void report_lamps(Report *report, ReportScene *scene, const ChiaroTransport *t, const ChiaroRays *rays, float size);

/* --- report_claims.c --- */
extern const ReportClaim report_claims[REPORT_CLAIMS];
/* False where nothing was claimed, or measured. */
bool report_claim_holds(const ReportClaim *claim, double measured);
/* Those that have nothing to do with a scene. */
void report_measure_claims(Report *report);

/* --- report_scaling.c --- */
void report_fit(ReportSeries *series);
void report_scaling(Report *report, const ReportScene *scene);

/* --- report_write.c --- */
/* Marks the points of the front: nothing is both faster and more right. */
void report_find_front(ReportScene *scene);
/* Median of a frame with these settings and, if there are any, objects with theirs. */
double report_frame_ms(const ReportScene *scene, const ReportPoint *point);
/* The point with the least error whose frame fits a budget; NULL: none does. */
const ReportPoint *report_suggest(const ReportScene *scene, double budget_ms);
/* Writes report.csv, report.json and index.html; ends the program with one line if it cannot. */
void report_write(const Report *report);
/* The same choice from a report.csv: links (0: only without bounce light), and what else was asked of the baker. For a scene
 * of the same name, at the size of the pictures that were measured. False: `fault` says why. */
typedef struct ReportPlace {
    const char *input;
    uint32_t width, height;
} ReportPlace;
bool report_read_choice(const char *path, const ReportPlace *place, double budget_ms, ReportPoint *choice,
                        const char **fault);

/* --- report_html.c --- */
void report_write_html(FILE *file, const Report *report);

#endif
