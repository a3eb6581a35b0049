/* The drawn mesh: triangles are split until light can be interpolated over them, and every corner gets a receiver.
 *
 * An edge is split if it is long for the distance to what surrounds it (the harmonic mean of the free path, as in irradiance
 * caching: Ward, Rubinstein, Clear 1988). The decision belongs to the edge, by its place alone, so both sides
 * agree and no T-junction can open. A triangle with a split edge splits its longest edge too, which keeps it in shape.
 *
 * Corners share a receiver if they share place and normal. A receiver that lies inside a solid (a floor under a block)
 * would bleed its darkness over the triangle's visible part: it moves along an edge to where the triangle comes out.
 * It stands for the triangles around it, so its rays start all over their inner halves: at the foot of a low step, say, it
 * is far brighter or darker than what it is interpolated over.
 */
#include "../core/log.h"
#include "../offline/parallel.h"
#include "bake.h"
#include "chiaro_shared.h"
#include "map.h"

enum { SIZING_RAYS = 32, MAX_ROUNDS = 96, BISECTIONS = 8, USUAL_RUN = 150 /* receivers whose links are fitted together */ };

/* Edge length wanted where surroundings are as far away as the scene's free path, elsewhere with their distance to this power:
 * near ones ask for short edges, but they are dark and many. In edges of a square of the mean area a receiver; and limits. */
static const float USUAL_EDGE = 1.2f, DISTANCE_POWER = 1.0f / 3, SHORTEST_EDGE = 0.6f, LONGEST_EDGE = 6;
/* Refinement begins with edges that are so much longer, and goes on in steps of at most and at least so much. */
static const float COARSEST = 16, MOST_FINER = 1.4142136f, LEAST_FINER = 1.05f;
static const float ROUNDING = 1e-4f;
/* Vertices, at most: so many for each receiver that was asked for, beyond the scene's own; in all; and where the scene itself
 * has more than that, so many times its own. */
static const double MOST_A_RECEIVER = 4, MOST_VERTICES = 160e3, MOST_MORE = 1.25;
/* A receiver of less area than this part of a square of the shortest edge (fine detail, as it was modelled) counts less. */
static const float USUAL_PART = 0.02f;
/* A receiver is moved this part of the way to the middle of its triangles: a corner lies on two walls. */
static const float INWARD = 0.02f;
/* Its rays start up to this part of the way across its triangles; of those whose normal is nearly its own. */
static const float SPREAD = 0.5f, LEVEL = 0.995f;
/* Places this close, in edges of a square of the mean area a receiver, are one to light; and normals, one step of so many to
 * each side. */
static const float SAME_PLACE = 0.1f;
/* Their grid lies so that walls at the scene's bounds, and at whole units from them, are clear of its planes. */
static const float OFF_WALL = 0.37f;
enum { SAME_NORMAL = 4 };
/* More than this share of rays that meet surfaces from behind: the place is inside something. */
static const float INSIDE = 0.5f;

typedef struct Triangle {
    uint32_t vertex[3];
    uint32_t part;
} Triangle;

typedef struct Edge {
    uint32_t a, b;   /* places */
    Vec3 normal;     /* of one triangle at it */
    float wanted;    /* length in units, from that triangle's side */
} Edge;

typedef struct Mesh {
    Baker *baker;
    ChiaroVertex *vertices;
    uint32_t *vertex_place;
    Vec3 *places;
    Triangle *triangles;
    Edge *edges;
    uint32_t vertex_count, vertex_capacity, place_count, place_capacity, triangle_count, triangle_capacity;
    uint32_t edge_count, edge_capacity;
    Map wanted; /* of edges that were sized: the bits of their wanted length, in units */
    float unit; /* edge of a square of the mean area a receiver; larger where the scene may not have as many */
    RowScratch *scratch; /* one a thread */
} Mesh;

/* Makes room for one more in `array`; NULL: out of memory, and the array stays as it was. */
static void *reserve(void *array, uint32_t count, uint32_t *capacity, size_t size)
{
    if (count < *capacity)
        return array;
    uint32_t wanted = *capacity ? *capacity * 2 : 4096;
    void *grown = realloc(array, wanted * size);
    if (grown)
        *capacity = wanted;
    return grown;
}

static uint32_t add_vertex(Mesh *mesh, const ChiaroVertex *vertex, uint32_t place)
{
    uint32_t capacity = mesh->vertex_capacity;
    ChiaroVertex *vertices = reserve(mesh->vertices, mesh->vertex_count, &capacity, sizeof *vertices);
    if (!vertices)
        return CHIARO_NONE;
    mesh->vertices = vertices;
    uint32_t *places = reserve(mesh->vertex_place, mesh->vertex_count, &mesh->vertex_capacity, sizeof *places);
    if (!places)
        return CHIARO_NONE;
    mesh->vertex_place = places;
    mesh->vertices[mesh->vertex_count] = *vertex;
    mesh->vertex_place[mesh->vertex_count] = place;
    return mesh->vertex_count++;
}

static uint32_t add_place(Mesh *mesh, Vec3 place)
{
    Vec3 *places = reserve(mesh->places, mesh->place_count, &mesh->place_capacity, sizeof *places);
    if (!places)
        return CHIARO_NONE;
    mesh->places = places;
    mesh->places[mesh->place_count] = place;
    return mesh->place_count++;
}

static bool add_triangle(Mesh *mesh, uint32_t a, uint32_t b, uint32_t c, uint32_t part)
{
    if (a == CHIARO_NONE || b == CHIARO_NONE || c == CHIARO_NONE)
        return false;
    Triangle *triangles = reserve(mesh->triangles, mesh->triangle_count, &mesh->triangle_capacity, sizeof *triangles);
    if (!triangles)
        return false;
    mesh->triangles = triangles;
    mesh->triangles[mesh->triangle_count++] = (Triangle){{a, b, c}, part};
    return true;
}

static Vec3 corner(const Mesh *mesh, const Triangle *t, int k) { return mesh->places[mesh->vertex_place[t->vertex[k]]]; }

/* Twice the area along the normal. */
static Vec3 triangle_cross(const Mesh *mesh, const Triangle *t)
{
    return vec3_cross(vec3_sub(corner(mesh, t, 1), corner(mesh, t, 0)), vec3_sub(corner(mesh, t, 2), corner(mesh, t, 0)));
}

/* Vertices of the scene that are used, welded by place, and its triangles that have an area. */
static bool load(Mesh *mesh)
{
    const Baker *baker = mesh->baker;
    const ChiaroScene *scene = baker->scene;
    Map weld = {0};
    uint32_t *renamed = malloc(scene->vertex_count * sizeof *renamed);
    bool ok = renamed != NULL;
    for (uint32_t v = 0; ok && v < scene->vertex_count; v++)
        renamed[v] = CHIARO_NONE;
    for (uint32_t t = 0; ok && t < scene->index_count / 3; t++) {
        if (!baker->patches.triangle_edge[t])
            continue;
        uint32_t vertex[3];
        for (uint32_t k = 0; ok && k < 3; k++) {
            uint32_t v = scene->indices[3 * t + k];
            if (renamed[v] == CHIARO_NONE) {
                Vec3 p = vec3_load(scene->vertices[v].position);
                p = vec3_add(p, vec3(0, 0, 0)); /* -0 is 0 */
                uint32_t bits[3];
                memcpy(bits, &p, sizeof bits);
                uint64_t key = chiaro_random_mix(chiaro_random_mix(bits[0] | (uint64_t)bits[1] << 32) ^ bits[2]) >> 1;
                uint32_t *place = map_at(&weld, key, mesh->place_count);
                ok = place && (*place != mesh->place_count || add_place(mesh, p) != CHIARO_NONE);
                if (ok)
                    renamed[v] = add_vertex(mesh, &scene->vertices[v], *place);
            }
            vertex[k] = renamed[v];
        }
        ok = ok && add_triangle(mesh, vertex[0], vertex[1], vertex[2], baker->patches.triangle_part[t]);
    }
    free(renamed);
    map_free(&weld);
    return ok;
}

static void size_edges(uint32_t begin, uint32_t end, uint32_t thread, void *user)
{
    Mesh *mesh = user;
    const Baker *baker = mesh->baker;
    for (uint32_t e = begin; e < end; e++) {
        Edge *edge = &mesh->edges[e];
        Vec3 middle = vec3_scale(vec3_add(mesh->places[edge->a], mesh->places[edge->b]), 0.5f);
        RowFacts facts;
        chiaro_row_trace(baker, &middle, 1, edge->normal, edge->normal, SIZING_RAYS, 0x20000000u + e,
                         &mesh->scratch[thread], &facts);
        /* The sky is far away: where a part of the hemisphere is sky, the mean of 1 / distance is as much less. */
        float distance = facts.sky < 1 ? facts.free_path / (1 - facts.sky) : INFINITY;
        edge->wanted = USUAL_EDGE * powf(distance / baker->free_path, DISTANCE_POWER);
        /* Inside a solid nobody looks, but the edge that leads out of it matters. */
        edge->wanted = facts.behind > 0.9f ? LONGEST_EDGE : fminf(LONGEST_EDGE, fmaxf(SHORTEST_EDGE, edge->wanted));
    }
}

static float edge_length(const Mesh *mesh, uint32_t a, uint32_t b)
{
    return vec3_length(vec3_sub(mesh->places[a], mesh->places[b]));
}

static uint64_t triangle_edge(const Mesh *mesh, const Triangle *t, int k)
{
    return map_pair(mesh->vertex_place[t->vertex[k]], mesh->vertex_place[t->vertex[(k + 1) % 3]]);
}

enum { EDGE_KEPT = UINT32_MAX, EDGE_SPLIT = UINT32_MAX - 1 }; /* values of the map of edges; else: the middle's place */

/* Which edge of a triangle is the longest; the first of those that are equal but for rounding. */
static int longest_edge(const Mesh *mesh, const Triangle *t)
{
    float most = 0;
    int longest = 0;
    for (int k = 0; k < 3; k++) {
        float length = edge_length(mesh, mesh->vertex_place[t->vertex[k]], mesh->vertex_place[t->vertex[(k + 1) % 3]]);
        if (length > most * (1 + ROUNDING))
            most = length, longest = k;
    }
    return longest;
}

/* Asks for the size of an edge, seen from a triangle with this normal. */
static bool add_edge(Mesh *mesh, uint32_t a, uint32_t b, Vec3 normal)
{
    Edge *edges = reserve(mesh->edges, mesh->edge_count, &mesh->edge_capacity, sizeof *edges);
    if (!edges)
        return false;
    mesh->edges = edges;
    mesh->edges[mesh->edge_count++] = (Edge){a, b, normal, 0};
    return true;
}

/* Sizes the edges that are neither short nor long in any case and were not met before: the shorter of both sides' wishes.
 * False: out of memory. */
static bool size_new_edges(Mesh *mesh)
{
    mesh->edge_count = 0;
    for (uint32_t t = 0; t < mesh->triangle_count; t++) {
        const Triangle *triangle = &mesh->triangles[t];
        Vec3 normal = vec3_normalize(triangle_cross(mesh, triangle));
        for (int k = 0; k < 3 && vec3_dot(normal, normal) > 0; k++) {
            uint32_t a = mesh->vertex_place[triangle->vertex[k]], b = mesh->vertex_place[triangle->vertex[(k + 1) % 3]];
            float length = edge_length(mesh, a, b) / mesh->unit;
            if (length <= SHORTEST_EDGE || length > LONGEST_EDGE)
                continue;
            uint32_t *wanted = map_at(&mesh->wanted, map_pair(a, b), 0);
            if (!wanted || (!*wanted && !add_edge(mesh, a, b, normal)))
                return false;
        }
    }
    chiaro_parallel_for(mesh->baker->desc.threads, mesh->edge_count, 64, size_edges, mesh, NULL, NULL);
    for (uint32_t e = 0; e < mesh->edge_count; e++) {
        const Edge *edge = &mesh->edges[e];
        uint32_t bits, *wanted = map_at(&mesh->wanted, map_pair(edge->a, edge->b), 0);
        if (!wanted)
            return false;
        memcpy(&bits, &edge->wanted, sizeof bits); /* of positive numbers: ordered as they are */
        *wanted = *wanted && *wanted < bits ? *wanted : bits;
    }
    return true;
}

/* Marks the edges that are too long, in a map from edges to EDGE_*. Returns how many; -1: out of memory. */
static int64_t mark_edges(Mesh *mesh, Map *marks)
{
    int64_t marked = 0;
    if (!size_new_edges(mesh))
        return -1;
    for (uint32_t t = 0; t < mesh->triangle_count; t++) {
        const Triangle *triangle = &mesh->triangles[t];
        Vec3 cross = triangle_cross(mesh, triangle);
        for (int k = 0; k < 3; k++) {
            uint64_t key = triangle_edge(mesh, triangle, k);
            uint32_t *mark = map_at(marks, key, EDGE_KEPT);
            float length = edge_length(mesh, mesh->vertex_place[triangle->vertex[k]],
                                       mesh->vertex_place[triangle->vertex[(k + 1) % 3]]) / mesh->unit;
            if (!mark)
                return -1;
            if (*mark == EDGE_SPLIT || length <= SHORTEST_EDGE || !(vec3_dot(cross, cross) > 0))
                continue;
            float longest = LONGEST_EDGE;
            if (length <= LONGEST_EDGE) {
                uint32_t *wanted = map_at(&mesh->wanted, key, 0);
                if (!wanted)
                    return -1;
                memcpy(&longest, wanted, sizeof longest);
            }
            if (length > longest)
                *mark = EDGE_SPLIT, marked++;
        }
    }
    /* Longest edges of touched triangles, until nothing changes. */
    for (bool changed = marked > 0; changed;) {
        changed = false;
        for (uint32_t t = 0; t < mesh->triangle_count; t++) {
            const Triangle *triangle = &mesh->triangles[t];
            uint32_t *mark[3];
            int at = longest_edge(mesh, triangle), any = 0;
            for (int k = 0; k < 3; k++) {
                mark[k] = map_at(marks, triangle_edge(mesh, triangle, k), EDGE_KEPT); /* known: stays where it is */
                any += *mark[k] == EDGE_SPLIT;
            }
            if (any && *mark[at] != EDGE_SPLIT)
                *mark[at] = EDGE_SPLIT, marked++, changed = true;
        }
    }
    return marked;
}

static ChiaroVertex middle_vertex(const ChiaroVertex *a, const ChiaroVertex *b, Vec3 place)
{
    ChiaroVertex m;
    vec3_store(m.position, place);
    Vec3 n = vec3_add(vec3_load(a->normal), vec3_load(b->normal));
    vec3_store(m.normal, vec3_dot(n, n) > 1e-6f ? vec3_normalize(n) : vec3_load(a->normal));
    for (int k = 0; k < 2; k++) {
        m.uv[k] = (a->uv[k] + b->uv[k]) / 2;
        m.emission_uv[k] = (a->emission_uv[k] + b->emission_uv[k]) / 2;
    }
    for (int k = 0; k < 4; k++)
        m.color[k] = (a->color[k] + b->color[k]) / 2;
    return m;
}

/* The vertex in the middle of a triangle's edge, made once for each pair of vertices; CHIARO_NONE: not split, or (`ok`
 * cleared) out of memory. */
static uint32_t middle(Mesh *mesh, Map *marks, Map *middles, uint32_t a, uint32_t b, bool *ok)
{
    uint32_t place_a = mesh->vertex_place[a], place_b = mesh->vertex_place[b];
    uint32_t *mark = map_at(marks, map_pair(place_a, place_b), EDGE_KEPT);
    if (!mark)
        *ok = false;
    if (!mark || *mark == EDGE_KEPT)
        return CHIARO_NONE;
    if (*mark == EDGE_SPLIT)
        *mark = add_place(mesh, vec3_scale(vec3_add(mesh->places[place_a], mesh->places[place_b]), 0.5f));
    uint32_t place = *mark, *known = map_at(middles, map_pair(a, b), CHIARO_NONE);
    if (place == CHIARO_NONE || !known) {
        *ok = false;
        return CHIARO_NONE;
    }
    if (*known == CHIARO_NONE) {
        ChiaroVertex vertex = middle_vertex(&mesh->vertices[a], &mesh->vertices[b], mesh->places[place]);
        *known = add_vertex(mesh, &vertex, place);
        *ok = *ok && *known != CHIARO_NONE;
    }
    return *known;
}

static bool split_triangles(Mesh *mesh, Map *marks)
{
    Map middles = {0};
    Triangle *old = mesh->triangles;
    uint32_t count = mesh->triangle_count;
    bool ok = true;
    mesh->triangles = NULL, mesh->triangle_count = mesh->triangle_capacity = 0;
    for (uint32_t t = 0; ok && t < count; t++) {
        uint32_t part = old[t].part, v[3], m[3];
        int split = 0, longest = longest_edge(mesh, &old[t]);
        /* Turned so that the longest edge comes first. */
        for (int k = 0; k < 3; k++)
            v[k] = old[t].vertex[(longest + k) % 3];
        for (int k = 0; k < 3; k++) {
            m[k] = middle(mesh, marks, &middles, v[k], v[(k + 1) % 3], &ok);
            split += m[k] != CHIARO_NONE;
        }
        if (!ok)
            break;
        if (split == 0) {
            ok = add_triangle(mesh, v[0], v[1], v[2], part);
        } else if (split == 3) {
            ok = add_triangle(mesh, v[0], m[0], m[2], part) && add_triangle(mesh, m[0], v[1], m[1], part) &&
                 add_triangle(mesh, m[2], m[1], v[2], part) && add_triangle(mesh, m[0], m[1], m[2], part);
        } else {
            /* The longest edge is split for certain: cut from its middle to the far corner, then each half. */
            if (m[1] != CHIARO_NONE)
                ok = add_triangle(mesh, m[0], v[1], m[1], part) && add_triangle(mesh, m[0], m[1], v[2], part);
            else
                ok = add_triangle(mesh, m[0], v[1], v[2], part);
            if (ok && m[2] != CHIARO_NONE)
                ok = add_triangle(mesh, m[0], v[2], m[2], part) && add_triangle(mesh, m[0], m[2], v[0], part);
            else if (ok)
                ok = add_triangle(mesh, m[0], v[2], v[0], part);
        }
    }
    free(old);
    map_free(&middles);
    return ok;
}

/* --- receivers --- */

typedef struct Draft {
    Vec3 place, normal, plane, inward; /* inward: sum of the centres of its triangles */
    uint32_t triangles;
    bool inside;
    float moved; /* how far along which edge it came out of a solid */
    Vec3 outside;
    Vec3 spread[CHIARO_SPREAD]; /* where its rays start */
} Draft;

typedef struct Receivers {
    Mesh *mesh;
    Draft *drafts;
    uint32_t *of_vertex;
    uint32_t count;
    uint32_t *star_first, *star; /* corners at each draft: 3 * triangle + corner */
} Receivers;

static bool draft_receivers(Receivers *receivers)
{
    Mesh *mesh = receivers->mesh;
    Map known = {0};
    bool ok = true;
    receivers->of_vertex = malloc(mesh->vertex_count * sizeof *receivers->of_vertex);
    receivers->drafts = calloc(mesh->vertex_count, sizeof *receivers->drafts);
    ok = receivers->of_vertex && receivers->drafts;
    for (uint32_t v = 0; ok && v < mesh->vertex_count; v++) {
        Vec3 n = vec3_load(mesh->vertices[v].normal);
        uint64_t key = (uint64_t)mesh->vertex_place[v] << 31 | (uint64_t)((int)lrintf(n.x * 511) + 511) << 20 |
                       (uint64_t)((int)lrintf(n.y * 511) + 511) << 10 | (uint64_t)((int)lrintf(n.z * 511) + 511);
        uint32_t *index = map_at(&known, key, receivers->count);
        ok = index != NULL;
        if (ok && *index == receivers->count) {
            Draft *draft = &receivers->drafts[receivers->count++];
            draft->place = mesh->places[mesh->vertex_place[v]], draft->normal = n, draft->moved = INFINITY;
        }
        if (ok)
            receivers->of_vertex[v] = *index;
    }
    map_free(&known);
    for (uint32_t t = 0; ok && t < mesh->triangle_count; t++) {
        const Triangle *triangle = &mesh->triangles[t];
        Vec3 cross = triangle_cross(mesh, triangle), center = {0, 0, 0};
        for (int k = 0; k < 3; k++)
            center = vec3_mad(center, corner(mesh, triangle, k), 1.0f / 3);
        for (int k = 0; k < 3; k++) {
            Draft *draft = &receivers->drafts[receivers->of_vertex[triangle->vertex[k]]];
            draft->plane = vec3_add(draft->plane, cross);
            draft->inward = vec3_add(draft->inward, vec3_sub(center, draft->place));
            draft->triangles++;
        }
    }
    for (uint32_t r = 0; ok && r < receivers->count; r++) {
        Draft *draft = &receivers->drafts[r];
        draft->plane = vec3_normalize(draft->plane);
        if (draft->triangles)
            draft->place = vec3_mad(draft->place, draft->inward, INWARD / (float)draft->triangles);
        if (!(vec3_dot(draft->plane, draft->normal) > 0.05f))
            draft->normal = draft->plane; /* a normal that points into the surface gets no light at all */
    }
    return ok;
}

static bool is_inside(const Mesh *mesh, Vec3 place, Vec3 normal, uint32_t stream, uint32_t thread)
{
    RowFacts facts;
    chiaro_row_trace(mesh->baker, &place, 1, normal, normal, SIZING_RAYS, stream, &mesh->scratch[thread], &facts);
    return facts.behind > INSIDE;
}

static void find_inside(uint32_t begin, uint32_t end, uint32_t thread, void *user)
{
    Receivers *receivers = user;
    for (uint32_t r = begin; r < end; r++) {
        Draft *draft = &receivers->drafts[r];
        draft->inside = is_inside(receivers->mesh, draft->place, draft->plane, 0x40000000u + r, thread);
    }
}

/* From a receiver inside a solid along an edge to one outside. */
typedef struct Way {
    const Receivers *receivers;
    uint32_t hidden, open;
    float out; /* where it comes out: part of the edge */
} Way;

static void find_out(uint32_t begin, uint32_t end, uint32_t thread, void *user)
{
    for (Way *way = (Way *)user + begin; way < (Way *)user + end; way++) {
        const Draft *hidden = &way->receivers->drafts[way->hidden], *open = &way->receivers->drafts[way->open];
        float low = 0, high = 1;
        for (uint32_t step = 0; step < BISECTIONS; step++) {
            float half = (low + high) / 2;
            Vec3 place = vec3_mad(vec3_scale(hidden->place, 1 - half), open->place, half);
            if (is_inside(way->receivers->mesh, place, hidden->plane, 0x60000000u + step, thread))
                low = half;
            else
                high = half;
        }
        way->out = high + (1 - high) * 0.05f;
    }
}

/* Moves receivers inside solids to where the nearest edge comes out. */
static bool move_outside(Receivers *receivers)
{
    const Mesh *mesh = receivers->mesh;
    uint32_t count = 0;
    Way *ways = malloc(((size_t)mesh->triangle_count * 6 + 1) * sizeof *ways);
    if (!ways)
        return false;
    for (uint32_t t = 0; t < mesh->triangle_count; t++) {
        for (int k = 0; k < 6; k++) {
            uint32_t from = receivers->of_vertex[mesh->triangles[t].vertex[k % 3]];
            uint32_t to = receivers->of_vertex[mesh->triangles[t].vertex[(k + 1 + k / 3) % 3]];
            if (receivers->drafts[from].inside && !receivers->drafts[to].inside)
                ways[count++] = (Way){receivers, from, to, 1};
        }
    }
    chiaro_parallel_for(mesh->baker->desc.threads, count, 64, find_out, ways, NULL, NULL);
    for (const Way *way = ways; way < ways + count; way++) {
        Draft *hidden = &receivers->drafts[way->hidden];
        const Draft *open = &receivers->drafts[way->open];
        float distance = way->out * vec3_length(vec3_sub(open->place, hidden->place));
        if (distance < hidden->moved) {
            hidden->moved = distance;
            hidden->outside = vec3_mad(vec3_scale(hidden->place, 1 - way->out), open->place, way->out);
        }
    }
    for (uint32_t r = 0; r < receivers->count; r++) {
        if (receivers->drafts[r].moved < INFINITY)
            receivers->drafts[r].place = receivers->drafts[r].outside;
    }
    free(ways);
    return true;
}

/* Twice the area of a triangle of a draft's star; 0: it looks another way. */
static double star_area(const Mesh *mesh, const Draft *draft, uint32_t star_corner)
{
    Vec3 cross = triangle_cross(mesh, &mesh->triangles[star_corner / 3]);
    float area = vec3_length(cross);
    return vec3_dot(cross, draft->plane) > LEVEL * area ? (double)area : 0;
}

/* From a triangle's corner part of the way to a place on the triangle; u, v: 0 .. 1. */
static Vec3 star_way(const Mesh *mesh, uint32_t star_corner, float u, float v)
{
    const Triangle *triangle = &mesh->triangles[star_corner / 3];
    int k = (int)(star_corner % 3);
    Vec3 at = corner(mesh, triangle, k), a = vec3_sub(corner(mesh, triangle, (k + 1) % 3), at);
    Vec3 b = vec3_sub(corner(mesh, triangle, (k + 2) % 3), at);
    float root = SPREAD * sqrtf(u);
    return vec3_add(vec3_scale(a, root * (1 - v)), vec3_scale(b, root * v));
}

/* Places spread evenly over the areas of a draft's triangles. What came out of a solid, or would be in one, stays. */
static void spread_some(uint32_t begin, uint32_t end, uint32_t thread, void *user)
{
    const Receivers *receivers = user;
    const Mesh *mesh = receivers->mesh;
    (void)thread;
    for (uint32_t r = begin; r < end; r++) {
        Draft *draft = &receivers->drafts[r];
        const uint32_t *star = receivers->star + receivers->star_first[r];
        uint32_t count = draft->inside ? 0 : draft->triangles, k = 0;
        ChiaroRandom random = chiaro_random_seed(mesh->baker->desc.seed, (uint64_t)1 << 35 | r);
        float u = chiaro_random_float(&random), v = chiaro_random_float(&random);
        double all = 0, next = 0;
        for (uint32_t s = 0; s < count; s++)
            all += star_area(mesh, draft, star[s]);
        for (uint32_t j = 0; j < CHIARO_SPREAD; j++) {
            double wanted = (j + 0.5) / CHIARO_SPREAD * all;
            while (k < count && next <= wanted)
                next += star_area(mesh, draft, star[k++]);
            draft->spread[j] = draft->place;
            if (!(next > wanted))
                continue;
            /* Roberts' sequence: its steps come of the plastic number, as those of the golden section in one dimension. */
            Vec3 place = vec3_add(draft->place, star_way(mesh, star[k - 1], fmodf(u + 0.754877666f * (float)j, 1),
                                                         fmodf(v + 0.569840291f * (float)j, 1)));
            if (!chiaro_rays_covered(mesh->baker->rays, place, draft->plane))
                draft->spread[j] = place;
        }
    }
}

static bool spread_rays(Receivers *receivers)
{
    const Mesh *mesh = receivers->mesh;
    uint32_t *next = receivers->star_first = calloc(receivers->count + (size_t)2, sizeof *receivers->star_first);
    receivers->star = malloc((3 * (size_t)mesh->triangle_count + 1) * sizeof *receivers->star);
    if (!next || !receivers->star)
        return false;
    for (uint32_t r = 0; r < receivers->count; r++)
        next[r + 2] = next[r + 1] + receivers->drafts[r].triangles;
    for (uint32_t c = 0; c < 3 * mesh->triangle_count; c++) /* `next` of a draft ends where the following one begins */
        receivers->star[next[receivers->of_vertex[mesh->triangles[c / 3].vertex[c % 3]] + 1]++] = c;
    chiaro_parallel_for(mesh->baker->desc.threads, receivers->count, 64, spread_some, receivers, NULL, NULL);
    return true;
}

/* Does a wall stand between two places on the surface? */
static bool is_parted(const Mesh *mesh, const Draft *a, const Draft *b)
{
    float height = SAME_PLACE * mesh->unit / 4;
    return chiaro_rays_parted(mesh->baker->rays, vec3_mad(a->place, a->plane, height), vec3_mad(b->place, b->plane, height));
}

/* Corners of fine detail that lie close together and look the same way, about, share a receiver. */
static bool merge_detail(Receivers *receivers)
{
    const Mesh *mesh = receivers->mesh;
    Vec3 low = vec3_load(mesh->baker->info.bounds_min);
    uint32_t count = 0, *renamed = malloc(receivers->count * sizeof *renamed);
    Map known = {0};
    bool ok = renamed != NULL;
    for (uint32_t r = 0; ok && r < receivers->count; r++) {
        Draft draft = receivers->drafts[r];
        Vec3 cell = vec3_scale(vec3_sub(draft.place, low), 1 / (SAME_PLACE * mesh->unit));
        cell = vec3_add(cell, vec3(OFF_WALL, OFF_WALL, OFF_WALL));
        Vec3 turn = vec3_scale(draft.normal, SAME_NORMAL);
        uint64_t key = chiaro_random_mix((uint64_t)(int64_t)floorf(cell.x) << 42 ^ (uint64_t)(int64_t)floorf(cell.y) << 21 ^
                                         (uint64_t)(int64_t)floorf(cell.z));
        key ^= (uint64_t)((lrintf(turn.x) + SAME_NORMAL) << 16 | (lrintf(turn.y) + SAME_NORMAL) << 8 |
                          (lrintf(turn.z) + SAME_NORMAL));
        uint32_t *shared;
        do {
            key = chiaro_random_mix(key) >> 1;
            shared = map_at(&known, key, count);
        } while (shared && *shared < count && is_parted(mesh, &receivers->drafts[*shared], &draft));
        ok = shared != NULL;
        if (!ok)
            break;
        if (*shared == count)
            receivers->drafts[count++] = draft;
        renamed[r] = *shared;
    }
    for (uint32_t v = 0; ok && v < mesh->vertex_count; v++)
        receivers->of_vertex[v] = renamed[receivers->of_vertex[v]];
    receivers->count = count;
    map_free(&known);
    free(renamed);
    return ok;
}

/* Orders the receivers so that neighbours that look the same way follow each other, and cuts them into runs.
 * `order` receives the draft of each. */
static bool deal_runs(const Receivers *receivers, uint32_t *order)
{
    Baker *baker = receivers->mesh->baker;
    uint32_t n = receivers->count;
    ClusterTree tree;
    ClusterItem *items = calloc(n, sizeof *items);
    baker->receiver_runs = malloc(((size_t)n + 1) * sizeof *baker->receiver_runs);
    /* A quarter turn parts two receivers like two edges of a run. */
    float run = sqrtf(USUAL_RUN) * receivers->mesh->unit, turn = 2 * run;
    for (uint32_t r = 0; items && r < n; r++) {
        const Draft *draft = &receivers->drafts[r];
        Vec3 normal = vec3_scale(draft->normal, turn);
        items[r] = (ClusterItem){{draft->place.x, draft->place.y, draft->place.z, 0, normal.x, normal.y, normal.z}, 1, run};
    }
    ClusterDesc desc = {.items = items, .count = n, .threads = baker->desc.threads, .leaves = (n + USUAL_RUN - 1) / USUAL_RUN,
                        .most = CHIARO_BLOCK_ROWS};
    if (!items || !baker->receiver_runs || !chiaro_cluster(&desc, &tree)) {
        free(items);
        return false;
    }
    memcpy(order, tree.order, n * sizeof *order);
    uint32_t count = 0;
    for (uint32_t k = 0; k < tree.node_count; k++) {
        if (tree.nodes[k].left == CHIARO_NONE)
            baker->receiver_runs[count++] = tree.nodes[k].first;
    }
    baker->receiver_runs[count] = n;
    baker->receiver_run_count = count;
    chiaro_cluster_free(&tree);
    free(items);
    return true;
}

/* Hands the mesh over to the baker, triangles grouped by part, receivers run by run. */
static bool finish(Receivers *receivers)
{
    Mesh *mesh = receivers->mesh;
    Baker *baker = mesh->baker;
    uint32_t parts = baker->scene->part_count, n = receivers->count;
    uint32_t *renamed = malloc(n * sizeof *renamed), *order = malloc(n * sizeof *order);
    baker->parts = calloc(parts, sizeof *baker->parts);
    baker->indices = malloc(3 * (size_t)mesh->triangle_count * sizeof *baker->indices);
    baker->receivers = calloc(n, sizeof *baker->receivers);
    baker->receiver_plane = malloc(n * sizeof *baker->receiver_plane);
    baker->receiver_spread = malloc((size_t)CHIARO_SPREAD * n * sizeof *baker->receiver_spread);
    baker->receiver_share = calloc(n, sizeof *baker->receiver_share);
    if (!renamed || !order || !baker->parts || !baker->indices || !baker->receivers || !baker->receiver_plane ||
        !baker->receiver_spread ||
        !baker->receiver_share || !deal_runs(receivers, order)) {
        free(renamed);
        free(order);
        return false;
    }
    for (uint32_t r = 0; r < n; r++) {
        const Draft *draft = &receivers->drafts[order[r]];
        renamed[order[r]] = r;
        vec3_store(baker->receivers[r].position, draft->place);
        vec3_store(baker->receivers[r].normal, draft->normal);
        baker->receiver_plane[r] = draft->plane;
        memcpy(baker->receiver_spread + (size_t)CHIARO_SPREAD * r, draft->spread, sizeof draft->spread);
    }
    for (uint32_t v = 0; v < mesh->vertex_count; v++)
        receivers->of_vertex[v] = renamed[receivers->of_vertex[v]];
    free(renamed);
    free(order);
    float shortest = SHORTEST_EDGE * mesh->unit, usual = USUAL_PART * shortest * shortest;
    for (uint32_t t = 0; t < mesh->triangle_count; t++) {
        const Triangle *triangle = &mesh->triangles[t];
        baker->parts[triangle->part].index_count += 3;
        for (int k = 0; k < 3; k++)
            baker->receiver_share[receivers->of_vertex[triangle->vertex[k]]] +=
                vec3_length(triangle_cross(mesh, triangle)) / (6 * usual);
    }
    for (uint32_t r = 0; r < n; r++)
        baker->receiver_share[r] = fminf(1, baker->receiver_share[r]);
    uint32_t next = 0;
    for (uint32_t p = 0; p < parts; p++) {
        uint32_t count = baker->parts[p].index_count;
        baker->parts[p] = baker->scene->parts[p];
        baker->parts[p].first_index = next, baker->parts[p].index_count = 0;
        next += count;
    }
    for (uint32_t t = 0; t < mesh->triangle_count; t++) {
        ChiaroPart *part = &baker->parts[mesh->triangles[t].part];
        memcpy(baker->indices + part->first_index + part->index_count, mesh->triangles[t].vertex, 3 * sizeof(uint32_t));
        part->index_count += 3;
    }
    baker->index_count = next;
    baker->receiver_count = n;
    baker->vertex_count = mesh->vertex_count;
    baker->vertices = mesh->vertices, mesh->vertices = NULL;
    baker->vertex_receivers = receivers->of_vertex, receivers->of_vertex = NULL;
    return true;
}

/* Splits edges until all are short enough, those first that are the longest for what surrounds them: where that would take
 * more vertices than a scene may have, since its surroundings are near everywhere, or since its own are many already, all
 * edges end about equally too long. */
static ChiaroResult refine(Mesh *mesh)
{
    Baker *baker = mesh->baker;
    if (!load(mesh))
        return CHIARO_ERROR_MEMORY;
    double most = fmin(mesh->vertex_count + MOST_A_RECEIVER * baker->desc.receivers,
                       fmax(MOST_VERTICES, MOST_MORE * mesh->vertex_count));
    float end = mesh->unit;
    uint32_t own = mesh->vertex_count;
    mesh->unit *= COARSEST;
    for (uint32_t round = 0; round < MAX_ROUNDS; round++) {
        Map marks = {0};
        int64_t marked = mark_edges(mesh, &marks);
        bool ok = marked >= 0 && (marked == 0 || split_triangles(mesh, &marks));
        map_free(&marks);
        if (!ok)
            return CHIARO_ERROR_MEMORY;
        if (!chiaro_bake_progress((float)round / MAX_ROUNDS, baker))
            return CHIARO_ERROR_INTERRUPTED;
        if (marked > 0)
            continue;
        /* Vertices that came in addition grow by the square. */
        float room = (float)sqrt((most - own) / fmax(1, (double)mesh->vertex_count - own));
        if (mesh->unit <= end || room < LEAST_FINER)
            break;
        mesh->unit = fmaxf(end, mesh->unit / fminf(MOST_FINER, room));
    }
    return CHIARO_OK;
}

ChiaroResult chiaro_bake_mesh(Baker *baker)
{
    uint32_t threads = baker->desc.threads;
    Mesh mesh = {.baker = baker, .unit = (float)sqrt(baker->patches.area / baker->desc.receivers)};
    Receivers receivers = {.mesh = &mesh};
    ChiaroResult result = CHIARO_ERROR_MEMORY;
    mesh.scratch = calloc(threads, sizeof *mesh.scratch);
    for (uint32_t t = 0; mesh.scratch && t < threads; t++) {
        if (!chiaro_row_scratch_create(baker, SIZING_RAYS, &mesh.scratch[t]))
            goto done;
    }
    if (!mesh.scratch)
        goto done;
    result = refine(&mesh);
    if (result != CHIARO_OK)
        goto done;
    result = CHIARO_ERROR_MEMORY;
    if (!draft_receivers(&receivers))
        goto done;
    chiaro_parallel_for(threads, receivers.count, 64, find_inside, &receivers, NULL, NULL);
    if (!move_outside(&receivers))
        goto done;
    result = spread_rays(&receivers) && merge_detail(&receivers) && finish(&receivers) ? CHIARO_OK : CHIARO_ERROR_MEMORY;
done:
    for (uint32_t t = 0; mesh.scratch && t < threads; t++)
        chiaro_row_scratch_destroy(&mesh.scratch[t]);
    free(mesh.scratch);
    free(mesh.vertices);
    free(mesh.vertex_place);
    free(mesh.places);
    free(mesh.triangles);
    free(mesh.edges);
    map_free(&mesh.wanted);
    free(receivers.drafts);
    free(receivers.of_vertex);
    free(receivers.star_first);
    free(receivers.star);
    return result;
}
