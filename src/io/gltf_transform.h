/* Places and directions of a glTF file, in double so that deep hierarchies do not wear positions out. C++, inside src/io
 * only. */
#ifndef CHIARO_GLTF_TRANSFORM_H
#define CHIARO_GLTF_TRANSFORM_H

#include "gltf_access.h"

#include <algorithm>
#include <cfloat>
#include <cmath>

namespace chiaro_gltf {

struct Vector {
    double x, y, z;
};

inline Vector operator-(Vector a, Vector b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
inline Vector operator*(Vector a, double s) { return {a.x * s, a.y * s, a.z * s}; }
inline double dot(Vector a, Vector b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
inline Vector cross(Vector a, Vector b) { return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x}; }
inline double length(Vector a) { return std::sqrt(dot(a, a)); }
inline bool finite(Vector a) { return std::isfinite(a.x) && std::isfinite(a.y) && std::isfinite(a.z); }
inline Vector load_vector(const float *v) { return {double(v[0]), double(v[1]), double(v[2])}; }

/* False for the zero vector and for what is not finite. */
inline bool store_unit(float *out, Vector v)
{
    double size = length(v);
    if (!(size > DBL_MIN) || !std::isfinite(size))
        return false;
    out[0] = float(v.x / size);
    out[1] = float(v.y / size);
    out[2] = float(v.z / size);
    return true;
}

/* Columns of an affine transform. */
struct Transform {
    Vector x{1, 0, 0}, y{0, 1, 0}, z{0, 0, 1}, origin{0, 0, 0};

    Vector direction(Vector v) const
    {
        return {x.x * v.x + y.x * v.y + z.x * v.z, x.y * v.x + y.y * v.y + z.y * v.z,
                x.z * v.x + y.z * v.y + z.z * v.z};
    }
    Vector point(Vector v) const
    {
        Vector d = direction(v);
        return {d.x + origin.x, d.y + origin.y, d.z + origin.z};
    }
    double determinant() const { return dot(cross(x, y), z); }
    /* Cofactors: what the inverse transpose gives, also where there is no inverse; the sign follows the determinant. */
    Vector normal(Vector n) const
    {
        Vector a = cross(y, z), b = cross(z, x), c = cross(x, y);
        Vector v = Transform{a, b, c, {0, 0, 0}}.direction(n);
        return determinant() < 0 ? v * -1 : v;
    }
    /* Only where the determinant is not zero. */
    Transform inverse() const
    {
        double s = 1 / determinant();
        Vector a = cross(y, z) * s, b = cross(z, x) * s, c = cross(x, y) * s;
        Transform t{{a.x, b.x, c.x}, {a.y, b.y, c.y}, {a.z, b.z, c.z}, {0, 0, 0}};
        t.origin = t.direction(origin) * -1;
        return t;
    }
};

Transform operator*(const Transform &a, const Transform &b);

/* A box about places. */
struct Bounds {
    Vector low{INFINITY, INFINITY, INFINITY}, high{-INFINITY, -INFINITY, -INFINITY};

    void grow(Vector p)
    {
        if (!finite(p))
            return;
        low = {std::min(low.x, p.x), std::min(low.y, p.y), std::min(low.z, p.z)};
        high = {std::max(high.x, p.x), std::max(high.y, p.y), std::max(high.z, p.z)};
    }

    /* Zero, where floats tell its places apart as finely as a bake does. Else about its middle, in steps of a power of two
     * that is no less than its size: what differs only in where it lies is read alike, to the bit if by whole steps. */
    Vector near_origin() const
    {
        Vector extent = high - low;
        double size = std::max({extent.x, extent.y, extent.z});
        double furthest = std::max({high.x, high.y, high.z, -low.x, -low.y, -low.z});
        if (!(size > 0) || !(furthest * double(FLT_EPSILON) > coarse * size))
            return {0, 0, 0};
        double step = std::exp2(std::ceil(std::log2(size)));
        return {step * std::nearbyint((low.x + high.x) / 2 / step), step * std::nearbyint((low.y + high.y) / 2 / step),
                step * std::nearbyint((low.z + high.z) / 2 / step)};
    }

private:
    static constexpr double coarse = 1.0 / (1 << 20); /* steps of a bake, of the size (chiaro_bake()) */
};

/* A node's own transform, checked: translation, rotation and scale where it has no matrix. */
struct Local {
    double translation[3] = {0, 0, 0}, rotation[4] = {0, 0, 0, 1}, scale[3] = {1, 1, 1};
};
Local local_parts(const tinygltf::Node &node, int index);
Transform local_transform(const tinygltf::Node &node, int index);

Transform from_plain(const ChiaroIoAffine &t);
ChiaroIoAffine to_plain(const Transform &t);

} // namespace chiaro_gltf

#endif
