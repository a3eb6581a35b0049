/* Messages of the library. */
#include "log.h"

#include <stdarg.h>
#include <stdio.h>

void chiaro_log_write(const ChiaroLog *log, ChiaroLogLevel level, ChiaroLogItem item, const char *format, ...)
{
    if (!log || !log->func)
        return;
    char line[512];
    int used = snprintf(line, sizeof line, "%s: ", chiaro_log_item_text(item));
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(line + used, sizeof line - (size_t)used, format, arguments);
    va_end(arguments);
    log->func(level, item, line, log->user);
}
