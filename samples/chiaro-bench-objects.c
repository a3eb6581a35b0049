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
#include "common/crowd.h"
#include "common/metrics.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

/* Rounds until the lists are as full as they get, and rounds that are timed. */
enum { OBJECTS = CROWD_OBJECTS, MOST_TEXELS = 384, WARM_UP = 40, ROUNDS = 15, PATHS = 2048 };
/* What is timed. */
enum { OURS, LITERAL, LITERAL_TABLE, FORMS };

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
    Crowd crowd;
    ChiaroWorld *world;
    uint32_t edge, texels;
    Vec3 directions[MOST_TEXELS];
    float kernel[MOST_TEXELS][MOST_TEXELS], sky[MOST_TEXELS][3];
    float literal[OBJECTS][MOST_TEXELS][3];
} Bench;

static void make_literal(Bench *bench)
{
    float angle;
    bench->texels = 6 * bench->edge * bench->edge;
    for (uint32_t t = 0; t < bench->texels; t++) {
        float toward[3];
        bench->directions[t] = chiaro_cube_texel_direction(t, bench->edge, &angle);
        vec3_store(toward, bench->directions[t]);
        chiaro_sky_radiance(&crowd_sky, toward, bench->sky[t]);
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
    const Crowd *crowd = &bench->crowd;
    const float *albedo = crowd->object.elements[0].albedo;
    memcpy(radiance, bench->sky, sizeof radiance);
    for (uint32_t t = 0; t < bench->texels; t++)
        depth[t] = INFINITY;
    for (uint32_t kind = 0; kind < 2; kind++) {
        uint32_t count;
        const ChiaroNeighbour *list = chiaro_neighbours_list(chiaro_world_neighbours(bench->world), kind, id, &count);
        for (uint32_t k = 0; k < count; k++) {
            Vec3 way = vec3_sub(crowd->places[list[k].object], crowd->places[id]);
            uint32_t texel = chiaro_cube_texel(way, bench->edge);
            float from[3], intensity[3], distance = vec3_length(way);
            if (!(distance < depth[texel]))
                continue;
            depth[texel] = distance;
            vec3_store(from, crowd->places[id]);
            float center[3];
            vec3_store(center, crowd->places[list[k].object]);
            chiaro_neighbour_light(center, crowd->object.radius, albedo, &crowd_sun, from, intensity);
            for (uint32_t c = 0; c < 3; c++)
                radiance[texel][c] = intensity[c] / (CHIARO_PI * crowd->object.radius * crowd->object.radius);
        }
    }
    for (uint32_t i = 0; i < bench->texels; i++)
        smooth_literally(bench, i, radiance, table, bench->literal[id][i]);
}

static double literal_error(const Bench *bench)
{
    double wrong = 0, square = 0;
    for (uint32_t k = 0; k < CROWD_PROBES; k++) {
        const CrowdProbe *probe = &bench->crowd.probes[k];
        const float *texel = bench->literal[probe->object][chiaro_cube_texel(vec3_load(probe->normal), bench->edge)];
        for (uint32_t c = 0; c < 3; c++) {
            double d = (double)(CHIARO_PI * texel[c]) - probe->truth[c];
            wrong += d * d, square += probe->truth[c] * probe->truth[c];
        }
    }
    return sqrt(wrong / square);
}

/* A round: something has moved, so that all cubes are painted again. */
static void paint_round(Bench *bench, uint32_t round)
{
    crowd_move(bench->world, &bench->crowd, round % OBJECTS, vec3(1e-4f * (float)(1 + round % 2), 0, 0));
    chiaro_world_update(bench->world, OBJECTS, NULL);
}

/* Each form in turn, so that drift cancels; the median. */
static void bench_edge(Bench *bench, uint32_t edge)
{
    const ChiaroWorldDesc desc = {.edge = edge};
    double time[FORMS][ROUNDS];
    bench->edge = edge;
    bench->world = crowd_world(&bench->options, &bench->crowd, &desc);
    make_literal(bench);
    for (uint32_t round = 0; round < WARM_UP; round++)
        paint_round(bench, round);
    for (uint32_t round = 0; round < ROUNDS; round++) {
        for (uint32_t form = 0; form < FORMS; form++) {
            double begin = seconds();
            if (form == OURS)
                paint_round(bench, round);
            for (uint32_t i = 0; i < OBJECTS && form != OURS; i++)
                paint_literally(bench, i, form == LITERAL_TABLE);
            time[form][round] = 1e3 * (seconds() - begin);
        }
    }
    for (uint32_t form = 0; form < FORMS; form++)
        metrics_sort(time[form], ROUNDS);
    double ours = crowd_error(&bench->options, &bench->crowd, bench->world), literal = literal_error(bench);
    double own = time[OURS][ROUNDS / 2], plain = time[LITERAL][ROUNDS / 2], table = time[LITERAL_TABLE][ROUNDS / 2];
    printf("%u objects, %ux%ux6 : relRMSE %.4f (literal %.4f), median of %d rounds after %d: %.2f ms (literal %.2f ms, ratio "
           "%.2f; with a table %.2f ms, ratio %.2f)\n", OBJECTS, edge, edge, ours, literal, ROUNDS, WARM_UP, own, plain,
           plain / own, table, table / own);
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
    crowd_open(&bench->options, PATHS, &bench->crowd);
    for (uint32_t edge = 4; edge <= 8; edge += 2)
        bench_edge(bench, edge);
    crowd_close(&bench->crowd);
    free(bench);
    return CHIARO_EXIT_OK;
}
