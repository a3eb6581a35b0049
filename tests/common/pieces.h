/* A scene taken apart: what stays, and what moves. For tests and benchmarks. */
#ifndef CHIARO_TEST_PIECES_H
#define CHIARO_TEST_PIECES_H

#include "chiaro/chiaro.h"

/* The parts [first, first + count) of a scene as one of their own, moved by -center; vertices that no part uses are left
 * out. Materials, textures, lights and cameras are those of `scene`, which must outlive it. Memory that cannot be had
 * ends the program. */
ChiaroScene piece_make(const ChiaroScene *scene, uint32_t first, uint32_t count, const float center[3]);

/* All triangles of two scenes that share their materials; the second one moved by `center`. */
ChiaroScene piece_join(const ChiaroScene *scene, const ChiaroScene *other, const float center[3]);
void piece_free(ChiaroScene *piece);

#endif
