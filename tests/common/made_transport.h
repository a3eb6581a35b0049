/* A transport made by hand: right in form, arbitrary in content. For tests of what runs it, on CPU and GPU. */
#ifndef CHIARO_TEST_MADE_TRANSPORT_H
#define CHIARO_TEST_MADE_TRANSPORT_H

#include "chiaro/chiaro.h"

typedef struct MadeTransportDesc {
    uint32_t mesh_steps;   /* edges of the scene's triangles are cut into so many for drawing */
    uint32_t sample_steps; /* and into so many for samples */
    uint32_t points;       /* of a sample: 1 or 3 */
    uint32_t links;        /* nodes of the smallest block, of both kinds of rows */
    bool sky;              /* with sky leaves */
} MadeTransportDesc;

/* Samples lie on the scene's triangles, receivers are the drawn vertices; nodes are runs of leaves; links go to random
 * nodes with random weights of both signs. `scene` must outlive the transport. */
ChiaroTransport made_transport(const ChiaroScene *scene, const MadeTransportDesc *desc);
void made_transport_free(ChiaroTransport *transport);

#endif
