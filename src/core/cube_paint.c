/* Painting environment cubes, and looking them up (article: Environment maps).
 *
 * The article draws a thing as one pixel. Its light then jumps from texel to texel, and a small thing may miss them
 * all; so a thing is spread, by its true solid angle, over the texels whose tents it touches. What a texel shows is a
 * share of its solid angle: radiance * solid angle is kept, however small the thing is.
 */
#include "cubes.h"
#include "lanes.h"

#include <string.h>

/* In texels: distance of the samples that a disc is spread by, and the radii up to which one sample and one ring will
 * do. Samples at 0.3 take twice the time and bring no sphere of the tests' nearer by more than a tenth of its error. */
#define SPACING 0.4f
#define ONE_SAMPLE 0.15f
#define ONE_RING 0.5f
/* A ring starts this much of a turn after the last: the golden section, which never lines up. Its cosine and sine. */
#define GOLDEN_COSINE -0.73736888f
#define GOLDEN_SINE 0.67549029f

/* Small skies are read at this many rows, twice as many columns. */
enum { LEAST_ROWS = 512 };

static bool is_direction(Vec3 d)
{
    float square = vec3_dot(d, d);
    return square > 0 && isfinite(square);
}

/* ------------------------------------------------------------------------------------------------------------------
 * Discs
 */

float chiaro_cube_sphere_angle(float radius, float distance)
{
    if (!(radius > 0))
        return 0;
    if (!(radius < distance))
        return 2 * CHIARO_PI;
    float s = radius / distance;
    /* 2 pi (1 - cos), in the form that does not cancel. */
    return 2 * CHIARO_PI * s * s / (1 + sqrtf(1 - s * s));
}

void chiaro_cube_clear(const ChiaroCubeKernel *kernel, ChiaroCubeTexel *texels)
{
    memset(texels, 0, kernel->texel_count * sizeof *texels);
}

/* What a disc takes of the texels: solid angle first, then share. */
typedef struct Cover {
    float share[CHIARO_CUBE_MAX_TEXELS];
} Cover;

static void cover_point(const ChiaroCubeTaps *taps, float angle, Cover *cover)
{
    for (uint32_t k = 0; k < 4; k++)
        cover->share[taps->texel[k]] += angle * taps->weight[k];
}

/* A ring of samples about an axis: its middle, two ways across it, and the place of the first sample by them; a quarter of
 * its samples. */
typedef struct Ring {
    Vec3 middle, tangent, bitangent;
    float x, y;
    uint32_t quarter;
} Ring;

static void cover_ring(const ChiaroCubeKernel *kernel, Ring ring, float angle, Cover *cover)
{
    float turn = CHIARO_PI / 2 / (float)ring.quarter, c = 0, s = 1;
    if (ring.quarter > 1)
        c = cosf(turn), s = sinf(turn);
    for (uint32_t k = 0; k < ring.quarter; k++) {
        /* Four, a quarter of a turn apart. */
        const Lanes x = {ring.x, -ring.y, -ring.x, ring.y}, y = {ring.y, ring.x, -ring.y, -ring.x};
        ring.y = s * x[0] + c * y[0], ring.x = c * x[0] - s * y[0];
        const Lanes samples[3] = {ring.middle.x + ring.tangent.x * x + ring.bitangent.x * y,
                                  ring.middle.y + ring.tangent.y * x + ring.bitangent.y * y,
                                  ring.middle.z + ring.tangent.z * x + ring.bitangent.z * y};
        ChiaroCubePlaces places = chiaro_cube_places(kernel, samples);
        for (uint32_t lane = 0; lane < LANES; lane++) {
            ChiaroCubeTaps taps = chiaro_cube_place_taps(kernel, &places, lane);
            cover_point(&taps, angle, cover);
        }
    }
}

/* Rings of samples; each sample stands for its part of its ring's solid angle. */
static void cover_disc(const ChiaroCubeKernel *kernel, Vec3 d, float half, float angle, Cover *cover)
{
    float texel = CHIARO_PI / 2 / (float)kernel->edge;
    memset(cover->share, 0, kernel->texel_count * sizeof *cover->share);
    if (half < ONE_SAMPLE * texel) {
        ChiaroCubeTaps taps = chiaro_cube_taps(kernel, d);
        cover_point(&taps, angle, cover);
        return;
    }
    Ring ring;
    float x = 1, y = 0; /* where a ring starts */
    vec3_frame(d, &ring.tangent, &ring.bitangent);
    uint32_t rings = half < ONE_RING * texel ? 1 : 1 + (uint32_t)(half / (SPACING * texel));
    float step = half / (float)rings, inner = 0; /* 1 - cos of the ring's inner edge */
    for (uint32_t r = 0; r < rings; r++) {
        float edge = r + 1 < rings ? sinf(0.5f * step * (float)(r + 1)) : 0;
        float outer = r + 1 < rings ? 2 * edge * edge : angle / (2 * CHIARO_PI), z = 1 - (inner + outer) / 2;
        float radius = sqrtf(chiaro_max(1 - z * z, 0)), next = GOLDEN_COSINE * x - GOLDEN_SINE * y;
        ring.middle = vec3_scale(d, z);
        ring.x = radius * x, ring.y = radius * y;
        y = GOLDEN_SINE * x + GOLDEN_COSINE * y, x = next;
        ring.quarter = (uint32_t)(CHIARO_PI / 2 * radius / step + 0.5f);
        ring.quarter = ring.quarter > 0 ? ring.quarter : 1;
        cover_ring(kernel, ring, CHIARO_PI / 2 * (outer - inner) / (float)ring.quarter, cover);
        inner = outer;
    }
}

/* Samples tell the share of a texel to a few parts in a hundred. Where the disc, whose half angle has this cosine and
 * sine, holds the whole tent it is 1, so that nothing bright behind a near thing shines through it. */
static float share_of(const ChiaroCubeKernel *kernel, uint32_t texel, float angle, Vec3 d, float cosine, float sine)
{
    const float *reach = kernel->reach[texel];
    /* Angle to the centre plus reach at most the half angle: the cosine of (half - reach), where half is the larger. */
    if (cosine < reach[0] &&
        vec3_dot(d, chiaro_cube_centre(kernel, texel)) >= cosine * reach[0] + sine * reach[1])
        return 1;
    return chiaro_min(angle / kernel->weight[texel], 1);
}

/* A texel covered in part is covered further. */
static void paint_texel(ChiaroCubeTexel *texel, const ChiaroCubeDisc *disc, float depth, float share)
{
    float before = texel->coverage, kept = before;
    if (!(before > 0)) {
        *texel = (ChiaroCubeTexel){.distance = disc->distance, .coverage = share};
        vec3_store(texel->radiance, vec3_scale(vec3_load(disc->radiance), share));
        return;
    }
    bool beside = fabsf(disc->distance - texel->distance) < depth;
    bool nearer = disc->distance < texel->distance;
    /* Side by side, only what does not fit is hidden; else the nearer hides its share of the further. */
    if (nearer)
        kept = beside ? chiaro_min(before, 1 - share) : before * (1 - share);
    else
        share = beside ? chiaro_min(share, 1 - before) : share * (1 - before);
    if (!(share > 0))
        return;
    float keep = kept / before;
    for (uint32_t c = 0; c < 3; c++)
        texel->radiance[c] = keep * texel->radiance[c] + share * disc->radiance[c];
    texel->coverage = chiaro_min(kept + share, 1);
    texel->distance = (kept * texel->distance + share * disc->distance) / (kept + share);
}

void chiaro_cube_paint(const ChiaroCubeKernel *kernel, ChiaroCubeTexel *texels, const ChiaroCubeDisc *disc)
{
    Cover cover;
    Vec3 direction = vec3_load(disc->direction);
    if (!is_direction(direction) || !(disc->solid_angle > 0) || !(disc->distance > 0) || isinf(disc->distance))
        return;
    float angle = chiaro_min(disc->solid_angle, 2 * CHIARO_PI), square = angle / (4 * CHIARO_PI), root = sqrtf(square);
    float half = 2 * asinf(root), cosine = 1 - 2 * square, sine = 2 * root * sqrtf(1 - square);
    float depth = disc->depth > 0 ? disc->depth : disc->distance * sine;
    direction = vec3_normalize(direction);
    cover_disc(kernel, direction, half, angle, &cover);
    for (uint32_t first = 0; first < kernel->texel_count; first += 2 * LANES) { /* most are not touched */
        const float *share = cover.share + first;
        if (!lanes_any(lanes_load(share) + lanes_load(share + LANES) > lanes_of(0)))
            continue;
        for (uint32_t k = 0; k < 2 * LANES; k++) {
            if (share[k] > 0)
                paint_texel(&texels[first + k], disc, depth,
                            share_of(kernel, first + k, share[k], direction, cosine, sine));
        }
    }
}

void chiaro_cube_resolve(const ChiaroCubeKernel *kernel, const ChiaroCubeTexel *texels, const float *background,
                         float *radiance)
{
    for (uint32_t t = 0; t < kernel->texel_count; t++) {
        float open = 1 - texels[t].coverage;
        for (uint32_t c = 0; c < 3; c++)
            radiance[4 * t + c] = texels[t].radiance[c] + (background ? open * background[4 * t + c] : 0);
        radiance[4 * t + 3] = texels[t].coverage;
    }
}

/* ------------------------------------------------------------------------------------------------------------------
 * Light from far away
 */

void chiaro_cube_splat(const ChiaroCubeKernel *kernel, const float direction[3], const float flux[3], float *radiance)
{
    Vec3 d = vec3_load(direction);
    if (!is_direction(d))
        return;
    ChiaroCubeTaps taps = chiaro_cube_taps(kernel, d);
    for (uint32_t k = 0; k < 4; k++) {
        float *texel = radiance + 4 * (size_t)taps.texel[k], weight = taps.weight[k] / kernel->weight[taps.texel[k]];
        for (uint32_t c = 0; c < 3; c++)
            texel[c] += weight * flux[c];
    }
}

/* A background while it is gathered. Doubles: a bright sun and millions of dim pixels. */
typedef struct Gather {
    double sum[CHIARO_CUBE_MAX_TEXELS][3], weight[CHIARO_CUBE_MAX_TEXELS];
    double way[CHIARO_CUBE_MAX_TEXELS][3], square[CHIARO_CUBE_MAX_TEXELS]; /* of directions */
    double moment[CHIARO_CUBE_MAX_TEXELS][3][3];                           /* of channels with directions */
} Gather;

static void gather_radiance(const ChiaroCubeKernel *kernel, Vec3 d, double angle, const float rgb[3], Gather *gather)
{
    ChiaroCubeTaps taps = chiaro_cube_taps(kernel, d);
    for (uint32_t k = 0; k < 4; k++) {
        double weight = angle * (double)taps.weight[k];
        uint32_t t = taps.texel[k];
        float way[3];
        vec3_store(way, d);
        gather->weight[t] += weight;
        for (uint32_t c = 0; c < 3; c++) {
            gather->sum[t][c] += weight * (double)rgb[c];
            gather->way[t][c] += weight * (double)way[c];
            gather->square[t] += weight * (double)(way[c] * way[c]);
            for (uint32_t axis = 0; axis < 3; axis++)
                gather->moment[t][c][axis] += weight * (double)(rgb[c] * way[axis]);
        }
    }
}

/* Divided by the weights that came, not by those that should have: uniform stays uniform to the last bit or two. */
static void finish_gather(const ChiaroCubeKernel *kernel, const Gather *gather, float *radiance)
{
    for (uint32_t t = 0; t < kernel->texel_count; t++) {
        for (uint32_t c = 0; c < 3; c++)
            radiance[4 * t + c] = gather->weight[t] > 0 ? (float)(gather->sum[t][c] / gather->weight[t]) : 0;
        radiance[4 * t + 3] = 0;
    }
}

static void gather_sky(const ChiaroCubeKernel *kernel, const ChiaroSky *sky, Gather *gather)
{
    static const double pi = 3.14159265358979323846;
    memset(gather, 0, sizeof *gather);
    uint32_t rows = !sky ? 0 : sky->height > LEAST_ROWS ? sky->height : LEAST_ROWS;
    uint32_t columns = sky && sky->width > 2 * LEAST_ROWS ? sky->width : 2 * LEAST_ROWS;
    bool pixels = sky && rows == sky->height && columns == sky->width;
    for (uint32_t j = 0; j < rows; j++) {
        double upper = cos(pi * j / rows), lower = cos(pi * (j + 1.0) / rows), polar = pi * (j + 0.5) / rows;
        double y = cos(polar), radius = sin(polar);
        for (uint32_t i = 0; i < columns; i++) {
            double azimuth = 2 * pi * ((i + 0.5) / columns - 0.5);
            float d[3] = {(float)(radius * cos(azimuth)), (float)y, (float)(radius * sin(azimuth))}, rgb[3];
            if (pixels)
                memcpy(rgb, sky->radiance + 3 * ((size_t)j * columns + i), sizeof rgb);
            else
                chiaro_sky_radiance(sky, d, rgb);
            gather_radiance(kernel, vec3_load(d), upper - lower, rgb, gather);
        }
    }
}

void chiaro_cube_sky(const ChiaroCubeKernel *kernel, const ChiaroSky *sky, float *radiance)
{
    Gather gather;
    gather_sky(kernel, sky, &gather);
    finish_gather(kernel, &gather, radiance);
}

void chiaro_cube_sky_slope(const ChiaroCubeKernel *kernel, const ChiaroSky *sky, float *radiance,
                           ChiaroCubeSlope *slopes)
{
    Gather g;
    gather_sky(kernel, sky, &g);
    finish_gather(kernel, &g, radiance);
    for (uint32_t t = 0; t < kernel->texel_count; t++) {
        ChiaroCubeSlope *slope = &slopes[t];
        memset(slope, 0, sizeof *slope);
        if (!(g.weight[t] > 0))
            continue;
        double mean[3], spread = g.square[t] / g.weight[t];
        for (uint32_t c = 0; c < 3; c++) {
            mean[c] = g.way[t][c] / g.weight[t], spread -= mean[c] * mean[c];
            slope->mean[c] = (float)mean[c];
        }
        /* Least squares; the tent is as wide one way as the other, and flat. */
        for (uint32_t c = 0; c < 3 && spread > 0; c++) {
            for (uint32_t axis = 0; axis < 3; axis++)
                slope->slope[c][axis] =
                    (float)((g.moment[t][c][axis] - g.sum[t][c] * mean[axis]) / g.weight[t] / (spread / 2));
        }
    }
}

void chiaro_cube_background(const ChiaroCubeKernel *kernel, ChiaroRadianceFunc func, void *user, uint32_t samples,
                            float *radiance)
{
    Gather gather;
    memset(&gather, 0, sizeof gather);
    uint32_t steps = kernel->edge * (samples ? samples : 1);
    for (uint32_t face = 0; face < 6; face++) {
        for (uint32_t j = 0; j < steps; j++) {
            for (uint32_t i = 0; i < steps; i++) {
                float x = (2 * (float)i + 1) / (float)steps - 1, y = (2 * (float)j + 1) / (float)steps - 1;
                double square = 1 + (double)(x * x + y * y);
                float d[3], rgb[3];
                vec3_store(d, vec3_normalize(chiaro_cube_direction(face, x, y)));
                func(d, rgb, user);
                gather_radiance(kernel, vec3_load(d), 1 / (square * sqrt(square)), rgb, &gather);
            }
        }
    }
    finish_gather(kernel, &gather, radiance);
}

/* ------------------------------------------------------------------------------------------------------------------
 * Looking up
 */

void chiaro_cube_look_up(const ChiaroCubeKernel *kernel, const float *texels, const float direction[3], float value[4])
{
    ChiaroCubeTaps taps = chiaro_cube_taps(kernel, vec3_load(direction));
    Lanes sum = chiaro_cube_mix(&taps, texels);
    memcpy(value, &sum, sizeof sum);
}
