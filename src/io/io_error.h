/* How the files of src/io fill a ChiaroIoError. */
#ifndef CHIARO_IO_ERROR_H
#define CHIARO_IO_ERROR_H

#include "io.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>

/* "path: what is wrong". Always false, so that a function can end with it. `error` may be NULL. */
static inline bool __attribute__((format(printf, 3, 4))) chiaro_io_fail(ChiaroIoError *error, const char *path,
                                                                          const char *format, ...)
{
    char text[CHIARO_IO_MESSAGE_SIZE / 2 - 3];
    va_list arguments;
    if (!error)
        return false;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    /* A long path must not push the fault out of the line: its tail says more than its head. */
    size_t length = strlen(path), room = sizeof error->message / 2;
    snprintf(error->message, sizeof error->message, "%s: %s", length > room ? path + length - room : path, text);
    /* One line, whatever a file's own names contain. */
    for (char *c = error->message; *c; c++)
        if ((unsigned char)*c < 0x20 || *c == 0x7f)
            *c = ' ';
    return false;
}

#endif
