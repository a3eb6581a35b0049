/* Picking by rays, dragging in the plane through what was taken that the camera looks straight at. */
#include "view_drag.h"

#define PUSH_STEP 1.08f /* of the depth, a step */

/* The place at a depth that the mouse points at. */
static Vec3 point_at(const ViewCamera *camera, const ViewMouse *mouse, float depth)
{
    Vec3 way = view_camera_ray(camera, mouse->x, mouse->y, mouse->aspect);
    Vec3 forward = view_camera_ray(camera, 0, 0, mouse->aspect);
    return vec3_mad(camera->eye, way, depth / vec3_dot(way, forward));
}

static float depth_of(const ViewCamera *camera, Vec3 point)
{
    return vec3_dot(vec3_sub(point, camera->eye), view_camera_ray(camera, 0, 0, 1));
}

/* The lamp nearest to the mouse, within its reach. */
static uint32_t pick_lamp(const ViewCamera *camera, const ViewMouse *mouse, const ChiaroLight *lights, uint32_t count)
{
    uint32_t nearest = CHIARO_NONE;
    float least = mouse->reach;
    for (uint32_t i = 0; i < count; i++) {
        float x, y;
        if (lights[i].type == CHIARO_LIGHT_SUN ||
            !view_camera_project(camera, vec3_load(lights[i].position), mouse->aspect, &x, &y))
            continue;
        float away = hypotf((x - mouse->x) * mouse->aspect, y - mouse->y);
        if (away < least)
            least = away, nearest = i;
    }
    return nearest;
}

ViewDrag view_drag_begin(const ViewCamera *camera, const ViewMouse *mouse, const ChiaroLight *lights,
                         uint32_t light_count, const Moving *moving)
{
    ViewDrag drag = {.grip = GRIP_CAMERA};
    float distance;
    uint32_t lamp = pick_lamp(camera, mouse, lights, light_count);
    Vec3 way = view_camera_ray(camera, mouse->x, mouse->y, mouse->aspect), taken = camera->eye;
    if (lamp != CHIARO_NONE) {
        drag.grip = GRIP_LAMP;
        drag.number = lamp;
        drag.place = vec3_load(lights[lamp].position);
        taken = point_at(camera, mouse, depth_of(camera, drag.place));
    } else {
        drag.number = moving_pick(moving, camera->eye, way, &distance);
        if (drag.number == CHIARO_NONE)
            return drag;
        drag.grip = GRIP_OBJECT;
        drag.place = vec3_load(moving->poses[drag.number].transform + 12);
        taken = vec3_mad(camera->eye, way, distance);
    }
    drag.depth = depth_of(camera, taken);
    drag.hold = vec3_sub(drag.place, taken);
    return drag;
}

Vec3 view_drag_to(ViewDrag *drag, const ViewCamera *camera, const ViewMouse *mouse)
{
    drag->place = vec3_add(point_at(camera, mouse, drag->depth), drag->hold);
    return drag->place;
}

Vec3 view_drag_push(ViewDrag *drag, const ViewCamera *camera, const ViewMouse *mouse, float steps)
{
    drag->depth *= powf(PUSH_STEP, steps);
    return view_drag_to(drag, camera, mouse);
}
