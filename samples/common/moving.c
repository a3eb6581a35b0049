/* Baking and placing what moves. */
#include "moving.h"

#include "../../src/core/lanes.h"
#include "../../src/offline/parallel.h"
#include "baked.h"
#include "picture.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

/* What is longer than so many patches of the scene gets more than one cube: the light around it is not the same at both
 * ends. In cornell it halves the error on a box of a metre. */
#define PART_PATCHES 3

/* Shadow rays start so many radii above a surface. */
#define START 1e-3f

/* The spheres of four objects; where there are fewer, the rest are too far away to be met. */
typedef struct MovingSpheres {
    Lanes x, y, z, radius;
} MovingSpheres;

/* A ray in an object's own space. Poses turn, scale evenly and move. */
typedef struct OwnRay {
    Vec3 start, way;
    float size; /* of one of its metres, in the world */
} OwnRay;

/* The first object from a number on whose sphere the ray meets; as many as there are: none. Most do not, so this is asked
 * apart, of four at a time. */
static uint32_t next_near(const Moving *moving, uint32_t first, Vec3 from, Vec3 way, float end)
{
    uint32_t count = moving->objects.count;
    for (uint32_t group = first / LANES; group * LANES < count; group++) {
        const MovingSpheres *spheres = &moving->spheres[group];
        Lanes x = spheres->x - from.x, y = spheres->y - from.y, z = spheres->z - from.z;
        Lanes along = lanes_max(lanes_of(0), lanes_min(lanes_of(end), x * way.x + y * way.y + z * way.z));
        x -= along * way.x, y -= along * way.y, z -= along * way.z;
        LaneMask met = x * x + y * y + z * z <= spheres->radius * spheres->radius;
        for (uint32_t lane = 0; lanes_any(met) && lane < LANES; lane++) {
            if (met[lane] && group * LANES + lane >= first)
                return group * LANES + lane;
        }
    }
    return count;
}

static OwnRay own_ray(const MovingPose *pose, Vec3 from, Vec3 way)
{
    const float *m = pose->transform;
    Vec3 x = vec3_load(m), y = vec3_load(m + 4), z = vec3_load(m + 8), start = vec3_sub(from, vec3_load(m + 12));
    float size = vec3_length(x), shrink = 1 / vec3_dot(x, x);
    return (OwnRay){
        .start = vec3_scale(vec3(vec3_dot(x, start), vec3_dot(y, start), vec3_dot(z, start)), shrink),
        .way = vec3_scale(vec3(vec3_dot(x, way), vec3_dot(y, way), vec3_dot(z, way)), 1 / size),
        .size = size};
}

/* True if the object is in the way. */
static bool blocks(const ChiaroRays *rays, const MovingPose *pose, Vec3 from, Vec3 way, float end)
{
    OwnRay own = own_ray(pose, from, way);
    return chiaro_rays_blocked(rays, own.start, own.way, 0, end / own.size);
}

static bool sees_light(const ChiaroLight *light, const float point[3], const float normal[3], void *user)
{
    const Moving *moving = user;
    float toward[3], distance, rgb[3];
    Vec3 p = vec3_load(point), n = vec3_load(normal);
    if (!chiaro_rays_light_visible(moving->rays, light, p, n))
        return false;
    chiaro_light_at(light, point, toward, &distance, rgb);
    uint32_t count = moving->objects.count;
    for (uint32_t i = 0; (i = next_near(moving, i, p, vec3_load(toward), distance)) < count; i++) {
        /* An element of a round thing lies a little within it. */
        Vec3 start = vec3_mad(p, n, START * moving->poses[i].radius);
        if (blocks(moving->own[i], &moving->poses[i], start, vec3_load(toward), distance))
            return false;
    }
    return true;
}

static void must(const SceneOptions *options, const char *name, ChiaroResult result)
{
    if (result != CHIARO_OK)
        options_fail(options, CHIARO_EXIT_INPUT, "%s: object '%s': %s", options->input, name,
                     chiaro_result_text(result));
}

static double now(void)
{
    struct timespec time;
    clock_gettime(CLOCK_MONOTONIC, &time);
    return (double)time.tv_sec + 1e-9 * (double)time.tv_nsec;
}

/* From the cache, or baked and kept there. */
static void bake_object(const SceneOptions *options, const SceneObject *object, Moving *moving, uint32_t number)
{
    const ChiaroBakeObjectDesc desc = {.struct_size = sizeof desc,
                                       .elements = moving->desc.elements,
                                       .part_size = moving->part_size,
                                       .threads = moving->desc.threads,
                                       .seed = moving->desc.seed};
    BakeKey key = {"object", {desc.elements, desc.parts, desc.rays, desc.seed}};
    memcpy(&key.settings[4], &desc.part_size, sizeof desc.part_size);
    ChiaroBlob *blob = &moving->blobs[number];
    ChiaroIoFile *file = &moving->files[number];
    ChiaroObject *baked = &moving->baked[number];
    ChiaroIoError error;
    char path[BAKED_PATH_SIZE];
    bool cache = baked_cache_path(object->scene, &key, path);
    if (cache && chiaro_io_map(path, file, &error)) {
        if (chiaro_object_open(file->data, file->size, baked, NULL) == CHIARO_OK)
            return;
        chiaro_io_unmap(file);
        *file = (ChiaroIoFile){0};
    }
    must(options, object->name, chiaro_bake_object(object->scene, &desc, blob));
    must(options, object->name, chiaro_object_open(blob->data, blob->size, baked, NULL));
    if (cache && !chiaro_io_write_file(path, blob->data, blob->size, &error) && !options->quiet)
        fprintf(stderr, "%s: %s\n", options->program, error.message);
}

static void bake_objects(const SceneOptions *options, Moving *moving)
{
    double start = now();
    for (uint32_t i = 0; i < moving->objects.count; i++) {
        const SceneObject *object = &moving->objects.list[i];
        bake_object(options, object, moving, i);
        must(options, object->name, chiaro_rays_create(object->scene, NULL, &moving->own[i]));
    }
    moving->seconds = now() - start;
}

static const MovingPose *take_pose(Moving *moving, uint32_t number, double time, float radius, float turn)
{
    MovingPose *pose = &moving->poses[number];
    const ChiaroObject *object = &moving->baked[number];
    float *m = pose->transform;
    objects_transform(&moving->objects, number, time, m);
    m[12] += radius * cosf(turn + (float)number);
    m[14] += radius * sinf(turn + (float)number);
    Vec3 center = vec3_mad(vec3_load(m + 12), vec3_load(m), object->center[0]);
    pose->center = vec3_mad(vec3_mad(center, vec3_load(m + 4), object->center[1]), vec3_load(m + 8), object->center[2]);
    pose->radius = object->radius * vec3_length(vec3_load(m));
    MovingSpheres *spheres = &moving->spheres[number / LANES];
    spheres->x[number % LANES] = pose->center.x, spheres->y[number % LANES] = pose->center.y;
    spheres->z[number % LANES] = pose->center.z, spheres->radius[number % LANES] = pose->radius;
    return pose;
}

typedef struct Job {
    void (*work)(uint32_t index, void *data);
    void *data;
} Job;

static void run_jobs(uint32_t begin, uint32_t end, uint32_t thread, void *user)
{
    const Job *job = user;
    (void)thread;
    for (uint32_t i = begin; i < end; i++)
        job->work(i, job->data);
}

static void share_work(uint32_t count, void (*work)(uint32_t index, void *data), void *data, void *user)
{
    const Moving *moving = user;
    Job job = {work, data};
    chiaro_parallel_for(moving->desc.threads, count, 1, run_jobs, &job, NULL, NULL);
}

static void create_world(const SceneOptions *options, const ChiaroTransport *transport, Moving *moving)
{
    ChiaroWorldDesc desc = {.struct_size = sizeof desc,
                            .object_capacity = moving->objects.count,
                            .edge = moving->desc.edge,
                            .format = moving->desc.format,
                            .neighbours = moving->desc.neighbours,
                            .seed = moving->desc.seed,
                            .transport = transport,
                            .clock = moving->desc.clock};
    if (!desc.clock.now) /* what is timed stays on its thread */
        desc.jobs = (ChiaroJobs){share_work, moving};
    for (uint32_t i = 0; i < moving->objects.count; i++) {
        desc.cube_capacity += moving->baked[i].part_count;
        desc.element_capacity += moving->baked[i].element_count;
    }
    must(options, "all", chiaro_world_create(&desc, &moving->world));
    for (uint32_t i = 0; i < moving->objects.count; i++) {
        const SceneObject *object = &moving->objects.list[i];
        const MovingPose *pose = take_pose(moving, i, (double)options->time, 0, 0);
        must(options, object->name,
             chiaro_object_add(moving->world, &moving->baked[i], pose->transform, &moving->ids[i]));
    }
}

static MovingSpheres *make_spheres(size_t count)
{
    size_t groups = (count + LANES - 1) / LANES;
    MovingSpheres *spheres = aligned_alloc(_Alignof(MovingSpheres), groups * sizeof *spheres);
    for (size_t i = 0; spheres && i < groups; i++)
        spheres[i] = (MovingSpheres){.x = lanes_of(INFINITY)};
    return spheres;
}

void moving_open(const SceneOptions *options, const ChiaroIoScene *file, const ChiaroTransport *transport,
                 const MovingDesc *desc, Moving *moving)
{
    *moving = (Moving){.desc = *desc};
    objects_open(options, file, &moving->objects);
    size_t count = moving->objects.count;
    if (count == 0)
        return;
    const ChiaroScene *still = file->object_count > 0 ? &file->scene : &transport->scene;
    const ChiaroScene shared = {.materials = still->materials,
                                .textures = still->textures,
                                .pixels = still->pixels,
                                .pixel_bytes = still->pixel_bytes,
                                .material_count = still->material_count,
                                .texture_count = still->texture_count};
    moving->blobs = calloc(count, sizeof *moving->blobs);
    moving->baked = calloc(count, sizeof *moving->baked);
    moving->ids = calloc(count, sizeof *moving->ids);
    moving->files = calloc(count, sizeof *moving->files);
    moving->own = calloc(count, sizeof *moving->own);
    moving->poses = calloc(count, sizeof *moving->poses);
    moving->spheres = make_spheres(count);
    if (!moving->blobs || !moving->files || !moving->baked || !moving->ids || !moving->own || !moving->poses ||
        !moving->spheres || !objects_merge(&moving->objects, &shared, NULL, &moving->meshes))
        options_fail(options, CHIARO_EXIT_INPUT, "out of memory");
    must(options, "all", chiaro_rays_create(&transport->scene, NULL, &moving->rays));
    moving->part_size = PART_PATCHES * transport->info.patch_size;
    bake_objects(options, moving);
    create_world(options, transport, moving);
}

void moving_close(Moving *moving)
{
    chiaro_world_destroy(moving->world);
    if (moving->rays)
        chiaro_rays_destroy(moving->rays);
    for (uint32_t i = 0; moving->blobs && i < moving->objects.count; i++) {
        chiaro_blob_free(&moving->blobs[i]);
        if (moving->files[i].data)
            chiaro_io_unmap(&moving->files[i]);
        if (moving->own[i])
            chiaro_rays_destroy(moving->own[i]);
    }
    free(moving->files);
    free(moving->own);
    free(moving->poses);
    free(moving->spheres);
    free(moving->blobs);
    free(moving->baked);
    free(moving->ids);
    objects_free_merged(&moving->meshes);
    objects_close(&moving->objects);
    *moving = (Moving){0};
}

ChiaroResult moving_load(Moving *moving, const ChiaroVulkanApi *api, ChiaroVulkan *chiaro, VkCommandBuffer commands,
                         uint64_t frame)
{
    uint32_t count = moving->objects.count, part = 0, vertex = 0;
    ChiaroVulkanMesh *meshes = calloc((size_t)count + 1, sizeof *meshes);
    if (!meshes)
        return CHIARO_ERROR_MEMORY;
    for (uint32_t i = 0; i < count; i++) {
        const ChiaroScene *scene = moving->objects.list[i].scene;
        meshes[i] = (ChiaroVulkanMesh){
            .first_part = part, .part_count = scene->part_count, .first_vertex = vertex, .object = &moving->baked[i]};
        part += scene->part_count;
        vertex += scene->vertex_count;
    }
    const ChiaroVulkanObjects objects = {.struct_size = sizeof objects,
                                         .mesh_count = count,
                                         .meshes = meshes,
                                         .scene = &moving->meshes.scene,
                                         .world = moving->world,
                                         .visible = sees_light,
                                         .user = moving,
                                         .cubes = moving->desc.cubes,
                                         .command_buffer = commands,
                                         .frame = frame};
    ChiaroResult result = api->objects_load(chiaro, &objects);
    free(meshes);
    for (uint32_t i = 0; i < count && result == CHIARO_OK; i++)
        result = api->object_show(chiaro, moving->ids[i], i);
    return result;
}

void moving_pose(const SceneOptions *options, Moving *moving, double time, float radius, float turn)
{
    for (uint32_t i = 0; i < moving->objects.count; i++) {
        const MovingPose *pose = take_pose(moving, i, time, radius, turn);
        must(options, moving->objects.list[i].name,
             chiaro_object_move(moving->world, moving->ids[i], pose->transform));
    }
}

uint32_t moving_pick(const Moving *moving, Vec3 from, Vec3 way, float *distance)
{
    uint32_t nearest = CHIARO_NONE;
    ChiaroHit hit;
    *distance = INFINITY;
    if (moving->rays && picture_hit(moving->rays, from, way, INFINITY, &hit))
        *distance = hit.distance;
    for (uint32_t i = 0; (i = next_near(moving, i, from, way, *distance)) < moving->objects.count; i++) {
        OwnRay own = own_ray(&moving->poses[i], from, way);
        if (!picture_hit(moving->own[i], own.start, own.way, *distance / own.size, &hit))
            continue;
        *distance = hit.distance * own.size;
        nearest = i;
    }
    return nearest;
}

void moving_place(Moving *moving, uint32_t number, Vec3 place)
{
    SceneObject *object = &moving->objects.list[number];
    memcpy(object->transform, moving->poses[number].transform, sizeof object->transform);
    vec3_store(object->transform + 12, place);
    object->placed = true;
}
