/* Layout of a baked block: what writes it (the baker) and what reads it (chiaro_transport_open) agree on here.
 *
 * Header, then every array of ChiaroTransport in a fixed order, each on a 64-byte boundary. Offsets follow from the counts.
 * Little-endian; the checksum covers everything after itself.
 */
#ifndef CHIARO_TRANSPORT_H
#define CHIARO_TRANSPORT_H

#include "chiaro/chiaro.h"

#define CHIARO_FILE_MAGIC "CHIARO\r\n"
enum { CHIARO_FILE_VERSION = 2, CHIARO_FILE_ENDIAN = 0x01020304, CHIARO_FILE_ALIGNMENT = 64, CHIARO_FILE_COUNTS = 24 };

typedef struct ChiaroFileHeader {
    char magic[8];
    uint32_t version, endian;
    uint64_t size, checksum;
    uint64_t counts[CHIARO_FILE_COUNTS];
    ChiaroTransportInfo info;
} ChiaroFileHeader;

/* One array of the block: where its pointer lives, and its bytes. */
typedef struct ChiaroFileArray {
    const void **slot;
    uint64_t count;
    size_t stride;
} ChiaroFileArray;

enum { CHIARO_FILE_ARRAYS = 24 };

/* The arrays of a transport, in file order, sized by its counts. */
void chiaro_file_arrays(ChiaroTransport *transport, ChiaroFileArray arrays[CHIARO_FILE_ARRAYS]);

/* The counts of a transport, to and from the header. False: a count does not fit its field. */
void chiaro_file_store_counts(const ChiaroTransport *transport, uint64_t counts[CHIARO_FILE_COUNTS]);
bool chiaro_file_load_counts(ChiaroTransport *transport, const uint64_t counts[CHIARO_FILE_COUNTS]);

/* Offset of the first array, and of what follows an array. */
uint64_t chiaro_file_align(uint64_t offset);

/* Checksum of a block of `size` bytes (a multiple of 8), header included. */
uint64_t chiaro_file_checksum(const void *data, size_t size);


#endif
