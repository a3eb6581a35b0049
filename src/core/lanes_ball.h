/* Form factors of four balls at a time: chiaro_sphere_form() to 0.003, without branches or anything but a root. */
#ifndef CHIARO_LANES_BALL_H
#define CHIARO_LANES_BALL_H

#include "chiaro_shared.h"
#include "lanes.h"

/* `away`: distances of the centres; `height`: how far they are above the receiver's plane. From within, a ball is seen as
 * from its skin on the same side. */
static inline Lanes lanes_ball_forms(Lanes away, Lanes height, Lanes radius)
{
    Lanes zero = lanes_of(0), one = lanes_of(1), least = lanes_of(1e-20f);
    Lanes ratio = radius / lanes_max(away, lanes_max(radius, least)), square = ratio * ratio;
    height /= lanes_max(lanes_min(away, radius), least);
    Lanes u = lanes_max(-one, lanes_min(one, height)), v = u * u, h = lanes_sqrt(lanes_max(zero, one - square));
    Lanes rim = ratio * (0.5f + 0.5f * u) - (one - v) * CHIARO_BALL_FIT(v, h);
    return square * (lanes_max(zero, rim) + ratio * lanes_max(zero, height - one));
}

#endif
