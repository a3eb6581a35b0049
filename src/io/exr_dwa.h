/* OpenEXR files whose compression the C library cannot undo. */
#ifndef CHIARO_EXR_DWA_H
#define CHIARO_EXR_DWA_H

#include "io.h"

/* Reads the file into image->pixels, whose size, channels and memory are already there. NULL, or the fault. `left` and
 * `top` are the corner of the data window that the size was taken from. */
const char *chiaro_io_read_exr_dwa(const char *path, int left, int top, ChiaroIoImage *image);

#endif
