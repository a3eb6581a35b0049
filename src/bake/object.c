/* An object that moves, baked in its own space: a small scene of its own, whose patches are the elements of its
 * hierarchical BRDF.
 *
 * Cavity (article: Cavity shading). Light comes from outside, evenly; what the object blocks of it comes from the
 * object's own surface. So the cavity colour C is a radiosity solution: C_i = open_i + sum_j F_ij rho_j C_j, over as
 * many bounces as it takes, tinted by what blocks. In even surroundings it is exact.
 */
#include "../core/cube.h"
#include "../core/log.h"
#include "../core/object.h"
#include "../core/random.h"
#include "../offline/parallel.h"
#include "bake.h"

#include <stdlib.h>
#include <string.h>

enum { DEFAULT_ELEMENTS = 48, MOST_ELEMENTS = 4096, DEFAULT_OBJECT_RAYS = 512, MOST_SWEEPS = 2000,
       HULL_POINTS = 32, SPREAD_POINTS = 256 };
static const float CAVITY_PRECISION = 1e-5f;
/* A part longer than this many edges of the cube of its volume gets cut; sheets count as this share of their length. */
static const float LONGEST_PART = 2, THINNEST = 1.0f / 16;
/* Vertices lie on rims: their rays start this much further in. */
static const float INWARD = 0.02f;

/* What rays say of a place. */
typedef struct Place {
    RowEntry *entries; /* elements, and how much of the hemisphere each takes */
    uint32_t count;
    float open;
    Vec3 bent, cavity;
} Place;

typedef struct ObjectBaker {
    Baker baker;
    ChiaroBakeObjectDesc desc;
    RowScratch *scratch; /* one a thread */
    Vec3 *origin, *plane; /* of vertices */
    Place *places;        /* of elements, then of vertices */
    ChiaroObject object;
    ChiaroObjectVertex *vertices;
    ChiaroElement *elements;
    ChiaroObjectElement *element_more;
    void *primitives;
    ChiaroObjectPart parts[CHIARO_MAX_OBJECT_PARTS];
    float *hull;
    bool failed; /* out of memory, in some thread */
} ObjectBaker;

static Vec3 element_place(const Baker *baker, uint32_t e)
{
    const ChiaroSample *sample = &baker->samples[e];
    return vec3_mad(vec3_load(sample->position), vec3_load(sample->normal), sample->cull);
}

/* ------------------------------------------------------------------------------------------------------------------
 * Rays
 */

typedef struct Corner {
    Vec3 cross, inward; /* of the triangle: twice its area along its normal; from the corner to its centre */
    uint32_t vertex;
} Corner;

static Corner corner_of(const ChiaroScene *scene, uint32_t index)
{
    Vec3 c[3];
    uint32_t first = index / 3 * 3;
    for (uint32_t k = 0; k < 3; k++)
        c[k] = vec3_load(scene->vertices[scene->indices[first + k]].position);
    Vec3 middle = vec3_scale(vec3_add(c[0], vec3_add(c[1], c[2])), 1.0f / 3);
    return (Corner){vec3_cross(vec3_sub(c[1], c[0]), vec3_sub(c[2], c[0])), vec3_sub(middle, c[index - first]),
                    scene->indices[index]};
}

/* Where the rays of vertices start, and above which plane: a little inside the triangles around, so that a vertex in a
 * corner sees what they see; but above all of them, for on a round surface inside is below. */
static bool survey_vertices(ObjectBaker *job)
{
    const ChiaroScene *scene = job->baker.scene;
    uint32_t *corners = calloc(scene->vertex_count + (size_t)1, sizeof *corners);
    float *lift = calloc(scene->vertex_count + (size_t)1, sizeof *lift);
    job->origin = calloc(scene->vertex_count + (size_t)1, sizeof *job->origin);
    job->plane = calloc(scene->vertex_count + (size_t)1, sizeof *job->plane);
    bool ok = corners && lift && job->origin && job->plane;
    for (uint32_t i = 0; ok && i < scene->index_count; i++) {
        Corner corner = corner_of(scene, i);
        job->plane[corner.vertex] = vec3_add(job->plane[corner.vertex], corner.cross);
        job->origin[corner.vertex] = vec3_mad(job->origin[corner.vertex], corner.inward, INWARD);
        corners[corner.vertex]++;
    }
    for (uint32_t v = 0; ok && v < scene->vertex_count; v++) {
        job->origin[v] = vec3_scale(job->origin[v], 1 / fmaxf(1, (float)corners[v]));
        job->plane[v] = vec3_normalize(job->plane[v]);
        if (!(vec3_dot(job->plane[v], job->plane[v]) > 0))
            job->plane[v] = vec3_load(scene->vertices[v].normal);
    }
    for (uint32_t i = 0; ok && i < scene->index_count; i++) {
        Corner corner = corner_of(scene, i);
        Vec3 normal = vec3_normalize(corner.cross);
        float rise = vec3_dot(normal, job->plane[corner.vertex]), below = -vec3_dot(normal, job->origin[corner.vertex]);
        if (rise > 0.1f)
            lift[corner.vertex] = fmaxf(lift[corner.vertex], below / rise);
    }
    for (uint32_t v = 0; ok && v < scene->vertex_count; v++) {
        Vec3 inside = vec3_add(vec3_load(scene->vertices[v].position), job->origin[v]);
        job->origin[v] = vec3_mad(inside, job->plane[v], lift[v]);
    }
    free(corners);
    free(lift);
    return ok;
}

/* Keeps what the rays of a row found. Rays that meet the sky are the open ones; those that meet a surface from behind
 * are lost. */
static void keep_row(ObjectBaker *job, Place *place, Vec3 from, const RowEntry *entries, uint32_t count,
                     const RowFacts *facts)
{
    const Baker *baker = &job->baker;
    place->open = facts->sky, place->bent = facts->bent;
    place->entries = malloc((count + (size_t)1) * sizeof *entries);
    if (!place->entries) {
        job->failed = true;
        return;
    }
    for (uint32_t k = 0; k < count; k++) {
        RowEntry entry = entries[k];
        if (entry.node >= baker->sample_count)
            continue;
        if (job->desc.fade > 0) {
            float distance = vec3_length(vec3_sub(element_place(baker, entry.node), from));
            float faded = entry.weight * distance / (distance + job->desc.fade);
            place->open += faded, entry.weight -= faded;
        }
        place->entries[place->count++] = entry;
    }
}

static void trace_places(uint32_t begin, uint32_t end, uint32_t thread, void *user)
{
    ObjectBaker *job = user;
    const Baker *baker = &job->baker;
    RowScratch *scratch = &job->scratch[thread];
    for (uint32_t i = begin; i < end; i++) {
        RowFacts facts;
        uint32_t count, v = i - baker->sample_count;
        Vec3 from;
        if (i < baker->sample_count) {
            from = element_place(baker, i);
            count = chiaro_row_trace_sample(baker, i, baker->sample_rays, scratch, &facts);
        } else {
            Vec3 normal = vec3_load(baker->scene->vertices[v].normal), plane = job->plane[v];
            from = job->origin[v];
            if (!(vec3_dot(normal, plane) > 0.05f))
                normal = plane; /* a normal that points into the surface gets no light at all */
            count = chiaro_row_trace(baker, &from, 1, normal, plane, baker->sample_rays, v, scratch, &facts);
        }
        keep_row(job, &job->places[i], from, scratch->entries, count, &facts);
    }
}

static Vec3 gather_cavity(const ObjectBaker *job, const Place *place)
{
    Vec3 sum = {place->open, place->open, place->open};
    for (uint32_t k = 0; k < place->count; k++) {
        uint32_t e = place->entries[k].node;
        Vec3 given = vec3_mul(vec3_load(job->baker.samples[e].albedo), job->places[e].cavity);
        sum = vec3_mad(sum, given, place->entries[k].weight);
    }
    return vec3(fminf(1, sum.x), fminf(1, sum.y), fminf(1, sum.z));
}

/* Sweep by sweep, each with what the last one left (Gauss and Seidel): rows add up to 1 at most and albedo to 0.99, so
 * this ends. */
static void solve_cavity(ObjectBaker *job)
{
    uint32_t elements = job->baker.sample_count, all = elements + job->baker.scene->vertex_count;
    float change = 1;
    for (uint32_t sweep = 0; sweep < MOST_SWEEPS && change > CAVITY_PRECISION; sweep++) {
        change = 0;
        for (uint32_t e = 0; e < elements; e++) {
            Vec3 next = gather_cavity(job, &job->places[e]), way = vec3_sub(next, job->places[e].cavity);
            change = fmaxf(change, fmaxf(fabsf(way.x), fmaxf(fabsf(way.y), fabsf(way.z))));
            job->places[e].cavity = next;
        }
    }
    for (uint32_t i = elements; i < all; i++)
        job->places[i].cavity = gather_cavity(job, &job->places[i]);
}

/* ------------------------------------------------------------------------------------------------------------------
 * Elements and parts
 */

/* Mean normal of a piece of surface, not normalised. */
static Vec3 mean_normal(const Baker *baker, uint32_t e)
{
    Vec3 sum = {0, 0, 0}, place, normal;
    for (uint32_t k = 0; k < HULL_POINTS; k++) {
        chiaro_patches_place(baker, e, ((float)k + 0.5f) / HULL_POINTS, 0.5f, 0.5f, &place, &normal);
        sum = vec3_mad(sum, normal, 1.0f / HULL_POINTS);
    }
    return sum;
}

/* How far a piece of surface reaches to all sides of a place. */
static void measure_spread(const Baker *baker, uint32_t e, Vec3 from, float spread[6])
{
    ChiaroRandom random = chiaro_random_seed(baker->desc.seed, (uint64_t)5 << 33 | e);
    for (uint32_t k = 0; k < SPREAD_POINTS; k++) {
        Vec3 place, normal;
        float pick = ((float)k + chiaro_random_float(&random)) / SPREAD_POINTS, u = chiaro_random_float(&random);
        chiaro_patches_place(baker, e, pick, u, chiaro_random_float(&random), &place, &normal);
        Vec3 d = vec3_sub(place, from);
        float product[6] = {d.x * d.x, d.y * d.y, d.z * d.z, d.x * d.y, d.y * d.z, d.z * d.x};
        for (uint32_t c = 0; c < 6; c++)
            spread[c] += product[c] / SPREAD_POINTS;
    }
}

/* Elements do not hide each other, so each counts as much as is seen of it: the mean of projected area over all
 * directions is then right for any shape. And each counts as its projection along its mean normal, so that a closed
 * surface stays closed: what it shows to one side it shows to the other; all grow alike to make up for it. */
static bool make_elements(ObjectBaker *job)
{
    const Baker *baker = &job->baker;
    uint32_t count = baker->sample_count;
    job->elements = calloc(count, sizeof *job->elements);
    job->element_more = calloc(count, sizeof *job->element_more);
    size_t size = chiaro_primitives_size(count);
    job->primitives = calloc(1, size);
    if (!job->elements || !job->element_more || !job->primitives)
        return false;
    double area = 0, projected = 0;
    for (uint32_t e = 0; e < count; e++) {
        const ChiaroSample *sample = &baker->samples[e];
        Vec3 normal = mean_normal(baker, e);
        float flatness = vec3_length(normal);
        vec3_store(job->elements[e].normal, flatness > 0 ? vec3_normalize(normal) : vec3_load(sample->normal));
        vec3_store(job->elements[e].position, element_place(baker, e));
        job->elements[e].area = sample->area * fminf(1, job->places[e].open) * flatness;
        area += (double)sample->area, projected += (double)(sample->area * flatness);
        memcpy(job->elements[e].albedo, sample->albedo, sizeof sample->albedo);
        memcpy(job->element_more[e].emission, sample->emission, sizeof sample->emission);
        vec3_store(job->element_more[e].cavity, job->places[e].cavity);
        measure_spread(baker, e, element_place(baker, e), job->element_more[e].spread);
    }
    for (uint32_t e = 0; e < count && projected > 0; e++)
        job->elements[e].area *= (float)(area / projected);
    return chiaro_primitives_build(job->elements, count, job->primitives, size, &job->object.primitives) == CHIARO_OK;
}

/* Bounds of the elements of a part. */
static void part_bounds(const ObjectBaker *job, uint32_t part, float low[3], float high[3])
{
    for (uint32_t c = 0; c < 3; c++)
        low[c] = INFINITY, high[c] = -INFINITY;
    for (uint32_t e = 0; e < job->baker.sample_count; e++) {
        for (uint32_t c = 0; c < 3 && job->element_more[e].part == part; c++) {
            low[c] = fminf(low[c], job->elements[e].position[c]);
            high[c] = fmaxf(high[c], job->elements[e].position[c]);
        }
    }
}

/* How much longer a part is than a cube may be; and along which axis. */
static float part_excess(const float low[3], const float high[3], uint32_t *axis)
{
    float edge[3], volume = 1;
    *axis = 0;
    for (uint32_t c = 0; c < 3; c++) {
        edge[c] = high[c] - low[c];
        *axis = edge[c] > edge[*axis] ? c : *axis;
    }
    for (uint32_t c = 0; c < 3; c++)
        volume *= fmaxf(edge[c], THINNEST * edge[*axis]);
    return volume > 0 ? edge[*axis] / (LONGEST_PART * cbrtf(volume)) : 0;
}

/* Cuts the part that is longest, until none is too long. How long a piece may be is the whole object's affair: pieces of
 * a sheet are as long as it is thick no sooner than they are crumbs. */
static void make_parts(ObjectBaker *job)
{
    uint32_t most = job->desc.parts, count = 1, axis;
    float low[3], high[3];
    part_bounds(job, 0, low, high);
    float whole = part_excess(low, high, &axis), longest = whole > 1 ? (high[axis] - low[axis]) / whole : INFINITY;
    longest = job->desc.part_size > 0 ? fminf(longest, job->desc.part_size) : longest;
    while (count < most) {
        uint32_t worst = 0, worst_axis = 0;
        float length = 0, middle = 0;
        for (uint32_t p = 0; p < count; p++) {
            part_bounds(job, p, low, high);
            part_excess(low, high, &axis);
            if (high[axis] - low[axis] > length)
                worst = p, worst_axis = axis, length = high[axis] - low[axis], middle = (low[axis] + high[axis]) / 2;
        }
        if (!(length > longest))
            break;
        for (uint32_t e = 0; e < job->baker.sample_count; e++) {
            if (job->element_more[e].part == worst && job->elements[e].position[worst_axis] > middle)
                job->element_more[e].part = count;
        }
        count++;
    }
    job->object.part_count = count;
    for (uint32_t p = 0; p < count; p++) {
        part_bounds(job, p, low, high);
        Vec3 center = vec3_scale(vec3_add(vec3_load(low), vec3_load(high)), 0.5f);
        vec3_store(job->parts[p].center, center);
        for (uint32_t e = 0; e < job->baker.sample_count; e++) {
            if (job->element_more[e].part != p)
                continue;
            float away = vec3_length(vec3_sub(vec3_load(job->elements[e].position), center));
            away += sqrtf(job->baker.samples[e].area / CHIARO_PI);
            job->parts[p].radius = fmaxf(job->parts[p].radius, away);
        }
    }
}

/* Inverse fourth power of the distance, less that of the fifth part: what is left out counted nothing. */
static void weigh_parts(const ObjectBaker *job, Vec3 place, ChiaroObjectVertex *vertex)
{
    float weight[CHIARO_MAX_OBJECT_PARTS + 1] = {0}, sum = 0;
    uint32_t order[CHIARO_MAX_OBJECT_PARTS], count = job->object.part_count, left = 255;
    for (uint32_t p = 0; p < count; p++) {
        Vec3 way = vec3_sub(vec3_load(job->parts[p].center), place);
        float square = vec3_dot(way, way) + 1e-6f * job->object.radius * job->object.radius + 1e-30f;
        uint32_t k = p;
        weight[p] = 1 / (square * square);
        for (; k > 0 && weight[order[k - 1]] < weight[p]; k--)
            order[k] = order[k - 1];
        order[k] = p;
    }
    uint32_t kept = count < 4 ? count : 4;
    float least = count > 4 ? weight[order[4]] : 0;
    for (uint32_t k = 0; k < kept; k++)
        sum += weight[order[k]] - least;
    for (uint32_t k = kept; k-- > 0;) {
        float share = sum > 0 ? (weight[order[k]] - least) / sum : 1 / (float)kept;
        uint32_t parts = k ? (uint32_t)lrintf(255 * share) : left;
        parts = parts < left ? parts : left;
        vertex->parts[k] = (uint8_t)order[k], vertex->weights[k] = (uint8_t)parts;
        left -= parts;
    }
}

static bool make_vertices(ObjectBaker *job)
{
    const ChiaroScene *scene = job->baker.scene;
    job->vertices = calloc(scene->vertex_count + (size_t)1, sizeof *job->vertices);
    for (uint32_t v = 0; job->vertices && v < scene->vertex_count; v++) {
        const Place *place = &job->places[job->baker.sample_count + v];
        ChiaroObjectVertex *vertex = &job->vertices[v];
        Vec3 normal = vec3_load(scene->vertices[v].normal);
        /* Where all is open the mean is the normal itself: rays would only add their noise. */
        bool bends = place->open < 0.999f && vec3_length(place->bent) > 1e-3f;
        vec3_store(vertex->bent, bends ? vec3_normalize(place->bent) : normal);
        vec3_store(vertex->cavity, place->cavity);
        vertex->open = fminf(1, place->open);
        weigh_parts(job, vec3_load(scene->vertices[v].position), vertex);
    }
    return job->vertices != NULL;
}

/* ------------------------------------------------------------------------------------------------------------------
 * Hull
 */

/* Places all over the surface. */
typedef struct HullPoint {
    Vec3 place, normal;
    float area;
    uint32_t part;
} HullPoint;

typedef struct HullJob {
    ObjectBaker *job;
    HullPoint *points;
    uint32_t point_count;
} HullJob;

static float lobe(float cosine)
{
    float power = fmaxf(0, cosine);
    for (uint32_t k = 0; k < 5; k++)
        power *= power;
    return power;
}

/* Where surface of a normal lies: the mean over a narrow lobe about it. */
static void hull_texels(uint32_t begin, uint32_t end, uint32_t thread, void *user)
{
    static const uint32_t edges[3] = {4, 6, 8};
    const HullJob *hull = user;
    (void)thread;
    for (uint32_t i = begin; i < end; i++) {
        uint32_t part = i / CHIARO_HULL_TEXELS, texel = i % CHIARO_HULL_TEXELS, k = 0;
        float angle;
        while (texel >= 6 * edges[k] * edges[k])
            texel -= 6 * edges[k] * edges[k], k++;
        Vec3 n = chiaro_cube_texel_direction(texel, edges[k], &angle);
        Vec3 center = vec3_load(hull->job->parts[part].center);
        double sum[3] = {0}, weight = 0;
        for (uint32_t p = 0; p < hull->point_count; p++) {
            const HullPoint *point = &hull->points[p];
            if (point->part != part)
                continue;
            double w = (double)(lobe(vec3_dot(point->normal, n)) * point->area);
            Vec3 from = vec3_sub(point->place, center);
            sum[0] += w * (double)from.x, sum[1] += w * (double)from.y, sum[2] += w * (double)from.z;
            weight += w;
        }
        for (uint32_t c = 0; c < 3; c++)
            hull->job->hull[4 * (size_t)i + c] = weight > 0 ? (float)(sum[c] / weight) : 0;
    }
}

static bool make_hull(ObjectBaker *job)
{
    const Baker *baker = &job->baker;
    uint32_t elements = baker->sample_count, texels = CHIARO_HULL_TEXELS * job->object.part_count;
    HullJob hull = {job, calloc((size_t)elements * HULL_POINTS, sizeof(HullPoint)), elements * HULL_POINTS};
    job->hull = calloc(4 * (size_t)texels, sizeof *job->hull);
    bool ok = hull.points && job->hull;
    ChiaroRandom random = chiaro_random_seed(job->desc.seed, 0x4011);
    for (uint32_t i = 0; ok && i < hull.point_count; i++) {
        HullPoint *point = &hull.points[i];
        uint32_t e = i / HULL_POINTS;
        float pick = ((float)(i % HULL_POINTS) + chiaro_random_float(&random)) / HULL_POINTS;
        float u = chiaro_random_float(&random), v = chiaro_random_float(&random);
        chiaro_patches_place(baker, e, pick, u, v, &point->place, &point->normal);
        point->area = baker->samples[e].area / HULL_POINTS, point->part = job->element_more[e].part;
    }
    if (ok)
        chiaro_parallel_for(job->desc.threads, texels, 32, hull_texels, &hull, NULL, NULL);
    free(hull.points);
    return ok;
}

/* ------------------------------------------------------------------------------------------------------------------
 * All of it
 */

static ChiaroResult resolve(ObjectBaker *job, const ChiaroBakeObjectDesc *desc)
{
    ChiaroBakeObjectDesc *d = &job->desc;
    if (desc && desc->struct_size < sizeof *desc)
        return CHIARO_ERROR_ARGUMENT;
    if (desc)
        *d = *desc;
    d->elements = d->elements ? d->elements : DEFAULT_ELEMENTS;
    d->parts = d->parts ? d->parts : CHIARO_MAX_OBJECT_PARTS;
    d->rays = d->rays ? d->rays : DEFAULT_OBJECT_RAYS;
    d->threads = d->threads ? d->threads : chiaro_core_count();
    bool sane = d->elements <= MOST_ELEMENTS && d->parts <= CHIARO_MAX_OBJECT_PARTS && d->rays >= 16 &&
                d->rays <= CHIARO_MAX_RAYS && d->threads <= 1024 && d->fade >= 0 && isfinite(d->fade) &&
                d->part_size >= 0;
    if (!sane)
        chiaro_log_write(&d->log, CHIARO_LOG_ERROR, CHIARO_LOG_ARGUMENT_INVALID,
                         "elements, parts, part_size, rays, fade or threads");
    return sane ? CHIARO_OK : CHIARO_ERROR_ARGUMENT;
}

static void measure(ObjectBaker *job)
{
    const ChiaroScene *scene = job->baker.scene;
    Vec3 low = vec3_load(job->baker.info.bounds_min), high = vec3_load(job->baker.info.bounds_max);
    Vec3 center = vec3_scale(vec3_add(low, high), 0.5f);
    vec3_store(job->object.center, center);
    for (uint32_t i = 0; i < scene->index_count; i++) {
        Vec3 place = vec3_load(scene->vertices[scene->indices[i]].position);
        job->object.radius = fmaxf(job->object.radius, vec3_length(vec3_sub(place, center)));
    }
}

static ChiaroResult bake(ObjectBaker *job)
{
    Baker *baker = &job->baker;
    ChiaroResult result = chiaro_scene_check(baker->scene, &job->desc.log);
    if (result == CHIARO_OK)
        result = chiaro_rays_create(baker->scene, &job->desc.log, &baker->rays);
    if (result != CHIARO_OK)
        return result;
    chiaro_bake_bounds(baker);
    measure(job);
    if ((result = chiaro_bake_patches(baker)) != CHIARO_OK)
        return result;
    uint32_t places = baker->sample_count + baker->scene->vertex_count;
    job->scratch = calloc(job->desc.threads, sizeof *job->scratch);
    job->places = calloc(places, sizeof *job->places);
    if (!job->scratch || !job->places || !survey_vertices(job))
        return CHIARO_ERROR_MEMORY;
    for (uint32_t t = 0; t < job->desc.threads; t++) {
        if (!chiaro_row_scratch_create(baker, baker->sample_rays, &job->scratch[t]))
            return CHIARO_ERROR_MEMORY;
    }
    chiaro_parallel_for(job->desc.threads, places, 16, trace_places, job, NULL, NULL);
    if (job->failed)
        return CHIARO_ERROR_MEMORY;
    solve_cavity(job);
    if (!make_elements(job))
        return CHIARO_ERROR_MEMORY;
    make_parts(job);
    return make_vertices(job) && make_hull(job) ? CHIARO_OK : CHIARO_ERROR_MEMORY;
}

static ChiaroResult write_object(ObjectBaker *job, ChiaroBlob *blob)
{
    ChiaroObject *object = &job->object;
    object->vertices = job->vertices, object->elements = job->elements, object->element_more = job->element_more;
    object->parts = job->parts, object->hull = job->hull;
    object->vertex_count = job->baker.scene->vertex_count, object->element_count = job->baker.sample_count;
    ChiaroObjectHeader header = {.start.version = CHIARO_OBJECT_VERSION, .vertex_count = object->vertex_count,
                                 .element_count = object->element_count, .part_count = object->part_count,
                                 .radius = object->radius};
    ChiaroFileArray arrays[CHIARO_OBJECT_ARRAYS];
    memcpy(header.start.magic, CHIARO_OBJECT_MAGIC, sizeof header.start.magic);
    memcpy(header.center, object->center, sizeof header.center);
    chiaro_object_arrays(object, arrays);
    return chiaro_bake_block(&header.start, sizeof header, arrays, CHIARO_OBJECT_ARRAYS, blob);
}

ChiaroResult chiaro_bake_object(const ChiaroScene *scene, const ChiaroBakeObjectDesc *desc, ChiaroBlob *blob)
{
    ObjectBaker job = {.baker.scene = scene};
    if (!scene || !blob)
        return CHIARO_ERROR_ARGUMENT;
    ChiaroResult result = resolve(&job, desc);
    if (result != CHIARO_OK)
        return result;
    job.baker.desc = (ChiaroBakeDesc){.samples = job.desc.elements, .threads = job.desc.threads, .seed = job.desc.seed,
                                      .log = job.desc.log};
    job.baker.sample_rays = chiaro_bake_ray_count(job.desc.rays);
    result = bake(&job);
    if (result == CHIARO_OK)
        result = write_object(&job, blob);
    if (result == CHIARO_ERROR_MEMORY)
        chiaro_log_write(&job.desc.log, CHIARO_LOG_ERROR, CHIARO_LOG_OUT_OF_MEMORY, "while baking an object");
    for (uint32_t t = 0; job.scratch && t < job.desc.threads; t++)
        chiaro_row_scratch_destroy(&job.scratch[t]);
    for (uint32_t i = 0; job.places && i < job.baker.sample_count + scene->vertex_count; i++)
        free(job.places[i].entries);
    void *all[] = {job.scratch, job.origin, job.plane, job.places, job.vertices, job.elements, job.element_more,
                   job.primitives, job.hull};
    for (size_t k = 0; k < sizeof all / sizeof *all; k++)
        free(all[k]);
    chiaro_bake_release(&job.baker);
    return result;
}
