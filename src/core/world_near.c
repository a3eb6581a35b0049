/* Near neighbours are seen from the skin, not from the centre: for each normal, near things give what their form factor
 * from the hull says, four at a time.
 *
 * A plate is small for its distance: cos cos' A / (pi d^2 + A (3 cos cos' - 2)), which is the form of a disc to first order
 * where the two are parallel, and exact on its axis. Many of them that tile a plane have the plane's own form. Off the
 * axis the second term is left out rather than negative. Where a plate stands across the receiver's
 * horizon, the receiver's cosine is cut off softly, over as much as the plate rises above its own centre.
 */
#include "lanes_ball.h"
#include "world.h"

void chiaro_near_add(Near *near, const NearThing *thing)
{
    if (thing->ball) {
        const float ball[BALL_NUMBERS] = {thing->center.x, thing->center.y, thing->center.z,
                                          sqrtf(thing->area / CHIARO_PI), thing->visible, thing->radiance.x,
                                          thing->radiance.y, thing->radiance.z};
        for (uint32_t k = 0; k < BALL_NUMBERS && near->ball_count < WORLD_MAX_BALLS; k++)
            near->balls[k][near->ball_count] = ball[k];
        near->ball_count += near->ball_count < WORLD_MAX_BALLS;
        return;
    }
    if (near->plate_count == WORLD_MAX_NEAR)
        return;
    const float numbers[NEAR_NUMBERS] = {thing->center.x, thing->center.y, thing->center.z, thing->normal.x,
                                         thing->normal.y, thing->normal.z, thing->area, sqrtf(thing->area / CHIARO_PI),
                                         thing->visible, thing->radiance.x, thing->radiance.y, thing->radiance.z};
    for (uint32_t k = 0; k < NEAR_NUMBERS; k++)
        near->plates[k][near->plate_count] = numbers[k];
    near->plate_count++;
}

/* Form factors of four plates; false: the receiver sees none of them. */
static bool plate_forms(const Near *near, uint32_t i, Vec3 point, Vec3 normal, Lanes *forms)
{
    Lanes zero = lanes_of(0), one = lanes_of(1), least = lanes_of(1e-30f);
    Lanes x = lanes_load(near->plates[NEAR_X] + i) - point.x, y = lanes_load(near->plates[NEAR_Y] + i) - point.y;
    Lanes z = lanes_load(near->plates[NEAR_Z] + i) - point.z, half = lanes_load(near->plates[NEAR_HALF] + i);
    Lanes height = x * normal.x + y * normal.y + z * normal.z;
    if (!lanes_any(height > -half)) /* it rises by no more than its radius */
        return false;
    Lanes nx = lanes_load(near->plates[NEAR_NX] + i), ny = lanes_load(near->plates[NEAR_NY] + i);
    Lanes nz = lanes_load(near->plates[NEAR_NZ] + i), area = lanes_load(near->plates[NEAR_AREA] + i);
    Lanes square = x * x + y * y + z * z, front = lanes_max(zero, -(x * nx + y * ny + z * nz));
    /* Where its rim is, above its centre: the sine of the angle between the normals, near enough, without a root. */
    Lanes cosine = nx * normal.x + ny * normal.y + nz * normal.z, flat = lanes_min(one, cosine * cosine);
    Lanes rise = half * (one - flat) * (one + 0.5f * flat) + least;
    Lanes low = lanes_max(-rise, lanes_min(rise, height)) + rise;
    /* low^2 / (4 rise) of its height, and all that is beyond the rise. */
    Lanes both = front * (low * low + 4 * rise * lanes_max(zero, height - rise)), four = 4 * rise * square;
    *forms = lanes_min(one, both * area / (CHIARO_PI * four * square + area * lanes_max(zero, 3 * both - 2 * four) + least));
    return true;
}

/* The same of four balls. */
static bool ball_forms(const Near *near, uint32_t i, Vec3 point, Vec3 normal, Lanes *forms)
{
    Lanes x = lanes_load(near->balls[BALL_X] + i) - point.x, y = lanes_load(near->balls[BALL_Y] + i) - point.y;
    Lanes z = lanes_load(near->balls[BALL_Z] + i) - point.z, radius = lanes_load(near->balls[BALL_RADIUS] + i);
    Lanes height = x * normal.x + y * normal.y + z * normal.z;
    if (!lanes_any(height > -radius))
        return false;
    *forms = lanes_ball_forms(lanes_sqrt(x * x + y * y + z * z), height, radius);
    return true;
}

/* Light of four things, their forms cut down to what is seen of them: `visible`, then their colours. */
typedef struct NearSum {
    Lanes color[3], forms;
} NearSum;

static void add_forms(NearSum *sum, Lanes forms, const float *visible, const float *red, const float *green,
                      const float *blue)
{
    forms *= lanes_load(visible);
    sum->color[0] += forms * lanes_load(red);
    sum->color[1] += forms * lanes_load(green);
    sum->color[2] += forms * lanes_load(blue);
    sum->forms += forms;
}

void chiaro_near_sum(Near *near, Vec3 point, Vec3 normal, float light[4])
{
    NearSum sum = {{lanes_of(0), lanes_of(0), lanes_of(0)}, lanes_of(0)};
    Lanes forms;
    for (uint32_t k = 0; k < LANES - 1; k++) {
        near->plates[NEAR_VISIBLE][near->plate_count + k] = 0;
        near->balls[BALL_VISIBLE][near->ball_count + k] = 0;
    }
    for (uint32_t i = 0; i < near->plate_count; i += LANES) {
        if (plate_forms(near, i, point, normal, &forms))
            add_forms(&sum, forms, near->plates[NEAR_VISIBLE] + i, near->plates[NEAR_RED] + i,
                      near->plates[NEAR_GREEN] + i, near->plates[NEAR_BLUE] + i);
    }
    for (uint32_t i = 0; i < near->ball_count; i += LANES) {
        if (ball_forms(near, i, point, normal, &forms))
            add_forms(&sum, forms, near->balls[BALL_VISIBLE] + i, near->balls[BALL_RED] + i,
                      near->balls[BALL_GREEN] + i, near->balls[BALL_BLUE] + i);
    }
    for (uint32_t c = 0; c < 3; c++)
        light[c] = lanes_sum(sum.color[c]);
    light[3] = lanes_sum(sum.forms);
}
