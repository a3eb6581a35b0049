/* What stands in the way: form factors of spheres, discs and nodes against closed forms and sums by brute force, and
 * several blockers together against rays. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "common/elements.h"
#include "common/geometry.h"

/* ------------------------------------------------------------------------------------------------------------------
 * Form factors
 */

static void spheres_have_the_forms_of_the_table(void **state)
{
    (void)state;
    const float point[3] = {0, 0, 0}, normal[3] = {0, 0, 1};
    static const double table[][2] = {{1.3, 0.110726754}, {0.49, 0.263520136}, {0.3, 0.266637407},
                                      {0, 0.166943493}, {-0.2, 0.053022820}, {-0.5, 0}, {-2, 0}};
    for (size_t i = 0; i < sizeof table / sizeof *table; i++) {
        float center[3] = {0.6f, 0, (float)table[i][0]};
        assert_near("height", table[i][0], (double)chiaro_sphere_form(point, normal, center, 0.5f), table[i][1], 2e-7);
    }
}

/* Share of cosine-weighted directions over a receiver that hit one of several spheres. */
static double sphere_truth(const float point[3], const float normal[3], const float (*centers)[4], uint32_t count,
                           uint32_t steps)
{
    uint32_t hits = 0;
    for (uint32_t k = 0; k < steps * steps; k++) {
        float u = ((float)(k % steps) + 0.5f) / (float)steps, v = ((float)(k / steps) + 0.5f) / (float)steps;
        Vec3 d = vec3_cosine_direction(vec3_load(normal), u, v);
        for (uint32_t i = 0; i < count; i++) {
            Vec3 way = vec3_sub(vec3_load(centers[i]), vec3_load(point));
            float along = vec3_dot(way, d), radius = centers[i][3];
            if (along > 0 && vec3_dot(way, way) - along * along < radius * radius) {
                hits++;
                break;
            }
        }
    }
    return (double)hits / (steps * steps);
}

static void spheres_have_the_forms_that_rays_find(void **state)
{
    (void)state;
    ChiaroRandom random = chiaro_random_seed(20, 1);
    uint32_t crossing = 0;
    for (int k = 0; k < 300; k++) {
        float point[3] = {1, 2, 3}, normal[3], sphere[1][4];
        vec3_store(normal, random_direction(&random));
        Vec3 way = vec3_scale(random_direction(&random), 1 + 2 * chiaro_random_float(&random));
        vec3_store(sphere[0], vec3_add(vec3_load(point), way));
        sphere[0][3] = 0.95f * chiaro_random_float(&random);
        crossing += fabsf(vec3_dot(vec3_load(normal), way)) < sphere[0][3];
        assert_near("sphere", k, (double)chiaro_sphere_form(point, normal, sphere[0], sphere[0][3]),
                    sphere_truth(point, normal, (const float (*)[4])sphere, 1, 256), 0.004);
    }
    assert_in_range(crossing, 30, 200);
}

static void nothing_jumps_where_a_sphere_touches_or_sets(void **state)
{
    (void)state;
    const float point[3] = {0, 0, 0}, normal[3] = {0, 1, 0};
    for (int degrees = 0; degrees <= 180; degrees += 5) {
        float angle = (float)degrees * CHIARO_PI / 180, before = -1;
        for (float distance = 3; distance > 0; distance -= 0.0005f) {
            float center[3] = {distance * sinf(angle), distance * cosf(angle), 0};
            float form = chiaro_sphere_form(point, normal, center, 1);
            assert_true(form >= 0 && form <= 1);
            /* The steepest is the grazing sphere at contact, as the square root of the gap. */
            if (before >= 0)
                assert_near("degrees", degrees, (double)form, (double)before, 0.03);
            before = form;
        }
    }
    for (float scale = 1e-6f; scale < 1e7f; scale *= 10) {
        float center[3] = {0.6f * scale, 0.3f * scale, 0};
        assert_near("scale", (double)scale, (double)chiaro_sphere_form(point, normal, center, 0.5f * scale),
                    0.266637407, 1e-6);
        float facing[3] = {0, 1, 0};
        assert_near("disc, scale", (double)scale, (double)chiaro_disc_form(point, normal, center, facing, 0.5f * scale),
                    0.5 * (1 - (0.36 + 0.09 - 0.25) / sqrt(pow(0.36 + 0.09 + 0.25, 2) - 4 * 0.25 * 0.36)), 0.004);
    }
}

/* Parallel: 1/2 [1 - (a^2 + h^2 - R^2) / sqrt((a^2 + h^2 + R^2)^2 - 4 R^2 a^2)]. */
static void parallel_discs_have_the_closed_form(void **state)
{
    (void)state;
    const float point[3] = {0, 0, 0}, normal[3] = {0, 0, 1}, facing[3] = {0, 0, -1};
    double worst = 0;
    for (double h = 0.02; h < 100; h *= 1.7) {
        for (double a = 0; a < 5; a += 0.23) {
            float center[3] = {0, (float)a, (float)h};
            double s = a * a + h * h, truth = 0.5 * (1 - (s - 0.49) / sqrt((s + 0.49) * (s + 0.49) - 4 * 0.49 * a * a));
            double form = (double)chiaro_disc_form(point, normal, center, facing, 0.7f);
            /* Just over the rim, a sixteenth of it is a chord: there alone it shows. */
            worst = fmax(worst, fabs(form - truth) / fmax(1, fabs(truth)));
            if (h > 0.1)
                assert_near("height", h, form, truth, 0.004);
        }
    }
    print_message("parallel disc: at most %.4f wrong, right above the rim\n", worst);
    assert_near("on the table", 0, (double)chiaro_disc_form(point, normal, (float[3]){0.5f, 0, 1}, facing, 0.7f),
                0.261454069, 5e-4);
}

static void turned_discs_have_the_forms_that_sums_find(void **state)
{
    (void)state;
    ChiaroRandom random = chiaro_random_seed(21, 1);
    double worst = 0;
    uint32_t crossing = 0;
    for (int k = 0; k < 400; k++) {
        float point[3] = {-1, 0, 2}, normal[3], facing[3], center[3];
        float radius = 0.1f + 1.2f * chiaro_random_float(&random);
        Vec3 n = random_direction(&random), m = random_direction(&random), u, v;
        Vec3 way = vec3_scale(random_direction(&random), 0.5f + 2 * chiaro_random_float(&random));
        /* Sums are of no use where the plane is touched. */
        if (fabsf(vec3_dot(way, m)) < 0.2f)
            continue;
        vec3_store(normal, n);
        vec3_store(facing, m);
        vec3_store(center, vec3_add(vec3_load(point), way));
        vec3_frame(m, &u, &v);
        double truth = 0;
        const uint32_t steps = 200;
        for (uint32_t i = 0; i < steps * steps; i++) {
            float r = radius * sqrtf(((float)(i % steps) + 0.5f) / (float)steps);
            float phi = 2 * CHIARO_PI * ((float)(i / steps) + 0.5f) / (float)steps;
            Vec3 p = vec3_mad(vec3_mad(way, u, r * cosf(phi)), v, r * sinf(phi));
            double d = (double)vec3_length(p), c = (double)vec3_dot(n, p), s = (double)fabsf(vec3_dot(m, p));
            truth += fmax(0, c) * s / (d * d * d * d) * (double)(radius * radius) / (steps * steps);
        }
        crossing += fabsf(vec3_dot(n, way)) < 0.7f * radius;
        double form = (double)chiaro_disc_form(point, normal, center, facing, radius);
        worst = fmax(worst, fabs(form - truth));
        assert_near("disc", k, form, truth, 0.004);
    }
    print_message("turned discs: at most %.4f wrong\n", worst);
    assert_in_range(crossing, 40, 300);
}

static void far_discs_are_points(void **state)
{
    (void)state;
    const float point[3] = {0, 0, 0}, normal[3] = {0, 1, 0};
    ChiaroRandom random = chiaro_random_seed(22, 1);
    for (int k = 0; k < 200; k++) {
        /* On both sides of the distance where the law changes. */
        float facing[3], inner[3], outer[3];
        Vec3 d = vec3_normalize(vec3_add(random_direction(&random), vec3(0, 1.2f, 0)));
        vec3_store(facing, random_direction(&random));
        vec3_store(inner, vec3_scale(d, 31.9f));
        vec3_store(outer, vec3_scale(d, 32.1f));
        double near_form = (double)chiaro_disc_form(point, normal, inner, facing, 1);
        double far_form = (double)chiaro_disc_form(point, normal, outer, facing, 1);
        assert_near("form", k, far_form * (32.1 * 32.1) / (31.9 * 31.9), near_form, 0.003 * near_form + 3e-6);
    }
}

static void nodes_have_the_form_of_what_they_stand_for(void **state)
{
    (void)state;
    ChiaroRandom random = chiaro_random_seed(23, 1);
    Object sphere = make_sphere(vec3(0, 0, 0), 1, 2000), plate = object_begin(400);
    add_rectangle(&plate, vec3(0, 0, 0), vec3(0, 0, 0.886227f), vec3(0.886227f, 0, 0), 20, grey);
    object_build(&plate);
    const float center[3] = {0, 0, 0}, up[3] = {0, 1, 0};
    for (int k = 0; k < 300; k++) {
        float point[3], normal[3];
        vec3_store(point, vec3_scale(random_direction(&random), 1.5f + 3 * chiaro_random_float(&random)));
        vec3_store(normal, random_direction(&random));
        double form = (double)chiaro_primitive_form(&sphere.tree.nodes[0], point, normal);
        assert_near("sphere", k, form, (double)chiaro_sphere_form(point, normal, center, 1), 0.003);
        form = (double)chiaro_primitive_form(&plate.tree.nodes[0], point, normal);
        double truth = point[1] > 0 ? (double)chiaro_disc_form(point, normal, center, up, 1) : 0;
        assert_near("plate", k, form, truth, 1e-4);
    }
    object_end(&sphere);
    object_end(&plate);
}

/* Light that arrives from a glowing sphere: the same from its root, and summed over the nodes of a walk. */
static void nodes_send_what_the_whole_sends(void **state)
{
    (void)state;
    Object sphere = make_sphere(vec3(0, 3, 0), 1, 2000);
    const float point[3] = {0.5f, 0, 0}, normal[3] = {0, 1, 0}, center[3] = {0, 3, 0};
    double truth = (double)chiaro_sphere_form(point, normal, center, 1);
    static const float spans[] = {3, 0.4f, 0.2f, 0.1f};
    for (int s = 0; s < 4; s++) {
        double sum = 0;
        ChiaroPrimitiveWalk walk = chiaro_primitive_walk_begin(&sphere.tree, point, spans[s]);
        for (uint32_t n; (n = chiaro_primitive_walk_next(&walk)) != CHIARO_NONE;)
            sum += (double)chiaro_primitive_form(&sphere.tree.nodes[n], point, normal);
        print_message("sphere in nodes of up to %.1f rad: form %.4f of %.4f\n", (double)spans[s], sum, truth);
        assert_near("span", (double)spans[s], sum, truth, 0.03 * truth);
    }
    object_end(&sphere);
}

/* ------------------------------------------------------------------------------------------------------------------
 * Several in the way
 */

/* Balls over a floor, some in front of others, against rays; beside them what the two simple rules give: all as
 * independent (product), and all as apart (sum). */
static void blockers_together_take_what_rays_say(void **state)
{
    (void)state;
    ChiaroRandom random = chiaro_random_seed(30, 1);
    double square = 0, product_square = 0, sum_square = 0, mean = 0, worst = 0, worst_product = 0;
    const int cases = 400;
    for (int k = 0; k < cases; k++) {
        const float point[3] = {0, 0, 0}, normal[3] = {0, 1, 0};
        float spheres[8][4];
        ChiaroBlocker blockers[8];
        uint32_t count = 2 + (uint32_t)k % 7;
        double product = 1, sum = 0, largest = 0;
        for (uint32_t i = 0; i < count; i++) {
            Vec3 way = random_direction(&random);
            way.y = fabsf(way.y);
            float distance = 1.2f + 5 * chiaro_random_float(&random);
            vec3_store(spheres[i], vec3_scale(way, distance));
            spheres[i][3] = fminf(distance - 0.1f, 0.3f + 1.5f * chiaro_random_float(&random));
            blockers[i] = chiaro_sphere_blocker(point, normal, spheres[i], spheres[i][3]);
            product *= 1 - (double)blockers[i].form;
            sum += (double)blockers[i].form;
            largest = fmax(largest, (double)blockers[i].form);
        }
        double truth = sphere_truth(point, normal, (const float (*)[4])spheres, count, 128);
        double together = (double)chiaro_blockers_combine(blockers, count);
        assert_true(together >= largest - 1e-6 && together <= fmin(1, sum) + 1e-6);
        worst = fmax(worst, fabs(together - truth)), worst_product = fmax(worst_product, fabs(1 - product - truth));
        square += pow(together - truth, 2) / cases, mean += (together - truth) / cases;
        product_square += pow(1 - product - truth, 2) / cases, sum_square += pow(fmin(1, sum) - truth, 2) / cases;
    }
    print_message("blockers together: rms %.4f, mean %+.4f, worst %.4f; product rms %.4f, worst %.4f; sum rms %.4f\n",
                  sqrt(square), mean, worst, sqrt(product_square), worst_product, sqrt(sum_square));
    assert_below("rms", 0, sqrt(square), 0.03);
    assert_below("worst", 0, worst, 0.15);
    assert_below("against the product", 0, sqrt(square), sqrt(product_square));
}

static void blockers_apart_add_and_behind_another_do_not(void **state)
{
    (void)state;
    const float point[3] = {0, 0, 0}, normal[3] = {0, 1, 0};
    const float left[3] = {-3, 3, 0}, right[3] = {3, 3, 0}, behind[3] = {6, 6, 0};
    ChiaroBlocker a = chiaro_sphere_blocker(point, normal, left, 1), b = chiaro_sphere_blocker(point, normal, right, 1);
    ChiaroBlocker c = chiaro_sphere_blocker(point, normal, behind, 1.5f);
    assert_near("apart", 0, (double)chiaro_blockers_combine((ChiaroBlocker[2]){a, b}, 2), (double)(a.form + b.form),
                1e-7);
    assert_near("behind", 0, (double)chiaro_blockers_combine((ChiaroBlocker[2]){b, c}, 2), (double)b.form, 1e-6);
    assert_near("twice", 0, (double)chiaro_blockers_combine((ChiaroBlocker[2]){b, b}, 2), (double)b.form, 1e-6);
    assert_true(chiaro_blockers_combine(NULL, 0) == 0);
}

static void the_order_of_blockers_cannot_be_seen(void **state)
{
    (void)state;
    ChiaroRandom random = chiaro_random_seed(31, 1);
    const float point[3] = {0, 0, 0}, normal[3] = {0, 1, 0};
    ChiaroBlocker blockers[40], turned[40];
    for (uint32_t i = 0; i < 40; i++) {
        float center[3];
        vec3_store(center, vec3_scale(random_direction(&random), 3));
        blockers[i] = i % 5 == 4 ? blockers[i - 1] : chiaro_sphere_blocker(point, normal, center, 1);
        turned[39 - i] = blockers[i];
    }
    for (uint32_t count = 1; count <= 40; count++)
        assert_true(chiaro_blockers_combine(blockers, count) == chiaro_blockers_combine(turned + 40 - count, count));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(spheres_have_the_forms_of_the_table),
        cmocka_unit_test(spheres_have_the_forms_that_rays_find),
        cmocka_unit_test(nothing_jumps_where_a_sphere_touches_or_sets),
        cmocka_unit_test(parallel_discs_have_the_closed_form),
        cmocka_unit_test(turned_discs_have_the_forms_that_sums_find),
        cmocka_unit_test(far_discs_are_points),
        cmocka_unit_test(nodes_have_the_form_of_what_they_stand_for),
        cmocka_unit_test(nodes_send_what_the_whole_sends),
        cmocka_unit_test(blockers_together_take_what_rays_say),
        cmocka_unit_test(blockers_apart_add_and_behind_another_do_not),
        cmocka_unit_test(the_order_of_blockers_cannot_be_seen),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
