/* Form factors of four balls at a time: chiaro_sphere_form() to 0.003, without branches or anything but a root. */
#ifndef CHIARO_LANES_BALL_H
#define CHIARO_LANES_BALL_H

#include "chiaro_shared.h"
#include "lanes.h"

/* From the squares of their distances, and how far their centres are above the receiver's plane, in radii. From within, a
 * ball is seen as from its skin on the same side. Twin of chiaro_ball_form in glsl/chiaro.glsl. */
static inline Lanes lanes_ball_forms(Lanes square_distance, Lanes height)
{
    Lanes zero = lanes_of(0), one = lanes_of(1), inverse = one / lanes_sqrt(lanes_max(square_distance, lanes_of(1e-12f)));
    Lanes ratio = lanes_min(inverse, one), square = ratio * ratio;
    height *= lanes_max(inverse, one);
    Lanes u = lanes_max(-one, lanes_min(one, height)), v = u * u, h = lanes_sqrt(one - square);
    Lanes rim = ratio * (0.5f + 0.5f * u) - (one - v) * CHIARO_BALL_FIT(v, h);
    return square * (lanes_max(zero, rim) + ratio * lanes_max(zero, height - one));
}

#endif
