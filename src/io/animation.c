/* Node animations of glTF 2.0, appendix C: where an object is at a time. In double, as the nodes' own transforms are. */
#include "io.h"

#include <math.h>
#include <string.h>

/* ------------------------------------------------------------------------------------------------------------------
 * Transforms
 */

static void direction(const ChiaroIoAffine *t, const double v[3], double out[3])
{
    for (int i = 0; i < 3; i++)
        out[i] = t->x[i] * v[0] + t->y[i] * v[1] + t->z[i] * v[2];
}

ChiaroIoAffine chiaro_io_multiply(const ChiaroIoAffine *a, const ChiaroIoAffine *b)
{
    ChiaroIoAffine c;
    direction(a, b->x, c.x);
    direction(a, b->y, c.y);
    direction(a, b->z, c.z);
    direction(a, b->origin, c.origin);
    for (int i = 0; i < 3; i++)
        c.origin[i] += a->origin[i];
    return c;
}

ChiaroIoAffine chiaro_io_compose(const double translation[3], const double rotation[4], const double scale[3])
{
    double qx = rotation[0], qy = rotation[1], qz = rotation[2], qw = rotation[3];
    double s = 2 / (qx * qx + qy * qy + qz * qz + qw * qw); /* Forgives a quaternion that is not unit. */
    ChiaroIoAffine t = {{1 - s * (qy * qy + qz * qz), s * (qx * qy + qz * qw), s * (qx * qz - qy * qw)},
                        {s * (qx * qy - qz * qw), 1 - s * (qx * qx + qz * qz), s * (qy * qz + qx * qw)},
                        {s * (qx * qz + qy * qw), s * (qy * qz - qx * qw), 1 - s * (qx * qx + qy * qy)},
                        {translation[0], translation[1], translation[2]}};
    for (int i = 0; i < 3; i++) {
        t.x[i] *= scale[0];
        t.y[i] *= scale[1];
        t.z[i] *= scale[2];
    }
    return t;
}

/* ------------------------------------------------------------------------------------------------------------------
 * Interpolation
 */

/* The last key that is not after `time`; the first if there is none. */
static uint32_t find_key(const ChiaroIoChannel *channel, double time)
{
    uint32_t low = 0, high = channel->key_count; /* times[low] <= time < times[high] */
    while (high - low > 1) {
        uint32_t middle = low + (high - low) / 2;
        if ((double)channel->times[middle] <= time)
            low = middle;
        else
            high = middle;
    }
    return low;
}

/* A spline may pass through zero: that is no rotation at all. */
static void normalize(double q[4])
{
    double length = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    for (int i = 0; i < 4; i++)
        q[i] = length > 0 ? q[i] / length : i == 3 ? 1 : 0;
}

/* From a to b (unit) the shorter way round, at constant speed. */
static void slerp(const double a[4], const double b[4], double u, double out[4])
{
    double cosine = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3], sign = cosine < 0 ? -1 : 1;
    double angle = acos(fmin(1, sign * cosine)), sine = sin(angle);
    /* Closer than that a straight line is as good, and does not divide by zero. */
    double from = sine > 1e-6 ? sin((1 - u) * angle) / sine : 1 - u, to = sine > 1e-6 ? sin(u * angle) / sine : u;
    for (int i = 0; i < 4; i++)
        out[i] = from * a[i] + sign * to * b[i];
}

/* Hermite's cubic. Slopes are per second: `span` seconds lie between the keys. */
static double cubic(double value, double slope, double next_value, double next_slope, double span, double u)
{
    double u2 = u * u, u3 = u2 * u;
    return (2 * u3 - 3 * u2 + 1) * value + span * (u3 - 2 * u2 + u) * slope + (3 * u2 - 2 * u3) * next_value +
           span * (u3 - u2) * next_slope;
}

static void evaluate(const ChiaroIoChannel *channel, double time, double value[4])
{
    bool turns = channel->path == CHIARO_IO_ROTATION, spline = channel->interpolation == CHIARO_IO_CUBIC;
    uint32_t width = turns ? 4 : 3, key = find_key(channel, time), next = key + 1;
    size_t stride = (size_t)width * (spline ? 3 : 1);
    const float *here = channel->values + key * stride + (spline ? width : 0), *there = here + stride;
    double a[4], b[4];
    for (uint32_t i = 0; i < width; i++)
        a[i] = value[i] = (double)here[i];
    double first = (double)channel->times[key];
    if (next < channel->key_count && time > first && channel->interpolation != CHIARO_IO_STEP) {
        double span = (double)channel->times[next] - first, u = (time - first) / span;
        for (uint32_t i = 0; i < width; i++) {
            b[i] = (double)there[i];
            value[i] = spline ? cubic(a[i], (double)here[width + i], b[i], (double)*(there - width + i), span, u)
                              : a[i] + u * (b[i] - a[i]);
        }
        if (turns && !spline) {
            normalize(a);
            normalize(b);
            slerp(a, b, u, value);
        }
    }
    if (turns)
        normalize(value);
}

/* ------------------------------------------------------------------------------------------------------------------
 * Joints and objects
 */

static ChiaroIoAffine local_transform(const ChiaroIoScene *scene, const ChiaroIoJoint *joint, double time)
{
    double rest[3][4] = {{joint->translation[0], joint->translation[1], joint->translation[2]},
                         {joint->rotation[0], joint->rotation[1], joint->rotation[2], joint->rotation[3]},
                         {joint->scale[0], joint->scale[1], joint->scale[2]}};
    for (uint32_t i = 0; i < joint->channel_count; i++) {
        const ChiaroIoChannel *channel = &scene->channels[joint->first_channel + i];
        evaluate(channel, time, rest[channel->path]);
    }
    ChiaroIoAffine own = chiaro_io_compose(rest[CHIARO_IO_TRANSLATION], rest[CHIARO_IO_ROTATION], rest[CHIARO_IO_SCALE]);
    return chiaro_io_multiply(&joint->before, &own);
}

ChiaroIoAffine chiaro_io_joint_transform(const ChiaroIoScene *scene, uint32_t joint, double time)
{
    ChiaroIoAffine t = local_transform(scene, &scene->joints[joint], time);
    for (uint32_t parent = scene->joints[joint].parent; parent != CHIARO_NONE; parent = scene->joints[parent].parent) {
        ChiaroIoAffine above = local_transform(scene, &scene->joints[parent], time);
        t = chiaro_io_multiply(&above, &t);
    }
    return t;
}

void chiaro_io_object_transform(const ChiaroIoScene *scene, uint32_t object, double time, float transform[16])
{
    const ChiaroIoObject *o = &scene->objects[object];
    ChiaroIoAffine t = o->after;
    if (o->joint != CHIARO_NONE) {
        ChiaroIoAffine joint = chiaro_io_joint_transform(scene, o->joint, time);
        t = chiaro_io_multiply(&joint, &o->after);
    }
    const double *columns[4] = {t.x, t.y, t.z, t.origin};
    for (int column = 0; column < 4; column++) {
        for (int row = 0; row < 3; row++)
            transform[4 * column + row] = (float)columns[column][row];
        transform[4 * column + 3] = column == 3 ? 1.0f : 0.0f;
    }
}
