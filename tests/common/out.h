/* Where tests put the files that they make. */
#ifndef CHIARO_TEST_OUT_H
#define CHIARO_TEST_OUT_H

#include <sys/stat.h>

#define OUT "build/tests/out/"

/* Makes the folder; for cmocka, as the set-up of a group. */
static inline int make_folder(void **state)
{
    (void)state;
    mkdir("build", 0777);
    mkdir("build/tests", 0777);
    mkdir("build/tests/out", 0777);
    return 0;
}

#endif
