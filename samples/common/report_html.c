/* The page of a report: one file that needs no other and no network. Plots are SVG, pictures are PNG data. */
#include "report.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { WIDTH = 560, HEIGHT = 340, LEFT = 64, RIGHT = 16, TOP = 28, BOTTOM = 46, MOST_NUMBERS = 8 };
static const double LINE = 12.5; /* from base line to base line */

static const char style[] =
    "body{font:15px/1.5 system-ui,sans-serif;color:#1b1b1f;background:#fff;max-width:1180px;margin:2em auto;padding:0 1em}"
    "h1{font-size:1.7em;margin:.2em 0}h2{font-size:1.25em;margin:1.6em 0 .4em;border-bottom:1px solid #ccc}"
    ".plots,.pictures{display:flex;flex-wrap:wrap;gap:16px}figure{margin:0}figcaption{font-size:13px;color:#444}"
    ".pictures img{width:270px;image-rendering:pixelated;border:1px solid #ccc}"
    "table{border-collapse:collapse;font-size:13px;margin:.6em 0}td,th{padding:3px 8px;border-bottom:1px solid #ddd;"
    "text-align:right}td:first-child,th:first-child,td.text{text-align:left}"
    "tr.chosen{background:#fff3d6;font-weight:600}"
    "tr.front td:first-child::after{content:' \\25c6';color:#0a7}tr.baseline{color:#666}"
    "svg text{font:11px system-ui,sans-serif;fill:#333;stroke:#fff;stroke-width:3px;paint-order:stroke}"
    "svg .title{font-size:13px;font-weight:600}"
    "@media print{body{max-width:none;margin:0;font-size:11px}figure,table{break-inside:avoid}h2{break-after:avoid}}";

/* Text of other people's, such as names of files. */
static void put_text(FILE *file, const char *text)
{
    for (; *text; text++) {
        switch (*text) {
        case '&': fputs("&amp;", file); break;
        case '<': fputs("&lt;", file); break;
        case '>': fputs("&gt;", file); break;
        case '"': fputs("&quot;", file); break;
        default: fputc(*text, file);
        }
    }
}

/* ---- plots -------------------------------------------------------------------------------------------------------- */

/* Where numbers fall on the paper. Axes are logarithmic, but for an x axis that begins at zero: it counts. */
typedef struct Plot {
    FILE *file;
    bool linear;            /* the x axis */
    double low[2], high[2]; /* of x and y, as log10 unless linear */
    double taken[2 * REPORT_POINTS][3]; /* left, right and base line of dots, and of labels that stand already */
    uint32_t taken_count;
} Plot;

static double place(const Plot *plot, int axis, double value)
{
    double at = plot->linear && axis == 0 ? value : log10(value);
    double part = (at - plot->low[axis]) / (plot->high[axis] - plot->low[axis]);
    part = fmin(fmax(part, 0), 1);
    return axis == 0 ? LEFT + part * (WIDTH - LEFT - RIGHT) : HEIGHT - BOTTOM - part * (HEIGHT - TOP - BOTTOM);
}

/* A range that holds some positive numbers, with some air about them. */
static void find_range(Plot *plot, int axis, const double *values, uint32_t count)
{
    double low = INFINITY, high = 0;
    for (uint32_t i = 0; i < count; i++) {
        if (values[i] > 0 && isfinite(values[i]))
            low = fmin(low, values[i]), high = fmax(high, values[i]);
    }
    if (high == 0)
        low = 0.1, high = 1;
    if (plot->linear && axis == 0) {
        plot->low[axis] = -0.04 * high, plot->high[axis] = 1.1 * high;
        return;
    }
    plot->low[axis] = log10(low) - 0.12, plot->high[axis] = log10(high) + 0.12;
    if (plot->high[axis] - plot->low[axis] < 0.5) {
        double middle = (plot->high[axis] + plot->low[axis]) / 2;
        plot->low[axis] = middle - 0.25, plot->high[axis] = middle + 0.25;
    }
}

static void put_tick(const Plot *plot, int axis, double value)
{
    double p = place(plot, axis, value);
    if (axis == 0)
        fprintf(plot->file, "<path d=\"M%.1f %dV%d\" stroke=\"#e4e4e8\"/><text x=\"%.1f\" y=\"%d\" "
                            "text-anchor=\"middle\">%g</text>", p, TOP, HEIGHT - BOTTOM, p, HEIGHT - BOTTOM + 15, value);
    else
        fprintf(plot->file, "<path d=\"M%d %.1fH%d\" stroke=\"#e4e4e8\"/><text x=\"%d\" y=\"%.1f\" "
                            "text-anchor=\"end\">%g</text>", LEFT, p, WIDTH - RIGHT, LEFT - 5, p + 4, value);
}

static void begin_plot(const Plot *plot, const char *title, const char *x_label, const char *y_label)
{
    static const double steps[] = {1, 2, 5, 3, 1.5, 7, 4, 6};
    FILE *file = plot->file;
    fprintf(file, "<figure><svg width=\"%d\" height=\"%d\" viewBox=\"0 0 %d %d\" role=\"img\"><text class=\"title\" x=\"%d\" "
                  "y=\"16\">", WIDTH, HEIGHT, WIDTH, HEIGHT, LEFT);
    put_text(file, title);
    fprintf(file, "</text><rect x=\"%d\" y=\"%d\" width=\"%d\" height=\"%d\" fill=\"none\" stroke=\"#999\"/>", LEFT, TOP,
            WIDTH - LEFT - RIGHT, HEIGHT - TOP - BOTTOM);
    for (int axis = 0; axis < 2; axis++) {
        double span = plot->high[axis] - plot->low[axis];
        int marks = span > 3 ? 1 : span > 1 ? 3 : 8;
        if (plot->linear && axis == 0) {
            double step = ceil(plot->high[axis] / 1.1 / 5); /* whole frames */
            for (int k = 0; step > 0 && k * step < plot->high[axis]; k++)
                put_tick(plot, axis, k * step);
            continue;
        }
        for (int decade = (int)floor(plot->low[axis]); decade <= (int)ceil(plot->high[axis]); decade++) {
            for (int k = 0; k < marks; k++) {
                double value = steps[k] * pow(10, decade), at = log10(value);
                if (at >= plot->low[axis] && at <= plot->high[axis])
                    put_tick(plot, axis, value);
            }
        }
    }
    fprintf(file, "<text x=\"%d\" y=\"%d\" text-anchor=\"middle\">", (LEFT + WIDTH - RIGHT) / 2, HEIGHT - 10);
    put_text(file, x_label);
    fprintf(file, "</text><text transform=\"translate(14 %d) rotate(-90)\" text-anchor=\"middle\">",
            (TOP + HEIGHT - BOTTOM) / 2);
    put_text(file, y_label);
    fputs("</text>", file);
}

static void end_plot(const Plot *plot, const char *caption)
{
    fputs("</svg><figcaption>", plot->file);
    put_text(plot->file, caption);
    fputs("</figcaption></figure>\n", plot->file);
}

static void take_room(Plot *plot, double begin, double end, double base)
{
    if (plot->taken_count == sizeof plot->taken / sizeof *plot->taken)
        return;
    double *own = plot->taken[plot->taken_count++];
    own[0] = begin, own[1] = end, own[2] = base;
}

/* Labels stay off dots that are still to come. */
static void expect_dot(Plot *plot, double x, double y)
{
    double px = place(plot, 0, x), py = place(plot, 1, y);
    take_room(plot, px - 4, px + 4, py + 4);
}

/* The base line of a label, as near as it is free: moved by `way` until it touches nothing. */
static double find_free(const Plot *plot, double begin, double end, double base, double way)
{
    for (uint32_t k = 0; k < plot->taken_count; k++) {
        const double *other = plot->taken[k];
        if (begin < other[1] && end > other[0] && fabs(base - other[2]) < fabs(way))
            base = other[2] + way, k = UINT32_MAX; /* and look again */
    }
    return base;
}

/* A dot with its label, which gives way to what stands there: up or down, whichever is nearer and on the paper. */
static void put_dot(Plot *plot, double x, double y, const char *color, bool large, const char *label)
{
    double px = place(plot, 0, x), py = place(plot, 1, y), width = 6.2 * (double)strlen(label);
    bool left = px + 8 + width > WIDTH - RIGHT;
    double begin = left ? px - 8 - width : px + 8, end = begin + width;
    double up = find_free(plot, begin, end, py - 5, -LINE), down = find_free(plot, begin, end, py - 5, LINE);
    bool fits = down < HEIGHT - BOTTOM - 2 && (up < TOP + LINE || down - py + 5 < py - 5 - up);
    double base = fits ? down : up;
    take_room(plot, begin, end, base);
    if (fabs(base - py) > 16)
        fprintf(plot->file, "<path d=\"M%.1f %.1fL%.1f %.1f\" stroke=\"#bbb\"/>", px, py, left ? px - 7 : px + 7,
                base - 4);
    fprintf(plot->file, "<circle cx=\"%.1f\" cy=\"%.1f\" r=\"%d\" fill=\"%s\"><title>", px, py, large ? 7 : 4, color);
    put_text(plot->file, label);
    fprintf(plot->file, "</title></circle><text x=\"%.1f\" y=\"%.1f\" text-anchor=\"%s\">", left ? px - 8 : px + 8, base,
            left ? "end" : "start");
    put_text(plot->file, label);
    fputs("</text>", plot->file);
}

/* One plot of curves that share their axes. */
static void plot_series(FILE *file, const ReportSeries *series, uint32_t series_count)
{
    static const char *const colors[] = {"#2667b5", "#d97706", "#0a7", "#a21caf", "#6b7280"};
    enum { COLORS = sizeof colors / sizeof *colors };
    Plot plot = {.file = file, .linear = series->count && series->x[0] == 0};
    double x[REPORT_BUDGETS * REPORT_VALUES], y[REPORT_BUDGETS * REPORT_VALUES];
    char caption[3 * REPORT_TEXT];
    uint32_t count = 0;
    for (uint32_t s = 0; s < series_count; s++) {
        for (uint32_t k = 0; k < series[s].count; k++)
            x[count] = series[s].x[k], y[count++] = series[s].y[k];
    }
    if (count == 0)
        return;
    find_range(&plot, 0, x, count);
    find_range(&plot, 1, y, count);
    begin_plot(&plot, series->title, series->x_label, series->y_label);
    for (uint32_t s = 0; s < series_count; s++) {
        const ReportSeries *one = &series[s];
        fprintf(file, "<path fill=\"none\" stroke=\"%s\" stroke-width=\"2\" d=\"", colors[s % COLORS]);
        for (uint32_t k = 0; k < one->count; k++)
            fprintf(file, "%c%.1f %.1f", k ? 'L' : 'M', place(&plot, 0, one->x[k]), place(&plot, 1, one->y[k]));
        fputs("\"/>", file);
    }
    for (uint32_t s = 0; s < series_count; s++) {
        const ReportSeries *one = &series[s];
        /* Short curves have a number at every point, long ones their name at the end. */
        for (uint32_t k = 0; k < one->count; k++) {
            char label[2 * REPORT_TEXT];
            bool last = k + 1 == one->count;
            snprintf(label, sizeof label, "%.3g%s%s", one->y[k], last && one->name[0] ? ", " : "", last ? one->name : "");
            if ((one->count <= MOST_NUMBERS && series_count == 1) || last)
                put_dot(&plot, one->x[k], one->y[k], colors[s % COLORS], false, label);
        }
    }
    if (isfinite(series->exponent))
        snprintf(caption, sizeof caption, "grows with the power %.2f%s%s", series->exponent, series->note[0] ? "; " : "",
                 series->note);
    else
        caption[0] = 0;
    end_plot(&plot, caption);
}

/* Time of a point on an axis: of a frame on the device, or of an update on one core. */
static double time_of(const ReportScene *scene, const ReportPoint *p, bool device)
{
    double sum = 0, free_frame = -1;
    for (uint32_t k = 0; k < REPORT_TASKS; k++)
        sum += p->cpu_ms[k];
    for (uint32_t i = 0; i < scene->point_count; i++)
        free_frame = scene->points[i].links == 0 && !scene->points[i].baseline ? scene->points[i].frame.median : free_frame;
    if (!device)
        return sum;
    /* What costs nothing at run time takes as long as a frame without bounce light. */
    return p->frame.median > 0 ? p->frame.median : sum == 0 ? free_frame : -1;
}

static int compare_times(const void *a, const void *b)
{
    const double *x = a, *y = b;
    return (x[0] > y[0]) - (x[0] < y[0]);
}

static void plot_front(FILE *file, const ReportScene *scene, bool device)
{
    Plot plot = {.file = file};
    double x[REPORT_POINTS], y[REPORT_POINTS], line[REPORT_POINTS][2], least = INFINITY;
    uint32_t count = 0;
    for (uint32_t i = 0; i < scene->point_count; i++) {
        x[i] = time_of(scene, &scene->points[i], device), y[i] = scene->points[i].indirect.relrmse;
        least = x[i] > 0 ? fmin(least, x[i]) : least;
    }
    for (uint32_t i = 0; i < scene->point_count; i++)
        x[i] = x[i] == 0 && scene->points[i].baseline ? least / 2 : x[i]; /* for nothing: at the left edge */
    find_range(&plot, 0, x, scene->point_count);
    find_range(&plot, 1, y, scene->point_count);
    begin_plot(&plot, device ? "Error against frame time" : "Error against update time, one core",
               device ? "frame with moving lights on the device, ms (median)" : "update of bounce light on one core, ms",
               "relRMSE of indirect");
    for (uint32_t i = 0; i < scene->point_count; i++) {
        if (device ? scene->points[i].front : scene->points[i].links && !scene->points[i].baseline)
            line[count][0] = x[i], line[count++][1] = y[i];
    }
    qsort(line, count, sizeof *line, compare_times);
    if (device && count) {
        fputs("<path fill=\"none\" stroke=\"#0a7\" stroke-dasharray=\"5 3\" d=\"", file);
        for (uint32_t i = 0; i < count; i++)
            fprintf(file, "%c%.1f %.1f", i ? 'L' : 'M', place(&plot, 0, line[i][0]), place(&plot, 1, line[i][1]));
        fputs("\"/>", file);
    }
    for (uint32_t i = 0; i < scene->point_count; i++) {
        if (x[i] > 0 && y[i] > 0)
            expect_dot(&plot, x[i], y[i]);
    }
    for (uint32_t i = 0; i < scene->point_count; i++) {
        const ReportPoint *p = &scene->points[i];
        if (x[i] > 0 && y[i] > 0)
            put_dot(&plot, x[i], y[i], p->chosen ? "#d97706" : p->baseline ? "#999" : "#2667b5", p->chosen, p->name);
    }
    end_plot(&plot, device ? "Green: the front. Orange: the default. Grey: baselines, drawn at the time of a frame without "
                             "bounce light."
                           : "Grey: baselines; those that cost nothing stand at the left edge.");
}

static void plot_causes(FILE *file, const ReportScene *scene)
{
    const int row = 26, left = 370, width = 130;
    double most = 1e-9;
    int height = row * (int)scene->cause_count + 34;
    for (uint32_t k = 0; k < scene->cause_count; k++)
        most = fmax(most, scene->causes[k].relrmse);
    fprintf(file, "<figure><svg width=\"%d\" height=\"%d\" viewBox=\"0 0 %d %d\" role=\"img\"><text class=\"title\" x=\"8\" "
                  "y=\"16\">Error by cause, default settings</text>", WIDTH, height, WIDTH, height);
    for (uint32_t k = 0; k < scene->cause_count; k++) {
        int y = 26 + row * (int)k;
        double bar = width * scene->causes[k].relrmse / most;
        fprintf(file, "<text x=\"%d\" y=\"%d\" text-anchor=\"end\">", left - 6, y + 15);
        put_text(file, scene->causes[k].name);
        fprintf(file, "</text><rect x=\"%d\" y=\"%d\" width=\"%.1f\" height=\"18\" fill=\"%s\"/>", left, y + 1, bar,
                k + 1 == scene->cause_count ? "#d97706" : "#7aa6d8");
        fprintf(file, "<text x=\"%.1f\" y=\"%d\">%.4f</text>", left + bar + 5, y + 15, scene->causes[k].relrmse);
    }
    fputs("</svg><figcaption>relRMSE of indirect. Independent causes add up by their squares.</figcaption></figure>\n",
          file);
}

/* ---- pictures ----------------------------------------------------------------------------------------------------- */

static void put_base64(FILE *file, const unsigned char *bytes, size_t count)
{
    static const char digits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    for (size_t i = 0; i < count; i += 3) {
        unsigned long word = (unsigned long)bytes[i] << 16;
        word |= i + 1 < count ? (unsigned long)bytes[i + 1] << 8 : 0;
        word |= i + 2 < count ? bytes[i + 2] : 0;
        fputc(digits[word >> 18 & 63], file);
        fputc(digits[word >> 12 & 63], file);
        fputc(i + 1 < count ? digits[word >> 6 & 63] : '=', file);
        fputc(i + 2 < count ? digits[word & 63] : '=', file);
    }
}

static void put_picture(FILE *file, const Report *report, const ReportPicture *picture)
{
    char path[REPORT_PATH];
    ChiaroIoError error;
    ChiaroIoFile png;
    snprintf(path, sizeof path, "%s/.picture.png", report->folder);
    if (!chiaro_io_write_png(path, &picture->image, &error) || !chiaro_io_map(path, &png, &error))
        options_fail(&report->options, CHIARO_EXIT_INPUT, "%s", error.message);
    fputs("<figure><img alt=\"", file);
    put_text(file, picture->title);
    fputs("\" src=\"data:image/png;base64,", file);
    put_base64(file, png.data, png.size);
    fputs("\"><figcaption>", file);
    put_text(file, picture->title);
    fputs("</figcaption></figure>\n", file);
    chiaro_io_unmap(&png);
    remove(path);
}

/* ---- tables ------------------------------------------------------------------------------------------------------- */

static void put_number(FILE *file, const char *format, double value)
{
    fputs("<td>", file);
    if (isfinite(value) && value >= 0)
        fprintf(file, format[0] == '0' ? "%.0f" : format[0] == '1' ? "%.1f" : format[0] == '2' ? "%.2f" : "%.4f", value);
    fputs("</td>", file);
}

/* A row of a table: it begins with the settings, and has times and errors. */
static void begin_row(FILE *file, const ReportPoint *p)
{
    fprintf(file, "<tr class=\"%s%s%s\"><td>", p->chosen ? "chosen " : "", p->front ? "front " : "",
            p->baseline ? "baseline" : "");
    put_text(file, p->name);
    fputs("</td>", file);
}

static void put_times(FILE *file, const ReportPoint *p)
{
    put_number(file, "2", p->frame.median);
    put_number(file, "2", p->frame.p95);
    put_number(file, "2", p->update.median);
    put_number(file, "2", p->update.p95);
}

static void put_errors(FILE *file, const Metrics *metrics)
{
    put_number(file, "4", metrics->relrmse);
    put_number(file, "4", metrics->mean_ratio);
    put_number(file, "4", metrics->p99);
}

static void put_table(FILE *file, const ReportScene *scene)
{
    fputs("<table><tr><th>settings</th><th>K</th><th>samples</th><th>receivers</th><th>bake, s</th><th>KiB</th>"
          "<th>frame, ms</th><th>p95</th><th>update, ms</th><th>p95</th><th>one core: light</th><th>means</th>"
          "<th>gather samples</th><th>gather receivers</th><th>indirect relRMSE</th><th>mean ratio</th><th>p99</th>"
          "<th>full relRMSE</th><th>mean ratio</th></tr>\n", file);
    for (uint32_t i = 0; i < scene->point_count; i++) {
        const ReportPoint *p = &scene->points[i];
        begin_row(file, p);
        put_number(file, "0", p->links ? (double)p->links : (double)NAN);
        put_number(file, "0", p->samples ? (double)p->samples : (double)NAN);
        put_number(file, "0", p->receivers ? (double)p->receivers : (double)NAN);
        put_number(file, "1", p->bake_s > 0 ? p->bake_s : (double)NAN);
        put_number(file, "0", p->bytes / 1024);
        put_times(file, p);
        /* What was not timed has no time. */
        const double *ms = p->cpu_ms, core = time_of(scene, p, false) > 0 ? 1 : (double)NAN;
        put_number(file, "2", core * ms[0]);
        put_number(file, "2", core * (ms[1] + ms[3]));
        put_number(file, "2", core * ms[2]);
        put_number(file, "2", core * ms[4]);
        put_errors(file, &p->indirect);
        put_number(file, "4", p->full.relrmse);
        put_number(file, "4", p->full.mean_ratio);
        fputs("</tr>\n", file);
    }
    fputs("</table>\n", file);
}

static void begin_table(FILE *file, const char *const *heads, size_t count)
{
    fputs("<table><tr>", file);
    for (size_t k = 0; k < count; k++)
        fprintf(file, "<th>%s</th>", heads[k]);
    fputs("</tr>\n", file);
}

static void put_object_table(FILE *file, const ReportScene *scene)
{
    static const char *const heads[] = {"settings", "frame, ms", "p95", "update() on the CPU, ms", "p95", "KiB",
                                        "objects: relRMSE", "mean ratio", "p99", "at rest", "whole picture: relRMSE",
                                        "mean ratio", "changes"};
    fputs("<h3>Objects that move</h3>\n<p>Indirect light against the truth of the same frame: of the pixels that show an "
          "object, the same once everything rests, and of the whole picture. Last, how far the picture at rest is from the "
          "default's: what the setting is good for.</p>\n", file);
    begin_table(file, heads, sizeof heads / sizeof *heads);
    for (uint32_t i = 0; i < scene->object_count; i++) {
        const ReportPoint *p = &scene->objects[i];
        begin_row(file, p);
        put_times(file, p);
        put_number(file, "0", p->bytes / 1024);
        put_errors(file, &p->objects);
        put_number(file, "4", p->rest);
        put_number(file, "4", p->indirect.relrmse);
        put_number(file, "4", p->indirect.mean_ratio);
        put_number(file, "4", p->changed);
        fputs("</tr>\n", file);
    }
    fputs("</table>\n", file);
}

static void put_motion_table(FILE *file, const ReportScene *scene)
{
    static const char *const heads[] = {"budget", "frame, ms", "p95", "update on the device, ms", "p95",
                                        "update() on the CPU, ms", "age, frames", "relRMSE", "with nothing late",
                                        "for being late"};
    fprintf(file, "<h3>Lights and objects that move under a budget</h3>\n<p>The module runs as in a game; indirect light of "
                  "each frame against the truth of that frame (noise %.4f), the same with nothing late, and one against the "
                  "other: the error for being late. Age: of the oldest light that is shown. Lights go round small circles: "
                  "who is late by more than half a turn may look less late than he is.</p>\n", scene->motion_noise);
    begin_table(file, heads, sizeof heads / sizeof *heads);
    for (uint32_t i = 0; i < scene->motion_count; i++) {
        const ReportPoint *p = &scene->motion[i];
        begin_row(file, p);
        put_times(file, p);
        put_number(file, "2", p->cpu_ms[0]);
        put_number(file, "1", p->age);
        put_number(file, "4", p->indirect.relrmse);
        put_number(file, "4", p->rest);
        put_number(file, "4", p->changed);
        fputs("</tr>\n", file);
    }
    fputs("</table>\n", file);
}

/* An error without that of the truth: independent, they add up by their squares. What is less than a quarter of the noise
 * is not known, nor what is less than rounding. */
static double without_noise(double relrmse, double noise)
{
    return sqrt(fmax(relrmse * relrmse - noise * noise, fmax(noise * noise / 16, 1e-8)));
}

/* A sum of samples that are not there: the article has nothing to say about such a scene. */
static const double NOTHING_SEEN = 0.99;

/* Nothing, if nothing of this kind was seen. */
static void put_moving(FILE *file, const char *what, const Metrics *ours, const Metrics *constant, double noise)
{
    if (isfinite(ours->relrmse))
        fprintf(file, "<li>%s: %.4f (noise %.4f); the best constant of the moment: <b>%.1f times</b> as much without that "
                      "noise.</li>", what, ours->relrmse, noise,
                without_noise(constant->relrmse, noise) / without_noise(ours->relrmse, noise));
}

/* What the page is for: how much better than what costs nothing, and than the article's own form. */
static void put_verdict(FILE *file, const ReportScene *scene)
{
    const ReportPoint *chosen = &scene->points[0], *free_of_cost = NULL, *literal = NULL, *cheapest = NULL;
    for (uint32_t i = 0; i < scene->point_count; i++) {
        const ReportPoint *p = &scene->points[i];
        if (p->baseline && time_of(scene, p, false) == 0 &&
            (!free_of_cost || p->indirect.relrmse < free_of_cost->indirect.relrmse))
            free_of_cost = p;
        if (strcmp(p->group, "literal") == 0 && (!literal || p->indirect.relrmse < literal->indirect.relrmse))
            literal = p;
    }
    for (uint32_t i = 0; literal && i < scene->point_count; i++) {
        const ReportPoint *p = &scene->points[i];
        if (!p->baseline && time_of(scene, p, false) > 0 && p->indirect.relrmse <= literal->indirect.relrmse &&
            (!cheapest || time_of(scene, p, false) < time_of(scene, cheapest, false)))
            cheapest = p;
    }
    fputs("<ul>", file);
    double noise = scene->noise[CHIARO_COMPONENT_INDIRECT];
    if (free_of_cost)
        fprintf(file, "<li>Default: relRMSE of indirect %.4f (noise of the truth %.4f); the best that costs nothing, "
                      "<i>%s</i>: %.4f. Without that noise <b>%.1f times</b> as much.</li>", chosen->indirect.relrmse, noise,
                free_of_cost->name, free_of_cost->indirect.relrmse,
                without_noise(free_of_cost->indirect.relrmse, noise) / without_noise(chosen->indirect.relrmse, noise));
    if (literal && cheapest && literal->indirect.relrmse < NOTHING_SEEN)
        fprintf(file, "<li>The article literally comes to %.4f at best (K = %u, %.2f ms on one core); <i>%s</i> is at least "
                      "as good at %.2f ms: <b>%.1f times</b> cheaper.</li>", literal->indirect.relrmse, literal->links,
                time_of(scene, literal, false), cheapest->name, time_of(scene, cheapest, false),
                time_of(scene, literal, false) / time_of(scene, cheapest, false));
    if (scene->object_count) {
        const ReportPoint *first = &scene->objects[0], *constant = &scene->objects[scene->object_count - 1];
        put_moving(file, "While objects move", &first->indirect, &constant->indirect, scene->moment_noise);
        put_moving(file, "The same where an object is seen", &first->objects, &constant->objects, scene->object_noise);
    }
    fputs("</ul>\n", file);
}

static void put_lamp_table(FILE *file, const ReportScene *scene)
{
    static const char *const heads[] = {"one lamp elsewhere", "places", "relRMSE, median", "worst", "mean ratio"};
    fputs("<h3>Lamps where nobody hung one</h3>\n<p>What one lamp's light comes to by bounces, at receivers that see the "
          "lamp, default settings on one core; the noise of the truth is taken off.</p>\n", file);
    begin_table(file, heads, sizeof heads / sizeof *heads);
    for (uint32_t k = 0; k < REPORT_LAMPS; k++) {
        const ReportLamps *lamps = &scene->lamps[k];
        fprintf(file, "<tr><td>%s</td>", lamps->name);
        put_number(file, "0", lamps->count);
        put_number(file, "4", lamps->median);
        put_number(file, "4", lamps->worst);
        put_number(file, "4", lamps->mean_ratio);
        fputs("</tr>\n", file);
    }
    fputs("</table>\n", file);
}

/* Numbers of any size, such as a count or nothing at all. */
static void put_any(FILE *file, double value)
{
    if (isfinite(value))
        fprintf(file, "<td>%.4g</td>", value);
    else
        fputs("<td></td>", file);
}

static void put_claims_table(FILE *file, const Report *report)
{
    static const char *const heads[] = {"key", "what the README says", "claimed", "measured", "", "holds"};
    fputs("<h2>What the README claims</h2>\n", file);
    begin_table(file, heads, sizeof heads / sizeof *heads);
    for (uint32_t k = 0; k < REPORT_CLAIMS; k++) {
        const ReportClaim *claim = &report_claims[k];
        double measured = report->measured[k];
        fprintf(file, "<tr><td>[%s]</td><td class=\"text\">", claim->key);
        put_text(file, claim->says);
        fputs("</td>", file);
        put_any(file, claim->claimed);
        put_any(file, measured);
        fputs("<td class=\"text\">", file);
        put_text(file, claim->unit);
        fprintf(file, "</td><td>%s</td></tr>\n", !isfinite(measured)         ? "not measured here"
                                                  : !isfinite(claim->claimed) ? ""
                                                  : report_claim_holds(claim, measured) ? "yes" : "<b>no</b>");
    }
    fputs("</table>\n", file);
}

static void put_scaling_table(FILE *file, const Report *report)
{
    fputs("<table><tr><th>cost</th><th>power</th><th>from</th><th>to</th><th></th></tr>\n", file);
    for (uint32_t k = 0; k < report->series_count; k++) {
        const ReportSeries *s = &report->series[k];
        if (s->count == 0)
            continue;
        fputs("<tr><td>", file);
        put_text(file, s->title);
        fprintf(file, "</td><td>%.2f</td><td>%g: %.3g %s</td><td>%g: %.3g %s</td><td>", s->exponent, s->x[0], s->y[0],
                s->y_label, s->x[s->count - 1], s->y[s->count - 1], s->y_label);
        put_text(file, s->note);
        fputs("</td></tr>\n", file);
    }
    fputs("</table>\n", file);
}

void report_write_html(FILE *file, const Report *report)
{
    fprintf(file, "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>Chiaro: error against run time"
                  "</title><style>%s</style></head><body>\n<h1>Error against run time</h1>\n<p>", style);
    put_text(file, report->device);
    fprintf(file, "; pictures %u x %u%s. Errors are relative to a path tracer; no error below its own noise means anything. "
                  "Bakes of a scene are timed by turns, frame by frame, after a warm-up.</p>\n", report->options.width,
            report->options.height, report->quick ? "; quick: small bakes, few paths" : "");
    for (uint32_t s = 0; s < report->scene_count; s++) {
        const ReportScene *scene = &report->scenes[s];
        fputs("<h2>", file);
        put_text(file, scene->input);
        fputs("</h2>\n", file);
        put_verdict(file, scene);
        fputs("<div class=\"pictures\">\n", file);
        for (uint32_t k = 0; k < scene->picture_count; k++)
            put_picture(file, report, &scene->pictures[k]);
        fputs("</div><div class=\"plots\">\n", file);
        plot_front(file, scene, true);
        plot_front(file, scene, false);
        plot_causes(file, scene);
        plot_series(file, scene->budgets, REPORT_SPEEDS);
        plot_series(file, scene->frames, REPORT_BUDGETS);
        fputs("</div>\n", file);
        put_table(file, scene);
        if (scene->object_count)
            put_object_table(file, scene);
        if (scene->motion_count)
            put_motion_table(file, scene);
        if (scene->lamps[0].name)
            put_lamp_table(file, scene);
    }
    put_claims_table(file, report);
    if (report->series_count) {
        fputs("<h2>How cost grows</h2>\n", file);
        put_scaling_table(file, report);
        fputs("<div class=\"plots\">\n", file);
        for (uint32_t k = 0; k < report->series_count; k++)
            plot_series(file, &report->series[k], 1);
        fputs("</div>\n", file);
    }
    fputs("</body></html>\n", file);
}
