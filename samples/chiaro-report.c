/* Error against run time of any scene: a page, a table, and the settings that fit a budget. */
#include "common/json.h"
#include "common/report.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const char help[] =
    "Usage: chiaro-report SCENE.(gltf|glb)... -o FOLDER [options]\n"
    "Bakes, renders and traces scenes with many settings in one run, and writes FOLDER/index.html, report.csv and\n"
    "report.json: error against frame time, error by cause, lights and objects that move under a budget, baselines, how\n"
    "cost grows. The files are written anew after each part: if it is interrupted, what was finished is there.\n"
    "  --quick         small bakes, few paths: minutes instead of hours\n"
    "  --no-sweep      bakes no other settings of the static scene than the default and the most links\n"
    "  --no-scaling    leaves out how cost grows\n"
    "  --device N|NAME which Vulkan device\n"
    "  --suggest MS    prints, for each scene, the settings with the least error whose frame takes at most so long here\n";

static Report take_options(int argc, char **argv)
{
    Report report = {.options = {.program = "chiaro-report", .usage = help}};
    SceneOptions *options = &report.options;
    bool sweep = true, scaling = true;
    report.scenes = report_alloc(&report, (size_t)argc, sizeof *report.scenes);
    for (int i = 1; i < argc; i++) {
        if (argv[i][0] != '-')
            report.scenes[report.scene_count++].input = argv[i];
        else if (strcmp(argv[i], "--quick") == 0)
            report.quick = true;
        else if (strcmp(argv[i], "--no-sweep") == 0)
            sweep = false;
        else if (strcmp(argv[i], "--no-scaling") == 0)
            scaling = false;
        else if (strcmp(argv[i], "--device") == 0)
            report.device_name = options_text(options, argc, argv, &i);
        else if (strcmp(argv[i], "--suggest") == 0)
            report.suggest_ms = (double)options_float(options, argc, argv, &i, 0.001f, 1e6f);
        else if (!options_take(options, argc, argv, &i))
            options_fail(options, CHIARO_EXIT_USAGE, "unknown word '%s'", argv[i]);
    }
    if (report.scene_count == 0)
        options_fail(options, CHIARO_EXIT_USAGE, "which scene?");
    if (!options->output || strlen(options->output) > REPORT_PATH / 2)
        options_fail(options, CHIARO_EXIT_USAGE, "-o FOLDER is missing, or too long");
    report.folder = options->output;
    report.sweep = sweep, report.scaling = scaling;
    for (uint32_t k = 0; k < REPORT_CLAIMS; k++)
        report.measured[k] = (double)NAN;
    return report;
}

/* As options of chiaro-render; what is left to the scene has none. */
static void suggest(const Report *report)
{
    for (uint32_t s = 0; s < report->scene_count; s++) {
        const ReportScene *scene = &report->scenes[s];
        const ReportPoint *p = report_suggest(scene, report->suggest_ms);
        if (!p) {
            printf("%s: nothing fits %.3g ms here\n", scene->input, report->suggest_ms);
            continue;
        }
        const struct {
            const char *name;
            uint32_t value;
        } options[] = {{"links", p->links}, {"samples", p->asked_samples}, {"receivers", p->asked_receivers},
                       {"rays", p->asked_rays}};
        printf("%s: %s:", scene->input, p->name);
        for (size_t k = 0; k < sizeof options / sizeof *options && p->links > 0; k++) {
            if (options[k].value > 0)
                printf(" --%s %u", options[k].name, options[k].value);
        }
        printf("%s; %.2f ms, relRMSE of indirect %.4f\n", p->links ? "" : " --gi off",
               report_frame_ms(scene, p), p->indirect.relrmse);
    }
}

/* Where the files are, and what of the README does not hold here. */
static void tell(const Report *report)
{
    uint32_t broken = 0;
    for (uint32_t k = 0; k < REPORT_CLAIMS; k++) {
        double claimed = report_claims[k].claimed, measured = report->measured[k];
        if (!isfinite(claimed) || !isfinite(measured) || report_claim_holds(&report_claims[k], measured))
            continue;
        broken++;
        if (!report->options.json)
            printf("does not hold here: %s [%s]: %.4g\n", report_claims[k].says, report_claims[k].key, measured);
    }
    if (!report->options.json) {
        printf("%s/index.html\n", report->folder);
        return;
    }
    Json json = json_begin(stdout);
    json_text(&json, "folder", report->folder);
    json_text(&json, "device", report->device);
    json_number(&json, "scenes", report->scene_count);
    json_number(&json, "claims_broken", broken);
    json_end(&json);
}

static void release(Report *report)
{
    for (uint32_t s = 0; s < report->scene_count; s++) {
        ReportScene *scene = &report->scenes[s];
        for (int c = 0; c < CHIARO_COMPONENT_COUNT; c++)
            free(scene->truth[c].pixels);
        for (uint32_t k = 0; k < scene->picture_count; k++)
            free(scene->pictures[k].image.pixels);
        free(scene->lights);
        chiaro_io_free_scene(&scene->read);
    }
    free(report->scenes);
    free((void *)(uintptr_t)report->sky.radiance);
}

int main(int argc, char **argv)
{
    Report report = take_options(argc, argv);
    Progress heard;
    progress_begin(&heard, report.options.program, true); /* before threads are: signals are for the steps to hear */
    if (!options_sky(&report.options, &report.sky))
        return CHIARO_EXIT_INPUT;
    const uint32_t scene_count = report.scene_count;
    for (report.scene_count = 0; report.scene_count < scene_count;) {
        ReportScene *scene = &report.scenes[report.scene_count];
        report.options.input = scene->input;
        report.scene_count++;
        report_scene(&report, scene);
        report_write(&report);
    }
    report_measure_claims(&report);
    report_write(&report);
    if (report.scaling) {
        report_scaling(&report, &report.scenes[0]);
        report_write(&report);
    }
    if (report.suggest_ms > 0 && !report.options.json)
        suggest(&report);
    if (report.options.json || (!report.options.quiet && report.suggest_ms == 0))
        tell(&report);
    release(&report);
    progress_end(&heard);
    return CHIARO_EXIT_OK;
}
