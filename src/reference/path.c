/* One path: at each vertex it asks the lamps, aims at an emitter and at the sky, and goes on in a cosine-distributed
 * direction; what both an aimed and a free ray can find is shared between them by multiple importance sampling (Veach
 * and Guibas 1995). One more ray starts at a lamp, and the place that it lights is joined to every vertex, which tames
 * the bright spot around a lamp that hangs close to a wall: free rays alone seldom find it, and then it glares. In a
 * picture the first vertex is joined to a pool of points, too, that know what light they pass on. */
#include "pool.h"

#include "../core/samples.h"

/* Up to here every lamp is asked at every vertex; of more, one that is likely to matter. */
#define MAX_ASKED_LAMPS 8u
/* Paths that carry less than this end by chance (Russian roulette). Measured on a Cornell box: noise^2 * seconds is
 * flat from 0.1 to 0.25 and twice as high at 0.5. */
#define ROULETTE_BELOW 0.15f
/* Share of the paths that go on where the map has guessed. */
#define ON_SHARE 0.25f
/* Each pool point holds the mean of many paths and is worth more than a path that goes on: by so much its density
 * counts more in sharing. Any value is right; this one had the least noise for the time. */
#define POOL_TRUST 500.0f

/* Pairs of random numbers that a path uses: two for the lamp's ray, then four a vertex. */
enum { PAIR_LAMP_DIRECTION, PAIR_LAMP_CHOICE, PAIR_VERTICES };
enum { PAIR_DIRECTION, PAIR_EMITTER, PAIR_SKY, PAIR_CHOICES, PAIRS_PER_VERTEX };

static uint32_t pair_at(uint32_t vertex, uint32_t purpose)
{
    return PAIR_VERTICES + vertex * PAIRS_PER_VERTEX + purpose;
}

static float squared(float x) { return x * x; }

/* Share of a technique of density `a` beside one of density `b`: the power heuristic, safe for infinite densities. */
static float mis_weight(float a, float b)
{
    return a > b ? 1 / (1 + squared(b / a)) : a > 0 ? squared(a / b) / (1 + squared(a / b)) : 0;
}

/* Twice the area times the normal, by doubles: edges of any length must not under- or overflow. */
static void cross_edges(const ChiaroScene *scene, uint32_t triangle, double cross[3])
{
    const uint32_t *index = scene->indices + (size_t)triangle * 3;
    Vec3 a = vec3_load(scene->vertices[index[0]].position);
    Vec3 e = vec3_sub(vec3_load(scene->vertices[index[1]].position), a);
    Vec3 f = vec3_sub(vec3_load(scene->vertices[index[2]].position), a);
    cross[0] = (double)e.y * (double)f.z - (double)e.z * (double)f.y;
    cross[1] = (double)e.z * (double)f.x - (double)e.x * (double)f.z;
    cross[2] = (double)e.x * (double)f.y - (double)e.y * (double)f.x;
}

double path_triangle_area(const ChiaroScene *scene, uint32_t triangle)
{
    double c[3];
    cross_edges(scene, triangle, c);
    return 0.5 * sqrt(c[0] * c[0] + c[1] * c[1] + c[2] * c[2]);
}

Vec3 path_triangle_normal(const ChiaroScene *scene, uint32_t triangle)
{
    double c[3], length = 2 * path_triangle_area(scene, triangle);
    cross_edges(scene, triangle, c);
    return length > 0 ? vec3((float)(c[0] / length), (float)(c[1] / length), (float)(c[2] / length)) : vec3(0, 0, 0);
}

Place path_place(const World *world, uint32_t part, uint32_t triangle, float u, float v, Vec3 geometric)
{
    const ChiaroScene *scene = world->scene;
    const uint32_t *index = scene->indices + (size_t)triangle * 3;
    const ChiaroVertex *a = &scene->vertices[index[0]], *b = &scene->vertices[index[1]];
    const ChiaroVertex *c = &scene->vertices[index[2]];
    float w = 1 - u - v, albedo[3], emission[3];
    Vec3 position = vec3_scale(vec3_load(a->position), w), shading = vec3_scale(vec3_load(a->normal), w);
    position = vec3_mad(vec3_mad(position, vec3_load(b->position), u), vec3_load(c->position), v);
    shading = vec3_normalize(vec3_mad(vec3_mad(shading, vec3_load(b->normal), u), vec3_load(c->normal), v));
    if (!(vec3_dot(shading, shading) > 0))
        shading = geometric;
    float alpha = chiaro_surface(scene, part, triangle, u, v, albedo, emission);
    return (Place){position, vec3_mad(position, geometric, chiaro_rays_epsilon(world->rays)), geometric, shading,
                   vec3_load(albedo), vec3_load(emission),
                   chiaro_material_transmission(&scene->materials[scene->parts[part].material]), triangle,
                   alpha < scene->materials[scene->parts[part].material].alpha_cutoff};
}

/* The other side of a place. */
static Place turned(const Place *place)
{
    Place other = *place;
    other.origin = vec3_sub(vec3_scale(place->position, 2), place->origin);
    other.geometric = vec3_scale(place->geometric, -1), other.shading = vec3_scale(place->shading, -1);
    return other;
}

/* A place that lets light through is turned as often as what it scatters leaves on the other side. Returns what the path
 * carries for it. */
static Vec3 choose_side(Place *place, Sampler *sampler)
{
    Vec3 one = vec3(1, 1, 1), share = place->transmission;
    float often = (share.x + share.y + share.z) / 3;
    if (!(often > 0))
        return one;
    bool turn = chiaro_random_float(&sampler->random) < often;
    if (turn)
        *place = turned(place);
    return turn ? vec3_scale(share, 1 / often) : vec3_scale(vec3_sub(one, share), 1 / (1 - often));
}

/* What a direction counts: its cosine, and that of the direction which is mirrored up to it (see reference.h).
 * Over pi it is the density of free_direction(). */
static float kernel(const Place *place, Vec3 direction)
{
    float height = vec3_dot(direction, place->geometric);
    if (height <= 0)
        return 0;
    Vec3 mirrored = vec3_mad(direction, place->geometric, -2 * height);
    return fmaxf(0, vec3_dot(direction, place->shading)) + fmaxf(0, vec3_dot(mirrored, place->shading));
}

static Vec3 free_direction(const Place *place, Pair pair)
{
    Vec3 direction = vec3_cosine_direction(place->shading, pair.u, pair.v);
    float height = vec3_dot(direction, place->geometric);
    return height < 0 ? vec3_mad(direction, place->geometric, -2 * height) : direction;
}

/* True if two points off their surfaces see each other. */
static bool joined(const World *world, Vec3 from, Vec3 to, uint64_t *rays)
{
    (*rays)++;
    return !chiaro_rays_parted(world->rays, from, to);
}

/* ------------------------------------------------------------------------------------------------------------------
 * Lamps
 */

/* Solid angle that a lamp shines into. */
static float lamp_angle(const ChiaroLight *lamp)
{
    if (lamp->type == CHIARO_LIGHT_SUN)
        return 0;
    return 2 * CHIARO_PI * (lamp->type == CHIARO_LIGHT_SPOT ? 1 - lamp->cos_outer : 2);
}

void path_share_lamps(const ChiaroLight *lights, uint32_t count, float *shares)
{
    double sum = 0;
    for (uint32_t i = 0; i < count; i++)
        sum += lamp_angle(&lights[i]) * vec3_luminance(vec3_load(lights[i].intensity));
    for (uint32_t i = 0; i < count; i++) {
        double power = lamp_angle(&lights[i]) * vec3_luminance(vec3_load(lights[i].intensity));
        shares[i] = sum > 0 ? (float)(power / sum) : 0;
    }
}

/* Irradiance / pi of a lamp that nothing hides. */
static Vec3 lamp_light(const ChiaroLight *lamp, const Place *place, Vec3 *toward, float *distance)
{
    float point[3], direction[3], rgb[3];
    vec3_store(point, place->position);
    chiaro_light_at(lamp, point, direction, distance, rgb);
    *toward = vec3_load(direction);
    if (vec3_dot(*toward, place->geometric) <= 0)
        return vec3(0, 0, 0);
    return vec3_scale(vec3_load(rgb), fmaxf(0, vec3_dot(*toward, place->shading)) / CHIARO_PI);
}

/* Density per m^2 of a lamp's rays around a place. */
static float lamp_density(const World *world, uint32_t lamp, const Place *place, Vec3 toward, float distance)
{
    float share = world->lamp_shares[lamp];
    if (!(share > 0))
        return 0;
    return share / lamp_angle(&world->lights[lamp]) * fmaxf(0, vec3_dot(toward, place->geometric)) / squared(distance);
}

/* Irradiance / pi of one lamp that nothing hides. `density`: per m^2, of the free ray that came here and shares its
 * find with the lamp's ray; INFINITY: there is no lamp's ray. */
static Vec3 shared_light(const World *world, uint32_t lamp, const Place *place, float density)
{
    Vec3 toward;
    float distance;
    Vec3 light = lamp_light(&world->lights[lamp], place, &toward, &distance);
    if (density < INFINITY && vec3_max(light) > 0)
        light = vec3_scale(light, mis_weight(density, lamp_density(world, lamp, place, toward, distance)));
    return light;
}

static Vec3 lamp_if_visible(const World *world, uint32_t lamp, const Place *place, Vec3 light, uint64_t *rays)
{
    if (!(vec3_max(light) > 0))
        return vec3(0, 0, 0);
    (*rays)++;
    bool visible = chiaro_rays_light_visible(world->rays, &world->lights[lamp], place->position, place->geometric);
    return visible ? light : vec3(0, 0, 0);
}

/* Of many lamps one, as often as it would light the place if nothing hid it. */
static Vec3 choose_lamp(const World *world, const Place *place, float density, float choice, uint64_t *rays)
{
    double sum = 0, wanted;
    for (uint32_t i = 0; i < world->light_count; i++)
        sum += vec3_luminance(shared_light(world, i, place, density));
    wanted = choice * sum;
    for (uint32_t i = 0; i < world->light_count; i++) {
        Vec3 light = shared_light(world, i, place, density);
        double share = vec3_luminance(light);
        wanted -= share;
        if (wanted < 0)
            return lamp_if_visible(world, i, place, vec3_scale(light, (float)(sum / share)), rays);
    }
    return vec3(0, 0, 0);
}

static Vec3 from_lamps(const World *world, const Place *place, float density, float choice, uint64_t *rays)
{
    if (world->light_count > MAX_ASKED_LAMPS)
        return choose_lamp(world, place, density, choice, rays);
    Vec3 sum = vec3(0, 0, 0);
    for (uint32_t i = 0; i < world->light_count; i++)
        sum = vec3_add(sum, lamp_if_visible(world, i, place, shared_light(world, i, place, density), rays));
    return sum;
}

static Vec3 from_all_lamps(const World *world, const Place *place, uint64_t *rays)
{
    Vec3 sum = vec3(0, 0, 0);
    for (uint32_t i = 0; i < world->light_count; i++)
        sum = vec3_add(sum, lamp_if_visible(world, i, place, shared_light(world, i, place, INFINITY), rays));
    return sum;
}

Vec3 path_punctual(const World *world, const Place *place, uint64_t *rays)
{
    Vec3 front = from_all_lamps(world, place, rays);
    if (!(vec3_max(place->transmission) > 0))
        return front;
    Place other = turned(place);
    Vec3 change = vec3_sub(from_all_lamps(world, &other, rays), front);
    return vec3_add(front, vec3_mul(place->transmission, change));
}

/* Density per m^2 of the free ray from a place, around a point with this normal: also the geometric factor. From the
 * origin, where rays start: beside an edge the other wall may be nearer than the origin is to its own. */
static float free_density(const Place *from, Vec3 position, Vec3 normal)
{
    Vec3 line = vec3_sub(position, from->origin), direction = vec3_normalize(line);
    return kernel(from, direction) / CHIARO_PI * fmaxf(0, -vec3_dot(direction, normal)) / vec3_dot(line, line);
}

/* A place that a lamp's ray found. */
typedef struct Lit {
    bool found;
    float density; /* per m^2, of the lamp's ray */
    Vec3 light;    /* irradiance / pi from that lamp, times albedo: radiance */
    Place place;
} Lit;

static Vec3 lamp_direction(const ChiaroLight *lamp, Pair pair)
{
    bool spot = lamp->type == CHIARO_LIGHT_SPOT;
    Vec3 axis = spot ? vec3_normalize(vec3_load(lamp->direction)) : vec3(0, 1, 0), t, b;
    float low = spot ? lamp->cos_outer : -1, along = low + (1 - low) * pair.u;
    float across = sqrtf(fmaxf(0, 1 - along * along)), phi = 2 * CHIARO_PI * pair.v;
    vec3_frame(axis, &t, &b);
    return vec3_mad(vec3_mad(vec3_scale(axis, along), t, across * cosf(phi)), b, across * sinf(phi));
}

static Lit follow_lamp_ray(const World *world, Sampler *sampler, uint64_t *rays)
{
    Lit lit = {0};
    float choice = sampler_pair(sampler, PAIR_LAMP_CHOICE).u;
    uint32_t number = 0;
    while (number + 1 < world->light_count && choice >= world->lamp_shares[number])
        choice -= world->lamp_shares[number++];
    if (!(world->lamp_shares[number] > 0))
        return lit;
    const ChiaroLight *lamp = &world->lights[number];
    Vec3 direction = lamp_direction(lamp, sampler_pair(sampler, PAIR_LAMP_DIRECTION)), toward;
    /* As a shadow ray ends short of the lamp, so this one starts: a lamp may touch the surface that carries it. */
    float start = chiaro_rays_epsilon(world->rays), distance;
    ChiaroHit hit;
    (*rays)++;
    if (!chiaro_rays_hit(world->rays, vec3_load(lamp->position), direction, start, INFINITY, &hit) || !hit.front)
        return lit;
    lit.place = path_place(world, hit.part, hit.triangle, hit.u, hit.v, hit.normal);
    lit.light = vec3_mul(lamp_light(lamp, &lit.place, &toward, &distance), lit.place.albedo);
    lit.density = lamp_density(world, number, &lit.place, toward, distance);
    lit.light = vec3_mul(lit.light, choose_side(&lit.place, sampler));
    lit.found = lit.density > 0 && vec3_max(lit.light) > 0;
    return lit;
}

/* What a lit place sends to another: irradiance / pi. */
static Vec3 from_lit(const World *world, const Place *place, const Lit *lit, uint64_t *rays)
{
    float free = free_density(place, lit->place.position, lit->place.geometric);
    if (!(free > 0) || !joined(world, place->origin, lit->place.origin, rays))
        return vec3(0, 0, 0);
    return vec3_scale(lit->light, free / lit->density * mis_weight(lit->density, free));
}

/* ------------------------------------------------------------------------------------------------------------------
 * Emitters, sky, and the walk
 */

/* From per m^2 around a place, seen along a unit direction at a distance, to per steradian. */
static float per_steradian(float density, Vec3 direction, const Place *seen, float distance)
{
    float cosine = -vec3_dot(direction, seen->geometric);
    return cosine > 0 ? density * squared(distance) / cosine : INFINITY;
}

static Vec3 from_emitter(const World *world, const Place *place, float choice, Pair pair, uint64_t *rays)
{
    EmitterPoint point = emitters_draw(&world->emitters, choice, pair);
    Place seen = path_place(world, point.part, point.triangle, point.u, point.v,
                            path_triangle_normal(world->scene, point.triangle));
    Vec3 line = vec3_sub(seen.position, place->origin), direction = vec3_normalize(line);
    float weight = kernel(place, direction);
    float density = per_steradian(point.density, direction, &seen, vec3_length(line));
    if (!(weight > 0) || !(density < INFINITY) || !(density > 0) || !(vec3_max(seen.emission) > 0) ||
        seen.hole || !joined(world, place->origin, seen.origin, rays))
        return vec3(0, 0, 0);
    return vec3_scale(seen.emission, weight / CHIARO_PI / density * mis_weight(density, weight / CHIARO_PI));
}

static Vec3 sky_radiance(const World *world, Vec3 direction)
{
    float d[3], rgb[3] = {0, 0, 0};
    vec3_store(d, direction);
    if (world->sky)
        chiaro_sky_radiance(world->sky, d, rgb);
    return vec3_load(rgb);
}

static Vec3 from_sky(const World *world, const Place *place, Pair pair, uint64_t *rays)
{
    float density;
    Vec3 direction = sky_sampler_draw(world->sky_sampler, pair, &density);
    float weight = kernel(place, direction);
    if (!(weight > 0) || !(density > 0))
        return vec3(0, 0, 0);
    (*rays)++;
    if (chiaro_rays_blocked(world->rays, place->origin, direction, 0, INFINITY))
        return vec3(0, 0, 0);
    float share = weight / CHIARO_PI / density * mis_weight(density, weight / CHIARO_PI);
    return vec3_scale(sky_radiance(world, direction), share);
}

/* The sky that a free ray of this density found. */
static Vec3 found_sky(const World *world, Vec3 direction, float density)
{
    float aimed = world->sky_sampler ? sky_sampler_density(world->sky_sampler, direction) : 0;
    return vec3_scale(sky_radiance(world, direction), mis_weight(density, aimed));
}

/* The emission that a free ray of this density found. */
static Vec3 found_emission(const World *world, const Place *seen, Vec3 direction, float distance, float density)
{
    float area_density = world->emitters.densities ? world->emitters.densities[seen->triangle] : 0;
    float aimed = area_density > 0 ? per_steradian(area_density, direction, seen, distance) : 0;
    return vec3_scale(seen->emission, mis_weight(density, aimed));
}

/* A path that carries little ends by chance, or carries more. False: it ends. */
static bool survives(Vec3 *carried, Sampler *sampler)
{
    float strength = vec3_max(*carried);
    if (strength >= ROULETTE_BELOW)
        return true;
    if (chiaro_random_float(&sampler->random) * ROULETTE_BELOW >= strength)
        return false;
    *carried = vec3_scale(*carried, ROULETTE_BELOW / strength);
    return true;
}

/* What some points of the pool know better than the map: irradiance / pi, of either sign. */
static Vec3 from_pool(const World *world, const Place *place, const Joins *joins, uint64_t *rays)
{
    const Pool *pool = joins->pool;
    Vec3 sum = vec3(0, 0, 0);
    for (uint32_t i = 0; i < POOL_JOINS; i++) {
        const PoolPoint *point = &pool->points[(joins->first + i) & (pool->count - 1)];
        float free = free_density(place, point->position, point->normal);
        float share = free / ((float)POOL_JOINS * point->density) * mis_weight(POOL_TRUST * point->density, free);
        Vec3 origin = vec3_mad(point->position, point->normal, chiaro_rays_epsilon(world->rays));
        if (share > 0 && joined(world, place->origin, origin, rays))
            sum = vec3_mad(sum, point->light, share);
    }
    return sum;
}

/* A free ray has come to its first place: what the map guesses there. True if the path goes on, to correct it. */
static bool guess(const Place *place, const Joins *joins, float arrival, Sampler *sampler, Vec3 *carried, Vec3 *light)
{
    Vec3 map = pool_guess(joins->pool, place);
    *light = vec3_add(*light, vec3_mul(*carried, map));
    float weight = mis_weight(arrival, POOL_TRUST * joins->pool->densities[place->triangle]);
    if (chiaro_random_float(&sampler->random) >= ON_SHARE || !(weight > 0))
        return false;
    *carried = vec3_scale(*carried, weight / ON_SHARE);
    if (!survives(carried, sampler))
        return false;
    *light = vec3_sub(*light, vec3_mul(*carried, map));
    return true;
}

Vec3 path_indirect(const World *world, const Place *first, Sampler *sampler, uint32_t depth, const Joins *joins,
                   uint64_t *rays)
{
    Vec3 light = vec3(0, 0, 0), carried = vec3(1, 1, 1);
    Place place = *first;
    bool lamp_ray = world->lamp_shares && depth != 1;
    Lit lit = lamp_ray ? follow_lamp_ray(world, sampler, rays) : (Lit){0};
    float arrival = INFINITY; /* density per m^2 of the free ray that came here */
    for (uint32_t vertex = 0; depth == 0 || vertex < depth; vertex++) {
        Pair choices = sampler_pair(sampler, pair_at(vertex, PAIR_CHOICES));
        const Place reached = place;
        Vec3 side = choose_side(&place, sampler);
        if (vertex > 0) {
            Vec3 lamps = from_lamps(world, &place, lamp_ray ? arrival : INFINITY, choices.v, rays);
            light = vec3_add(light, vec3_mul(carried, vec3_mul(side, lamps)));
        }
        if (vertex == 1 && joins && !guess(&reached, joins, arrival, sampler, &carried, &light))
            return light;
        carried = vec3_mul(carried, side);
        Vec3 here = vec3(0, 0, 0);
        if (vertex == 0 && joins)
            here = from_pool(world, &place, joins, rays);
        if (lit.found && (depth == 0 || vertex + 1 < depth))
            here = vec3_add(here, from_lit(world, &place, &lit, rays));
        if (world->emitters.count) {
            Pair pair = sampler_pair(sampler, pair_at(vertex, PAIR_EMITTER));
            here = vec3_add(here, from_emitter(world, &place, choices.u, pair, rays));
        }
        if (world->sky_sampler)
            here = vec3_add(here, from_sky(world, &place, sampler_pair(sampler, pair_at(vertex, PAIR_SKY)), rays));
        light = vec3_add(light, vec3_mul(carried, here));

        Vec3 direction = free_direction(&place, sampler_pair(sampler, pair_at(vertex, PAIR_DIRECTION)));
        float density = kernel(&place, direction) / CHIARO_PI;
        ChiaroHit hit;
        (*rays)++;
        if (!chiaro_rays_hit(world->rays, place.origin, direction, 0, INFINITY, &hit))
            return vec3_add(light, vec3_mul(carried, found_sky(world, direction, density)));
        if (!hit.front)
            return light;
        Place next = path_place(world, hit.part, hit.triangle, hit.u, hit.v, hit.normal);
        light = vec3_add(light, vec3_mul(carried, found_emission(world, &next, direction, hit.distance, density)));
        carried = vec3_mul(carried, next.albedo);
        if (!survives(&carried, sampler))
            return light;
        arrival = density * -vec3_dot(direction, next.geometric) / squared(hit.distance);
        place = next;
    }
    return light;
}
