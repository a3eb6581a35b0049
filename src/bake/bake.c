/* The baker: its stages in order, its settings, its progress. */
#include "../core/log.h"
#include "../offline/parallel.h"
#include "bake.h"

#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

/* Defaults where the caller leaves them to the scene. */
enum { DEFAULT_LINKS = 32, DEFAULT_RAYS = 2048, LARGE_SCENE_RAYS = 256, LEAST_RECEIVERS = 4096, MOST_RECEIVERS = 32768 };
static const float RECEIVER_PART_OF_FREE_PATH = 0.055f;
static const size_t LARGE_TABLE = (size_t)32 << 20;
/* Positions lie on so many steps along a scene's longest edge; of a float's own, steps of this part of it are told. */
static const double STEPS = 1 << 20, NOTABLE_STEP = 1e-4;

bool chiaro_bake_progress(float done, void *user)
{
    Baker *baker = user;
    float whole = baker->stage_begin + (baker->stage_end - baker->stage_begin) * done;
    return !baker->desc.progress || baker->desc.progress(baker->stage, whole, baker->desc.progress_user);
}

uint32_t chiaro_bake_ray_count(uint32_t n)
{
    uint32_t p = 16;
    while (p < n)
        p *= 2;
    return p;
}

static ChiaroResult resolve(Baker *baker, const ChiaroBakeDesc *desc)
{
    ChiaroBakeDesc *d = &baker->desc;
    if (desc) {
        if (desc->struct_size < sizeof *desc)
            return CHIARO_ERROR_ARGUMENT;
        *d = *desc;
    }
    d->links = d->links ? d->links : DEFAULT_LINKS;
    d->threads = d->threads ? d->threads : chiaro_core_count();
    bool sane = d->links <= CHIARO_MAX_LINKS && d->rays <= CHIARO_MAX_RAYS && d->threads <= 1024 &&
                (d->rays == 0 || d->rays >= 16) &&
                (d->samples == 0 || (d->samples >= CHIARO_MIN_SAMPLES && d->samples <= CHIARO_MAX_SAMPLES)) &&
                d->receivers <= 1u << 24 && isfinite(d->origin[0]) && isfinite(d->origin[1]) && isfinite(d->origin[2]);
    if (!sane)
        chiaro_log_write(&d->log, CHIARO_LOG_ERROR, CHIARO_LOG_ARGUMENT_INVALID, "links, samples, rays, threads or origin");
    return sane ? CHIARO_OK : CHIARO_ERROR_ARGUMENT;
}

/* What only the scene's size can tell. */
static void resolve_from_scene(Baker *baker)
{
    ChiaroBakeDesc *d = &baker->desc;
    double edge = RECEIVER_PART_OF_FREE_PATH * baker->free_path, wanted = baker->patches.area / (edge * edge);
    if (!d->receivers)
        d->receivers = (uint32_t)fmin(MOST_RECEIVERS, fmax(LEAST_RECEIVERS, wanted));
    if (!d->rays)
        d->rays = wanted > MOST_RECEIVERS ? LARGE_SCENE_RAYS : DEFAULT_RAYS;
    d->rays = chiaro_bake_ray_count(d->rays);
    baker->sample_rays = d->rays / 2 < 16 ? 16 : d->rays / 2;
    baker->info.rays = d->rays;
    baker->info.links = d->links;
    baker->info.seed = d->seed;
    baker->info.clamped_materials = d->clamped_materials;
    for (uint32_t m = 0; m < baker->scene->material_count; m++)
        baker->info.clamped_materials += vec3_max(vec3_load(baker->scene->materials[m].albedo)) > CHIARO_MAX_ALBEDO;
    baker->info.degenerate_triangles = baker->patches.degenerate;
}

void chiaro_bake_bounds(Baker *baker)
{
    for (int c = 0; c < 3; c++) {
        baker->info.bounds_min[c] = INFINITY, baker->info.bounds_max[c] = -INFINITY;
        for (uint32_t i = 0; i < baker->scene->index_count; i++) {
            float p = baker->scene->vertices[baker->scene->indices[i]].position[c];
            baker->info.bounds_min[c] = fminf(baker->info.bounds_min[c], p);
            baker->info.bounds_max[c] = fmaxf(baker->info.bounds_max[c], p);
        }
    }
}

/* Where and how large a scene is, is no affair of its light: it is baked by its lowest corner, its longest edge 1, and
 * moved back afterwards. So rounding is the same wherever it lies, areas neither overflow nor vanish; and as positions go
 * to steps of a tenth of what rays resolve, the bake of a scene that came in other units, or from elsewhere, is the same
 * bit by bit, but for positions that lie on the edge between two steps. */
typedef struct Frame {
    double low[3], size;
} Frame;

static void tell_coarse(const Baker *baker, double size)
{
    float furthest = 0;
    for (int c = 0; c < 3; c++)
        furthest = fmaxf(furthest, fmaxf(fabsf(baker->info.bounds_min[c]), fabsf(baker->info.bounds_max[c])));
    double step = (double)nextafterf(furthest, INFINITY) - (double)furthest;
    if (step > NOTABLE_STEP * size)
        chiaro_log_write(&baker->desc.log, CHIARO_LOG_WARNING, CHIARO_LOG_BAKE_LIMIT,
                         "%g m from the origin positions lie %g m apart, %.2g of the scene's size: move it nearer",
                         (double)furthest, step, step / size);
}

/* Returns false where memory is short. */
static bool move_near(const Baker *baker, ChiaroScene *near, Frame *frame)
{
    *frame = (Frame){.size = 0};
    for (int c = 0; c < 3 && near->index_count; c++) {
        frame->low[c] = (double)baker->info.bounds_min[c];
        frame->size = fmax(frame->size, (double)baker->info.bounds_max[c] - frame->low[c]);
    }
    frame->size = frame->size > 0 ? frame->size : 1;
    tell_coarse(baker, frame->size);
    ChiaroVertex *vertices = malloc((near->vertex_count + (size_t)1) * sizeof *vertices);
    if (!vertices)
        return false;
    for (uint32_t v = 0; v < near->vertex_count; v++) {
        vertices[v] = near->vertices[v];
        for (int c = 0; c < 3; c++) {
            double place = ((double)vertices[v].position[c] - frame->low[c]) / frame->size;
            vertices[v].position[c] = (float)(round(place * STEPS) / STEPS);
        }
    }
    near->vertices = vertices;
    return true;
}

static void place_back(const Frame *frame, float position[3])
{
    for (int c = 0; c < 3; c++)
        position[c] = (float)(frame->low[c] + frame->size * (double)position[c]);
}

static void move_back(Baker *baker, const Frame *frame)
{
    float length = (float)frame->size, area = (float)(frame->size * frame->size);
    for (uint32_t i = 0; i < baker->sample_count; i++) {
        ChiaroSample *sample = &baker->samples[i];
        place_back(frame, sample->position);
        sample->cull *= length, sample->area *= area, baker->leaf_weights[i] *= area;
    }
    for (uint32_t i = 0; i < baker->point_count; i++) {
        place_back(frame, baker->points[i].position);
        baker->points[i].cull *= length;
    }
    for (uint32_t n = 0; n < baker->node_count; n++) {
        if (baker->nodes[n].first >= baker->sample_count)
            continue; /* the sky is where it is, and as large */
        place_back(frame, baker->nodes[n].center);
        baker->nodes[n].radius *= length, baker->nodes[n].area *= area;
    }
    for (uint32_t r = 0; r < baker->receiver_count; r++) {
        place_back(frame, baker->receivers[r].position);
        baker->receivers[r].cavity_distance *= length;
    }
    for (uint32_t v = 0; v < baker->vertex_count; v++)
        place_back(frame, baker->vertices[v].position);
    baker->info.patch_size *= length;
}

float *chiaro_bake_table(size_t rows, size_t columns)
{
    size_t bytes = rows * columns * sizeof(float), page = 4096;
    float *table = calloc(rows, columns * sizeof(float));
    if (table && bytes > LARGE_TABLE) /* rows are read here and there: with large pages they are found sooner */
        (void)madvise((void *)((uintptr_t)table & ~(uintptr_t)(page - 1)), bytes, MADV_HUGEPAGE);
    return table;
}

void chiaro_bake_release(Baker *baker)
{
    Patches *p = &baker->patches;
    void *all[] = {p->triangle_first, p->triangle_edge, p->small_leaf, p->leaf_small, p->leaf_first, p->small_triangle,
                   p->triangle_part, p->leaf_cumulative, baker->samples, baker->points, baker->leaf_weights,
                   baker->sky_directions, baker->sky_order, baker->nodes, baker->row_first, baker->row_behind, baker->rows,
                   baker->vertices, baker->vertex_receivers, baker->indices, baker->parts, baker->receivers,
                   baker->receiver_plane, baker->receiver_spread, baker->receiver_share,
                   baker->column_channel, baker->direct, baker->total, baker->carried, baker->irradiance, baker->more,
                   baker->clusters, baker->sample_cluster, baker->response[0], baker->response[1], baker->response[2],
                   baker->receiver_runs, baker->sample_links.blocks, baker->sample_links.nodes,
                   baker->sample_links.weights, baker->receiver_links.blocks, baker->receiver_links.nodes,
                   baker->receiver_links.weights};
    for (size_t k = 0; k < sizeof all / sizeof *all; k++)
        free(all[k]);
    chiaro_rays_destroy(baker->rays);
}

typedef struct Stage {
    const char *name;
    ChiaroResult (*run)(Baker *);
    float end; /* of the whole bake */
} Stage;

ChiaroResult chiaro_bake(const ChiaroScene *scene, const ChiaroBakeDesc *desc, ChiaroBlob *blob)
{
    static const Stage stages[] = {
        {"patches", chiaro_bake_patches, 0.03f},           {"rows", chiaro_bake_rows, 0.15f},
        {"mesh", chiaro_bake_mesh, 0.2f},                  {"training lights", chiaro_bake_training, 0.35f},
        {"bounces", chiaro_bake_solve, 0.5f},              {"sample links", chiaro_bake_sample_links, 0.6f},
        {"more lights", chiaro_bake_more_lights, 0.65f},    {"receiver links", chiaro_bake_receiver_links, 1},
    };
    Baker baker = {.scene = scene};
    ChiaroScene near;
    Frame frame;
    if (!scene || !blob)
        return CHIARO_ERROR_ARGUMENT;
    ChiaroResult result = resolve(&baker, desc);
    if (result == CHIARO_OK)
        result = chiaro_scene_check(scene, &baker.desc.log);
    near = *scene;
    if (result == CHIARO_OK) {
        chiaro_bake_bounds(&baker);
        result = move_near(&baker, &near, &frame) ? CHIARO_OK : CHIARO_ERROR_MEMORY;
        baker.scene = &near;
    }
    if (result == CHIARO_OK) {
        chiaro_bake_bounds(&baker);
        result = chiaro_rays_create(&near, &baker.desc.log, &baker.rays);
    }
    for (size_t s = 0; s < sizeof stages / sizeof *stages && result == CHIARO_OK; s++) {
        baker.stage = stages[s].name;
        baker.stage_begin = s ? stages[s - 1].end : 0, baker.stage_end = stages[s].end;
        if (!chiaro_bake_progress(0, &baker))
            result = CHIARO_ERROR_INTERRUPTED;
        else
            result = stages[s].run(&baker);
        if (s == 0 && result == CHIARO_OK)
            resolve_from_scene(&baker);
    }
    baker.scene = scene;
    if (result == CHIARO_OK) {
        move_back(&baker, &frame);
        chiaro_bake_bounds(&baker);
        result = chiaro_bake_write(&baker, blob);
    }
    if (result == CHIARO_OK)
        chiaro_log_write(&baker.desc.log, CHIARO_LOG_INFO, CHIARO_LOG_BAKE_SUMMARY,
                         "%u samples, %u receivers, %u training lights, %u sweeps, fit %.4f (samples %.4f)",
                         baker.sample_count, baker.receiver_count, baker.info.training_lights, baker.info.solver_sweeps,
                         (double)baker.info.fit_error, (double)baker.info.sample_fit_error);
    if (result == CHIARO_ERROR_MEMORY)
        chiaro_log_write(&baker.desc.log, CHIARO_LOG_ERROR, CHIARO_LOG_OUT_OF_MEMORY, "while baking %s", baker.stage);
    chiaro_bake_release(&baker);
    if (near.vertices != scene->vertices)
        free((void *)(uintptr_t)near.vertices);
    return result;
}

void chiaro_blob_free(ChiaroBlob *blob)
{
    if (blob) {
        free(blob->data);
        *blob = (ChiaroBlob){NULL, 0};
    }
}
