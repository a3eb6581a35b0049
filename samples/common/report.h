/* A report: error against run time of a scene, and of what it could be replaced by.
 *
 *   report_scene.c      truth, bakes, pictures and times of one scene; the sweep; light that is late
 *   report_objects.c    objects that move: cubes of all kinds and budgets
 *   report_baselines.c  what engines do instead, and the article taken literally
 *   report_scaling.c    how cost grows
 *   report_write.c      report.csv, report.json, the table and the choice for a budget
 *   report_html.c       index.html, with its plots
 */
#ifndef CHIARO_REPORT_H
#define CHIARO_REPORT_H

#include "../../src/io/io.h"
#include "../../src/offline/rays.h"
#include "../../src/reference/reference.h"
#include "chiaro/chiaro_bake.h"
#include "metrics.h"
#include "options.h"

#include <stdio.h>

enum { REPORT_TEXT = 96, REPORT_POINTS = 48, REPORT_TASKS = 5, REPORT_SERIES = 16, REPORT_VALUES = 16, REPORT_CAUSES = 8,
       REPORT_PICTURES = 12, REPORT_PATH = 1024 };

typedef struct ReportTiming {
    double median, p95; /* ms; negative: not measured */
} ReportTiming;

/* One choice of settings, or one baseline. */
typedef struct ReportPoint {
    char group[REPORT_TEXT], name[REPORT_TEXT];
    uint32_t links, samples, receivers; /* as they came out; 0: does not apply */
    uint32_t asked_samples, asked_receivers, asked_rays; /* of the baker; 0: its default */
    double bake_s, bytes;
    ReportTiming frame, update; /* on the device: a frame with moving lights, and what update() recorded of it */
    double cpu_ms[REPORT_TASKS]; /* the same update on one core: light on samples, means, gather to them, means, gather
                                    to receivers */
    Metrics indirect, full;
    bool chosen, front, baseline;
} ReportPoint;

/* A curve: y over x. */
typedef struct ReportSeries {
    char title[REPORT_TEXT], x_label[REPORT_TEXT], y_label[REPORT_TEXT], note[2 * REPORT_TEXT];
    double x[REPORT_VALUES], y[REPORT_VALUES];
    uint32_t count;
    double exponent; /* y ~ x^exponent; NAN: not fitted */
} ReportSeries;

typedef struct ReportCause {
    char name[REPORT_TEXT];
    double relrmse;
} ReportCause;

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
    double noise[CHIARO_COMPONENT_COUNT], truth_s;
    ReportPoint points[REPORT_POINTS];
    uint32_t point_count, cause_count, picture_count;
    ReportCause causes[REPORT_CAUSES];
    ReportPicture pictures[REPORT_PICTURES];
    float exposure; /* of all of them, stops */
    ReportSeries late; /* error of light that is so many frames late */
    uint32_t object_count;
    ReportPoint objects[REPORT_POINTS]; /* settings for objects: errors are of the pixels that show one */
} ReportScene;

typedef struct Report {
    SceneOptions options;
    const char *folder, *device_name; /* NULL: any device */
    bool quick, scaling;
    double suggest_ms; /* 0: not asked for */
    ChiaroSky sky;
    ReportScene *scenes;
    uint32_t scene_count, series_count;
    ReportSeries series[REPORT_SERIES];
    char device[256];
} Report;

/* --- report_scene.c --- */
double report_now(void); /* s */
/* One line to stderr: what was done, and how long it took. */
void report_tell(const Report *report, const char *what, double seconds);
/* Median and 95th of a hundred; sorts them. */
ReportTiming report_summarize(double *values, uint32_t count);
/* The truth of a scene in this light. */
void report_trace(const Report *report, const ReportScene *scene, const ChiaroScene *what, const ChiaroLight *lights,
                  ChiaroReferenceImages *images);
/* Bakes of the sweep, pictures, times, causes, light that is late, baselines. Ends the program with one line on failure. */
void report_scene(Report *report, ReportScene *scene);
ReportPoint *report_add_point(const Report *report, ReportScene *scene, const char *group, const char *name);
/* relRMSE and so on of a picture against the scene's truth. */
Metrics report_compare(const Report *report, const ReportScene *scene, const ChiaroIoImage *picture,
                       ChiaroComponent component);
/* A tone-mapped copy for the page. */
void report_add_picture(const Report *report, ReportScene *scene, const ChiaroIoImage *picture, const char *title);
void *report_alloc(const Report *report, size_t count, size_t size);

/* --- report_baselines.c --- */
/* `direct`: radiosity of the samples of `t` straight from lights; `rays`: of the scene. */
void report_baselines(Report *report, ReportScene *scene, const ChiaroTransport *t, const ChiaroRays *rays);

/* --- report_objects.c --- */
typedef struct ReportDevice ReportDevice;
/* Objects of the file and the options that move over the static scene, if there are any. */
void report_objects(Report *report, ReportScene *scene, ReportDevice *device, const ChiaroTransport *t);

/* --- report_scaling.c --- */
void report_fit(ReportSeries *series);
void report_scaling(Report *report, const ReportScene *scene);

/* --- report_write.c --- */
/* Marks the points of the front: nothing is both faster and more right. */
void report_find_front(ReportScene *scene);
/* The point with the least error that fits a budget; NULL: none does. */
const ReportPoint *report_suggest(const ReportScene *scene, double budget_ms);
/* Writes report.csv, report.json and index.html; ends the program with one line if it cannot. */
void report_write(const Report *report);
/* The same choice from a report.csv, of any scene: links, and what else was asked of the baker. False: `fault` says why. */
bool report_read_choice(const char *path, double budget_ms, ReportPoint *choice, const char **fault);

/* --- report_html.c --- */
void report_write_html(FILE *file, const Report *report);

#endif
