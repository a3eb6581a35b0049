/* Chiaro: the core as a table, for hosts that load the plugin and link nothing. Each entry is the function of that name,
 * with chiaro_ before it, documented where it is declared. Appended to at its end only.
 *
 * Reached by ChiaroVulkanApi.core. Hosts that link the library call the functions themselves.
 */
#ifndef CHIARO_CHIARO_CORE_H
#define CHIARO_CHIARO_CORE_H

#include "chiaro_kernel.h"
#include "chiaro_world.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct ChiaroCoreApi {
    uint32_t struct_size; /**< sizeof of the library's table, which may be larger than the caller's. */
    uint32_t reserved;

    uint32_t (*version)(void);
    const char *(*result_text)(ChiaroResult result);
    const char *(*log_item_text)(ChiaroLogItem item);

    ChiaroResult (*scene_check)(const ChiaroScene *scene, const ChiaroLog *log);
    ChiaroResult (*light_check)(const ChiaroLight *light);
    ChiaroResult (*sky_check)(const ChiaroSky *sky);
    void (*sky_radiance)(const ChiaroSky *sky, const float direction[3], float rgb[3]);
    bool (*sky_split)(const ChiaroSky *sky, ChiaroLight *sun, float *radius, float *rest);
    void (*light_at)(const ChiaroLight *light, const float point[3], float toward[3], float *distance, float rgb[3]);

    ChiaroResult (*transport_open)(const void *data, size_t size, ChiaroTransport *transport, const ChiaroLog *log);
    void (*transport_update)(const ChiaroTransport *transport, const ChiaroLight *lights, uint32_t light_count,
                             const ChiaroSky *sky, ChiaroVisibleFunc visible, void *user, float *scratch,
                             float *irradiance);

    ChiaroResult (*object_open)(const void *data, size_t size, ChiaroObject *object, const ChiaroLog *log);
    ChiaroResult (*world_create)(const ChiaroWorldDesc *desc, ChiaroWorld **world);
    void (*world_destroy)(ChiaroWorld *world);
    const ChiaroWorldDesc *(*world_desc)(const ChiaroWorld *world);
    ChiaroResult (*world_sky)(ChiaroWorld *world, const ChiaroSky *sky);
    ChiaroResult (*world_light)(ChiaroWorld *world, const ChiaroWorldLight *light);
    ChiaroResult (*object_add)(ChiaroWorld *world, const ChiaroObject *object, const float transform[16], uint32_t *id);
    ChiaroResult (*object_move)(ChiaroWorld *world, uint32_t id, const float transform[16]);
    ChiaroResult (*object_remove)(ChiaroWorld *world, uint32_t id);
    bool (*object_state)(const ChiaroWorld *world, uint32_t id, ChiaroObjectState *state);
    void (*world_eye)(ChiaroWorld *world, const float eye[3], const float forward[3]);
    uint32_t (*world_run)(ChiaroWorld *world, ChiaroBudget budget, uint32_t spent, uint32_t *painted, uint32_t capacity);
    uint32_t (*world_update)(ChiaroWorld *world, uint32_t budget, uint32_t *painted);
    bool (*world_settled)(const ChiaroWorld *world);
    const ChiaroKernel *(*world_kernel)(const ChiaroWorld *world);
    bool (*world_cube)(const ChiaroWorld *world, uint32_t slot, ChiaroWorldCube *cube);

    ChiaroResult (*object_irradiance)(const ChiaroWorld *world, uint32_t id, uint32_t vertex, float irradiance[3]);
    ChiaroResult (*world_irradiance)(ChiaroWorld *world, const float point[3], float radius, const float normal[3],
                                     float irradiance[3]);
    ChiaroResult (*world_probe)(ChiaroWorld *world, const float point[3], float radius, float *texels);
    const ChiaroCubeKernel *(*world_cube_kernel)(const ChiaroWorld *world);
    void (*cube_look_up)(const ChiaroCubeKernel *kernel, const float *texels, const float direction[3], float value[4]);
    ChiaroResult (*world_ages)(const ChiaroWorld *world, ChiaroWorldAges *ages);
    uint32_t (*object_age)(const ChiaroWorld *world, uint32_t id);
    const ChiaroNeighbours *(*world_neighbours)(const ChiaroWorld *world);
    const ChiaroNeighbour *(*neighbours_list)(const ChiaroNeighbours *neighbours, uint32_t kind, uint32_t object,
                                              uint32_t *count);

    size_t (*kernel_size)(const ChiaroKernelDesc *desc);
    ChiaroResult (*kernel_init)(const ChiaroKernelDesc *desc, void *memory, size_t size, ChiaroKernel **kernel);
    ChiaroResult (*kernel_due)(ChiaroKernel *kernel, uint32_t item, uint32_t kind, float urgency, uint32_t cost,
                               uint32_t slice);
    void (*kernel_drop)(ChiaroKernel *kernel, uint32_t item);
    uint32_t (*kernel_age)(const ChiaroKernel *kernel, uint32_t item);
    void (*kernel_begin)(ChiaroKernel *kernel, ChiaroBudget budget, uint32_t spent);
    uint32_t (*kernel_next)(ChiaroKernel *kernel, uint32_t *units);
    ChiaroResult (*kernel_stats)(const ChiaroKernel *kernel, ChiaroKernelStats *stats);

    ChiaroResult (*transport_origin)(const void *data, size_t size, double origin[3]);
} ChiaroCoreApi;

#ifdef __cplusplus
}
#endif

#endif
