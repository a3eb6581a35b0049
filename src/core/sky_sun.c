/* The sun of a sky. The leaves that a sky goes into are some degrees wide, and the links that carry their light make one
 * of many; a sun spread over them casts no edge. So a spot that is compact and strong enough for that to be seen is
 * taken out of the image, and shines as a light of its own: sun + rest = sky.
 *
 * Spot is what stands above its surroundings within a disc, so that behind it is left a sky without a hole or a spike.
 */
#include "chiaro/chiaro.h"
#include "cube.h"

#include <string.h>

/* The relative error that is worth a light, as saving() estimates it. */
static const double least_saving = 0.02;

/* Discs are one leaf large, or 2, or 4. */
enum { LARGEST_SIZE = 4 };

/* Moves from the start to the spot's own centre; a few are enough, or it is no spot. */
enum { MOST_MOVES = 12 };

/* Radius of a disc of directions with the solid angle of a mean leaf: 4 pi / leaves = pi r^2. */
static double leaf_radius(void) { return sqrt(4.0 / CHIARO_SKY_TEXELS); }

/* ---- the texels about a direction --------------------------------------------------------------------------------- */

typedef struct Direction {
    double x, y, z;
} Direction;

static Direction add_scaled(Direction a, Direction b, double s)
{
    return (Direction){a.x + b.x * s, a.y + b.y * s, a.z + b.z * s};
}

static double dot(Direction a, Direction b) { return a.x * b.x + a.y * b.y + a.z * b.z; }

/* The zero vector stays zero. */
static Direction normalize(Direction a)
{
    double length = sqrt(dot(a, a));
    return length > 0 ? (Direction){a.x / length, a.y / length, a.z / length} : a;
}

/* A texel: where it is, and its weight in the sphere's integral of the bilinear image, in sr. */
typedef struct Texel {
    size_t index;
    Direction direction;
    double weight;
} Texel;

typedef void (*TexelFunc)(const Texel *texel, void *user);

/* Integral of a row's tent, 1 at its centre and 0 at its neighbours', over the sphere. The first and the last row reach
 * on to the poles. */
static double row_weight(uint32_t row, uint32_t height)
{
    double step = (double)CHIARO_PI / height, sum;
    if (height == 1)
        sum = 2;
    else if (row == 0 || row == height - 1)
        sum = 1 - (sin(1.5 * step) - sin(0.5 * step)) / step;
    else
        sum = sin((row + 0.5) * step) * 2 * (1 - cos(step)) / step;
    return sum * 2 * (double)CHIARO_PI;
}

/* Calls `func` for every texel whose centre lies within an angle about a direction. */
static void visit(const ChiaroSky *sky, Direction center, double angle, TexelFunc func, void *user)
{
    const double pi = (double)CHIARO_PI;
    double height = sky->height, width = sky->width, ring = sqrt(center.x * center.x + center.z * center.z);
    double polar = atan2(ring, center.y), azimuth = ring > 0 ? atan2(center.z, center.x) : 0;
    double top = fmax(0, floor((polar - angle) / pi * height - 0.5));
    double bottom = fmin(height - 1, ceil((polar + angle) / pi * height - 0.5));
    /* Around a pole all columns. */
    bool around = polar - angle <= 0 || polar + angle >= pi;
    double middle = (0.5 + azimuth / (2 * pi)) * width - 0.5;
    double half = around ? width : asin(fmin(1, sin(angle) / sin(polar))) / (2 * pi) * width + 1;
    uint32_t columns = 2 * half + 1 < width ? (uint32_t)(2 * half) + 1 : sky->width;
    uint32_t first = columns < sky->width ? (uint32_t)((int64_t)floor(middle - half) + sky->width) % sky->width : 0;
    double least = angle < pi ? cos(angle) : -2, cosine_step = cos(2 * pi / width), sine_step = sin(2 * pi / width);
    for (uint32_t j = (uint32_t)top; j <= (uint32_t)bottom; j++) {
        double theta = (j + 0.5) / height * pi, sine = sin(theta), cosine = cos(theta);
        double phi = ((first + 0.5) / width - 0.5) * 2 * pi, cosine_phi = cos(phi), sine_phi = sin(phi);
        double weight = row_weight(j, sky->height) / width;
        for (uint32_t k = 0; k < columns; k++) {
            uint32_t i = (uint32_t)(((uint64_t)first + k) % sky->width);
            Texel texel = {3 * ((size_t)j * sky->width + i), {sine * cosine_phi, cosine, sine * sine_phi}, weight};
            if (dot(texel.direction, center) >= least)
                func(&texel, user);
            double turned = cosine_phi * cosine_step - sine_phi * sine_step;
            sine_phi = sine_phi * cosine_step + cosine_phi * sine_step;
            cosine_phi = turned;
        }
    }
}

/* ---- a spot ------------------------------------------------------------------------------------------------------- */

/* What stands above its surroundings within a disc. Colours count alike, as they do where errors are measured. */
typedef struct Spot {
    const ChiaroSky *sky;
    Direction center; /* of the disc */
    double reach;
    double around[3], around_weight; /* sums over the ring about it */
    float level[3];                  /* and their mean: what is no more belongs to the rest */
    Direction moments[3];            /* of a channel's excess */
    double flux, spread;             /* over channels; the second moment of the distance from the centre */
} Spot;

static void add_around(const Texel *texel, void *user)
{
    Spot *spot = user;
    if (dot(texel->direction, spot->center) >= cos(spot->reach))
        return;
    for (int c = 0; c < 3; c++)
        spot->around[c] += texel->weight * (double)spot->sky->radiance[texel->index + (size_t)c];
    spot->around_weight += texel->weight;
}

static void add_excess(const Texel *texel, void *user)
{
    Spot *spot = user;
    Direction off = add_scaled(texel->direction, spot->center, -1);
    for (int c = 0; c < 3; c++) {
        double excess = (double)(spot->sky->radiance[texel->index + (size_t)c] - spot->level[c]) * texel->weight;
        if (!(excess > 0))
            continue;
        spot->moments[c] = add_scaled(spot->moments[c], texel->direction, excess);
        spot->flux += excess;
        spot->spread += excess * dot(off, off);
    }
}

static Spot measure_spot(const ChiaroSky *sky, Direction center, double reach)
{
    Spot spot = {.sky = sky, .center = center, .reach = reach};
    visit(sky, center, 2 * reach, add_around, &spot);
    for (int c = 0; c < 3; c++)
        spot.level[c] = spot.around_weight > 0 ? (float)(spot.around[c] / spot.around_weight) : 0;
    /* Without surroundings nothing stands above them. */
    if (spot.around_weight > 0)
        visit(sky, center, reach, add_excess, &spot);
    return spot;
}

static Direction spot_direction(const Spot *spot)
{
    return normalize(add_scaled(add_scaled(spot->moments[0], spot->moments[1], 1), spot->moments[2], 1));
}

/* From somewhere near it to the spot: the disc moves to the centre of what stands out in it, as long as that is worth
 * it. */
static Spot find_spot(const ChiaroSky *sky, Direction start, double reach, double worth)
{
    Spot spot = measure_spot(sky, start, 2 * reach);
    for (int i = 0; i < MOST_MOVES && spot.flux > worth; i++) {
        Direction next = spot_direction(&spot);
        if (i > 0 && dot(next, spot.center) > 1 - 1e-12)
            break;
        spot = measure_spot(sky, next, reach);
    }
    return spot;
}

/* Radius of the even disc that is spread alike. A texel is a tent, whose own spread is a sixth of its width squared. */
static double spot_radius(const Spot *spot)
{
    double row = (double)CHIARO_PI / spot->sky->height, column = 2 * (double)CHIARO_PI / spot->sky->width;
    double ring = sqrt(fmax(0, 1 - spot->center.y * spot->center.y));
    return sqrt(2 * (spot->spread / spot->flux + (row * row + column * column * ring * ring) / 6));
}

/* ---- the split ---------------------------------------------------------------------------------------------------- */

/* Flux times direction of a leaf's texels. */
typedef struct Leaves {
    const ChiaroSky *sky;
    Direction moments[CHIARO_SKY_TEXELS];
} Leaves;

static void add_to_leaf(const Texel *texel, void *user)
{
    Leaves *leaves = user;
    const float *rgb = leaves->sky->radiance + texel->index;
    Vec3 d = {(float)texel->direction.x, (float)texel->direction.y, (float)texel->direction.z};
    Direction *moment = &leaves->moments[chiaro_cube_texel(d, CHIARO_SKY_EDGE)];
    *moment = add_scaled(*moment, texel->direction, texel->weight * ((double)rgb[0] + (double)rgb[1] + (double)rgb[2]));
}

/* Irradiance, over channels, of a surface under the open sky. */
static double irradiance(const Leaves *leaves, Direction normal)
{
    double sum = 0;
    for (uint32_t t = 0; t < CHIARO_SKY_TEXELS; t++)
        sum += fmax(0, dot(leaves->moments[t], normal));
    return sum;
}

/* The error that a light of its own saves: the spot's share of the irradiance, and less the wider it is. Measured in the
 * courtyard, with the leaves alone: a share of 65 % costs 48 % as a disc of 0.4 degrees, 43 % at 2.5, 41 % at 4, 18 % at
 * 7, 6 % at 12; small shares of 0.8, 1.9, 3.8, 9 % at 0.5 degrees cost 1.0, 2.1, 4.0, 9.6 %. */
static double saving(const Leaves *leaves, const Spot *spot)
{
    if (!(spot->flux > 0))
        return 0;
    double share = spot->flux / irradiance(leaves, spot_direction(spot));
    return share * pow(fmin(1, leaf_radius() / spot_radius(spot)), 1.5);
}

/* The strongest spot of a leaf's size. It has at least a quarter of its flux in one leaf, and most of it stands above
 * whatever is around the wider disc that the search begins with. */
static Spot strongest_spot(const Leaves *leaves)
{
    Spot best = {.sky = leaves->sky};
    for (uint32_t t = 0; t < CHIARO_SKY_TEXELS; t++) {
        Direction start = normalize(leaves->moments[t]);
        double worth = least_saving / 2 * irradiance(leaves, start);
        if (!(dot(leaves->moments[t], start) > worth / 2))
            continue;
        Spot spot = find_spot(leaves->sky, start, leaf_radius(), worth);
        if (spot.flux > fmax(worth, best.flux))
            best = spot;
    }
    return best;
}

/* The spot that saves most, of any size; larger ones are looked for about the brightest leaf. Where they are about as
 * good the sharper one is taken, a sun without the glow around it, unless it fills its disc: then it is a piece. */
static Spot best_spot(const Leaves *leaves)
{
    Spot best = strongest_spot(leaves);
    const Direction *brightest = leaves->moments;
    for (uint32_t t = 1; t < CHIARO_SKY_TEXELS; t++)
        if (dot(leaves->moments[t], leaves->moments[t]) > dot(*brightest, *brightest))
            brightest = &leaves->moments[t];
    for (int size = 2; size <= LARGEST_SIZE; size *= 2) {
        Spot spot = find_spot(leaves->sky, normalize(*brightest), size * leaf_radius(), 0);
        bool piece = best.flux > 0 && spot_radius(&best) > 0.9 * best.reach;
        if (saving(leaves, &spot) > (piece ? 1 : 1.2) * saving(leaves, &best))
            best = spot;
    }
    return best;
}

/* What of a texel belongs to the spot is taken from the rest. */
typedef struct Taking {
    const Spot *spot;
    float *rest;
} Taking;

static void take_excess(const Texel *texel, void *user)
{
    const Taking *taking = user;
    for (int c = 0; c < 3; c++) {
        float *value = &taking->rest[texel->index + (size_t)c];
        *value = fminf(*value, taking->spot->level[c]);
    }
}

bool chiaro_sky_split(const ChiaroSky *sky, ChiaroLight *sun, float *radius, float *rest)
{
    Leaves leaves = {.sky = sky};
    const Direction up = {0, 1, 0};
    if (rest && rest != sky->radiance)
        memcpy(rest, sky->radiance, 3 * (size_t)sky->width * sky->height * sizeof *rest);
    visit(sky, up, (double)CHIARO_PI, add_to_leaf, &leaves);
    Spot spot = best_spot(&leaves);
    Direction toward = spot_direction(&spot);
    if (!(saving(&leaves, &spot) >= least_saving))
        return false;
    *sun = (ChiaroLight){.type = CHIARO_LIGHT_SUN,
                         .direction = {(float)-toward.x, (float)-toward.y, (float)-toward.z}};
    for (int c = 0; c < 3; c++)
        sun->intensity[c] = (float)dot(spot.moments[c], toward);
    *radius = (float)spot_radius(&spot);
    Taking taking = {&spot, rest};
    if (rest)
        visit(sky, spot.center, spot.reach, take_excess, &taking);
    return true;
}
