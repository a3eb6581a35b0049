/* Rays against a scene, by Embree. Of two twins (the sides of one sheet) only the first goes into the acceleration
 * structure: which side a ray meets follows from its direction, so coincident triangles never compete. */
#include "rays.h"

#include "../core/log.h"

#if CHIARO_EMBREE == 4
#include <embree4/rtcore.h>
#else
#include <embree3/rtcore.h>
#endif
#include <stdlib.h>

struct ChiaroRays {
    const ChiaroScene *scene;
    RTCDevice device;
    RTCScene accelerator;
    uint32_t *triangles; /* of each primitive: index / 3 into scene->indices */
    uint32_t *parts;     /* of each primitive */
    float epsilon;
};

/* A point on one side of a primitive. */
typedef struct Side {
    uint32_t part, triangle;
    float u, v;
} Side;

static Vec3 corner(const ChiaroScene *scene, uint32_t triangle, uint32_t number)
{
    return vec3_load(scene->vertices[scene->indices[triangle * 3 + number]].position);
}

static bool same_place(Vec3 a, Vec3 b) { return a.x == b.x && a.y == b.y && a.z == b.z; }

/* Unit normal by doubles: edges of any length, from micrometres to light years, must not under- or overflow. */
static Vec3 geometric_normal(const ChiaroScene *scene, uint32_t triangle)
{
    Vec3 a = corner(scene, triangle, 0), e = vec3_sub(corner(scene, triangle, 1), a);
    Vec3 f = vec3_sub(corner(scene, triangle, 2), a);
    double x = (double)e.y * f.z - (double)e.z * f.y, y = (double)e.z * f.x - (double)e.x * f.z;
    double z = (double)e.x * f.y - (double)e.y * f.x, length = sqrt(x * x + y * y + z * z);
    if (!(length > 0))
        return vec3(0, 0, 0);
    return vec3((float)(x / length), (float)(y / length), (float)(z / length));
}

/* The same point on the twin, whose corners stand in another order. */
static Side twin_of(const ChiaroScene *scene, Side side)
{
    const ChiaroPart *part = &scene->parts[side.part], *twin = &scene->parts[part->twin];
    uint32_t triangle = twin->first_index / 3 + (side.triangle - part->first_index / 3);
    float weights[3] = {1 - side.u - side.v, side.u, side.v}, moved[3] = {0, side.u, side.v};
    for (uint32_t i = 1; i < 3; i++) {
        Vec3 here = corner(scene, triangle, i);
        for (uint32_t j = 0; j < 3; j++) {
            if (same_place(here, corner(scene, side.triangle, j)))
                moved[i] = weights[j];
        }
    }
    return (Side){part->twin, triangle, moved[1], moved[2]};
}

/* Embree's filter: refuses hits in the holes of masked materials. Rays come one at a time here, and for one ray Embree
 * promises the layout of RTCRay and RTCHit. */
static void see_through_holes(const struct RTCFilterFunctionNArguments *arguments)
{
    const ChiaroRays *rays = arguments->geometryUserPtr;
    const struct RTCRay *ray = (const struct RTCRay *)arguments->ray;
    const struct RTCHit *hit = (const struct RTCHit *)arguments->hit;
    Side side = {rays->parts[hit->primID], rays->triangles[hit->primID], hit->u, hit->v};
    Vec3 direction = vec3(ray->dir_x, ray->dir_y, ray->dir_z);
    bool behind = vec3_dot(geometric_normal(rays->scene, side.triangle), direction) > 0;
    if (behind && rays->scene->parts[side.part].twin != CHIARO_NONE)
        side = twin_of(rays->scene, side);
    float cutoff = rays->scene->materials[rays->scene->parts[side.part].material].alpha_cutoff, albedo[3], emission[3];
    if (cutoff > 0 && chiaro_surface(rays->scene, side.part, side.triangle, side.u, side.v, albedo, emission) < cutoff)
        arguments->valid[0] = 0;
}

/* Primitives of a part: none if its twin stands before it. */
static uint32_t primitives_of(const ChiaroScene *scene, uint32_t part)
{
    uint32_t twin = scene->parts[part].twin;
    return twin != CHIARO_NONE && twin < part ? 0 : scene->parts[part].index_count / 3;
}

static float resolve_epsilon(const ChiaroScene *scene)
{
    Vec3 low = vec3(INFINITY, INFINITY, INFINITY), high = vec3(-INFINITY, -INFINITY, -INFINITY);
    for (uint32_t i = 0; i < scene->index_count; i++) {
        Vec3 p = vec3_load(scene->vertices[scene->indices[i]].position);
        low = vec3(fminf(low.x, p.x), fminf(low.y, p.y), fminf(low.z, p.z));
        high = vec3(fmaxf(high.x, p.x), fmaxf(high.y, p.y), fmaxf(high.z, p.z));
    }
    float far = fmaxf(fmaxf(vec3_max(high), -low.x), fmaxf(-low.y, -low.z));
    /* The first is what a scene of ordinary place and size needs; far from the origin, some steps of a float. */
    return fmaxf(1e-5f * vec3_length(vec3_sub(high, low)), 1e-6f * far);
}

static bool build_geometry(ChiaroRays *rays)
{
    const ChiaroScene *scene = rays->scene;
    uint32_t count = 0;
    bool masked = false;
    for (uint32_t i = 0; i < scene->part_count; i++) {
        count += primitives_of(scene, i);
        masked |= scene->materials[scene->parts[i].material].alpha_cutoff > 0;
    }
    RTCGeometry geometry = rtcNewGeometry(rays->device, RTC_GEOMETRY_TYPE_TRIANGLE);
    if (!geometry)
        return false;
    rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, scene->vertices,
                               offsetof(ChiaroVertex, position), sizeof(ChiaroVertex), scene->vertex_count);
    uint32_t *indices = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                                3 * sizeof(uint32_t), count);
    rays->triangles = malloc((size_t)count * sizeof(uint32_t));
    rays->parts = malloc((size_t)count * sizeof(uint32_t));
    bool good = indices && rays->triangles && rays->parts;
    uint32_t n = 0;
    for (uint32_t i = 0; good && i < scene->part_count; i++) {
        uint32_t first = scene->parts[i].first_index / 3;
        for (uint32_t j = 0, end = primitives_of(scene, i); j < end; j++, n++) {
            rays->parts[n] = i, rays->triangles[n] = first + j;
            for (uint32_t k = 0; k < 3; k++)
                indices[n * 3 + k] = scene->indices[(first + j) * 3 + k];
        }
    }
    if (masked) {
        rtcSetGeometryUserData(geometry, rays);
        rtcSetGeometryIntersectFilterFunction(geometry, see_through_holes);
        rtcSetGeometryOccludedFilterFunction(geometry, see_through_holes);
    }
    if (good) {
        rtcCommitGeometry(geometry);
        rtcAttachGeometry(rays->accelerator, geometry);
        rtcCommitScene(rays->accelerator);
    }
    rtcReleaseGeometry(geometry);
    return good && rtcGetDeviceError(rays->device) == RTC_ERROR_NONE;
}

ChiaroResult chiaro_rays_create(const ChiaroScene *scene, const ChiaroLog *log, ChiaroRays **out)
{
    *out = NULL;
    ChiaroResult result = chiaro_scene_check(scene, log);
    if (result != CHIARO_OK)
        return result;
    ChiaroRays *rays = calloc(1, sizeof *rays);
    if (rays) {
        rays->scene = scene;
        rays->epsilon = resolve_epsilon(scene);
        /* One thread builds, so that the tree, and with it the answer for a ray through a shared edge, is always the
         * same. */
        rays->device = rtcNewDevice("threads=1,set_affinity=0");
        rays->accelerator = rays->device ? rtcNewScene(rays->device) : NULL;
    }
    if (rays && rays->accelerator) {
        rtcSetSceneFlags(rays->accelerator, RTC_SCENE_FLAG_ROBUST);
        rtcSetSceneBuildQuality(rays->accelerator, RTC_BUILD_QUALITY_HIGH);
    }
    if (!rays || !rays->accelerator || !build_geometry(rays)) {
        chiaro_rays_destroy(rays);
        chiaro_log_write(log, CHIARO_LOG_ERROR, CHIARO_LOG_OUT_OF_MEMORY, "no ray tracing structure for %u triangles",
                       scene->index_count / 3);
        return CHIARO_ERROR_MEMORY;
    }
    *out = rays;
    return CHIARO_OK;
}

void chiaro_rays_destroy(ChiaroRays *rays)
{
    if (!rays)
        return;
    if (rays->accelerator)
        rtcReleaseScene(rays->accelerator);
    if (rays->device)
        rtcReleaseDevice(rays->device);
    free(rays->triangles);
    free(rays->parts);
    free(rays);
}

static struct RTCRay make_ray(Vec3 origin, Vec3 direction, float tmin, float tmax)
{
    return (struct RTCRay){.org_x = origin.x, .org_y = origin.y, .org_z = origin.z, .dir_x = direction.x,
                           .dir_y = direction.y, .dir_z = direction.z, .tnear = tmin, .tfar = tmax, .mask = UINT32_MAX};
}

bool chiaro_rays_hit(const ChiaroRays *rays, Vec3 origin, Vec3 direction, float tmin, float tmax, ChiaroHit *hit)
{
    struct RTCRayHit query = {.ray = make_ray(origin, direction, tmin, tmax),
                              .hit = {.geomID = RTC_INVALID_GEOMETRY_ID, .primID = RTC_INVALID_GEOMETRY_ID}};
#if CHIARO_EMBREE == 4
    rtcIntersect1(rays->accelerator, &query, NULL);
#else
    struct RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    rtcIntersect1(rays->accelerator, &context, &query);
#endif
    if (query.hit.geomID == RTC_INVALID_GEOMETRY_ID)
        return false;
    uint32_t primitive = query.hit.primID;
    Side side = {rays->parts[primitive], rays->triangles[primitive], query.hit.u, query.hit.v};
    Vec3 normal = geometric_normal(rays->scene, side.triangle);
    bool front = vec3_dot(normal, direction) <= 0;
    if (!front && rays->scene->parts[side.part].twin != CHIARO_NONE) {
        side = twin_of(rays->scene, side);
        normal = vec3_scale(normal, -1);
        front = true;
    }
    *hit = (ChiaroHit){query.ray.tfar, side.u, side.v, side.part, side.triangle, normal, front};
    return true;
}

bool chiaro_rays_blocked(const ChiaroRays *rays, Vec3 origin, Vec3 direction, float tmin, float tmax)
{
    struct RTCRay ray = make_ray(origin, direction, tmin, tmax);
#if CHIARO_EMBREE == 4
    rtcOccluded1(rays->accelerator, &ray, NULL);
#else
    struct RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    rtcOccluded1(rays->accelerator, &context, &ray);
#endif
    return ray.tfar < 0;
}

bool chiaro_rays_parted(const ChiaroRays *rays, Vec3 from, Vec3 to)
{
    Vec3 way = vec3_sub(to, from);
    float distance = vec3_length(way);
    return distance > 0 && chiaro_rays_blocked(rays, from, vec3_scale(way, 1 / distance), 0, distance);
}

bool chiaro_rays_covered(const ChiaroRays *rays, Vec3 place, Vec3 normal)
{
    ChiaroHit hit;
    return chiaro_rays_hit(rays, vec3_mad(place, normal, rays->epsilon), normal, 0, INFINITY, &hit) && !hit.front;
}

float chiaro_rays_epsilon(const ChiaroRays *rays) { return rays->epsilon; }

bool chiaro_rays_light_visible(const ChiaroRays *rays, const ChiaroLight *light, Vec3 point, Vec3 normal)
{
    Vec3 origin = vec3_mad(point, normal, rays->epsilon), toward;
    float tmax = INFINITY;
    if (light->type == CHIARO_LIGHT_SUN) {
        toward = vec3_scale(vec3_load(light->direction), -1);
    } else {
        /* Short of the light: a lamp may touch the surface that carries it. */
        Vec3 line = vec3_sub(vec3_load(light->position), origin);
        float distance = vec3_length(line);
        if (distance <= rays->epsilon)
            return true;
        toward = vec3_scale(line, 1 / distance);
        tmax = distance - rays->epsilon;
    }
    return vec3_dot(toward, normal) > 0 && !chiaro_rays_blocked(rays, origin, toward, 0, tmax);
}

bool chiaro_rays_visible(const ChiaroLight *light, const float point[3], const float normal[3], void *user)
{
    return chiaro_rays_light_visible(user, light, vec3_load(point), vec3_load(normal));
}
