/* The baker's rays against closed forms: form factors, open sky, bent normals, cavities.
 *
 * Every bound is what random rays would be off by: one standard deviation of counting, 3 for means of many rows. The
 * baker's rays are spread evenly, so they must do better than that. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <string.h>

#include "../src/bake/bake.h"
#include "../src/core/cube.h"
#include "common/check.h"
#include "common/mesh.h"

/* A baker as far as rows need it. */
typedef struct Rows {
    Mesh mesh;
    Baker baker;
    RowScratch scratch;
    RowFacts facts;
    uint32_t rays, entries;
} Rows;

static void close_rows(Rows *rows)
{
    Baker *b = &rows->baker;
    Patches *p = &b->patches;
    void *all[] = {p->triangle_first, p->triangle_edge, p->small_leaf, p->leaf_small, p->leaf_first, p->small_triangle,
                   p->triangle_part, p->leaf_cumulative, b->samples, b->points, b->leaf_weights, b->sky_directions,
                   b->sky_order, b->nodes};
    for (size_t k = 0; k < sizeof all / sizeof *all; k++)
        free(all[k]);
    chiaro_row_scratch_destroy(&rows->scratch);
    chiaro_rays_destroy(b->rays);
    mesh_end(&rows->mesh);
}

/* Runs the stages up to the patches on a mesh, which it takes over. */
static void open_rows(Rows *rows, const Mesh *mesh, uint32_t samples, uint32_t rays)
{
    *rows = (Rows){.mesh = *mesh, .rays = rays};
    Baker *b = &rows->baker;
    b->scene = &rows->mesh.scene;
    b->desc = (ChiaroBakeDesc){.samples = samples, .rays = rays, .threads = 1, .seed = 5};
    assert_int_equal(chiaro_rays_create(b->scene, NULL, &b->rays), CHIARO_OK);
    for (int c = 0; c < 3; c++) {
        b->info.bounds_min[c] = INFINITY, b->info.bounds_max[c] = -INFINITY;
        for (uint32_t v = 0; v < b->scene->vertex_count; v++) {
            b->info.bounds_min[c] = fminf(b->info.bounds_min[c], b->scene->vertices[v].position[c]);
            b->info.bounds_max[c] = fmaxf(b->info.bounds_max[c], b->scene->vertices[v].position[c]);
        }
    }
    assert_int_equal(chiaro_bake_patches(b), CHIARO_OK);
    assert_true(chiaro_row_scratch_create(b, rays, &rows->scratch));
}

/* Share of the last row that goes to surfaces. A row is a cut: nothing in it may reach over both surfaces and sky. */
static double surface_share(const Rows *rows)
{
    const Baker *b = &rows->baker;
    double surfaces = 0, sky = 0;
    for (uint32_t e = 0; e < rows->entries; e++) {
        const ChiaroNode *node = &b->nodes[rows->scratch.entries[e].node];
        assert_true(rows->scratch.entries[e].weight >= 0);
        assert_true(node->first >= b->sample_count || node->first + node->count <= b->sample_count);
        if (node->first < b->sample_count)
            surfaces += (double)rows->scratch.entries[e].weight;
        else
            sky += (double)rows->scratch.entries[e].weight;
    }
    assert_near("sky of the row", 0, sky, (double)rows->facts.sky, 1e-5);
    assert_near("whole row", 0, surfaces + sky + (double)rows->facts.behind, 1, 1e-5);
    return surfaces;
}

static double trace(Rows *rows, Vec3 place, Vec3 normal, uint32_t rays, uint32_t stream)
{
    rows->entries = chiaro_row_trace(&rows->baker, &place, 1, normal, normal, rays, stream, &rows->scratch,
                                     &rows->facts);
    return surface_share(rows);
}

static double deviation(double share, double rays) { return sqrt(share * (1 - share) / rays); }

/* ------------------------------------------------------------------------------------------------------------------
 * Form factors
 */

/* Form factor of a place, to one thing that is all there is, by many rows: with few rays and with many. */
static void check_place(const char *what, double number, Mesh *mesh, Vec3 place, Vec3 normal, double truth)
{
    enum { PLACES = 48, FEW = 256, MANY = 16384 };
    Rows rows;
    open_rows(&rows, mesh, 256, MANY);
    double few = 0, many = 0, mean = 0;
    for (uint32_t k = 0; k < PLACES; k++) {
        double a = trace(&rows, place, normal, FEW, k) - truth, b = trace(&rows, place, normal, MANY, k) - truth;
        few += a * a / PLACES, many += b * b / PLACES, mean += b / PLACES;
    }
    few = sqrt(few), many = sqrt(many);
    assert_below(what, number, few, deviation(truth, FEW));
    assert_below(what, number, many, deviation(truth, MANY));
    assert_below(what, number, many, few * sqrt((double)FEW / MANY));
    assert_near(what, number, mean, 0, 3 * deviation(truth, (double)MANY * PLACES));
    close_rows(&rows);
}

static void a_place_below_the_corner_of_a_rectangle(void **state)
{
    (void)state;
    Mesh mesh = mesh_begin();
    mesh_material(&mesh, 0.5f, 0);
    mesh_quad(&mesh, vec3(0, 1, 0), vec3(1, 1, 0), vec3(1, 1, 1), vec3(0, 1, 1)); /* faces down */
    check_place("parallel, 1 x 1 at 1", 1, &mesh, vec3(0, 0, 0), vec3(0, 1, 0), 0.138531606);
    /* In front of the middle: four corners. */
    mesh = mesh_begin();
    mesh_material(&mesh, 0.5f, 0);
    mesh_quad(&mesh, vec3(-1, 1, -1), vec3(1, 1, -1), vec3(1, 1, 1), vec3(-1, 1, 1));
    check_place("parallel, 2 x 2 at 1", 2, &mesh, vec3(0, 0, 0), vec3(0, 1, 0), 4 * 0.138531606);
}

static void a_place_before_a_standing_rectangle(void **state)
{
    (void)state;
    Mesh mesh = mesh_begin();
    mesh_material(&mesh, 0.5f, 0);
    /* Height 2, width 1, distance 0.5; faces -x. */
    mesh_quad(&mesh, vec3(0.5f, 0, 0), vec3(0.5f, 0, 1), vec3(0.5f, 2, 1), vec3(0.5f, 2, 0));
    check_place("perpendicular", 1, &mesh, vec3(0, 0, 0), vec3(0, 1, 0), 0.158774805);
}

static void fan(Mesh *mesh, float radius, float height, bool up, uint32_t sides)
{
    for (uint32_t i = 0; i < sides; i++) {
        float a = 2 * CHIARO_PI * (float)i / (float)sides, b = 2 * CHIARO_PI * (float)(i + 1) / (float)sides;
        Vec3 p = vec3(radius * cosf(a), height, radius * sinf(a)), q = vec3(radius * cosf(b), height, radius * sinf(b));
        mesh_triangle(mesh, vec3(0, height, 0), up ? q : p, up ? p : q);
    }
}

static void a_place_below_a_disc_beside_its_axis(void **state)
{
    (void)state;
    Mesh mesh = mesh_begin();
    mesh_material(&mesh, 0.5f, 0);
    fan(&mesh, 0.7f, 1, false, 256);
    check_place("disc", 1, &mesh, vec3(0.5f, 0, 0), vec3(0, 1, 0), 0.261454069);
}

/* Mean over the patches of part 0, of rows that start all over each patch, to what else there is. */
static void check_patches(const char *what, double number, Mesh *mesh, double truth)
{
    enum { RAYS = 1024 };
    Rows rows;
    open_rows(&rows, mesh, 256, RAYS);
    const Baker *b = &rows.baker;
    const float *from = rows.mesh.vertices[0].normal;
    double area = 0, share = 0;
    uint32_t patches = 0;
    for (uint32_t s = 0; s < b->sample_count; s++) {
        if (vec3_dot(vec3_load(b->samples[s].normal), vec3_load(from)) < 0.99f)
            continue;
        rows.entries = chiaro_row_trace_sample(b, s, RAYS, &rows.scratch, &rows.facts);
        share += surface_share(&rows) * (double)b->samples[s].area;
        area += (double)b->samples[s].area;
        patches++;
    }
    /* As many random rays would be this far off, three times in a thousand more. */
    assert_near(what, number, share / area, truth, 3 * deviation(truth, (double)RAYS * patches));
    close_rows(&rows);
}

static double parallel_rectangles(double x, double y)
{
    double p = 1 + x * x, q = 1 + y * y;
    return 2 / (pi * x * y) * (log(p * q / (p + y * y)) / 2 + x * sqrt(q) * atan(x / sqrt(q)) +
                               y * sqrt(p) * atan(y / sqrt(p)) - x * atan(x) - y * atan(y));
}

static void facing_rectangles(void **state)
{
    (void)state;
    static const double cases[][3] = {{1, 1, 0.199824896}, {1, 2, 0.285875385}, {2, 2, 0.415253284},
                                      {10, 10, 0.826994522}, {0.1, 0.1, 0.003162057}};
    for (size_t k = 0; k < sizeof cases / sizeof *cases; k++) {
        float x = (float)cases[k][0], y = (float)cases[k][1];
        assert_near("formula", (double)k, parallel_rectangles(cases[k][0], cases[k][1]), cases[k][2], 1e-8);
        Mesh mesh = mesh_begin();
        mesh_material(&mesh, 0.5f, 0);
        mesh_quad(&mesh, vec3(0, 0, 0), vec3(0, 0, y), vec3(x, 0, y), vec3(x, 0, 0));
        mesh_quad(&mesh, vec3(0, 1, 0), vec3(x, 1, 0), vec3(x, 1, y), vec3(0, 1, y));
        check_patches("parallel", (double)k, &mesh, cases[k][2]);
    }
}

static void rectangles_that_share_an_edge(void **state)
{
    (void)state;
    /* H: height of the wall that is seen, W: depth of the floor that sees it, by the length of the edge. */
    static const double cases[][3] = {{1, 1, 0.200043776}, {2, 1, 0.232852603}, {1, 2, 0.116426301},
                                      {0.5, 1, 0.146186679}};
    for (size_t k = 0; k < sizeof cases / sizeof *cases; k++) {
        float h = (float)cases[k][0], w = (float)cases[k][1];
        Mesh mesh = mesh_begin();
        mesh_material(&mesh, 0.5f, 0);
        mesh_quad(&mesh, vec3(0, 0, 0), vec3(0, 0, 1), vec3(w, 0, 1), vec3(w, 0, 0));
        mesh_quad(&mesh, vec3(0, 0, 1), vec3(0, 0, 0), vec3(0, h, 0), vec3(0, h, 1)); /* faces +x */
        check_patches("perpendicular", (double)k, &mesh, cases[k][2]);
    }
}

/* Places and directions must be independent: the row of a patch as large as what it sees gets better with every ray. */
static void the_row_of_a_patch_tightens_with_its_rays(void **state)
{
    (void)state;
    enum { ROWS = 48 };
    const double truth = 0.200043776;
    for (uint32_t rays = 256; rays <= 16384; rays *= 8) {
        double wrong = 0;
        for (uint32_t seed = 0; seed < ROWS / 2; seed++) {
            Mesh mesh = mesh_begin();
            mesh_material(&mesh, 0.5f, 0);
            mesh_quad(&mesh, vec3(0, 0, 0), vec3(0, 0, 1), vec3(1, 0, 1), vec3(1, 0, 0));
            mesh_quad(&mesh, vec3(0, 0, 1), vec3(0, 0, 0), vec3(0, 1, 0), vec3(0, 1, 1));
            Rows rows;
            open_rows(&rows, &mesh, 2, rays);
            rows.baker.desc.seed = seed;
            assert_int_equal(rows.baker.sample_count, 2);
            for (uint32_t s = 0; s < 2; s++) {
                rows.entries = chiaro_row_trace_sample(&rows.baker, s, rays, &rows.scratch, &rows.facts);
                double e = surface_share(&rows) - truth;
                wrong += e * e / ROWS;
            }
            close_rows(&rows);
        }
        assert_below("rays", rays, sqrt(wrong), deviation(truth, rays));
    }
}

/* In a sphere F = A / (4 pi R^2), from everywhere. */
static void in_a_sphere_every_patch_has_the_share_of_its_area(void **state)
{
    (void)state;
    enum { RAYS = 4096 };
    Mesh mesh = mesh_begin();
    mesh_material(&mesh, 0.5f, 0);
    mesh_sphere(&mesh, 1, 64, false);
    Rows rows;
    open_rows(&rows, &mesh, 128, RAYS);
    const Baker *b = &rows.baker;
    assert_int_equal(b->sky_count, 0);
    double *share = new_array(b->sample_count, sizeof *share), area = 0;
    for (uint32_t s = 0; s < b->sample_count; s++) {
        rows.entries = chiaro_row_trace_sample(b, s, RAYS, &rows.scratch, &rows.facts);
        assert_near("closed", s, surface_share(&rows), 1, 1e-6);
        for (uint32_t e = 0; e < rows.entries; e++) {
            const ChiaroNode *node = &b->nodes[rows.scratch.entries[e].node];
            for (uint32_t l = node->first; l < node->first + node->count; l++)
                share[l] += (double)(rows.scratch.entries[e].weight * b->leaf_weights[l] / node->area);
        }
        area += (double)b->samples[s].area;
    }
    for (uint32_t s = 0; s < b->sample_count; s++) {
        double truth = (double)b->samples[s].area / area, rays = (double)RAYS * b->sample_count;
        /* Flat triangles: 0.2 % of a patch. */
        assert_near("patch", s, share[s] / b->sample_count, truth, 3 * deviation(truth, rays) + 2e-3 * truth);
    }
    free(share);
    close_rows(&rows);
}

/* ------------------------------------------------------------------------------------------------------------------
 * The open sky
 */

enum { SKY_RAYS = 16384 };

/* Part of the hemisphere that is open over a place; rays are spread evenly, so one deviation is plenty. */
static void check_open(const char *what, double number, Mesh *mesh, Vec3 place, Vec3 normal, double truth)
{
    Rows rows;
    open_rows(&rows, mesh, 64, SKY_RAYS);
    trace(&rows, place, normal, SKY_RAYS, 3);
    assert_near(what, number, (double)rows.facts.sky, truth, deviation(truth, SKY_RAYS));
    close_rows(&rows);
}

/* A wall along z at x, that faces the origin. */
static void wall(Mesh *mesh, float x, float height, float half_length)
{
    float l = x < 0 ? half_length : -half_length;
    mesh_quad(mesh, vec3(x, 0, l), vec3(x, 0, -l), vec3(x, height, -l), vec3(x, height, l));
}

static void beside_a_long_wall(void **state)
{
    (void)state;
    static const float heights[] = {0.25f, 0.5f, 1, 2, 4};
    for (size_t k = 0; k < sizeof heights / sizeof *heights; k++) {
        double h = (double)heights[k], d = 0.5;
        Mesh mesh = mesh_begin();
        mesh_material(&mesh, 0.5f, 0);
        wall(&mesh, -0.5f, heights[k], 50);
        check_open("wall of height", h, &mesh, vec3(0, 0, 0), vec3(0, 1, 0), (1 + d / sqrt(d * d + h * h)) / 2);
    }
}

static void in_a_corner_of_two_walls_a_quarter_is_open(void **state)
{
    (void)state;
    static const float places[][2] = {{0.2f, 0.2f}, {0.1f, 0.4f}};
    for (size_t k = 0; k < 2; k++) {
        Mesh mesh = mesh_begin();
        mesh_material(&mesh, 0.5f, 0);
        mesh_quad(&mesh, vec3(0, 0, 200), vec3(0, 0, 0), vec3(0, 200, 0), vec3(0, 200, 200)); /* faces +x */
        mesh_quad(&mesh, vec3(0, 0, 0), vec3(200, 0, 0), vec3(200, 200, 0), vec3(0, 200, 0)); /* faces +z */
        check_open("corner", (double)k, &mesh, vec3(places[k][0], 0, places[k][1]), vec3(0, 1, 0), 0.25);
    }
}

static void on_the_floor_of_slots_and_pits(void **state)
{
    (void)state;
    static const float depths[] = {0.3f, 1, 2.5f};
    for (size_t k = 0; k < sizeof depths / sizeof *depths; k++) {
        double h = (double)depths[k];
        Mesh mesh = mesh_begin();
        mesh_material(&mesh, 0.5f, 0);
        wall(&mesh, -1, depths[k], 300);
        wall(&mesh, 1, depths[k], 300);
        check_open("slot of depth", h, &mesh, vec3(0, 0, 0), vec3(0, 1, 0), 1 / sqrt(1 + h * h));
        mesh = mesh_begin();
        mesh_material(&mesh, 0.5f, 0);
        for (uint32_t i = 0; i < 256; i++) { /* a round wall, seen from inside */
            float a = 2 * CHIARO_PI * (float)i / 256, b = 2 * CHIARO_PI * (float)(i + 1) / 256;
            Vec3 p = vec3(cosf(a), 0, sinf(a)), q = vec3(cosf(b), 0, sinf(b)), up = vec3(0, depths[k], 0);
            mesh_quad(&mesh, p, q, vec3_add(q, up), vec3_add(p, up));
        }
        check_open("pit of depth", h, &mesh, vec3(0, 0, 0), vec3(0, 1, 0), 1 / (1 + h * h));
        mesh = mesh_begin();
        mesh_material(&mesh, 0.5f, 0);
        fan(&mesh, 1, depths[k], false, 256);
        check_open("below a round roof at", h, &mesh, vec3(0, 0, 0), vec3(0, 1, 0), h * h / (h * h + 1));
    }
}

/* (1 - cos alpha) / 2 between endless faces; these are 400 wide, which the truth here knows. */
static void in_a_groove(void **state)
{
    (void)state;
    for (int degrees = 30; degrees <= 150; degrees += 30) {
        double alpha = degrees * pi / 180, w = 400;
        float c = (float)(w * cos(alpha)), s = (float)(w * sin(alpha));
        for (int k = 1; k <= 3; k++) {
            double x = k, open = (1 + (x - w * cos(alpha)) / sqrt(x * x + w * w - 2 * x * w * cos(alpha))) / 2;
            assert_near("endless", degrees, open, (1 - cos(alpha)) / 2, 0.005);
            Mesh mesh = mesh_begin();
            mesh_material(&mesh, 0.5f, 0);
            mesh_quad(&mesh, vec3(0, 0, -600), vec3(0, 0, 600), vec3((float)w, 0, 600), vec3((float)w, 0, -600));
            mesh_quad(&mesh, vec3(0, 0, 600), vec3(0, 0, -600), vec3(c, s, -600), vec3(c, s, 600));
            check_open("groove of degrees", degrees, &mesh, vec3((float)k, 0, 0), vec3(0, 1, 0), open);
        }
    }
}

/* The convention: the mean of the open directions is weighted by their cosine. Beside an endless wall that is a tilt of
 * atan(2 / pi) = 32.4816 degrees away from it; without the cosine it would be 45. The share of the whole hemisphere's
 * mean: 2 / (3 pi) away from the wall, 1/3 up. */
static void the_bent_normal_is_weighted_by_the_cosine(void **state)
{
    (void)state;
    Mesh mesh = mesh_begin();
    mesh_material(&mesh, 0.5f, 0);
    wall(&mesh, -0.05f, 100, 200);
    Rows rows;
    open_rows(&rows, &mesh, 64, SKY_RAYS);
    trace(&rows, vec3(0, 0, 0), vec3(0, 1, 0), SKY_RAYS, 4);
    double tilt = atan2((double)rows.facts.bent.x, (double)rows.facts.bent.y) * 180 / pi;
    assert_near("tilt", 0, tilt, 32.4816, 0.1);
    assert_near("along the wall", 0, (double)rows.facts.bent.z, 0, 1e-3);
    assert_near("away", 0, (double)rows.facts.bent.x, 2 / (3 * pi), 1e-3);
    assert_near("up", 0, (double)rows.facts.bent.y, 1.0 / 3, 1e-3);
    /* Where nothing is in the way it is the normal. */
    trace(&rows, vec3(50, 90, 0), vec3(1, 0, 0), SKY_RAYS, 4);
    assert_near("free", 0, (double)rows.facts.sky, 1, 1e-6);
    assert_near("free, along", 0, (double)rows.facts.bent.x, 2.0 / 3, 1e-3);
    close_rows(&rows);
}

/* V / (1 - rho (1 - V)), V = 1/2, exact in a bowl, for every channel by itself. */
static void the_cavity_colour_of_a_bowl_is_that_of_all_bounces(void **state)
{
    (void)state;
    const double albedo[3] = {0.2, 0.5, 0.99};
    Mesh mesh = mesh_begin();
    mesh_material(&mesh, 0, 0);
    for (int c = 0; c < 3; c++)
        mesh.materials[0].albedo[c] = (float)albedo[c];
    mesh_sphere(&mesh, 2, 128, true);
    Rows rows;
    open_rows(&rows, &mesh, 256, SKY_RAYS);
    for (uint32_t t = 50; t < rows.mesh.scene.index_count / 3; t += 4000) {
        const ChiaroVertex *v = &rows.mesh.vertices[(size_t)t * 3];
        Vec3 sum = vec3_add(vec3_add(vec3_load(v[0].position), vec3_load(v[1].position)), vec3_load(v[2].position));
        trace(&rows, vec3_scale(sum, 1 / 3.0f), vec3_load(v->normal), SKY_RAYS, t);
        float cavity[3];
        vec3_store(cavity, rows.facts.cavity);
        assert_near("open", t, (double)rows.facts.sky, 0.5, deviation(0.5, SKY_RAYS));
        for (int c = 0; c < 3; c++) {
            double truth = 0.5 / (1 - albedo[c] * 0.5);
            assert_near("cavity", albedo[c], (double)cavity[c], truth, 0.01 * truth);
        }
    }
    close_rows(&rows);
}

/* A sky that is as bright as the cosine of the zenith, on planes that are tilted: the row times the sky's leaves. */
static void rows_weigh_the_sky_by_the_cosine(void **state)
{
    (void)state;
    enum { W = 128, H = 256 };
    float *image = new_array((size_t)W * H * 3, sizeof(float));
    for (uint32_t j = 0; j < H; j++)
        for (uint32_t i = 0; i < 3 * W; i++)
            image[(size_t)j * 3 * W + i] = fmaxf(0, (float)cos(pi * (j + 0.5) / H));
    ChiaroSky sky = {W, H, image};
    Mesh mesh = mesh_begin();
    mesh_material(&mesh, 0.5f, 0);
    mesh_triangle(&mesh, vec3(0, 0, 0), vec3(1, 0, 0), vec3(0, 0, 1));
    Rows rows;
    open_rows(&rows, &mesh, 64, SKY_RAYS);
    const Baker *b = &rows.baker;
    ChiaroTransport leaves = {.sky_count = b->sky_count, .sky_directions = b->sky_directions};
    float *value = new_array(3 * (size_t)b->sky_count, sizeof(float));
    chiaro_sky_light(&leaves, &sky, value);
    const double tilts[] = {0, 30, 90, 150}, truths[] = {2 * pi / 3, 1.844832804, 2.0 / 3, 0.031033439};
    for (int k = 0; k < 4; k++) {
        double irradiance = 0, tilt = tilts[k] * pi / 180;
        assert_near("formula", k, 2 / 3.0 * ((pi - tilt) * cos(tilt) + sin(tilt)), truths[k], 1e-8);
        /* Far above the triangle, where nothing is in the way. */
        trace(&rows, vec3(0, 1e5f, 0), vec3((float)sin(tilt), (float)cos(tilt), 0), SKY_RAYS, 5);
        for (uint32_t e = 0; e < rows.entries; e++) {
            const ChiaroNode *node = &b->nodes[rows.scratch.entries[e].node];
            double mean = 0;
            for (uint32_t l = node->first; l < node->first + node->count; l++)
                mean += (double)(b->leaf_weights[l] * value[3 * (l - b->sample_count)]);
            irradiance += (double)rows.scratch.entries[e].weight * mean / (double)node->area;
        }
        /* The leaves are texels of 16 x 16 x 6: half a percent of the full hemisphere. */
        assert_near("tilt", tilts[k], irradiance, truths[k], 0.005 * truths[0]);
    }
    free(value);
    free(image);
    close_rows(&rows);
}

/* Surfaces seen from behind are black and take no part, but they are counted. */
static void what_is_seen_from_behind_is_lost_and_told(void **state)
{
    (void)state;
    Mesh mesh = mesh_begin();
    mesh_material(&mesh, 0.9f, 0);
    fan(&mesh, 1, 1, true, 256); /* faces up, away from the place below */
    Rows rows;
    open_rows(&rows, &mesh, 64, SKY_RAYS);
    assert_near("surfaces", 0, trace(&rows, vec3(0, 0, 0), vec3(0, 1, 0), SKY_RAYS, 6), 0, 0);
    assert_near("behind", 0, (double)rows.facts.behind, 0.5, deviation(0.5, SKY_RAYS));
    close_rows(&rows);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_place_below_the_corner_of_a_rectangle),
        cmocka_unit_test(a_place_before_a_standing_rectangle),
        cmocka_unit_test(a_place_below_a_disc_beside_its_axis),
        cmocka_unit_test(facing_rectangles),
        cmocka_unit_test(rectangles_that_share_an_edge),
        cmocka_unit_test(the_row_of_a_patch_tightens_with_its_rays),
        cmocka_unit_test(in_a_sphere_every_patch_has_the_share_of_its_area),
        cmocka_unit_test(beside_a_long_wall),
        cmocka_unit_test(in_a_corner_of_two_walls_a_quarter_is_open),
        cmocka_unit_test(on_the_floor_of_slots_and_pits),
        cmocka_unit_test(in_a_groove),
        cmocka_unit_test(the_bent_normal_is_weighted_by_the_cosine),
        cmocka_unit_test(the_cavity_colour_of_a_bowl_is_that_of_all_bounces),
        cmocka_unit_test(rows_weigh_the_sky_by_the_cosine),
        cmocka_unit_test(what_is_seen_from_behind_is_lost_and_told),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
