/* Questions to the world: what light there is at any place, and how old everything is. */
#include "versions.h"
#include "world.h"

static bool is_place(const float point[3], float radius)
{
    return radius >= 0 && radius < 1e9f && fabsf(point[0]) <= 1e9f && fabsf(point[1]) <= 1e9f && fabsf(point[2]) <= 1e9f;
}

ChiaroResult chiaro_world_probe(ChiaroWorld *world, const float point[3], float radius, float *texels)
{
    if (!is_place(point, radius))
        return CHIARO_ERROR_ARGUMENT;
    chiaro_world_paint_at(world, vec3_load(point), radius, texels);
    return CHIARO_OK;
}

ChiaroResult chiaro_world_irradiance(ChiaroWorld *world, const float point[3], float radius, const float normal[3],
                                     float irradiance[3])
{
    float texels[4 * CHIARO_CUBE_MAX_TEXELS], value[4];
    if (!(fabsf(vec3_length(vec3_load(normal)) - 1) < 1e-3f))
        return CHIARO_ERROR_ARGUMENT;
    ChiaroResult result = chiaro_world_probe(world, point, radius, texels);
    if (result != CHIARO_OK)
        return result;
    chiaro_cube_look_up(world->kernel, texels, normal, value);
    for (uint32_t c = 0; c < 3; c++)
        irradiance[c] = CHIARO_PI * chiaro_max(value[c], 0);
    return CHIARO_OK;
}

const ChiaroCubeKernel *chiaro_world_cube_kernel(const ChiaroWorld *world) { return world->kernel; }

uint32_t chiaro_object_age(const ChiaroWorld *world, uint32_t id)
{
    if (id >= world->body_end || !world->bodies[id].used || !world->bodies[id].shown)
        return CHIARO_NONE;
    return chiaro_world_settled(world) ? 0 : (uint32_t)(world->updates - world->bodies[id].shown);
}

ChiaroResult chiaro_world_ages(const ChiaroWorld *world, ChiaroWorldAges *ages)
{
    ChiaroWorldAges now = {.object = CHIARO_NONE};
    for (uint32_t id = 0; id < world->body_end; id++) {
        uint32_t age = chiaro_object_age(world, id);
        if (age != CHIARO_NONE && (now.object == CHIARO_NONE || age > now.cubes))
            now.cubes = age, now.object = id;
    }
    now.round = chiaro_world_settled(world) ? 0 : (uint32_t)(world->updates - world->round_began);
    now.light = world->light_comes ? (uint32_t)(world->updates - world->light_came) : 0;
    now.blockers = world->shown_stale ? (uint32_t)(world->updates - world->blockers_stale) : 0;
    return chiaro_give_struct(ages, sizeof now, &now, sizeof now) ? CHIARO_OK : CHIARO_ERROR_ARGUMENT;
}
