/* A report as report.csv and report.json, and the choice that fits a budget. */
#include "report.h"

#include "json.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

enum { LINE = 4096, COLUMNS = 25 };

void report_find_front(ReportScene *scene)
{
    for (uint32_t i = 0; i < scene->point_count; i++) {
        ReportPoint *p = &scene->points[i];
        p->front = p->frame.median > 0;
        for (uint32_t k = 0; k < scene->point_count; k++) {
            const ReportPoint *q = &scene->points[k];
            bool better = q->frame.median > 0 && q->frame.median <= p->frame.median &&
                          q->indirect.relrmse <= p->indirect.relrmse &&
                          (q->frame.median < p->frame.median || q->indirect.relrmse < p->indirect.relrmse);
            p->front = p->front && !better;
        }
    }
}

const ReportPoint *report_suggest(const ReportScene *scene, double budget_ms)
{
    const ReportPoint *best = NULL;
    for (uint32_t i = 0; i < scene->point_count; i++) {
        const ReportPoint *p = &scene->points[i];
        if (p->front && p->frame.median <= budget_ms && (!best || p->indirect.relrmse < best->indirect.relrmse))
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

static void columns_of(const ReportPoint *p, double noise, Column columns[COLUMNS])
{
    const Column all[COLUMNS] = {
        {"links", p->links},
        {"samples", p->samples},
        {"receivers", p->receivers},
        {"asked_samples", p->asked_samples},
        {"asked_receivers", p->asked_receivers},
        {"asked_rays", p->asked_rays},
        {"bake_s", p->bake_s},
        {"bytes", p->bytes},
        {"frame_ms", known(p->frame.median)},
        {"frame_p95_ms", known(p->frame.p95)},
        {"update_ms", known(p->update.median)},
        {"update_p95_ms", known(p->update.p95)},
        {"core_light_ms", p->cpu_ms[0]},
        {"core_mean_ms", p->cpu_ms[1] + p->cpu_ms[3]},
        {"core_gather_samples_ms", p->cpu_ms[2]},
        {"core_gather_receivers_ms", p->cpu_ms[4]},
        {"indirect_relrmse", p->indirect.relrmse},
        {"indirect_mean_ratio", p->indirect.mean_ratio},
        {"indirect_p99", p->indirect.p99},
        {"full_relrmse", p->full.relrmse},
        {"full_mean_ratio", p->full.mean_ratio},
        {"full_p99", p->full.p99},
        {"truth_noise", noise},
        {"front", p->front},
        {"chosen", p->chosen},
    };
    memcpy(columns, all, sizeof all);
}

/* Settings of the static scene, then those of objects. */
static const ReportPoint *point_of(const ReportScene *scene, uint32_t i)
{
    return i < scene->point_count ? &scene->points[i] : &scene->objects[i - scene->point_count];
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

static void write_csv(FILE *file, const Report *report)
{
    Column columns[COLUMNS];
    columns_of(&report->scenes[0].points[0], 0, columns);
    fputs("scene,group,name", file);
    for (uint32_t k = 0; k < COLUMNS; k++)
        fprintf(file, ",%s", columns[k].name);
    fputc('\n', file);
    for (uint32_t s = 0; s < report->scene_count; s++) {
        const ReportScene *scene = &report->scenes[s];
        for (uint32_t i = 0; i < scene->point_count + scene->object_count; i++) {
            const ReportPoint *p = point_of(scene, i);
            columns_of(p, scene->noise[CHIARO_COMPONENT_INDIRECT], columns);
            put_csv_text(file, scene->input);
            fputc(',', file);
            put_csv_text(file, p->group);
            fputc(',', file);
            put_csv_text(file, p->name);
            for (uint32_t k = 0; k < COLUMNS; k++) {
                fputc(',', file);
                if (isfinite(columns[k].value))
                    fprintf(file, "%.9g", columns[k].value);
            }
            fputc('\n', file);
        }
    }
}

static void write_series(FILE *file, const ReportSeries *series, const char **comma)
{
    for (uint32_t k = 0; k < series->count; k++) {
        fputs(*comma, file);
        Json json = json_begin(file);
        json_text(&json, "series", series->title);
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
    Column columns[COLUMNS];
    const char *comma = "";
    fputs("{\"run\": ", file);
    Json json = json_begin(file);
    json_text(&json, "device", report->device);
    json_number(&json, "quick", report->quick);
    json_number(&json, "width", report->options.width);
    json_number(&json, "height", report->options.height);
    json_end(&json);
    fputs(", \"points\": [", file);
    for (uint32_t s = 0; s < report->scene_count; s++) {
        const ReportScene *scene = &report->scenes[s];
        for (uint32_t i = 0; i < scene->point_count + scene->object_count; i++) {
            const ReportPoint *p = point_of(scene, i);
            fputs(comma, file);
            columns_of(p, scene->noise[CHIARO_COMPONENT_INDIRECT], columns);
            json = json_begin(file);
            json_text(&json, "scene", scene->input);
            json_text(&json, "group", p->group);
            json_text(&json, "name", p->name);
            for (uint32_t k = 0; k < COLUMNS; k++)
                json_number(&json, columns[k].name, columns[k].value);
            json_end(&json);
            comma = ", ";
        }
    }
    fputs("], \"causes\": [", file);
    comma = "";
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
    for (uint32_t s = 0; s < report->scene_count; s++)
        write_series(file, &report->scenes[s].late, &comma);
    for (uint32_t k = 0; k < report->series_count; k++)
        write_series(file, &report->series[k], &comma);
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

bool report_read_choice(const char *path, double budget_ms, ReportPoint *choice, const char **fault)
{
    char line[LINE];
    FILE *file = fopen(path, "rb");
    bool found = false;
    *fault = "cannot be read, or holds no choice that fits the budget";
    while (file && fgets(line, sizeof line, file)) {
        char *at = line, *fields[3 + COLUMNS];
        uint32_t count = 0;
        while (count < 3 + COLUMNS && (fields[count] = next_field(&at)))
            count++;
        if (count < 3 + COLUMNS)
            continue;
        ReportPoint point = {.links = (uint32_t)strtoul(fields[3], NULL, 10),
                             .asked_samples = (uint32_t)strtoul(fields[6], NULL, 10),
                             .asked_receivers = (uint32_t)strtoul(fields[7], NULL, 10),
                             .asked_rays = (uint32_t)strtoul(fields[8], NULL, 10)};
        point.frame.median = strtod(fields[11], NULL), point.indirect.relrmse = strtod(fields[19], NULL);
        bool sane = point.links >= 1 && point.links <= CHIARO_MAX_LINKS && point.asked_samples <= CHIARO_MAX_SAMPLES &&
                    point.asked_receivers <= 1u << 24 && point.asked_rays <= CHIARO_MAX_RAYS;
        if (sane && point.frame.median > 0 && point.frame.median <= budget_ms &&
            (!found || point.indirect.relrmse < choice->indirect.relrmse))
            *choice = point, found = true;
    }
    if (file)
        fclose(file);
    return found;
}
