/* A block of links: light of the cut's nodes -> patterns -> irradiance of the rows. One work group a block. Twin of
 * chiaro_links_gather. Includers define NODES and WEIGHTS, the arrays of their links. */
shared vec3 chiaro_light[CHIARO_BLOCK_NODES];
shared vec3 chiaro_part[CHIARO_BLOCK_RANK * CHIARO_BLOCK_PARTS];
shared vec3 chiaro_pattern[CHIARO_BLOCK_RANK];

/* Collects the patterns of a block, from the half of values that begins at `first`. */
void chiaro_gather_patterns(ChiaroGpuBlock block, uint first)
{
    uint lane = gl_LocalInvocationIndex, nodes = block.rows.w, rank = block.weights.z;
    for (uint i = lane; i < nodes; i += CHIARO_GROUP_SIZE)
        chiaro_light[i] = values[first + NODES[block.rows.z + i]].rgb;
    barrier();
    uint channel = block.weights.w == 3 ? rank * nodes : 0;
    for (uint task = lane; task < rank * CHIARO_BLOCK_PARTS; task += CHIARO_GROUP_SIZE) {
        uint row = block.weights.x + task / CHIARO_BLOCK_PARTS * nodes;
        vec3 sum = vec3(0);
        for (uint i = task % CHIARO_BLOCK_PARTS; i < nodes; i += CHIARO_BLOCK_PARTS) {
            vec3 weight = vec3(WEIGHTS[row + i], WEIGHTS[row + channel + i], WEIGHTS[row + 2 * channel + i]);
            sum += weight * chiaro_light[i];
        }
        chiaro_part[task] = sum;
    }
    barrier();
    if (lane < rank) {
        vec3 sum = vec3(0);
        for (uint part = 0; part < CHIARO_BLOCK_PARTS; part++)
            sum += chiaro_part[lane * CHIARO_BLOCK_PARTS + part];
        chiaro_pattern[lane] = sum;
    }
    barrier();
}

vec3 chiaro_gather_row(ChiaroGpuBlock block, uint row)
{
    vec3 sum = vec3(0);
    for (uint p = 0; p < block.weights.z; p++)
        sum += chiaro_pattern[p] * WEIGHTS[block.weights.y + p * block.rows.y + row];
    return max(sum, vec3(0));
}
