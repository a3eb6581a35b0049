/* A cube, painted (article: Environment maps), and the light on the elements of its object.
 *
 * Rays tell which static surface each part of a texel sees, or that it sees the sky. Neighbours lie over what is behind
 * them and under what is in front. A surface shows the light of a node of the static tree that is no wider than the ray
 * (article: The ideal size of a primitive is one pixel).
 *
 * What is near is not put into the cube: the smoothing would see it from the centre. It is summed for every texel by its
 * form factor from the object's hull instead, and each row is normalised, so that even surroundings stay even. What the
 * smoothing carries is told by its fourth lane: how much of what a normal sees is far.
 */
#include "chiaro_shared.h"
#include "lanes.h"
#include "object.h"
#include "primitives.h"
#include "world.h"

#include <string.h>

/* In radii of the object's part: static surfaces up to the first count as near, beyond the second as far. */
static const float NEAR_ALL = 10, NEAR_NONE = 20;
/* From the skin, a radius nearer, what lies at NEAR_ALL radii takes this much more of the sphere than from the centre. */
static const float FAR_GROWS = 1.23f;
/* A node of the tree may be so wide, as a part of its distance and a texel's angle; and must look one way, by the length
 * of its mean normal: a node of both sides of a wall would carry the light of one side to the other. */
static const float SPAN = 0.25f, ONE_WAY = 0.9f;
/* A near plate spans no more than this from the nearest skin, or so many radii, unless it is of one ray; is flat by this
 * cosine, and from one piece to the next it rises by no more than this sine. */
static const float PLATE_SPAN = 0.5f, FINEST = 0.2f, PLATE_FLAT = 0.999f, PLATE_STEP = 0.1f;
/* The least cosine under which a ray counts as meeting a surface. */
static const float GRAZING = 0.03f;
/* In radii of the object's part: nearer neighbours are seen from the hull. */
static const float NEAR_OBJECT = 4;
/* And those that shine by themselves, further off: their light changes with the square of the distance. */
static const float NEAR_LAMP = 24;
/* Sharpening raises no light by more than this: a cosine wants 1.04 at 4x4x6. */
static const float MOST_RAISED = 1.08f;
/* Twenty-four where a piece is curved as a ball is. */
static const float FACE_BEND = 24;
/* A hull is a sphere where no place of it is further off, in radii. */
static const float ROUND_SKIN = 0.04f;
/* Rows that see next to nothing are left as they are. */
static const float LEAST_WEIGHT = 0.01f;
/* Things less visible are left out of the near sum. */
static const float LEAST_VISIBLE = 0.01f;

/* Walls are told to be no further than this many radii: blockers reach half of it. */
static const float DEPTH_RANGE = 16;
_Static_assert(6 * CHIARO_DEPTH_EDGE * CHIARO_DEPTH_EDGE == CHIARO_BLOCKER_DEPTHS, "texels of a cube");

enum { MAX_LISTED = 2 * CHIARO_MAX_NEIGHBOURS };

/* A cube is painted in steps, so that a frame can stop between any two of them: its neighbours; blocks of rays; sky and
 * smoothing; what is near, for some texels at a time; all of it together. */
enum { BLOCKS_A_STEP = 6, TEXELS_A_STEP = 24, FACES_A_PART = 24, OTHER_STEPS = 3 };

typedef struct Canvas {
    ChiaroWorld *world;
    const Body *body;
    uint32_t part;
    Vec3 center;
    float radius;
    ChiaroCubeTexel near[CHIARO_CUBE_MAX_TEXELS], far[CHIARO_CUBE_MAX_TEXELS]; /* neighbours */
    bool any_near, any_far;
    float full[CHIARO_CUBE_MAX_TEXELS];           /* static cover */
    Vec3 covered[CHIARO_CUBE_MAX_TEXELS];         /* its directions, summed */
    float before_near[CHIARO_CUBE_MAX_TEXELS], before_far[CHIARO_CUBE_MAX_TEXELS]; /* of it, in front of neighbours */
    float near_share[CHIARO_CUBE_MAX_TEXELS];     /* of it, near */
    float radiance[4 * CHIARO_CUBE_MAX_TEXELS];
    float depth[CHIARO_BLOCKER_DEPTHS], depth_angle[CHIARO_BLOCKER_DEPTHS]; /* of walls: sums over rays */
    KeyRay key_rays[WORLD_MAX_RAYS];
    uint32_t key_count;
    Near near_things;
    float near_light[CHIARO_CUBE_MAX_TEXELS][4]; /* theirs, by normals */
} Canvas;

/* ------------------------------------------------------------------------------------------------------------------
 * Neighbours
 */

typedef struct Listed {
    float distance;
    uint32_t id;
} Listed;

/* Nearest first. Lists are short. */
static void sort_listed(Listed *listed, uint32_t count)
{
    for (uint32_t k = 1; k < count; k++) {
        const Listed entry = listed[k];
        uint32_t place = k;
        for (; place > 0 && (entry.distance < listed[place - 1].distance ||
                             (entry.distance == listed[place - 1].distance && entry.id < listed[place - 1].id));
             place--)
            listed[place] = listed[place - 1];
        listed[place] = entry;
    }
}

static Listed listed_of(const Canvas *canvas, uint32_t id)
{
    const ChiaroNeighbourObject *object = &canvas->world->neighbour_objects[id];
    return (Listed){vec3_length(vec3_sub(vec3_load(object->position), canvas->center)) - object->radius, id};
}

/* A place that is no object has no lists: the nearest of all, for their size. */
static uint32_t list_all(const Canvas *canvas, Listed listed[MAX_LISTED])
{
    const ChiaroWorld *world = canvas->world;
    float weights[MAX_LISTED] = {0};
    uint32_t total = 0;
    for (uint32_t id = 0; id < world->body_end; id++) {
        if (!world->bodies[id].present)
            continue;
        Listed entry = listed_of(canvas, id);
        float radius = world->neighbour_objects[id].radius, weight = radius / chiaro_max(entry.distance + radius, radius);
        uint32_t place = total;
        if (total == world->desc.neighbours) {
            for (uint32_t k = place = 0; k < total; k++)
                place = weights[k] < weights[place] ? k : place;
            if (weight <= weights[place])
                continue;
        } else {
            total++;
        }
        listed[place] = entry, weights[place] = weight;
    }
    sort_listed(listed, total);
    return total;
}

/* Everybody on one of the lists, nearest first. */
static uint32_t list_neighbours(const Canvas *canvas, uint32_t id, Listed listed[MAX_LISTED])
{
    const ChiaroWorld *world = canvas->world;
    uint32_t total = 0;
    if (id == CHIARO_NONE)
        return list_all(canvas, listed);
    for (uint32_t kind = 0; kind < 2; kind++) {
        uint32_t count;
        const ChiaroNeighbour *list = chiaro_neighbours_list(world->neighbours, kind, id, &count);
        for (uint32_t i = 0; i < count; i++) {
            uint32_t other = list[i].object, k = 0;
            while (k < total && listed[k].id != other)
                k++;
            if (k < total || !world->bodies[other].present)
                continue;
            listed[total++] = listed_of(canvas, other);
        }
    }
    sort_listed(listed, total);
    return total;
}

/* A node of a neighbour; all numbers of the node are in the neighbour's own space. */
static void paint_node(Canvas *canvas, const Body *other, uint32_t number, bool near)
{
    const Pose *pose = &other->pose;
    const ChiaroPrimitive *node = &other->object.primitives.nodes[number];
    bool ball = chiaro_is_ball(node);
    /* The mean place of a few dozen elements is not quite the middle of a ball; nor is what they show its disc. */
    const float *middle = ball && number == 0 ? other->object.center : node->center;
    Vec3 center = pose_point(pose, vec3_load(middle)), way = vec3_sub(center, canvas->center);
    float distance = vec3_length(way), viewer[3], intensity[3], square = pose->scale * pose->scale;
    vec3_store(viewer, vec3_scale(pose_turn_back(pose, way), distance > 0 ? -1 / distance : 0));
    float projected = chiaro_primitive_projected_area(node, viewer);
    if (!(projected > 0))
        return;
    const float *axes = canvas->world->last.axes + 18 * (2 * (size_t)other->first_element + number);
    chiaro_primitive_radiate(node, axes, viewer, intensity);
    Vec3 radiance = vec3_scale(vec3_load(intensity), 1 / projected);
    if (ball)
        projected = node->area / 4;
    ChiaroCubeDisc disc = {.distance = distance, .depth = node->radius * pose->scale};
    disc.solid_angle = chiaro_cube_sphere_angle(sqrtf(projected * square / CHIARO_PI), distance);
    vec3_store(disc.direction, way);
    if (!near) {
        vec3_store(disc.radiance, radiance);
        chiaro_cube_paint(canvas->world->kernel, canvas->far, &disc);
        return;
    }
    chiaro_cube_paint(canvas->world->kernel, canvas->near, &disc);
    Vec3 normal = vec3_load(node->normal);
    NearThing thing = {.center = center, .radiance = radiance, .area = projected * square, .visible = 1,
                       .ball = node->form == CHIARO_PRIMITIVE_AXES};
    if (!thing.ball)
        thing.area = node->area * vec3_length(normal) * square;
    thing.normal = vec3_normalize(pose_turn(pose, normal));
    chiaro_near_add(&canvas->near_things, &thing);
}

static void paint_neighbours(Canvas *canvas, uint32_t id)
{
    const ChiaroWorld *world = canvas->world;
    Listed listed[MAX_LISTED];
    uint32_t count = world->without & CHIARO_WORLD_WITHOUT_NEIGHBOURS ? 0 : list_neighbours(canvas, id, listed);
    chiaro_cube_clear(world->kernel, canvas->near);
    chiaro_cube_clear(world->kernel, canvas->far);
    for (uint32_t i = 0; i < count; i++) {
        const Body *other = &world->bodies[listed[i].id];
        float reach = other->shines ? NEAR_LAMP : NEAR_OBJECT - 1, point[3];
        bool near = !(world->without & CHIARO_WORLD_WITHOUT_SKIN) && listed[i].distance < reach * canvas->radius;
        *(near ? &canvas->any_near : &canvas->any_far) = true;
        if (chiaro_is_ball(other->object.primitives.nodes)) {
            paint_node(canvas, other, 0, near); /* it is the same from everywhere, however near */
            continue;
        }
        vec3_store(point, pose_point_back(&other->pose, canvas->center));
        ChiaroPrimitiveWalk walk =
            chiaro_primitive_walk_begin(&other->object.primitives, point, CHIARO_PI / 2 / (float)world->desc.edge);
        for (uint32_t n; (n = chiaro_primitive_walk_next(&walk)) != CHIARO_NONE;)
            paint_node(canvas, other, n, near);
    }
}

/* ------------------------------------------------------------------------------------------------------------------
 * Static surfaces
 */

/* What a neighbour in a texel leaves of a thing at this distance; counts the thing as in front otherwise. */
static float left_over(const ChiaroCubeTexel *texel, float distance, float share, float *before)
{
    if (!(texel->coverage > 0))
        return 1;
    if (distance > texel->distance)
        return 1 - texel->coverage;
    *before += share;
    return 1;
}

/* The largest node about a leaf that is no wider than `reach`. */
static uint32_t find_node(const ChiaroWorld *world, uint32_t leaf, float reach)
{
    const ChiaroTransport *t = world->desc.transport;
    uint32_t n = leaf;
    for (uint32_t up = world->parent[n]; up != CHIARO_NONE; n = up, up = world->parent[n]) {
        const ChiaroNode *node = &t->nodes[up];
        if (!(node->radius <= reach) || node->first + node->count > t->sample_count ||
            !(vec3_length(vec3_load(node->normal)) >= ONE_WAY))
            break;
    }
    return n;
}

/* Paints what is far of a ray's surface. Returns how much of it no neighbour hides. */
static float paint_ray(Canvas *canvas, const StaticRay *ray, float distance, Vec3 radiance, float near)
{
    const ChiaroWorld *world = canvas->world;
    float taken = 0, left = 0;
    for (uint32_t k = 0; k < 4; k++) {
        uint32_t t = ray->texel[k];
        float share = ray->share[k], seen = share;
        canvas->full[t] += share;
        canvas->covered[t] = vec3_mad(canvas->covered[t], ray->direction, share);
        if (canvas->any_near)
            seen *= left_over(&canvas->near[t], distance, share, &canvas->before_near[t]);
        if (canvas->any_far)
            seen *= left_over(&canvas->far[t], distance, share, &canvas->before_far[t]);
        taken += share * world->kernel->weight[t], left += seen * world->kernel->weight[t];
        canvas->near_share[t] += near * seen;
        float *color = canvas->radiance + 4 * (size_t)t, far = (1 - near) * seen;
        color[0] += far * radiance.x, color[1] += far * radiance.y, color[2] += far * radiance.z;
    }
    return taken > 0 ? left / taken : 0;
}

/* A near piece of surface, on its way to being a plate of its own or a part of one. Of no area: there is none. */
typedef struct Piece {
    Vec3 center, normal, ambient, direct, albedo, emission;
    float area, seen, distance, visible, leaf_area; /* seen: area across the line of sight */
    bool back;
} Piece;

static Vec3 near_radiance(const ChiaroWorld *world, const Piece *piece)
{
    const StaticLight *light = &world->light;
    Vec3 bounce, direct = piece->direct;
    if (piece->back)
        return vec3(0, 0, 0);
    /* Where lamps can be asked, their light on this very piece, if that is finer than what the leaf knows. */
    if (piece->area < piece->leaf_area && light->visible && light->light_count)
        direct = vec3_add(piece->emission,
                          vec3_mul(piece->albedo, chiaro_world_direct(world, piece->center, piece->normal)));
    float open = chiaro_blockers_at(world, piece->center, piece->normal, &bounce);
    Vec3 ambient = vec3_positive(vec3_mad(vec3_mul(piece->albedo, bounce), piece->ambient, open));
    return vec3_scale(vec3_add(direct, ambient), 1 / CHIARO_PI);
}

static void add_plate(Canvas *canvas, const Piece *piece, Vec3 radiance)
{
    NearThing thing = {.center = piece->center, .normal = piece->normal, .area = piece->area, .visible = piece->visible,
                       .radiance = radiance};
    if (piece->visible > LEAST_VISIBLE)
        chiaro_near_add(&canvas->near_things, &thing);
}

/* The mean of pieces side by side; false: they are not one plate. */
static bool join_pieces(const Piece *pieces, uint32_t count, Piece *sum)
{
    *sum = (Piece){.normal = pieces[0].normal, .back = pieces[0].back, .distance = INFINITY};
    for (uint32_t k = 0; k < count; k++) {
        const Piece *piece = &pieces[k];
        float area = piece->area;
        Vec3 way = vec3_sub(piece->center, pieces[0].center);
        if (!(area > 0 && vec3_dot(piece->normal, sum->normal) > PLATE_FLAT && piece->back == sum->back &&
              fabsf(vec3_dot(way, sum->normal)) <= PLATE_STEP * vec3_length(way)))
            return false;
        sum->center = vec3_mad(sum->center, piece->center, area);
        sum->ambient = vec3_mad(sum->ambient, piece->ambient, area);
        sum->direct = vec3_mad(sum->direct, piece->direct, area);
        sum->albedo = vec3_mad(sum->albedo, piece->albedo, area);
        sum->emission = vec3_mad(sum->emission, piece->emission, area);
        sum->visible += piece->visible * area, sum->leaf_area += piece->leaf_area * area;
        sum->area += area, sum->seen += piece->seen;
        sum->distance = chiaro_min(piece->distance, sum->distance);
    }
    Vec3 *means[] = {&sum->center, &sum->ambient, &sum->direct, &sum->albedo, &sum->emission};
    for (uint32_t k = 0; k < sizeof means / sizeof *means; k++)
        *means[k] = vec3_scale(*means[k], 1 / sum->area);
    sum->visible /= sum->area, sum->leaf_area /= sum->area;
    return true;
}

/* A block of pieces is one plate where that is fine enough; else its quarters are asked. Even where each of four is a
 * plate, they share their light, which does not change as fast as what is seen of them. */
static void add_pieces(Canvas *canvas, const Piece *pieces, uint32_t count)
{
    const ChiaroWorld *world = canvas->world;
    Piece sum;
    bool flat = join_pieces(pieces, count, &sum);
    float span = chiaro_max(PLATE_SPAN * (sum.distance - canvas->radius), FINEST * canvas->radius);
    if (flat && sum.seen < span * span) {
        add_plate(canvas, &sum, near_radiance(world, &sum));
    } else if (count > 4) {
        for (uint32_t k = 0; k < 4; k++)
            add_pieces(canvas, pieces + k * (count / 4), count / 4);
    } else {
        Vec3 shared = flat ? near_radiance(world, &sum) : vec3(0, 0, 0);
        for (uint32_t k = 0; k < count; k++) {
            if (pieces[k].area > 0)
                add_plate(canvas, &pieces[k], flat ? shared : near_radiance(world, &pieces[k]));
        }
    }
}

/* A ray's surface: what is far of it is painted; what is near becomes a piece. */
static void take_ray(Canvas *canvas, const StaticRay *ray, const StaticHit *hit, float span, Piece *piece)
{
    const ChiaroWorld *world = canvas->world;
    const StaticLight *light = &world->light;
    const Tile *tile = &world->tiles[hit->tile];
    uint32_t leaf = world->tile_leaf[hit->tile];
    Vec3 normal = vec3_normalize(vec3_cross(vec3_sub(tile->corner[1], tile->corner[0]),
                                            vec3_sub(tile->corner[2], tile->corner[0])));
    float cosine = -vec3_dot(normal, ray->direction), distance = hit->distance;
    float near = chiaro_clamp((NEAR_NONE - distance / canvas->radius) / (NEAR_NONE - NEAR_ALL), 0, 1);
    bool back = cosine < 0;
    near = world->without & CHIARO_WORLD_WITHOUT_SKIN ? 0 : near;
    Vec3 radiance = {0, 0, 0};
    near *= near * (3 - 2 * near);
    if (light->lit && near < 1 && !back)
        radiance = vec3_load(light->total + 3 * (size_t)find_node(world, leaf, span * distance));
    float visible = paint_ray(canvas, ray, distance, vec3_scale(radiance, 1 / CHIARO_PI), near);
    if (light->lit && !back) {
        Vec3 seen = vec3_scale(vec3_load(light->total + 3 * (size_t)leaf), visible / CHIARO_PI);
        canvas->key_rays[canvas->key_count++] = (KeyRay){ray->direction, seen, ray->angle, distance};
    }
    if (!(near > 0))
        return;
    const ChiaroSample *sample = &world->desc.transport->samples[leaf];
    *piece = (Piece){.normal = back ? vec3_scale(normal, -1) : normal, .albedo = vec3_load(sample->albedo),
                     .distance = distance, .visible = near * visible,
                     .leaf_area = sample->area, .back = back};
    piece->center = vec3_mad(canvas->center, ray->direction, distance);
    piece->seen = ray->angle * distance * distance;
    piece->area = piece->seen / chiaro_max(fabsf(cosine), GRAZING);
    if (!(world->without & CHIARO_WORLD_WITHOUT_EMITTERS))
        piece->emission = vec3_load(sample->emission);
    if (light->lit) {
        piece->ambient = vec3_load(light->ambient + 3 * (size_t)leaf);
        piece->direct = vec3_sub(vec3_load(light->total + 3 * (size_t)leaf), piece->ambient);
    }
}

static void add_depth(Canvas *canvas, const StaticRay *ray, const StaticHit *hit)
{
    uint32_t t = chiaro_cube_texel(ray->direction, CHIARO_DEPTH_EDGE);
    float most = DEPTH_RANGE * canvas->radius;
    canvas->depth[t] += ray->angle * (hit->tile == CHIARO_NONE ? most : chiaro_min(hit->distance, most));
    canvas->depth_angle[t] += ray->angle;
}

static void store_depths(const Canvas *canvas, WallDepths *walls)
{
    walls->range = canvas->world->tile_count ? DEPTH_RANGE * canvas->radius : 0;
    for (uint32_t t = 0; t < CHIARO_BLOCKER_DEPTHS && walls->range > 0; t++) {
        float mean = canvas->depth_angle[t] > 0 ? canvas->depth[t] / canvas->depth_angle[t] : walls->range;
        walls->depths[t] = (uint8_t)(255 * chiaro_clamp(mean / walls->range, 0, 1) + 0.5f);
    }
}

static void paint_blocks(Canvas *canvas, uint32_t first)
{
    const ChiaroWorld *world = canvas->world;
    float span = SPAN * CHIARO_PI / 2 / (float)world->desc.edge;
    uint32_t end = first + BLOCKS_A_STEP * WORLD_BLOCK;
    for (uint32_t r = first; r < end && r < world->ray_count; r += WORLD_BLOCK) {
        StaticHit hits[WORLD_BLOCK];
        Piece pieces[WORLD_BLOCK] = {{.area = 0}};
        chiaro_static_trace(world, canvas->center, canvas->radius, r, hits);
        for (uint32_t k = 0; k < WORLD_BLOCK; k++) {
            add_depth(canvas, &world->rays[r + k], &hits[k]);
            if (hits[k].tile != CHIARO_NONE)
                take_ray(canvas, &world->rays[r + k], &hits[k], span, &pieces[k]);
        }
        add_pieces(canvas, pieces, WORLD_BLOCK);
    }
}

/* ------------------------------------------------------------------------------------------------------------------
 * All together
 */

/* What static surfaces leave of a texel's sky: not only how much they cover counts, but which side of it. */
static Lanes open_sky(const Canvas *canvas, uint32_t t, float cover)
{
    const ChiaroCubeSlope *slope = &canvas->world->sky_slopes[t];
    Lanes sky = lanes_load(canvas->world->sky + 4 * t), lost = lanes_of(0);
    Vec3 way = vec3_mad(canvas->covered[t], vec3_load(slope->mean), -cover);
    for (uint32_t c = 0; c < 3; c++)
        lost[c] = vec3_dot(vec3_load(slope->slope[c]), way);
    return lanes_max(lanes_of(0), lanes_min(sky, sky * (1 - cover) - lost));
}

/* Static surfaces, neighbours and sky become one picture; its fourth number is what of it is far. */
static void resolve(Canvas *canvas)
{
    const ChiaroWorld *world = canvas->world;
    bool statics = world->tile_count > 0;
    for (uint32_t t = 0; t < world->texel_count; t++) {
        float near = canvas->near[t].coverage, far = canvas->far[t].coverage, cover = 0, near_share = 0;
        float near_seen = near, far_open = 1 - near, *out = canvas->radiance + 4 * t;
        Lanes sky = lanes_load(world->sky + 4 * t), radiance = lanes_of(0);
        if (statics) {
            cover = chiaro_clamp(canvas->full[t], 0, 1), near_share = canvas->near_share[t];
            near_seen *= 1 - chiaro_clamp(canvas->before_near[t], 0, 1);
            far_open *= 1 - chiaro_clamp(canvas->before_far[t], 0, 1);
            radiance = lanes_load(out);
            sky = cover < 1 ? cover > 0 ? open_sky(canvas, t, cover) : sky : lanes_of(0);
        }
        radiance += far_open * lanes_load(canvas->far[t].radiance) + (1 - near) * (1 - far) * sky;
        radiance[3] = 1 - near_share - near_seen;
        memcpy(out, &radiance, sizeof radiance);
    }
}

/* What is kept of far light where so much of the row is far and so much near, and what both are scaled by then. */
typedef struct Fill {
    Lanes keep, scale;
} Fill;

/* What is near is nearer from the hull than from the centre, so what is far has to make room; or it has moved aside, as
 * the frame of a window does, and more of what is far is seen. What both leave of the row then, both fill. */
static Fill fill_rows(Lanes far, Lanes near)
{
    Lanes zero = lanes_of(0), one = lanes_of(1), least = lanes_of(LEAST_WEIGHT);
    far = lanes_max(far, zero);
    LaneMask seen = far + near > least;
    Lanes keep = lanes_min(lanes_max((one - near) / lanes_max(far, least), zero), lanes_of(FAR_GROWS));
    return (Fill){lanes_choose(seen, keep, one), lanes_choose(seen, one / (keep * far + near), one)};
}

static Lanes fourths(const float *texels) { return (Lanes){texels[3], texels[7], texels[11], texels[15]}; }

static bool has_near(const Canvas *canvas) { return canvas->near_things.plate_count || canvas->near_things.ball_count; }

/* The hull's cube: places from the middle of the part, in the object's own space. NULL: it is not known. */
static const float *hull_of(const ChiaroWorld *world, const ChiaroObject *object, uint32_t part)
{
    uint32_t edge = world->desc.edge, row = edge == 4 ? 0 : edge == 6 ? 96 : 96 + 216;
    return object->hull ? object->hull + 4 * (size_t)(row + part * CHIARO_HULL_TEXELS) : NULL;
}

float chiaro_world_skin(const ChiaroWorld *world, const ChiaroObject *object)
{
    const float *hull = hull_of(world, object, 0);
    float sum = 0;
    if (!hull || object->part_count > 1)
        return 0;
    for (uint32_t t = 0; t < world->texel_count; t++)
        sum += vec3_length(vec3_load(hull + 4 * t));
    float radius = sum / (float)world->texel_count;
    for (uint32_t t = 0; t < world->texel_count; t++) {
        Vec3 off = vec3_mad(vec3_load(hull + 4 * t), chiaro_cube_centre(world->kernel, t), -radius);
        if (!(vec3_length(off) <= ROUND_SKIN * radius))
            return 0;
    }
    return radius;
}

/* Places of the hull, by normals. */
static void place_receivers(const Canvas *canvas, uint32_t first, NearReceivers *receivers)
{
    const ChiaroWorld *world = canvas->world;
    const Body *body = canvas->body;
    const float *hull = hull_of(world, &body->object, canvas->part);
    Lanes way[3];
    const float center[3] = {canvas->center.x, canvas->center.y, canvas->center.z};
    for (uint32_t c = 0; c < 3; c++)
        receivers->point[c] = lanes_of(center[c]), receivers->normal[c] = lanes_load(world->kernel->centre[c] + first);
    if (!hull)
        return;
    if (body->skin > 0) {
        for (uint32_t c = 0; c < 3; c++)
            receivers->point[c] += body->pose.scale * body->skin * receivers->normal[c];
        return;
    }
    for (uint32_t c = 0; c < 3; c++) {
        Vec3 axis = body->pose.axis[c];
        way[c] = receivers->normal[0] * axis.x + receivers->normal[1] * axis.y + receivers->normal[2] * axis.z;
    }
    ChiaroCubePlaces places = chiaro_cube_places(world->kernel, way);
    for (uint32_t lane = 0; lane < LANES; lane++) {
        ChiaroCubeTaps taps = chiaro_cube_place_taps(world->kernel, &places, lane);
        Lanes place = chiaro_cube_mix(&taps, hull);
        for (uint32_t c = 0; c < 3; c++)
            way[c][lane] = body->pose.scale * place[c];
    }
    for (uint32_t c = 0; c < 3; c++) {
        Vec3 axis = body->pose.axis[c];
        receivers->point[0] += way[c] * axis.x, receivers->point[1] += way[c] * axis.y;
        receivers->point[2] += way[c] * axis.z;
    }
}

/* What is near, as each normal's own place on the hull sees it. */
static void sum_near(Canvas *canvas, uint32_t first)
{
    const ChiaroWorld *world = canvas->world;
    for (uint32_t t = first; has_near(canvas) && t < first + TEXELS_A_STEP && t < world->texel_count; t += LANES) {
        NearReceivers receivers;
        place_receivers(canvas, t, &receivers);
        chiaro_near_sum(&canvas->near_things, &receivers, LANES, canvas->near_light + t);
    }
}

/* What a look-up along a texel's normal should find, for all of them. `far`: smoothed. */
static void fill_texels(const Canvas *canvas, const float *far, float *texels)
{
    const ChiaroWorld *world = canvas->world;
    const float *light = canvas->near_light[0];
    float sharp[4 * CHIARO_CUBE_MAX_TEXELS];
    memcpy(sharp, light, 4 * world->texel_count * sizeof *light);
    chiaro_cube_sharpen(world->kernel, sharp);
    for (uint32_t first = 0; first < 4 * world->texel_count; first += 4 * LANES) {
        Fill raised = fill_rows(fourths(far + first), fourths(sharp + first));
        Fill plain = fill_rows(fourths(far + first), fourths(light + first));
        for (uint32_t lane = 0, t = first; lane < LANES; lane++, t += 4) {
            Lanes value = (lanes_load(sharp + t) + raised.keep[lane] * lanes_load(far + t)) * raised.scale[lane];
            Lanes unsharp = (lanes_load(light + t) + plain.keep[lane] * lanes_load(far + t)) * plain.scale[lane];
            /* What differs more from its neighbours than a cosine does is an edge, which no look-up rounds off. */
            value = lanes_min(value, MOST_RAISED * unsharp);
            memcpy(texels + t, &value, 3 * sizeof *texels);
        }
    }
}

/* How much an element says of what look-ups find: nothing where its normals spread over a texel, for it is one sample of
 * many places between texels. Normals of a piece of a ball spread by an angle whose square is 24 times what the piece is
 * thick for its extent, both as mean squares. */
static float face_weight(const Canvas *canvas, uint32_t e)
{
    const ChiaroObject *object = &canvas->body->object;
    const float *spread = object->element_more[e].spread, texel = CHIARO_PI / 2 / (float)canvas->world->desc.edge;
    float thick = chiaro_spread_along(spread, vec3_load(object->elements[e].normal));
    float extent = (spread[0] + spread[1] + spread[2]) * texel * texel;
    return object->elements[e].area * chiaro_max(extent > 0 ? 1 - FACE_BEND * thick / extent : 1, 0);
}

/* Flat faces are looked up along one normal only, between texels as a rule, and what is near may change its light faster
 * than any texels about it can tell: before an opening it is darkest just there. So texels move until elements that are
 * flat find what is true for them; where they disagree, the mean. */
static void fit_faces(Canvas *canvas, const float *far, float *texels)
{
    const ChiaroCubeKernel *kernel = canvas->world->kernel;
    const ChiaroObject *object = &canvas->body->object;
    const Pose *pose = &canvas->body->pose;
    float wrong[4 * CHIARO_CUBE_MAX_TEXELS]; /* the fourth number is the weight */
    bool any = false;
    uint32_t stride = 1 + object->element_count / (FACES_A_PART * (object->part_count + 1));
    for (uint32_t e = 0; e < object->element_count; e += stride) {
        float weight = face_weight(canvas, e), near[1][4];
        if (object->element_more[e].part != canvas->part || !(weight > 0))
            continue;
        Vec3 normal = pose_turn(pose, vec3_load(object->elements[e].normal));
        Vec3 point = pose_point(pose, vec3_load(object->elements[e].position));
        const NearReceivers receiver = {{{point.x}, {point.y}, {point.z}}, {{normal.x}, {normal.y}, {normal.z}}};
        chiaro_near_sum(&canvas->near_things, &receiver, 1, near);
        ChiaroCubeTaps taps = chiaro_cube_taps(kernel, normal);
        Lanes there = chiaro_cube_mix(&taps, far);
        Fill fill = fill_rows(lanes_of(there[3]), lanes_of(near[0][3]));
        Lanes missing = (lanes_load(near[0]) + fill.keep * there) * fill.scale - chiaro_cube_mix(&taps, texels);
        missing[3] = 1; /* the weight */
        if (!any)
            memset(wrong, 0, sizeof wrong);
        any = true;
        for (uint32_t k = 0; k < 4; k++) {
            float *sum = wrong + 4 * taps.texel[k];
            Lanes more = lanes_load(sum) + weight * taps.weight[k] * missing;
            memcpy(sum, &more, sizeof more);
        }
    }
    for (uint32_t t = 0; any && t < 4 * canvas->world->texel_count; t += 4) {
        if (wrong[t + 3] > 0)
            vec3_store(texels + t, vec3_mad(vec3_load(texels + t), vec3_load(wrong + t), 1 / wrong[t + 3]));
    }
}

static void add_near(Canvas *canvas, float *texels)
{
    float far[4 * CHIARO_CUBE_MAX_TEXELS];
    if (!has_near(canvas))
        return;
    memcpy(far, texels, 4 * canvas->world->texel_count * sizeof *far);
    fill_texels(canvas, far, texels);
    fit_faces(canvas, far, texels);
}

/* `id`: of the object that is there; CHIARO_NONE: none. */
static void begin(Canvas *canvas, uint32_t id)
{
    size_t texels = canvas->world->texel_count;
    if (canvas->world->tile_count) {
        memset(canvas->full, 0, texels * sizeof *canvas->full);
        memset(canvas->covered, 0, texels * sizeof *canvas->covered);
        memset(canvas->before_near, 0, texels * sizeof *canvas->before_near);
        memset(canvas->before_far, 0, texels * sizeof *canvas->before_far);
        memset(canvas->near_share, 0, texels * sizeof *canvas->near_share);
        memset(canvas->radiance, 0, 4 * texels * sizeof *canvas->radiance);
    }
    canvas->near_things.plate_count = canvas->near_things.ball_count = 0;
    canvas->any_near = canvas->any_far = false;
    canvas->key_count = 0;
    memset(canvas->depth, 0, sizeof canvas->depth);
    memset(canvas->depth_angle, 0, sizeof canvas->depth_angle);
    paint_neighbours(canvas, id);
}

static void smooth(Canvas *canvas, float *texels)
{
    const ChiaroWorld *world = canvas->world;
    resolve(canvas);
    if (world->without & CHIARO_WORLD_WITHOUT_SMOOTHING)
        memcpy(texels, canvas->radiance, sizeof canvas->radiance[0] * 4 * world->texel_count);
    else
        chiaro_cube_smooth(world->kernel, canvas->radiance, texels);
}

static uint32_t ray_steps(const ChiaroWorld *world)
{
    uint32_t rays = BLOCKS_A_STEP * WORLD_BLOCK;
    return world->tile_count ? (world->ray_count + rays - 1) / rays : 0;
}

uint32_t chiaro_world_steps(const ChiaroWorld *world)
{
    return OTHER_STEPS + ray_steps(world) + (world->texel_count + TEXELS_A_STEP - 1) / TEXELS_A_STEP;
}

static void paint_step(Canvas *canvas, uint32_t id, uint32_t step, float *texels)
{
    const ChiaroWorld *world = canvas->world;
    uint32_t rays = ray_steps(world);
    if (step == 0)
        begin(canvas, id);
    else if (step <= rays)
        paint_blocks(canvas, (step - 1) * BLOCKS_A_STEP * WORLD_BLOCK);
    else if (step == rays + 1)
        smooth(canvas, texels);
    else if (step + 1 < chiaro_world_steps(world))
        sum_near(canvas, (step - rays - 2) * TEXELS_A_STEP);
    else
        add_near(canvas, texels);
}

bool chiaro_world_canvases(ChiaroWorld *world)
{
    uint32_t count = world->desc.jobs.parallel_for ? WORLD_BATCH : 1;
    world->canvases = chiaro_world_alloc(world, count, sizeof *world->canvases);
    world->asked = chiaro_world_alloc(world, 1, sizeof *world->asked);
    world->painting = CHIARO_NONE;
    return world->canvases && world->asked;
}

/* Light of lamps on a point, each asked whether it is seen. */
Vec3 chiaro_world_direct(const ChiaroWorld *world, Vec3 point, Vec3 normal)
{
    const StaticLight *light = &world->light;
    Vec3 sum = {0, 0, 0};
    float p[3], n[3];
    vec3_store(p, point);
    vec3_store(n, normal);
    for (uint32_t l = 0; l < light->light_count; l++) {
        float toward[3], distance, rgb[3];
        chiaro_light_at(&light->lights[l], p, toward, &distance, rgb);
        float cosine = vec3_dot(normal, vec3_load(toward));
        if (cosine > 0 && vec3_max(vec3_load(rgb)) > 0 &&
            (!light->visible || light->visible(&light->lights[l], p, n, light->user)))
            sum = vec3_mad(sum, vec3_load(rgb), cosine);
    }
    return sum;
}

/* Where the normals of four elements, or of as many as are left, meet a cube. */
static ChiaroCubePlaces element_places(const ChiaroWorld *world, const Body *body, uint32_t first)
{
    Lanes ways[3] = {lanes_of(1), lanes_of(0), lanes_of(0)};
    for (uint32_t lane = 0; lane < LANES && first + lane < body->object.element_count; lane++) {
        Vec3 normal = pose_turn(&body->pose, vec3_load(body->object.elements[first + lane].normal));
        ways[0][lane] = normal.x, ways[1][lane] = normal.y, ways[2][lane] = normal.z;
    }
    return chiaro_cube_places(world->kernel, ways);
}

/* What the object gives off, by its fresh cubes. */
static void light_elements(ChiaroWorld *world, const Body *body)
{
    const ChiaroObject *object = &body->object;
    float *radiosity = world->radiosity + 3 * (size_t)body->first_element;
    ChiaroCubePlaces places = {.first = {0}};
    for (uint32_t e = 0; e < object->element_count; e++) {
        const ChiaroElement *element = &object->elements[e];
        const ChiaroObjectElement *more = &object->element_more[e];
        Vec3 normal = pose_turn(&body->pose, vec3_load(element->normal));
        Vec3 place = pose_point(&body->pose, vec3_load(element->position));
        const float *texels = world->next.texels + 4 * (size_t)(body->first_slot + more->part) * world->texel_count;
        if (e % LANES == 0)
            places = element_places(world, body, e);
        ChiaroCubeTaps taps = chiaro_cube_place_taps(world->kernel, &places, e % LANES);
        Lanes value = chiaro_cube_mix(&taps, texels);
        Vec3 ambient = vec3_positive(vec3(value[0], value[1], value[2]));
        Vec3 light = vec3_mad(chiaro_world_direct(world, place, normal), vec3_mul(ambient, vec3_load(more->cavity)),
                              CHIARO_PI);
        light = vec3_mul(light, vec3_load(element->albedo));
        if (!(world->without & CHIARO_WORLD_WITHOUT_EMITTERS))
            light = vec3_add(light, vec3_load(more->emission));
        vec3_store(radiosity + 3 * (size_t)e, light);
    }
    float *axes = world->next.axes + 36 * (size_t)body->first_element;
    if (chiaro_is_ball(object->primitives.nodes)) /* of which nothing but the root is asked */
        chiaro_primitives_sum_all(object->elements, object->element_count, radiosity, axes);
    else
        chiaro_primitives_sum(&object->primitives, object->elements, radiosity, axes);
}

/* Steps [first, end) of all that its cubes take. */
static void paint_steps(ChiaroWorld *world, Canvas *canvas, uint32_t id, uint32_t first, uint32_t end)
{
    const Body *body = &world->bodies[id];
    uint32_t a_part = chiaro_world_steps(world);
    for (uint32_t step = first; step < end; step++) {
        uint32_t part = step / a_part;
        const ChiaroObjectPart *from = &body->object.parts[part];
        float *texels = world->next.texels + 4 * (size_t)(body->first_slot + part) * world->texel_count;
        canvas->world = world, canvas->body = body, canvas->part = part;
        canvas->center = pose_point(&body->pose, vec3_load(from->center));
        canvas->radius = from->radius * body->pose.scale;
        paint_step(canvas, id, step % a_part, texels);
        if ((step + 1) % a_part == 0) {
            world->next.keys[body->first_slot + part] =
                chiaro_key_find(canvas->key_rays, canvas->key_count, canvas->center);
            store_depths(canvas, &world->next.walls[body->first_slot + part]);
        }
        for (uint32_t t = 0; (step + 1) % a_part == 0 && t < world->texel_count; t++)
            texels[4 * t + 3] = 1;
    }
}

bool chiaro_world_paint(ChiaroWorld *world, uint32_t id, uint32_t steps)
{
    const Body *body = &world->bodies[id];
    uint32_t end = chiaro_world_steps(world) * body->object.part_count;
    if (world->painting != id)
        world->painting = id, world->paint_step = 0;
    uint32_t first = world->paint_step, left = end - first;
    world->paint_step += steps < left ? steps : left;
    paint_steps(world, world->canvases, id, first, world->paint_step);
    if (world->paint_step < end)
        return false;
    light_elements(world, body);
    world->painting = CHIARO_NONE;
    return true;
}

void chiaro_world_paint_whole(ChiaroWorld *world, uint32_t canvas, uint32_t id)
{
    const Body *body = &world->bodies[id];
    paint_steps(world, &world->canvases[canvas], id, 0, chiaro_world_steps(world) * body->object.part_count);
    light_elements(world, body);
}

/* Seen from the place itself: a point has no skin. */
void chiaro_world_paint_at(ChiaroWorld *world, Vec3 center, float radius, float *texels)
{
    Body point = {.pose = {{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}, center, 1}};
    Canvas *canvas = world->asked;
    canvas->world = world, canvas->body = &point, canvas->part = 0;
    canvas->center = center, canvas->radius = radius;
    for (uint32_t step = 0; step < chiaro_world_steps(world); step++)
        paint_step(canvas, CHIARO_NONE, step, texels);
}
