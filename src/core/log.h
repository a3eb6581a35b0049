/* Messages of the library go out through here, and nowhere else. */
#ifndef CHIARO_LOG_H
#define CHIARO_LOG_H

#include "chiaro/chiaro.h"

/* One line: the item's fixed text, then the details. Does nothing if there is nowhere to log to. */
void chiaro_log_write(const ChiaroLog *log, ChiaroLogLevel level, ChiaroLogItem item, const char *format, ...)
    __attribute__((format(printf, 4, 5)));

#endif
