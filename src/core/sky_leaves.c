/* The sky as samples at infinity: each texel of the sky's cube is a leaf of the tree (article, "Environment maps": the sky
 * dome "will greatly influence the look of the finished rendering").
 */
#include "chiaro/chiaro.h"
#include "cube.h"

#include <string.h>

/* The sky is read at this many rows at least, so that a small image fills every texel. */
enum { LEAST_ROWS = 512 };

void chiaro_sky_light(const ChiaroTransport *transport, const ChiaroSky *sky, float *radiosity)
{
    uint32_t leaf_of[CHIARO_SKY_TEXELS];
    double weight[CHIARO_SKY_TEXELS] = {0}, sum[CHIARO_SKY_TEXELS][3];
    memset(radiosity, 0, 3 * (size_t)transport->sky_count * sizeof *radiosity);
    if (!sky || transport->sky_count != CHIARO_SKY_TEXELS)
        return;
    memset(sum, 0, sizeof sum);
    for (uint32_t s = 0; s < transport->sky_count; s++)
        leaf_of[chiaro_cube_texel(vec3_load(transport->sky_directions + 4 * (size_t)s), CHIARO_SKY_EDGE)] = s;
    uint32_t rows = sky->height > LEAST_ROWS ? sky->height : LEAST_ROWS;
    uint32_t columns = sky->width > 2 * rows ? sky->width : 2 * rows;
    for (uint32_t j = 0; j < rows; j++) {
        double polar = CHIARO_PI * (j + 0.5) / rows, w = sin(polar);
        for (uint32_t i = 0; i < columns; i++) {
            double azimuth = 2 * CHIARO_PI * ((i + 0.5) / columns - 0.5);
            float rgb[3], d[3] = {(float)(w * cos(azimuth)), (float)cos(polar), (float)(w * sin(azimuth))};
            chiaro_sky_radiance(sky, d, rgb);
            uint32_t texel = chiaro_cube_texel(vec3_load(d), CHIARO_SKY_EDGE);
            weight[texel] += w;
            for (int c = 0; c < 3; c++)
                sum[texel][c] += w * rgb[c];
        }
    }
    double whole = 0, sent[3] = {0}, kept[3] = {0}, solid_angle = 0;
    for (uint32_t t = 0; t < CHIARO_SKY_TEXELS; t++) {
        double angle = (double)transport->sky_directions[4 * (size_t)leaf_of[t] + 3];
        whole += weight[t], solid_angle += angle;
        for (int c = 0; c < 3; c++) {
            sent[c] += sum[t][c];
            sum[t][c] = weight[t] > 0 ? sum[t][c] / weight[t] : 0;
            kept[c] += angle * sum[t][c];
        }
    }
    /* Texels hold a whole number of places, so their means weigh a lone bright spot a few percent wrong. */
    for (uint32_t t = 0; t < CHIARO_SKY_TEXELS; t++) {
        for (int c = 0; c < 3; c++) {
            double right = kept[c] > 0 ? sent[c] / whole * solid_angle / kept[c] : 0;
            radiosity[3 * leaf_of[t] + (uint32_t)c] = (float)(CHIARO_PI * sum[t][c] * right);
        }
    }
}
