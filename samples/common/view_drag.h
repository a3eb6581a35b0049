/* What the mouse holds: a lamp, an object, or the camera itself. */
#ifndef CHIARO_VIEW_DRAG_H
#define CHIARO_VIEW_DRAG_H

#include "moving.h"
#include "view_camera.h"

typedef enum ViewGrip { GRIP_NOTHING, GRIP_CAMERA, GRIP_LAMP, GRIP_OBJECT } ViewGrip;

typedef struct ViewDrag {
    ViewGrip grip;
    uint32_t number; /* of the lamp or the object */
    Vec3 place;      /* where it is */
    Vec3 hold;       /* from the point that was taken to it */
    float depth;     /* of that point, along the camera's view */
} ViewDrag;

/* A mouse's place in a picture, as view_camera_ray() takes it. */
typedef struct ViewMouse {
    float x, y, aspect;
    float reach; /* how far from a lamp, as a share of half the picture's height, the mouse still takes it */
} ViewMouse;

/* Takes what lies under the mouse: a lamp (a point or spot) before an object, the camera where there is neither. */
ViewDrag view_drag_begin(const ViewCamera *camera, const ViewMouse *mouse, const ChiaroLight *lights,
                         uint32_t light_count, const Moving *moving);
/* Where the lamp or object is now: it stays at its depth. */
Vec3 view_drag_to(ViewDrag *drag, const ViewCamera *camera, const ViewMouse *mouse);
/* The same, further away by steps. */
Vec3 view_drag_push(ViewDrag *drag, const ViewCamera *camera, const ViewMouse *mouse, float steps);

#endif
