/* The plugin of the build that a test belongs to. Included after cmocka.h. */
#ifndef CHIARO_TEST_PLUGIN_H
#define CHIARO_TEST_PLUGIN_H

#include <dlfcn.h>
#include <limits.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

/* A file of the build: `name` from its top. */
static inline void build_path(char path[PATH_MAX], const char *name)
{
    char own[PATH_MAX];
    ssize_t length = readlink("/proc/self/exe", own, sizeof own - 1);
    assert_true(length > 0);
    own[length] = 0;
    for (int up = 0; up < 2; up++) /* out of tests/ */
        *strrchr(own, '/') = 0;
    snprintf(path, PATH_MAX, "%.2000s/%.2000s", own, name);
}

/* What the plugin's one symbol is, as a pointer to any function. */
static inline void open_plugin(void *function, size_t size)
{
    char path[PATH_MAX];
    build_path(path, "chiaro_plugin.so");
    void *library = dlopen(path, RTLD_NOW | RTLD_LOCAL);
    if (!library)
        fail_msg("%s", dlerror());
    void *symbol = dlsym(library, "chiaro_vulkan_get_api");
    assert_non_null(symbol);
    memcpy(function, &symbol, size);
}

#endif
