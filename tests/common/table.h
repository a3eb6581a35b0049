/* The table of `make stability`: what is expected, what came out, by how much they differ, and whether that will do.
 * Included after cmocka.h. A table fails as a whole, at its end, so that all of it is seen. */
#ifndef CHIARO_TEST_TABLE_H
#define CHIARO_TEST_TABLE_H

#include <math.h>
#include <stdio.h>

typedef struct Table {
    unsigned rows, failed;
} Table;

static inline Table table_begin(const char *title)
{
    printf("| %-66s | %12s | %12s | %9s | %9s | pass |\n", title, "expected", "got", "error", "allowed");
    return (Table){0, 0};
}

static inline void table_put(Table *table, const char *name, double expected, double got, double error, double allowed)
{
    bool good = error <= allowed; /* a NaN is not */
    table->rows++;
    table->failed += !good;
    printf("| %-66s | %12.6g | %12.6g | %9.2e | %9.2e | %s |\n", name, expected, got, error, allowed,
           good ? "yes " : "NO  ");
}

/* Relative to what is expected; where that is nothing, as it is. */
static inline void table_near(Table *table, const char *name, double expected, double got, double allowed)
{
    table_put(table, name, expected, got, fabs(got - expected) / (expected != 0 ? fabs(expected) : 1), allowed);
}

/* For what is an error, or a count, itself. */
static inline void table_most(Table *table, const char *name, double got, double allowed)
{
    table_put(table, name, 0, got, got, allowed);
}

static inline void table_end(const Table *table)
{
    fflush(stdout);
    if (table->failed || !table->rows)
        fail_msg("%u of %u rows of the table failed", table->failed, table->rows);
}

#endif
