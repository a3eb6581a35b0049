/* All bounces at any albedo: the baker's solver, held against a direct solution of the same system in double precision.
 *
 * The importer's limit of albedo 0.99 is stepped over here: it is there for what comes in, and hides nothing. Closed boxes
 * are stiff in one vector a room (the light that fills it); rooms that are weakly joined in two; a black wall, and albedo
 * that differs from patch to patch, take that simple picture away. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <string.h>

#include "../src/bake/bake.h"
#include "../src/core/random.h"
#include "common/check.h"
#include "common/mesh.h"
#include "common/table.h"

enum { SAMPLES = 640, RAYS = 512, COLUMNS = CHIARO_COLUMN_BLOCK };
static const uint32_t MOST_SWEEPS = 8;
static const double WRONG = 1e-4;

/* A baker as far as its rows. */
typedef struct Case {
    Mesh mesh;
    Baker baker;
} Case;

static void open_case(Case *c, const Mesh *mesh)
{
    *c = (Case){.mesh = *mesh};
    Baker *b = &c->baker;
    b->scene = &c->mesh.scene;
    b->desc = (ChiaroBakeDesc){.samples = SAMPLES, .threads = 2, .seed = 3};
    b->sample_rays = RAYS;
    assert_int_equal(chiaro_rays_create(b->scene, NULL, &b->rays), CHIARO_OK);
    chiaro_bake_bounds(b);
    assert_int_equal(chiaro_bake_patches(b), CHIARO_OK);
    assert_int_equal(chiaro_bake_rows(b), CHIARO_OK);
    b->columns = COLUMNS, b->grey = true;
    b->column_channel = new_array(COLUMNS, sizeof *b->column_channel);
    b->direct = new_array((size_t)b->node_count * COLUMNS, sizeof(float));
    b->total = new_array((size_t)b->node_count * COLUMNS, sizeof(float));
    /* Patches that shine: in column k every patch whose number is k, then a whole that is uniform. */
    for (uint32_t s = 0; s < b->sample_count; s++) {
        for (uint32_t k = 0; k + 1 < COLUMNS; k++)
            b->direct[(size_t)s * COLUMNS + k] = s % (COLUMNS - 1) == k && s < 4 * COLUMNS ? 1 : 0;
        b->direct[(size_t)s * COLUMNS + COLUMNS - 1] = 1;
    }
}

static void close_case(Case *c)
{
    chiaro_bake_release(&c->baker);
    mesh_end(&c->mesh);
}

static void set_albedo(Case *c, float albedo)
{
    for (uint32_t s = 0; s < c->baker.sample_count; s++)
        c->baker.samples[s].albedo[0] = c->baker.samples[s].albedo[1] = c->baker.samples[s].albedo[2] = albedo;
}

/* x of (I - rho F) x = b for all columns, by elimination: the matrix is diagonally dominant, so it needs no pivots. */
static double *solve_directly(const Baker *b)
{
    uint32_t n = b->sample_count;
    double *a = new_array((size_t)n * n, sizeof *a), *x = new_array((size_t)n * COLUMNS, sizeof *x);
    for (uint32_t s = 0; s < n; s++) {
        a[(size_t)s * n + s] = 1;
        for (size_t e = b->row_first[s]; e < b->row_first[s + 1] && b->rows[e].node < n; e++)
            a[(size_t)s * n + b->rows[e].node] -= (double)b->samples[s].albedo[0] * (double)b->rows[e].weight;
        for (uint32_t k = 0; k < COLUMNS; k++)
            x[(size_t)s * COLUMNS + k] = (double)b->direct[(size_t)s * COLUMNS + k];
    }
    for (uint32_t p = 0; p < n; p++) {
        for (uint32_t r = p + 1; r < n; r++) {
            double f = a[(size_t)r * n + p] / a[(size_t)p * n + p];
            for (uint32_t k = p; f != 0 && k < n; k++)
                a[(size_t)r * n + k] -= f * a[(size_t)p * n + k];
            for (uint32_t k = 0; f != 0 && k < COLUMNS; k++)
                x[(size_t)r * COLUMNS + k] -= f * x[(size_t)p * COLUMNS + k];
        }
    }
    for (uint32_t p = n; p-- > 0;) {
        for (uint32_t k = 0; k < COLUMNS; k++) {
            double sum = x[(size_t)p * COLUMNS + k];
            for (uint32_t j = p + 1; j < n; j++)
                sum -= a[(size_t)p * n + j] * x[(size_t)j * COLUMNS + k];
            x[(size_t)p * COLUMNS + k] = sum / a[(size_t)p * n + p];
        }
    }
    free(a);
    return x;
}

/* The worst column, relative. */
static double worst_column(const Baker *b, const double *truth)
{
    double worst = 0;
    for (uint32_t k = 0; k < COLUMNS; k++) {
        double wrong = 0, size = 0;
        for (uint32_t s = 0; s < b->sample_count; s++) {
            double x = truth[(size_t)s * COLUMNS + k], e = (double)b->total[(size_t)s * COLUMNS + k] - x;
            wrong += e * e, size += x * x;
        }
        worst = fmax(worst, sqrt(wrong / size));
    }
    return worst;
}

static void solve(Baker *b)
{
    void *last[] = {b->irradiance, b->clusters, b->sample_cluster, b->response[0]};
    for (size_t k = 0; k < sizeof last / sizeof *last; k++)
        free(last[k]);
    b->info.solver_sweeps = 0;
    assert_int_equal(chiaro_bake_solve(b), CHIARO_OK);
}

static void check_solver(Table *table, const char *name, Case *c)
{
    Baker *b = &c->baker;
    char text[96];
    solve(b);
    double *truth = solve_directly(b);
    snprintf(text, sizeof text, "%s: sweeps", name);
    table_most(table, text, b->info.solver_sweeps, MOST_SWEEPS);
    snprintf(text, sizeof text, "%s: worst of %u lights", name, COLUMNS);
    table_most(table, text, worst_column(b, truth), WRONG);
    free(truth);
}

/* ------------------------------------------------------------------------------------------------------------------ */

/* A wall at x = 0 of the square 0 .. 2 with a square hole in its middle, that faces +x; or its other side, triangle by
 * triangle. */
static void wall_with_hole(Mesh *mesh, float half, bool back)
{
    float a = 1 - half, z = 1 + half;
    const float strips[4][4] = {{0, 0, 2, a}, {0, z, 2, 2}, {0, a, a, z}, {z, a, 2, z}};
    for (int k = 0; k < 4; k++) {
        const float *s = strips[k];
        Vec3 p = vec3(0, s[0], s[1]), q = vec3(0, s[2], s[1]), r = vec3(0, s[2], s[3]), t = vec3(0, s[0], s[3]);
        mesh_triangle(mesh, p, back ? r : q, back ? q : r);
        mesh_triangle(mesh, p, back ? t : r, back ? r : t);
    }
}

/* Two rooms of 2 x 2 x 2 m on either side of a wall; its hole is this part of the surface of a room. */
static Mesh two_rooms(double opening)
{
    float half = (float)sqrt(24 * opening) / 2;
    Mesh mesh = mesh_begin(), box = mesh_begin();
    mesh_material(&box, 0.5f, 0);
    mesh_box(&box, vec3(-2, 0, 0), vec3(0, 2, 2));
    mesh_box(&box, vec3(0, 0, 0), vec3(2, 2, 2));
    mesh_material(&mesh, 0.5f, 0);
    for (uint32_t i = 0; i < box.scene.index_count; i += 3) {
        Vec3 a = vec3_load(box.vertices[i].position), b = vec3_load(box.vertices[i + 1].position);
        Vec3 c = vec3_load(box.vertices[i + 2].position);
        if (a.x != 0 || b.x != 0 || c.x != 0)
            mesh_triangle(&mesh, a, b, c);
    }
    mesh_end(&box);
    for (int back = 0; back < 2; back++) {
        uint32_t part = mesh_material(&mesh, 0.5f, 0);
        wall_with_hole(&mesh, half, back);
        mesh.parts[part].twin = back ? part - 1 : part + 1;
    }
    return mesh;
}

static Mesh one_room(void) { return mesh_room(0.5f, 0); }

static void closed_rooms_converge_at_every_albedo(void **state)
{
    (void)state;
    static const float albedos[] = {0.5f, 0.8f, 0.95f, 0.99f, 0.999f, 0.9999f, 0.99999f, 0.999999f};
    static const char *const kinds[3] = {"one room", "two rooms, opening 0.1 %", "two rooms, opening 0.001 %"};
    Table table = table_begin("solver: closed rooms, albedo");
    for (int kind = 0; kind < 3; kind++) {
        Case c;
        Mesh mesh = kind == 0 ? one_room() : two_rooms(kind == 1 ? 1e-3 : 1e-5);
        open_case(&c, &mesh);
        /* So small a hole is asked of the library up to the albedo that it lets in. */
        for (size_t k = 0; k < (kind == 2 ? 4 : sizeof albedos / sizeof *albedos); k++) {
            char name[64];
            snprintf(name, sizeof name, "%s, %g", kinds[kind], (double)albedos[k]);
            set_albedo(&c, albedos[k]);
            check_solver(&table, name, &c);
        }
        close_case(&c);
    }
    table_end(&table);
}

static void rooms_of_many_albedos_converge(void **state)
{
    (void)state;
    Table table = table_begin("solver: mixed albedo");
    Case c;
    Mesh mesh = one_room();
    open_case(&c, &mesh);
    Baker *b = &c.baker;
    ChiaroRandom random = chiaro_random_seed(9, 9);
    for (uint32_t s = 0; s < b->sample_count; s++)
        b->samples[s].albedo[0] = 0.1f + 0.88f * chiaro_random_float(&random);
    check_solver(&table, "random, 0.1 to 0.98", &c);
    for (uint32_t s = 0; s < b->sample_count; s++)
        b->samples[s].albedo[0] = b->samples[s].normal[0] > 0.9f ? 0 : 0.97f;
    check_solver(&table, "one black wall, the rest 0.97", &c);
    for (uint32_t s = 0; s < b->sample_count; s++)
        b->samples[s].albedo[0] = b->samples[s].normal[0] > 0.9f ? 0 : 0.999999f;
    check_solver(&table, "one black wall, the rest 0.999999", &c);
    for (uint32_t s = 0; s < b->sample_count; s++)
        b->samples[s].albedo[0] = s % 2 ? 0 : 0.999999f;
    check_solver(&table, "black and 0.999999 by turns", &c);
    set_albedo(&c, 0);
    check_solver(&table, "black", &c);
    close_case(&c);
    table_end(&table);
}

/* B = E / (1 - rho), everywhere, where everything shines alike. Rays that slip through the edges of a room would show here:
 * one in a thousand makes 9 % at 0.99. */
static void a_furnace_is_its_closed_form(void **state)
{
    (void)state;
    static const float albedos[] = {0.5f, 0.9f, 0.99f};
    Table table = table_begin("solver: furnace against E / (1 - albedo)");
    for (int kind = 0; kind < 2; kind++) {
        Case c;
        Mesh mesh = kind == 0 ? one_room() : two_rooms(1e-3);
        open_case(&c, &mesh);
        for (size_t k = 0; k < sizeof albedos / sizeof *albedos; k++) {
            Baker *b = &c.baker;
            char name[64];
            double low = INFINITY, high = 0, truth = 1 / (1 - (double)albedos[k]);
            set_albedo(&c, albedos[k]);
            solve(b);
            for (uint32_t s = 0; s < b->sample_count; s++) {
                low = fmin(low, (double)b->total[(size_t)s * COLUMNS + COLUMNS - 1]);
                high = fmax(high, (double)b->total[(size_t)s * COLUMNS + COLUMNS - 1]);
            }
            snprintf(name, sizeof name, "%s, %g: darkest patch", kind ? "two rooms" : "one room", (double)albedos[k]);
            table_near(&table, name, truth, low, 1e-3);
            snprintf(name, sizeof name, "%s, %g: brightest patch", kind ? "two rooms" : "one room", (double)albedos[k]);
            table_near(&table, name, truth, high, 1e-3);
        }
        close_case(&c);
    }
    table_end(&table);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(closed_rooms_converge_at_every_albedo),
        cmocka_unit_test(rooms_of_many_albedos_converge),
        cmocka_unit_test(a_furnace_is_its_closed_form),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
