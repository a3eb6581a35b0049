/* Between tinygltf and the importer. tinygltf checks the JSON but hardly any index or range, so everything that is read
 * by position, from the container's chunks to sparse accessors, is checked here before it is touched. */
#include "gltf_access.h"

#include "io_error.h"

#include <algorithm>
#include <cctype>
#include <cstring>
#include <sys/stat.h>

namespace chiaro_gltf {

[[noreturn]] void fail(const char *format, ...)
{
    char text[CHIARO_IO_MESSAGE_SIZE / 2];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    throw Fault{text};
}

namespace {

const size_t max_elements = size_t{1} << 27; /* Of one accessor. */
const int max_json_depth = 128;              /* tinygltf recurses. */

/* ------------------------------------------------------------------------------------------------------------------
 * Files
 */

bool file_exists(const std::string &path, void *)
{
    struct stat status;
    return stat(path.c_str(), &status) == 0 && S_ISREG(status.st_mode);
}

std::string keep_path(const std::string &path, void *) { return path; }

bool read_file(std::vector<unsigned char> *out, std::string *error, const std::string &path, void *)
{
    ChiaroIoFile file;
    ChiaroIoError fault;
    if (!chiaro_io_map(path.c_str(), &file, &fault)) {
        *error += fault.message;
        return false;
    }
    const unsigned char *bytes = static_cast<const unsigned char *>(file.data);
    out->assign(bytes, bytes + file.size);
    chiaro_io_unmap(&file);
    return true;
}

bool refuse_write(std::string *, const std::string &, const std::vector<unsigned char> &, void *) { return false; }

/* Keeps the bytes of an image as they are: only those that a material shows are decoded, later. tinygltf does not check
 * the range of an image in a buffer view before it calls this, so those bytes are not looked at here. */
bool keep_image(tinygltf::Image *image, const int, std::string *, std::string *, int, int, const unsigned char *bytes,
                int size, void *)
{
    if (image->bufferView < 0)
        image->image.assign(bytes, bytes + size);
    return true;
}

uint32_t read_u32(const unsigned char *bytes)
{
    return uint32_t(bytes[0]) | uint32_t(bytes[1]) << 8 | uint32_t(bytes[2]) << 16 | uint32_t(bytes[3]) << 24;
}

/* Refuses what tinygltf would read past the end of. Returns the length of the JSON; its start is `*json`. */
size_t check_container(const unsigned char *bytes, size_t size, const unsigned char **json)
{
    *json = bytes;
    if (size > UINT32_MAX)
        fail("is larger than 4 GiB");
    if (size < 4 || memcmp(bytes, "glTF", 4) != 0)
        return size;
    if (size < 20)
        fail("is cut short: no room for a header");
    uint32_t version = read_u32(bytes + 4), length = read_u32(bytes + 8), json_length = read_u32(bytes + 12);
    if (version != 2)
        fail("is binary glTF of version %u, not 2", version);
    if (length > size)
        fail("is cut short: %zu bytes of %u", size, length);
    uint64_t end = uint64_t{20} + json_length;
    if (end > length)
        fail("has a JSON chunk that reaches past the end");
    if (end != length) {
        if (end + 8 > length || end + 8 + read_u32(bytes + end) > length)
            fail("has a binary chunk that reaches past the end");
    }
    *json = bytes + 20;
    return json_length;
}

void check_depth(const unsigned char *json, size_t size)
{
    int depth = 0;
    bool quoted = false;
    for (size_t i = 0; i < size; i++) {
        unsigned char c = json[i];
        if (quoted && c == '\\')
            i++;
        else if (c == '"')
            quoted = !quoted;
        else if (!quoted && (c == '{' || c == '[') && ++depth > max_json_depth)
            fail("has JSON that is nested too deeply");
        else if (!quoted && (c == '}' || c == ']'))
            depth--;
    }
}

/* An extension may change what anything in the file means, hence the list of those we obey. */
void check_extensions(const tinygltf::Model &model)
{
    static const char *const known[] = {"KHR_lights_punctual", "KHR_materials_emissive_strength",
                                        "KHR_texture_transform", "KHR_materials_unlit", "KHR_mesh_quantization",
                                        "KHR_materials_transmission", "KHR_materials_diffuse_transmission"};
    for (const std::string &name : model.extensionsRequired) {
        bool found = false;
        for (const char *k : known)
            found |= name == k;
        if (!found)
            fail("requires the extension %s, which is not supported", name.c_str());
    }
}

void check_version(const tinygltf::Asset &asset)
{
    if (asset.version.compare(0, 2, "2.") != 0)
        fail("is glTF of version '%s', not 2", asset.version.c_str());
    if (!asset.minVersion.empty() && asset.minVersion != "2.0")
        fail("needs glTF '%s', newer than 2.0", asset.minVersion.c_str());
}

} // namespace

void parse(const char *path, const ChiaroIoFile &file, tinygltf::Model *model)
{
    const unsigned char *bytes = static_cast<const unsigned char *>(file.data);
    size_t size = file.size;
    const unsigned char *json;
    size_t json_size = check_container(bytes, size, &json);
    check_depth(json, json_size);
    tinygltf::TinyGLTF loader;
    loader.SetImageLoader(keep_image, nullptr);
    loader.SetFsCallbacks({file_exists, keep_path, read_file, refuse_write, nullptr});
    std::string error, warning, name = path;
    size_t slash = name.rfind('/');
    std::string folder = slash == std::string::npos ? "." : slash == 0 ? "/" : name.substr(0, slash);
    bool done = json == bytes
                    ? loader.LoadASCIIFromString(model, &error, &warning, reinterpret_cast<const char *>(bytes),
                                                 static_cast<unsigned>(size), folder, tinygltf::REQUIRE_VERSION)
                    : loader.LoadBinaryFromMemory(model, &error, &warning, bytes, static_cast<unsigned>(size), folder,
                                                  tinygltf::REQUIRE_VERSION);
    check_extensions(*model); /* First: an unknown one may well be why the rest failed. */
    if (!done) {
        while (!error.empty() && isspace(static_cast<unsigned char>(error.back())))
            error.pop_back();
        fail("cannot be read as glTF: %s", error.empty() ? "unknown fault" : error.c_str());
    }
    check_version(model->asset);
}

/* ------------------------------------------------------------------------------------------------------------------
 * Accessors
 */

Span view_bytes(const tinygltf::Model &model, int index)
{
    const tinygltf::BufferView &view = element(model.bufferViews, index, "buffer view");
    const tinygltf::Buffer &buffer = element(model.buffers, view.buffer, "buffer");
    if (view.byteOffset > buffer.data.size() || view.byteLength > buffer.data.size() - view.byteOffset)
        fail("buffer view %d reaches past the end of its buffer", index);
    return {buffer.data.data() + view.byteOffset, view.byteLength};
}

bool is_unsigned(int type)
{
    return type == TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE || type == TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT ||
           type == TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT;
}

namespace {

/* `count` elements of `size` bytes, `stride` apart, from `offset` on: all within the span? */
const unsigned char *checked_range(Span span, size_t offset, size_t count, size_t size, size_t stride, int accessor)
{
    if (count > max_elements)
        fail("accessor %d has too many elements", accessor);
    if (count > 0 && (offset > span.size || stride > span.size || size > span.size - offset ||
                      (count - 1) * stride > span.size - offset - size))
        fail("accessor %d reaches past the end of its buffer view", accessor);
    return span.data + offset;
}

template <class T> double load(const unsigned char *bytes)
{
    T value;
    memcpy(&value, bytes, sizeof value);
    return double(value);
}

double read_component(const unsigned char *bytes, int type, bool normalized)
{
    switch (type) {
    case TINYGLTF_COMPONENT_TYPE_BYTE:
        return normalized ? std::max(load<int8_t>(bytes) / 127, -1.0) : load<int8_t>(bytes);
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE:
        return load<uint8_t>(bytes) / (normalized ? 255 : 1);
    case TINYGLTF_COMPONENT_TYPE_SHORT:
        return normalized ? std::max(load<int16_t>(bytes) / 32767, -1.0) : load<int16_t>(bytes);
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT:
        return load<uint16_t>(bytes) / (normalized ? 65535 : 1);
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT:
        return load<uint32_t>(bytes) / (normalized ? 4294967295.0 : 1);
    default:
        return load<float>(bytes);
    }
}

size_t component_size(int type, int accessor)
{
    switch (type) {
    case TINYGLTF_COMPONENT_TYPE_BYTE:
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE:
        return 1;
    case TINYGLTF_COMPONENT_TYPE_SHORT:
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT:
        return 2;
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT:
    case TINYGLTF_COMPONENT_TYPE_FLOAT:
        return 4;
    default:
        fail("accessor %d has the component type %d, which glTF does not know", accessor, type);
    }
}

/* Overwrites what a sparse accessor stores apart. */
template <class T>
void apply_sparse(const tinygltf::Model &model, int index, bool normalized, size_t size, Elements<T> *out)
{
    const tinygltf::Accessor &accessor = model.accessors[size_t(index)];
    const auto &sparse = accessor.sparse;
    if (sparse.count < 0 || size_t(sparse.count) > out->count || sparse.indices.byteOffset < 0 ||
        sparse.values.byteOffset < 0 || !is_unsigned(sparse.indices.componentType))
        fail("accessor %d has sparse data out of range", index);
    size_t count = size_t(sparse.count), index_size = component_size(sparse.indices.componentType, index);
    const unsigned char *where = checked_range(view_bytes(model, sparse.indices.bufferView),
                                               size_t(sparse.indices.byteOffset), count, index_size, index_size, index);
    const unsigned char *what = checked_range(view_bytes(model, sparse.values.bufferView),
                                              size_t(sparse.values.byteOffset), count, size * out->width,
                                              size * out->width, index);
    for (size_t i = 0; i < count; i++) {
        size_t target = size_t(read_component(where + i * index_size, sparse.indices.componentType, false));
        if (target >= out->count)
            fail("accessor %d has a sparse index %zu beyond its %zu elements", index, target, out->count);
        for (size_t c = 0; c < out->width; c++)
            out->values[target * out->width + c] =
                T(read_component(what + (i * out->width + c) * size, accessor.componentType, normalized));
    }
}

} // namespace

template <class T>
Elements<T> read_accessor(const tinygltf::Model &model, int index, bool always_normalized)
{
    const tinygltf::Accessor &accessor = element(model.accessors, index, "accessor");
    Elements<T> out;
    size_t size = component_size(accessor.componentType, index);
    int width = tinygltf::GetNumComponentsInType(uint32_t(accessor.type));
    bool normalized = (accessor.normalized || always_normalized) &&
                      accessor.componentType != TINYGLTF_COMPONENT_TYPE_FLOAT;
    if (accessor.count > max_elements)
        fail("accessor %d has too many elements", index);
    out.count = accessor.count;
    out.width = size_t(width);
    if (accessor.bufferView != -1) {
        Span span = view_bytes(model, accessor.bufferView);
        size_t stride = model.bufferViews[size_t(accessor.bufferView)].byteStride, whole = size * out.width;
        if (stride == 0)
            stride = whole;
        if (stride < whole)
            fail("accessor %d has elements larger than their stride", index);
        const unsigned char *bytes = checked_range(span, accessor.byteOffset, out.count, whole, stride, index);
        out.values.resize(out.count * out.width);
        for (size_t i = 0; i < out.count; i++)
            for (size_t c = 0; c < out.width; c++)
                out.values[i * out.width + c] =
                    T(read_component(bytes + i * stride + c * size, accessor.componentType, normalized));
    } else {
        out.values.resize(out.count * out.width); /* glTF: zeros, usually overwritten by sparse data. */
    }
    if (accessor.sparse.isSparse)
        apply_sparse(model, index, normalized, size, &out);
    return out;
}

template Elements<float> read_accessor<float>(const tinygltf::Model &, int, bool);
template Elements<uint32_t> read_accessor<uint32_t>(const tinygltf::Model &, int, bool);

} // namespace chiaro_gltf
