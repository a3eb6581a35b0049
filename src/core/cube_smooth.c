/* Smoothing by parity classes (article: "this final step is by far the slowest").
 *
 * A cube is split into its classes by additions (a Walsh-Hadamard step of 8 texels), each class is multiplied with its
 * own small block, and the way back is the same additions. For 8 x 8 x 6 texels that is a sixteenth of the dense
 * matrix, and nothing is lost.
 */
#include "cubes.h"

#include <string.h>

#ifdef __x86_64__
#include <immintrin.h>
#endif

/* Of an orbit: the class even in all axes, then those even in one axis alone. */
enum { CLASSES = 4, ROWS = 3 };

static inline void store(float *to, Lanes lanes) { memcpy(to, &lanes, sizeof lanes); }

static inline void butterfly(Lanes *a, Lanes *b)
{
    Lanes difference = *a - *b;
    *a += *b, *b = difference;
}

/* Sums of 8 values with the signs of every class; entry k belongs to the class that is odd in the axes of k's bits. */
static inline void walsh(Lanes v[8])
{
    butterfly(&v[0], &v[1]), butterfly(&v[2], &v[3]), butterfly(&v[4], &v[5]), butterfly(&v[6], &v[7]);
    butterfly(&v[0], &v[2]), butterfly(&v[1], &v[3]), butterfly(&v[4], &v[6]), butterfly(&v[5], &v[7]);
    butterfly(&v[0], &v[4]), butterfly(&v[1], &v[5]), butterfly(&v[2], &v[6]), butterfly(&v[3], &v[7]);
}

/* Where the orbit lies once `axis` has been turned into x; `block` orbits belong to a face. */
static inline uint32_t turned(uint32_t orbit, uint32_t axis, uint32_t block)
{
    return orbit >= axis * block ? orbit - axis * block : orbit + (3 - axis) * block;
}

static void split(const ChiaroCubeKernel *kernel, const float *radiance, Lanes even[][CLASSES], Lanes odd[3])
{
    uint32_t orbits = kernel->orbit_count, block = orbits / 3;
    for (uint32_t o = 0; o < orbits; o++) {
        uint32_t x = o, y = turned(o, 1, block), z = turned(o, 2, block);
        Lanes v[8];
        for (uint32_t s = 0; s < 8; s++)
            v[s] = lanes_load(radiance + CUBE_LANES * (size_t)kernel->orbit[o][s]);
        walsh(v);
        even[o][0] = v[0], even[x][1] = v[6], even[y][2] = v[5], even[z][3] = v[3];
        odd[0] += kernel->odd_column[x] * v[1];
        odd[1] += kernel->odd_column[y] * v[2];
        odd[2] += kernel->odd_column[z] * v[4];
    }
}

/* Three rows at a time (every cube's orbits are a multiple of three), so that sums do not wait for each other. */
static void multiply(const ChiaroCubeKernel *kernel, const Lanes in[][CLASSES], Lanes out[][CLASSES])
{
    uint32_t orbits = kernel->orbit_count;
    for (uint32_t i = 0; i < orbits; i += ROWS) {
        const float(*a)[2] = kernel->even + i * orbits, (*b)[2] = a + orbits, (*c)[2] = b + orbits;
        Lanes a0 = {0}, a1 = {0}, a2 = {0}, a3 = {0}, b0 = {0}, b1 = {0}, b2 = {0}, b3 = {0}, c0 = {0}, c1 = {0},
              c2 = {0}, c3 = {0};
        for (uint32_t j = 0; j < orbits; j++) {
            a0 += a[j][0] * in[j][0], b0 += b[j][0] * in[j][0], c0 += c[j][0] * in[j][0];
            a1 += a[j][1] * in[j][1], a2 += a[j][1] * in[j][2], a3 += a[j][1] * in[j][3];
            b1 += b[j][1] * in[j][1], b2 += b[j][1] * in[j][2], b3 += b[j][1] * in[j][3];
            c1 += c[j][1] * in[j][1], c2 += c[j][1] * in[j][2], c3 += c[j][1] * in[j][3];
        }
        out[i][0] = a0, out[i][1] = a1, out[i][2] = a2, out[i][3] = a3;
        out[i + 1][0] = b0, out[i + 1][1] = b1, out[i + 1][2] = b2, out[i + 1][3] = b3;
        out[i + 2][0] = c0, out[i + 2][1] = c1, out[i + 2][2] = c2, out[i + 2][3] = c3;
    }
}

#ifdef __x86_64__
#define WIDE __attribute__((target("avx")))

/* Numbers of two classes: the first of a row's entry four times, then the second. */
WIDE static inline __m256 entry_pair(const float entry[2])
{
    double both;
    memcpy(&both, entry, sizeof both);
    return _mm256_permutevar_ps(_mm256_castpd_ps(_mm256_set1_pd(both)), _mm256_setr_epi32(0, 0, 0, 0, 1, 1, 1, 1));
}

/* The same sums in the same order, two classes at a time, for processors that can. */
WIDE static void multiply_wide(const ChiaroCubeKernel *kernel, const Lanes in[][CLASSES], Lanes out[][CLASSES])
{
    uint32_t orbits = kernel->orbit_count;
    for (uint32_t i = 0; i < orbits; i += ROWS) {
        const float(*a)[2] = kernel->even + i * orbits, (*b)[2] = a + orbits, (*c)[2] = b + orbits;
        __m256 a0 = {0}, a2 = {0}, b0 = {0}, b2 = {0}, c0 = {0}, c2 = {0};
        for (uint32_t j = 0; j < orbits; j++) {
            __m256 low = _mm256_loadu_ps((const float *)in[j]), high = _mm256_loadu_ps((const float *)(in[j] + 2));
            a0 += entry_pair(a[j]) * low, b0 += entry_pair(b[j]) * low, c0 += entry_pair(c[j]) * low;
            a2 += a[j][1] * high, b2 += b[j][1] * high, c2 += c[j][1] * high;
        }
        float *to = (float *)out[i];
        _mm256_storeu_ps(to, a0), _mm256_storeu_ps(to + 8, a2), _mm256_storeu_ps(to + 16, b0);
        _mm256_storeu_ps(to + 24, b2), _mm256_storeu_ps(to + 32, c0), _mm256_storeu_ps(to + 40, c2);
    }
}
#endif

static void join(const ChiaroCubeKernel *kernel, const Lanes even[][CLASSES], const Lanes odd[3], bool add,
                 float *irradiance)
{
    uint32_t orbits = kernel->orbit_count, block = orbits / 3;
    for (uint32_t o = 0; o < orbits; o++) {
        uint32_t x = o, y = turned(o, 1, block), z = turned(o, 2, block);
        Lanes v[8] = {even[o][0], kernel->odd_row[x] * odd[0], kernel->odd_row[y] * odd[1], even[z][3],
                      kernel->odd_row[z] * odd[2], even[y][2], even[x][1], {0}};
        walsh(v);
        for (uint32_t s = 0; s < 8; s++) {
            float *texel = irradiance + CUBE_LANES * (size_t)kernel->orbit[o][s];
            store(texel, add ? lanes_load(texel) + v[s] : v[s]);
        }
    }
}

static void smooth(const ChiaroCubeKernel *kernel, const float *radiance, bool add, float *irradiance)
{
    _Alignas(2 * sizeof(Lanes)) Lanes in[CUBE_ORBITS][CLASSES], out[CUBE_ORBITS][CLASSES];
    Lanes odd[3] = {{0}, {0}, {0}};
    split(kernel, radiance, in, odd);
#ifdef __x86_64__
    if (kernel->wide)
        multiply_wide(kernel, (const Lanes(*)[CLASSES])in, out);
    else
#endif
        multiply(kernel, (const Lanes(*)[CLASSES])in, out);
    join(kernel, (const Lanes(*)[CLASSES])out, odd, add, irradiance);
}

void chiaro_cube_smooth(const ChiaroCubeKernel *kernel, const float *radiance, float *irradiance)
{
    smooth(kernel, radiance, false, irradiance);
}

void chiaro_cube_smooth_add(const ChiaroCubeKernel *kernel, const float *change, float *irradiance)
{
    smooth(kernel, change, true, irradiance);
}

uint32_t chiaro_cube_multiply_adds(const ChiaroCubeKernel *kernel)
{
    uint32_t n = kernel->orbit_count;
    return 3 * (CLASSES * n * n + 3 * (n + n));
}

void chiaro_cube_smooth_texel(const ChiaroCubeKernel *kernel, uint32_t texel, const float change[4], float *irradiance)
{
    uint32_t n = kernel->orbit_count, block = n / 3, j = kernel->place[texel] / 8u, octant = kernel->place[texel] % 8u;
    for (uint32_t i = 0; i < n; i++) {
        /* A column of the matrix, eight rows at a time: one entry of every class, and the way back to texels. */
        float entry[8];
        entry[0] = kernel->even[i * n + j][0];
        for (uint32_t axis = 0; axis < 3; axis++) {
            uint32_t ti = turned(i, axis, block), tj = turned(j, axis, block);
            entry[7u ^ 1u << axis] = kernel->even[ti * n + tj][1];
            entry[1u << axis] = kernel->odd_row[ti] * kernel->odd_column[tj];
        }
        entry[7] = 0;
        for (uint32_t bit = 1; bit < 8; bit *= 2) {
            for (uint32_t k = 0; k < 8; k++) {
                if (k & bit)
                    continue;
                float a = entry[k], b = entry[k | bit];
                entry[k] = a + b, entry[k | bit] = a - b;
            }
        }
        for (uint32_t s = 0; s < 8; s++) {
            float *out = irradiance + CUBE_LANES * (size_t)kernel->orbit[i][s ^ octant];
            for (uint32_t c = 0; c < CUBE_LANES; c++)
                out[c] += entry[s] * change[c];
        }
    }
}

/* A parabola over a cell of width h lies h^2 / 8 of its second derivative below its chord, in the middle, in each
 * direction: so much is what differences of neighbours tell. In the middle, for there the axes are, along which most
 * faces of made things look: a distant light, 4x4x6, is then 0.0151 rms of its peak wrong over all normals and 0.0233
 * along the axes, where h^2 / 12, the mean of the cell, leaves 0.0147 and 0.0270, and nothing 0.0206 and 0.0370. */
void chiaro_cube_sharpen(const ChiaroCubeKernel *kernel, float *texels)
{
    float before[CUBE_LANES * CHIARO_CUBE_MAX_TEXELS];
    const uint32_t edge = kernel->edge, row = edge + 2;
    memcpy(before, texels, kernel->texel_count * CUBE_LANES * sizeof(float));
    for (uint32_t j = 0; j < 6 * edge; j++) {
        const uint16_t *rim = kernel->rim + ((size_t)(j / edge) * row + j % edge + 1) * row + 1;
        for (uint32_t i = 0; i < edge; i++, rim++, texels += CUBE_LANES) {
            Lanes own = lanes_load(before + CUBE_LANES * rim[0]);
            Lanes across = lanes_load(before + CUBE_LANES * rim[-1]) + lanes_load(before + CUBE_LANES * rim[1]);
            Lanes along = lanes_load(before + CUBE_LANES * *(rim - row)) + lanes_load(before + CUBE_LANES * rim[row]);
            store(texels, own - (across + along - 4 * own) / 8);
        }
    }
}
