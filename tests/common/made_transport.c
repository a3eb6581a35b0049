/* A transport made by hand. */
#include "made_transport.h"

#include <stdlib.h>
#include <string.h>

#include "../../src/core/cube.h"
#include "../../src/core/random.h"
#include "chiaro_shared.h"
#include "insist.h"
#include "mesh.h"

/* Arrays under construction: the transport's own pointers are to const. */
typedef struct Made {
    ChiaroTransport t;
    ChiaroSample *samples;
    ChiaroPoint *points;
    float *leaf_weights, *sky_directions;
    ChiaroNode *nodes;
    ChiaroReceiver *receivers;
    uint32_t *vertex_receivers, *indices;
    ChiaroVertex *vertices;
    ChiaroPart *parts;
} Made;

/* The place (i, j) of a triangle whose edges are cut into `steps`. */
static Vec3 grid_point(Vec3 a, Vec3 b, Vec3 c, float i, float j, uint32_t steps)
{
    float u = i / (float)steps, v = j / (float)steps;
    return vec3_mad(vec3_mad(vec3_scale(a, 1 - u - v), b, u), c, v);
}

static void cut_triangle(Made *made, const ChiaroScene *scene, uint32_t first_index, uint32_t steps)
{
    ChiaroTransport *t = &made->t;
    Vec3 a = corner(scene, first_index), b = corner(scene, first_index + 1), c = corner(scene, first_index + 2);
    const ChiaroVertex *like = &scene->vertices[scene->indices[first_index]];
    uint32_t row = t->vertex_count;
    for (uint32_t j = 0; j <= steps; j++)
        for (uint32_t i = 0; i + j <= steps; i++) {
            ChiaroVertex *vertex = &made->vertices[t->vertex_count];
            *vertex = *like;
            vec3_store(vertex->position, grid_point(a, b, c, (float)i, (float)j, steps));
            made->vertex_receivers[t->vertex_count] = t->vertex_count;
            t->vertex_count++;
        }
    for (uint32_t j = 0; j < steps; j++) {
        uint32_t length = steps - j + 1, next = row + length;
        for (uint32_t i = 0; i + 1 < length; i++) {
            uint32_t quad[6] = {row + i, row + i + 1, next + i, row + i + 1, next + i + 1, next + i};
            for (uint32_t k = 0; k < (i + 2 < length ? 6u : 3u); k++)
                made->indices[t->index_count++] = quad[k];
        }
        row = next;
    }
}

/* A sample on the triangle whose corner is at (i, j), pointing up or down in the grid. */
static void add_sample(Made *made, const ChiaroMaterial *material, const Vec3 corners[3], uint32_t points)
{
    ChiaroTransport *t = &made->t;
    Vec3 cross = vec3_cross(vec3_sub(corners[1], corners[0]), vec3_sub(corners[2], corners[0]));
    Vec3 normal = vec3_normalize(cross), center = vec3_add(vec3_add(corners[0], corners[1]), corners[2]);
    float area = vec3_length(cross) / 2, share = area / (float)points;
    ChiaroSample *sample = &made->samples[t->sample_count++];
    center = vec3_scale(center, 1.0f / 3);
    sample->area = area;
    sample->cull = sqrtf(area / (2 * CHIARO_PI));
    vec3_store(sample->normal, normal);
    vec3_store(sample->position, vec3_mad(center, normal, -sample->cull));
    sample->first_point = t->point_count;
    sample->point_count = points;
    for (int i = 0; i < 3; i++) {
        sample->albedo[i] = material->albedo[i] * (1 - 0.1f * (float)i);
        sample->emission[i] = CHIARO_PI * material->emission[i];
        sample->transmission[i] = sample->albedo[i] * ((float)material->transmission[i] / 255);
    }
    for (uint32_t i = 0; i < points; i++) {
        ChiaroPoint *point = &made->points[t->point_count++];
        Vec3 place = points == 1 ? center : vec3_mad(vec3_scale(center, 0.5f), corners[i], 0.5f);
        point->cull = sqrtf(share / (2 * CHIARO_PI));
        point->weight = 1 / (float)points;
        vec3_store(point->normal, normal);
        vec3_store(point->position, vec3_mad(place, normal, -point->cull));
    }
}

static void sample_triangle(Made *made, const ChiaroScene *scene, const ChiaroMaterial *material, uint32_t first_index,
                            uint32_t steps, uint32_t points)
{
    Vec3 a = corner(scene, first_index), b = corner(scene, first_index + 1), c = corner(scene, first_index + 2);
    for (uint32_t j = 0; j < steps; j++)
        for (uint32_t i = 0; i + j < steps; i++) {
            float x = (float)i, y = (float)j;
            Vec3 p = grid_point(a, b, c, x + 1, y, steps), q = grid_point(a, b, c, x, y + 1, steps);
            Vec3 upper[3] = {grid_point(a, b, c, x, y, steps), p, q};
            add_sample(made, material, upper, points);
            if (i + j + 1 < steps) {
                Vec3 lower[3] = {p, grid_point(a, b, c, x + 1, y + 1, steps), q};
                add_sample(made, material, lower, points);
            }
        }
}

/* A node over [first, first + count) of the leaves, summed from [source, source + sources). */
static void add_node(Made *made, uint32_t first, uint32_t count, uint32_t source, uint32_t sources)
{
    ChiaroNode *node = &made->nodes[made->t.node_count++];
    *node = (ChiaroNode){.first = first, .count = count, .source_first = source, .source_count = sources};
    for (uint32_t i = first; i < first + count; i++)
        node->area += made->leaf_weights[i];
}

static void make_nodes(Made *made)
{
    ChiaroTransport *t = &made->t;
    uint32_t leaves = t->leaf_count, blocks = (leaves + CHIARO_SMALL_NODE - 1) / CHIARO_SMALL_NODE;
    for (uint32_t i = 0; i < leaves; i++) {
        add_node(made, i, 1, i, 1);
        made->nodes[i].left = made->nodes[i].right = i;
    }
    for (uint32_t size = 4; size <= CHIARO_SMALL_NODE; size *= 4)
        for (uint32_t i = 0; i < leaves; i += size) {
            uint32_t count = i + size < leaves ? size : leaves - i;
            add_node(made, i, count, i, count);
        }
    t->small_node_end = t->node_count;
    /* Larger nodes are runs of the blocks that came last. */
    for (uint32_t size = 4; size < 4 * blocks; size *= 4)
        for (uint32_t i = 0; i < blocks; i += size) {
            uint32_t count = i + size < blocks ? size : blocks - i, first = i * CHIARO_SMALL_NODE;
            uint32_t end = (i + count) * CHIARO_SMALL_NODE < leaves ? (i + count) * CHIARO_SMALL_NODE : leaves;
            add_node(made, first, end - first, t->small_node_end - blocks + i, count);
        }
}

/* Blocks of one row, of a few, and of as many as may be; of one pattern and of many; with one channel and with three. */
static ChiaroLinks make_links(uint32_t rows, uint32_t nodes, uint32_t links, uint64_t seed)
{
    ChiaroRandom random = chiaro_random_seed(7, seed);
    uint32_t most = rows + 1, words = 0;
    ChiaroBlock *blocks = taken(most, sizeof *blocks);
    uint32_t *cut = taken((size_t)most * (links + 40), sizeof *cut);
    ChiaroLinks table = {.blocks = blocks, .nodes = cut};
    for (uint32_t row = 0; row < rows; table.block_count++) {
        const uint32_t sizes[4] = {1, 5, CHIARO_BLOCK_ROWS, 33}, i = table.block_count;
        uint32_t size = sizes[i % 4] < rows - row ? sizes[i % 4] : rows - row;
        ChiaroBlock *block = &blocks[i];
        *block = (ChiaroBlock){.first_row = row, .row_count = size, .first_node = table.node_count, .first_weight = words};
        block->rank = 1 + i % CHIARO_BLOCK_RANK;
        block->node_count = links + 4 * (i % 10);
        block->channels = i % 3 ? 3 : 1;
        block->first_share = words + block->channels * block->rank * block->node_count;
        words = block->first_share + block->rank * size;
        for (uint32_t k = 0; k < block->node_count; k++)
            cut[table.node_count++] = chiaro_random_bits(&random) % nodes;
        row += size;
    }
    float *weights = taken(words, sizeof *weights);
    for (uint32_t k = 0; k < words; k++)
        weights[k] = chiaro_random_float(&random) / sqrtf((float)links * CHIARO_BLOCK_RANK);
    table.weights = weights;
    table.weight_count = words;
    return table;
}

static void free_links(const ChiaroLinks *links)
{
    free((void *)(uintptr_t)links->blocks);
    free((void *)(uintptr_t)links->nodes);
    free((void *)(uintptr_t)links->weights);
}

/* Receivers of two sides that let light through know each other by their place. */
static void pair_sides(Made *made, uint32_t p)
{
    const ChiaroTransport *t = &made->t;
    const ChiaroPart *own = &made->parts[p], *other = &made->parts[own->twin];
    const ChiaroMaterial *material = &t->scene.materials[own->material];
    for (uint32_t i = own->first_index; i < own->first_index + own->index_count; i++) {
        uint32_t a = made->indices[i];
        for (uint32_t k = other->first_index; k < other->first_index + other->index_count; k++) {
            uint32_t b = made->indices[k];
            Vec3 way = vec3_sub(vec3_load(t->vertices[a].position), vec3_load(t->vertices[b].position));
            if (made->receivers[a].back != 0 || made->receivers[b].back != 0 || vec3_length(way) > 1e-4f)
                continue;
            made->receivers[a].back = b, made->receivers[b].back = a;
            memcpy(made->receivers[a].transmission, material->transmission, 3);
            memcpy(made->receivers[b].transmission, material->transmission, 3);
        }
    }
}

static void allocate(Made *made, const ChiaroScene *scene, const MadeTransportDesc *desc)
{
    ChiaroTransport *t = &made->t;
    size_t triangles = scene->index_count / 3, cut = desc->mesh_steps, sampled = desc->sample_steps;
    size_t vertices = triangles * (cut + 1) * (cut + 2) / 2, samples = triangles * sampled * sampled;
    size_t leaves = samples + CHIARO_SKY_TEXELS;
    t->vertices = made->vertices = taken(vertices, sizeof *made->vertices);
    t->vertex_receivers = made->vertex_receivers = taken(vertices, sizeof(uint32_t));
    t->indices = made->indices = taken(3 * triangles * cut * cut, sizeof(uint32_t));
    t->parts = made->parts = taken(scene->part_count, sizeof *made->parts);
    t->samples = made->samples = taken(samples, sizeof *made->samples);
    t->points = made->points = taken(samples * desc->points, sizeof *made->points);
    t->leaf_weights = made->leaf_weights = taken(leaves, sizeof(float));
    t->sky_directions = made->sky_directions = taken(CHIARO_SKY_TEXELS, 4 * sizeof(float));
    t->nodes = made->nodes = taken(2 * leaves + 64, sizeof *made->nodes);
    t->receivers = made->receivers = taken(vertices, sizeof *made->receivers);
}

ChiaroTransport made_transport(const ChiaroScene *scene, const MadeTransportDesc *desc)
{
    Made made = {.t = {.scene = *scene, .part_count = scene->part_count}};
    ChiaroTransport *t = &made.t;
    allocate(&made, scene, desc);
    for (uint32_t p = 0; p < scene->part_count; p++) {
        const ChiaroPart *part = &scene->parts[p];
        made.parts[p] = *part;
        made.parts[p].first_index = t->index_count;
        for (uint32_t i = 0; i < part->index_count; i += 3) {
            cut_triangle(&made, scene, part->first_index + i, desc->mesh_steps);
            sample_triangle(&made, scene, &scene->materials[part->material], part->first_index + i, desc->sample_steps,
                            desc->points);
        }
        made.parts[p].index_count = t->index_count - made.parts[p].first_index;
    }
    for (uint32_t p = 0; p < scene->part_count; p++)
        if (scene->materials[scene->parts[p].material].transmission[0] && scene->parts[p].twin < p)
            pair_sides(&made, p);
    t->receiver_count = t->vertex_count;
    t->sky_count = desc->sky ? CHIARO_SKY_TEXELS : 0;
    t->leaf_count = t->sample_count + t->sky_count;
    t->info.links = desc->links;
    for (uint32_t i = 0; i < t->sample_count; i++)
        made.leaf_weights[i] = made.samples[i].area;
    for (uint32_t i = 0; i < t->sky_count; i++) {
        float *direction = made.sky_directions + 4 * (size_t)i;
        vec3_store(direction, chiaro_cube_texel_direction(i, CHIARO_SKY_EDGE, &direction[3]));
        made.leaf_weights[t->sample_count + i] = direction[3];
    }
    make_nodes(&made);
    t->sample_links = make_links(t->sample_count, t->node_count, desc->links, 0);
    t->receiver_links = make_links(t->receiver_count, t->node_count, desc->links, 1);
    return made.t;
}

void made_transport_free(ChiaroTransport *transport)
{
    const void *arrays[] = {transport->vertices,     transport->vertex_receivers, transport->indices,
                            transport->parts,        transport->samples,          transport->points,
                            transport->leaf_weights, transport->sky_directions,   transport->nodes,
                            transport->receivers};
    for (size_t i = 0; i < sizeof arrays / sizeof arrays[0]; i++)
        free((void *)(uintptr_t)arrays[i]);
    free_links(&transport->sample_links);
    free_links(&transport->receiver_links);
}
