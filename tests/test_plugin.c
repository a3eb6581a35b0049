/* The plugin as a host's loader sees it: what it needs, what it shows, how large it is; and the versions that both sides
 * check. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <elf.h>
#include <math.h>
#include <stdlib.h>
#include <sys/stat.h>

#include "../src/io/io.h"
#include "chiaro/chiaro_vulkan.h"
#include "common/plugin.h"

/* What a dynamic section says: names of needed libraries, and of the symbols that others may use. */
typedef struct Dynamic {
    ChiaroIoFile file;
    const char *needed[16], *shown[256];
    uint32_t needed_count, shown_count;
} Dynamic;

static const Elf64_Shdr *section(const Dynamic *dynamic, uint32_t number)
{
    const uint8_t *data = dynamic->file.data;
    Elf64_Ehdr head;
    memcpy(&head, data, sizeof head);
    return (const Elf64_Shdr *)(const void *)(data + head.e_shoff) + number;
}

static Dynamic read_dynamic(const char *path)
{
    Dynamic dynamic = {0};
    ChiaroIoError error;
    Elf64_Ehdr head;
    assert_true(chiaro_io_map(path, &dynamic.file, &error));
    const char *data = dynamic.file.data;
    memcpy(&head, data, sizeof head);
    assert_memory_equal(head.e_ident, ELFMAG, SELFMAG);
    for (uint32_t i = 0; i < head.e_shnum; i++) {
        const Elf64_Shdr *part = section(&dynamic, i);
        const char *names = data + section(&dynamic, part->sh_link)->sh_offset;
        const Elf64_Dyn *entries = (const void *)(data + part->sh_offset);
        const Elf64_Sym *symbols = (const void *)(data + part->sh_offset);
        for (uint32_t k = 0; part->sh_type == SHT_DYNAMIC && entries[k].d_tag != DT_NULL; k++)
            if (entries[k].d_tag == DT_NEEDED && dynamic.needed_count < 16)
                dynamic.needed[dynamic.needed_count++] = names + entries[k].d_un.d_val;
        for (uint32_t k = 0; part->sh_type == SHT_DYNSYM && k < part->sh_size / sizeof *symbols; k++)
            if (symbols[k].st_shndx != SHN_UNDEF && ELF64_ST_BIND(symbols[k].st_info) != STB_LOCAL &&
                dynamic.shown_count < 256)
                dynamic.shown[dynamic.shown_count++] = names + symbols[k].st_name;
    }
    return dynamic;
}

static void it_needs_the_c_library_only_and_shows_one_symbol(void **state)
{
    (void)state;
    static const char *const allowed[] = {"libc.so", "libm.so", "libasan.so", "libubsan.so", "libtsan.so", "ld-linux"};
    char path[PATH_MAX];
    build_path(path, "chiaro_plugin.so");
    Dynamic dynamic = read_dynamic(path);
    assert_true(dynamic.needed_count > 0);
    for (uint32_t i = 0; i < dynamic.needed_count; i++) {
        bool known = false;
        for (size_t k = 0; k < sizeof allowed / sizeof *allowed; k++)
            known |= strncmp(dynamic.needed[i], allowed[k], strlen(allowed[k])) == 0;
        if (!known)
            fail_msg("the plugin needs %s", dynamic.needed[i]);
    }
    assert_int_equal(dynamic.shown_count, 1);
    assert_string_equal(dynamic.shown[0], CHIARO_VULKAN_SYMBOL);
    chiaro_io_unmap(&dynamic.file);
}

static void stripped_it_is_no_larger_than_300_kib(void **state)
{
    (void)state;
#ifdef NDEBUG
    char path[PATH_MAX], command[3 * PATH_MAX];
    struct stat status;
    build_path(path, "chiaro_plugin.so");
    snprintf(command, sizeof command, "strip -o build/tests/out/stripped.so '%s'", path);
    assert_int_equal(system(command), 0);
    assert_int_equal(stat("build/tests/out/stripped.so", &status), 0);
    printf("  %.1f KiB\n", (double)status.st_size / 1024);
    assert_true(status.st_size <= 300 * 1024);
#else
    skip(); /* sizes of other configurations are nobody's */
#endif
}

static void both_sides_check_the_version(void **state)
{
    (void)state;
    ChiaroVulkanGetApi get_api;
    open_plugin(&get_api, sizeof get_api);
    assert_null(get_api(0));
    assert_null(get_api(CHIARO_VULKAN_API_VERSION + 1));
    for (uint32_t version = 1; version <= CHIARO_VULKAN_API_VERSION; version++) {
        const ChiaroVulkanApi *api = get_api(version);
        assert_non_null(api);
        assert_true(api->struct_size >= sizeof *api && api->version >= version);
    }
    const ChiaroVulkanApi *api = get_api(CHIARO_VULKAN_API_VERSION);
    assert_true(api->core->struct_size >= sizeof *api->core);
    assert_int_equal(api->core->version(), CHIARO_VERSION);
    assert_ptr_not_equal(api, chiaro_vulkan_get_api(CHIARO_VULKAN_API_VERSION)); /* it is a library of its own */
}

/* No entry is forgotten: each is a pointer of its own. */
static void every_entry_of_both_tables_is_there(void **state)
{
    (void)state;
    ChiaroVulkanGetApi get_api;
    open_plugin(&get_api, sizeof get_api);
    const ChiaroVulkanApi *api = get_api(CHIARO_VULKAN_API_VERSION);
    const void *tables[2] = {api, api->core};
    const size_t sizes[2] = {sizeof *api, sizeof *api->core};
    for (int t = 0; t < 2; t++) {
        const size_t first = 2 * sizeof(uint32_t), count = (sizes[t] - first) / sizeof(void *);
        for (size_t i = 0; i < count; i++) {
            uintptr_t entry;
            memcpy(&entry, (const char *)tables[t] + first + i * sizeof entry, sizeof entry);
            assert_true(entry != 0);
        }
    }
}

/* A world without Vulkan, through the table. */
static void the_core_works_through_its_table(void **state)
{
    (void)state;
    ChiaroVulkanGetApi get_api;
    open_plugin(&get_api, sizeof get_api);
    const ChiaroCoreApi *core = get_api(CHIARO_VULKAN_API_VERSION)->core;
    const float rgb[3] = {1, 2, 3}, point[3] = {4, 5, 6}, normal[3] = {0, 1, 0}, pi = 3.14159265f;
    const ChiaroSky sky = {1, 1, rgb};
    ChiaroWorldDesc desc = {.struct_size = sizeof desc, .object_capacity = 1};
    ChiaroWorld *world;
    float irradiance[3];
    assert_int_equal(core->world_create(&desc, &world), CHIARO_OK);
    assert_int_equal(core->world_desc(world)->edge, 4); /* a default, resolved */
    assert_int_equal(core->world_sky(world, &sky), CHIARO_OK);
    core->world_run(world, (ChiaroBudget){0}, 0, NULL, CHIARO_MAX_OBJECT_PARTS);
    assert_int_equal(core->world_irradiance(world, point, 0, normal, irradiance), CHIARO_OK);
    for (int c = 0; c < 3; c++)
        assert_true(fabsf(irradiance[c] - pi * rgb[c]) < 1e-4f);
    core->world_destroy(world);
    ChiaroTransport transport;
    _Alignas(16) static const char nonsense[64] = "nonsense";
    assert_int_equal(core->transport_open(nonsense, sizeof nonsense, &transport, NULL), CHIARO_ERROR_DATA);
    assert_string_equal(core->result_text(CHIARO_ERROR_DATA), chiaro_result_text(CHIARO_ERROR_DATA));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(it_needs_the_c_library_only_and_shows_one_symbol),
        cmocka_unit_test(stripped_it_is_no_larger_than_300_kib),
        cmocka_unit_test(both_sides_check_the_version),
        cmocka_unit_test(every_entry_of_both_tables_is_there),
        cmocka_unit_test(the_core_works_through_its_table),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
