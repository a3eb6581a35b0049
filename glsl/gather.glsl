/* Irradiance of a row of links from the patterns of its block. */
vec3 chiaro_gather_row(uint row)
{
    uvec2 place = texelFetch(rows, int(row)).xy;
    int share = int(place.x), pattern = 3 * int(place.y >> 3), end = share + int(place.y & 7u);
    vec3 sum = vec3(0);
    for (; share < end; share++, pattern += 3) {
        vec4 shares = texelFetch(link_weights, share);
        sum += vec3(dot(shares, texelFetch(patterns, pattern)), dot(shares, texelFetch(patterns, pattern + 1)),
                    dot(shares, texelFetch(patterns, pattern + 2)));
    }
    return max(sum, vec3(0));
}
