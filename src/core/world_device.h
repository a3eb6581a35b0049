/* What the renderer asks of a world beyond the public header: to be told of cubes while it runs, so that sending them
 * is within what painting them may cost, and to leave the grids alone while they are sent piece by piece.
 */
#ifndef CHIARO_WORLD_DEVICE_H
#define CHIARO_WORLD_DEVICE_H

#include "chiaro/chiaro_world.h"

/* A slot that has just been painted; chiaro_world_cube() has it. */
typedef void (*ChiaroPaintedFunc)(uint32_t slot, void *user);

/* chiaro_world_run(), until so many cubes are painted. */
uint32_t chiaro_world_run_telling(ChiaroWorld *world, ChiaroBudget budget, uint32_t spent, uint32_t cubes,
                                  ChiaroPaintedFunc tell, void *user);

/* Somebody looks at the grids: chiaro_world_run() lays them anew when they are stale, but not while they are held, for
 * then what chiaro_world_blockers_shown() told is still read. */
void chiaro_world_blockers_follow(ChiaroWorld *world, bool held);

#endif
