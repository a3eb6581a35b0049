/* Packs compiled shaders into one C header: pack_shaders OUT.h A.spv B.spv ... How is told by packed.h. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "../vulkan/packed.h"

enum { MOST_WORDS = 1 << 20 };

typedef struct Packer {
    Packed packed;
    uint32_t words[MOST_WORDS], count;
    uint8_t bytes[8 * MOST_WORDS];
} Packer;

static void fail(const char *file, const char *what)
{
    fprintf(stderr, "pack_shaders: %s: %s\n", file, what);
    exit(1);
}

/* build/spirv/forward.frag.spv: forward_frag. */
static void print_name(FILE *out, const char *path)
{
    const char *name = strrchr(path, '/');
    name = name ? name + 1 : path;
    for (size_t length = strlen(name) - strlen(".spv"), i = 0; i < length; i++)
        fputc(name[i] == '.' ? '_' : name[i], out);
}

static void read_words(Packer *packer, const char *path)
{
    FILE *file = fopen(path, "rb");
    if (!file)
        fail(path, "cannot be read");
    packer->count += (uint32_t)fread(packer->words + packer->count, 4, MOST_WORDS - packer->count, file);
    if (!feof(file) || fclose(file) != 0)
        fail(path, "cannot be read, or too long");
}

int main(int argc, char **argv)
{
    Packer *packer = calloc(1, sizeof *packer);
    FILE *out = argc > 2 ? fopen(argv[1], "w") : NULL;
    if (!packer || !out)
        fail(argc > 1 ? argv[1] : "usage", "pack_shaders OUT.h A.spv ...");
    fprintf(out, "enum {\n");
    for (int i = 2; i < argc; i++) {
        fprintf(out, "    SHADER_");
        print_name(out, argv[i]);
        fprintf(out, ",\n");
    }
    fprintf(out, "    SHADER_COUNT\n};\n\n#ifdef CHIARO_PACKED_SHADERS\n"
                 "/* Where, in words, each begins. */\nstatic const uint32_t shader_first[SHADER_COUNT + 1] = {0");
    for (int i = 2; i < argc; i++) {
        read_words(packer, argv[i]);
        fprintf(out, ", %u", packer->count);
    }
    packer->packed.to = packer->bytes;
    packed_words(&packer->packed, packer->words, packer->count);
    for (uint32_t i = 0; i < 4; i++)
        *packer->packed.to++ = (uint8_t)(packer->packed.low >> (24 - 8 * i));
    fprintf(out, "};\nstatic const uint8_t shader_bytes[] = {");
    for (const uint8_t *byte = packer->bytes; byte < packer->packed.to; byte++)
        fprintf(out, "%s%u,", (byte - packer->bytes) % 24 ? "" : "\n    ", *byte);
    fprintf(out, "\n};\n#endif\n");
    if (fclose(out) != 0)
        fail(argv[1], "cannot be written");
    free(packer);
    return 0;
}
