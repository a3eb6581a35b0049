/* A thousand balls. They do not touch, and nothing else is there: what is wrong with their light is the fault of
 * neighbour lists and cubes alone. */
#include "crowd.h"

#include "../../src/core/random.h"
#include "../../src/offline/parallel.h"
#include "../../src/reference/reference.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { ROOM = 32 };

static const float sky_rows[3 * 4] = {0.3f, 0.5f, 1, 0.8f, 0.8f, 0.9f, 0.4f, 0.35f, 0.3f, 0.2f, 0.2f, 0.2f};
const ChiaroSky crowd_sky = {1, 4, sky_rows};
const ChiaroLight crowd_sun = {.type = CHIARO_LIGHT_SUN, .direction = {0.6f, -0.8f, 0}, .intensity = {1, 1, 1}};

static const ChiaroPart *part_of(const Crowd *crowd)
{
    return &crowd->scene.scene.parts[crowd->scene.nodes[1].first_part];
}

static void make_object(const SceneOptions *options, Crowd *crowd)
{
    const char *fault;
    SceneRequest request = {0};
    if (!scenes_make("spheres", &request, &crowd->scene, &fault))
        options_fail(options, CHIARO_EXIT_INPUT, "%s", fault);
    ChiaroScene ball = crowd->scene.scene;
    ChiaroPart part = *part_of(crowd);
    ball.indices += part.first_index, ball.index_count = part.index_count;
    part.first_index = 0;
    ball.parts = &part, ball.part_count = 1;
    ChiaroBakeObjectDesc desc = {.struct_size = sizeof desc, .rays = 16};
    if (chiaro_bake_object(&ball, &desc, &crowd->blob) != CHIARO_OK ||
        chiaro_object_open(crowd->blob.data, crowd->blob.size, &crowd->object, NULL) != CHIARO_OK)
        options_fail(options, CHIARO_EXIT_INPUT, "the object cannot be baked");
    crowd->middle = vec3_load(crowd->object.center);
}

static void place_objects(Crowd *crowd)
{
    ChiaroRandom random = chiaro_random_seed(1, 7);
    for (uint32_t i = 0; i < CROWD_OBJECTS; i++) {
        for (bool clear = false; !clear;) {
            float x = ROOM * chiaro_random_float(&random), y = ROOM * chiaro_random_float(&random);
            crowd->places[i] = vec3(x, y, ROOM * chiaro_random_float(&random));
            clear = true;
            for (uint32_t k = 0; k < i && clear; k++)
                clear = vec3_length(vec3_sub(crowd->places[i], crowd->places[k])) > 2.5f * crowd->object.radius;
        }
    }
}

/* ---- truth -------------------------------------------------------------------------------------------------------- */

/* All objects as one scene, for the path tracer. */
static ChiaroScene whole_scene(const SceneOptions *options, const Crowd *crowd, ChiaroPart *whole_part)
{
    const ChiaroScene *from = &crowd->scene.scene;
    const ChiaroPart *part = part_of(crowd);
    ChiaroScene whole = *from;
    uint32_t corners = part->index_count;
    ChiaroVertex *vertices = calloc((size_t)corners * CROWD_OBJECTS, sizeof *vertices);
    uint32_t *indices = calloc((size_t)corners * CROWD_OBJECTS, sizeof *indices);
    if (!vertices || !indices)
        options_fail(options, CHIARO_EXIT_INPUT, "out of memory");
    for (uint32_t i = 0; i < CROWD_OBJECTS * corners; i++) {
        const ChiaroVertex *vertex = &from->vertices[from->indices[part->first_index + i % corners]];
        vertices[i] = *vertex, indices[i] = i;
        vec3_store(vertices[i].position, vec3_add(vec3_sub(vec3_load(vertex->position), crowd->middle),
                                                  crowd->places[i / corners]));
    }
    *whole_part = (ChiaroPart){0, corners * CROWD_OBJECTS, part->material, CHIARO_NONE};
    whole.vertices = vertices, whole.indices = indices, whole.parts = whole_part;
    whole.vertex_count = whole.index_count = corners * CROWD_OBJECTS, whole.part_count = 1;
    return whole;
}

typedef struct Trace {
    const ChiaroReference *reference;
    const ChiaroVertex *vertices; /* of the whole scene */
    uint32_t corners, paths;
    CrowdProbe *probes;
    uint32_t corner[CROWD_PROBES]; /* of the object, each probe's */
} Trace;

static void trace_probes(uint32_t begin, uint32_t end, uint32_t thread, void *user)
{
    const Trace *trace = user;
    (void)thread;
    for (uint32_t k = begin; k < end; k++) {
        CrowdProbe *probe = &trace->probes[k];
        const ChiaroVertex *vertex = &trace->vertices[probe->object * trace->corners + trace->corner[k]];
        ChiaroReferenceIrradiance truth =
            chiaro_reference_irradiance(trace->reference, vertex->position, vertex->normal, trace->paths, 0, k, 1);
        memcpy(probe->normal, vertex->normal, sizeof probe->normal);
        memcpy(probe->truth, truth.indirect, sizeof probe->truth);
    }
}

static void make_truth(const SceneOptions *options, Crowd *crowd, uint32_t paths)
{
    ChiaroPart part;
    ChiaroScene whole = whole_scene(options, crowd, &part);
    ChiaroReference *reference;
    ChiaroRandom random = chiaro_random_seed(2, 9);
    if (chiaro_reference_create(&whole, &crowd_sun, 1, &crowd_sky, NULL, &reference) != CHIARO_OK)
        options_fail(options, CHIARO_EXIT_INPUT, "out of memory");
    Trace trace = {.reference = reference, .vertices = whole.vertices, .corners = part_of(crowd)->index_count,
                   .paths = paths, .probes = crowd->probes};
    for (uint32_t k = 0; k < CROWD_PROBES; k++) {
        CrowdProbe *probe = &crowd->probes[k];
        probe->object = chiaro_random_bits(&random) % CROWD_OBJECTS;
        trace.corner[k] = chiaro_random_bits(&random) % trace.corners;
        probe->vertex = crowd->scene.scene.indices[part_of(crowd)->first_index + trace.corner[k]];
    }
    chiaro_parallel_for(chiaro_core_count(), CROWD_PROBES, 1, trace_probes, &trace, NULL, NULL);
    chiaro_reference_destroy(reference);
    free((void *)(uintptr_t)whole.vertices);
    free((void *)(uintptr_t)whole.indices);
}

/* ---- the crowd ---------------------------------------------------------------------------------------------------- */

void crowd_open(const SceneOptions *options, uint32_t paths, Crowd *crowd)
{
    make_object(options, crowd);
    place_objects(crowd);
    make_truth(options, crowd, paths);
}

void crowd_close(Crowd *crowd)
{
    chiaro_blob_free(&crowd->blob);
    scenes_free(&crowd->scene);
}

static void place_of(const Crowd *crowd, uint32_t object, Vec3 by, float transform[16])
{
    Vec3 to = vec3_add(vec3_sub(crowd->places[object], crowd->middle), by);
    const float matrix[16] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, to.x, to.y, to.z, 1};
    memcpy(transform, matrix, sizeof matrix);
}

ChiaroWorld *crowd_world(const SceneOptions *options, const Crowd *crowd, const ChiaroWorldDesc *desc)
{
    ChiaroWorldDesc own = *desc;
    ChiaroWorldLight light = {.struct_size = sizeof light, .lights = &crowd_sun, .light_count = 1};
    ChiaroWorld *world;
    own.struct_size = sizeof own, own.object_capacity = CROWD_OBJECTS;
    bool good = chiaro_world_create(&own, &world) == CHIARO_OK && chiaro_world_sky(world, &crowd_sky) == CHIARO_OK &&
                chiaro_world_light(world, &light) == CHIARO_OK;
    for (uint32_t i = 0, id; i < CROWD_OBJECTS && good; i++) {
        float transform[16];
        place_of(crowd, i, vec3(0, 0, 0), transform);
        good = chiaro_object_add(world, &crowd->object, transform, &id) == CHIARO_OK && id == i;
    }
    if (!good)
        options_fail(options, CHIARO_EXIT_INPUT, "out of memory");
    return world;
}

void crowd_move(ChiaroWorld *world, const Crowd *crowd, uint32_t object, Vec3 by)
{
    float transform[16];
    place_of(crowd, object, by, transform);
    chiaro_object_move(world, object, transform);
}

double crowd_error(const SceneOptions *options, const Crowd *crowd, const ChiaroWorld *world)
{
    double wrong = 0, square = 0;
    for (uint32_t k = 0; k < CROWD_PROBES; k++) {
        const CrowdProbe *probe = &crowd->probes[k];
        float light[3];
        if (chiaro_object_irradiance(world, probe->object, probe->vertex, light) != CHIARO_OK)
            options_fail(options, CHIARO_EXIT_INPUT, "an object is missing");
        for (uint32_t c = 0; c < 3; c++) {
            double d = (double)light[c] - probe->truth[c];
            wrong += d * d, square += probe->truth[c] * probe->truth[c];
        }
    }
    return sqrt(wrong / square);
}
