/* A glTF file as tinygltf sees it, and checked ways to its contents. C++, inside src/io only. */
#ifndef CHIARO_GLTF_ACCESS_H
#define CHIARO_GLTF_ACCESS_H

#include "io.h"

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

/* Somebody else's code: our warnings are not its rules. */
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wconversion"
#pragma GCC diagnostic ignored "-Wshadow"
#pragma GCC diagnostic ignored "-Wunused-parameter"
#include <tiny_gltf.h>
#pragma GCC diagnostic pop

namespace chiaro_gltf {

/* What is wrong with the file; ends the import. */
struct Fault {
    std::string text;
};

[[noreturn]] __attribute__((format(printf, 1, 2))) void fail(const char *format, ...);

/* tinygltf checks hardly any index: every one goes through here. */
template <class T> const T &element(const std::vector<T> &list, int index, const char *what)
{
    if (index < 0 || size_t(index) >= list.size())
        fail("%s %d does not exist (there are %zu)", what, index, list.size());
    return list[size_t(index)];
}

/* Parses a .gltf or .glb in memory; files beside it are looked for in the folder of `path`. Refuses versions and
 * required extensions that we do not know. Images keep their encoded bytes: most are never shown. */
void parse(const char *path, const ChiaroIoFile &file, tinygltf::Model *model);

struct Span {
    const unsigned char *data;
    size_t size;
};

/* The bytes of a buffer view. */
Span view_bytes(const tinygltf::Model &model, int index);

bool is_unsigned(int component_type);

/* The elements of an accessor, unpacked. No accessor: count 0. */
template <class T> struct Elements {
    std::vector<T> values;
    size_t count = 0, width = 0;
};

/* All component types, strides and sparse data; for float and uint32_t. */
template <class T>
Elements<T> read_accessor(const tinygltf::Model &model, int index, bool always_normalized = false);

} // namespace chiaro_gltf

#endif
