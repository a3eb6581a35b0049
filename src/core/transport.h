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

/* What every block begins with. */
typedef struct ChiaroFileStart {
    char magic[8];
    uint32_t version, endian;
    uint64_t size, checksum;
} ChiaroFileStart;

typedef struct ChiaroFileHeader {
    ChiaroFileStart start;
    uint64_t counts[CHIARO_FILE_COUNTS];
    ChiaroTransportInfo info;
    double origin[3];
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

/* Is this a whole and undamaged block of this kind, with a header of so many bytes? The log says what is wrong. */
ChiaroResult chiaro_file_check(const void *data, size_t size, const char *magic, uint32_t version, size_t header,
                               const ChiaroLog *log);

/* Points the slots of the arrays into a block. False: they do not fill it exactly. */
bool chiaro_file_place(const void *data, size_t size, size_t header, const ChiaroFileArray *arrays, uint32_t count);

/* Logs what is wrong with a block; returns false. */
bool chiaro_file_fault(const ChiaroLog *log, const char *format, ...) __attribute__((format(printf, 2, 3)));

bool chiaro_file_finite(const float *values, size_t count);

#endif
