/* The baked block, written: the mirror of chiaro_transport_open(). */
#include "bake.h"

#include <stdlib.h>
#include <string.h>

static ChiaroLinks links_of(const LinkTable *table)
{
    return (ChiaroLinks){table->blocks, table->nodes, table->weights, table->block_count, table->node_count,
                         table->weight_count};
}

ChiaroResult chiaro_bake_block(const ChiaroFileStart *header, size_t header_size, const ChiaroFileArray *arrays,
                               uint32_t count, ChiaroBlob *blob)
{
    uint64_t size = chiaro_file_align(header_size);
    for (uint32_t k = 0; k < count; k++)
        size = chiaro_file_align(size + arrays[k].count * arrays[k].stride);
    char *data = calloc(1, size);
    if (!data)
        return CHIARO_ERROR_MEMORY;
    memcpy(data, header, header_size);
    ChiaroFileStart *start = (ChiaroFileStart *)(void *)data;
    start->endian = CHIARO_FILE_ENDIAN;
    start->size = size;
    uint64_t offset = chiaro_file_align(header_size);
    for (uint32_t k = 0; k < count; k++) {
        size_t bytes = arrays[k].count * arrays[k].stride;
        if (bytes)
            memcpy(data + offset, *arrays[k].slot, bytes);
        offset = chiaro_file_align(offset + bytes);
    }
    start->checksum = chiaro_file_checksum(data, size);
    *blob = (ChiaroBlob){data, size};
    return CHIARO_OK;
}

ChiaroResult chiaro_bake_write(Baker *baker, ChiaroBlob *blob)
{
    ChiaroTransport t = {
        .info = baker->info,
        .scene = *baker->scene,
        .samples = baker->samples,
        .points = baker->points,
        .leaf_weights = baker->leaf_weights,
        .sky_directions = baker->sky_directions,
        .nodes = baker->nodes,
        .receivers = baker->receivers,
        .sample_links = links_of(&baker->sample_links),
        .receiver_links = links_of(&baker->receiver_links),
        .vertices = baker->vertices,
        .vertex_receivers = baker->vertex_receivers,
        .indices = baker->indices,
        .parts = baker->parts,
        .sample_count = baker->sample_count,
        .point_count = baker->point_count,
        .sky_count = baker->sky_count,
        .leaf_count = baker->leaf_count,
        .node_count = baker->node_count,
        .receiver_count = baker->receiver_count,
        .vertex_count = baker->vertex_count,
        .index_count = baker->index_count,
        .small_node_end = baker->small_node_end,
        .part_count = baker->scene->part_count,
    };
    ChiaroFileArray arrays[CHIARO_FILE_ARRAYS];
    ChiaroFileHeader header;
    memset(&header, 0, sizeof header); /* what lies between its members is written too */
    header.info = baker->info;
    memcpy(header.origin, baker->desc.origin, sizeof header.origin);
    chiaro_file_arrays(&t, arrays);
    chiaro_file_store_counts(&t, header.counts);
    header.start.version = CHIARO_FILE_VERSION;
    memcpy(header.start.magic, CHIARO_FILE_MAGIC, sizeof header.start.magic);
    return chiaro_bake_block(&header.start, sizeof header, arrays, CHIARO_FILE_ARRAYS, blob);
}
