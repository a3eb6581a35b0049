/* The baked block, read in place. Nothing in it is trusted: every offset, index, count and number is checked here, once,
 * so that what runs each frame need not.
 */
#include "transport.h"

#include "chiaro_shared.h"
#include "cube.h"
#include "log.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

void chiaro_file_arrays(ChiaroTransport *t, ChiaroFileArray arrays[CHIARO_FILE_ARRAYS])
{
    uint32_t n = 0;
#define ARRAY(pointer, number) \
    arrays[n++] = (ChiaroFileArray){(const void **)(void *)&t->pointer, number, sizeof *t->pointer}
    ARRAY(samples, t->sample_count);
    ARRAY(points, t->point_count);
    ARRAY(leaf_weights, t->leaf_count);
    ARRAY(sky_directions, 4 * (uint64_t)t->sky_count);
    ARRAY(nodes, t->node_count);
    ARRAY(sample_links.blocks, t->sample_links.block_count);
    ARRAY(sample_links.nodes, t->sample_links.node_count);
    ARRAY(sample_links.weights, t->sample_links.weight_count);
    ARRAY(receivers, t->receiver_count);
    ARRAY(receiver_links.blocks, t->receiver_links.block_count);
    ARRAY(receiver_links.nodes, t->receiver_links.node_count);
    ARRAY(receiver_links.weights, t->receiver_links.weight_count);
    ARRAY(vertices, t->vertex_count);
    ARRAY(vertex_receivers, t->vertex_count);
    ARRAY(indices, t->index_count);
    ARRAY(parts, t->part_count);
    ARRAY(scene.vertices, t->scene.vertex_count);
    ARRAY(scene.indices, t->scene.index_count);
    ARRAY(scene.parts, t->scene.part_count);
    ARRAY(scene.materials, t->scene.material_count);
    ARRAY(scene.textures, t->scene.texture_count);
    ARRAY(scene.lights, t->scene.light_count);
    ARRAY(scene.cameras, t->scene.camera_count);
    ARRAY(scene.pixels, t->scene.pixel_bytes);
#undef ARRAY
}

/* Every 32-bit count, in file order. */
#define COUNTS(X)                                                                                                      \
    X(sample_count) X(point_count) X(sky_count) X(leaf_count) X(node_count) X(receiver_count) X(vertex_count)          \
    X(index_count) X(small_node_end) X(part_count) X(sample_links.block_count) X(sample_links.node_count)              \
    X(sample_links.weight_count) X(receiver_links.block_count) X(receiver_links.node_count)                            \
    X(receiver_links.weight_count) X(scene.vertex_count) X(scene.index_count) X(scene.part_count)                      \
    X(scene.material_count) X(scene.texture_count) X(scene.light_count) X(scene.camera_count)

void chiaro_file_store_counts(const ChiaroTransport *transport, uint64_t counts[CHIARO_FILE_COUNTS])
{
    uint32_t n = 0;
    memset(counts, 0, CHIARO_FILE_COUNTS * sizeof *counts);
#define X(field) counts[n++] = transport->field;
    COUNTS(X)
#undef X
    counts[n] = transport->scene.pixel_bytes;
}

bool chiaro_file_load_counts(ChiaroTransport *transport, const uint64_t counts[CHIARO_FILE_COUNTS])
{
    uint32_t n = 0;
    bool fits = true;
#define X(field)                                                                                                       \
    fits = fits && counts[n] < UINT32_MAX;                                                                             \
    transport->field = (uint32_t)counts[n++];
    COUNTS(X)
#undef X
    transport->scene.pixel_bytes = counts[n];
    return fits && counts[n] < (uint64_t)1 << 40;
}

uint64_t chiaro_file_align(uint64_t offset)
{
    return (offset + CHIARO_FILE_ALIGNMENT - 1) / CHIARO_FILE_ALIGNMENT * CHIARO_FILE_ALIGNMENT;
}

uint64_t chiaro_file_checksum(const void *data, size_t size)
{
    /* FNV-1a over 64-bit words, with a shift so that high bits reach low ones. */
    uint64_t sum = 0xcbf29ce484222325u;
    size_t begin = offsetof(ChiaroFileStart, checksum) + sizeof(uint64_t);
    for (size_t i = begin; i + 8 <= size; i += 8) {
        uint64_t word;
        memcpy(&word, (const char *)data + i, 8);
        sum = (sum ^ word) * 0x100000001b3u;
        sum ^= sum >> 29;
    }
    return sum;
}

bool chiaro_file_fault(const ChiaroLog *log, const char *format, ...)
{
    char text[256];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    chiaro_log_write(log, CHIARO_LOG_ERROR, CHIARO_LOG_DATA_INVALID, "%s", text);
    return false;
}

bool chiaro_file_finite(const float *values, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        if (!isfinite(values[i]))
            return false;
    }
    return true;
}

static bool nodes_sound(const ChiaroTransport *t, const ChiaroLog *log)
{
    if (t->leaf_count != (uint64_t)t->sample_count + t->sky_count || t->node_count < t->leaf_count ||
        t->small_node_end < t->leaf_count || t->small_node_end > t->node_count)
        return chiaro_file_fault(log, "counts of samples, leaves and nodes do not agree");
    for (uint32_t n = 0; n < t->node_count; n++) {
        const ChiaroNode *node = &t->nodes[n];
        bool leaf = n < t->leaf_count;
        uint32_t below = leaf ? t->leaf_count : n < t->small_node_end ? t->leaf_count : t->small_node_end;
        if ((uint64_t)node->first + node->count > t->leaf_count || node->count == 0 || node->source_count == 0 ||
            (uint64_t)node->source_first + node->source_count > below || node->left >= t->node_count ||
            node->right >= t->node_count || !(node->area >= 0) || !isfinite(node->area))
            return chiaro_file_fault(log, "node %u points outside the tree", n);
    }
    return true;
}

/* Either no sky, or each texel of its cube once. */
static bool sky_sound(const ChiaroTransport *t, const ChiaroLog *log)
{
    bool seen[CHIARO_SKY_TEXELS] = {false};
    if (t->sky_count != 0 && t->sky_count != CHIARO_SKY_TEXELS)
        return chiaro_file_fault(log, "a sky of %u leaves is not known", t->sky_count);
    for (uint32_t s = 0; s < t->sky_count; s++) {
        const float *direction = t->sky_directions + 4 * (size_t)s;
        if (!chiaro_file_finite(direction, 4))
            return chiaro_file_fault(log, "sky leaf %u has numbers that are not finite", s);
        uint32_t texel = chiaro_cube_texel(vec3_load(direction), CHIARO_SKY_EDGE);
        if (seen[texel])
            return chiaro_file_fault(log, "two sky leaves share a texel");
        seen[texel] = true;
    }
    return true;
}

static bool samples_sound(const ChiaroTransport *t, const ChiaroLog *log)
{
    for (uint32_t s = 0; s < t->sample_count; s++) {
        const ChiaroSample *sample = &t->samples[s];
        if ((uint64_t)sample->first_point + sample->point_count > t->point_count)
            return chiaro_file_fault(log, "sample %u has points that do not exist", s);
        for (int c = 0; c < 3; c++) {
            if (!(sample->albedo[c] >= 0 && sample->albedo[c] <= 1) || !(sample->emission[c] >= 0) ||
                !isfinite(sample->emission[c]) ||
                !(sample->transmission[c] >= 0 && sample->transmission[c] <= sample->albedo[c]))
                return chiaro_file_fault(log, "sample %u has an impossible colour", s);
        }
    }
    return (chiaro_file_finite((const float *)t->points, (size_t)t->point_count * 8) &&
            chiaro_file_finite(t->leaf_weights, t->leaf_count)) ||
           chiaro_file_fault(log, "points or leaves hold numbers that are not finite");
}

static bool links_sound(const ChiaroTransport *t, const ChiaroLinks *links, uint32_t rows, const char *of,
                        const ChiaroLog *log)
{
    uint64_t next = 0;
    for (uint32_t b = 0; b < links->block_count; b++) {
        const ChiaroBlock *block = &links->blocks[b];
        bool small = block->row_count <= CHIARO_BLOCK_ROWS && block->node_count <= CHIARO_BLOCK_NODES &&
                     block->rank <= CHIARO_BLOCK_RANK && (block->channels == 1 || block->channels == 3);
        if (!small || block->first_row != next ||
            (uint64_t)block->first_node + block->node_count > links->node_count ||
            (uint64_t)block->first_weight + (uint64_t)block->channels * block->rank * block->node_count >
                links->weight_count ||
            (uint64_t)block->first_share + (uint64_t)block->rank * block->row_count > links->weight_count)
            return chiaro_file_fault(log, "block %u of the links of %s is out of range", b, of);
        next += block->row_count;
    }
    if (next != rows)
        return chiaro_file_fault(log, "the links of %s serve %llu of %u", of, (unsigned long long)next, rows);
    for (uint32_t k = 0; k < links->node_count; k++) {
        if (links->nodes[k] >= t->node_count)
            return chiaro_file_fault(log, "a link of %s points outside the tree", of);
    }
    return chiaro_file_finite(links->weights, links->weight_count) ||
           chiaro_file_fault(log, "the links of %s hold weights that are not finite", of);
}

/* Two sides of a surface name each other, and let the same through; others name nothing, which reads as the first. */
static bool receivers_sound(const ChiaroTransport *t, const ChiaroLog *log)
{
    for (uint32_t r = 0; r < t->receiver_count; r++) {
        const ChiaroReceiver *own = &t->receivers[r];
        const uint8_t *share = own->transmission;
        if (own->back == 0 && !(share[0] | share[1] | share[2]))
            continue;
        if (own->back >= t->receiver_count || own->back == r || t->receivers[own->back].back != r ||
            memcmp(share, t->receivers[own->back].transmission, 3) != 0)
            return chiaro_file_fault(log, "receiver %u has no other side", r);
    }
    return true;
}

static bool mesh_sound(const ChiaroTransport *t, const ChiaroLog *log)
{
    if (t->part_count != t->scene.part_count)
        return chiaro_file_fault(log, "the drawn mesh and the scene differ in parts");
    for (uint32_t p = 0; p < t->part_count; p++) {
        if ((uint64_t)t->parts[p].first_index + t->parts[p].index_count > t->index_count ||
            t->parts[p].index_count % 3 != 0 || t->parts[p].material >= t->scene.material_count)
            return chiaro_file_fault(log, "part %u of the drawn mesh is out of range", p);
    }
    for (uint32_t i = 0; i < t->index_count; i++) {
        if (t->indices[i] >= t->vertex_count)
            return chiaro_file_fault(log, "an index of the drawn mesh is out of range");
    }
    for (uint32_t v = 0; v < t->vertex_count; v++) {
        if (t->vertex_receivers[v] >= t->receiver_count)
            return chiaro_file_fault(log, "vertex %u has no receiver", v);
    }
    size_t numbers = (size_t)t->vertex_count * (sizeof *t->vertices / sizeof(float));
    return chiaro_file_finite((const float *)t->vertices, numbers) ||
           chiaro_file_fault(log, "the drawn mesh holds numbers that are not finite");
}

ChiaroResult chiaro_file_check(const void *data, size_t size, const char *magic, uint32_t version, size_t header,
                               const ChiaroLog *log)
{
    const ChiaroFileStart *start = data;
    if (size < header || memcmp(start->magic, magic, sizeof start->magic) != 0) {
        chiaro_file_fault(log, "not a baked file");
        return CHIARO_ERROR_DATA;
    }
    if (start->endian != CHIARO_FILE_ENDIAN || start->version != version) {
        chiaro_log_write(log, CHIARO_LOG_ERROR, CHIARO_LOG_VERSION_MISMATCH, "file version %u, this library reads %u",
                         start->version, version);
        return CHIARO_ERROR_VERSION;
    }
    if (start->size != size) {
        chiaro_file_fault(log, "%zu bytes long instead of %llu: truncated", size, (unsigned long long)start->size);
        return CHIARO_ERROR_DATA;
    }
    if (start->checksum != chiaro_file_checksum(data, size)) {
        chiaro_file_fault(log, "the checksum does not match: damaged");
        return CHIARO_ERROR_DATA;
    }
    return CHIARO_OK;
}

bool chiaro_file_place(const void *data, size_t size, size_t header, const ChiaroFileArray *arrays, uint32_t count)
{
    uint64_t offset = chiaro_file_align(header);
    for (uint32_t k = 0; k < count; k++) {
        if (arrays[k].count > (size - (offset < size ? offset : size)) / arrays[k].stride)
            return false;
        *arrays[k].slot = (const char *)data + offset;
        offset = chiaro_file_align(offset + arrays[k].count * arrays[k].stride);
    }
    return offset == size;
}

static bool origin_sound(const ChiaroFileHeader *header, const ChiaroLog *log)
{
    const double *origin = header->origin;
    if (isfinite(origin[0]) && isfinite(origin[1]) && isfinite(origin[2]))
        return true;
    return chiaro_file_fault(log, "its origin is no place");
}

ChiaroResult chiaro_transport_open(const void *data, size_t size, ChiaroTransport *transport, const ChiaroLog *log)
{
    const ChiaroFileHeader *header = data;
    if (!data || !transport || (uintptr_t)data % 16 != 0)
        return CHIARO_ERROR_ARGUMENT;
    ChiaroResult result = chiaro_file_check(data, size, CHIARO_FILE_MAGIC, CHIARO_FILE_VERSION, sizeof *header, log);
    if (result != CHIARO_OK)
        return result;
    ChiaroTransport t = {.info = header->info};
    ChiaroFileArray arrays[CHIARO_FILE_ARRAYS];
    bool sound = chiaro_file_load_counts(&t, header->counts);
    if (sound)
        chiaro_file_arrays(&t, arrays);
    if (!sound || !chiaro_file_place(data, size, sizeof *header, arrays, CHIARO_FILE_ARRAYS)) {
        chiaro_file_fault(log, "the sizes of its parts do not add up");
        return CHIARO_ERROR_DATA;
    }
    if (!origin_sound(header, log) || !nodes_sound(&t, log) || !sky_sound(&t, log) || !samples_sound(&t, log) ||
        !links_sound(&t, &t.sample_links, t.sample_count, "samples", log) ||
        !links_sound(&t, &t.receiver_links, t.receiver_count, "receivers", log) || !receivers_sound(&t, log) ||
        !mesh_sound(&t, log) ||
        chiaro_scene_check(&t.scene, log) != CHIARO_OK)
        return CHIARO_ERROR_DATA;
    *transport = t;
    return CHIARO_OK;
}

ChiaroResult chiaro_transport_origin(const void *data, size_t size, double origin[3])
{
    const ChiaroFileHeader *header = data;
    if (!data || !origin || (uintptr_t)data % 16 != 0)
        return CHIARO_ERROR_ARGUMENT;
    ChiaroResult result = chiaro_file_check(data, size, CHIARO_FILE_MAGIC, CHIARO_FILE_VERSION, sizeof *header, NULL);
    if (result != CHIARO_OK)
        return result;
    if (!origin_sound(header, NULL))
        return CHIARO_ERROR_DATA;
    memcpy(origin, header->origin, sizeof header->origin);
    return CHIARO_OK;
}
