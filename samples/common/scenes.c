/* Our own test scenes. Each is a handful of large polygons: cutting them up is the baker's business.
 *
 * Rooms are made from a grid of cells that are open or solid; faces stand where the two meet and look into the open.
 * That way walls have thickness, nothing leaks, and neighbouring faces share whole edges: no T-junctions. */
#include "scenes.h"

#include "view.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* ------------------------------------------------------------------------------------------------------------------
 * Building
 */

/* A polygon or a sphere: a run of the arrays, of one material and one node. */
typedef struct Shape {
    uint32_t first_vertex, vertex_count, first_index, index_count, material, node;
} Shape;

enum { MAX_MATERIALS = 16, MAX_CAMERAS = 4 };

typedef struct Builder {
    ChiaroVertex *vertices, *sorted_vertices;
    uint32_t *indices, *sorted_indices;
    Shape *shapes;
    ChiaroIoNode *nodes;
    ChiaroPart *parts;
    uint32_t vertex_count, index_count, shape_count, node_count, part_count;
    uint32_t vertex_room, index_room, shape_room, node_room;
    ChiaroMaterial materials[MAX_MATERIALS];
    ChiaroCamera cameras[MAX_CAMERAS];
    ChiaroLight light;
    uint32_t material_count, camera_count, light_count;
    bool failed; /* Out of memory: everything after it does nothing. */
} Builder;

/* Makes room for `more` further items behind `*count` and counts them in. NULL if memory is short. */
static void *append(Builder *b, void *array_pointer, uint32_t *count, uint32_t *room, uint32_t more, size_t size)
{
    void *array;
    memcpy(&array, array_pointer, sizeof array); /* A pointer to any kind of pointer. */
    if (b->failed)
        return NULL;
    if (*count + more > *room) {
        uint32_t wanted = (*count + more) * 2;
        void *moved = realloc(array, wanted * size);
        if (!moved) {
            b->failed = true;
            return NULL;
        }
        array = moved;
        *room = wanted;
        memcpy(array_pointer, &array, sizeof array);
    }
    void *first = (char *)array + *count * size;
    memset(first, 0, more * size);
    *count += more;
    return first;
}

static uint32_t add_material(Builder *b, float red, float green, float blue)
{
    b->materials[b->material_count] = (ChiaroMaterial){.albedo = {red, green, blue}, .alpha = 1,
                                                       .albedo_texture = CHIARO_NONE, .emission_texture = CHIARO_NONE};
    return b->material_count++;
}

static void add_camera(Builder *b, const char *name, Vec3 eye, Vec3 target, float yfov)
{
    ChiaroCamera *camera = &b->cameras[b->camera_count++];
    *camera = (ChiaroCamera){.yfov = yfov, .znear = 0.05f};
    snprintf(camera->name, sizeof camera->name, "%s", name);
    view_look_at(camera, eye, target);
}

static void set_lamp(Builder *b, Vec3 place, float intensity)
{
    b->light = (ChiaroLight){.type = CHIARO_LIGHT_POINT, .direction = {0, -1, 0},
                             .intensity = {intensity, intensity, intensity}};
    vec3_store(b->light.position, place);
    b->light_count = 1;
}

/* Shapes that follow belong to this node. */
static void add_node(Builder *b, const char *name, Vec3 translation)
{
    ChiaroIoNode *node = append(b, &b->nodes, &b->node_count, &b->node_room, 1, sizeof *node);
    if (!node)
        return;
    snprintf(node->name, sizeof node->name, "%s", name);
    vec3_store(node->translation, translation);
}

/* Starts a shape; its vertices and indices, numbered from 0 within it, are for the caller to fill. */
static bool add_shape(Builder *b, uint32_t material, uint32_t vertex_count, uint32_t index_count,
                      ChiaroVertex **vertices, uint32_t **indices)
{
    uint32_t first_vertex = b->vertex_count, first_index = b->index_count;
    Shape *shape = append(b, &b->shapes, &b->shape_count, &b->shape_room, 1, sizeof *shape);
    *vertices = append(b, &b->vertices, &b->vertex_count, &b->vertex_room, vertex_count, sizeof **vertices);
    *indices = append(b, &b->indices, &b->index_count, &b->index_room, index_count, sizeof **indices);
    if (b->failed)
        return false;
    *shape = (Shape){first_vertex, vertex_count, first_index, index_count, material, b->node_count - 1};
    return true;
}

static void set_vertex(ChiaroVertex *vertex, Vec3 position, Vec3 normal)
{
    *vertex = (ChiaroVertex){.color = {1, 1, 1, 1}};
    vec3_store(vertex->position, position);
    vec3_store(vertex->normal, normal);
}

/* Corners counter-clockwise as seen from in front. Newell's normal also suits four corners slightly off one plane. */
static void add_quad(Builder *b, uint32_t material, const Vec3 corner[4])
{
    static const uint32_t order[6] = {0, 1, 2, 0, 2, 3};
    ChiaroVertex *vertices;
    uint32_t *indices;
    Vec3 normal = vec3_normalize(vec3_cross(vec3_sub(corner[2], corner[0]), vec3_sub(corner[3], corner[1])));
    if (!add_shape(b, material, 4, 6, &vertices, &indices))
        return;
    for (int i = 0; i < 4; i++)
        set_vertex(&vertices[i], corner[i], normal);
    memcpy(indices, order, sizeof order);
}

/* Gathers the shapes of each node and material into one part. */
static void sort_into_parts(Builder *b)
{
    uint32_t vertex = 0, index = 0;
    if (b->failed)
        return;
    b->sorted_vertices = calloc(b->vertex_count, sizeof *b->sorted_vertices);
    b->sorted_indices = calloc(b->index_count, sizeof *b->sorted_indices);
    b->parts = calloc(b->shape_count, sizeof *b->parts);
    if (!b->sorted_vertices || !b->sorted_indices || !b->parts) {
        b->failed = true;
        return;
    }
    for (uint32_t n = 0; n < b->node_count; n++) {
        b->nodes[n].first_part = b->part_count;
        for (uint32_t m = 0; m < b->material_count; m++) {
            uint32_t first_index = index;
            for (uint32_t s = 0; s < b->shape_count; s++) {
                const Shape *shape = &b->shapes[s];
                if (shape->node != n || shape->material != m)
                    continue;
                for (uint32_t i = 0; i < shape->index_count; i++)
                    b->sorted_indices[index++] = vertex + b->indices[shape->first_index + i];
                memcpy(b->sorted_vertices + vertex, b->vertices + shape->first_vertex,
                       shape->vertex_count * sizeof *b->vertices);
                vertex += shape->vertex_count;
            }
            if (index > first_index)
                b->parts[b->part_count++] = (ChiaroPart){first_index, index - first_index, m, CHIARO_NONE};
        }
        b->nodes[n].part_count = b->part_count - b->nodes[n].first_part;
    }
}

/* ------------------------------------------------------------------------------------------------------------------
 * Rooms from cells
 */

typedef struct Grid {
    int count[3];          /* Planes along each axis. */
    const float *plane[3]; /* Their places, rising. */
    bool outside_solid;    /* Beyond the grid: rock, or air. */
    bool (*solid)(Vec3 cell);
    uint32_t (*material)(Vec3 face, Vec3 normal);
} Grid;

static bool cell_is_solid(const Grid *grid, const int cell[3])
{
    float center[3];
    for (int d = 0; d < 3; d++) {
        if (cell[d] < 0 || cell[d] + 1 >= grid->count[d])
            return grid->outside_solid;
        center[d] = (grid->plane[d][cell[d]] + grid->plane[d][cell[d] + 1]) / 2;
    }
    return grid->solid(vec3_load(center));
}

/* The face below `cell` along `axis`, if one side of it is solid and the other is not. */
static void add_face(Builder *b, const Grid *grid, int axis, const int cell[3])
{
    int below[3] = {cell[0], cell[1], cell[2]}, u = (axis + 1) % 3, v = (axis + 2) % 3;
    below[axis]--;
    bool solid_below = cell_is_solid(grid, below);
    if (solid_below == cell_is_solid(grid, cell))
        return;
    Vec3 corner[4];
    float center[3], normal[3] = {0};
    for (int i = 0; i < 4; i++) {
        float p[3];
        int k = solid_below ? i : 3 - i; /* u x v = axis: this way round the face looks up the axis. */
        p[axis] = grid->plane[axis][cell[axis]];
        p[u] = grid->plane[u][cell[u] + (k == 1 || k == 2)];
        p[v] = grid->plane[v][cell[v] + (k >= 2)];
        corner[i] = vec3_load(p);
    }
    vec3_store(center, vec3_scale(vec3_add(corner[0], corner[2]), 0.5f));
    normal[axis] = solid_below ? 1 : -1;
    add_quad(b, grid->material(vec3_load(center), vec3_load(normal)), corner);
}

static void add_grid(Builder *b, const Grid *grid)
{
    for (int axis = 0; axis < 3; axis++) {
        int cell[3], end[3];
        for (int d = 0; d < 3; d++)
            end[d] = grid->count[d] - (d == axis ? 0 : 1); /* One face more than cells along the axis. */
        for (cell[2] = 0; cell[2] < end[2]; cell[2]++)
            for (cell[1] = 0; cell[1] < end[1]; cell[1]++)
                for (cell[0] = 0; cell[0] < end[0]; cell[0]++)
                    add_face(b, grid, axis, cell);
    }
}

#define COUNT(array) (int)(sizeof(array) / sizeof *(array))

/* ------------------------------------------------------------------------------------------------------------------
 * cornell: the published box. Measurements and reflectance spectra: Cornell University Program of Computer Graphics,
 * "Cornell Box Data", www.graphics.cornell.edu/online/box/data.html (see third_party_notes/cornell.md).
 */

/* Millimetres to our units. */
static Vec3 cornell_point(const float mm[3]) { return vec3(mm[0] * 0.01f, mm[1] * 0.01f, mm[2] * 0.01f); }

static void make_cornell(Builder *b, const SceneRequest *request)
{
    enum { WHITE, RED, GREEN, PANEL };
    /* In the order that the source gives them; clockwise or not is decided below. */
    static const struct {
        int material;
        float corner[4][3];
        float front[3]; /* A point in front of the face. */
    } faces[] = {
        /* Floor, ceiling, back, right, left; open in front. */
        {WHITE, {{552.8f, 0, 0}, {0, 0, 0}, {0, 0, 559.2f}, {549.6f, 0, 559.2f}}, {278, 270, 280}},
        {WHITE, {{556, 548.8f, 0}, {556, 548.8f, 559.2f}, {0, 548.8f, 559.2f}, {0, 548.8f, 0}}, {278, 270, 280}},
        {WHITE, {{549.6f, 0, 559.2f}, {0, 0, 559.2f}, {0, 548.8f, 559.2f}, {556, 548.8f, 559.2f}}, {278, 270, 280}},
        {GREEN, {{0, 0, 559.2f}, {0, 0, 0}, {0, 548.8f, 0}, {0, 548.8f, 559.2f}}, {278, 270, 280}},
        {RED, {{552.8f, 0, 0}, {549.6f, 0, 559.2f}, {556, 548.8f, 559.2f}, {556, 548.8f, 0}}, {278, 270, 280}},
        /* Short block. */
        {WHITE, {{130, 165, 65}, {82, 165, 225}, {240, 165, 272}, {290, 165, 114}}, {186, 500, 169}},
        {WHITE, {{290, 0, 114}, {290, 165, 114}, {240, 165, 272}, {240, 0, 272}}, {500, 80, 230}},
        {WHITE, {{130, 0, 65}, {130, 165, 65}, {290, 165, 114}, {290, 0, 114}}, {250, 80, -200}},
        {WHITE, {{82, 0, 225}, {82, 165, 225}, {130, 165, 65}, {130, 0, 65}}, {-200, 80, 100}},
        {WHITE, {{240, 0, 272}, {240, 165, 272}, {82, 165, 225}, {82, 0, 225}}, {100, 80, 500}},
        /* Tall block. */
        {WHITE, {{423, 330, 247}, {265, 330, 296}, {314, 330, 456}, {472, 330, 406}}, {368, 500, 351}},
        {WHITE, {{423, 0, 247}, {423, 330, 247}, {472, 330, 406}, {472, 0, 406}}, {700, 160, 270}},
        {WHITE, {{472, 0, 406}, {472, 330, 406}, {314, 330, 456}, {314, 0, 456}}, {450, 160, 700}},
        {WHITE, {{314, 0, 456}, {314, 330, 456}, {265, 330, 296}, {265, 0, 296}}, {0, 160, 430}},
        {WHITE, {{265, 0, 296}, {265, 330, 296}, {423, 330, 247}, {423, 0, 247}}, {300, 160, 0}},
        /* The panel, 2 mm below the ceiling that it is flush with in the source. */
        {PANEL, {{343, 546.8f, 227}, {343, 546.8f, 332}, {213, 546.8f, 332}, {213, 546.8f, 227}}, {278, 270, 280}},
    };
    /* Means of the published spectra over 600 - 700, 500 - 596 and 400 - 496 nm. */
    add_material(b, 0.734f, 0.736f, 0.698f);
    add_material(b, 0.576f, 0.083f, 0.056f);
    add_material(b, 0.133f, 0.351f, 0.114f);
    uint32_t panel = add_material(b, 0.78f, 0.78f, 0.78f);
    for (int c = 0; c < 3; c++)
        b->materials[panel].emission[c] = 25; /* About as much light on the floor as from the point lamp. */
    add_node(b, "cornell", vec3(0, 0, 0));
    for (int f = 0; f < COUNT(faces); f++) {
        Vec3 corner[4], front = cornell_point(faces[f].front);
        for (int i = 0; i < 4; i++)
            corner[i] = cornell_point(faces[f].corner[i]);
        Vec3 normal = vec3_cross(vec3_sub(corner[1], corner[0]), vec3_sub(corner[2], corner[0]));
        if (vec3_dot(normal, vec3_sub(front, corner[0])) < 0) {
            Vec3 swap = corner[1];
            corner[1] = corner[3];
            corner[3] = swap;
        }
        if (faces[f].material != PANEL || request->panel)
            add_quad(b, (uint32_t)faces[f].material, corner);
    }
    if (!request->panel)
        set_lamp(b, vec3(2.78f, 5.0f, 2.795f), 17);
    /* 35 mm focal length, 25 mm of film. */
    add_camera(b, "main", vec3(2.78f, 2.73f, -8), vec3(2.78f, 2.73f, 0), 2 * atanf(12.5f / 35));
}

/* ------------------------------------------------------------------------------------------------------------------
 * two-rooms and corridor: light that comes round a corner
 */

enum { FLOOR, CEILING, PLAIN, RED_WALL, YELLOW_WALL, BLUE_WALL, GREEN_WALL };

static void add_room_materials(Builder *b)
{
    add_material(b, 0.45f, 0.38f, 0.30f);
    add_material(b, 0.80f, 0.80f, 0.80f);
    add_material(b, 0.70f, 0.70f, 0.68f);
    add_material(b, 0.65f, 0.15f, 0.10f);
    add_material(b, 0.75f, 0.60f, 0.20f);
    add_material(b, 0.15f, 0.25f, 0.65f);
    add_material(b, 0.20f, 0.55f, 0.20f);
}

static bool two_rooms_solid(Vec3 cell)
{
    bool door = cell.y < 2 && cell.z > 2.1f && cell.z < 2.9f;
    return cell.x > 5 && cell.x < 5.2f && !door;
}

static uint32_t two_rooms_material(Vec3 face, Vec3 normal)
{
    bool passage = face.x > 5.05f && face.x < 5.15f;
    if (normal.y != 0)
        return normal.y > 0 ? FLOOR : passage ? PLAIN : CEILING;
    if (normal.x != 0 || passage)
        return PLAIN;
    if (face.x < 5)
        return normal.z > 0 ? RED_WALL : YELLOW_WALL;
    return normal.z > 0 ? BLUE_WALL : GREEN_WALL;
}

static void make_two_rooms(Builder *b, const SceneRequest *request)
{
    static const float x[] = {0, 5, 5.2f, 10.2f}, y[] = {0, 2, 3}, z[] = {0, 2.1f, 2.9f, 5};
    const Grid grid = {{COUNT(x), COUNT(y), COUNT(z)}, {x, y, z}, true, two_rooms_solid, two_rooms_material};
    const float wide = 1.2f;
    (void)request;
    add_room_materials(b);
    add_node(b, "rooms", vec3(0, 0, 0));
    add_grid(b, &grid);
    set_lamp(b, vec3(2, 2.5f, 1.2f), 30);
    add_camera(b, "main", vec3(5.6f, 1.6f, 0.4f), vec3(10.2f, 1.1f, 4.2f), wide);
    add_camera(b, "first", vec3(0.4f, 1.6f, 0.4f), vec3(5, 1.1f, 3.4f), wide);
    add_camera(b, "second", vec3(5.6f, 1.6f, 0.4f), vec3(10.2f, 1.1f, 4.2f), wide);
}

static bool corridor_solid(Vec3 cell) { return cell.x < 6 && cell.z > 2; }

static uint32_t corridor_material(Vec3 face, Vec3 normal)
{
    if (normal.y != 0)
        return normal.y > 0 ? FLOOR : CEILING;
    if (normal.z < 0 && face.z < 3)
        return RED_WALL; /* The inner wall of the lit leg. */
    return normal.x > 0 && face.x > 5 ? BLUE_WALL : PLAIN; /* The inner wall of the dark leg. */
}

static void make_corridor(Builder *b, const SceneRequest *request)
{
    static const float x[] = {0, 6, 8}, y[] = {0, 2.5f}, z[] = {0, 2, 8};
    const Grid grid = {{COUNT(x), COUNT(y), COUNT(z)}, {x, y, z}, true, corridor_solid, corridor_material};
    const float wide = 1.2f;
    (void)request;
    add_room_materials(b);
    add_node(b, "corridor", vec3(0, 0, 0));
    add_grid(b, &grid);
    /* Its light reaches x = 8, z = 2.45 past the inner edge; the second camera sees nothing before z = 2.8. */
    set_lamp(b, vec3(1.5f, 2.2f, 1), 15);
    add_camera(b, "main", vec3(7, 1.5f, 2.8f), vec3(7, 1.2f, 8), wide);
    add_camera(b, "first", vec3(0.4f, 1.5f, 1), vec3(8, 1.2f, 1), wide);
    add_camera(b, "second", vec3(7, 1.5f, 2.8f), vec3(7, 1.2f, 8), wide);
}

/* ------------------------------------------------------------------------------------------------------------------
 * courtyard: 12 x 12 m under the sky, an arcade all around
 */

/* Is this one of the four pillars between the corners? 12 m = 5 openings of 2 m and 4 pillars of 0.5 m. */
static bool pillar_place(float along)
{
    float a = fabsf(along);
    return (a > 1 && a < 1.5f) || (a > 3.5f && a < 4) || a > 6;
}

static bool courtyard_solid(Vec3 cell)
{
    float ax = fabsf(cell.x), az = fabsf(cell.z), ring = fmaxf(ax, az);
    if (cell.y < 0 || ring > 9) /* Ground and outer wall. */
        return true;
    if (ring < 6)
        return false;
    if (cell.y > 3) /* The storey that the pillars carry. */
        return true;
    if (ring < 6.5f)
        return ax > 6 ? pillar_place(cell.z) : pillar_place(cell.x);
    return false;
}

static uint32_t courtyard_material(Vec3 face, Vec3 normal)
{
    enum { GROUND, PLASTER, PILLAR, ARCADE, ROOF };
    float ring = fmaxf(fabsf(face.x), fabsf(face.z));
    if (normal.y > 0)
        return face.y > 1 ? ROOF : GROUND;
    if (normal.y < 0)
        return face.y > 1 ? ARCADE : GROUND;
    if (face.y < 0)
        return GROUND;
    if (face.y < 3 && ring < 6.6f)
        return PILLAR;
    return face.y < 3 && ring < 9.1f ? ARCADE : PLASTER;
}

static void make_courtyard(Builder *b, const SceneRequest *request)
{
    static const float side[] = {-9.3f, -9, -6.5f, -6, -4, -3.5f, -1.5f, -1, 1, 1.5f, 3.5f, 4, 6, 6.5f, 9, 9.3f};
    static const float y[] = {-0.2f, 0, 3, 6};
    const Grid grid = {{COUNT(side), COUNT(y), COUNT(side)}, {side, y, side}, false, courtyard_solid,
                       courtyard_material};
    (void)request;
    add_material(b, 0.45f, 0.42f, 0.38f);
    add_material(b, 0.70f, 0.60f, 0.45f);
    add_material(b, 0.75f, 0.72f, 0.68f);
    add_material(b, 0.70f, 0.68f, 0.62f);
    add_material(b, 0.55f, 0.25f, 0.18f);
    add_node(b, "courtyard", vec3(0, 0, 0));
    add_grid(b, &grid);
    add_camera(b, "main", vec3(-5, 1.7f, 5.2f), vec3(4, 2.2f, -6), 1.1f);
    add_camera(b, "arcade", vec3(-7.75f, 1.7f, 8), vec3(-7, 1.5f, -8), 1.1f);
}

/* ------------------------------------------------------------------------------------------------------------------
 * furnace: the same radiance everywhere, whatever stands where
 */

static bool nothing_solid(Vec3 cell)
{
    (void)cell;
    return false;
}

static uint32_t only_material(Vec3 face, Vec3 normal)
{
    (void)face, (void)normal;
    return 0;
}

static void make_furnace(Builder *b, const SceneRequest *request)
{
    static const float x[] = {0, 5}, y[] = {0, 3}, z[] = {0, 4};
    const Grid grid = {{COUNT(x), COUNT(y), COUNT(z)}, {x, y, z}, true, nothing_solid, only_material};
    float albedo = request->has_albedo ? request->albedo : 0.5f;
    uint32_t wall = add_material(b, albedo, albedo, albedo);
    for (int c = 0; c < 3; c++)
        b->materials[wall].emission[c] = 1;
    add_node(b, "furnace", vec3(0, 0, 0));
    add_grid(b, &grid);
    add_camera(b, "main", vec3(0.6f, 1.5f, 0.6f), vec3(5, 1.2f, 4), 1.2f);
}

/* ------------------------------------------------------------------------------------------------------------------
 * spheres: many small things on a plane
 */

enum { SPHERES = 10, SPHERE_CUTS = 4, SPHERE_POINTS = 10 * SPHERE_CUTS * SPHERE_CUTS + 2, SPHERE_FACES = 20 };

typedef struct UnitSphere {
    Vec3 point[SPHERE_POINTS];
    uint32_t point_count, index_count;
    uint32_t index[SPHERE_FACES * SPHERE_CUTS * SPHERE_CUTS * 3];
} UnitSphere;

/* Faces of the icosahedron share the points on their edges: the few there are can be found by looking. */
static uint32_t sphere_point(UnitSphere *sphere, Vec3 direction)
{
    Vec3 p = vec3_normalize(direction);
    for (uint32_t i = 0; i < sphere->point_count; i++)
        if (vec3_length(vec3_sub(p, sphere->point[i])) < 1e-3f)
            return i;
    sphere->point[sphere->point_count] = p;
    return sphere->point_count++;
}

/* An icosahedron with every edge cut into SPHERE_CUTS, blown up to the unit sphere. */
static void make_unit_sphere(UnitSphere *sphere)
{
    static const uint8_t face[SPHERE_FACES][3] = {
        {0, 11, 5}, {0, 5, 1},  {0, 1, 7},   {0, 7, 10}, {0, 10, 11}, {1, 5, 9}, {5, 11, 4},
        {11, 10, 2}, {10, 7, 6}, {7, 1, 8},  {3, 9, 4},  {3, 4, 2},   {3, 2, 6}, {3, 6, 8},
        {3, 8, 9},  {4, 9, 5},  {2, 4, 11}, {6, 2, 10}, {8, 6, 7},   {9, 8, 1}};
    const float g = 1.6180340f; /* The golden ratio. */
    const Vec3 corner[12] = {{-1, g, 0}, {1, g, 0}, {-1, -g, 0}, {1, -g, 0}, {0, -1, g}, {0, 1, g},
                             {0, -1, -g}, {0, 1, -g}, {g, 0, -1}, {g, 0, 1}, {-g, 0, -1}, {-g, 0, 1}};
    *sphere = (UnitSphere){.point_count = 0};
    for (int f = 0; f < SPHERE_FACES; f++) {
        uint32_t grid[SPHERE_CUTS + 1][SPHERE_CUTS + 1];
        Vec3 a = corner[face[f][0]], ab = vec3_sub(corner[face[f][1]], a), ac = vec3_sub(corner[face[f][2]], a);
        for (int i = 0; i <= SPHERE_CUTS; i++)
            for (int j = 0; i + j <= SPHERE_CUTS; j++)
                grid[i][j] = sphere_point(sphere, vec3_mad(vec3_mad(a, ab, (float)i / SPHERE_CUTS), ac,
                                                           (float)j / SPHERE_CUTS));
        for (int i = 0; i < SPHERE_CUTS; i++)
            for (int j = 0; i + j < SPHERE_CUTS; j++) {
                const uint32_t triangles[2][3] = {{grid[i][j], grid[i + 1][j], grid[i][j + 1]},
                                                  {grid[i + 1][j], grid[i + 1][j + 1], grid[i][j + 1]}};
                int count = i + j + 1 < SPHERE_CUTS ? 2 : 1;
                memcpy(sphere->index + sphere->index_count, triangles, (size_t)count * sizeof triangles[0]);
                sphere->index_count += 3 * (uint32_t)count;
            }
    }
}

/* Repeatable numbers in [0, 1) (the multiply-add generator of Numerical Recipes). */
static float jitter(uint32_t *state)
{
    *state = *state * 1664525u + 1013904223u;
    return (float)(*state >> 8) / 16777216.0f;
}

static void add_sphere(Builder *b, const UnitSphere *sphere, uint32_t material, Vec3 center, float radius)
{
    ChiaroVertex *vertices;
    uint32_t *indices;
    if (!add_shape(b, material, sphere->point_count, sphere->index_count, &vertices, &indices))
        return;
    for (uint32_t p = 0; p < sphere->point_count; p++)
        set_vertex(&vertices[p], vec3_mad(center, sphere->point[p], radius), sphere->point[p]);
    memcpy(indices, sphere->index, sphere->index_count * sizeof *indices);
}

static void make_spheres(Builder *b, const SceneRequest *request)
{
    static const float palette[][3] = {{0.80f, 0.78f, 0.75f}, {0.70f, 0.12f, 0.10f}, {0.15f, 0.50f, 0.18f},
                                       {0.12f, 0.22f, 0.65f}, {0.80f, 0.62f, 0.15f}, {0.45f, 0.45f, 0.45f},
                                       {0.60f, 0.25f, 0.55f}, {0.15f, 0.55f, 0.55f}, {0.15f, 0.14f, 0.13f}};
    const float radius = 0.5f, spacing = 3, half = 20;
    const Vec3 plane[4] = {{-half, 0, half}, {half, 0, half}, {half, 0, -half}, {-half, 0, -half}};
    uint32_t state = 2004;
    (void)request;
    UnitSphere *sphere = malloc(sizeof *sphere);
    if (!sphere) {
        b->failed = true;
        return;
    }
    make_unit_sphere(sphere);
    for (int m = 0; m < COUNT(palette); m++)
        add_material(b, palette[m][0], palette[m][1], palette[m][2]);
    uint32_t ground = add_material(b, 0.5f, 0.5f, 0.48f);
    add_node(b, "plane", vec3(0, 0, 0));
    add_quad(b, ground, plane);
    for (int i = 0; i < SPHERES * SPHERES; i++) {
        char name[CHIARO_NAME_SIZE];
        float dx = jitter(&state) - 0.5f, dz = jitter(&state) - 0.5f;
        Vec3 center = vec3(((float)(i % SPHERES) - 4.5f + dx * 0.6f) * spacing, radius,
                           ((float)(i / SPHERES) - 4.5f + dz * 0.6f) * spacing);
        snprintf(name, sizeof name, "sphere_%02d", i);
        add_node(b, name, center);
        add_sphere(b, sphere, (uint32_t)i % (uint32_t)COUNT(palette), center, radius);
    }
    free(sphere);
    add_camera(b, "main", vec3(0, 13, 21), vec3(0, 0, 1), 0.7f);
}

/* ------------------------------------------------------------------------------------------------------------------
 * The list
 */

typedef struct Recipe {
    const char *name, *about;
    void (*make)(Builder *b, const SceneRequest *request);
} Recipe;

static const Recipe recipes[] = {
    {"cornell", "the published Cornell box, 1 mm = 0.01 units, one lamp below the ceiling", make_cornell},
    {"two-rooms", "two closed rooms, one narrow door, the lamp in the first", make_two_rooms},
    {"corridor", "an L-shaped corridor, lit in one leg", make_corridor},
    {"courtyard", "open to the sky, arcades all around, no lamp", make_courtyard},
    {"furnace", "a closed box whose walls all emit 1", make_furnace},
    {"spheres", "100 separate spheres on a plane, no lamp", make_spheres},
};

const char *scenes_name(uint32_t index, const char **about)
{
    if (index >= (uint32_t)COUNT(recipes))
        return NULL;
    *about = recipes[index].about;
    return recipes[index].name;
}

static void free_builder(Builder *b)
{
    free(b->vertices);
    free(b->sorted_vertices);
    free(b->indices);
    free(b->sorted_indices);
    free(b->shapes);
    free(b->nodes);
    free(b->parts);
    free(b);
}

/* Hands what was built over. */
static void finish(Builder *b, TestScene *made)
{
    made->scene = (ChiaroScene){.vertices = b->sorted_vertices, .indices = b->sorted_indices, .parts = b->parts,
                                .materials = b->materials, .lights = b->light_count ? &b->light : NULL,
                                .cameras = b->cameras, .vertex_count = b->vertex_count, .index_count = b->index_count,
                                .part_count = b->part_count, .material_count = b->material_count,
                                .light_count = b->light_count, .camera_count = b->camera_count};
    made->nodes = b->nodes;
    made->node_count = b->node_count;
    made->memory = b;
}

/* What does not fit, or NULL. */
static const char *check_request(const Recipe *recipe, const SceneRequest *request)
{
    if (!recipe)
        return "there is no scene of that name";
    if (request->panel && recipe->make != make_cornell)
        return "only cornell has a panel";
    if (request->panel && request->has_light)
        return "the panel has its place; it cannot be moved";
    if (request->has_albedo && recipe->make != make_furnace)
        return "only furnace takes an albedo";
    if (request->has_albedo && !(request->albedo >= 0 && request->albedo <= CHIARO_MAX_ALBEDO))
        return "an albedo lies between 0 and 0.99";
    return NULL;
}

bool scenes_make(const char *name, const SceneRequest *request, TestScene *made, const char **fault)
{
    const Recipe *recipe = NULL;
    *made = (TestScene){0};
    for (int i = 0; i < COUNT(recipes); i++)
        if (strcmp(recipes[i].name, name) == 0)
            recipe = &recipes[i];
    *fault = check_request(recipe, request);
    if (*fault)
        return false;
    Builder *b = calloc(1, sizeof *b);
    if (b) {
        recipe->make(b, request);
        sort_into_parts(b);
    }
    if (!b || b->failed) {
        if (b)
            free_builder(b);
        *fault = "out of memory";
        return false;
    }
    if (request->has_light) {
        float intensity = b->light_count ? b->light.intensity[0] : 20;
        set_lamp(b, vec3_load(request->light), intensity);
    }
    finish(b, made);
    return true;
}

static bool all_solid(Vec3 cell)
{
    (void)cell;
    return true;
}

bool scenes_make_shape(const char *name, float size, TestScene *made)
{
    const float plane[2] = {-size / 2, size / 2};
    const Grid box = {{2, 2, 2}, {plane, plane, plane}, false, all_solid, only_material};
    bool round = strcmp(name, "sphere") == 0;
    UnitSphere *sphere = malloc(sizeof *sphere);
    Builder *b = calloc(1, sizeof *b);
    *made = (TestScene){0};
    if (b && sphere) {
        add_material(b, 0.7f, 0.7f, 0.7f);
        add_node(b, name, vec3(0, 0, 0));
        make_unit_sphere(sphere);
        if (round)
            add_sphere(b, sphere, 0, vec3(0, 0, 0), size / 2);
        else
            add_grid(b, &box);
        sort_into_parts(b);
    }
    bool good = b && sphere && !b->failed;
    free(sphere);
    if (good)
        finish(b, made);
    else if (b)
        free_builder(b);
    return good;
}

void scenes_free(TestScene *made)
{
    if (made->memory)
        free_builder(made->memory);
    *made = (TestScene){0};
}
