/* Numbers against numbers, for tests. Included after cmocka.h. */
#ifndef CHIARO_TEST_CHECK_H
#define CHIARO_TEST_CHECK_H

#include <math.h>
#include <stdlib.h>

static const double pi = 3.14159265358979323846;

/* NaN is near nothing. `what` and `number` name the case. */
static inline void assert_near(const char *what, double number, double value, double truth, double tolerance)
{
    if (!(fabs(value - truth) <= tolerance))
        fail_msg("%s (%g): %.8g instead of %.8g, wrong by %.2g of %.2g allowed", what, number, value, truth,
                 fabs(value - truth), tolerance);
}

static inline void assert_below(const char *what, double number, double value, double limit)
{
    if (!(value <= limit))
        fail_msg("%s (%g): %.8g is above %.8g", what, number, value, limit);
}

static inline void *new_array(size_t count, size_t size)
{
    void *memory = calloc(count + 1, size);
    assert_non_null(memory);
    return memory;
}

#endif
