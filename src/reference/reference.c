/* Pictures and probes made of paths. A pixel's first hit is found once; its light straight from lamps is exact; the
 * rest is the mean of two independent halves of paths, whose difference tells the noise. Random numbers depend on the
 * seed, the pixel, the half and the sample alone, so any number of threads gives the same bits. */
#include "reference.h"

#include "../core/log.h"
#include "../offline/parallel.h"
#include "pool.h"

#include <stdatomic.h>
#include <stdlib.h>

#define IRRADIANCE_BATCHES 16u
/* Pixels a thread takes at a time: few, so that an interrupt is heard soon. */
#define PIXEL_RUN 16u

/* One path goes into the pools, their maps included, for this many of the picture. A point averages enough of them to
 * know the light better than the map does. Too few points would make noise that all pixels have in common. Measured on
 * a Cornell box of 256x256 and 128 paths a pixel: a seventh of the time for the same noise. */
#define PATHS_A_POOL_PATH 4u
#define POOL_SAMPLES 64u
#define MIN_POOL_POINTS (1u << 11)
#define MAX_POOL_POINTS (1u << 17)
/* Share of the progress that the pools are. */
#define POOL_PROGRESS 0.3f
/* Rays that look where the picture's paths arrive. */
#define SCOUTS (1u << 18)

struct ChiaroReference {
    World world;
    ChiaroRays *rays;
    ChiaroSky sky;
};

ChiaroResult chiaro_reference_create(const ChiaroScene *scene, const ChiaroLight *lights, uint32_t light_count,
                                     const ChiaroSky *sky, const ChiaroLog *log, ChiaroReference **out)
{
    *out = NULL;
    bool all_good = true, any_starts = false;
    for (uint32_t i = 0; i < light_count; i++) {
        all_good &= chiaro_light_check(&lights[i]) == CHIARO_OK;
        any_starts |= lights[i].type != CHIARO_LIGHT_SUN;
    }
    if (!all_good || (sky && chiaro_sky_check(sky) != CHIARO_OK)) {
        chiaro_log_write(log, CHIARO_LOG_ERROR, CHIARO_LOG_ARGUMENT_INVALID, all_good ? "sky" : "light");
        return CHIARO_ERROR_ARGUMENT;
    }
    ChiaroReference *reference = calloc(1, sizeof *reference);
    ChiaroResult result = reference ? chiaro_rays_create(scene, log, &reference->rays) : CHIARO_ERROR_MEMORY;
    if (result == CHIARO_OK) {
        World *world = &reference->world;
        *world = (World){.scene = scene, .rays = reference->rays, .lights = lights, .light_count = light_count};
        if (sky) {
            reference->sky = *sky;
            world->sky = &reference->sky;
            world->sky_sampler = sky_sampler_create(sky);
        }
        world->lamp_shares = any_starts ? malloc(light_count * sizeof(float)) : NULL;
        if (world->lamp_shares)
            path_share_lamps(lights, light_count, world->lamp_shares);
        if (!emitters_create(scene, &world->emitters))
            result = CHIARO_ERROR_MEMORY;
    }
    if (result != CHIARO_OK) {
        chiaro_reference_destroy(reference);
        return result;
    }
    *out = reference;
    return CHIARO_OK;
}

void chiaro_reference_destroy(ChiaroReference *reference)
{
    if (!reference)
        return;
    chiaro_rays_destroy(reference->rays);
    sky_sampler_destroy(reference->world.sky_sampler);
    emitters_destroy(&reference->world.emitters);
    free(reference->world.lamp_shares);
    free(reference);
}

/* ------------------------------------------------------------------------------------------------------------------
 * Pictures
 */

typedef struct Picture {
    const World *world;
    const ChiaroReferenceDesc *desc;
    ChiaroReferenceImages *images;
    float *squares; /* per pixel: squared difference of the two halves of the indirect light, sum over channels */
    Vec3 right;
    float tangent; /* of half the opening, per half picture height */
    Pool pools[2];         /* one for each half; empty if they do not pay */
    atomic_uint *arrivals; /* scouts that came to each triangle */
    float stage_start, stage_span; /* of the progress */
    bool stopped;
    atomic_uint_fast64_t rays;
} Picture;

/* What a pixel centre sees. Backs are culled, as a rasteriser does, and so is what lies before znear or beyond zfar. */
static bool first_hit(const Picture *picture, uint32_t x, uint32_t y, Vec3 *direction, ChiaroHit *hit, uint64_t *rays)
{
    const ChiaroCamera *camera = &picture->desc->camera;
    float width = (float)picture->desc->width, height = (float)picture->desc->height;
    float across = ((float)x + 0.5f - 0.5f * width) / (0.5f * height) * picture->tangent;
    float up = (0.5f * height - (float)y - 0.5f) / (0.5f * height) * picture->tangent;
    Vec3 line = vec3_mad(vec3_load(camera->forward), picture->right, across);
    line = vec3_mad(line, vec3_load(camera->up), up);
    float stretch = vec3_length(line);
    *direction = vec3_scale(line, 1 / stretch);

    float start = camera->znear * stretch, end = camera->zfar > 0 ? camera->zfar * stretch : INFINITY;
    for (;;) {
        (*rays)++;
        if (!chiaro_rays_hit(picture->world->rays, vec3_load(camera->eye), *direction, start, end, hit))
            return false;
        if (hit->front)
            return true;
        start = nextafterf(hit->distance, INFINITY);
    }
}

static void set_pixel(const Picture *picture, ChiaroComponent component, uint32_t pixel, Vec3 rgb, float alpha)
{
    float *rgba = picture->images->pixels[component] + (size_t)pixel * 4;
    vec3_store(rgba, rgb);
    rgba[3] = alpha;
}

/* `pool` may be NULL. */
static void mean_of_paths(const World *world, const Place *place, uint64_t key, uint32_t count, uint32_t depth,
                          const Pool *pool, double mean[3], uint64_t *rays)
{
    double sum[3] = {0, 0, 0};
    /* A run of points that starts at a multiple of its length is well spread: where, is chance. */
    uint32_t length = 1, start = (uint32_t)(key >> 32);
    while (length < count * POOL_JOINS && length < MAX_POOL_POINTS)
        length *= 2;
    for (uint32_t i = 0; i < count; i++) {
        Sampler sampler = sampler_make(key, i);
        Joins joins = {pool, (start & ~(length - 1)) + i * POOL_JOINS};
        Vec3 light = path_indirect(world, place, &sampler, depth, pool ? &joins : NULL, rays);
        sum[0] += (double)light.x, sum[1] += (double)light.y, sum[2] += (double)light.z;
    }
    for (uint32_t c = 0; c < 3; c++)
        mean[c] = sum[c] / count;
}

static uint32_t half_spp(const ChiaroReferenceDesc *desc) { return (desc->spp + 1) / 2; }

static void trace_pixel(Picture *picture, uint32_t pixel, uint64_t *rays)
{
    const World *world = picture->world;
    const ChiaroReferenceDesc *desc = picture->desc;
    Vec3 direction, black = vec3(0, 0, 0);
    ChiaroHit hit;
    if (!first_hit(picture, pixel % desc->width, pixel / desc->width, &direction, &hit, rays)) {
        float toward[3], sky[3] = {0, 0, 0};
        vec3_store(toward, direction);
        if (world->sky)
            chiaro_sky_radiance(world->sky, toward, sky);
        set_pixel(picture, CHIARO_COMPONENT_FULL, pixel, vec3_load(sky), 0);
        set_pixel(picture, CHIARO_COMPONENT_PUNCTUAL, pixel, black, 0);
        set_pixel(picture, CHIARO_COMPONENT_INDIRECT, pixel, black, 0);
        picture->images->parts[pixel] = CHIARO_NONE;
        return;
    }
    picture->images->parts[pixel] = hit.part;
    Place place = path_place(world, hit.part, hit.triangle, hit.u, hit.v, hit.normal);
    Vec3 punctual = vec3_mul(place.albedo, path_punctual(world, &place, rays));
    uint64_t key = chiaro_random_mix(chiaro_random_mix(desc->seed) + pixel);
    double halves[2][3];
    for (uint32_t i = 0; i < 2; i++) {
        const Pool *pool = picture->pools[i].count ? &picture->pools[i] : NULL;
        mean_of_paths(world, &place, chiaro_random_mix(key + i), half_spp(desc), desc->depth, pool, halves[i], rays);
    }
    float albedo[3], mean[3];
    double square = 0;
    vec3_store(albedo, place.albedo);
    for (uint32_t c = 0; c < 3; c++) {
        mean[c] = (float)(0.5 * (halves[0][c] + halves[1][c]) * (double)albedo[c]);
        double difference = (halves[0][c] - halves[1][c]) * (double)albedo[c];
        square += difference * difference;
    }
    picture->squares[pixel] = (float)square;
    Vec3 indirect = vec3_load(mean);
    set_pixel(picture, CHIARO_COMPONENT_PUNCTUAL, pixel, punctual, 1);
    set_pixel(picture, CHIARO_COMPONENT_INDIRECT, pixel, indirect, 1);
    set_pixel(picture, CHIARO_COMPONENT_FULL, pixel, vec3_add(vec3_add(punctual, indirect), place.emission), 1);
}

static void trace_pixels(uint32_t begin, uint32_t end, uint32_t thread, void *user)
{
    (void)thread;
    Picture *picture = user;
    uint64_t rays = 0;
    for (uint32_t i = begin; i < end; i++)
        trace_pixel(picture, i, &rays);
    atomic_fetch_add(&picture->rays, rays);
}

static void send_scouts(uint32_t begin, uint32_t end, uint32_t thread, void *user)
{
    (void)thread;
    Picture *picture = user;
    const World *world = picture->world;
    uint64_t rays = 0;
    for (uint32_t i = begin; i < end; i++) {
        ChiaroRandom random = chiaro_random_seed(~(uint64_t)picture->desc->seed, i);
        uint32_t x = chiaro_random_bits(&random) % picture->desc->width;
        uint32_t y = chiaro_random_bits(&random) % picture->desc->height;
        Vec3 direction;
        ChiaroHit hit;
        if (!first_hit(picture, x, y, &direction, &hit, &rays))
            continue;
        Place place = path_place(world, hit.part, hit.triangle, hit.u, hit.v, hit.normal);
        float u = chiaro_random_float(&random);
        direction = vec3_cosine_direction(place.geometric, u, chiaro_random_float(&random));
        rays++;
        if (chiaro_rays_hit(world->rays, place.origin, direction, 0, INFINITY, &hit) && hit.front)
            atomic_fetch_add(&picture->arrivals[hit.triangle], 1);
    }
    atomic_fetch_add(&picture->rays, rays);
}

/* Progress of a stage as progress of the whole; remembers that somebody asked to stop. */
static bool tell_stage(float done, void *user)
{
    Picture *picture = user;
    const ChiaroReferenceDesc *desc = picture->desc;
    if (desc->progress && !desc->progress(picture->stage_start + done * picture->stage_span, desc->progress_user))
        picture->stopped = true;
    return !picture->stopped;
}

/* Pools are an aid: where they do not pay, or memory is short, they stay empty. */
static void make_pools(Picture *picture)
{
    const ChiaroReferenceDesc *desc = picture->desc;
    uint32_t triangles = picture->world->scene->index_count / 3, points = 1;
    /* Two pools, each of points and a map of as many. */
    uint64_t paths = (uint64_t)desc->width * desc->height * half_spp(desc) * 2;
    uint64_t wanted_points = paths / PATHS_A_POOL_PATH / POOL_SAMPLES / 4;
    while (points < MAX_POOL_POINTS && 2 * (uint64_t)points <= wanted_points)
        points *= 2;
    if (points < MIN_POOL_POINTS || desc->depth == 1)
        return;
    picture->arrivals = malloc(triangles * sizeof *picture->arrivals);
    uint32_t *wanted = malloc(triangles * sizeof *wanted);
    if (picture->arrivals && wanted) {
        for (uint32_t i = 0; i < triangles; i++)
            atomic_init(&picture->arrivals[i], 0);
        chiaro_parallel_for(desc->threads, SCOUTS, 1024, send_scouts, picture, NULL, NULL);
        for (uint32_t i = 0; i < triangles; i++)
            wanted[i] = atomic_load(&picture->arrivals[i]);
        uint64_t rays = 0;
        PoolDesc pool = {.wanted = wanted, .points = points, .samples = POOL_SAMPLES,
                         .depth = desc->depth ? desc->depth - 1 : 0, .threads = desc->threads,
                         .progress = tell_stage, .progress_user = picture};
        for (uint32_t i = 0; i < 2 && !picture->stopped; i++) {
            picture->stage_span = POOL_PROGRESS / 2;
            picture->stage_start = (float)i * picture->stage_span;
            pool.seed = chiaro_random_mix(desc->seed ^ (uint64_t)(i + 1) << 40);
            pool_create(picture->world, &pool, &picture->pools[i], &rays);
        }
        atomic_fetch_add(&picture->rays, rays);
    }
    free(picture->arrivals);
    free(wanted);
}

/* The mean of two halves is off by half of what they differ, in the mean square. */
static double relative_noise(const Picture *picture, ChiaroComponent component)
{
    const float *pixels = picture->images->pixels[component];
    double squares = 0, values = 0;
    for (size_t i = 0, n = (size_t)picture->desc->width * picture->desc->height; i < n; i++) {
        const float *p = pixels + i * 4;
        if (p[3] > 0) {
            squares += (double)picture->squares[i];
            values += (double)p[0] * (double)p[0] + (double)p[1] * (double)p[1] + (double)p[2] * (double)p[2];
        }
    }
    return values > 0 ? 0.5 * sqrt(squares / values) : 0;
}

static bool can_render(const ChiaroReferenceDesc *desc)
{
    const ChiaroCamera *camera = &desc->camera;
    Vec3 eye = vec3_load(camera->eye), forward = vec3_load(camera->forward), up = vec3_load(camera->up);
    float numbers = vec3_length(eye) + vec3_length(forward) + vec3_length(up) + camera->znear + camera->zfar;
    return isfinite(numbers) && camera->yfov > 0 && camera->yfov < CHIARO_PI && camera->znear >= 0 &&
           camera->zfar >= 0 && desc->width >= 1 && desc->height >= 1 && desc->width <= CHIARO_REFERENCE_MAX_SIZE &&
           desc->height <= CHIARO_REFERENCE_MAX_SIZE && desc->spp >= 1 && desc->spp <= CHIARO_REFERENCE_MAX_SPP;
}

ChiaroResult chiaro_reference_render(const ChiaroReference *reference, const ChiaroReferenceDesc *desc,
                                     ChiaroReferenceImages *images)
{
    *images = (ChiaroReferenceImages){0};
    if (!can_render(desc))
        return CHIARO_ERROR_ARGUMENT;
    size_t pixels = (size_t)desc->width * desc->height;
    Picture picture = {.world = &reference->world, .desc = desc, .images = images,
                       .squares = calloc(pixels, sizeof(float)),
                       .right = vec3_cross(vec3_load(desc->camera.forward), vec3_load(desc->camera.up)),
                       .tangent = tanf(0.5f * desc->camera.yfov)};
    images->parts = malloc(pixels * sizeof *images->parts);
    bool good = picture.squares && images->parts;
    for (uint32_t i = 0; i < CHIARO_COMPONENT_COUNT; i++) {
        images->pixels[i] = malloc(pixels * 4 * sizeof(float));
        good = good && images->pixels[i];
    }
    ChiaroResult result = good ? CHIARO_OK : CHIARO_ERROR_MEMORY;
    if (good)
        make_pools(&picture);
    picture.stage_start = picture.pools[0].count ? POOL_PROGRESS : 0;
    picture.stage_span = 1 - picture.stage_start;
    if (good && (picture.stopped || !chiaro_parallel_for(desc->threads, (uint32_t)pixels, PIXEL_RUN, trace_pixels,
                                                         &picture, tell_stage, &picture)))
        result = CHIARO_ERROR_INTERRUPTED;
    if (result == CHIARO_OK) {
        /* Light straight from lamps has no noise: every lamp is asked once. */
        images->noise[CHIARO_COMPONENT_FULL] = relative_noise(&picture, CHIARO_COMPONENT_FULL);
        images->noise[CHIARO_COMPONENT_INDIRECT] = relative_noise(&picture, CHIARO_COMPONENT_INDIRECT);
        images->rays = atomic_load(&picture.rays);
    } else {
        chiaro_reference_free_images(images);
    }
    pool_destroy(&picture.pools[0]);
    pool_destroy(&picture.pools[1]);
    free(picture.squares);
    return result;
}

void chiaro_reference_free_images(ChiaroReferenceImages *images)
{
    for (uint32_t i = 0; i < CHIARO_COMPONENT_COUNT; i++)
        free(images->pixels[i]);
    free(images->parts);
    *images = (ChiaroReferenceImages){0};
}

/* ------------------------------------------------------------------------------------------------------------------
 * Probes
 */

typedef struct Probe {
    const World *world;
    const Place *place;
    uint32_t samples, depth, seed; /* samples of one batch */
    double means[IRRADIANCE_BATCHES][3];
} Probe;

static void trace_batches(uint32_t begin, uint32_t end, uint32_t thread, void *user)
{
    (void)thread;
    Probe *probe = user;
    uint64_t rays = 0;
    for (uint32_t i = begin; i < end; i++) {
        uint64_t key = chiaro_random_mix(chiaro_random_mix(probe->seed) + i);
        mean_of_paths(probe->world, probe->place, key, probe->samples, probe->depth, NULL, probe->means[i], &rays);
    }
}

ChiaroReferenceIrradiance chiaro_reference_irradiance(const ChiaroReference *reference, const float point[3],
                                                      const float normal[3], uint32_t samples, uint32_t depth,
                                                      uint32_t seed, uint32_t threads)
{
    const World *world = &reference->world;
    Vec3 p = vec3_load(point), n = vec3_load(normal);
    Place place = {.position = p, .origin = vec3_mad(p, n, chiaro_rays_epsilon(world->rays)), .geometric = n,
                   .shading = n};
    uint64_t rays = 0;
    Vec3 punctual = path_punctual(world, &place, &rays);
    uint32_t batch = samples / IRRADIANCE_BATCHES + (samples % IRRADIANCE_BATCHES != 0 || samples == 0);
    Probe probe = {.world = world, .place = &place, .samples = batch, .depth = depth, .seed = seed};
    chiaro_parallel_for(threads, IRRADIANCE_BATCHES, 1, trace_batches, &probe, NULL, NULL);

    const double pi = 3.14159265358979323846;
    ChiaroReferenceIrradiance result = {.punctual = {pi * (double)punctual.x, pi * (double)punctual.y,
                                                     pi * (double)punctual.z}};
    for (uint32_t c = 0; c < 3; c++) {
        double mean = 0, squares = 0;
        for (uint32_t i = 0; i < IRRADIANCE_BATCHES; i++)
            mean += probe.means[i][c] / IRRADIANCE_BATCHES;
        for (uint32_t i = 0; i < IRRADIANCE_BATCHES; i++)
            squares += (probe.means[i][c] - mean) * (probe.means[i][c] - mean);
        result.indirect[c] = pi * mean;
        result.error[c] = pi * sqrt(squares / (IRRADIANCE_BATCHES * (IRRADIANCE_BATCHES - 1.0)));
    }
    return result;
}
