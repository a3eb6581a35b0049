/* Smoothing by parity classes (article: "this final step is by far the slowest").
 *
 * A cube is split into its classes by additions (a Walsh-Hadamard step of 8 texels), each class is multiplied with its own
 * small block, and the way back is the same additions. For 8 x 8 x 6 texels that is a sixteenth of the dense matrix, and
 * nothing is lost. All loops run over four floats (red, green, blue, coverage) or the twelve of the three like classes,
 * side by side, which compilers turn into vectors.
 */
#include "cubes.h"

/* Numbers of an orbit: the class even in all axes, then those even in one axis alone. */
enum { CLASSES = 4, WIDTH = CLASSES * CUBE_LANES };

/* Sums of 8 values with the signs of every class; entry k belongs to the class that is odd in the axes of k's bits. */
static inline void walsh(float value[8][CUBE_LANES])
{
    for (uint32_t bit = 1; bit < 8; bit *= 2) {
        for (uint32_t k = 0; k < 8; k++) {
            if (k & bit)
                continue;
            for (uint32_t c = 0; c < CUBE_LANES; c++) {
                float a = value[k][c], b = value[k | bit][c];
                value[k][c] = a + b, value[k | bit][c] = a - b;
            }
        }
    }
}

/* Where the orbit lies once `axis` has been turned into x; `block` orbits belong to a face. */
static inline uint32_t turned(uint32_t orbit, uint32_t axis, uint32_t block)
{
    return orbit >= axis * block ? orbit - axis * block : orbit + (3 - axis) * block;
}

static inline void copy_lanes(float *to, const float *from)
{
    for (uint32_t c = 0; c < CUBE_LANES; c++)
        to[c] = from[c];
}

static inline void split(const ChiaroCubeKernel *kernel, uint32_t orbits, const float *radiance,
                         float even[][WIDTH], float odd[3][CUBE_LANES])
{
    uint32_t block = orbits / 3;
    for (uint32_t o = 0; o < orbits; o++) {
        float value[8][CUBE_LANES];
        for (uint32_t s = 0; s < 8; s++)
            copy_lanes(value[s], radiance + CUBE_LANES * (size_t)kernel->orbit[o][s]);
        walsh(value);
        copy_lanes(even[o], value[0]);
        for (uint32_t axis = 0; axis < 3; axis++) {
            uint32_t t = turned(o, axis, block);
            copy_lanes(even[t] + (1 + axis) * CUBE_LANES, value[7u ^ 1u << axis]);
            for (uint32_t c = 0; c < CUBE_LANES; c++)
                odd[axis][c] += kernel->odd_column[t] * value[1u << axis][c];
        }
    }
}

/* Two rows at a time, so that sums do not wait for each other. */
static inline void multiply(const ChiaroCubeKernel *kernel, uint32_t orbits, const float in[][WIDTH],
                            float out[][WIDTH])
{
    uint32_t i = 0;
    for (; i + 2 <= orbits; i += 2) {
        const float(*upper)[2] = kernel->even + i * orbits, (*lower)[2] = upper + orbits;
        float a[WIDTH] = {0}, b[WIDTH] = {0};
        for (uint32_t j = 0; j < orbits; j++) {
            float a0 = upper[j][0], a1 = upper[j][1], b0 = lower[j][0], b1 = lower[j][1];
            for (uint32_t k = 0; k < CUBE_LANES; k++)
                a[k] += a0 * in[j][k];
            for (uint32_t k = CUBE_LANES; k < WIDTH; k++)
                a[k] += a1 * in[j][k];
            for (uint32_t k = 0; k < CUBE_LANES; k++)
                b[k] += b0 * in[j][k];
            for (uint32_t k = CUBE_LANES; k < WIDTH; k++)
                b[k] += b1 * in[j][k];
        }
        for (uint32_t k = 0; k < WIDTH; k++)
            out[i][k] = a[k], out[i + 1][k] = b[k];
    }
    for (; i < orbits; i++) {
        const float(*row)[2] = kernel->even + i * orbits;
        float a[WIDTH] = {0};
        for (uint32_t j = 0; j < orbits; j++) {
            float a0 = row[j][0], a1 = row[j][1];
            for (uint32_t k = 0; k < CUBE_LANES; k++)
                a[k] += a0 * in[j][k];
            for (uint32_t k = CUBE_LANES; k < WIDTH; k++)
                a[k] += a1 * in[j][k];
        }
        for (uint32_t k = 0; k < WIDTH; k++)
            out[i][k] = a[k];
    }
}

static inline void join(const ChiaroCubeKernel *kernel, uint32_t orbits, const float even[][WIDTH],
                        const float odd[3][CUBE_LANES], bool add, float *irradiance)
{
    uint32_t block = orbits / 3;
    for (uint32_t o = 0; o < orbits; o++) {
        float value[8][CUBE_LANES] = {{0}};
        copy_lanes(value[0], even[o]);
        for (uint32_t axis = 0; axis < 3; axis++) {
            uint32_t t = turned(o, axis, block);
            copy_lanes(value[7u ^ 1u << axis], even[t] + (1 + axis) * CUBE_LANES);
            for (uint32_t c = 0; c < CUBE_LANES; c++)
                value[1u << axis][c] = kernel->odd_row[t] * odd[axis][c];
        }
        walsh(value);
        for (uint32_t s = 0; s < 8; s++) {
            float *texel = irradiance + CUBE_LANES * (size_t)kernel->orbit[o][s];
            for (uint32_t c = 0; c < CUBE_LANES; c++)
                texel[c] = add ? texel[c] + value[s][c] : value[s][c];
        }
    }
}

static void smooth(const ChiaroCubeKernel *kernel, const float *radiance, bool add, float *irradiance)
{
    float in[CUBE_ORBITS][WIDTH], out[CUBE_ORBITS][WIDTH], odd[3][CUBE_LANES] = {{0}};
    split(kernel, kernel->orbit_count, radiance, in, odd);
    multiply(kernel, kernel->orbit_count, (const float(*)[WIDTH])in, out);
    join(kernel, kernel->orbit_count, (const float(*)[WIDTH])out, (const float(*)[CUBE_LANES])odd, add, irradiance);
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
