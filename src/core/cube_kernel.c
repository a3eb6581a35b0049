/* The kernel of environment cubes: which texel lies where, and the matrix that smooths.
 *
 * Plain: K[i][j] = max(0, d_i . d_j) * solid angle of j, rows normalised.
 *
 * Fitted: let b(d) be the bilinear weights of the texels in direction d. A light of flux F from d is painted as F b(d);
 * a normal n looks up b(n) . x. The best matrix M makes b(n) M b(d) = max(0, n . d) / pi for all n and d in the sense
 * of least squares: M = G^-1 C G^-1 with G the integral of b b' and C that of b(n) max(0, n . d) / pi b'(d). The
 * integrals run over Gauss points in every quarter of a texel, where b is smooth, and these points have the symmetry of
 * the grid: so has M.
 *
 * Both are made class by class. In the class of sign pattern sigma a function is known by its values in one octant:
 *   b_sigma(d)[orbit] = sum over octants s of sigma(s) b(d)[texel of the orbit in s]
 *   k_sigma(n, d) = sum over octants s of sigma(s) max(0, n . s d) / pi,
 * and the equations above hold with these in place of b and k. Since max(0, x) = |x| / 2 + x / 2, the classes that are
 * odd in one axis see n_x d_x alone, which is a product: rank 1. The class odd in all axes sees nothing. The even ones,
 * "even in all axes" and three that turning the axes makes the same, keep a full block each.
 */
#include "cubes.h"

#include <stdlib.h>
#include <string.h>

enum { GAUSS = 3, MAX_POINTS = 3 * CHIARO_CUBE_MAX_EDGE * CHIARO_CUBE_MAX_EDGE * GAUSS * GAUSS };

/* The classes that are worked out: even in all axes, even in x alone, odd in x alone. Bits: the axes that are odd. */
enum { CLASS_EVEN = 0, CLASS_EVEN_X = 6, CLASS_ODD_X = 1 };

/* A direction of the octant of positive x, y, z, its solid angle and the bilinear weights of orbits. */
typedef struct Point {
    double d[3], angle;
    uint32_t orbit[4], octant[4];
    double weight[4];
} Point;

/* What a fit works with. */
typedef struct Work {
    double gram[CUBE_ORBITS * CUBE_ORBITS];  /* then its Cholesky factor */
    double cross[CUBE_ORBITS * CUBE_ORBITS]; /* C, then M */
    double row[CUBE_ORBITS];
    uint32_t point_count;
    Point points[MAX_POINTS];
} Work;

static void *default_alloc(size_t size, void *user)
{
    (void)user;
    return malloc(size);
}

static void default_free(void *memory, void *user)
{
    (void)user;
    free(memory);
}

/* +1 or -1: the sign of an octant in a class. */
static double class_sign(uint32_t class_axes, uint32_t octant)
{
    uint32_t odd = class_axes & octant;
    return (odd ^ odd >> 1 ^ odd >> 2) & 1 ? -1 : 1;
}

/* ------------------------------------------------------------------------------------------------------------------
 * Tables of the grid
 */

static void make_rim(ChiaroCubeKernel *kernel)
{
    uint32_t edge = kernel->edge, row = edge + 2;
    for (uint32_t face = 0; face < 6; face++) {
        for (uint32_t j = 0; j < row; j++) {
            for (uint32_t i = 0; i < row; i++) {
                /* The plane of the face goes on: what lies beyond its edge falls into the neighbour's outer row. */
                float x = (2 * (float)i - 1) / (float)edge - 1, y = (2 * (float)j - 1) / (float)edge - 1;
                bool corner = (i == 0 || i > edge) && (j == 0 || j > edge);
                kernel->rim[((size_t)face * row + j) * row + i] =
                    corner ? CUBE_NO_TEXEL : (uint16_t)chiaro_cube_texel(chiaro_cube_direction(face, x, y), edge);
            }
        }
    }
}

static void make_orbits(ChiaroCubeKernel *kernel)
{
    uint32_t half = kernel->edge / 2;
    for (uint32_t t = 0; t < kernel->texel_count; t++) {
        float angle, d[3];
        vec3_store(d, chiaro_cube_texel_direction(t, kernel->edge, &angle));
        uint32_t octant = (d[0] < 0 ? 1u : 0) | (d[1] < 0 ? 2u : 0) | (d[2] < 0 ? 4u : 0), axis = 0;
        for (uint32_t a = 1; a < 3; a++)
            axis = fabsf(d[a]) > fabsf(d[axis]) ? a : axis;
        float scale = (float)half / fabsf(d[axis]);
        uint32_t u = (uint32_t)(fabsf(d[(axis + 1) % 3]) * scale), v = (uint32_t)(fabsf(d[(axis + 2) % 3]) * scale);
        uint32_t orbit = (axis * half + u) * half + v;
        kernel->orbit[orbit][octant] = (uint16_t)t;
        kernel->place[t] = (uint16_t)(8 * orbit + octant);
    }
}

/* A tent ends at the centres of the texels around it. */
static void make_reach(ChiaroCubeKernel *kernel)
{
    uint32_t edge = kernel->edge, row = edge + 2;
    for (uint32_t t = 0; t < kernel->texel_count; t++) {
        float angle;
        Vec3 centre = chiaro_cube_texel_direction(t, edge, &angle);
        kernel->centre[0][t] = centre.x, kernel->centre[1][t] = centre.y, kernel->centre[2][t] = centre.z;
    }
    for (uint32_t t = 0; t < kernel->texel_count; t++) {
        uint32_t i = t % edge, j = t / edge % edge, face = t / (edge * edge);
        Vec3 centre = chiaro_cube_centre(kernel, t);
        float cosine = 1;
        for (uint32_t k = 0; k < 9; k++) {
            uint32_t other = kernel->rim[((size_t)face * row + j + k / 3) * row + i + k % 3];
            if (other != CUBE_NO_TEXEL)
                cosine = fminf(cosine, vec3_dot(centre, chiaro_cube_centre(kernel, other)));
        }
        kernel->reach[t][0] = cosine, kernel->reach[t][1] = sqrtf(1 - cosine * cosine);
    }
}

/* ------------------------------------------------------------------------------------------------------------------
 * Directions of one octant
 */

static void make_points(const ChiaroCubeKernel *kernel, Work *work)
{
    static const double node[GAUSS] = {0.11270166537925831, 0.5, 0.88729833462074169};
    static const double gauss[GAUSS] = {5.0 / 18, 8.0 / 18, 5.0 / 18};
    uint32_t edge = kernel->edge, steps = edge * GAUSS; /* quarters of texels from 0 to 1: as many as texels from -1 */
    double sum = 0;
    work->point_count = 0;
    for (uint32_t k = 0; k < 3 * steps * steps; k++) {
        uint32_t axis = k / (steps * steps), i = k / steps % steps, j = k % steps;
        double u = (i / GAUSS + node[i % GAUSS]) / edge, v = (j / GAUSS + node[j % GAUSS]) / edge;
        double length = sqrt(1 + u * u + v * v);
        Point *point = &work->points[work->point_count++];
        point->d[axis] = 1 / length, point->d[(axis + 1) % 3] = u / length, point->d[(axis + 2) % 3] = v / length;
        point->angle = gauss[i % GAUSS] * gauss[j % GAUSS] / (length * length * length);
        sum += point->angle;
        ChiaroCubeTaps taps =
            chiaro_cube_taps(kernel, vec3((float)point->d[0], (float)point->d[1], (float)point->d[2]));
        for (uint32_t t = 0; t < 4; t++) {
            point->orbit[t] = kernel->place[taps.texel[t]] / 8u;
            point->octant[t] = kernel->place[taps.texel[t]] % 8u;
            point->weight[t] = (double)taps.weight[t];
        }
    }
    for (uint32_t p = 0; p < work->point_count; p++)
        work->points[p].angle *= 4 * atan(1) / 2 / sum; /* pi / 2: an octant */
}

static void make_weights(ChiaroCubeKernel *kernel, Work *work)
{
    double weight[CUBE_ORBITS] = {0};
    for (uint32_t p = 0; p < work->point_count; p++) {
        for (uint32_t t = 0; t < 4; t++)
            weight[work->points[p].orbit[t]] += work->points[p].angle * work->points[p].weight[t];
    }
    for (uint32_t t = 0; t < kernel->texel_count; t++)
        kernel->weight[t] = (float)weight[kernel->place[t] / 8u];
}

/* ------------------------------------------------------------------------------------------------------------------
 * One class
 */

/* The kernel max(0, n . d) / pi summed over the octants, each with the sign of the class. */
static double class_kernel(uint32_t class_axes, const double n[3], const double d[3])
{
    static const double pi = 3.14159265358979323846;
    double x = n[0] * d[0], y = n[1] * d[1], z = n[2] * d[2];
    double a = x + y + z, b = fabs(x + y - z), c = fabs(x - y + z), e = fabs(x - y - z); /* a is not negative */
    return class_axes == CLASS_EVEN ? (a + b + c + e) / pi : (a - b - c + e) / pi;
}

/* In place; the lower triangle holds the factor. The tents are independent, so no pivot comes near zero. */
static void factor(double *matrix, uint32_t n)
{
    for (uint32_t j = 0; j < n; j++) {
        for (uint32_t i = j; i < n; i++) {
            double sum = matrix[i * n + j];
            for (uint32_t k = 0; k < j; k++)
                sum -= matrix[i * n + k] * matrix[j * n + k];
            matrix[i * n + j] = i == j ? sqrt(sum) : sum / matrix[j * n + j];
        }
    }
}

/* Solves for a vector whose entries lie `stride` apart. */
static void solve(const double *lower, uint32_t n, double *x, uint32_t stride)
{
    for (uint32_t i = 0; i < n; i++) {
        for (uint32_t k = 0; k < i; k++)
            x[i * stride] -= lower[i * n + k] * x[k * stride];
        x[i * stride] /= lower[i * n + i];
    }
    for (uint32_t i = n; i-- > 0;) {
        for (uint32_t k = i + 1; k < n; k++)
            x[i * stride] -= lower[k * n + i] * x[k * stride];
        x[i * stride] /= lower[i * n + i];
    }
}

/* Weights of a point's orbits in a class. */
static void class_weights(const Point *point, uint32_t class_axes, double weight[4])
{
    for (uint32_t t = 0; t < 4; t++)
        weight[t] = point->weight[t] * class_sign(class_axes, point->octant[t]);
}

static void make_gram(Work *work, uint32_t n, uint32_t class_axes)
{
    memset(work->gram, 0, sizeof work->gram);
    for (uint32_t p = 0; p < work->point_count; p++) {
        const Point *point = &work->points[p];
        double weight[4];
        class_weights(point, class_axes, weight);
        for (uint32_t s = 0; s < 4; s++) {
            for (uint32_t t = 0; t < 4; t++)
                work->gram[point->orbit[s] * n + point->orbit[t]] += point->angle * weight[s] * weight[t];
        }
    }
    factor(work->gram, n);
}

/* work->cross becomes M of an even class. */
static void fit_even(Work *work, uint32_t n, uint32_t class_axes)
{
    make_gram(work, n, class_axes);
    memset(work->cross, 0, sizeof work->cross);
    for (uint32_t p = 0; p < work->point_count; p++) {
        const Point *normal = &work->points[p];
        double row[CUBE_ORBITS] = {0}, weight[4];
        for (uint32_t q = 0; q < work->point_count; q++) {
            const Point *light = &work->points[q];
            double value = light->angle * class_kernel(class_axes, normal->d, light->d);
            class_weights(light, class_axes, weight);
            for (uint32_t t = 0; t < 4; t++)
                row[light->orbit[t]] += value * weight[t];
        }
        class_weights(normal, class_axes, weight);
        for (uint32_t t = 0; t < 4; t++) {
            for (uint32_t j = 0; j < n; j++)
                work->cross[normal->orbit[t] * n + j] += normal->angle * weight[t] * row[j];
        }
    }
    for (uint32_t j = 0; j < n; j++)
        solve(work->gram, n, work->cross + j, n);
    for (uint32_t i = 0; i < n; i++)
        solve(work->gram, n, work->cross + (size_t)i * n, 1);
}

/* work->row becomes the vector whose product with itself, times 4 / pi, is M of the class odd in x. */
static void fit_odd(Work *work, uint32_t n)
{
    make_gram(work, n, CLASS_ODD_X);
    memset(work->row, 0, sizeof work->row);
    for (uint32_t p = 0; p < work->point_count; p++) {
        const Point *point = &work->points[p];
        double weight[4];
        class_weights(point, CLASS_ODD_X, weight);
        for (uint32_t t = 0; t < 4; t++)
            work->row[point->orbit[t]] += point->angle * point->d[0] * weight[t];
    }
    solve(work->gram, n, work->row, 1);
}

/* The same between texel centres. */
static void plain_even(const ChiaroCubeKernel *kernel, Work *work, uint32_t class_axes, const double d[][3])
{
    uint32_t n = kernel->orbit_count;
    for (uint32_t i = 0; i < n; i++) {
        for (uint32_t j = 0; j < n; j++)
            work->cross[i * n + j] = class_kernel(class_axes, d[i], d[j]);
    }
}

/* ------------------------------------------------------------------------------------------------------------------
 * The whole matrix
 */

static void make_matrix(ChiaroCubeKernel *kernel, Work *work)
{
    static const double pi = 3.14159265358979323846;
    uint32_t n = kernel->orbit_count;
    double d[CUBE_ORBITS][3], angle[CUBE_ORBITS], norm[CUBE_ORBITS];
    bool fitted = kernel->method == CHIARO_CUBE_FITTED;
    for (uint32_t o = 0; o < n; o++) {
        float solid_angle;
        Vec3 centre = chiaro_cube_texel_direction(kernel->orbit[o][0], kernel->edge, &solid_angle);
        d[o][0] = (double)centre.x, d[o][1] = (double)centre.y, d[o][2] = (double)centre.z;
        angle[o] = (double)(fitted ? kernel->weight[kernel->orbit[o][0]] : solid_angle);
    }
    static const uint32_t classes[2] = {CLASS_EVEN, CLASS_EVEN_X};
    for (uint32_t k = 0; k < 2; k++) {
        if (fitted)
            fit_even(work, n, classes[k]);
        else
            plain_even(kernel, work, classes[k], d);
        for (uint32_t i = 0; i < n; i++) {
            double sum = 0;
            for (uint32_t j = 0; j < n; j++)
                sum += work->cross[i * n + j] * angle[j];
            /* A uniform cube lies in the class that is even in all axes; each of its rows adds up to 1. */
            norm[i] = k ? norm[i] : sum;
            for (uint32_t j = 0; j < n; j++)
                kernel->even[i * n + j][k] = (float)(work->cross[i * n + j] * angle[j] / (8 * norm[i]));
        }
    }
    if (fitted)
        fit_odd(work, n);
    for (uint32_t o = 0; o < n; o++) {
        double value = fitted ? work->row[o] : d[o][0];
        kernel->odd_row[o] = (float)(4 / pi * value / (8 * norm[o]));
        kernel->odd_column[o] = (float)(value * angle[o]);
    }
}

ChiaroResult chiaro_cube_kernel_create(uint32_t edge, ChiaroCubeMethod method, const ChiaroAllocator *allocator,
                                       ChiaroCubeKernel **kernel)
{
    ChiaroAllocator memory = {default_alloc, default_free, NULL};
    if (!kernel)
        return CHIARO_ERROR_ARGUMENT;
    *kernel = NULL;
    if ((edge != 4 && edge != 6 && edge != 8) || (method != CHIARO_CUBE_FITTED && method != CHIARO_CUBE_PLAIN))
        return CHIARO_ERROR_ARGUMENT;
    if (allocator && !allocator->alloc != !allocator->free)
        return CHIARO_ERROR_ARGUMENT;
    if (allocator && allocator->alloc)
        memory = *allocator;
    ChiaroCubeKernel *made = memory.alloc(sizeof *made, memory.user);
    Work *work = made ? memory.alloc(sizeof *work, memory.user) : NULL;
    if (!work) {
        if (made)
            memory.free(made, memory.user);
        return CHIARO_ERROR_MEMORY;
    }
    memset(made, 0, sizeof *made);
    made->edge = edge, made->texel_count = 6 * edge * edge, made->orbit_count = made->texel_count / 8;
    made->method = method, made->allocator = memory;
#ifdef __x86_64__
    made->wide = __builtin_cpu_supports("avx");
#endif
    make_rim(made);
    make_orbits(made);
    make_reach(made);
    make_points(made, work);
    make_weights(made, work);
    make_matrix(made, work);
    memory.free(work, memory.user);
    *kernel = made;
    return CHIARO_OK;
}

void chiaro_cube_kernel_destroy(ChiaroCubeKernel *kernel)
{
    if (kernel) {
        ChiaroAllocator memory = kernel->allocator;
        memory.free(kernel, memory.user);
    }
}

uint32_t chiaro_cube_texel_count(const ChiaroCubeKernel *kernel) { return kernel->texel_count; }

float chiaro_cube_texel_weight(const ChiaroCubeKernel *kernel, uint32_t texel) { return kernel->weight[texel]; }

void chiaro_cube_kernel_matrix(const ChiaroCubeKernel *kernel, double *matrix)
{
    uint32_t n = kernel->orbit_count, block = n / 3;
    for (uint32_t row = 0; row < kernel->texel_count; row++) {
        for (uint32_t column = 0; column < kernel->texel_count; column++) {
            uint32_t i = kernel->place[row] / 8u, j = kernel->place[column] / 8u;
            uint32_t turn = (kernel->place[row] ^ kernel->place[column]) % 8u;
            double sum = (double)kernel->even[i * n + j][0];
            for (uint32_t axis = 0; axis < 3; axis++) {
                /* The class of another axis is that of x with the axes turned. */
                uint32_t ti = (i + n - axis * block) % n, tj = (j + n - axis * block) % n;
                sum += class_sign(7u ^ 1u << axis, turn) * (double)kernel->even[ti * n + tj][1];
                sum += class_sign(1u << axis, turn) * (double)kernel->odd_row[ti] * (double)kernel->odd_column[tj];
            }
            matrix[(size_t)row * kernel->texel_count + column] = sum;
        }
    }
}
