/* Lamps where nobody hung one: how wrong is bounce light when the game puts a lamp anywhere? One lamp at a time, over
 * places that are spread evenly among the receivers: half way to what stands opposite, and close to the surface. Held
 * against the path tracer at receivers that the lamp sees, and only the lamp's own light: neither the sky's nor that of
 * what glows. */
#include "report.h"

#include "../../src/core/random.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Near a wall some lamps are ten times as wrong as others: the median of a few would tell which places they had. Noise is
 * less than that, and is taken off. */
enum { PLACES = 32, QUICK_PLACES = 16, WATCHED = 128, PATHS = 512, QUICK_PATHS = 256, TRIES = 4096,
       CORNERS = 26, FIRST_TRIES = 256, STRIDE = 7919 };
/* Parts of the way to what stands opposite; nothing there: of the scene's size. */
static const float ways[REPORT_LAMPS] = {0.5f, 0.05f};
static const char *const names[REPORT_LAMPS] = {"a lamp half way to what stands opposite", "a lamp near a wall"};

/* A lamp, and receivers in its light. */
typedef struct Lamp {
    ChiaroLight light;
    uint32_t watched[WATCHED], count;
    double irradiance[WATCHED][3], error[WATCHED]; /* the truth; the square of its noise */
} Lamp;

typedef struct Bench {
    Report *report;
    const ChiaroTransport *transport;
    const ChiaroRays *rays;
    float size;
    ChiaroScene dark; /* nothing glows */
    float *scratch, *irradiance, *glow; /* of receivers: all light; without a lamp */
} Bench;

static Vec3 above(const Bench *bench, const ChiaroReceiver *receiver)
{
    return vec3_mad(vec3_load(receiver->position), vec3_load(receiver->normal), 4 * chiaro_rays_epsilon(bench->rays));
}

/* Nothing comes nearer to a lamp than what it hangs from, or stands opposite. */
static bool has_room(const Bench *bench, Vec3 place, float distance)
{
    bool free_way = true;
    for (int k = 0; k <= CORNERS && free_way; k++) {
        Vec3 way = vec3((float)(k % 3 - 1), (float)(k / 3 % 3 - 1), (float)(k / 9 - 1));
        free_way = vec3_dot(way, way) == 0 ||
                   !chiaro_rays_blocked(bench->rays, place, vec3_normalize(way), 0, 0.9f * distance);
    }
    return free_way;
}

/* False: there is no room, or hardly anything is seen from there. */
static bool hang(const Bench *bench, const ChiaroReceiver *from, float way, uint32_t seed, Lamp *lamp)
{
    const ChiaroTransport *t = bench->transport;
    ChiaroRandom random = chiaro_random_seed(seed, 11);
    ChiaroHit hit;
    Vec3 up = vec3_load(from->normal), low = above(bench, from);
    float room = chiaro_rays_hit(bench->rays, low, up, 0, bench->size, &hit) ? hit.distance : bench->size;
    Vec3 place = vec3_mad(low, up, way * room);
    if (!has_room(bench, place, way * room))
        return false;
    *lamp = (Lamp){.light = {.type = CHIARO_LIGHT_POINT, .intensity = {1, 1, 1}}};
    vec3_store(lamp->light.position, place);
    for (uint32_t k = 0; k < TRIES && lamp->count < WATCHED; k++) {
        uint32_t r = chiaro_random_bits(&random) % t->receiver_count;
        if (!chiaro_rays_parted(bench->rays, place, above(bench, &t->receivers[r])))
            lamp->watched[lamp->count++] = r;
    }
    return lamp->count > WATCHED / 4;
}

typedef struct Trace {
    const ChiaroReference *reference;
    const ChiaroTransport *transport;
    uint32_t paths;
    Lamp *lamp;
} Trace;

static void trace_watched(uint32_t begin, uint32_t end, uint32_t thread, void *user)
{
    const Trace *trace = user;
    Lamp *lamp = trace->lamp;
    (void)thread;
    for (uint32_t k = begin; k < end; k++) {
        const ChiaroReceiver *receiver = &trace->transport->receivers[lamp->watched[k]];
        ChiaroReferenceIrradiance e =
            chiaro_reference_irradiance(trace->reference, receiver->position, receiver->normal, trace->paths, 0, k, 1);
        memcpy(lamp->irradiance[k], e.indirect, sizeof e.indirect);
        lamp->error[k] = e.error[0] * e.error[0] + e.error[1] * e.error[1] + e.error[2] * e.error[2];
    }
}

/* relRMSE without the noise of the truth, which is known; and the mean ratio. */
static void measure(const Bench *bench, ReportStep *step, Lamp *lamp, double *wrong, double *ratio)
{
    const Report *report = bench->report;
    const ChiaroTransport *t = bench->transport;
    ChiaroReference *reference;
    double square = 0, all = 0, ours = 0, truth = 0;
    if (chiaro_reference_create(&bench->dark, &lamp->light, 1, NULL, NULL, &reference) != CHIARO_OK)
        options_fail(&report->options, CHIARO_EXIT_INPUT, "out of memory");
    Trace trace = {reference, t, report->quick ? QUICK_PATHS : PATHS, lamp};
    report_each(step, lamp->count, trace_watched, &trace);
    chiaro_reference_destroy(reference);
    chiaro_transport_update(t, &lamp->light, 1, NULL, chiaro_rays_visible, (void *)(uintptr_t)bench->rays,
                            bench->scratch, bench->irradiance);
    for (uint32_t k = 0; k < lamp->count; k++) {
        for (uint32_t c = 0; c < 3; c++) {
            size_t i = 3 * (size_t)lamp->watched[k] + c;
            double a = (double)(bench->irradiance[i] - bench->glow[i]), b = lamp->irradiance[k][c];
            square += (a - b) * (a - b), all += b * b, ours += a, truth += b;
        }
        square -= lamp->error[k];
    }
    *wrong = all > 0 ? sqrt(fmax(0, square) / all) : 0;
    *ratio = truth > 0 ? ours / truth : 1;
}

static void run_way(const Bench *bench, ReportStep *step, uint32_t number, ReportLamps *out)
{
    const ChiaroTransport *t = bench->transport;
    uint32_t places = bench->report->quick ? QUICK_PLACES : PLACES;
    double wrong[PLACES], ratio[PLACES];
    Lamp *lamp = report_alloc(bench->report, 1, sizeof *lamp);
    *out = (ReportLamps){.name = names[number], .median = (double)NAN, .worst = (double)NAN, .mean_ratio = (double)NAN};
    for (uint32_t k = 0; k < places; k++) {
        uint64_t from = (2 * (uint64_t)k + 1) * t->receiver_count / (2 * places);
        bool hangs = false;
        for (uint32_t i = 0; i < FIRST_TRIES && !hangs; i++, from += STRIDE)
            hangs = hang(bench, &t->receivers[from % t->receiver_count], ways[number], k, lamp);
        if (!hangs)
            continue;
        measure(bench, step, lamp, &wrong[out->count], &ratio[out->count]);
        out->count++;
    }
    free(lamp);
    if (out->count == 0)
        return;
    out->median = report_summarize(wrong, out->count).median, out->worst = wrong[out->count - 1];
    out->mean_ratio = report_summarize(ratio, out->count).median;
}

void report_lamps(Report *report, ReportScene *scene, const ChiaroTransport *t, const ChiaroRays *rays, float size)
{
    ReportStep step;
    const ChiaroScene *s = &scene->read.scene;
    ChiaroMaterial *materials = report_alloc(report, s->material_count, sizeof *materials);
    Bench bench = {.report = report, .transport = t, .rays = rays, .size = size, .dark = *s,
                   .glow = report_alloc(report, 3 * (size_t)t->receiver_count, sizeof(float)),
                   .scratch = report_alloc(report, 3 * ((size_t)t->node_count + t->sample_count), sizeof(float)),
                   .irradiance = report_alloc(report, 3 * (size_t)t->receiver_count, sizeof(float))};
    for (uint32_t m = 0; m < s->material_count; m++) {
        materials[m] = s->materials[m];
        memset(materials[m].emission, 0, sizeof materials[m].emission);
    }
    bench.dark.materials = materials;
    chiaro_transport_update(t, NULL, 0, NULL, NULL, NULL, bench.scratch, bench.glow);
    report_begin(report, "lamps elsewhere", &step);
    for (uint32_t k = 0; k < REPORT_LAMPS; k++)
        run_way(&bench, &step, k, &scene->lamps[k]);
    double worst = 100 * scene->lamps[REPORT_LAMPS - 1].median;
    if (!(report->measured[CLAIM_LAMPS] >= worst) && isfinite(worst))
        report->measured[CLAIM_LAMPS] = worst;
    free(bench.scratch);
    free(bench.irradiance);
    free(bench.glow);
    free(materials);
    report_end(&step);
}
