/* Near neighbours are seen from the skin, not from the centre: for each normal, near things give what their form factor
 * from the hull says, in fours.
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
                                          sqrtf(CHIARO_PI / chiaro_max(thing->area, 1e-30f)), thing->visible, thing->radiance.x,
                                          thing->radiance.y, thing->radiance.z};
        for (uint32_t k = 0; k < BALL_NUMBERS && near->ball_count < WORLD_MAX_BALLS; k++)
            near->balls[near->ball_count][k] = ball[k];
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

/* Light of things in four lanes, their forms cut down to what is seen of them; then the forms. */
typedef struct NearSum {
    Lanes color[3], forms;
} NearSum;

static void add_forms(NearSum *sum, Lanes forms, Lanes visible, Lanes red, Lanes green, Lanes blue)
{
    forms *= visible;
    sum->color[0] += forms * red;
    sum->color[1] += forms * green;
    sum->color[2] += forms * blue;
    sum->forms += forms;
}

/* Plates are many: four of them at a time, for one receiver. */
static NearSum sum_plates(const Near *near, Vec3 point, Vec3 normal)
{
    NearSum sum = {{lanes_of(0), lanes_of(0), lanes_of(0)}, lanes_of(0)};
    Lanes forms;
    for (uint32_t i = 0; i < near->plate_count; i += LANES) {
        if (plate_forms(near, i, point, normal, &forms))
            add_forms(&sum, forms, lanes_load(near->plates[NEAR_VISIBLE] + i), lanes_load(near->plates[NEAR_RED] + i),
                      lanes_load(near->plates[NEAR_GREEN] + i), lanes_load(near->plates[NEAR_BLUE] + i));
    }
    return sum;
}

/* Balls are few: one at a time, for four receivers. */
static NearSum sum_balls(const Near *near, const NearReceivers *at)
{
    NearSum sum = {{lanes_of(0), lanes_of(0), lanes_of(0)}, lanes_of(0)};
    for (uint32_t i = 0; i < near->ball_count; i++) {
        const float *ball = near->balls[i];
        Lanes x = ball[BALL_X] - at->point[0], y = ball[BALL_Y] - at->point[1], z = ball[BALL_Z] - at->point[2];
        Lanes height = x * at->normal[0] + y * at->normal[1] + z * at->normal[2], in_radii = lanes_of(ball[BALL_IN_RADII]);
        height *= in_radii;
        if (!lanes_any(height > lanes_of(-1)))
            continue;
        add_forms(&sum, lanes_ball_forms((x * x + y * y + z * z) * in_radii * in_radii, height), lanes_of(ball[BALL_VISIBLE]),
                  lanes_of(ball[BALL_RED]), lanes_of(ball[BALL_GREEN]), lanes_of(ball[BALL_BLUE]));
    }
    return sum;
}

void chiaro_near_sum(Near *near, const NearReceivers *receivers, uint32_t count, float light[][4])
{
    for (uint32_t k = 0; k < LANES - 1; k++)
        near->plates[NEAR_VISIBLE][near->plate_count + k] = 0;
    NearSum balls = sum_balls(near, receivers);
    Lanes rows[LANES] = {balls.color[0], balls.color[1], balls.color[2], balls.forms};
    lanes_transpose(rows);
    for (uint32_t r = 0; r < count; r++) {
        if (near->plate_count) {
            Vec3 point = vec3(receivers->point[0][r], receivers->point[1][r], receivers->point[2][r]);
            Vec3 normal = vec3(receivers->normal[0][r], receivers->normal[1][r], receivers->normal[2][r]);
            NearSum sum = sum_plates(near, point, normal);
            rows[r] += (Lanes){lanes_sum(sum.color[0]), lanes_sum(sum.color[1]), lanes_sum(sum.color[2]), lanes_sum(sum.forms)};
        }
        memcpy(light[r], &rows[r], sizeof rows[r]);
    }
}
