/* Layout of a baked object: a header, then every array of ChiaroObject in a fixed order (transport.h has the manners). */
#ifndef CHIARO_OBJECT_H
#define CHIARO_OBJECT_H

#include "chiaro/chiaro_world.h"
#include "transport.h"
#include "vec.h"

#define CHIARO_OBJECT_MAGIC "CHIAROBJ"
enum { CHIARO_OBJECT_VERSION = 2, CHIARO_OBJECT_ARRAYS = 7, CHIARO_OBJECT_MAX_ELEMENTS = 1 << 16 };

typedef struct ChiaroObjectHeader {
    ChiaroFileStart start;
    uint32_t vertex_count, element_count, part_count, reserved;
    float center[3];
    float radius;
} ChiaroObjectHeader;

/* The arrays of an object, in file order, sized by its counts. */
void chiaro_object_arrays(ChiaroObject *object, ChiaroFileArray arrays[CHIARO_OBJECT_ARRAYS]);

/* Mean square of an element's reach along an axis. */
static inline float chiaro_spread_along(const float s[6], Vec3 a)
{
    return a.x * a.x * s[0] + a.y * a.y * s[1] + a.z * a.z * s[2] +
           2 * (a.x * a.y * s[3] + a.y * a.z * s[4] + a.z * a.x * s[5]);
}

#endif
