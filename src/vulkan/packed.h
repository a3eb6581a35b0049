/* Shaders, packed: words of SPIR-V, each told by what has come before. src/tools/pack_shaders.c writes them, shaders.c
 * reads them; the way is the same, and bits go one way or the other.
 *
 * Variants of a shader repeat each other, but for the numbers of their values. So where the last instructions have been
 * seen before in this order, a word is guessed to be the one that came then; or the one that is as far from the last result
 * as that was from its own. Most are. The others are numbers, or steps from the last result, if these are smaller.
 *
 * Bits are coded by how likely they have become in their context (I. Witten, R. Neal, J. Cleary, "Arithmetic Coding for Data
 * Compression", 1987), which is the instruction and which of its words it is.
 */
#ifndef CHIARO_PACKED_H
#define CHIARO_PACKED_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { PACKED_CONTEXTS = 1 << 16, PACKED_PLACES = 1 << 12, PACKED_MAGIC = 0x07230203, PACKED_HEADER = 5 };

/* A place in the words, counted from 1, and the last result there. */
typedef struct PackedPlace {
    uint32_t next, result;
} PackedPlace;

/* Zero at first. */
typedef struct Packed {
    uint8_t *to;         /* NULL: it reads */
    const uint8_t *from;
    uint32_t low, high, value; /* the bits so far as an interval; reading: where in it */
    uint16_t chances[PACKED_CONTEXTS]; /* of a 1: 12 bits; how often it was asked: 4; 0: never */
    PackedPlace places[PACKED_PLACES]; /* by the last instructions */
} Packed;

static inline uint32_t packed_mix(uint32_t context, uint32_t more)
{
    context = (context ^ more * 0x85ebca6bu) * 0x9e3779b1u;
    return context ^ context >> 15;
}

/* Returns the bit; reading, the one that is given does not count. */
static bool packed_bit(Packed *packed, uint32_t context, bool bit)
{
    enum { ONE = 1 << 12, EVEN = ONE / 2 << 4, LEAST = 16 };
    uint16_t *chance = &packed->chances[(packed_mix(context, 0) >> 8) % PACKED_CONTEXTS];
    uint32_t state = *chance ? *chance : EVEN, likely = state >> 4, asked = state & 15;
    uint32_t middle = packed->low + ((packed->high - packed->low) >> 12) * likely;
    uint32_t haste = asked < 6 ? asked / 2 + 1 : 4; /* the first are believed most */
    if (!packed->to)
        bit = packed->value <= middle;
    if (bit)
        packed->high = middle, likely += (ONE - 1 - likely) >> haste;
    else
        packed->low = middle + 1, likely -= likely >> haste;
    likely = likely < LEAST ? LEAST : likely > ONE - LEAST ? ONE - LEAST : likely;
    *chance = (uint16_t)(likely << 4 | (asked < 15 ? asked + 1 : 15));
    for (; (packed->low ^ packed->high) >> 24 == 0; packed->low <<= 8, packed->high = packed->high << 8 | 255) {
        if (packed->to)
            *packed->to++ = (uint8_t)(packed->high >> 24);
        else
            packed->value = packed->value << 8 | *packed->from++;
    }
    return bit;
}

/* How many bits it has, then these. */
static uint32_t packed_number(Packed *packed, uint32_t context, uint32_t number)
{
    uint32_t bits = 0;
    while (bits < 32 && packed_bit(packed, packed_mix(context, bits + 1), number >> bits != 0))
        bits++;
    uint32_t read = bits > 0;
    for (uint32_t i = bits; i-- > 1;)
        read = read << 1 | packed_bit(packed, packed_mix(packed_mix(context, 64 + bits), read), number >> (i - 1) & 1);
    return read;
}

/* A word that was not guessed. */
static uint32_t packed_word(Packed *packed, uint32_t context, bool steps, uint32_t result, uint32_t word)
{
    enum { STEPS = 3 };
    uint32_t way = result - word, step = way >> 31 ? 2 * ~way + 1 : 2 * way;
    if (!steps || !packed_bit(packed, packed_mix(context, STEPS), step < word))
        return packed_number(packed, packed_mix(context, 1), word);
    step = packed_number(packed, packed_mix(context, 2), step);
    return result - (step & 1 ? ~(step >> 1) : step >> 1);
}

/* Writing, the words are as they shall be. Reading, they become so. */
static void packed_words(Packed *packed, uint32_t *words, uint32_t count)
{
    enum { SAME = 100, MOVED = 200, OPERANDS = 5 };
    uint32_t before[3] = {0}, operand = 0, left = 0, result = 0;
    PackedPlace like = {0};
    packed->high = UINT32_MAX;
    for (uint32_t i = 0; !packed->to && i < 4; i++)
        packed->value = packed->value << 8 | *packed->from++;
    for (uint32_t at = 0; at < count; at++, operand++, left--) {
        if (left == 0) {
            uint32_t key = packed_mix(packed_mix(packed_mix(0, before[0]), before[1]), before[2]);
            PackedPlace *place = &packed->places[(key >> 8) % PACKED_PLACES];
            like = like.next ? like : *place;
            *place = (PackedPlace){at + 1, result};
            operand = 0;
        }
        uint32_t context = packed_mix(before[0], operand < OPERANDS ? operand : OPERANDS);
        uint32_t same = like.next ? words[like.next - 1] : 0, moved = same - like.result + result, word = words[at];
        if (like.next && packed_bit(packed, packed_mix(context, SAME), word == same))
            words[at] = same;
        else if (like.next && operand && moved != same && packed_bit(packed, packed_mix(context, MOVED), word == moved))
            words[at] = moved;
        else
            words[at] = packed_word(packed, context, operand > 0, result, word);
        if (operand == 2) /* of most instructions, it is their result */
            result = words[at], like.result = same;
        if (operand == 0) {
            before[2] = before[1], before[1] = before[0], before[0] = words[at];
            left = words[at] == PACKED_MAGIC ? PACKED_HEADER : words[at] >> 16;
            like.next = words[at] == same ? like.next : 0;
        }
        like.next += like.next > 0;
    }
}

#endif
