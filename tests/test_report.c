/* What a report makes of its figures: the front, the choice for a budget, powers, and files that stand by themselves; and
 * how objects move in it. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <ctype.h>
#include <string.h>

#include "../samples/common/report_objects.h"
#include "../samples/common/scenes.h"
#include "common/check.h"
#include "common/out.h"

#define FOLDER OUT "report"

static void add(ReportScene *scene, const char *group, const char *name, uint32_t links, double ms, double error)
{
    ReportPoint *p = &scene->points[scene->point_count++];
    *p = report_new_point(group, name);
    p->links = links, p->samples = 2000, p->receivers = 4000, p->asked_samples = 1000 + links;
    p->frame = (ReportTiming){ms, ms}, p->indirect.relrmse = error, p->baseline = ms < 0;
}

/* One scene with a name that no format takes as it is. */
static Report made_report(ReportScene *scene)
{
    Report report = {.options = {.program = "test"}, .folder = FOLDER, .scenes = scene, .scene_count = 1};
    *scene = (ReportScene){.input = "some/a \"b\", <c> & d.glb"};
    report.options.width = 4, report.options.height = 3;
    add(scene, "default", "default", 32, 10, 0.05);
    add(scene, "links", "cheap", 8, 4, 0.2);
    add(scene, "links", "worse than default", 16, 11, 0.06);
    add(scene, "links", "dear", 128, 30, 0.04);
    add(scene, "features", "off", 0, 3, 1);
    add(scene, "features", "no shadows, by luck the best", 32, 5, 0.01);
    add(scene, "baseline", "constant", 0, -1, 0.5);
    scene->points[0].chosen = true;
    scene->budgets[0] = (ReportSeries){.count = 2, .x = {1, 4}, .y = {0.1, 0.2}, .exponent = (double)NAN};
    scene->frames[0] = (ReportSeries){.count = 2, .x = {0, 1}, .y = {0.1, 0.2}, .exponent = (double)NAN};
    report_find_front(scene);
    return report;
}

static void the_front_holds_what_nothing_beats(void **state)
{
    (void)state;
    ReportScene *scene = new_array(1, sizeof *scene);
    made_report(scene);
    const bool front[] = {true, true, false, true, true, false, false};
    for (uint32_t i = 0; i < scene->point_count; i++)
        assert_int_equal(scene->points[i].front, front[i]);
    assert_string_equal(report_suggest(scene, 10)->name, "default");
    assert_string_equal(report_suggest(scene, 9.9)->name, "cheap");
    assert_string_equal(report_suggest(scene, 1000)->name, "dear");
    assert_string_equal(report_suggest(scene, 3.5)->name, "off");
    assert_null(report_suggest(scene, 2));
    free(scene);
}

static void a_power_is_found(void **state)
{
    (void)state;
    ReportSeries series = {.count = 4};
    for (uint32_t i = 0; i < 4; i++)
        series.x[i] = pow(3, i), series.y[i] = 0.5 * pow(series.x[i], 1.7);
    report_fit(&series);
    assert_near("power", 1.7, series.exponent, 1.7, 1e-9);
    series.count = 1;
    report_fit(&series);
    assert_true(isnan(series.exponent));
}

static const ReportPlace place = {"elsewhere/a \"b\", <c> & d.glb", 4, 3};

static void the_choice_is_read_back_from_the_file(void **state)
{
    (void)state;
    ReportScene *scene = new_array(1, sizeof *scene);
    Report report = made_report(scene);
    ReportPoint choice;
    const char *fault;
    report_write(&report);
    for (double budget = 2; budget < 100; budget *= 1.1) {
        const ReportPoint *wanted = report_suggest(scene, budget);
        bool found = report_read_choice(FOLDER "/report.csv", &place, budget, &choice, &fault);
        assert_int_equal(found, wanted != NULL);
        if (!found)
            continue;
        assert_string_equal(choice.name, wanted->name);
        assert_int_equal(choice.links, wanted->links);
        assert_int_equal(choice.asked_samples, wanted->asked_samples);
    }
    assert_false(report_read_choice(FOLDER "/none.csv", &place, 12, &choice, &fault));
    assert_string_equal(fault, "cannot be read");
    assert_false(report_read_choice(FOLDER "/index.html", &place, 12, &choice, &fault));
    assert_string_equal(fault, "is no report.csv of chiaro-report");
    free(scene);
}

static void a_choice_is_for_the_scene_and_the_size_that_were_measured(void **state)
{
    (void)state;
    ReportScene *scene = new_array(1, sizeof *scene);
    Report report = made_report(scene);
    const ReportPlace other = {"other.glb", 4, 3}, larger = {place.input, 8, 6};
    ReportPoint choice;
    const char *fault;
    report_write(&report);
    assert_false(report_read_choice(FOLDER "/report.csv", &other, 12, &choice, &fault));
    assert_string_equal(fault, "says nothing about this scene");
    assert_false(report_read_choice(FOLDER "/report.csv", &larger, 12, &choice, &fault));
    assert_string_equal(fault, "was measured at another --size");
    assert_false(report_read_choice(FOLDER "/report.csv", &place, 2, &choice, &fault));
    assert_string_equal(fault, "holds no settings that fit the budget");
    free(scene);
}

/* How often a word stands in a file. */
static uint32_t count_in(const char *path, const char *word)
{
    ChiaroIoFile file;
    ChiaroIoError error;
    uint32_t count = 0;
    assert_true(chiaro_io_map(path, &file, &error));
    char *text = new_array(file.size, 1);
    memcpy(text, file.data, file.size);
    for (const char *at = text; (at = strstr(at, word)) != NULL; at++)
        count++;
    chiaro_io_unmap(&file);
    free(text);
    return count;
}

static void numbers_in_the_csv_have_no_exponents(void **state)
{
    (void)state;
    ReportScene *scene = new_array(1, sizeof *scene);
    Report report = made_report(scene);
    ReportPoint choice;
    const char *fault;
    scene->points[0].indirect.relrmse = 1.59993353e-05, scene->points[0].bytes = 12345678912.0;
    report_write(&report);
    assert_int_equal(count_in(FOLDER "/report.csv", ",0.0000159993353,"), 1);
    assert_int_equal(count_in(FOLDER "/report.csv", ",12345678912,"), 1);
    assert_true(report_read_choice(FOLDER "/report.csv", &place, 12, &choice, &fault));
    assert_near("error", 0, choice.indirect.relrmse, 1.59993353e-05, 1e-14);
    free(scene);
}

static void every_file_has_every_row(void **state)
{
    (void)state;
    ReportScene *scene = new_array(2, sizeof *scene);
    Report report = made_report(scene);
    scene[1] = *scene, scene[1].input = "another.glb", scene[1].points[0].frame.median = 7;
    report.scene_count = 2;
    scene->lamps[0] = (ReportLamps){.name = "a lamp", .count = 3, .median = 0.1, .worst = 0.2, .mean_ratio = 1};
    report.measured[CLAIM_PLUGIN] = 123.456;
    report_write(&report);
    uint32_t rows = 2 * scene->point_count + 2 + REPORT_CLAIMS;
    ReportPoint choice;
    const char *fault;
    assert_int_equal(count_in(FOLDER "/report.csv", "\n"), 1 + rows);
    assert_int_equal(count_in(FOLDER "/report.json", "\"group\""), rows);
    assert_int_equal(count_in(FOLDER "/report.csv", "scene,group,name"), 1);
    assert_int_equal(count_in(FOLDER "/report.csv", "a lamp, worst of 3"), 1);
    assert_int_equal(count_in(FOLDER "/index.html", "<h2>another.glb</h2>"), 1);
    /* Each scene has a choice of its own. */
    const ReportPlace other = {"another.glb", 4, 3};
    assert_true(report_read_choice(FOLDER "/report.csv", &place, 8, &choice, &fault));
    assert_string_equal(choice.name, "cheap");
    assert_true(report_read_choice(FOLDER "/report.csv", &other, 8, &choice, &fault));
    assert_string_equal(choice.name, "default");
    for (uint32_t k = 0; k < REPORT_CLAIMS; k++) {
        char row[REPORT_TEXT], shown[REPORT_TEXT];
        snprintf(row, sizeof row, "\"claim\",\"%s\"", report_claims[k].key);
        snprintf(shown, sizeof shown, "<td>[%s]</td>", report_claims[k].key);
        assert_int_equal(count_in(FOLDER "/report.csv", row), 1);
        assert_int_equal(count_in(FOLDER "/index.html", shown), 1);
    }
    char plugin[REPORT_TEXT];
    snprintf(plugin, sizeof plugin, ",%g,123.456\n", report_claims[CLAIM_PLUGIN].claimed);
    assert_int_equal(count_in(FOLDER "/report.csv", plugin), 1);
    assert_int_equal(count_in(FOLDER "/index.html", "<td>123.5</td>"), 1);
    free(scene);
}

static void objects_take_their_part_of_a_budget(void **state)
{
    (void)state;
    ReportScene *scene = new_array(1, sizeof *scene);
    Report report = made_report(scene);
    ReportPoint choice;
    const char *fault;
    scene->objects[0] = report_new_point("objects", "default");
    scene->objects[0].frame = (ReportTiming){15, 15}, scene->objects[0].chosen = true;
    scene->objects[0].objects.relrmse = 0.1;
    scene->objects[1] = report_new_point("objects", "dearer");
    scene->objects[1].frame = (ReportTiming){40, 40};
    scene->object_count = 2;
    report_write(&report);
    assert_string_equal(report_suggest(scene, 15)->name, "default");
    assert_string_equal(report_suggest(scene, 14.9)->name, "cheap");
    assert_true(report_read_choice(FOLDER "/report.csv", &place, 14.9, &choice, &fault));
    assert_string_equal(choice.name, "cheap");
    free(scene);
}

static void the_page_needs_nothing_else(void **state)
{
    (void)state;
    ReportScene *scene = new_array(1, sizeof *scene);
    Report report = made_report(scene);
    float *pixels = new_array(48, sizeof *pixels);
    scene->picture_count = 1;
    scene->pictures[0] = (ReportPicture){.title = "p", .image = {4, 4, 3, pixels}};
    report_write(&report);
    ChiaroIoFile file;
    ChiaroIoError error;
    assert_true(chiaro_io_map(FOLDER "/index.html", &file, &error));
    char *page = new_array(file.size, 1);
    memcpy(page, file.data, file.size);
    assert_non_null(strstr(page, "<svg"));
    assert_non_null(strstr(page, "data:image/png;base64,iVBORw0KGgo"));
    assert_non_null(strstr(page, "a &quot;b&quot;, &lt;c&gt; &amp; d.glb"));
    assert_null(strstr(page, "http"));
    assert_null(strstr(page, "<script"));
    assert_null(strstr(page, "nan"));
    assert_null(strstr(page, "inf,"));
    chiaro_io_unmap(&file);
    free(page);
    free(pixels);
    free(scene);
}

/* Two balls and a box in the Cornell box: the balls 10 cm apart, the box 20 cm from a wall. */
static void the_truth_has_objects_where_the_module_has_them_and_none_meet(void **state)
{
    (void)state;
    Report report = {.options = {.program = "test", .added_count = 3,
                                 .added = {{"sphere", {2, 1, 1}, 0.6f}, {"sphere", {2.7f, 1, 1}, 0.6f},
                                           {"box", {4.8f, 3, 3}, 0.8f}}}};
    const SceneRequest request = {0};
    const char *fault;
    TestScene made;
    ChiaroBlob blob;
    ChiaroTransport transport;
    const ChiaroBakeDesc desc = {.struct_size = sizeof desc, .samples = 64, .rays = 16, .receivers = 64};
    const MovingDesc moving_desc = {0};
    Moving moving;
    MergedScene merged;
    assert_true(scenes_make("cornell", &request, &made, &fault));
    ReportScene *scene = new_array(1, sizeof *scene);
    scene->read.scene = made.scene;
    assert_int_equal(chiaro_bake(&made.scene, &desc, &blob), CHIARO_OK);
    assert_int_equal(chiaro_transport_open(blob.data, blob.size, &transport, NULL), CHIARO_OK);
    moving_open(&report.options, &scene->read, &transport, &moving_desc, &moving);
    float radius = report_object_circle(&moving, 5.5f);
    assert_true(radius > 0.03f && radius <= 0.05001f);
    for (float turn = 0; turn < 6; turn += 0.7f) {
        moving_pose(&report.options, &moving, 0, radius, turn);
        report_merge(&report, scene, &moving, radius, turn, &merged);
        const ChiaroVertex *vertex = merged.scene.vertices + made.scene.vertex_count;
        for (uint32_t i = 0; i < moving.objects.count; i++) {
            Vec3 sum = vec3(0, 0, 0);
            uint32_t count = moving.objects.list[i].scene->vertex_count;
            for (uint32_t v = 0; v < count; v++, vertex++)
                sum = vec3_mad(sum, vec3_load(vertex->position), 1 / (float)count);
            assert_below("an object's place", i, (double)vec3_length(vec3_sub(sum, moving.poses[i].center)), 0.01);
        }
        Vec3 gap = vec3_sub(moving.poses[0].center, moving.poses[1].center);
        assert_true(vec3_length(gap) > 0.6f);
        objects_free_merged(&merged);
    }
    moving_close(&moving);
    chiaro_blob_free(&blob);
    scenes_free(&made);
    free(scene);
}

/* In an empty box light comes out right, and what glows there is not in it; a wrong albedo shows. */
static void lamps_elsewhere_are_held_against_the_truth(void **state)
{
    (void)state;
    const SceneRequest request = {.has_albedo = true, .albedo = 0.5f};
    const ChiaroBakeDesc desc = {.struct_size = sizeof desc, .samples = 1024, .rays = 256, .receivers = 512};
    Report report = {.options = {.program = "test", .quiet = true}, .quick = true};
    const char *fault;
    TestScene made;
    ChiaroBlob blob;
    ChiaroTransport transport;
    ChiaroRays *rays;
    assert_true(scenes_make("furnace", &request, &made, &fault));
    ReportScene *scene = new_array(1, sizeof *scene);
    scene->read.scene = made.scene;
    assert_int_equal(chiaro_rays_create(&made.scene, NULL, &rays), CHIARO_OK);
    assert_int_equal(chiaro_bake(&made.scene, &desc, &blob), CHIARO_OK);
    assert_int_equal(chiaro_transport_open(blob.data, blob.size, &transport, NULL), CHIARO_OK);
    report.measured[CLAIM_LAMPS] = (double)NAN;
    report_lamps(&report, scene, &transport, rays, 1);
    for (uint32_t k = 0; k < REPORT_LAMPS; k++) {
        const ReportLamps *lamps = &scene->lamps[k];
        printf("  %s: median %.4f, worst %.4f, ratio %.4f\n", lamps->name, lamps->median, lamps->worst,
               lamps->mean_ratio);
        assert_int_equal(lamps->count, 16);
        assert_true(lamps->median > 0 && lamps->worst >= lamps->median);
    }
    /* Near a wall, which is half a patch away, it is the bake that is judged. */
    assert_below("median", 0, scene->lamps[0].median, 0.1);
    assert_near("mean ratio", 0, scene->lamps[0].mean_ratio, 1, 0.03);
    assert_near("row", 0, report.measured[CLAIM_LAMPS], 100 * scene->lamps[REPORT_LAMPS - 1].median, 1e-9);
    /* The same links beside another truth. */
    ChiaroMaterial *darker = new_array(made.scene.material_count, sizeof *darker);
    memcpy(darker, made.scene.materials, made.scene.material_count * sizeof *darker);
    for (uint32_t m = 0; m < made.scene.material_count; m++)
        darker[m].albedo[0] = 0.25f;
    scene->read.scene.materials = darker;
    report_lamps(&report, scene, &transport, rays, 1);
    assert_true(scene->lamps[0].median > 0.2 && scene->lamps[0].mean_ratio > 1.1);
    chiaro_blob_free(&blob);
    chiaro_rays_destroy(rays);
    scenes_free(&made);
    free(darker);
    free(scene);
}

/* ---- what the README says ----------------------------------------------------------------------------------------- */

/* The README with single spaces. */
static char *read_readme(void)
{
    ChiaroIoFile file;
    ChiaroIoError error;
    assert_true(chiaro_io_map("README.md", &file, &error));
    char *text = new_array(file.size, 1), *out = text;
    const char *in = file.data;
    for (size_t i = 0; i < file.size; i++) {
        bool space = isspace((unsigned char)in[i]);
        if (!space || (out > text && out[-1] != ' '))
            *out++ = space ? ' ' : in[i];
    }
    chiaro_io_unmap(&file);
    return text;
}

/* Every claim stands there, with its key; every key there is one of a claim. */
static void every_claim_of_the_readme_is_a_row(void **state)
{
    (void)state;
    char *text = read_readme(), wanted[256];
    for (uint32_t k = 0; k < REPORT_CLAIMS; k++) {
        const ReportClaim *claim = &report_claims[k];
        snprintf(wanted, sizeof wanted, "%s [%s]", claim->says, claim->key);
        if (!strstr(text, wanted))
            fail_msg("the README does not say: %s", wanted);
        assert_int_equal(isnan(claim->claimed), k == CLAIM_LAMPS);
    }
    for (const char *at = text; (at = strchr(at, '[')) != NULL; at++) {
        size_t length = strspn(at + 1, "abcdefghijklmnopqrstuvwxyz-");
        bool known = at[length + 1] != ']' || length == 0;
        for (uint32_t k = 0; k < REPORT_CLAIMS && !known; k++)
            known = strlen(report_claims[k].key) == length && strncmp(report_claims[k].key, at + 1, length) == 0;
        if (!known)
            fail_msg("no row of the report is called %.*s", (int)length + 2, at);
    }
    free(text);
}

/* True if what begins at `at` lies within a claim. */
static bool is_claimed(const char *text, const char *at)
{
    bool inside = false;
    for (uint32_t k = 0; k < REPORT_CLAIMS; k++) {
        const char *says = strstr(text, report_claims[k].says);
        inside |= says && at >= says && at < says + strlen(report_claims[k].says);
    }
    return inside;
}

/* A number with a unit that is measured is no row by accident. */
static void no_figure_of_the_readme_is_without_a_row(void **state)
{
    (void)state;
    static const char *const units[] = {" %", " KiB", " MiB", " cm", " degrees", " ms", " s ", " minutes", " lines",
                                        " times"};
    char *text = read_readme();
    uint32_t figures = 0;
    for (const char *at = text; *at; at++) {
        bool begins = isdigit((unsigned char)*at) && (at == text || !isalnum((unsigned char)at[-1]));
        const char *end = at + strspn(at, "0123456789.,");
        for (size_t k = 0; begins && k < sizeof units / sizeof *units; k++) {
            if (strncmp(end, units[k], strlen(units[k])) != 0)
                continue;
            figures++;
            if (!is_claimed(text, at))
                fail_msg("no row of the report says: %.60s", at);
        }
    }
    assert_true(figures >= 6);
    free(text);
}

static void claims_about_the_house_hold(void **state)
{
    (void)state;
    Report *report = new_array(1, sizeof *report);
    report->options = (SceneOptions){.program = "test", .quiet = true};
    report->quick = true;
    for (uint32_t k = 0; k < REPORT_CLAIMS; k++)
        report->measured[k] = (double)NAN;
    report_measure_claims(report);
    for (uint32_t k = 0; k < REPORT_CLAIMS; k++) {
        bool of_scenes = k == CLAIM_IDLE || k == CLAIM_LAMPS;
        printf("  %-12s claimed %6.4g, measured %8.4g\n", report_claims[k].key, report_claims[k].claimed,
               report->measured[k]);
        assert_int_equal(isnan(report->measured[k]), of_scenes);
#ifndef NDEBUG
        of_scenes |= k == CLAIM_PLUGIN; /* sizes of other configurations are nobody's */
#endif
        assert_true(of_scenes || report_claim_holds(&report_claims[k], report->measured[k]));
    }
    free(report);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_front_holds_what_nothing_beats),
        cmocka_unit_test(a_power_is_found),
        cmocka_unit_test(the_choice_is_read_back_from_the_file),
        cmocka_unit_test(a_choice_is_for_the_scene_and_the_size_that_were_measured),
        cmocka_unit_test(numbers_in_the_csv_have_no_exponents),
        cmocka_unit_test(every_file_has_every_row),
        cmocka_unit_test(objects_take_their_part_of_a_budget),
        cmocka_unit_test(the_truth_has_objects_where_the_module_has_them_and_none_meet),
        cmocka_unit_test(the_page_needs_nothing_else),
        cmocka_unit_test(lamps_elsewhere_are_held_against_the_truth),
        cmocka_unit_test(every_claim_of_the_readme_is_a_row),
        cmocka_unit_test(no_figure_of_the_readme_is_without_a_row),
        cmocka_unit_test(claims_about_the_house_hold),
    };
    return cmocka_run_group_tests(tests, make_folder, NULL);
}
