/* Form factors of four balls at a time: chiaro_sphere_form() almost without branches, to 2e-5.
 *
 * Arc cosine and arc tangent are the polynomials 4.4.45 and 4.4.48 of M. Abramowitz and I. Stegun, "Handbook of
 * Mathematical Functions", 1964.
 */
#ifndef CHIARO_LANES_BALL_H
#define CHIARO_LANES_BALL_H

#include "lanes.h"
#include "vec.h"

/* From -1 to 1. */
static inline Lanes lanes_acos(Lanes x)
{
    Lanes a = lanes_max(x, -x), one = lanes_of(1);
    Lanes angle = lanes_sqrt(one - a) * (1.5707288f + a * (-0.2121144f + a * (0.0742610f - 0.0187293f * a)));
    return lanes_choose(x < lanes_of(0), CHIARO_PI - angle, angle);
}

/* Of the angle whose tangent is y / x, both of them positive. */
static inline Lanes lanes_angle(Lanes y, Lanes x)
{
    Lanes z = lanes_min(x, y) / lanes_max(x, y), s = z * z;
    Lanes angle = z * (0.9998660f + s * (-0.3302995f + s * (0.1801410f + s * (-0.0851330f + s * 0.0208351f))));
    return lanes_choose(y > x, CHIARO_PI / 2 - angle, angle);
}

/* `away`: distances of the centres; `height`: how far they are above the receiver's plane. */
static inline Lanes lanes_ball_forms(Lanes away, Lanes height, Lanes radius)
{
    Lanes zero = lanes_of(0), one = lanes_of(1), least = lanes_of(1e-12f);
    Lanes cosine = lanes_max(-one, lanes_min(one, height / lanes_max(away, lanes_of(1e-20f))));
    Lanes ratio = lanes_min(one, radius / lanes_max(away, lanes_of(1e-20f))), square = ratio * ratio;
    Lanes forms = lanes_max(zero, square * cosine);
    LaneMask across = (cosine < ratio) & (cosine > -ratio);
    if (lanes_any(across)) {
        /* Howell's catalogue, B-19. */
        Lanes sine = lanes_sqrt(lanes_max(one - cosine * cosine, least));
        Lanes x = lanes_max(lanes_sqrt((one - ratio) * (one + ratio)) / lanes_max(ratio, least), least);
        Lanes y = lanes_max(-one, lanes_min(one, -x * cosine / sine)), root = lanes_sqrt(lanes_max(one - y * y, zero));
        Lanes part = square * (cosine * lanes_acos(y) - x * sine * root) + lanes_angle(lanes_max(sine * root, least), x);
        forms = lanes_choose(across, lanes_max(zero, part / CHIARO_PI), forms);
    }
    return lanes_choose(away > radius, lanes_choose(cosine > -ratio, forms, zero), 0.5f * (one + cosine));
}

#endif
