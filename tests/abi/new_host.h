/* A host of today, for the test of an old one: compiled apart, because the headers exclude each other. */
#ifndef CHIARO_TEST_NEW_HOST_H
#define CHIARO_TEST_NEW_HOST_H

#include <stddef.h>
#include <stdint.h>

#include "chiaro/chiaro.h"

uint32_t new_host_version(void);
size_t new_host_table_size(void);
size_t new_host_desc_size(void);

/* The picture of test_old_host.c, `size` pixels across. `host`: a Host; `api`: a ChiaroVulkanApi. Ends the program if a
 * step fails. */
struct Host;
void new_host_render(struct Host *host, const void *api, const ChiaroTransport *transport, uint32_t size, float *picture);

#endif
