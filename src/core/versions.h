/* Structures that grow: a host built against an older header passes fewer bytes; what it does not know is zero. */
#ifndef CHIARO_VERSIONS_H
#define CHIARO_VERSIONS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

/* The size that a type had when `member` was not there yet. */
#define CHIARO_SIZE_BEFORE(type, member) offsetof(type, member)

/* Copies a structure that begins with its uint32_t struct_size, as far as the caller has it; struct_size becomes `size`.
 * False: it is none, or neither of the sizes that it may have: at least `least`, at most `size`. */
static inline bool chiaro_take_struct(void *to, size_t size, const void *from, size_t least)
{
    uint32_t given = 0, whole = (uint32_t)size;
    if (from)
        memcpy(&given, from, sizeof given);
    if (!from || given < least || given > size)
        return false;
    memset(to, 0, size);
    memcpy(to, from, given);
    memcpy(to, &whole, sizeof whole);
    return true;
}

/* The reverse: the caller gets as much as it has room for; its struct_size stays. */
static inline bool chiaro_give_struct(void *to, size_t size, const void *from, size_t least)
{
    uint32_t room = 0;
    if (to)
        memcpy(&room, to, sizeof room);
    if (!to || room < least || room > size)
        return false;
    memcpy((char *)to + sizeof room, (const char *)from + sizeof room, room - sizeof room);
    return true;
}

#endif
