/* Environment cubes: error and cost of painting and smoothing, and 1,000 objects whose cubes are all repainted and smoothed
 * once, on one core: the library beside the article's literal form, in one run.
 *
 * Literally, a neighbour is drawn as one pixel with a z-test, and "to smooth a pixel we add the sum of all pixels in the
 * hemisphere modulated by a dot product ... finally we must divide the sum color with the sum of all dot products". That
 * is timed as it is written, and again with the dot products taken from a table, which the article does not mention.
 *
 * The objects fly in the open, so that both forms paint the same neighbours over the same sky. What the library does
 * beyond that - solid angles, elements lit again, neighbour lists kept up, encoding - is in its time; the literal form is
 * given the library's lists for nothing. Light is compared with what a path tracer says at some of the objects. */
#include "../src/core/cube.h"
#include "../src/core/random.h"
#include "../src/reference/reference.h"
#include "chiaro/chiaro_bake.h"
#include "common/options.h"
#include "common/scenes.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

enum { OBJECTS = 1000, MOST_TEXELS = 384, ROUNDS = 24, PROBES = 128, PATHS = 2048, ROOM = 32, LITERAL_ROUNDS = 5 };

static const char help[] = "Usage: chiaro-bench-objects\n"
                           "Prints error and cost of environment cubes for 1,000 objects beside the article's form.\n";

static double seconds(void)
{
    struct timespec now;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

typedef struct Bench {
    SceneOptions options;
    TestScene scene; /* spheres: the second of its nodes is the object */
    ChiaroBlob blob;
    ChiaroObject object;
    Vec3 middle; /* of the object, in its own space */
    Vec3 places[OBJECTS];
    ChiaroWorld *world;
    uint32_t edge, texels;
    Vec3 directions[MOST_TEXELS];
    float kernel[MOST_TEXELS][MOST_TEXELS], sky[MOST_TEXELS][3];
    float literal[OBJECTS][MOST_TEXELS][3];
} Bench;

static const float sky_rows[3 * 4] = {0.3f, 0.5f, 1, 0.8f, 0.8f, 0.9f, 0.4f, 0.35f, 0.3f, 0.2f, 0.2f, 0.2f};
static const ChiaroSky sky = {1, 4, sky_rows};
static const ChiaroLight sun = {.type = CHIARO_LIGHT_SUN, .direction = {0.6f, -0.8f, 0}, .intensity = {1, 1, 1}};

static void make_object(Bench *bench)
{
    const char *fault;
    SceneRequest request = {0};
    if (!scenes_make("spheres", &request, &bench->scene, &fault))
        options_fail(&bench->options, CHIARO_EXIT_INPUT, "%s", fault);
    ChiaroScene ball = bench->scene.scene;
    ChiaroPart part = ball.parts[bench->scene.nodes[1].first_part];
    ball.indices += part.first_index, ball.index_count = part.index_count;
    part.first_index = 0;
    ball.parts = &part, ball.part_count = 1;
    ChiaroBakeObjectDesc desc = {.struct_size = sizeof desc, .rays = 16};
    if (chiaro_bake_object(&ball, &desc, &bench->blob) != CHIARO_OK ||
        chiaro_object_open(bench->blob.data, bench->blob.size, &bench->object, NULL) != CHIARO_OK)
        options_fail(&bench->options, CHIARO_EXIT_INPUT, "the object cannot be baked");
    bench->middle = vec3_load(bench->object.center);
}

static void make_world(Bench *bench)
{
    ChiaroWorldDesc desc = {.struct_size = sizeof desc, .object_capacity = OBJECTS, .edge = bench->edge};
    ChiaroWorldLight light = {.struct_size = sizeof light, .lights = &sun, .light_count = 1};
    if (chiaro_world_create(&desc, &bench->world) != CHIARO_OK ||
        chiaro_world_sky(bench->world, &sky) != CHIARO_OK || chiaro_world_light(bench->world, &light) != CHIARO_OK)
        options_fail(&bench->options, CHIARO_EXIT_INPUT, "out of memory");
    ChiaroRandom random = chiaro_random_seed(1, 7);
    for (uint32_t i = 0; i < OBJECTS; i++) {
        /* They do not touch. */
        for (bool clear = false; !clear;) {
            float x = ROOM * chiaro_random_float(&random), y = ROOM * chiaro_random_float(&random);
            bench->places[i] = vec3(x, y, ROOM * chiaro_random_float(&random));
            clear = true;
            for (uint32_t k = 0; k < i && clear; k++)
                clear = vec3_length(vec3_sub(bench->places[i], bench->places[k])) > 2.5f * bench->object.radius;
        }
        Vec3 to = vec3_sub(bench->places[i], bench->middle);
        const float matrix[16] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, to.x, to.y, to.z, 1};
        uint32_t id;
        if (chiaro_object_add(bench->world, &bench->object, matrix, &id) != CHIARO_OK || id != i)
            options_fail(&bench->options, CHIARO_EXIT_INPUT, "out of memory");
    }
}

static void make_literal(Bench *bench)
{
    float angle;
    bench->texels = 6 * bench->edge * bench->edge;
    for (uint32_t t = 0; t < bench->texels; t++) {
        float toward[3];
        bench->directions[t] = chiaro_cube_texel_direction(t, bench->edge, &angle);
        vec3_store(toward, bench->directions[t]);
        chiaro_sky_radiance(&sky, toward, bench->sky[t]);
    }
    for (uint32_t i = 0; i < bench->texels; i++) {
        float sum = 0;
        for (uint32_t j = 0; j < bench->texels; j++)
            sum += bench->kernel[i][j] = fmaxf(0, vec3_dot(bench->directions[i], bench->directions[j]));
        for (uint32_t j = 0; j < bench->texels; j++)
            bench->kernel[i][j] /= sum;
    }
}

static void smooth_literally(const Bench *bench, uint32_t texel, float radiance[][3], bool table, float color[3])
{
    float red = 0, green = 0, blue = 0, sum = 0;
    Vec3 normal = bench->directions[texel];
    for (uint32_t j = 0; j < bench->texels; j++) {
        float cosine = table ? bench->kernel[texel][j] : vec3_dot(normal, bench->directions[j]);
        if (!table && !(cosine > 0))
            continue;
        red += cosine * radiance[j][0], green += cosine * radiance[j][1], blue += cosine * radiance[j][2];
        sum += cosine;
    }
    color[0] = red / sum, color[1] = green / sum, color[2] = blue / sum;
}

/* One object, as the article has it. The neighbours are those of the library's lists: finding them is not what differs. */
static void paint_literally(Bench *bench, uint32_t id, bool table)
{
    float radiance[MOST_TEXELS][3], depth[MOST_TEXELS];
    const float *albedo = bench->object.elements[0].albedo;
    memcpy(radiance, bench->sky, sizeof radiance);
    for (uint32_t t = 0; t < bench->texels; t++)
        depth[t] = INFINITY;
    for (uint32_t kind = 0; kind < 2; kind++) {
        uint32_t count;
        const ChiaroNeighbour *list = chiaro_neighbours_list(chiaro_world_neighbours(bench->world), kind, id, &count);
        for (uint32_t k = 0; k < count; k++) {
            Vec3 way = vec3_sub(bench->places[list[k].object], bench->places[id]);
            uint32_t texel = chiaro_cube_texel(way, bench->edge);
            float from[3], intensity[3], distance = vec3_length(way);
            if (!(distance < depth[texel]))
                continue;
            depth[texel] = distance;
            vec3_store(from, bench->places[id]);
            float center[3];
            vec3_store(center, bench->places[list[k].object]);
            chiaro_neighbour_light(center, bench->object.radius, albedo, &sun, from, intensity);
            for (uint32_t c = 0; c < 3; c++)
                radiance[texel][c] = intensity[c] / (CHIARO_PI * bench->object.radius * bench->object.radius);
        }
    }
    for (uint32_t i = 0; i < bench->texels; i++)
        smooth_literally(bench, i, radiance, table, bench->literal[id][i]);
}

/* All objects as one scene, for the path tracer. */
static ChiaroScene whole_scene(Bench *bench)
{
    const ChiaroScene *from = &bench->scene.scene;
    const ChiaroPart *part = &from->parts[bench->scene.nodes[1].first_part];
    ChiaroScene whole = *from;
    uint32_t corners = part->index_count;
    ChiaroVertex *vertices = calloc((size_t)corners * OBJECTS, sizeof *vertices);
    uint32_t *indices = calloc((size_t)corners * OBJECTS, sizeof *indices);
    ChiaroPart *parts = calloc(1, sizeof *parts);
    if (!vertices || !indices || !parts)
        options_fail(&bench->options, CHIARO_EXIT_INPUT, "out of memory");
    for (uint32_t i = 0; i < OBJECTS * corners; i++) {
        const ChiaroVertex *vertex = &from->vertices[from->indices[part->first_index + i % corners]];
        vertices[i] = *vertex, indices[i] = i;
        vec3_store(vertices[i].position, vec3_add(vec3_sub(vec3_load(vertex->position), bench->middle),
                                                  bench->places[i / corners]));
    }
    *parts = (ChiaroPart){0, corners * OBJECTS, part->material, CHIARO_NONE};
    whole.vertices = vertices, whole.indices = indices, whole.parts = parts;
    whole.vertex_count = whole.index_count = corners * OBJECTS, whole.part_count = 1;
    return whole;
}

static void measure_errors(Bench *bench, double *ours, double *literal)
{
    ChiaroScene whole = whole_scene(bench);
    const ChiaroPart *part = &bench->scene.scene.parts[bench->scene.nodes[1].first_part];
    ChiaroReference *reference;
    ChiaroRandom random = chiaro_random_seed(2, 9);
    double wrong[2] = {0, 0}, square = 0;
    if (chiaro_reference_create(&whole, &sun, 1, &sky, NULL, &reference) != CHIARO_OK)
        options_fail(&bench->options, CHIARO_EXIT_INPUT, "out of memory");
    for (uint32_t k = 0; k < PROBES; k++) {
        uint32_t id = chiaro_random_bits(&random) % OBJECTS, c = chiaro_random_bits(&random) % part->index_count;
        uint32_t v = bench->scene.scene.indices[part->first_index + c];
        const ChiaroVertex *vertex = &whole.vertices[id * part->index_count + c];
        ChiaroReferenceIrradiance truth =
            chiaro_reference_irradiance(reference, vertex->position, vertex->normal, PATHS, 0, k, 1);
        float light[3];
        if (chiaro_object_irradiance(bench->world, id, v, light) != CHIARO_OK)
            options_fail(&bench->options, CHIARO_EXIT_INPUT, "an object is missing");
        const float *texel = bench->literal[id][chiaro_cube_texel(vec3_load(vertex->normal), bench->edge)];
        for (uint32_t i = 0; i < 3; i++) {
            double a = (double)light[i] - truth.indirect[i], b = (double)(CHIARO_PI * texel[i]) - truth.indirect[i];
            wrong[0] += a * a, wrong[1] += b * b, square += truth.indirect[i] * truth.indirect[i];
        }
    }
    *ours = sqrt(wrong[0] / square), *literal = sqrt(wrong[1] / square);
    chiaro_reference_destroy(reference);
    free((void *)(uintptr_t)whole.vertices);
    free((void *)(uintptr_t)whole.indices);
    free((void *)(uintptr_t)whole.parts);
}

static void bench_edge(Bench *bench, uint32_t edge)
{
    double ours, literal, time[3] = {INFINITY, INFINITY, INFINITY};
    bench->edge = edge;
    make_world(bench);
    make_literal(bench);
    for (uint32_t round = 0; round < ROUNDS; round++) {
        double begin = seconds();
        chiaro_world_update(bench->world, OBJECTS, NULL);
        time[0] = fmin(time[0], seconds() - begin);
        for (uint32_t table = 0; table < 2 && round < LITERAL_ROUNDS; table++) {
            begin = seconds();
            for (uint32_t i = 0; i < OBJECTS; i++)
                paint_literally(bench, i, table);
            time[1 + table] = fmin(time[1 + table], seconds() - begin);
        }
    }
    measure_errors(bench, &ours, &literal);
    printf("%u objects, %ux%ux6 : relRMSE %.4f (literal %.4f), %.2f ms a round (literal %.2f ms, ratio %.2f; with a table "
           "%.2f ms, ratio %.2f)\n", OBJECTS, edge, edge, ours, literal, 1e3 * time[0], 1e3 * time[1],
           time[1] / time[0], 1e3 * time[2], time[2] / time[0]);
    chiaro_world_destroy(bench->world);
}

int main(int argc, char **argv)
{
    Bench *bench = calloc(1, sizeof *bench);
    if (argc > 1 && strcmp(argv[1], "--help") == 0) {
        fputs(help, stdout);
        free(bench);
        return CHIARO_EXIT_OK;
    }
    if (!bench)
        return CHIARO_EXIT_INPUT;
    bench->options = (SceneOptions){.program = "chiaro-bench-objects", .usage = help};
    if (argc > 1)
        options_fail(&bench->options, CHIARO_EXIT_USAGE, "no arguments are known");
    make_object(bench);
    for (uint32_t edge = 4; edge <= 8; edge += 2)
        bench_edge(bench, edge);
    chiaro_blob_free(&bench->blob);
    scenes_free(&bench->scene);
    free(bench);
    return CHIARO_EXIT_OK;
}
