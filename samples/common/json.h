/* One flat JSON object on standard output. */
#ifndef CHIARO_JSON_H
#define CHIARO_JSON_H

#include <stdbool.h>
#include <stdio.h>

typedef struct Json {
    FILE *file;
    bool any; /* something stands in the object already */
} Json;

Json json_begin(FILE *file);
void json_text(Json *json, const char *key, const char *value);
/* NaN and infinity, which JSON does not know, become null. */
void json_number(Json *json, const char *key, double value);
/* Closes the object. False if it could not be written. */
bool json_end(Json *json);

#endif
