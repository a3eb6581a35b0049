/* Scenes at their extremes: tiny, huge, far away, and full of triangles that should not be. */
#include <float.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <string.h>

#include "common/bake.h"
#include "common/glb.h"
#include "common/table.h"

/* Counts how often the log says that a place is far away. */
static void hear(ChiaroLogLevel level, ChiaroLogItem item, const char *message, void *user)
{
    (void)level;
    *(uint32_t *)user += item == CHIARO_LOG_BAKE_LIMIT && strstr(message, "from the origin");
}

/* Bakes a mesh, which it takes over, and lights it. `far` counts what the log says of that. */
static Bake open_lit(const Mesh *mesh, const ChiaroLight *lights, uint32_t count, uint32_t *far)
{
    ChiaroBakeDesc desc = {.struct_size = sizeof desc, .samples = 256, .rays = 4096, .receivers = 120, .links = 64,
                           .threads = 2, .seed = 1, .log = {hear, far}};
    Bake bake = open_bake(mesh, &desc);
    light_up(&bake, lights, count, NULL);
    return bake;
}

/* ------------------------------------------------------------------------------------------------------------------
 * Size and place
 */

/* A room with a shelf and a lamp, its intensity scaled with the room's surface. All corners are on steps of 1/16,
 * so that only rounding changes with place and size, and by no more than it must. */
static Bake room_at(float scale, float offset, uint32_t *far)
{
    Vec3 o = vec3(offset, offset, offset);
    Mesh mesh = mesh_begin();
    mesh_material(&mesh, 0.7f, 0);
    mesh_box(&mesh, o, vec3_add(o, vec3(3 * scale, 2 * scale, 4 * scale)));
    mesh_material(&mesh, 0.4f, 0);
    float l = scale, h = 1.5f * scale;
    Vec3 shelf[4] = {vec3(l, l, h), vec3(h, l, h), vec3(h, l, l), vec3(l, l, l)};
    mesh_quad(&mesh, vec3_add(o, shelf[0]), vec3_add(o, shelf[1]), vec3_add(o, shelf[2]), vec3_add(o, shelf[3]));
    ChiaroLight lamp = {.type = CHIARO_LIGHT_POINT};
    vec3_store(lamp.position, vec3_add(o, vec3(1.25f * scale, 1.25f * scale, 3 * scale)));
    for (int c = 0; c < 3; c++)
        lamp.intensity[c] = scale * scale;
    return open_lit(&mesh, &lamp, 1, far);
}

/* rms difference of receivers in the same place, within a millimetre or the half step that a float is off along an axis. */
static double difference(const Bake *a, float scale, float offset, const Bake *b)
{
    double wrong = 0, size = 0, pairs = 0;
    float near = fmaxf(1e-3f, 0.9f * FLT_EPSILON * offset);
    for (uint32_t r = 0; r < a->transport.receiver_count; r++) {
        for (uint32_t u = 0; u < b->transport.receiver_count; u++) {
            const ChiaroReceiver *x = &a->transport.receivers[r], *y = &b->transport.receivers[u];
            Vec3 at = vec3_scale(vec3_sub(vec3_load(x->position), vec3(offset, offset, offset)), 1 / scale);
            if (vec3_length(vec3_sub(at, vec3_load(y->position))) > near ||
                vec3_dot(vec3_load(x->normal), vec3_load(y->normal)) < 0.99f)
                continue;
            double p = (double)a->irradiance[3 * r], q = (double)b->irradiance[3 * u];
            wrong += (p - q) * (p - q), size += q * q, pairs++;
            break;
        }
    }
    assert_true(pairs > 0.4 * b->transport.receiver_count); /* far away, many have moved by a step */
    return sqrt(wrong / size);
}

static void size_and_place_do_not_matter(void **state)
{
    (void)state;
    /* Powers of two leave every rounding as it was. Others round the corners of the scene, so rays fall otherwise, as with
     * another seed: there, what two seeds differ by is what is allowed. Far away the bake is the same, but a float of the
     * result has steps: at 1e6 m of 6 cm, which the log must say. */
    static const struct {
        const char *name;
        float scale, offset;
        double allowed; /* below 0: only told */
        double told;
    } cases[] = {{"scaled by 2^-20", 0x1p-20f, 0, 1e-3, 0}, {"scaled by 2^20", 0x1p20f, 0, 1e-3, 0},
                 {"scaled by 1e-6", 1e-6f, 0, 1e-3, 0},     {"scaled by 1e6", 1e6f, 0, 1e-3, 0},
                 {"scaled by 0.3048", 0.3048f, 0, 1e-3, 0}, {"moved by 1e3 m", 1, 1e3f, 1e-3, 0},
                 {"moved by 1e5 m", 1, 1e5f, 1e-3, 1},      {"moved by 1e6 m", 1, 1e6f, -1, 1}};
    Table table = table_begin("scenes: size and place");
    uint32_t far = 0;
    Bake unit = room_at(1, 0, &far);
    for (size_t k = 0; k < sizeof cases / sizeof *cases; k++) {
        char name[96];
        far = 0;
        Bake bake = room_at(cases[k].scale, cases[k].offset, &far);
        snprintf(name, sizeof name, "%s: light at the receivers", cases[k].name);
        if (cases[k].allowed >= 0)
            table_most(&table, name, difference(&bake, cases[k].scale, cases[k].offset, &unit), cases[k].allowed);
        snprintf(name, sizeof name, "%s: numbers out of range", cases[k].name);
        table_near(&table, name, 0, bad_numbers(&bake), 0);
        snprintf(name, sizeof name, "%s: the log says that positions are coarse", cases[k].name);
        table_near(&table, name, cases[k].told, far, 0);
        close_bake(&bake);
    }
    close_bake(&unit);
    table_end(&table);
}

/* A file whose root node lies somewhere: a room without floor, a lamp, a camera. */
static ChiaroIoScene read_at(const double place[3])
{
    Mesh mesh = mesh_room(0.7f, 0);
    Binary binary = {.size = 0};
    char json[4096];
    ChiaroIoScene read;
    ChiaroIoError error;
    for (uint32_t i = 6; i < mesh.scene.index_count; i++)
        put(&binary, mesh.scene.vertices[mesh.scene.indices[i]].position, 3 * sizeof(float));
    uint32_t count = mesh.scene.index_count - 6;
    mesh_end(&mesh);
    snprintf(json, sizeof json,
             "{'asset':{'version':'2.0'},'scene':0,'scenes':[{'nodes':[0]}],'extensionsUsed':['KHR_lights_punctual'],"
             "'extensions':{'KHR_lights_punctual':{'lights':[{'type':'point','intensity':3}]}},"
             "'cameras':[{'type':'perspective','perspective':{'yfov':1,'znear':0.1}}],"
             "'nodes':[{'children':[1,2],'translation':[%.17g,%.17g,%.17g]},{'mesh':0,'scale':[1.3,1.3,1.3]},"
             "{'camera':0,'translation':[1.1,1.2,2.3],'extensions':{'KHR_lights_punctual':{'light':0}}}],"
             "'meshes':[{'primitives':[{'attributes':{'POSITION':0}}]}],"
             "'bufferViews':[{'buffer':0,'byteLength':%u}],'accessors':[{'bufferView':0,'componentType':5126,"
             "'count':%u,'type':'VEC3','min':[0,0,0],'max':[3,2,4]}],'buffers':[{'byteLength':%u}]}",
             place[0], place[1], place[2], binary.size, count, binary.size);
    write_glb(OUT "far.glb", json, &binary);
    if (!chiaro_io_read_gltf(OUT "far.glb", &read, &error))
        fail_msg("%s", error.message);
    return read;
}

/* What is far away in a file is read near the origin: nothing of its shape is lost, and what is drawn of it is the same. */
static void a_file_may_lie_anywhere(void **state)
{
    (void)state;
    static const struct {
        const char *name;
        double place[3], moved, lost; /* m: what is known to be rounded, at most */
    } cases[] = {{"16 m", {16, -8, 0}, 0, 2e-6},
                 {"100 m", {64, -128, 100}, 1, 2e-6},
                 {"1e6 m, by whole steps", {1e6, -2e6, 5e5}, 1, 0},
                 {"1e6 m", {1e6 + 0.3, 12.7, -1e6 + 0.1}, 1, 2e-6},
                 {"1e9 m", {3e9, -1e9, 7e8}, 1, 2e-6}};
    const double home[3] = {0, 0, 0};
    ChiaroBakeDesc desc = {.struct_size = sizeof desc, .samples = 256, .rays = 1024, .receivers = 120, .links = 64,
                           .threads = 2, .seed = 1};
    Table table = table_begin("scenes: files that lie far away");
    ChiaroIoScene near = read_at(home);
    Bake unmoved = open_scene_bake(&near.scene, &desc);
    assert_true(near.origin[0] == 0 && near.origin[1] == 0 && near.origin[2] == 0);
    must_light_up(&unmoved, near.scene.lights, 1, NULL);
    for (size_t k = 0; k < sizeof cases / sizeof *cases; k++) {
        char name[96];
        double most = 0, wrong = 0, size = 0, origin[3];
        ChiaroIoScene far = read_at(cases[k].place);
        assert_int_equal(far.scene.vertex_count, near.scene.vertex_count);
        assert_int_equal(far.origin[0] != 0, cases[k].moved);
        for (uint32_t c = 0; c < 3; c++) {
            double shift = cases[k].place[c] - far.origin[c];
            for (uint32_t v = 0; v < far.scene.vertex_count; v++)
                most = fmax(most, fabs((double)far.scene.vertices[v].position[c] - shift -
                                       (double)near.scene.vertices[v].position[c]));
            most = fmax(most, fabs((double)(far.scene.lights->position[c] - near.scene.lights->position[c]) - shift));
            most = fmax(most, fabs((double)(far.scene.cameras->eye[c] - near.scene.cameras->eye[c]) - shift));
        }
        snprintf(name, sizeof name, "%s: places, m", cases[k].name);
        table_most(&table, name, most, cases[k].lost);
        memcpy(desc.origin, far.origin, sizeof desc.origin);
        Bake bake = open_scene_bake(&far.scene, &desc);
        must_light_up(&bake, far.scene.lights, 1, NULL);
        assert_int_equal(chiaro_transport_origin(bake.blob.data, bake.blob.size, origin), CHIARO_OK);
        assert_memory_equal(origin, far.origin, sizeof origin);
        snprintf(name, sizeof name, "%s: receivers", cases[k].name);
        table_near(&table, name, unmoved.transport.receiver_count, bake.transport.receiver_count, 0);
        for (size_t i = 0; i < bake.count && bake.count == unmoved.count; i++) {
            double d = (double)bake.irradiance[i] - (double)unmoved.irradiance[i];
            wrong += d * d, size += (double)unmoved.irradiance[i] * (double)unmoved.irradiance[i];
        }
        snprintf(name, sizeof name, "%s: light", cases[k].name);
        table_most(&table, name, sqrt(wrong / size), 1e-3);
        close_bake(&bake);
        chiaro_io_free_scene(&far);
    }
    close_bake(&unmoved);
    chiaro_io_free_scene(&near);
    table_end(&table);
}

/* ------------------------------------------------------------------------------------------------------------------
 * Triangles that should not be
 */

/* A room of albedo 0.5 that shines 1: irradiance is 2 pi everywhere, whatever shape is closed and shines like it. */
static Mesh furnace(void) { return mesh_room(0.5f, 1); }

/* The worst receiver on the box itself, whose walls see each other. */
static void check_furnace(Table *table, const char *name, const Mesh *mesh, double truth, double allowed)
{
    char text[96];
    uint32_t far = 0;
    Bake bake = open_lit(mesh, NULL, 0, &far);
    double worst = truth;
    for (uint32_t r = 0; r < bake.transport.receiver_count; r++) {
        double e = (double)bake.irradiance[3 * r];
        worst = fabs(e - truth) > fabs(worst - truth) ? e : worst;
    }
    if (allowed > 0) {
        snprintf(text, sizeof text, "%s: worst receiver", name);
        table_near(table, text, truth, worst, allowed);
    }
    snprintf(text, sizeof text, "%s: numbers out of range", name);
    table_near(table, text, 0, bad_numbers(&bake), 0);
    close_bake(&bake);
}

/* Just above the floor, across the room. */
static void add_needles(Mesh *mesh, float width, float height)
{
    for (uint32_t k = 0; k < 200; k++) {
        float z = 0.02f * (float)k;
        mesh_triangle(mesh, vec3(0, height, z), vec3(0, height, z + width), vec3(3, height, z));
    }
}

static void triangles_that_should_not_be(void **state)
{
    (void)state;
    const double truth = 2 * pi;
    Table table = table_begin("scenes: triangles that should not be, in a furnace of 2 pi");
    Mesh mesh = furnace();
    add_needles(&mesh, 2e-5f, 2e-3f);
    /* Right below a needle, its black back takes up to width / (2 height) of the floor's light. Rays start 1e-5 of the
     * room's diagonal above the floor, and positions are rounded to 4 um: 0.6 %. With 4096 rays that is known to 0.15 %. */
    const double height = 2e-3 - 1e-5 * sqrt(3 * 3 + 2 * 2 + 4 * 4);
    check_furnace(&table, "200 needles, 20 um x 3 m", &mesh, truth, 2.4e-5 / (2 * height) + 3 * 0.0015);
    mesh = furnace();
    add_needles(&mesh, 1e-6f, 1e-4f);
    check_furnace(&table, "200 needles, 1 um x 3 m", &mesh, truth, 0);
    mesh = furnace();
    for (uint32_t k = 0; k < 200; k++) {
        Vec3 p = vec3(1, 1, 0.02f * (float)k), q = vec3(2, 1, 0.02f * (float)k);
        mesh_triangle(&mesh, p, k % 2 ? p : q, k % 3 ? p : vec3_scale(vec3_add(p, q), 0.5f));
        for (uint32_t i = 0; i < 3; i++)
            vec3_store(mesh.vertices[mesh.scene.vertex_count - 1 - i].normal, vec3(0, 1, 0));
    }
    check_furnace(&table, "200 triangles without area", &mesh, truth, 0.01);
    mesh = furnace();
    mesh_box(&mesh, vec3(0, 0, 0), vec3(3, 2, 4));
    mesh_box(&mesh, vec3(0, 0, 0), vec3(3, 2, 4));
    check_furnace(&table, "every face three times", &mesh, truth, 0.01);
    /* A wall that stands free on the floor, two sides of one surface: edges that three and more faces share. */
    mesh = furnace();
    uint32_t front = mesh_material(&mesh, 0.5f, 1);
    mesh_triangle(&mesh, vec3(1, 0, 1), vec3(2, 0, 1), vec3(2, 1, 1));
    uint32_t back = mesh_material(&mesh, 0.5f, 1);
    mesh_triangle(&mesh, vec3(1, 0, 1), vec3(2, 1, 1), vec3(2, 0, 1));
    mesh.parts[front].twin = back, mesh.parts[back].twin = front;
    check_furnace(&table, "a fin on the floor, both sides", &mesh, truth, 0.01);
    mesh = furnace();
    for (uint32_t i = 0; i < 6; i += 3) { /* the floor looks down: seen from the room it is black */
        uint32_t index = mesh.indices[i + 1];
        mesh.indices[i + 1] = mesh.indices[i + 2], mesh.indices[i + 2] = index;
    }
    check_furnace(&table, "a floor that is turned over", &mesh, truth, 0);
    mesh = furnace();
    mesh.materials[0].albedo[0] = mesh.materials[0].albedo[1] = mesh.materials[0].albedo[2] = 0;
    check_furnace(&table, "albedo 0", &mesh, truth / 2, 0.01);
    mesh = furnace();
    mesh.materials[0].albedo[0] = mesh.materials[0].albedo[1] = mesh.materials[0].albedo[2] = 1;
    check_furnace(&table, "albedo 1, taken as 0.99", &mesh, 50 * truth, 0.01);
    mesh = mesh_begin();
    mesh_material(&mesh, 0.5f, 1);
    mesh_triangle(&mesh, vec3(0, 0, 0), vec3(0, 0, 1), vec3(1, 0, 0));
    check_furnace(&table, "one triangle", &mesh, 0, 1e-30);
    static const float lengths[] = {3, 0, NAN};
    for (int k = 0; k < 3; k++) {
        ChiaroBlob blob;
        ChiaroBakeDesc desc = {.struct_size = sizeof desc, .samples = 64, .rays = 16, .receivers = 16};
        char name[64];
        mesh = furnace();
        for (uint32_t v = 0; v < mesh.scene.vertex_count; v++)
            vec3_store(mesh.vertices[v].normal, vec3_scale(vec3_load(mesh.vertices[v].normal), lengths[k]));
        snprintf(name, sizeof name, "normals of length %g: refused", (double)lengths[k]);
        table_near(&table, name, CHIARO_ERROR_SCENE, chiaro_bake(&mesh.scene, &desc, &blob), 0);
        mesh_end(&mesh);
    }
    table_end(&table);
}

/* A ball of a million triangles that share their corners. */
static void an_object_of_a_million_triangles(void **state)
{
    (void)state;
    enum { ROWS = 500, COLUMNS = 1000, CORNERS = (ROWS + 1) * COLUMNS };
    Table table = table_begin("scenes: an object of 1,000,000 triangles under an even sky");
    ChiaroVertex *vertices = new_array(CORNERS, sizeof *vertices);
    uint32_t *indices = new_array((size_t)6 * ROWS * COLUMNS, sizeof *indices), count = 0;
    for (uint32_t v = 0; v < CORNERS; v++) {
        float polar = CHIARO_PI * ((float)(v / COLUMNS) + 0.5f) / (ROWS + 1);
        float turn = 2 * CHIARO_PI * (float)(v % COLUMNS) / COLUMNS;
        Vec3 way = vec3(sinf(polar) * cosf(turn), cosf(polar), sinf(polar) * sinf(turn));
        vertices[v] = (ChiaroVertex){.color = {1, 1, 1, 1}};
        vec3_store(vertices[v].position, way);
        vec3_store(vertices[v].normal, vec3_normalize(way));
    }
    for (uint32_t i = 0; i < ROWS * COLUMNS; i++) {
        uint32_t a = i, b = i / COLUMNS * COLUMNS + (i + 1) % COLUMNS, c = a + COLUMNS, d = b + COLUMNS;
        const uint32_t corners[6] = {a, b, d, a, d, c};
        memcpy(indices + count, corners, sizeof corners);
        count += 6;
    }
    ChiaroMaterial material = {.albedo = {0.5f, 0.5f, 0.5f}, .alpha = 1, .albedo_texture = CHIARO_NONE,
                               .emission_texture = CHIARO_NONE};
    ChiaroPart part = {0, count, 0, CHIARO_NONE};
    ChiaroScene scene = {.vertices = vertices, .indices = indices, .parts = &part, .materials = &material,
                         .vertex_count = CORNERS, .index_count = count, .part_count = 1, .material_count = 1};
    ChiaroBakeObjectDesc desc = {.struct_size = sizeof desc, .rays = 16, .threads = 2};
    ChiaroBlob blob;
    ChiaroObject object;
    ChiaroWorldDesc world_desc = {.struct_size = sizeof world_desc, .object_capacity = 1};
    ChiaroWorld *world;
    const float one[3] = {1, 1, 1}, matrix[16] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
    const ChiaroSky sky = {1, 1, one};
    uint32_t id;
    assert_int_equal(chiaro_bake_object(&scene, &desc, &blob), CHIARO_OK);
    assert_int_equal(chiaro_object_open(blob.data, blob.size, &object, NULL), CHIARO_OK);
    assert_int_equal(chiaro_world_create(&world_desc, &world), CHIARO_OK);
    assert_int_equal(chiaro_world_sky(world, &sky), CHIARO_OK);
    assert_int_equal(chiaro_object_add(world, &object, matrix, &id), CHIARO_OK);
    while (chiaro_world_update(world, 10, NULL) > 0) {
    }
    double worst = pi;
    for (uint32_t v = 0; v < CORNERS; v += 997) {
        float light[3];
        assert_int_equal(chiaro_object_irradiance(world, id, v, light), CHIARO_OK);
        worst = fabs((double)light[0] - pi) > fabs(worst - pi) ? (double)light[0] : worst;
    }
    table_near(&table, "vertices that come out", CORNERS, object.vertex_count, 0);
    table_near(&table, "worst vertex", pi, worst, 0.01);
    chiaro_world_destroy(world);
    chiaro_blob_free(&blob);
    free(vertices);
    free(indices);
    table_end(&table);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(size_and_place_do_not_matter),
        cmocka_unit_test(triangles_that_should_not_be),
        cmocka_unit_test(a_file_may_lie_anywhere),
        cmocka_unit_test(an_object_of_a_million_triangles),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
