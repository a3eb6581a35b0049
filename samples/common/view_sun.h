/* The time of day of a sun that is a light of its own. */
#ifndef CHIARO_VIEW_SUN_H
#define CHIARO_VIEW_SUN_H

#include "chiaro/chiaro.h"

/* At `hour` o'clock, 0 .. 24, what shines as `noon` does at 12: an equinox, six to eighteen. It goes along the great
 * circle through its place at noon, reddens toward the horizon, and is dark below it. */
ChiaroLight view_sun(const ChiaroLight *noon, float hour);

#endif
