/* Packs compiled shaders into one C header: pack_shaders OUT.h A.spv B.spv ...
 *
 * The variants of a shader repeat each other, so all are packed as one text of words (LZ77: J. Ziv, A. Lempel, "A Universal
 * Algorithm for Sequential Data Compression", 1977). A token is a number: 2 n says that n words follow, 2 n + 1 that n words
 * are copied from as far back as the next number says. Numbers have seven bits a byte, the lowest first, the eighth bit set
 * if more follow. src/vulkan/shaders.c reads it.
 */
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { MOST_WORDS = 1 << 20, HASHES = 1 << 16, LOOKS = 256 };

typedef struct Packer {
    uint32_t words[MOST_WORDS], count;
    uint32_t newest[HASHES], older[MOST_WORDS]; /* places of pairs of words with a hash, counted from 1 */
    uint8_t bytes[5 * MOST_WORDS];
    size_t size;
} Packer;

static void fail(const char *file, const char *what)
{
    fprintf(stderr, "pack_shaders: %s: %s\n", file, what);
    exit(1);
}

static uint32_t bytes_of(uint32_t number)
{
    uint32_t bytes = 1;
    while (number >>= 7)
        bytes++;
    return bytes;
}

static void put(Packer *packer, uint32_t number)
{
    for (; number >= 128; number >>= 7)
        packer->bytes[packer->size++] = (uint8_t)(number | 128);
    packer->bytes[packer->size++] = (uint8_t)number;
}

static uint32_t hash(const uint32_t *words) { return (words[0] * 0x9e3779b1u ^ words[1] * 0x85ebca6bu) >> 16; }

/* The run before `at` that saves most bytes; its length, or 0. */
static uint32_t find_run(const Packer *packer, uint32_t at, uint32_t *back)
{
    int32_t best = 0;
    uint32_t length = 0;
    if (at + 1 >= packer->count)
        return 0;
    uint32_t place = packer->newest[hash(packer->words + at)];
    for (uint32_t look = 0; place && look < LOOKS; look++, place = packer->older[place - 1]) {
        uint32_t from = place - 1, n = 0, plain = 0;
        for (; at + n < packer->count && packer->words[from + n] == packer->words[at + n]; n++)
            plain += bytes_of(packer->words[at + n]);
        int32_t saved = (int32_t)plain - (int32_t)(bytes_of(2 * n + 1) + bytes_of(at - from));
        if (saved > best)
            best = saved, length = n, *back = at - from;
    }
    return length;
}

static void put_plain(Packer *packer, uint32_t first, uint32_t end)
{
    if (first == end)
        return;
    put(packer, 2 * (end - first));
    for (uint32_t i = first; i < end; i++)
        put(packer, packer->words[i]);
}

static void pack(Packer *packer)
{
    uint32_t plain = 0;
    for (uint32_t at = 0, step; at < packer->count; at += step) {
        uint32_t back = 0, run = find_run(packer, at, &back);
        step = run ? run : 1;
        if (run) {
            put_plain(packer, plain, at);
            put(packer, 2 * run + 1);
            put(packer, back);
            plain = at + run;
        }
        for (uint32_t i = at; i < at + step && i + 1 < packer->count; i++) {
            uint32_t *newest = &packer->newest[hash(packer->words + i)];
            packer->older[i] = *newest;
            *newest = i + 1;
        }
    }
    put_plain(packer, plain, packer->count);
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
    pack(packer);
    fprintf(out, "};\nstatic const uint8_t shader_bytes[] = {");
    for (size_t i = 0; i < packer->size; i++)
        fprintf(out, "%s%u,", i % 24 ? "" : "\n    ", packer->bytes[i]);
    fprintf(out, "\n};\n#endif\n");
    if (fclose(out) != 0)
        fail(argv[1], "cannot be written");
    free(packer);
    return 0;
}
