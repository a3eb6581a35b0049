/* The API reference: every public function and every entry of the table says what goes wrong, who may call it when, and how
 * long what it gives lives. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <ctype.h>
#include <dirent.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "../src/io/io.h"

static const char *const tags[] = {"@errors", "@thread_safety", "@lifetime"};

/* The comment that ends right before a declaration, as a copy; NULL: there is none. */
static char *comment_before(const char *text, const char *declaration)
{
    const char *end = declaration;
    while (end > text && isspace((unsigned char)end[-1]))
        end--;
    if (end - text < 2 || strncmp(end - 2, "*/", 2) != 0)
        return NULL;
    const char *begin = end - 2;
    while (begin > text && strncmp(begin, "/*", 2) != 0)
        begin--;
    return strncmp(begin, "/**", 3) == 0 ? strndup(begin, (size_t)(end - begin)) : NULL;
}

/* Counts what is missing, saying it. */
static uint32_t check(const char *file, const char *text, const char *declaration)
{
    uint32_t missing = 0;
    char *comment = comment_before(text, declaration);
    for (size_t i = 0; i < sizeof tags / sizeof *tags; i++) {
        if (comment && strstr(comment, tags[i]))
            continue;
        printf("  %s: no %s: %.*s\n", file, tags[i], (int)strcspn(declaration, "\n"), declaration);
        missing++;
    }
    free(comment);
    return missing;
}

static const char *line_of(const char *text, const char *place)
{
    while (place > text && place[-1] != '\n')
        place--;
    return place;
}

/* Every header of the folder, whole. */
static void every_function_says_errors_threads_and_lifetime(void **state)
{
    (void)state;
    DIR *folder = opendir("include/chiaro");
    uint32_t functions = 0, entries = 0, missing = 0;
    assert_non_null(folder);
    for (const struct dirent *entry; (entry = readdir(folder));) {
        char path[512];
        ChiaroIoFile file;
        ChiaroIoError error;
        if (!strstr(entry->d_name, ".h"))
            continue;
        snprintf(path, sizeof path, "include/chiaro/%s", entry->d_name);
        assert_true(chiaro_io_map(path, &file, &error));
        char *text = strndup(file.data, file.size);
        assert_non_null(text);
        for (const char *at = text; (at = strstr(at, "CHIARO_API ")); at++) {
            if (*line_of(text, at) == '#' || line_of(text, at) != at)
                continue;
            functions++;
            missing += check(entry->d_name, text, at);
        }
        const char *table = strstr(text, "typedef struct ChiaroVulkanApi {"), *end = strstr(text, "} ChiaroVulkanApi;");
        for (const char *at = table; at && (at = strstr(at, "(*")) && at < end; at++) {
            entries++;
            missing += check(entry->d_name, text, line_of(text, at) + 4);
        }
        free(text);
        chiaro_io_unmap(&file);
    }
    closedir(folder);
    printf("  %u functions, %u entries of the table\n", functions, entries);
    assert_true(functions > 80 && entries > 15);
    assert_int_equal(missing, 0);
}

static void what_lacks_a_tag_is_found(void **state)
{
    (void)state;
    static const char text[] = "/** Does. @errors none. @thread_safety any. */\nCHIARO_API void f(void);\n"
                               "CHIARO_API void g(void);\n";
    assert_int_equal(check("(meant)", text, strstr(text, "CHIARO_API void f")), 1);
    assert_int_equal(check("(meant)", text, strstr(text, "CHIARO_API void g")), 3);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_function_says_errors_threads_and_lifetime),
        cmocka_unit_test(what_lacks_a_tag_is_found),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
