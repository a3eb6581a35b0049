/* The viewer's camera: it orbits about a place, or walks. */
#ifndef CHIARO_VIEW_CAMERA_H
#define CHIARO_VIEW_CAMERA_H

#include "../../src/core/vec.h"
#include "chiaro/chiaro.h"

typedef struct ViewCamera {
    ChiaroCamera lens; /* opening and planes; where it is and looks is kept below */
    Vec3 eye;
    float yaw, pitch; /* radians: 0, 0 looks along -z; up is positive */
    float distance;   /* to the place that it orbits about, m; also what a step of the walk is measured by */
    bool walks;
} ViewCamera;

/* Looks as `camera` does; a roll is taken out. `distance` > 0. */
ViewCamera view_camera(const ChiaroCamera *camera, float distance);
/* The camera as the renderer wants it. */
ChiaroCamera view_camera_lens(const ViewCamera *camera);

/* Turns by radians, to the right and up: when it walks the eye stays, else the place that it orbits about. */
void view_camera_turn(ViewCamera *camera, float right, float up);
/* Moves by shares of the distance. */
void view_camera_move(ViewCamera *camera, float right, float up, float forward);
/* Closer by steps: to the place that it orbits about, or along the way that it looks. */
void view_camera_zoom(ViewCamera *camera, float steps);

/* Unit: the way that it sees a place of the picture, -1, -1 at the lower left to 1, 1; `aspect` is width / height. */
Vec3 view_camera_ray(const ViewCamera *camera, float x, float y, float aspect);
/* The reverse. False: the place is behind the eye. */
bool view_camera_project(const ViewCamera *camera, Vec3 point, float aspect, float *x, float *y);

#endif
