/* Where patches have to be small. A patch matters by how much others see of it, which is, by reciprocity, how much of its own
 * hemisphere surfaces fill: the outside of a building sends its light to the sky, and no patches are spent on it. And a
 * patch is fine enough by its angle from where it is seen, so what counts is how far away its surroundings are: a niche
 * asks for smaller patches than a hall.
 */
#include "sizing.h"

#include "../core/random.h"
#include "../offline/parallel.h"
#include "lattice.h"

#include <stdlib.h>
#include <string.h>

enum { SIZING_RAYS = 16, MOST_CELLS_AN_EDGE = 1024 };
static const uint32_t MOST_CELLS = 1u << 20;
/* Density goes with the distance of the surroundings to minus this power: 2 would keep angles, 0 areas. */
static const float POWER = 2.0f / 3;
/* Limits, as multiples of the mean. */
static const float LEAST_DENSITY = 1.0f / 64, MOST_DENSITY = 4;

typedef struct Job {
    const Baker *baker;
    Sizing *sizing;
    float *area; /* of each cell */
} Job;

static void look_around(uint32_t begin, uint32_t end, uint32_t thread, void *user)
{
    Job *job = user;
    const Baker *baker = job->baker;
    float epsilon = chiaro_rays_epsilon(baker->rays);
    (void)thread;
    for (uint32_t t = begin; t < end; t++) {
        uint32_t n = job->sizing->edge[t];
        Vec3 corner[3];
        chiaro_triangle_corners(baker->scene, t, corner);
        Vec3 cross = chiaro_triangle_cross(corner), normal = vec3_normalize(cross);
        for (uint32_t k = 0; k < n * n; k++) {
            uint32_t cell = job->sizing->first[t] + k, hits = 0;
            ChiaroRandom random = chiaro_random_seed(baker->desc.seed, (uint64_t)3 << 33 | cell);
            float c[3][2], distance = 0;
            chiaro_lattice_corners(n, k, c);
            Vec3 place = chiaro_triangle_at(corner, (c[0][0] + c[1][0] + c[2][0]) / 3, (c[0][1] + c[1][1] + c[2][1]) / 3);
            for (uint32_t r = 0; r < SIZING_RAYS; r++) {
                float a = ((float)r + chiaro_random_float(&random)) / SIZING_RAYS, b = chiaro_random_float(&random);
                ChiaroHit hit;
                if (!chiaro_rays_hit(baker->rays, vec3_mad(place, normal, epsilon), vec3_cosine_direction(normal, a, b), 0,
                                     INFINITY, &hit) || !hit.front)
                    continue;
                hits++, distance += hit.distance;
            }
            distance /= (float)(hits ? hits : 1);
            job->sizing->density[cell] =
                hits ? powf((float)hits / SIZING_RAYS * baker->free_path / fmaxf(distance, epsilon), POWER) : 0;
            job->area[cell] = vec3_length(cross) / (2 * (float)(n * n));
        }
    }
}

/* Mean 1 over the area, and within the limits: what they cut off is spread over the rest by the second round. */
static void normalize(const Job *job)
{
    float *density = job->sizing->density;
    for (int round = 0; round < 2; round++) {
        double sum = 0, area = 0;
        for (uint32_t k = 0; k < job->sizing->count; k++)
            sum += (double)density[k] * job->area[k], area += job->area[k];
        for (uint32_t k = 0; k < job->sizing->count; k++)
            density[k] = sum > 0 ? fminf(MOST_DENSITY, fmaxf(LEAST_DENSITY, (float)(density[k] * area / sum))) : 1;
    }
}

bool chiaro_sizing_create(const Baker *baker, Sizing *sizing)
{
    const ChiaroScene *scene = baker->scene;
    uint32_t triangles = scene->index_count / 3;
    float step = baker->info.patch_size;
    uint64_t count;
    Job job = {baker, sizing, NULL};
    memset(sizing, 0, sizeof *sizing);
    sizing->first = calloc(triangles, sizeof *sizing->first);
    sizing->edge = calloc(triangles, sizeof *sizing->edge);
    if (!sizing->first || !sizing->edge)
        goto failed;
    for (;; step *= 1.5f) {
        count = 0;
        for (uint32_t t = 0; t < triangles; t++) {
            Vec3 c[3];
            chiaro_triangle_corners(scene, t, c);
            float area = vec3_length(chiaro_triangle_cross(c)) / 2;
            /* About as many cells as squares of a step: a needle is not cut finer across than along. */
            float wanted = ceilf(fminf(chiaro_triangle_longest_edge(c), 2 * sqrtf(2 * area)) / step);
            sizing->edge[t] = (uint16_t)(area > 0 ? fmaxf(1, fminf(MOST_CELLS_AN_EDGE, wanted)) : 0);
            sizing->first[t] = (uint32_t)count;
            count += (uint64_t)sizing->edge[t] * sizing->edge[t];
        }
        if (count <= MOST_CELLS || count <= triangles)
            break;
    }
    sizing->count = (uint32_t)count;
    sizing->density = malloc(count * sizeof *sizing->density + 1);
    job.area = malloc(count * sizeof *job.area + 1);
    if (!sizing->density || !job.area)
        goto failed;
    chiaro_parallel_for(baker->desc.threads, triangles, 64, look_around, &job, NULL, NULL);
    normalize(&job);
    free(job.area);
    return true;
failed:
    free(job.area);
    chiaro_sizing_destroy(sizing);
    return false;
}

void chiaro_sizing_destroy(Sizing *sizing)
{
    free(sizing->first);
    free(sizing->edge);
    free(sizing->density);
    memset(sizing, 0, sizeof *sizing);
}

float chiaro_sizing_density(const Sizing *sizing, uint32_t triangle, float u, float v)
{
    return sizing->density[sizing->first[triangle] + chiaro_lattice_index(sizing->edge[triangle], u, v)];
}

float chiaro_sizing_most(const Sizing *sizing, uint32_t triangle)
{
    float most = 0;
    uint32_t n = sizing->edge[triangle];
    for (uint32_t k = 0; k < n * n; k++)
        most = fmaxf(most, sizing->density[sizing->first[triangle] + k]);
    return most;
}
