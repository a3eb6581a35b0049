/* Between four neighbouring texel centres the sky is bilinear, so it is sampled bilinearly: a cell by its mean
 * luminance, a point in it by the exact bilinear density. What is drawn is then proportional to the luminance that
 * chiaro_sky_radiance() answers, up to the sine of a row, and a sun of one texel makes no fireflies around it.
 * Rows of cells lie between rows of texels, so there is one more, and the first and last are half as high. */
#include "sky_sampler.h"

#include <stdlib.h>

struct SkySampler {
    uint32_t width, height;
    float *luminance; /* of each texel */
    float *columns;   /* of each row of cells: running sum over its cells, width + 1 */
    double *rows;     /* running sum over rows, height + 2 */
};

/* One row of cells: texel rows above and below, extent in v, and the sine that its solid angle is weighed by. */
typedef struct Row {
    uint32_t above, below;
    float v0, v1;
    float sine;
} Row;

static Row row_of(const SkySampler *sampler, uint32_t j)
{
    uint32_t h = sampler->height;
    float v0 = j == 0 ? 0 : ((float)j - 0.5f) / (float)h, v1 = j == h ? 1 : ((float)j + 0.5f) / (float)h;
    return (Row){j == 0 ? 0 : j - 1, j == h ? h - 1 : j, v0, v1, sinf(0.5f * (v0 + v1) * CHIARO_PI)};
}

/* Luminance at the corners of a cell; its left column of texels is i - 1. */
static void cell_corners(const SkySampler *sampler, const Row *row, uint32_t i, float corners[4])
{
    uint32_t w = sampler->width, left = (i + w - 1) % w, right = i % w;
    const float *upper = sampler->luminance + (size_t)row->above * w;
    const float *lower = sampler->luminance + (size_t)row->below * w;
    corners[0] = upper[left], corners[1] = upper[right], corners[2] = lower[left], corners[3] = lower[right];
}

static bool is_uniform(const SkySampler *sampler)
{
    for (size_t i = 1, n = (size_t)sampler->width * sampler->height; i < n; i++) {
        if (sampler->luminance[i] != sampler->luminance[0])
            return false;
    }
    return true;
}

static void sum_cells(SkySampler *sampler)
{
    uint32_t w = sampler->width;
    sampler->rows[0] = 0;
    for (uint32_t j = 0; j <= sampler->height; j++) {
        Row row = row_of(sampler, j);
        float *columns = sampler->columns + (size_t)j * (w + 1), corners[4];
        double sum = 0;
        columns[0] = 0;
        for (uint32_t i = 0; i < w; i++) {
            cell_corners(sampler, &row, i, corners);
            sum += 0.25 * ((double)corners[0] + corners[1] + corners[2] + corners[3]);
            columns[i + 1] = (float)sum;
        }
        sampler->rows[j + 1] = sampler->rows[j] + columns[w] * (double)row.sine * (double)(row.v1 - row.v0);
    }
}

SkySampler *sky_sampler_create(const ChiaroSky *sky)
{
    size_t texels = (size_t)sky->width * sky->height;
    SkySampler *sampler = calloc(1, sizeof *sampler);
    if (!sampler)
        return NULL;
    sampler->width = sky->width, sampler->height = sky->height;
    sampler->luminance = malloc(texels * sizeof(float));
    sampler->columns = malloc(((size_t)sky->width + 1) * ((size_t)sky->height + 1) * sizeof(float));
    sampler->rows = malloc(((size_t)sky->height + 2) * sizeof(double));
    if (sampler->luminance && sampler->columns && sampler->rows) {
        for (size_t i = 0; i < texels; i++)
            sampler->luminance[i] = vec3_luminance(vec3_load(sky->radiance + i * 3));
        if (!is_uniform(sampler)) {
            sum_cells(sampler);
            return sampler;
        }
    }
    sky_sampler_destroy(sampler);
    return NULL;
}

void sky_sampler_destroy(SkySampler *sampler)
{
    if (!sampler)
        return;
    free(sampler->luminance);
    free(sampler->columns);
    free(sampler->rows);
    free(sampler);
}

/* Place in [0, 1] where a density that runs linearly from a to b has passed the share u; u becomes uniform again. */
static float draw_linear(float a, float b, float u)
{
    float sum = a + b;
    if (!(sum > 0))
        return u;
    /* The stable root of a x + (b - a) x^2 / 2 = u sum / 2. */
    float x = u * sum / (a + sqrtf(fmaxf(0, a * a + u * (b - a) * sum)));
    return fminf(fmaxf(x, 0), 1);
}

static float bilinear(const float corners[4], float s, float t)
{
    return (1 - t) * ((1 - s) * corners[0] + s * corners[1]) + t * ((1 - s) * corners[2] + s * corners[3]);
}

/* From per area of the unit square of u and v to per steradian. */
static float to_solid_angle(float density, float v)
{
    float sine = sinf(v * CHIARO_PI);
    return sine > 0 ? density / (2 * CHIARO_PI * CHIARO_PI * sine) : 0;
}

static float density_at(const SkySampler *sampler, const Row *row, float luminance, float v)
{
    double total = sampler->rows[sampler->height + 1];
    return to_solid_angle((float)(luminance * (double)row->sine * sampler->width / total), v);
}

Vec3 sky_sampler_draw(const SkySampler *sampler, Pair pair, float *density)
{
    uint32_t w = sampler->width, low = 0, high = sampler->height + 1;
    double wanted = pair.v * sampler->rows[high];
    while (high - low > 1) {
        uint32_t middle = (low + high) / 2;
        *(sampler->rows[middle] <= wanted ? &low : &high) = middle;
    }
    uint32_t j = low;
    Row row = row_of(sampler, j);
    double row_share = sampler->rows[j + 1] - sampler->rows[j];
    float t_random = row_share > 0 ? (float)((wanted - sampler->rows[j]) / row_share) : 0;

    const float *columns = sampler->columns + (size_t)j * (w + 1);
    float along = pair.u * columns[w];
    low = 0, high = w;
    while (high - low > 1) {
        uint32_t middle = (low + high) / 2;
        *(columns[middle] <= along ? &low : &high) = middle;
    }
    float cell_share = columns[low + 1] - columns[low];
    float s_random = cell_share > 0 ? (along - columns[low]) / cell_share : 0;

    float corners[4];
    cell_corners(sampler, &row, low, corners);
    float t = draw_linear(corners[0] + corners[1], corners[2] + corners[3], fminf(fmaxf(t_random, 0), 1));
    float s = draw_linear((1 - t) * corners[0] + t * corners[2], (1 - t) * corners[1] + t * corners[3],
                          fminf(fmaxf(s_random, 0), 1));
    float u = ((float)low - 0.5f + s) / (float)w, v = row.v0 + t * (row.v1 - row.v0);
    float azimuth = (u - 0.5f) * 2 * CHIARO_PI, zenith = v * CHIARO_PI, sine = sinf(zenith);
    *density = density_at(sampler, &row, bilinear(corners, s, t), v);
    return vec3(sine * cosf(azimuth), cosf(zenith), sine * sinf(azimuth));
}

float sky_sampler_density(const SkySampler *sampler, Vec3 d)
{
    float w = (float)sampler->width, h = (float)sampler->height;
    float u = 0.5f + atan2f(d.z, d.x) / (2 * CHIARO_PI);
    float v = atan2f(sqrtf(d.x * d.x + d.z * d.z), d.y) / CHIARO_PI;
    float x = u * w + 0.5f, y = v * h + 0.5f;
    uint32_t i = (uint32_t)fminf(x, w), j = (uint32_t)fminf(y, h);
    Row row = row_of(sampler, j);
    float corners[4];
    cell_corners(sampler, &row, i % sampler->width, corners);
    /* i counts from the texel centre left of column 0, so width is cell 0 again. */
    return density_at(sampler, &row, bilinear(corners, x - floorf(x), (v - row.v0) / (row.v1 - row.v0)), v);
}
