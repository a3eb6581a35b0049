/* The one table of the core's functions. */
#ifndef CHIARO_CORE_TABLE_H
#define CHIARO_CORE_TABLE_H

#include "chiaro/chiaro_core.h"

extern const ChiaroCoreApi chiaro_core_table;

#endif
