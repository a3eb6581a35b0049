/* Two angles, an eye and a distance: orbiting keeps the place at that distance in front of the eye, walking the eye. */
#include "view_camera.h"

/* As far up or down as it looks: right above, left and right lose their meaning. */
#define STEEPEST 1.55f
#define ZOOM_STEP 0.88f /* of the distance, a step */

typedef struct Axes {
    Vec3 right, up, forward;
} Axes;

static Axes axes_of(const ViewCamera *camera)
{
    float flat = cosf(camera->pitch);
    Vec3 forward = {sinf(camera->yaw) * flat, sinf(camera->pitch), -cosf(camera->yaw) * flat};
    Vec3 right = {cosf(camera->yaw), 0, sinf(camera->yaw)};
    return (Axes){right, vec3_cross(right, forward), forward};
}

ViewCamera view_camera(const ChiaroCamera *camera, float distance)
{
    Vec3 forward = vec3_load(camera->forward);
    ViewCamera made = {.lens = *camera, .eye = vec3_load(camera->eye), .distance = distance};
    made.yaw = atan2f(forward.x, -forward.z);
    made.pitch = fmaxf(-STEEPEST, fminf(STEEPEST, asinf(fmaxf(-1, fminf(1, forward.y)))));
    return made;
}

ChiaroCamera view_camera_lens(const ViewCamera *camera)
{
    Axes axes = axes_of(camera);
    ChiaroCamera lens = camera->lens;
    vec3_store(lens.eye, camera->eye);
    vec3_store(lens.forward, axes.forward);
    vec3_store(lens.up, axes.up);
    return lens;
}

void view_camera_turn(ViewCamera *camera, float right, float up)
{
    Vec3 place = vec3_mad(camera->eye, axes_of(camera).forward, camera->distance);
    camera->yaw = remainderf(camera->yaw + right, 2 * CHIARO_PI);
    camera->pitch = fmaxf(-STEEPEST, fminf(STEEPEST, camera->pitch + up));
    if (!camera->walks)
        camera->eye = vec3_mad(place, axes_of(camera).forward, -camera->distance);
}

void view_camera_move(ViewCamera *camera, float right, float up, float forward)
{
    Axes axes = axes_of(camera);
    Vec3 way = vec3_mad(vec3_mad(vec3_scale(axes.right, right), axes.up, up), axes.forward, forward);
    camera->eye = vec3_mad(camera->eye, way, camera->distance);
}

void view_camera_zoom(ViewCamera *camera, float steps)
{
    float closer = powf(ZOOM_STEP, steps);
    view_camera_move(camera, 0, 0, 1 - closer);
    if (!camera->walks)
        camera->distance = fmaxf(camera->distance * closer, 10 * camera->lens.znear);
}

Vec3 view_camera_ray(const ViewCamera *camera, float x, float y, float aspect)
{
    Axes axes = axes_of(camera);
    float half = tanf(camera->lens.yfov / 2);
    return vec3_normalize(vec3_mad(vec3_mad(axes.forward, axes.right, x * half * aspect), axes.up, y * half));
}

bool view_camera_project(const ViewCamera *camera, Vec3 point, float aspect, float *x, float *y)
{
    Axes axes = axes_of(camera);
    Vec3 way = vec3_sub(point, camera->eye);
    float half = tanf(camera->lens.yfov / 2), depth = vec3_dot(way, axes.forward);
    if (!(depth > camera->lens.znear))
        return false;
    *x = vec3_dot(way, axes.right) / (depth * half * aspect);
    *y = vec3_dot(way, axes.up) / (depth * half);
    return true;
}
