/* What moves in a glTF file: transforms of nodes, and the channels that change them. */
#include "gltf_animation.h"

#include "gltf_transform.h"

namespace chiaro_gltf {

/* ------------------------------------------------------------------------------------------------------------------
 * Transforms
 */

Transform from_plain(const ChiaroIoAffine &t)
{
    return {{t.x[0], t.x[1], t.x[2]}, {t.y[0], t.y[1], t.y[2]}, {t.z[0], t.z[1], t.z[2]},
            {t.origin[0], t.origin[1], t.origin[2]}};
}

ChiaroIoAffine to_plain(const Transform &t)
{
    return {{t.x.x, t.x.y, t.x.z}, {t.y.x, t.y.y, t.y.z}, {t.z.x, t.z.y, t.z.z}, {t.origin.x, t.origin.y, t.origin.z}};
}

Transform operator*(const Transform &a, const Transform &b)
{
    ChiaroIoAffine left = to_plain(a), right = to_plain(b);
    return from_plain(chiaro_io_multiply(&left, &right));
}

namespace {

void take_numbers(const std::vector<double> &values, size_t wanted, double *to, int node, const char *what)
{
    if (!values.empty() && values.size() != wanted)
        fail("node %d has a %s of %zu numbers", node, what, values.size());
    std::copy(values.begin(), values.end(), to);
}

} // namespace

Local local_parts(const tinygltf::Node &node, int index)
{
    Local local;
    take_numbers(node.translation, 3, local.translation, index, "translation");
    take_numbers(node.rotation, 4, local.rotation, index, "rotation");
    take_numbers(node.scale, 3, local.scale, index, "scale");
    return local;
}

Transform local_transform(const tinygltf::Node &node, int index)
{
    double m[16];
    take_numbers(node.matrix, 16, m, index, "matrix");
    Local local = local_parts(node, index);
    if (node.matrix.empty())
        return from_plain(chiaro_io_compose(local.translation, local.rotation, local.scale));
    return {{m[0], m[1], m[2]}, {m[4], m[5], m[6]}, {m[8], m[9], m[10]}, {m[12], m[13], m[14]}};
}

/* ------------------------------------------------------------------------------------------------------------------
 * Channels
 */

namespace {

/* False for what no node's transform depends on: weights of morphs, and properties that extensions name. */
bool path_of(const std::string &name, uint32_t *path)
{
    static const char *const names[3] = {"translation", "rotation", "scale"};
    for (uint32_t i = 0; i < 3; i++)
        if (name == names[i]) {
            *path = i;
            return true;
        }
    return false;
}

uint32_t interpolation_of(const std::string &name, int animation)
{
    if (name == "STEP")
        return CHIARO_IO_STEP;
    if (name == "CUBICSPLINE")
        return CHIARO_IO_CUBIC;
    if (name != "LINEAR")
        fail("animation %d has the unknown interpolation '%s'", animation, name.c_str());
    return CHIARO_IO_LINEAR;
}

void check_times(const Elements<float> &times, int animation)
{
    if (times.count == 0 || times.width != 1)
        fail("animation %d has keys without times", animation);
    for (size_t i = 0; i < times.count; i++) {
        if (!std::isfinite(times.values[i]))
            fail("animation %d has a time that is not finite", animation);
        if (i > 0 && !(times.values[i] > times.values[i - 1]))
            fail("animation %d has times that do not rise", animation);
    }
}

void check_values(const Elements<float> &values, const ChiaroIoChannel &channel, int animation)
{
    bool turns = channel.path == CHIARO_IO_ROTATION, spline = channel.interpolation == CHIARO_IO_CUBIC;
    size_t width = turns ? 4 : 3, wanted = size_t(channel.key_count) * (spline ? 3 : 1);
    if (values.width != width || values.count != wanted)
        fail("animation %d has %zu values of %zu numbers for %u keys", animation, values.count, values.width,
             channel.key_count);
    for (float value : values.values)
        if (!std::isfinite(value))
            fail("animation %d has a value that is not finite", animation);
    for (size_t key = 0; turns && key < channel.key_count; key++) {
        const float *q = &values.values[width * (spline ? 3 * key + 1 : key)];
        if (q[0] == 0 && q[1] == 0 && q[2] == 0 && q[3] == 0)
            fail("animation %d has a rotation of no length", animation);
    }
}

} // namespace

std::vector<std::vector<ChiaroIoChannel>> read_animations(const tinygltf::Model &model, FloatArrays *arrays)
{
    std::vector<std::vector<ChiaroIoChannel>> of_node(model.nodes.size());
    for (size_t i = 0; i < model.animations.size(); i++) {
        const tinygltf::Animation &animation = model.animations[i];
        int number = int(i);
        for (const tinygltf::AnimationChannel &source : animation.channels) {
            ChiaroIoChannel channel = {};
            if (source.target_node == -1 || !path_of(source.target_path, &channel.path))
                continue; /* glTF: a channel without a node is ignored. */
            if (!element(model.nodes, source.target_node, "node").matrix.empty())
                fail("animation %d moves node %d, which has a matrix", number, source.target_node);
            const tinygltf::AnimationSampler &sampler = element(animation.samplers, source.sampler, "sampler");
            channel.interpolation = interpolation_of(sampler.interpolation, number);
            Elements<float> times = read_accessor<float>(model, sampler.input);
            Elements<float> values = read_accessor<float>(model, sampler.output);
            check_times(times, number);
            channel.key_count = uint32_t(times.count);
            check_values(values, channel, number);
            arrays->push_back(std::move(times.values));
            channel.times = arrays->back().data();
            arrays->push_back(std::move(values.values));
            channel.values = arrays->back().data();
            of_node[size_t(source.target_node)].push_back(channel);
        }
    }
    return of_node;
}

} // namespace chiaro_gltf
