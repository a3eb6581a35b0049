/* Primitives against closed forms: spheres, plates and boxes as they look and shine, what opens when, and neighbours as
 * lights. Where there is no closed form, the truth is summed here, by brute force. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <string.h>

#include "common/elements.h"
#include "common/geometry.h"

static Object make_box(Vec3 x, Vec3 y, Vec3 z, uint32_t steps)
{
    Object object = object_begin(6 * steps * steps);
    add_rectangle(&object, x, y, z, steps, grey);
    add_rectangle(&object, vec3_scale(x, -1), z, y, steps, grey);
    add_rectangle(&object, y, z, x, steps, grey);
    add_rectangle(&object, vec3_scale(y, -1), x, z, steps, grey);
    add_rectangle(&object, z, x, y, steps, grey);
    add_rectangle(&object, vec3_scale(z, -1), y, x, steps, grey);
    object_build(&object);
    return object;
}

static double projected_area(const ChiaroPrimitive *node, Vec3 d)
{
    float direction[3];
    vec3_store(direction, d);
    return (double)chiaro_primitive_projected_area(node, direction);
}

/* The green channel, for irradiance 1. */
static double reflected(const ChiaroPrimitive *node, Vec3 light, Vec3 viewer)
{
    const float one[3] = {1, 1, 1};
    float toward_light[3], toward_viewer[3], intensity[3];
    vec3_store(toward_light, light);
    vec3_store(toward_viewer, viewer);
    chiaro_primitive_reflect(node, toward_light, one, toward_viewer, intensity);
    return (double)intensity[1];
}

/* What the elements of an object do: the truth for every node above them. */
static double element_area(const Object *object, Vec3 d)
{
    double sum = 0;
    for (uint32_t i = 0; i < object->count; i++) {
        const ChiaroElement *e = &object->elements[i];
        sum += (double)(e->area * fmaxf(0, vec3_dot(vec3_load(e->normal), d)));
    }
    return sum;
}

static double element_reflected(const Object *object, Vec3 light, Vec3 viewer)
{
    double sum = 0;
    for (uint32_t i = 0; i < object->count; i++) {
        const ChiaroElement *e = &object->elements[i];
        Vec3 n = vec3_load(e->normal);
        sum += (double)(e->area * e->albedo[1] * fmaxf(0, vec3_dot(n, light)) * fmaxf(0, vec3_dot(n, viewer))) / pi;
    }
    return sum;
}

/* What a Lambert sphere does, as a share of rho r^2 E: 2 / (3 pi) (sin a + (pi - a) cos a). */
static double lambert_sphere(double angle) { return 2 / (3 * pi) * (sin(angle) + (pi - angle) * cos(angle)); }

static double angle_between(Vec3 a, Vec3 b) { return acos(fmax(-1, fmin(1, (double)vec3_dot(a, b)))); }

/* ------------------------------------------------------------------------------------------------------------------
 * Sphere, plate, box
 */

static void a_sphere_looks_the_same_from_everywhere(void **state)
{
    (void)state;
    Object sphere = make_sphere(vec3(3, -2, 5), 2, 600);
    ChiaroRandom random = chiaro_random_seed(1, 1);
    assert_int_equal(sphere.tree.nodes[0].form, CHIARO_PRIMITIVE_AXES);
    for (int i = 0; i < 1000; i++)
        assert_near("projected area", i, projected_area(&sphere.tree.nodes[0], random_direction(&random)), 4 * pi,
                    0.005 * 4 * pi);
    object_end(&sphere);
}

static void a_sphere_is_lit_as_a_lambert_sphere(void **state)
{
    (void)state;
    Object sphere = make_sphere(vec3(0, 0, 0), 1, 600);
    ChiaroRandom random = chiaro_random_seed(2, 1);
    double worst = 0;
    for (int i = 0; i < 2000; i++) {
        Vec3 light = random_direction(&random), viewer = random_direction(&random);
        double angle = angle_between(light, viewer), truth = 0.5 * lambert_sphere(angle);
        double value = reflected(&sphere.tree.nodes[0], light, viewer);
        worst = fmax(worst, fabs(value - truth));
        assert_near("phase angle", angle, value, truth, 0.01 * 0.5 * 2 / 3);
    }
    print_message("sphere: at most %.2g of the full phase wrong\n", worst / (0.5 * 2 / 3));
    object_end(&sphere);
}

static void a_plate_is_its_cosines(void **state)
{
    (void)state;
    ChiaroRandom random = chiaro_random_seed(3, 1);
    for (int k = 0; k < 20; k++) {
        Vec3 n = random_direction(&random), u, v;
        vec3_frame(n, &u, &v);
        Object plate = object_begin(64);
        add_rectangle(&plate, vec3(1, 2, 3), vec3_scale(u, 2), vec3_scale(v, 0.5f), 8, grey);
        object_build(&plate);
        const ChiaroPrimitive *root = &plate.tree.nodes[0];
        assert_below("error", k, (double)root->error, 1e-4);
        for (int i = 0; i < 200; i++) {
            Vec3 light = random_direction(&random), viewer = random_direction(&random);
            double a = fmax(0, (double)vec3_dot(n, light)), b = fmax(0, (double)vec3_dot(n, viewer));
            assert_near("projected area", k, projected_area(root, viewer), 4 * b, 1e-5);
            assert_near("reflected", k, reflected(root, light, viewer), 4 * 0.5 / pi * a * b, 1e-5);
        }
        object_end(&plate);
    }
}

/* A cap of a sphere: one normal and a cone about it, up to an eighth of the sphere and a little more. */
static void a_curved_piece_is_a_cone_of_normals(void **state)
{
    (void)state;
    ChiaroRandom random = chiaro_random_seed(24, 1);
    double worst_area = 0, worst_light = 0;
    for (int k = 0; k < 12; k++) {
        Vec3 axis = random_direction(&random);
        float edge = cosf((float)(10 + 3 * k) * CHIARO_PI / 180);
        Object cap = object_begin(4000);
        for (uint32_t i = 0; i < 4000; i++) {
            Vec3 n = spiral(i, 4000);
            if (vec3_dot(n, axis) > edge)
                object_add(&cap, n, n, 4 * CHIARO_PI / 4000, grey);
        }
        object_build(&cap);
        const ChiaroPrimitive *root = &cap.tree.nodes[0];
        assert_int_equal(root->form, CHIARO_PRIMITIVE_DOT);
        double full_area = element_area(&cap, axis), full_light = element_reflected(&cap, axis, axis);
        for (int i = 0; i < 300; i++) {
            Vec3 light = random_direction(&random), viewer = random_direction(&random);
            double area = fabs(projected_area(root, viewer) - element_area(&cap, viewer)) / full_area;
            double shine = fabs(reflected(root, light, viewer) - element_reflected(&cap, light, viewer)) / full_light;
            assert_below("projected area", 10 + 3 * k, area, 0.015);
            assert_below("reflected", 10 + 3 * k, shine, 0.04);
            worst_area = fmax(worst_area, area), worst_light = fmax(worst_light, shine);
        }
        object_end(&cap);
    }
    print_message("caps up to 43 degrees: area at most %.4f, light at most %.4f of the most wrong\n", worst_area,
                  worst_light);
}

static void a_box_along_the_axes_is_its_faces(void **state)
{
    (void)state;
    Object box = make_box(vec3(1, 0, 0), vec3(0, 0.3f, 0), vec3(0, 0, 2), 4);
    const ChiaroPrimitive *root = &box.tree.nodes[0];
    ChiaroRandom random = chiaro_random_seed(4, 1);
    assert_int_equal(root->form, CHIARO_PRIMITIVE_AXES);
    assert_below("error", 0, (double)root->error, 1e-4);
    for (int i = 0; i < 1000; i++) {
        Vec3 d = random_direction(&random), light = random_direction(&random);
        double area = 4 * ((double)fabsf(d.x) * 0.6 + (double)fabsf(d.y) * 2 + (double)fabsf(d.z) * 0.3);
        assert_near("projected area", i, projected_area(root, d), area, 1e-4);
        assert_near("reflected", i, reflected(root, light, d), element_reflected(&box, light, d), 1e-4);
    }
    object_end(&box);
}

/* Turned, the root is wrong and says so; opened down to its faces it is exact again. */
static void a_turned_box_opens_into_its_faces(void **state)
{
    (void)state;
    ChiaroRandom random = chiaro_random_seed(5, 1);
    double worst_root = 0;
    uint32_t most_used = 0;
    for (int k = 0; k < 20; k++) {
        Vec3 x = random_direction(&random), y, z;
        vec3_frame(x, &y, &z);
        Object box = make_box(x, vec3_scale(y, 0.5f), vec3_scale(z, 2), 4);
        Vec3 d = random_direction(&random), light = random_direction(&random);
        double area = 0, light_sum = 0;
        uint32_t used = 0;
        /* The largest nodes that say they are exact. */
        for (uint32_t n = 0; n < box.tree.node_count;) {
            const ChiaroPrimitive *node = &box.tree.nodes[n];
            if (node->error < 1e-3f) {
                area += projected_area(node, d), light_sum += reflected(node, light, d);
                used++, n = node->next;
            } else {
                n++;
            }
        }
        most_used = used > most_used ? used : most_used;
        assert_near("projected area", k, area, element_area(&box, d), 1e-3);
        assert_near("reflected", k, light_sum, element_reflected(&box, light, d), 1e-3);
        worst_root = fmax(worst_root, (double)box.tree.nodes[0].error);
        object_end(&box);
    }
    print_message("turned boxes: roots are up to %.3f wrong (rms) and say so; at most %u nodes are exact\n", worst_root,
                  most_used);
    assert_in_range(most_used, 6, 12);
    assert_true(worst_root > 0.02 && worst_root < 0.5);
}

/* A handful of random discs: no form fits. */
static Object make_blob(uint32_t seed, uint32_t count)
{
    ChiaroRandom random = chiaro_random_seed(seed, 77);
    Object blob = object_begin(count);
    for (uint32_t i = 0; i < count; i++) {
        Vec3 position = vec3_scale(random_direction(&random), 3), normal = random_direction(&random);
        float area = 0.1f * chiaro_random_float(&random);
        Vec3 albedo = {chiaro_random_float(&random), chiaro_random_float(&random), chiaro_random_float(&random)};
        object_add(&blob, position, normal, area, albedo);
    }
    object_build(&blob);
    return blob;
}

/* Cauchy: the mean projected area is a quarter of the surface. The mean of reflected light, over all directions of
 * light and viewer, is a sixteenth of area * albedo / pi. Open shapes gain a little where a negative area is cut off:
 * most of all plates, which have a form of their own. */
static void no_form_makes_or_loses_light(void **state)
{
    (void)state;
    double most_gained = 0;
    for (uint32_t k = 0; k < 12; k++) {
        Object blob = make_blob(k, 3 + 5 * k);
        for (uint32_t n = 0; n < blob.tree.node_count; n += 1 + n / 4) {
            ChiaroPrimitive node = blob.tree.nodes[n];
            bool plate = node.form == CHIARO_PRIMITIVE_DOT;
            double area = 0, light = 0, given = 0;
            for (uint32_t i = 0; i < node.count; i++) {
                const ChiaroElement *e = &blob.elements[blob.tree.elements[node.first + i]];
                given += (double)(e->area * e->albedo[1]) / pi;
            }
            node.form = CHIARO_PRIMITIVE_AXES;
            const uint32_t steps = 120;
            for (uint32_t i = 0; i < steps * steps; i++) {
                Vec3 d = spiral(i % steps, steps);
                area += projected_area(&node, d) / (steps * steps);
                light += reflected(&node, spiral(i / steps, steps), d) / (steps * steps);
            }
            double gained = area / ((double)node.area / 4) - 1;
            most_gained = plate ? most_gained : fmax(most_gained, gained);
            assert_true(gained > -0.01);
            assert_below(plate ? "gained by a plate" : "gained", n, gained, plate ? 0.15 : 0.08);
            assert_near("reflected", n, light, given / 16, 0.02 * given / 16);
        }
        object_end(&blob);
    }
    print_message("six axes: mean projected area at most %.4f too large\n", most_gained);
}

static void the_error_that_a_node_states_is_what_it_has(void **state)
{
    (void)state;
    ChiaroRandom random = chiaro_random_seed(7, 1);
    for (uint32_t k = 0; k < 8; k++) {
        Object blob = make_blob(100 + k, 4 + 6 * k);
        double wrong[2] = {0, 0}, right[2] = {0, 0};
        for (int i = 0; i < 4000; i++) {
            Vec3 viewer = random_direction(&random), light = random_direction(&random);
            double area = element_area(&blob, viewer), a = projected_area(&blob.tree.nodes[0], viewer) - area;
            wrong[0] += a * a, right[0] += area * area;
            double truth = element_reflected(&blob, light, viewer);
            double b = reflected(&blob.tree.nodes[0], light, viewer) - truth;
            wrong[1] += b * b, right[1] += truth * truth;
        }
        double error = sqrt(fmax(wrong[0] / right[0], wrong[1] / right[1]));
        /* Luminance there, green here; 64 directions there. */
        assert_near("stated error", k, (double)blob.tree.nodes[0].error, error, 0.25 * error);
        object_end(&blob);
    }
}

static void an_object_has_another_colour_from_another_side(void **state)
{
    (void)state;
    const Vec3 red = {0.8f, 0, 0}, blue = {0, 0, 0.8f};
    const float one[3] = {1, 1, 1}, right[3] = {1, 0, 0}, left[3] = {-1, 0, 0};
    Object ball = object_begin(400);
    for (uint32_t i = 0; i < 400; i++) {
        Vec3 n = spiral(i, 400);
        object_add(&ball, n, n, 4 * CHIARO_PI / 400, n.x > 0 ? red : blue);
    }
    object_build(&ball);
    float intensity[3];
    chiaro_primitive_reflect(&ball.tree.nodes[0], right, one, right, intensity);
    assert_near("red", 0, (double)intensity[0], 0.8 * 2 / 3, 0.01);
    assert_near("blue", 0, (double)intensity[2], 0, 0.01);
    chiaro_primitive_reflect(&ball.tree.nodes[0], left, one, left, intensity);
    assert_near("red", 1, (double)intensity[0], 0, 0.01);
    assert_near("blue", 1, (double)intensity[2], 0.8 * 2 / 3, 0.01);
    object_end(&ball);
}

static void a_thicket_looks_no_larger_than_its_sphere(void **state)
{
    (void)state;
    Object thicket = object_begin(5000);
    ChiaroRandom random = chiaro_random_seed(8, 1);
    for (uint32_t i = 0; i < 5000; i++) {
        Vec3 p = vec3_scale(random_direction(&random), cbrtf(chiaro_random_float(&random)));
        object_add(&thicket, p, random_direction(&random), 0.01f, grey);
    }
    object_build(&thicket);
    const ChiaroPrimitive *root = &thicket.tree.nodes[0];
    for (int i = 0; i < 100; i++) {
        Vec3 d = random_direction(&random);
        double area = projected_area(root, d), most = pi * (double)(root->radius * root->radius);
        assert_below("projected area", i, area, most * 1.0001);
        assert_true(element_area(&thicket, d) > 2 * most);
        /* As bright as its elements, not brighter. */
        assert_below("radiance", i, reflected(root, d, d) / area, 0.5 / pi);
    }
    object_end(&thicket);
}

/* ------------------------------------------------------------------------------------------------------------------
 * Light that elements give off
 */

static double radiated(const Object *object, const float *axes, uint32_t n, Vec3 d)
{
    float direction[3], intensity[3];
    vec3_store(direction, d);
    chiaro_primitive_radiate(&object->tree.nodes[n], axes + 18 * (size_t)n, direction, intensity);
    return (double)intensity[1];
}

static void elements_that_glow_evenly_have_one_radiance(void **state)
{
    (void)state;
    Object objects[2] = {make_sphere(vec3(0, 0, 0), 1, 500), make_box(vec3(1, 0, 0), vec3(0, 1, 0), vec3(0, 0, 1), 3)};
    for (int k = 0; k < 2; k++) {
        const Object *object = &objects[k];
        float *radiosity = new_array(3 * object->count, sizeof(float));
        float *axes = new_array(18 * object->tree.node_count, sizeof(float));
        for (uint32_t i = 0; i < 3 * object->count; i++)
            radiosity[i] = 2;
        chiaro_primitives_sum(&object->tree, object->elements, radiosity, axes);
        for (uint32_t i = 0; i < 300; i++) {
            Vec3 d = spiral(i, 300);
            for (uint32_t n = 0; n < object->tree.node_count; n += 1 + n / 4) {
                double area = projected_area(&object->tree.nodes[n], d);
                assert_near("intensity", n, radiated(object, axes, n, d), 2 / pi * area, 1e-4 + 1e-4 * area);
            }
        }
        free(radiosity);
        free(axes);
        object_end(&objects[k]);
    }
}

/* The tree's sums of a half-lit sphere: opened further, closer to the phase function. */
static void lit_elements_shine_as_the_sphere_does(void **state)
{
    (void)state;
    Object sphere = make_sphere(vec3(0, 0, 0), 1, 2000);
    float *radiosity = new_array(3 * sphere.count, sizeof(float));
    float *axes = new_array(18 * sphere.tree.node_count, sizeof(float));
    ChiaroRandom random = chiaro_random_seed(9, 1);
    static const double allowed[] = {0.08, 0.03, 0.003};
    static const float spans[] = {3.2f, 0.5f, 0.1f};
    for (int s = 0; s < 3; s++) {
        double wrong = 0, right = 0;
        for (int k = 0; k < 40; k++) {
            Vec3 light = random_direction(&random);
            for (uint32_t i = 0; i < sphere.count; i++)
                radiosity[3 * i + 1] = 0.5f * fmaxf(0, vec3_dot(vec3_load(sphere.elements[i].normal), light));
            chiaro_primitives_sum(&sphere.tree, sphere.elements, radiosity, axes);
            for (int i = 0; i < 20; i++) {
                Vec3 d = random_direction(&random);
                float viewer[3];
                vec3_store(viewer, vec3_scale(d, 3));
                ChiaroPrimitiveWalk walk = chiaro_primitive_walk_begin(&sphere.tree, viewer, spans[s]);
                double value = 0, truth = 0.5 * lambert_sphere(angle_between(light, d));
                for (uint32_t n; (n = chiaro_primitive_walk_next(&walk)) != CHIARO_NONE;)
                    value += radiated(&sphere, axes, n, d);
                wrong += (value - truth) * (value - truth), right += truth * truth;
            }
        }
        double error = sqrt(wrong / right);
        print_message("half-lit sphere, nodes up to %.1f rad: %.4f wrong (rms)\n", (double)spans[s], error);
        assert_below("relative rms", (double)spans[s], error, allowed[s]);
    }
    free(radiosity);
    free(axes);
    object_end(&sphere);
}

/* ------------------------------------------------------------------------------------------------------------------
 * Opening
 */

static void a_walk_covers_the_object_once_with_small_nodes(void **state)
{
    (void)state;
    Object sphere = make_sphere(vec3(0, 0, 0), 1, 1000);
    uint32_t *seen = new_array(sphere.count, sizeof *seen);
    static const float spans[] = {0, 0.05f, 0.2f, 0.39f, 1, 3.14159f};
    uint32_t before = UINT32_MAX;
    for (int s = 0; s < 6; s++) {
        for (float distance = 0; distance < 200; distance = 2 * distance + 0.7f) {
            float point[3] = {0.3f * distance, 0.9f * distance, -0.3f * distance};
            uint32_t count = 0;
            memset(seen, 0, sphere.count * sizeof *seen);
            ChiaroPrimitiveWalk walk = chiaro_primitive_walk_begin(&sphere.tree, point, spans[s]);
            for (uint32_t n; (n = chiaro_primitive_walk_next(&walk)) != CHIARO_NONE; count++) {
                const ChiaroPrimitive *node = &sphere.tree.nodes[n];
                float away = vec3_length(vec3_sub(vec3_load(node->center), vec3_load(point)));
                if (node->count > 1)
                    assert_below("half angle", (double)away, asin((double)(node->radius / away)),
                                 (double)spans[s] / 2 + 1e-4);
                for (uint32_t i = 0; i < node->count; i++)
                    seen[sphere.tree.elements[node->first + i]]++;
            }
            for (uint32_t i = 0; i < sphere.count; i++)
                assert_int_equal(seen[i], 1);
            if (s == 0)
                assert_int_equal(count, sphere.count);
            if (distance > 180)
                assert_true(s == 0 || count == 1);
        }
    }
    /* Coming closer, it opens. 22.5 degrees: a texel of the article's 8 x 8 hemisphere. */
    for (float distance = 1.5f; distance < 20; distance *= 1.3f) {
        float point[3] = {0, distance, 0};
        uint32_t count = 0;
        ChiaroPrimitiveWalk walk = chiaro_primitive_walk_begin(&sphere.tree, point, 22.5f * CHIARO_PI / 180);
        while (chiaro_primitive_walk_next(&walk) != CHIARO_NONE)
            count++;
        assert_true(count <= before);
        before = count;
    }
    assert_int_equal(before, 1);
    free(seen);
    object_end(&sphere);
}

static void assert_sound_tree(const Object *object)
{
    for (uint32_t n = 0; n < object->tree.node_count; n++) {
        const ChiaroPrimitive *node = &object->tree.nodes[n];
        assert_true(isfinite(node->error) && isfinite(node->radius) && isfinite(node->projected_blend));
        if (node->count == 1) {
            assert_int_equal(node->next, n + 1);
            continue;
        }
        const ChiaroPrimitive *left = node + 1, *right = &object->tree.nodes[left->next];
        assert_int_equal(left->first, node->first);
        assert_int_equal(right->first, node->first + left->count);
        assert_int_equal(left->count + right->count, node->count);
        assert_int_equal(right->next, node->next);
    }
}

/* What splits badly: all in one place, and each far beyond the last. */
static void bad_distributions_make_sound_trees(void **state)
{
    (void)state;
    for (int k = 0; k < 3; k++) {
        Object object = object_begin(3000);
        float x = 1e-20f;
        for (uint32_t i = 0; i < 3000; i++) {
            x = k == 1 ? fminf(x * 1.02f, 1e9f) : 0;
            object_add(&object, vec3(x, 0, 0), vec3(0, 1, 0), k == 2 ? 0 : 1, grey);
        }
        object_build(&object);
        assert_sound_tree(&object);
        object_end(&object);
    }
}

static void elements_out_of_range_are_refused(void **state)
{
    (void)state;
    ChiaroElement good = {.area = 1, .normal = {0, 1, 0}, .albedo = {0.5f, 0.5f, 0.5f}}, bad;
    ChiaroPrimitive node[2];
    ChiaroPrimitives tree;
    assert_int_equal(chiaro_primitives_size(0), 0);
    assert_int_equal(chiaro_primitives_size(CHIARO_MAX_ELEMENTS + 1), 0);
    assert_int_equal(chiaro_primitives_build(&good, 1, node, sizeof node, &tree), CHIARO_OK);
    assert_int_equal(chiaro_primitives_build(&good, 1, node, sizeof *node, &tree), CHIARO_ERROR_ARGUMENT);
    assert_int_equal(chiaro_primitives_build(&good, 1, (char *)node + 1, sizeof node - 1, &tree),
                     CHIARO_ERROR_ARGUMENT);
    assert_int_equal(chiaro_primitives_build(NULL, 1, node, sizeof node, &tree), CHIARO_ERROR_ARGUMENT);
#define REFUSES(what, value)                                                                                           \
    do {                                                                                                               \
        bad = good, bad.what = value;                                                                                  \
        assert_int_equal(chiaro_primitives_build(&bad, 1, node, sizeof node, &tree), CHIARO_ERROR_ARGUMENT);           \
    } while (0)
    REFUSES(area, -1);
    REFUSES(area, NAN);
    REFUSES(normal[1], 2);
    REFUSES(position[2], INFINITY);
    REFUSES(albedo[0], 1.5f);
}

/* ------------------------------------------------------------------------------------------------------------------
 * Neighbours as lights
 */

/* The half-angle rule beside the sphere it stands for; and the article's plain product, for comparison. */
static void the_half_angle_stands_for_a_sphere(void **state)
{
    (void)state;
    const float center[3] = {1, 2, 3}, albedo[3] = {1, 0.5f, 0};
    ChiaroLight sun = {.type = CHIARO_LIGHT_SUN, .direction = {0, 0, -1}, .intensity = {1, 1, 1}};
    double worst = 0, given = 0, plain = 0;
    const uint32_t steps = 2000;
    for (uint32_t i = 0; i < steps; i++) {
        double angle = pi * (i + 0.5) / steps, ring = 2 * pi * sin(angle) * pi / steps;
        float viewer[3] = {1 + 50 * (float)sin(angle), 2, 3 + 50 * (float)cos(angle)}, intensity[3];
        chiaro_neighbour_light(center, 2, albedo, &sun, viewer, intensity);
        assert_near("albedo", angle, (double)intensity[1], (double)intensity[0] / 2, 1e-6);
        assert_true(intensity[2] == 0);
        worst = fmax(worst, fabs((double)intensity[0] / 4 - lambert_sphere(angle)));
        given += (double)intensity[0] * ring;
        plain += 4 * pow(cos(angle / 2), 2) * ring;
    }
    print_message("half angle: at most %.4f of the full phase wrong; reflects %.4f, plain product %.4f of the light\n",
                  worst / (2.0 / 3), given / (4 * pi), plain / (4 * pi));
    assert_below("phase", 0, worst / (2.0 / 3), 0.013);
    assert_near("energy", 0, given, 4 * pi, 1e-3 * 4 * pi);
    assert_near("plain product", 0, plain, 2 * 4 * pi, 1e-3 * 4 * pi);
}

static void half_angle_normals_lie_between(void **state)
{
    (void)state;
    const float x[3] = {1, 0, 0}, y[3] = {0, 1, 0}, back[3] = {-1, 0, 0};
    float n[3];
    chiaro_half_angle_normal(x, y, n);
    assert_near("x", 0, (double)n[0], sqrt(0.5), 1e-6);
    assert_near("y", 0, (double)n[1], sqrt(0.5), 1e-6);
    chiaro_half_angle_normal(x, back, n);
    assert_true(n[0] == -1 && n[1] == 0 && n[2] == 0);
}

/* However near the lamp, a ball of albedo 1 gives back what the lamp sends to it, and no more; touching or inside,
 * nothing jumps. */
static void a_lamp_gives_a_ball_what_it_sends_there(void **state)
{
    (void)state;
    const float center[3] = {0, 0, 0}, albedo[3] = {1, 1, 1};
    Object ball = make_sphere(vec3(0, 0, 0), 1, 1000);
    for (float distance = 0.125f; distance < 100; distance *= 2) {
        ChiaroLight lamp = {.type = CHIARO_LIGHT_POINT, .position = {0, distance, 0}, .intensity = {3, 3, 3}};
        double given = 0, node_given = 0, d = (double)distance;
        const uint32_t steps = 1000;
        for (uint32_t i = 0; i < steps; i++) {
            Vec3 way = spiral(i, steps);
            float viewer[3], direction[3], intensity[3];
            vec3_store(viewer, vec3_scale(way, 100));
            vec3_store(direction, way);
            chiaro_neighbour_light(center, 1, albedo, &lamp, viewer, intensity);
            given += (double)intensity[0] * 4 * pi / steps;
            chiaro_primitive_light(&ball.tree.nodes[0], &lamp, direction, intensity);
            node_given += (double)intensity[0] * 4 * pi / steps;
        }
        double truth = d > 1 ? 3 * 2 * pi * (1 - sqrt(1 - 1 / (d * d))) : 3 * 2 * pi;
        assert_near("ball", d, given, truth, 0.003 * truth);
        /* Its elements are grey, and its sphere is larger by an element. */
        assert_near("node", d, node_given, truth / 2, 0.06 * truth);
    }
    object_end(&ball);
}

static void a_lamp_lights_a_plate_by_the_law_of_samples(void **state)
{
    (void)state;
    Object plate = object_begin(1600);
    add_rectangle(&plate, vec3(0, 0, 0), vec3(0, 0, 1), vec3(1, 0, 0), 40, grey);
    object_build(&plate);
    const float up[3] = {0, 1, 0};
    for (float height = 0.25f; height < 50; height *= 2) {
        ChiaroLight lamp = {.type = CHIARO_LIGHT_POINT, .position = {0.5f, height, 0.25f}, .intensity = {1, 1, 1}};
        double truth = 0;
        for (uint32_t i = 0; i < plate.count; i++) {
            Vec3 way = vec3_sub(vec3_load(lamp.position), vec3_load(plate.elements[i].position));
            double d = (double)vec3_length(way);
            truth += (double)plate.elements[i].area * 0.5 / pi * (double)way.y / (d * d * d);
        }
        float intensity[3];
        chiaro_primitive_light(&plate.tree.nodes[0], &lamp, up, intensity);
        assert_near("height", (double)height, (double)intensity[0], truth, 0.01 * truth);
    }
    ChiaroLight below = {.type = CHIARO_LIGHT_POINT, .position = {0, -1, 0}, .intensity = {1, 1, 1}};
    float intensity[3];
    chiaro_primitive_light(&plate.tree.nodes[0], &below, up, intensity);
    assert_true(intensity[0] == 0);
    object_end(&plate);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_sphere_looks_the_same_from_everywhere),
        cmocka_unit_test(a_sphere_is_lit_as_a_lambert_sphere),
        cmocka_unit_test(a_plate_is_its_cosines),
        cmocka_unit_test(a_curved_piece_is_a_cone_of_normals),
        cmocka_unit_test(a_box_along_the_axes_is_its_faces),
        cmocka_unit_test(a_turned_box_opens_into_its_faces),
        cmocka_unit_test(no_form_makes_or_loses_light),
        cmocka_unit_test(the_error_that_a_node_states_is_what_it_has),
        cmocka_unit_test(an_object_has_another_colour_from_another_side),
        cmocka_unit_test(a_thicket_looks_no_larger_than_its_sphere),
        cmocka_unit_test(elements_that_glow_evenly_have_one_radiance),
        cmocka_unit_test(lit_elements_shine_as_the_sphere_does),
        cmocka_unit_test(a_walk_covers_the_object_once_with_small_nodes),
        cmocka_unit_test(bad_distributions_make_sound_trees),
        cmocka_unit_test(elements_out_of_range_are_refused),
        cmocka_unit_test(the_half_angle_stands_for_a_sphere),
        cmocka_unit_test(half_angle_normals_lie_between),
        cmocka_unit_test(a_lamp_gives_a_ball_what_it_sends_there),
        cmocka_unit_test(a_lamp_lights_a_plate_by_the_law_of_samples),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
