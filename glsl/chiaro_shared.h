/* Constants and arithmetic shared by C and GLSL. Both include this file; nothing here may be written twice. */
#ifndef CHIARO_SHARED_H
#define CHIARO_SHARED_H

/* Rows of links are stored in blocks of 64 rows, link by link, so that neighbouring invocations read neighbouring words:
 * word of link k of row r in a table of K links a row. A table is padded to whole blocks. */
#define CHIARO_LINK_BLOCK 64u
#define CHIARO_LINK_INDEX(r, k, K)                                                                                     \
    (((r) / CHIARO_LINK_BLOCK) * CHIARO_LINK_BLOCK * (K) + (k) * CHIARO_LINK_BLOCK + (r) % CHIARO_LINK_BLOCK)

/* Receiver link: node in the low bits, weight in the high bits as a signed fixed-point number, times the row's scale. */
#define CHIARO_LINK_NODE_BITS 18
#define CHIARO_LINK_NODE_MASK 0x3ffffu
#define CHIARO_LINK_WEIGHT_MAX 8191 /* 14 bits, signed */

/* Sample link: node and red as above in the first word, green (low) and blue (high) as signed 16 bits in the second. */
#define CHIARO_LINK_GREEN_BLUE_MAX 32767

/* Nodes are summed in two passes: those of at most this many leaves from their leaves, the larger ones from those. */
#define CHIARO_SMALL_NODE 64u

#endif
