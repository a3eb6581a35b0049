/* Patches: static surfaces become samples, the samples become a tree.
 *
 * Every triangle is cut into a regular lattice of small triangles, a fraction of a patch wide. These are clustered by
 * place, direction and colour into M leaves of about equal area; a leaf is a sample with the article's ten floats. Each
 * leaf is cut once more into a few points, where direct light will be evaluated. The sky is clustered the same way and
 * becomes the other half of the tree.
 */
#include "../core/cube.h"
#include "../core/log.h"
#include "../offline/parallel.h"
#include "../core/random.h"
#include "bake.h"
#include "chiaro_shared.h"
#include "lattice.h"
#include "sizing.h"

#include <stdlib.h>
#include <string.h>

enum {
    POINTS_A_SAMPLE = 4,
    SMALL_A_PATCH_EDGE = 3, /* small triangles along the edge of a patch */
    MAX_LATTICE = 4096,
    TEXTURE_PROBES = 4, /* along each edge of a small triangle of a textured part */
    EMITTER_PATCHES = 64, /* that emitters get at least */
    SURVEY_RAYS = 4096
};
/* Default M: see chiaro_bake_patches(). */
static const float PATCH_PART_OF_FREE_PATH = 0.06f, DEFAULT_LEAST_SAMPLES = 2048, DEFAULT_MOST_SAMPLES = 16384;
static const uint32_t MAX_SMALL = 6u << 20;
/* Height over a patch from which its parts are to see each other, in patches. */
static const float HOVER = 0.2f;
/* A corner stands for a covered triangle this part of the way to it. */
static const float CORNERWARD = 0.8f;

uint32_t chiaro_patches_leaf(const Patches *patches, uint32_t triangle, float u, float v)
{
    uint32_t n = patches->triangle_edge[triangle];
    return n ? patches->small_leaf[patches->triangle_first[triangle] + chiaro_lattice_index(n, u, v)] : CHIARO_NONE;
}

static void small_corners(const Baker *baker, uint32_t small, Vec3 corner[3])
{
    const Patches *p = &baker->patches;
    uint32_t triangle = p->small_triangle[small];
    Vec3 whole[3];
    float b[3][2];
    chiaro_triangle_corners(baker->scene, triangle, whole);
    chiaro_lattice_corners(p->triangle_edge[triangle], small - p->triangle_first[triangle], b);
    for (int c = 0; c < 3; c++)
        corner[c] = chiaro_triangle_at(whole, b[c][0], b[c][1]);
}

static float small_area(const Baker *baker, uint32_t small)
{
    Vec3 c[3];
    small_corners(baker, small, c);
    return vec3_length(chiaro_triangle_cross(c)) / 2;
}

/* Mean albedo and emission of a small triangle: textures are averaged over it. */
static void small_color(const Baker *baker, uint32_t small, Vec3 *albedo, Vec3 *emission)
{
    const Patches *p = &baker->patches;
    uint32_t triangle = p->small_triangle[small], part = p->triangle_part[triangle];
    const ChiaroMaterial *material = &baker->scene->materials[baker->scene->parts[part].material];
    bool textured = material->albedo_texture != CHIARO_NONE || material->emission_texture != CHIARO_NONE;
    uint32_t probes = textured ? TEXTURE_PROBES : 1;
    float b[3][2], weight = 1 / (float)(probes * probes);
    chiaro_lattice_corners(p->triangle_edge[triangle], small - p->triangle_first[triangle], b);
    *albedo = *emission = vec3(0, 0, 0);
    for (uint32_t k = 0; k < probes * probes; k++) {
        float c[3][2], a[3], e[3];
        chiaro_lattice_corners(probes, k, c);
        float s = (c[0][0] + c[1][0] + c[2][0]) / 3, t = (c[0][1] + c[1][1] + c[2][1]) / 3;
        float u = b[0][0] * (1 - s - t) + b[1][0] * s + b[2][0] * t;
        float v = b[0][1] * (1 - s - t) + b[1][1] * s + b[2][1] * t;
        chiaro_surface(baker->scene, part, triangle, u, v, a, e);
        *albedo = vec3_mad(*albedo, vec3_load(a), weight);
        *emission = vec3_mad(*emission, vec3_load(e), weight);
    }
}

static bool is_emitter(const ChiaroScene *scene, uint32_t part)
{
    return vec3_max(vec3_load(scene->materials[scene->parts[part].material].emission)) > 0;
}

/* The numbers of small triangles that patches of this size need, where they are of the usual size. */
static uint64_t plan_lattices(Baker *baker, const Sizing *sizing, float edge, float emitter_edge)
{
    const ChiaroScene *scene = baker->scene;
    Patches *p = &baker->patches;
    uint64_t count = 0;
    for (uint32_t t = 0; t < scene->index_count / 3; t++) {
        Vec3 c[3];
        chiaro_triangle_corners(scene, t, c);
        float longest = chiaro_triangle_longest_edge(c), area = vec3_length(chiaro_triangle_cross(c)) / 2;
        p->triangle_edge[t] = 0;
        if (!(area > 0))
            continue;
        float step = edge / sqrtf(chiaro_sizing_most(sizing, t));
        step = is_emitter(scene, p->triangle_part[t]) ? fminf(step, emitter_edge) : step;
        /* A needle would be cut far finer across than along: its lattice is held to 4 times what its area asks for. */
        float wanted = ceilf(longest / step), fair = ceilf(2 * sqrtf(2 * area) / step);
        p->triangle_edge[t] = (uint16_t)fmaxf(1, fminf(MAX_LATTICE, fminf(wanted, fair)));
        p->triangle_first[t] = (uint32_t)count;
        count += (uint64_t)p->triangle_edge[t] * p->triangle_edge[t];
    }
    return count;
}

static ChiaroResult cut_triangles(Baker *baker, Sizing *sizing)
{
    const ChiaroScene *scene = baker->scene;
    Patches *p = &baker->patches;
    uint32_t triangles = scene->index_count / 3;
    double emitting = 0;
    p->emitter_boost = 1;
    p->triangle_first = calloc(triangles, sizeof *p->triangle_first);
    p->triangle_edge = calloc(triangles, sizeof *p->triangle_edge);
    p->triangle_part = calloc(triangles, sizeof *p->triangle_part);
    if (!p->triangle_first || !p->triangle_edge || !p->triangle_part)
        return CHIARO_ERROR_MEMORY;
    for (uint32_t q = 0; q < scene->part_count; q++) {
        for (uint32_t t = 0; t < scene->parts[q].index_count / 3; t++)
            p->triangle_part[scene->parts[q].first_index / 3 + t] = q;
    }
    for (uint32_t t = 0; t < triangles; t++) {
        Vec3 c[3];
        chiaro_triangle_corners(scene, t, c);
        double area = vec3_length(chiaro_triangle_cross(c)) / 2;
        p->area += area;
        emitting += is_emitter(scene, p->triangle_part[t]) ? area : 0;
        p->degenerate += !(area > 0);
    }
    if (!(p->area > 0) || !isfinite(p->area)) {
        chiaro_log_write(&baker->desc.log, CHIARO_LOG_ERROR, CHIARO_LOG_SCENE_INVALID, "no triangle has an area");
        return CHIARO_ERROR_SCENE;
    }
    baker->info.patch_size = (float)sqrt(p->area / baker->desc.samples);
    if (emitting > 0)
        p->emitter_boost = (float)fmax(1, EMITTER_PATCHES * p->area / (emitting * baker->desc.samples));
    float edge = baker->info.patch_size / SMALL_A_PATCH_EDGE;
    float emitter_edge = fminf(edge, (float)sqrt(emitting / EMITTER_PATCHES) / SMALL_A_PATCH_EDGE);
    uint64_t count;
    if (!chiaro_sizing_create(baker, sizing))
        return CHIARO_ERROR_MEMORY;
    while ((count = plan_lattices(baker, sizing, edge, emitter_edge)) > MAX_SMALL && count > triangles)
        edge *= 1.25f, emitter_edge *= 1.25f;
    if (count > UINT32_MAX / 4)
        return CHIARO_ERROR_SCENE;
    p->small_count = (uint32_t)count;
    p->small_leaf = malloc(count * sizeof *p->small_leaf);
    p->leaf_small = malloc(count * sizeof *p->leaf_small);
    p->small_triangle = malloc(count * sizeof *p->small_triangle);
    p->leaf_cumulative = malloc((count + 1) * sizeof *p->leaf_cumulative);
    if (!p->small_leaf || !p->leaf_small || !p->small_triangle || !p->leaf_cumulative)
        return CHIARO_ERROR_MEMORY;
    for (uint32_t t = 0; t < triangles; t++) {
        uint32_t n = p->triangle_edge[t];
        for (uint32_t k = 0; k < n * n; k++)
            p->small_triangle[p->triangle_first[t] + k] = t;
    }
    return CHIARO_OK;
}

/* Edge of a usual patch where a small triangle lies. */
static float local_size(const Baker *baker, const Sizing *sizing, uint32_t small)
{
    const Patches *p = &baker->patches;
    uint32_t triangle = p->small_triangle[small];
    float b[3][2];
    chiaro_lattice_corners(p->triangle_edge[triangle], small - p->triangle_first[triangle], b);
    float u = (b[0][0] + b[1][0] + b[2][0]) / 3, v = (b[0][1] + b[1][1] + b[2][1]) / 3;
    return baker->info.patch_size / sqrtf(chiaro_sizing_density(sizing, triangle, u, v));
}

/* Where a small triangle is: its centre, or near that corner at which it comes out from under a solid. */
static Vec3 small_place(const Baker *baker, const Vec3 corner[3], Vec3 normal)
{
    Vec3 center = vec3_scale(vec3_add(corner[0], vec3_add(corner[1], corner[2])), 1.0f / 3);
    if (!chiaro_rays_covered(baker->rays, center, normal))
        return center;
    for (int k = 0; k < 3; k++) {
        Vec3 place = vec3_mad(vec3_scale(center, 1 - CORNERWARD), corner[k], CORNERWARD);
        if (!chiaro_rays_covered(baker->rays, place, normal))
            return place;
    }
    return center;
}

typedef struct Description {
    const Baker *baker;
    const Sizing *sizing;
    ClusterItem *items;
} Description;

/* What makes two small triangles alike, in metres: direction counts as two patches, colour as one, and emitters stay
 * among themselves whatever it costs. They weigh as much as they fill of a patch of the local size. */
static void describe_small(uint32_t begin, uint32_t end, uint32_t thread, void *user)
{
    const Description *description = user;
    const Baker *baker = description->baker;
    const Patches *p = &baker->patches;
    float far = 4 * (float)sqrt(p->area);
    (void)thread;
    for (uint32_t s = begin; s < end; s++) {
        Vec3 c[3], albedo, emission;
        small_corners(baker, s, c);
        small_color(baker, s, &albedo, &emission);
        Vec3 cross = chiaro_triangle_cross(c), normal = vec3_normalize(cross);
        bool emits = vec3_max(emission) > 0;
        ClusterItem *item = &description->items[s];
        float *f = item->feature, size = local_size(baker, description->sizing, s);
        size /= emits ? sqrtf(p->emitter_boost) : 1;
        vec3_store(f, small_place(baker, c, normal));
        f[3] = emits ? far : 0;
        vec3_store(f + 4, vec3_scale(normal, 2 * size));
        vec3_store(f + 7, vec3_scale(albedo, size));
        item->unit = size;
        item->weight = vec3_length(cross) / (2 * size * size);
    }
}

/* From here on, weights are areas. */
static void weigh_small(uint32_t begin, uint32_t end, uint32_t thread, void *user)
{
    const Description *description = user;
    (void)thread;
    for (uint32_t s = begin; s < end; s++)
        description->items[s].weight = small_area(description->baker, s);
}

/* A place above each small triangle. */
typedef struct Hover {
    const Baker *baker;
    const Sizing *sizing;
    const ClusterItem *items;
    Vec3 *places;
} Hover;

/* A part of a patch high, or half way to what is there. */
static Vec3 hover_place(const Hover *hovers, uint32_t small)
{
    const Baker *baker = hovers->baker;
    const float *f = hovers->items[small].feature;
    Vec3 place = vec3_load(f), normal = vec3_normalize(vec3_load(f + 4));
    float height = HOVER * local_size(baker, hovers->sizing, small);
    ChiaroHit hit;
    place = vec3_mad(place, normal, chiaro_rays_epsilon(baker->rays));
    if (chiaro_rays_hit(baker->rays, place, normal, 0, 2 * height, &hit))
        height = hit.distance / 2;
    return vec3_mad(place, normal, height);
}

static void hover(uint32_t begin, uint32_t end, uint32_t thread, void *user)
{
    Hover *hovers = user;
    (void)thread;
    for (uint32_t small = begin; small < end; small++)
        hovers->places[small] = hover_place(hovers, small);
}

/* For chiaro_cluster(): two faces of a patch between which a wall stands share no light. Those that see the first one's
 * place go left. */
static uint32_t split_at_walls(uint32_t *order, uint32_t count, void *user)
{
    const Hover *hovers = user;
    Vec3 from = hovers->places[order[0]];
    uint32_t left = 1;
    for (uint32_t k = 1; k < count; k++) {
        if (chiaro_rays_parted(hovers->baker->rays, from, hovers->places[order[k]]))
            continue;
        uint32_t small = order[k];
        order[k] = order[left], order[left++] = small;
    }
    return left;
}

/* Groups small triangles into about as many patches as were asked for. */
static bool cluster_small(Baker *baker, const Sizing *sizing, const ClusterItem *items, ClusterTree *tree)
{
    uint32_t count = baker->patches.small_count, threads = baker->desc.threads;
    Hover hovers = {baker, sizing, items, malloc(count * sizeof *hovers.places)};
    if (!hovers.places)
        return false;
    chiaro_parallel_for(threads, count, 256, hover, &hovers, NULL, NULL);
    ClusterDesc desc = {.items = items, .count = count, .threads = threads, .leaves = baker->desc.samples, .most = UINT32_MAX,
                        .split = split_at_walls, .user = &hovers};
    bool ok = chiaro_cluster(&desc, tree);
    free(hovers.places);
    return ok;
}

/* The point that stands for a group of small triangles: its centroid if that lies on one of them, else the centre of the
 * nearest. Groups can be bent or in pieces, and a point in the air would be lit wrongly. */
static void place_point(const Baker *baker, const ClusterItem *items, const uint32_t *small, uint32_t count,
                        ChiaroPoint *point)
{
    Vec3 mean = {0, 0, 0}, best_center = {0, 0, 0}, best_normal = {0, 0, 0};
    float weight = 0, best = INFINITY, area_scale = 0;
    for (uint32_t k = 0; k < count; k++) {
        const ClusterItem *item = &items[small[k]];
        mean = vec3_mad(mean, vec3_load(item->feature), item->weight);
        weight += item->weight;
    }
    mean = vec3_scale(mean, 1 / weight);
    for (uint32_t k = 0; k < count; k++) {
        const ClusterItem *item = &items[small[k]];
        Vec3 c[3], center = vec3_load(item->feature), normal = vec3_normalize(vec3_load(item->feature + 4));
        small_corners(baker, small[k], c);
        Vec3 away = vec3_sub(mean, center);
        float height = vec3_dot(away, normal);
        Vec3 flat = vec3_mad(mean, normal, -height);
        bool inside = fabsf(height) < 1e-3f * sqrtf(item->weight);
        for (int e = 0; inside && e < 3; e++) {
            Vec3 edge = vec3_sub(c[(e + 1) % 3], c[e]);
            inside = vec3_dot(vec3_cross(edge, vec3_sub(flat, c[e])), normal) >= -1e-3f * item->weight;
        }
        float distance = inside ? -1 : vec3_length(away);
        if (distance < best)
            best = distance, best_center = inside ? flat : center, best_normal = normal;
        area_scale += item->weight;
    }
    point->cull = sqrtf(area_scale / (2 * CHIARO_PI));
    vec3_store(point->position, vec3_mad(best_center, best_normal, -point->cull));
    vec3_store(point->normal, best_normal);
    point->weight = weight;
}

/* Its points go to where there is room for as many as any sample has. */
static bool make_sample(Baker *baker, const ClusterItem *items, uint32_t s)
{
    const Patches *p = &baker->patches;
    const uint32_t *small = p->leaf_small + p->leaf_first[s];
    uint32_t count = p->leaf_first[s + 1] - p->leaf_first[s];
    ChiaroSample *sample = &baker->samples[s];
    ClusterItem *own = malloc(count * sizeof *own);
    ClusterDesc desc = {.items = own, .count = count, .threads = 1, .leaves = POINTS_A_SAMPLE, .most = UINT32_MAX};
    ClusterTree tree;
    if (!own)
        return false;
    double area = 0, albedo[3] = {0, 0, 0}, emission[3] = {0, 0, 0};
    for (uint32_t k = 0; k < count; k++) {
        Vec3 a, e;
        own[k] = items[small[k]];
        small_color(baker, small[k], &a, &e);
        double w = own[k].weight;
        area += w;
        albedo[0] += w * a.x, albedo[1] += w * a.y, albedo[2] += w * a.z;
        emission[0] += w * e.x, emission[1] += w * e.y, emission[2] += w * e.z;
    }
    for (int c = 0; c < 3; c++) {
        sample->albedo[c] = (float)(albedo[c] / area);
        sample->emission[c] = CHIARO_PI * (float)(emission[c] / area);
    }
    sample->area = (float)area;
    sample->first_point = s * POINTS_A_SAMPLE;
    if (!chiaro_cluster(&desc, &tree)) {
        free(own);
        return false;
    }
    uint32_t group[64];
    uint32_t *members = count <= 64 ? group : malloc(count * sizeof *members);
    for (uint32_t n = 0; members && n < tree.node_count; n++) {
        const ClusterNode *node = &tree.nodes[n];
        if (node->left != CHIARO_NONE)
            continue;
        for (uint32_t k = 0; k < node->count; k++)
            members[k] = small[tree.order[node->first + k]];
        place_point(baker, items, members, node->count, &baker->points[sample->first_point + sample->point_count++]);
    }
    for (uint32_t k = 0; k < sample->point_count; k++)
        baker->points[sample->first_point + k].weight /= (float)area;
    ChiaroPoint whole = {0};
    if (members)
        place_point(baker, items, small, count, &whole);
    memcpy(sample->position, whole.position, sizeof sample->position);
    memcpy(sample->normal, whole.normal, sizeof sample->normal);
    sample->cull = whole.cull;
    bool ok = members != NULL;
    if (members != group)
        free(members);
    chiaro_cluster_free(&tree);
    free(own);
    return ok;
}

typedef struct Making {
    Baker *baker;
    const ClusterItem *items;
    bool *failed; /* of each thread */
} Making;

static void make_some(uint32_t begin, uint32_t end, uint32_t thread, void *user)
{
    const Making *making = user;
    for (uint32_t s = begin; s < end; s++)
        making->failed[thread] = !make_sample(making->baker, making->items, s) || making->failed[thread];
}

static ChiaroResult make_samples(Baker *baker, const ClusterItem *items)
{
    uint32_t threads = baker->desc.threads;
    Making making = {baker, items, calloc(threads, sizeof(bool))};
    bool failed = !making.failed;
    if (!failed)
        chiaro_parallel_for(threads, baker->sample_count, 16, make_some, &making, NULL, NULL);
    for (uint32_t t = 0; t < threads && !failed; t++)
        failed = making.failed[t];
    free(making.failed);
    if (failed)
        return CHIARO_ERROR_MEMORY;
    for (uint32_t s = 0; s < baker->sample_count; s++) {
        ChiaroSample *sample = &baker->samples[s];
        memmove(baker->points + baker->point_count, baker->points + sample->first_point,
                sample->point_count * sizeof *baker->points);
        sample->first_point = baker->point_count;
        baker->point_count += sample->point_count;
        baker->info.emitters += vec3_max(vec3_load(sample->emission)) > 0;
    }
    return CHIARO_OK;
}

/* --- the sky's texels --- */

uint32_t chiaro_sky_leaf(const Baker *baker, Vec3 direction)
{
    return baker->sky_order ? baker->sample_count + baker->sky_order[chiaro_cube_texel(direction, CHIARO_SKY_EDGE)]
                            : CHIARO_NONE;
}

static void describe_sky(ClusterItem *items)
{
    memset(items, 0, CHIARO_SKY_TEXELS * sizeof *items);
    for (uint32_t t = 0; t < CHIARO_SKY_TEXELS; t++) {
        vec3_store(items[t].feature, chiaro_cube_texel_direction(t, CHIARO_SKY_EDGE, &items[t].weight));
        items[t].unit = 1;
    }
}

/* --- the tree --- */

typedef struct Layout {
    const ClusterNode *cluster[2]; /* surface, sky */
    uint32_t leaf_offset[2];
    ChiaroNode *nodes;
    uint32_t *index[2]; /* of each cluster node in the final order; CHIARO_NONE: not placed */
    uint32_t next;
} Layout;

/* Places the largest subtrees of at most CHIARO_SMALL_NODE leaves side by side, so that a larger node is a run of them. */
static void place_small_roots(Layout *layout, int half, uint32_t n)
{
    const ClusterNode *node = &layout->cluster[half][n];
    if (node->leaf_count <= CHIARO_SMALL_NODE) {
        layout->index[half][n] = layout->next++;
        return;
    }
    place_small_roots(layout, half, node->left);
    place_small_roots(layout, half, node->right);
}

static void place_rest(Layout *layout, int half, uint32_t n, bool small)
{
    const ClusterNode *node = &layout->cluster[half][n];
    if (layout->index[half][n] == CHIARO_NONE && (node->leaf_count <= CHIARO_SMALL_NODE) == small)
        layout->index[half][n] = node->leaf_count == 1 ? layout->leaf_offset[half] + node->leaf_first : layout->next++;
    if (node->left != CHIARO_NONE) {
        place_rest(layout, half, node->left, small);
        place_rest(layout, half, node->right, small);
    }
}

static uint32_t first_small_root(const Layout *layout, int half, uint32_t n)
{
    while (layout->cluster[half][n].leaf_count > CHIARO_SMALL_NODE)
        n = layout->cluster[half][n].left;
    return layout->index[half][n];
}

static uint32_t last_small_root(const Layout *layout, int half, uint32_t n)
{
    while (layout->cluster[half][n].leaf_count > CHIARO_SMALL_NODE)
        n = layout->cluster[half][n].right;
    return layout->index[half][n];
}

static void fill_node(const Baker *baker, ChiaroNode *node)
{
    Vec3 center = {0, 0, 0}, normal = {0, 0, 0};
    float area = 0, radius = 0;
    for (uint32_t l = node->first; l < node->first + node->count; l++) {
        bool sky = l >= baker->sample_count;
        const float *place = sky ? baker->sky_directions + 4 * (l - baker->sample_count) : baker->samples[l].position;
        Vec3 p = vec3_load(place), n = sky ? vec3_scale(p, -1) : vec3_load(baker->samples[l].normal);
        if (!sky)
            p = vec3_mad(p, n, baker->samples[l].cull);
        center = vec3_mad(center, p, baker->leaf_weights[l]);
        normal = vec3_mad(normal, n, baker->leaf_weights[l]);
        area += baker->leaf_weights[l];
    }
    center = vec3_scale(center, 1 / area);
    for (uint32_t l = node->first; l < node->first + node->count && l < baker->sample_count; l++) {
        const ChiaroSample *s = &baker->samples[l];
        Vec3 p = vec3_mad(vec3_load(s->position), vec3_load(s->normal), s->cull);
        radius = fmaxf(radius, vec3_length(vec3_sub(p, center)) + sqrtf(s->area / 2));
    }
    vec3_store(node->center, center);
    vec3_store(node->normal, vec3_scale(normal, 1 / area));
    node->radius = radius;
    node->area = area;
}

static ChiaroResult build_nodes(Baker *baker, const ClusterTree *surface, const ClusterTree *sky)
{
    const ClusterTree *trees[2] = {surface, sky};
    int halves = sky->node_count ? 2 : 1;
    /* Every cluster node, a second entry for leaves that are small roots, and the root over both halves. */
    size_t most = baker->leaf_count + surface->node_count + sky->node_count + 1;
    Layout layout = {.next = baker->leaf_count, .nodes = calloc(most, sizeof(ChiaroNode))};
    baker->nodes = layout.nodes;
    if (!layout.nodes)
        return CHIARO_ERROR_MEMORY;
    for (int h = 0; h < halves; h++) {
        layout.cluster[h] = trees[h]->nodes;
        layout.leaf_offset[h] = h ? baker->sample_count : 0;
        layout.index[h] = malloc(trees[h]->node_count * sizeof *layout.index[h]);
        if (!layout.index[h]) {
            free(layout.index[0]);
            return CHIARO_ERROR_MEMORY;
        }
        memset(layout.index[h], 0xff, trees[h]->node_count * sizeof *layout.index[h]);
    }
    for (int h = 0; h < halves; h++)
        place_small_roots(&layout, h, 0);
    for (int h = 0; h < halves; h++)
        place_rest(&layout, h, 0, true);
    baker->small_node_end = layout.next;
    for (int h = 0; h < halves; h++)
        place_rest(&layout, h, 0, false);
    for (uint32_t l = 0; l < baker->leaf_count; l++) {
        layout.nodes[l] = (ChiaroNode){.first = l, .count = 1, .source_first = l, .source_count = 1, .left = l, .right = l};
    }
    for (int h = 0; h < halves; h++) {
        for (uint32_t n = 0; n < trees[h]->node_count; n++) {
            const ClusterNode *from = &trees[h]->nodes[n];
            uint32_t index = layout.index[h][n], first = layout.leaf_offset[h] + from->leaf_first;
            if (index < baker->leaf_count)
                continue;
            ChiaroNode *node = &layout.nodes[index];
            node->first = first, node->count = from->leaf_count;
            if (from->leaf_count <= CHIARO_SMALL_NODE) {
                node->source_first = first, node->source_count = from->leaf_count;
            } else {
                node->source_first = first_small_root(&layout, h, n);
                node->source_count = last_small_root(&layout, h, n) - node->source_first + 1;
            }
            bool leaf = from->left == CHIARO_NONE;
            node->left = leaf ? first : layout.index[h][from->left];
            node->right = leaf ? first : layout.index[h][from->right];
        }
    }
    baker->root = layout.index[0][0];
    if (halves == 2) {
        baker->root = layout.next++;
        ChiaroNode *root = &layout.nodes[baker->root], *a = &layout.nodes[layout.index[0][0]];
        ChiaroNode *b = &layout.nodes[layout.index[1][0]];
        root->first = 0, root->count = baker->leaf_count;
        root->source_first = first_small_root(&layout, 0, 0);
        root->source_count = last_small_root(&layout, 1, 0) - root->source_first + 1;
        root->left = (uint32_t)(a - layout.nodes), root->right = (uint32_t)(b - layout.nodes);
    }
    baker->node_count = layout.next;
    for (uint32_t n = 0; n < baker->node_count; n++)
        fill_node(baker, &layout.nodes[n]);
    for (int h = 0; h < halves; h++)
        free(layout.index[h]);
    return CHIARO_OK;
}

static ChiaroResult number_leaves(Baker *baker, const ClusterItem *items, const ClusterTree *tree)
{
    Patches *p = &baker->patches;
    baker->sample_count = tree->leaf_count;
    p->leaf_first = malloc((tree->leaf_count + (size_t)1) * sizeof *p->leaf_first);
    baker->samples = calloc(tree->leaf_count, sizeof *baker->samples);
    baker->points = calloc((size_t)tree->leaf_count * POINTS_A_SAMPLE, sizeof *baker->points);
    if (!p->leaf_first || !baker->samples || !baker->points)
        return CHIARO_ERROR_MEMORY;
    memcpy(p->leaf_small, tree->order, p->small_count * sizeof *p->leaf_small);
    p->leaf_first[tree->leaf_count] = p->small_count;
    for (uint32_t n = 0; n < tree->node_count; n++) {
        const ClusterNode *node = &tree->nodes[n];
        if (node->left != CHIARO_NONE)
            continue;
        p->leaf_first[node->leaf_first] = node->first;
        for (uint32_t k = 0; k < node->count; k++)
            p->small_leaf[tree->order[node->first + k]] = node->leaf_first;
    }
    p->leaf_cumulative[0] = 0;
    for (uint32_t k = 0; k < p->small_count; k++)
        p->leaf_cumulative[k + 1] = p->leaf_cumulative[k] + items[p->leaf_small[k]].weight;
    return CHIARO_OK;
}

void chiaro_patches_place(const Baker *baker, uint32_t sample, float pick, float u, float v, Vec3 *place, Vec3 *normal)
{
    const Patches *p = &baker->patches;
    uint32_t low = p->leaf_first[sample], high = p->leaf_first[sample + 1];
    double begin = p->leaf_cumulative[low], wanted = begin + pick * (p->leaf_cumulative[high] - begin);
    while (high - low > 1) {
        uint32_t middle = low + (high - low) / 2;
        if (p->leaf_cumulative[middle] <= wanted)
            low = middle;
        else
            high = middle;
    }
    Vec3 c[3];
    small_corners(baker, p->leaf_small[low], c);
    float root = sqrtf(u);
    *place = chiaro_triangle_at(c, root * (1 - v), root * v);
    *normal = vec3_normalize(chiaro_triangle_cross(c));
}

/* A first look with a few rays: how far light travels here, and whether any of it leaves the scene. */
static void survey(Baker *baker, bool *sky_seen)
{
    const ChiaroScene *scene = baker->scene;
    ChiaroRandom random = chiaro_random_seed(baker->desc.seed, 0x5c0e);
    uint32_t triangles = scene->index_count / 3;
    float epsilon = chiaro_rays_epsilon(baker->rays);
    double area = 0, distance = 0, weight = 0;
    *sky_seen = false;
    double *cumulative = malloc(((size_t)triangles + 1) * sizeof *cumulative);
    if (!cumulative)
        return;
    for (uint32_t t = 0; t < triangles; t++) {
        Vec3 c[3];
        chiaro_triangle_corners(scene, t, c);
        cumulative[t] = area;
        area += vec3_length(chiaro_triangle_cross(c)) / 2;
    }
    for (uint32_t k = 0; k < SURVEY_RAYS; k++) {
        double wanted = ((double)k + chiaro_random_float(&random)) / SURVEY_RAYS * area;
        uint32_t low = 0, high = triangles;
        while (high - low > 1) {
            uint32_t middle = low + (high - low) / 2;
            if (cumulative[middle] <= wanted)
                low = middle;
            else
                high = middle;
        }
        Vec3 c[3];
        chiaro_triangle_corners(scene, low, c);
        float root = sqrtf(chiaro_random_float(&random)), v = chiaro_random_float(&random);
        Vec3 normal = vec3_normalize(chiaro_triangle_cross(c));
        Vec3 origin = vec3_mad(chiaro_triangle_at(c, root * (1 - v), root * v), normal, epsilon);
        float a = chiaro_random_float(&random), b = chiaro_random_float(&random);
        ChiaroHit hit;
        if (!chiaro_rays_hit(baker->rays, origin, vec3_cosine_direction(normal, a, b), 0, INFINITY, &hit))
            *sky_seen = true;
        else if (hit.front)
            distance += hit.distance, weight += 1;
    }
    free(cumulative);
    float diagonal = vec3_length(vec3_sub(vec3_load(baker->info.bounds_max), vec3_load(baker->info.bounds_min)));
    baker->free_path = weight > 0 ? (float)(distance / weight) : diagonal;
}

ChiaroResult chiaro_bake_patches(Baker *baker)
{
    bool sky_seen;
    survey(baker, &sky_seen);
    if (!baker->desc.samples) {
        /* A patch is to be a twentieth of the distance that light travels: that is an angle, whatever the scene's size. */
        double area = 0;
        for (uint32_t t = 0; t < baker->scene->index_count / 3; t++) {
            Vec3 c[3];
            chiaro_triangle_corners(baker->scene, t, c);
            area += vec3_length(chiaro_triangle_cross(c)) / 2;
        }
        double edge = PATCH_PART_OF_FREE_PATH * baker->free_path, wanted = area / (edge * edge);
        baker->desc.samples = (uint32_t)fmin(DEFAULT_MOST_SAMPLES, fmax(DEFAULT_LEAST_SAMPLES, wanted));
    }
    Sizing sizing = {0};
    ClusterTree surface = {0}, sky = {0};
    ClusterItem *items = NULL, *texels = NULL;
    ChiaroResult result = cut_triangles(baker, &sizing);
    if (result != CHIARO_OK)
        goto done;
    result = CHIARO_ERROR_MEMORY;
    items = malloc(baker->patches.small_count * sizeof *items);
    if (!items)
        goto done;
    Description description = {baker, &sizing, items};
    chiaro_parallel_for(baker->desc.threads, baker->patches.small_count, 256, describe_small, &description, NULL, NULL);
    if (!cluster_small(baker, &sizing, items, &surface))
        goto done;
    chiaro_parallel_for(baker->desc.threads, baker->patches.small_count, 256, weigh_small, &description, NULL, NULL);
    if ((result = number_leaves(baker, items, &surface)) != CHIARO_OK || (result = make_samples(baker, items)) != CHIARO_OK)
        goto done;
    result = CHIARO_ERROR_MEMORY;
    baker->info.sky_seen = sky_seen;
    baker->sky_count = sky_seen ? CHIARO_SKY_TEXELS : 0;
    if (sky_seen) {
        texels = malloc(baker->sky_count * sizeof *texels);
        baker->sky_order = malloc(baker->sky_count * sizeof *baker->sky_order);
        if (!texels || !baker->sky_order)
            goto done;
        describe_sky(texels);
        ClusterDesc desc = {.items = texels, .count = baker->sky_count, .threads = baker->desc.threads,
                            .leaves = baker->sky_count, .most = UINT32_MAX};
        if (!chiaro_cluster(&desc, &sky))
            goto done;
    }
    baker->leaf_count = baker->sample_count + baker->sky_count;
    baker->leaf_weights = calloc(baker->leaf_count, sizeof *baker->leaf_weights);
    baker->sky_directions = calloc(4 * (size_t)baker->sky_count + 1, sizeof *baker->sky_directions);
    if (!baker->leaf_weights || !baker->sky_directions)
        goto done;
    for (uint32_t s = 0; s < baker->sample_count; s++)
        baker->leaf_weights[s] = baker->samples[s].area;
    for (uint32_t k = 0; k < baker->sky_count; k++) {
        uint32_t texel = sky.order[k];
        baker->sky_order[texel] = k;
        memcpy(baker->sky_directions + 4 * (size_t)k, texels[texel].feature, 3 * sizeof(float));
        baker->leaf_weights[baker->sample_count + k] = texels[texel].weight;
        baker->sky_directions[4 * (size_t)k + 3] = texels[texel].weight;
    }
    result = build_nodes(baker, &surface, &sky);
done:
    chiaro_sizing_destroy(&sizing);
    chiaro_cluster_free(&surface);
    chiaro_cluster_free(&sky);
    free(items);
    free(texels);
    return result;
}
