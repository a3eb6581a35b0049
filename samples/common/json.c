/* One flat JSON object. */
#include "json.h"

#include <math.h>

static void put_text(FILE *file, const char *text)
{
    fputc('"', file);
    for (; *text; text++) {
        unsigned char c = (unsigned char)*text;
        if (c == '"' || c == '\\')
            fprintf(file, "\\%c", c);
        else if (c < 0x20)
            fprintf(file, "\\u%04x", c);
        else
            fputc(c, file);
    }
    fputc('"', file);
}

static void put_key(Json *json, const char *key)
{
    fputs(json->any ? ", " : "", json->file);
    json->any = true;
    put_text(json->file, key);
    fputs(": ", json->file);
}

Json json_begin(FILE *file)
{
    fputc('{', file);
    return (Json){.file = file};
}

void json_text(Json *json, const char *key, const char *value)
{
    put_key(json, key);
    put_text(json->file, value);
}

void json_number(Json *json, const char *key, double value)
{
    put_key(json, key);
    if (isfinite(value))
        fprintf(json->file, "%.12g", value);
    else
        fputs("null", json->file);
}

bool json_end(Json *json)
{
    fputs("}\n", json->file);
    return fflush(json->file) == 0 && !ferror(json->file);
}
