/* The viewer's keys: one table says what they do, and F1 shows it. */
#ifndef CHIARO_VIEW_KEYS_H
#define CHIARO_VIEW_KEYS_H

#include <stddef.h>

#include "view_frame.h"

/* Does what a key (GLFW's number) says. False: it says nothing. */
bool view_keys_take(Viewer *viewer, int key);

/* All keys, a line each, with what is in and out. */
void view_keys_help(uint32_t without, char *text, size_t size);
/* A line that names what is out; nothing if all is in. */
void view_keys_out(uint32_t without, char *text, size_t size);

#endif
