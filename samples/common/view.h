/* Where a camera looks. */
#ifndef CHIARO_VIEW_H
#define CHIARO_VIEW_H

#include "../../src/core/vec.h"
#include "chiaro/chiaro.h"

/* Puts a camera at `eye` and turns it to `target`; up is as near to +Y as it can be. False if that is no direction. */
static inline bool view_look_at(ChiaroCamera *camera, Vec3 eye, Vec3 target)
{
    Vec3 forward = vec3_normalize(vec3_sub(target, eye));
    if (!(vec3_length(forward) > 0.5f)) /* The same place, or too far away for floats. */
        return false;
    Vec3 up = vec3(0, 1, 0), level = vec3_mad(up, forward, -vec3_dot(up, forward));
    if (vec3_length(level) < 1e-3f) {
        up = vec3(0, 0, -1);
        level = vec3_mad(up, forward, -vec3_dot(up, forward));
    }
    vec3_store(camera->eye, eye);
    vec3_store(camera->forward, forward);
    vec3_store(camera->up, vec3_normalize(level));
    return true;
}

#endif
