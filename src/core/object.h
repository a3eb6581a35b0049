/* Layout of a baked object: a header, then every array of ChiaroObject in a fixed order (transport.h has the manners). */
#ifndef CHIARO_OBJECT_H
#define CHIARO_OBJECT_H

#include "chiaro/chiaro_world.h"
#include "transport.h"

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

#endif
