/* A report as report.csv and report.json, and the choice that fits a budget. */
#include "report.h"

#include "json.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

enum { LINE = 4096, MOST_RECEIVERS = 1 << 24, TEXTS = 3 /* columns of words, before those of numbers */ };
/* Those that are read again, where they stand. */
enum { COLUMN_WIDTH = 0, COLUMN_HEIGHT = 1, COLUMN_LINKS = 2, COLUMN_ASKED_SAMPLES = 5, COLUMN_ASKED_RECEIVERS = 6,
       COLUMN_ASKED_RAYS = 7, COLUMN_FRAME_MS = 10, COLUMN_INDIRECT = 18, COLUMN_FRONT = 34, COLUMN_CHOSEN = 35,
       COLUMN_CLAIMED, COLUMN_MEASURED, COLUMNS };

/* Settings that a renderer is told, other than ideas taken out to see what they do. */
static bool is_choice(const ReportPoint *p)
{
    return p->frame.median > 0 && (strcmp(p->group, "features") != 0 || p->links == 0);
}

void report_find_front(ReportScene *scene)
{
    for (uint32_t i = 0; i < scene->point_count; i++) {
        ReportPoint *p = &scene->points[i];
        p->front = is_choice(p);
        for (uint32_t k = 0; k < scene->point_count; k++) {
            const ReportPoint *q = &scene->points[k];
            bool better = is_choice(q) && q->frame.median <= p->frame.median &&
                          q->indirect.relrmse <= p->indirect.relrmse &&
                          (q->frame.median < p->frame.median || q->indirect.relrmse < p->indirect.relrmse);
            p->front = p->front && !better;
        }
    }
}

double report_frame_ms(const ReportScene *scene, const ReportPoint *point)
{
    /* What the defaults for objects add to the frame of the default bake, they add to every other. */
    double more = scene->object_count ? scene->objects[0].frame.median - scene->points[0].frame.median : 0;
    return point->frame.median + fmax(0, more);
}

const ReportPoint *report_suggest(const ReportScene *scene, double budget_ms)
{
    const ReportPoint *best = NULL;
    for (uint32_t i = 0; i < scene->point_count; i++) {
        const ReportPoint *p = &scene->points[i];
        if (p->front && report_frame_ms(scene, p) <= budget_ms && (!best || p->indirect.relrmse < best->indirect.relrmse))
            best = p;
    }
    return best;
}

/* ---- a file that is written whole or not at all ------------------------------------------------------------------- */

static FILE *begin_file(const Report *report, const char *name, char path[2][REPORT_PATH])
{
    snprintf(path[0], REPORT_PATH, "%s/%s", report->folder, name);
    snprintf(path[1], REPORT_PATH, "%s/.%s.part", report->folder, name);
    FILE *file = fopen(path[1], "wb");
    if (!file)
        options_fail(&report->options, CHIARO_EXIT_INPUT, "%s: cannot be written: %s", path[0], strerror(errno));
    return file;
}

static void end_file(const Report *report, FILE *file, char path[2][REPORT_PATH])
{
    bool good = !ferror(file);
    good = fclose(file) == 0 && good;
    if (!good || rename(path[1], path[0]) != 0) {
        remove(path[1]);
        options_fail(&report->options, CHIARO_EXIT_INPUT, "%s: cannot be written", path[0]);
    }
}

/* ---- rows --------------------------------------------------------------------------------------------------------- */

/* The columns of a point: numbers by name. NAN where it has none. */
typedef struct Column {
    const char *name;
    double value;
} Column;

static double known(double value) { return value >= 0 ? value : NAN; }

static void columns_of(const Report *report, const ReportPoint *p, double noise, Column columns[COLUMNS])
{
    const Column all[COLUMNS] = {
        [COLUMN_WIDTH] = {"width", report->options.width},
        [COLUMN_HEIGHT] = {"height", report->options.height},
        [COLUMN_LINKS] = {"links", p->links},
        {"samples", p->samples},
        {"receivers", p->receivers},
        [COLUMN_ASKED_SAMPLES] = {"asked_samples", p->asked_samples},
        [COLUMN_ASKED_RECEIVERS] = {"asked_receivers", p->asked_receivers},
        [COLUMN_ASKED_RAYS] = {"asked_rays", p->asked_rays},
        {"bake_s", p->bake_s},
        {"bytes", p->bytes},
        [COLUMN_FRAME_MS] = {"frame_ms", known(p->frame.median)},
        {"frame_p95_ms", known(p->frame.p95)},
        {"update_ms", known(p->update.median)},
        {"update_p95_ms", known(p->update.p95)},
        {"core_light_ms", p->cpu_ms[0]},
        {"core_mean_ms", p->cpu_ms[1] + p->cpu_ms[3]},
        {"core_gather_samples_ms", p->cpu_ms[2]},
        {"core_gather_receivers_ms", p->cpu_ms[4]},
        [COLUMN_INDIRECT] = {"indirect_relrmse", p->indirect.relrmse},
        {"indirect_mean_ratio", p->indirect.mean_ratio},
        {"indirect_p99", p->indirect.p99},
        {"full_relrmse", p->full.relrmse},
        {"full_mean_ratio", p->full.mean_ratio},
        {"full_p99", p->full.p99},
        {"objects_relrmse", p->objects.relrmse},
        {"objects_mean_ratio", p->objects.mean_ratio},
        {"objects_p99", p->objects.p99},
        {"rest_relrmse", p->rest},
        {"changed_relrmse", p->changed},
        {"age_frames", p->age},
        {"asked_cubes", p->asked_cubes},
        {"asked_edge", p->asked_edge},
        {"asked_format", p->asked_format},
        {"truth_noise", noise},
        [COLUMN_FRONT] = {"front", p->front},
        [COLUMN_CHOSEN] = {"chosen", p->chosen},
        [COLUMN_CLAIMED] = {"claimed", (double)NAN},
        [COLUMN_MEASURED] = {"measured", (double)NAN},
    };
    memcpy(columns, all, sizeof all);
}

/* Settings of the static scene, then those of objects, then motion: the points of a scene. */
static uint32_t points_of(const ReportScene *scene)
{
    return scene->point_count + scene->object_count + scene->motion_count;
}

static const ReportPoint *point_of(const ReportScene *scene, uint32_t i)
{
    uint32_t moving = scene->point_count + scene->object_count;
    return i < scene->point_count ? &scene->points[i]
           : i < moving           ? &scene->objects[i - scene->point_count]
                                  : &scene->motion[i - moving];
}

static double noise_of(const ReportScene *scene, const ReportPoint *p)
{
    return strcmp(p->group, "motion") == 0    ? scene->motion_noise
           : strcmp(p->group, "objects") == 0 ? scene->moment_noise
                                              : scene->noise[CHIARO_COMPONENT_INDIRECT];
}

static void put_csv_text(FILE *file, const char *text)
{
    fputc('"', file);
    for (; *text; text++) {
        if (*text == '"')
            fputc('"', file);
        fputc(*text, file);
    }
    fputc('"', file);
}

/* A row of the file: whose it is, and its columns. */
typedef struct Row {
    const char *scene, *group, *name;
    Column columns[COLUMNS];
} Row;
typedef void (*RowFunc)(FILE *file, const Row *row, bool first);

/* A row that says nothing yet. */
static Row new_row(const Report *report, const char *scene, const char *group, const char *name)
{
    Row row = {.scene = scene, .group = group, .name = name};
    const ReportPoint none = report_new_point(group, name);
    columns_of(report, &none, (double)NAN, row.columns);
    for (uint32_t k = 0; k < COLUMNS; k++)
        row.columns[k].value = (double)NAN;
    return row;
}

static void each_lamp(FILE *file, const Report *report, const ReportScene *scene, RowFunc put)
{
    for (uint32_t k = 0; k < REPORT_LAMPS; k++) {
        const ReportLamps *lamps = &scene->lamps[k];
        for (int worst = 0; worst < 2 && lamps->count > 0; worst++) {
            char name[REPORT_TEXT];
            snprintf(name, sizeof name, "%s, %s of %u", lamps->name, worst ? "worst" : "median", lamps->count);
            Row row = new_row(report, scene->input, "lamps", name);
            row.columns[COLUMN_INDIRECT].value = worst ? lamps->worst : lamps->median;
            if (!worst)
                row.columns[COLUMN_INDIRECT + 1].value = lamps->mean_ratio;
            put(file, &row, false);
        }
    }
}

/* All rows, scene by scene, and those of the README. */
static void each_row(FILE *file, const Report *report, RowFunc put)
{
    for (uint32_t s = 0; s < report->scene_count; s++) {
        const ReportScene *scene = &report->scenes[s];
        for (uint32_t i = 0; i < points_of(scene); i++) {
            const ReportPoint *p = point_of(scene, i);
            Row row = {.scene = scene->input, .group = p->group, .name = p->name};
            columns_of(report, p, noise_of(scene, p), row.columns);
            put(file, &row, s + i == 0);
        }
        each_lamp(file, report, scene, put);
    }
    for (uint32_t k = 0; k < REPORT_CLAIMS; k++) {
        Row row = new_row(report, "", "claim", report_claims[k].key);
        row.columns[COLUMN_CLAIMED].value = report_claims[k].claimed;
        row.columns[COLUMN_MEASURED].value = report->measured[k];
        put(file, &row, false);
    }
}

/* Nine digits, and no power of ten: who cuts a column short must not take 1.6e-05 for 1.6. */
static void put_csv_number(FILE *file, double value)
{
    char text[32];
    snprintf(text, sizeof text, "%.9g", value);
    if (strchr(text, 'e'))
        fprintf(file, "%.*f", fabs(value) < 1 ? (int)fmin(8 - floor(log10(fabs(value))), 30) : 0, value);
    else
        fputs(text, file);
}

static void put_csv_row(FILE *file, const Row *row, bool first)
{
    if (first) {
        fputs("scene,group,name", file);
        for (uint32_t k = 0; k < COLUMNS; k++)
            fprintf(file, ",%s", row->columns[k].name);
        fputc('\n', file);
    }
    put_csv_text(file, row->scene);
    fputc(',', file);
    put_csv_text(file, row->group);
    fputc(',', file);
    put_csv_text(file, row->name);
    for (uint32_t k = 0; k < COLUMNS; k++) {
        fputc(',', file);
        if (isfinite(row->columns[k].value))
            put_csv_number(file, row->columns[k].value);
    }
    fputc('\n', file);
}

static void write_csv(FILE *file, const Report *report) { each_row(file, report, put_csv_row); }

static void put_json_row(FILE *file, const Row *row, bool first)
{
    if (!first)
        fputs(", ", file);
    Json json = json_begin(file);
    json_text(&json, "scene", row->scene);
    json_text(&json, "group", row->group);
    json_text(&json, "name", row->name);
    for (uint32_t k = 0; k < COLUMNS; k++)
        json_number(&json, row->columns[k].name, row->columns[k].value);
    json_end(&json);
}

static void write_series(FILE *file, const char *scene, const ReportSeries *series, const char **comma)
{
    for (uint32_t k = 0; k < series->count; k++) {
        fputs(*comma, file);
        Json json = json_begin(file);
        json_text(&json, "scene", scene);
        json_text(&json, "series", series->title);
        json_text(&json, "name", series->name);
        json_text(&json, "x_label", series->x_label);
        json_text(&json, "y_label", series->y_label);
        json_number(&json, "x", series->x[k]);
        json_number(&json, "y", series->y[k]);
        json_number(&json, "exponent", series->exponent);
        json_text(&json, "note", series->note);
        json_end(&json);
        *comma = ", ";
    }
}

static void write_json(FILE *file, const Report *report)
{
    const char *comma = "";
    fputs("{\"run\": ", file);
    Json json = json_begin(file);
    json_text(&json, "device", report->device);
    json_number(&json, "quick", report->quick);
    json_number(&json, "width", report->options.width);
    json_number(&json, "height", report->options.height);
    json_end(&json);
    fputs(", \"points\": [", file);
    each_row(file, report, put_json_row);
    fputs("], \"causes\": [", file);
    for (uint32_t s = 0; s < report->scene_count; s++) {
        for (uint32_t k = 0; k < report->scenes[s].cause_count; k++) {
            fputs(comma, file);
            json = json_begin(file);
            json_text(&json, "scene", report->scenes[s].input);
            json_text(&json, "cause", report->scenes[s].causes[k].name);
            json_number(&json, "relrmse", report->scenes[s].causes[k].relrmse);
            json_end(&json);
            comma = ", ";
        }
    }
    fputs("], \"series\": [", file);
    comma = "";
    for (uint32_t s = 0; s < report->scene_count; s++) {
        const ReportScene *scene = &report->scenes[s];
        for (uint32_t k = 0; k < REPORT_SPEEDS; k++)
            write_series(file, scene->input, &scene->budgets[k], &comma);
        for (uint32_t k = 0; k < REPORT_BUDGETS; k++)
            write_series(file, scene->input, &scene->frames[k], &comma);
    }
    for (uint32_t k = 0; k < report->series_count; k++)
        write_series(file, report->scenes[0].input, &report->series[k], &comma);
    fputs("]}\n", file);
}

void report_write(const Report *report)
{
    static const struct {
        const char *name;
        void (*write)(FILE *file, const Report *report);
    } files[] = {{"report.csv", write_csv}, {"report.json", write_json}, {"index.html", report_write_html}};
    if (mkdir(report->folder, 0777) != 0 && errno != EEXIST)
        options_fail(&report->options, CHIARO_EXIT_INPUT, "%s: cannot be made: %s", report->folder, strerror(errno));
    for (size_t k = 0; k < sizeof files / sizeof *files; k++) {
        char path[2][REPORT_PATH];
        FILE *file = begin_file(report, files[k].name, path);
        files[k].write(file, report);
        end_file(report, file, path);
    }
}

/* ---- back from a file --------------------------------------------------------------------------------------------- */

/* The next field of a line of ours, unquoted in place; NULL: there is none. */
static char *next_field(char **line)
{
    char *begin = *line, *out = begin, *in = begin;
    bool quoted = *in == '"';
    if (!begin || *begin == 0)
        return NULL;
    for (in += quoted; *in && (quoted || (*in != ',' && *in != '\n')); in++) {
        if (quoted && *in == '"' && *++in != '"')
            break;
        *out++ = *in;
    }
    *line = *in == ',' ? in + 1 : in;
    if (*in == '\n')
        *line = in + 1;
    *out = 0;
    return begin;
}

/* What a line says, by the names in the first one. */
typedef struct Line {
    char *texts[TEXTS];
    double numbers[COLUMNS];
} Line;

static bool read_line(FILE *file, char buffer[LINE], Line *line)
{
    char *at = buffer, *field;
    uint32_t count = 0;
    if (!fgets(buffer, LINE, file))
        return false;
    *line = (Line){{NULL}, {0}};
    for (; count < TEXTS + COLUMNS && (field = next_field(&at)); count++) {
        if (count < TEXTS)
            line->texts[count] = field;
        else
            line->numbers[count - TEXTS] = strtod(field, NULL);
    }
    return count == TEXTS + COLUMNS;
}

/* A whole number in a range; `most` + 1: it is none. */
static uint32_t whole(double value, uint32_t most) { return value >= 0 && value <= most ? (uint32_t)value : most + 1; }

static const char *file_name(const char *path)
{
    const char *slash = strrchr(path, '/');
    return slash ? slash + 1 : path;
}

/* A row as a point; false: numbers that nobody can ask a baker for. */
static bool read_point(const Line *line, ReportPoint *point)
{
    const double *n = line->numbers;
    *point = report_new_point(line->texts[1], line->texts[2]);
    point->links = whole(n[COLUMN_LINKS], CHIARO_MAX_LINKS);
    point->asked_samples = whole(n[COLUMN_ASKED_SAMPLES], CHIARO_MAX_SAMPLES);
    point->asked_receivers = whole(n[COLUMN_ASKED_RECEIVERS], MOST_RECEIVERS);
    point->asked_rays = whole(n[COLUMN_ASKED_RAYS], CHIARO_MAX_RAYS);
    point->frame.median = n[COLUMN_FRAME_MS], point->indirect.relrmse = n[COLUMN_INDIRECT];
    point->front = n[COLUMN_FRONT] > 0, point->chosen = n[COLUMN_CHOSEN] > 0;
    return point->links <= CHIARO_MAX_LINKS && point->asked_samples <= CHIARO_MAX_SAMPLES &&
           point->asked_receivers <= MOST_RECEIVERS && point->asked_rays <= CHIARO_MAX_RAYS &&
           isfinite(point->frame.median) && point->indirect.relrmse >= 0;
}

bool report_read_choice(const char *path, const ReportPlace *place, double budget_ms, ReportPoint *choice,
                        const char **fault)
{
    char buffer[LINE];
    Line line;
    ReportPoint point;
    ReportScene *scene = calloc(1, sizeof *scene);
    FILE *file = fopen(path, "rb");
    bool ours = file && scene && read_line(file, buffer, &line) && strcmp(line.texts[0], "scene") == 0;
    *fault = !file ? "cannot be read" : ours ? "says nothing about this scene" : "is no report.csv of chiaro-report";
    while (ours && read_line(file, buffer, &line)) {
        if (strcmp(file_name(line.texts[0]), file_name(place->input)) != 0 || !read_point(&line, &point))
            continue;
        if (line.numbers[COLUMN_WIDTH] != place->width || line.numbers[COLUMN_HEIGHT] != place->height) {
            *fault = "was measured at another --size";
            continue;
        }
        *fault = "holds no settings that fit the budget";
        if (strcmp(point.group, "objects") != 0 && strcmp(point.group, "motion") != 0 && scene->point_count < REPORT_POINTS)
            scene->points[scene->point_count++] = point;
        else if (strcmp(point.group, "objects") == 0 && point.chosen)
            scene->objects[0] = point, scene->object_count = 1;
    }
    const ReportPoint *best = scene ? report_suggest(scene, budget_ms) : NULL;
    if (best)
        *choice = *best;
    if (file)
        fclose(file);
    free(scene);
    return best != NULL;
}
