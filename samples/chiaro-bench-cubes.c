/* Environment cubes alone: how right and how fast their smoothing is, beside the straightforward dense loop and an
 * equally tuned route by spherical harmonics of order 2, in one run. A line for each size. */
#include "../src/core/cubes.h"
#include "../src/core/lanes.h"
#include "../src/core/random.h"
#include "chiaro/chiaro_primitives.h"
#include "common/options.h"

#include <stdio.h>
#include <stdlib.h>
#include <time.h>

enum { TEXELS = CHIARO_CUBE_MAX_TEXELS, HARMONICS = 9, NORMALS = 400, LIGHTS = 200, SPHERES = 20, REPEATS = 4000,
       SKIES = 8, SKY_ROWS = 180, SKY_NORMALS = 60 };

static const char help[] = "Usage: chiaro-bench-cubes\n"
                           "Prints error and cost of painting and smoothing environment cubes.\n";

typedef struct Bench {
    ChiaroCubeKernel *kernel;
    uint32_t count;
    float in[4 * TEXELS], out[4 * TEXELS], other[4 * TEXELS];
    float dense[TEXELS * TEXELS], harmonics[TEXELS][HARMONICS];
    double matrix[TEXELS * TEXELS];
    Vec3 normals[NORMALS];
} Bench;

typedef void (*Smooth)(Bench *bench);

static double seconds(void)
{
    struct timespec now;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

static Vec3 any_direction(ChiaroRandom *random)
{
    float z = 2 * chiaro_random_float(random) - 1, turn = 2 * CHIARO_PI * chiaro_random_float(random);
    float radius = sqrtf(1 - z * z);
    return vec3(radius * cosf(turn), radius * sinf(turn), z);
}

static float look_up(const Bench *bench, const float *texels, Vec3 normal)
{
    float n[3], value[4];
    vec3_store(n, normal);
    chiaro_cube_look_up(bench->kernel, texels, n, value);
    return value[0];
}

/* ---- three ways to smooth ----------------------------------------------------------------------------------------- */

static void smooth_ours(Bench *bench) { chiaro_cube_smooth(bench->kernel, bench->in, bench->out); }

static void smooth_densely(Bench *bench)
{
    for (uint32_t i = 0; i < bench->count; i++) {
        const float *row = bench->dense + (size_t)i * bench->count;
        float red = 0, green = 0, blue = 0;
        for (uint32_t j = 0; j < bench->count; j++) {
            red += row[j] * bench->in[4 * j];
            green += row[j] * bench->in[4 * j + 1];
            blue += row[j] * bench->in[4 * j + 2];
        }
        bench->out[4 * i] = red, bench->out[4 * i + 1] = green, bench->out[4 * i + 2] = blue;
    }
}

/* Nine sums over the texels, then nine terms for each texel; colours side by side in a vector. */
static void smooth_by_harmonics(Bench *bench)
{
    static const float band[HARMONICS] = {1, 2.0f / 3, 2.0f / 3, 2.0f / 3, 0.25f, 0.25f, 0.25f, 0.25f, 0.25f};
    Lanes sum[HARMONICS];
    for (uint32_t h = 0; h < HARMONICS; h++)
        sum[h] = lanes_of(0);
    for (uint32_t t = 0; t < bench->count; t++) {
        Lanes color = lanes_load(bench->in + 4 * t) * bench->kernel->weight[t];
        for (uint32_t h = 0; h < HARMONICS; h++)
            sum[h] += color * bench->harmonics[t][h];
    }
    for (uint32_t h = 0; h < HARMONICS; h++)
        sum[h] *= band[h];
    for (uint32_t t = 0; t < bench->count; t++) {
        Lanes color = lanes_of(0);
        for (uint32_t h = 0; h < HARMONICS; h++)
            color += sum[h] * bench->harmonics[t][h];
        memcpy(bench->out + 4 * t, &color, sizeof color);
    }
}

/* Real spherical harmonics, orthonormal (R. Ramamoorthi, P. Hanrahan, "An Efficient Representation for Irradiance
 * Environment Maps", 2001). */
static void fill_harmonics(Bench *bench)
{
    for (uint32_t t = 0; t < bench->count; t++) {
        Vec3 d = chiaro_cube_centre(bench->kernel, t);
        const float h[HARMONICS] = {0.282095f, 0.488603f * d.y, 0.488603f * d.z, 0.488603f * d.x,
                                    1.092548f * d.x * d.y, 1.092548f * d.y * d.z, 0.315392f * (3 * d.z * d.z - 1),
                                    1.092548f * d.x * d.z, 0.546274f * (d.x * d.x - d.y * d.y)};
        memcpy(bench->harmonics[t], h, sizeof h);
    }
}

/* Microseconds, the best of several runs. */
static double cost(Bench *bench, Smooth smooth, uint32_t repeats)
{
    double best = INFINITY;
    for (int run = 0; run < 5; run++) {
        double begin = seconds();
        for (uint32_t k = 0; k < repeats; k++)
            smooth(bench);
        best = fmin(best, seconds() - begin);
    }
    return 1e6 * best / repeats;
}

/* ---- errors ------------------------------------------------------------------------------------------------------- */

/* Largest difference from the dense matrix in double precision, against the largest value. */
static double parity_error(Bench *bench, ChiaroRandom *random)
{
    double worst = 0, largest = 0;
    for (uint32_t i = 0; i < 4 * bench->count; i++)
        bench->in[i] = chiaro_random_float(random);
    smooth_ours(bench);
    for (uint32_t i = 0; i < bench->count; i++) {
        double sum = 0;
        for (uint32_t j = 0; j < bench->count; j++)
            sum += bench->matrix[(size_t)i * bench->count + j] * (double)bench->in[4 * j];
        worst = fmax(worst, fabs(sum - (double)bench->out[4 * i])), largest = fmax(largest, fabs(sum));
    }
    return worst / largest;
}

static double uniform_error(Bench *bench)
{
    double worst = 0;
    for (uint32_t i = 0; i < 4 * bench->count; i++)
        bench->in[i] = 1;
    smooth_ours(bench);
    for (uint32_t i = 0; i < bench->count; i++)
        worst = fmax(worst, fabs((double)bench->out[4 * i] - 1));
    return worst;
}

/* Root of the mean square error over normals and lights, against the peak. */
static double far_light_error(Bench *bench, ChiaroRandom *random, Smooth smooth)
{
    double square = 0;
    for (uint32_t k = 0; k < LIGHTS; k++) {
        Vec3 way = any_direction(random);
        float toward[3];
        const float flux[3] = {CHIARO_PI, CHIARO_PI, CHIARO_PI};
        vec3_store(toward, way);
        memset(bench->in, 0, sizeof bench->in);
        chiaro_cube_splat(bench->kernel, toward, flux, bench->in);
        smooth(bench);
        for (uint32_t i = 0; i < NORMALS; i++) {
            double wrong = (double)(look_up(bench, bench->out, bench->normals[i]) - fmaxf(0, vec3_dot(way, bench->normals[i])));
            square += wrong * wrong / (LIGHTS * NORMALS);
        }
    }
    return sqrt(square);
}

/* The worst painted sphere of half-angle 3 to 60 degrees: rms over normals, against the peak. */
static double sphere_error(Bench *bench, ChiaroRandom *random)
{
    ChiaroCubeTexel texels[TEXELS];
    const float origin[3] = {0, 0, 0};
    double worst = 0;
    for (uint32_t k = 0; k < SPHERES; k++) {
        for (float degrees = 3; degrees <= 60; degrees *= 1.35f) {
            Vec3 way = any_direction(random);
            float radius = sinf(degrees * CHIARO_PI / 180), center[3], normal[3];
            ChiaroCubeDisc disc = {.radiance = {1, 1, 1}, .distance = 1, .depth = radius,
                                   .solid_angle = chiaro_cube_sphere_angle(radius, 1)};
            double square = 0, peak = (double)(radius * radius);
            vec3_store(disc.direction, way);
            vec3_store(center, way);
            chiaro_cube_clear(bench->kernel, texels);
            chiaro_cube_paint(bench->kernel, texels, &disc);
            chiaro_cube_resolve(bench->kernel, texels, NULL, bench->in);
            smooth_ours(bench);
            for (uint32_t i = 0; i < NORMALS; i++) {
                vec3_store(normal, bench->normals[i]);
                double wrong = (double)(look_up(bench, bench->out, bench->normals[i]) -
                                        chiaro_sphere_form(origin, normal, center, radius));
                square += wrong * wrong / NORMALS;
            }
            worst = fmax(worst, sqrt(square) / peak);
        }
    }
    return worst;
}

/* A made sky: a gradient, broad clouds, and a glare that is some hundred times as bright. */
typedef struct MadeSky {
    Vec3 lobe[3];
    float power[3], bright[3];
} MadeSky;

static void made_radiance(const float direction[3], float radiance[3], void *user)
{
    const MadeSky *sky = user;
    float sum = direction[1] > 0 ? 0.4f + 0.6f * (1 - direction[1]) : 0.2f;
    for (uint32_t k = 0; k < 3; k++) {
        float cosine = vec3_dot(sky->lobe[k], vec3_load(direction));
        sum += cosine > 0 ? sky->bright[k] * powf(cosine, sky->power[k]) : 0;
    }
    radiance[0] = radiance[1] = radiance[2] = sum;
}

/* The worst relRMSE of irradiance under some of them. */
static double sky_error(Bench *bench, ChiaroRandom *random)
{
    double worst = 0;
    for (uint32_t s = 0; s < SKIES; s++) {
        MadeSky sky = {.power = {4, 30, 600}, .bright = {1, 6, 150}};
        double truth[SKY_NORMALS] = {0}, wrong = 0, square = 0;
        for (uint32_t k = 0; k < 3; k++)
            sky.lobe[k] = any_direction(random);
        for (uint32_t j = 0; j < SKY_ROWS; j++) {
            float polar = CHIARO_PI * ((float)j + 0.5f) / SKY_ROWS, y = cosf(polar), radius = sinf(polar);
            double share = (double)(radius * CHIARO_PI / (SKY_ROWS * SKY_ROWS)); /* of the solid angle, over pi */
            for (uint32_t i = 0; i < 2 * SKY_ROWS; i++) {
                float turn = CHIARO_PI * ((float)i + 0.5f) / SKY_ROWS, d[3] = {radius * cosf(turn), y, radius * sinf(turn)};
                float rgb[3];
                made_radiance(d, rgb, &sky);
                for (uint32_t n = 0; n < SKY_NORMALS; n++)
                    truth[n] += (double)(fmaxf(0, vec3_dot(bench->normals[n], vec3_load(d))) * rgb[0]) * share;
            }
        }
        chiaro_cube_background(bench->kernel, made_radiance, &sky, 32, bench->in);
        smooth_ours(bench);
        for (uint32_t n = 0; n < SKY_NORMALS; n++) {
            double a = (double)look_up(bench, bench->out, bench->normals[n]) - truth[n];
            wrong += a * a, square += truth[n] * truth[n];
        }
        worst = fmax(worst, sqrt(wrong / square));
    }
    return worst;
}

static void bench_edge(Bench *bench, uint32_t edge)
{
    ChiaroRandom random = chiaro_random_seed(1, 2);
    if (chiaro_cube_kernel_create(edge, CHIARO_CUBE_FITTED, NULL, &bench->kernel) != CHIARO_OK)
        exit(CHIARO_EXIT_INPUT);
    bench->count = chiaro_cube_texel_count(bench->kernel);
    chiaro_cube_kernel_matrix(bench->kernel, bench->matrix);
    for (uint32_t i = 0; i < bench->count * bench->count; i++)
        bench->dense[i] = (float)bench->matrix[i];
    for (uint32_t i = 0; i < NORMALS; i++)
        bench->normals[i] = any_direction(&random);
    fill_harmonics(bench);
    double parity = parity_error(bench, &random), uniform = uniform_error(bench);
    double ours = cost(bench, smooth_ours, REPEATS), dense = cost(bench, smooth_densely, REPEATS / 40);
    double harmonics = cost(bench, smooth_by_harmonics, REPEATS);
    printf("cube %ux%ux6 : parity against dense %.1e, uniform %.1e, %u multiply-adds (dense %u), %.2f us (dense %.2f us, "
           "ratio %.1f; harmonics %.2f us, ratio %.2f)\n", edge, edge, parity, uniform,
           chiaro_cube_multiply_adds(bench->kernel), 3 * bench->count * bench->count, ours, dense, dense / ours, harmonics,
           ours / harmonics);
    double light = far_light_error(bench, &random, smooth_ours);
    double blurred = far_light_error(bench, &random, smooth_by_harmonics);
    printf("cube %ux%ux6 : far light rms %.4f of peak (harmonics %.4f), painted spheres worst rms %.4f of peak, %u made "
           "skies worst relRMSE %.4f\n", edge, edge, light, blurred, sphere_error(bench, &random), SKIES,
           sky_error(bench, &random));
    chiaro_cube_kernel_destroy(bench->kernel);
}

int main(int argc, char **argv)
{
    Bench *bench = calloc(1, sizeof *bench);
    SceneOptions options = {.program = "chiaro-bench-cubes", .usage = help};
    for (int i = 1; i < argc; i++) {
        if (!options_take(&options, argc, argv, &i))
            options_fail(&options, CHIARO_EXIT_USAGE, "no arguments are known");
    }
    if (!bench)
        return CHIARO_EXIT_INPUT;
    for (uint32_t edge = 4; edge <= 8; edge += 2)
        bench_edge(bench, edge);
    free(bench);
    return CHIARO_EXIT_OK;
}
