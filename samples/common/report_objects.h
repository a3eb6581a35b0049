/* Objects of a report, in motion: what report_objects.c and report_motion.c share. */
#ifndef CHIARO_REPORT_OBJECTS_H
#define CHIARO_REPORT_OBJECTS_H

#include "picture.h"
#include "report_device.h"

/* A circle for moving_pose() on which objects neither meet each other nor, while there is another way, a wall. `size`: of
 * the scene, m. */
float report_object_circle(const Moving *moving, float size);
/* The scene with all objects where moving_pose() has them, for the reference. */
void report_merge(const Report *report, const ReportScene *scene, const Moving *moving, float radius, float turn,
                  MergedScene *merged);

#endif
