/* The animations of a glTF file, checked. C++, inside src/io only. */
#ifndef CHIARO_GLTF_ANIMATION_H
#define CHIARO_GLTF_ANIMATION_H

#include "gltf_access.h"

namespace chiaro_gltf {

/* Numbers of channels; they stay where they are when more come. */
using FloatArrays = std::vector<std::vector<float>>;

/* Per node, what all animations of the file together do to it. */
std::vector<std::vector<ChiaroIoChannel>> read_animations(const tinygltf::Model &model, FloatArrays *arrays);

} // namespace chiaro_gltf

#endif
