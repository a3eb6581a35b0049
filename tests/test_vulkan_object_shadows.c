/* Moving objects and what stays, in the renderer: their shadows against the same thing built into the scene, how they
 * darken and light static surfaces, and the light that they get from there. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <math.h>
#include <stdlib.h>

#include "chiaro_shared.h"
#include "common/play.h"

/* ---- shadows ------------------------------------------------------------------------------------------------------ */

/* The floor, with the shape on it as a part of the scene. */
static Mesh with_shape(const TestScene *made, const float m[16])
{
    Mesh mesh = floor_mesh();
    mesh_material(&mesh, 0.7f, 0);
    for (uint32_t i = 0; i < made->scene.index_count; i += 3) {
        Vec3 corners[3];
        for (uint32_t k = 0; k < 3; k++) {
            const float *p = made->scene.vertices[made->scene.indices[i + k]].position;
            corners[k] = vec3(m[0] * p[0] + m[4] * p[1] + m[8] * p[2] + m[12],
                              m[1] * p[0] + m[5] * p[1] + m[9] * p[2] + m[13],
                              m[2] * p[0] + m[6] * p[1] + m[10] * p[2] + m[14]);
        }
        mesh_triangle(&mesh, corners[0], corners[1], corners[2]);
    }
    return mesh;
}

static void render_built_in(const ChiaroLight *light, const TestScene *made, const float transform[16], float *picture)
{
    Stage stage = open_stage((HostDesc){0});
    Mesh mesh = with_shape(made, transform);
    MadeTransportDesc desc = {.mesh_steps = 1, .sample_steps = 1, .points = 1, .links = 1};
    create_context(&stage, NULL);
    set_component(&stage, CHIARO_COMPONENT_PUNCTUAL, true);
    load(&stage, &mesh.scene, &desc);
    look_down(&stage);
    assert_int_equal(stage.api->lights_set(stage.chiaro, light, 1), CHIARO_OK);
    memcpy(picture, render(&stage), SIZE * SIZE * 4 * sizeof(float));
    close_stage(&stage);
    mesh_end(&mesh);
}

/* The floor from above, a world for shapes over it, and lights. */
static void load_play(Play *play, const MadeTransportDesc *desc, const Shape *shape, const ChiaroLight *lights,
                      uint32_t count)
{
    load(&play->stage, &play->scene.scene, desc);
    look_down(&play->stage);
    play->world = make_world(4, CHIARO_CUBE_UNORM8, NULL);
    load_objects(play, &shape->made.scene, &shape->object);
    assert_int_equal(play->stage.api->lights_set(play->stage.chiaro, lights, count), CHIARO_OK);
}

/* A picture in tiles, each through a projection that shows no more than it, is the picture: nothing that lies across the edge
 * of a tile is taken to be beyond it. */
static void no_edge_of_a_picture_hides_what_crosses_it(void **state)
{
    (void)state;
    enum { TILES = 8, EDGE = SIZE / TILES };
    static float whole[SIZE * SIZE * 4];
    Shape shape = make_shape("sphere", 1);
    const ChiaroLight sun = sun_light(vec3(-0.6f, -1, -0.3f), 3);
    Play play = {.stage = open_stage((HostDesc){0}), .scene = floor_mesh()};
    MadeTransportDesc desc = {.mesh_steps = 1, .sample_steps = 1, .points = 1, .links = 1};
    ChiaroVulkanDraw *draw = &play.stage.draw;
    create_context(&play.stage, NULL);
    set_component(&play.stage, CHIARO_COMPONENT_PUNCTUAL, true);
    load_play(&play, &desc, &shape, &sun, 1);
    for (uint32_t k = 0; k < 4; k++) {
        float transform[16];
        moved_to(transform, vec3(1.1f * (float)k - 1.5f, 0.4f, 0.7f * (float)(k % 2)), 0.3f, 0.2f + 0.3f * (float)k);
        add_object(&play, &shape.object, transform);
    }
    memcpy(whole, render(&play.stage), sizeof whole);
    const ChiaroVulkanDraw all = *draw;
    uint32_t different = 0, seen = 0;
    for (uint32_t tile = 0; tile < TILES * TILES; tile++) {
        const uint32_t at[2] = {tile % TILES, tile / TILES};
        for (uint32_t column = 0; column < 4; column++) {
            for (uint32_t axis = 0; axis < 2; axis++)
                draw->projection[4 * column + axis] =
                    TILES * all.projection[4 * column + axis] +
                    ((float)TILES - 1 - 2 * (float)at[axis]) * all.projection[4 * column + 3];
        }
        draw->viewport = (VkViewport){(float)(at[0] * EDGE), (float)(at[1] * EDGE), EDGE, EDGE, 0, 1};
        draw->scissor = (VkRect2D){{(int32_t)(at[0] * EDGE), (int32_t)(at[1] * EDGE)}, {EDGE, EDGE}};
        const float *pixels = render(&play.stage);
        for (uint32_t i = 0; i < EDGE * EDGE; i++) {
            size_t place = 4 * ((size_t)(at[1] * EDGE + i / EDGE) * SIZE + at[0] * EDGE + i % EDGE);
            different += fabsf(pixels[place] - whole[place]) > 1e-3f;
            seen += whole[place] > 0;
        }
    }
    printf("  %u of %u pixels differ\n", different, seen);
    assert_true(seen > SIZE * SIZE / 4);
    assert_true(different < seen / 1000); /* rims, where the edge of a tile has cut a triangle */
    close_play(&play);
    free_shape(&shape);
}

/* Lit, shadowing itself and the floor, exactly as if it were a part of the scene; and again where it has moved to. */
static void objects_cast_the_shadows_of_things_that_stay(void **state)
{
    (void)state;
    static float built_in[SIZE * SIZE * 4];
    Shape shape = make_shape("box", 1);
    const ChiaroLight lights[3] = {point_light(vec3(1.2f, 2.4f, 0.7f), 5),
                                   spot_light(vec3(2.5f, 3, 1.5f), vec3(0, 0, 0), 30),
                                   sun_light(vec3(-0.6f, -1, -0.3f), 3)};
    for (int l = 0; l < 3; l++) {
        Play play = {.stage = open_stage((HostDesc){0}), .scene = floor_mesh()};
        MadeTransportDesc desc = {.mesh_steps = 1, .sample_steps = 1, .points = 1, .links = 1};
        float transform[16];
        create_context(&play.stage, NULL);
        set_component(&play.stage, CHIARO_COMPONENT_PUNCTUAL, true);
        load_play(&play, &desc, &shape, &lights[l], 1);
        moved_to(transform, vec3(0, 0.5f, 0), 0.3f, 1);
        uint32_t id = add_object(&play, &shape.object, transform);
        for (int step = 0; step < 2; step++) {
            moved_to(transform, vec3(-0.7f * (float)step, 0.5f, 0.4f * (float)step), 0.3f + (float)step, 1);
            assert_int_equal(chiaro_object_move(play.world, id, transform), CHIARO_OK);
            const float *pixels = render(&play.stage);
            render_built_in(&lights[l], &shape.made, transform, built_in);
            uint32_t different = 0, bright = 0;
            for (size_t i = 0; i < SIZE * SIZE; i++) {
                different += fabsf(pixels[4 * i] - built_in[4 * i]) > 2e-3f;
                bright += built_in[4 * i] > 2e-3f;
            }
            printf("  light %d, place %d: %u of %u lit pixels differ\n", l, step, different, bright);
            assert_true(bright > SIZE * SIZE / 10);
            assert_true(different < SIZE * SIZE / 200); /* rims of shadows */
        }
        close_play(&play);
    }
    free_shape(&shape);
}

static void only_views_that_an_object_is_in_are_drawn_again(void **state)
{
    (void)state;
    Shape shape = make_shape("box", 0.5f);
    Play play = {.stage = open_stage((HostDesc){0}), .scene = floor_mesh()};
    MadeTransportDesc desc = {.mesh_steps = 1, .sample_steps = 1, .points = 1, .links = 1};
    ChiaroLight lights[2] = {point_light(vec3(1.5f, 1, 0), 1), point_light(vec3(-2, 1, 0), 1)};
    ChiaroVulkanStats stats = {.struct_size = sizeof stats};
    float transform[16];
    lights[0].range = lights[1].range = 1.2f;
    create_context(&play.stage, NULL);
    load_play(&play, &desc, &shape, lights, 2);
    moved_to(transform, vec3(1.5f, 0.3f, 0), 0, 1);
    uint32_t id = add_object(&play, &shape.object, transform);
    /* Below a light it is in the view down; level with it and beside it, in the one to that side, and at its edges. */
    const struct {
        Vec3 place;
        uint32_t passes;
    } ways[6] = {{{1.5f, 0.3f, 0}, 12}, {{1.5f, 0.3f, 0}, 0}, {{1.5f, 0.25f, 0}, 1}, {{0.4f, 1, 0}, 2},
                 {{0.35f, 1, 0}, 1},    {{-0.1f, 1, 0}, 1}};
    for (int i = 0; i < 6; i++) {
        moved_to(transform, ways[i].place, 0, 1);
        assert_int_equal(chiaro_object_move(play.world, id, transform), CHIARO_OK);
        render(&play.stage);
        assert_int_equal(play.stage.api->stats(play.stage.chiaro, &stats), CHIARO_OK);
        assert_int_equal(stats.shadow_passes, ways[i].passes);
    }
    /* It goes: the light that it was not in has nothing to see. */
    assert_int_equal(play.stage.api->object_show(play.stage.chiaro, id, CHIARO_NONE), CHIARO_OK);
    render(&play.stage);
    assert_int_equal(object_stats(&play).shown, 0);
    close_play(&play);
    free_shape(&shape);
}

/* Four of them may wait for one another, but not for long, and the picture ends the same. */
static void views_take_turns_where_they_are_limited(void **state)
{
    (void)state;
    static float at_once[SIZE * SIZE * 4];
    Shape shape = make_shape("box", 0.5f);
    Play play = {.stage = open_stage((HostDesc){0}), .scene = floor_mesh()};
    MadeTransportDesc desc = {.mesh_steps = 6, .sample_steps = 6, .points = 1, .links = 8};
    ChiaroVulkanStats stats = {.struct_size = sizeof stats};
    ChiaroLight lights[4];
    float here[16], there[16];
    for (uint32_t i = 0; i < 4; i++)
        lights[i] = point_light(vec3(i % 2 ? -1.5f : 1.5f, 2, i / 2 ? -1.5f : 1.5f), 1);
    create_context(&play.stage, NULL);
    load_play(&play, &desc, &shape, lights, 4);
    moved_to(here, vec3(0.2f, 0.3f, 0.1f), 0.3f, 1);
    moved_to(there, vec3(-0.3f, 0.4f, -0.2f), 0.8f, 1);
    uint32_t id = add_object(&play, &shape.object, here);
    memcpy(at_once, settled(&play), sizeof at_once);
    assert_int_equal(chiaro_object_move(play.world, id, there), CHIARO_OK);
    settled(&play);
    uint32_t passes = 0, frames = 0;
    play.stage.shadow_views = 1;
    assert_int_equal(chiaro_object_move(play.world, id, here), CHIARO_OK);
    do {
        render(&play.stage);
        assert_int_equal(play.stage.api->stats(play.stage.chiaro, &stats), CHIARO_OK);
        assert_true(stats.shadow_passes <= 1);
        passes += stats.shadow_passes;
    } while (stats.shadow_passes > 0 && ++frames < 25);
    assert_in_range(passes, 4, 24);
    assert_int_equal(frames, passes);
    assert_memory_equal(settled(&play), at_once, sizeof at_once);
    close_play(&play);
    free_shape(&shape);
}

/* ---- back onto the static world ----------------------------------------------------------------------------------- */

/* Fractions cannot be compared while compiling. */
static void constants_of_blockers_are_the_shaders(void **state)
{
    (void)state;
    assert_true(CHIARO_BLOCKER_NEAR == (float)CHIARO_NEAR);
    assert_true(CHIARO_BLOCKER_REACH == (float)CHIARO_REACH);
    assert_true(CHIARO_BLOCKER_GAP == (float)CHIARO_GAP);
}

/* The floor, 6 m wide, from straight above, cut into 3 m pieces: the triangle that a place lies in, and what its corners
 * count there. */
typedef struct Spot {
    float corner[3][3]; /* on the floor */
    Vec3 weight;
} Spot;

static Spot spot_at(float x, float z)
{
    float u = (x + 3) / 3, v = (3 - z) / 3, i = floorf(u), j = floorf(v);
    bool lower = u - i >= v - j;
    Vec3 weight = lower ? vec3(1 - u + i, u - i - v + j, v - j) : vec3(1 - v + j, v - j - u + i, u - i);
    float at[3][2] = {{i, j}, {lower ? i + 1 : i, lower ? j : j + 1}, {i + 1, j + 1}};
    Spot spot = {.weight = weight};
    for (int k = 0; k < 3; k++)
        spot.corner[k][0] = 3 * at[k][0] - 3, spot.corner[k][2] = 3 - 3 * at[k][1];
    return spot;
}

static Vec3 pixel_place(uint32_t i)
{
    const float scale = 6.0f / SIZE;
    return vec3(((float)(i % SIZE) + 0.5f - SIZE / 2) * scale, 0, ((float)(i / SIZE) + 0.5f - SIZE / 2) * scale);
}

/* What a picture that is linear within the triangle shows at a spot's corners. */
static void corner_values(const float *picture, const Spot *spot, float values[3][3])
{
    Vec3 row[3];
    const float *color[3];
    for (int k = 0; k < 3; k++) {
        float x = 0, z = 0;
        for (int c = 0; c < 3; c++) {
            float part = c == k ? 0.8f : 0.1f;
            x += part * spot->corner[c][0], z += part * spot->corner[c][2];
        }
        uint32_t i = (uint32_t)((z / 6 + 0.5f) * SIZE) * SIZE + (uint32_t)((x / 6 + 0.5f) * SIZE);
        Vec3 place = pixel_place(i);
        row[k] = spot_at(place.x, place.z).weight;
        color[k] = picture + 4 * (size_t)i;
    }
    Vec3 crosses[3] = {vec3_cross(row[1], row[2]), vec3_cross(row[2], row[0]), vec3_cross(row[0], row[1])};
    for (int c = 0; c < 3; c++) {
        Vec3 sum = {0, 0, 0};
        for (int k = 0; k < 3; k++)
            sum = vec3_mad(sum, crosses[k], color[k][c] / vec3_dot(row[0], crosses[0]));
        values[0][c] = sum.x, values[1][c] = sum.y, values[2][c] = sum.z;
    }
}

/* What the floor shows: the far half of what the CPU says at the corners, the near one at the place itself; no less than
 * nothing. Returns the share of its light that is left. */
static double floor_color(ChiaroWorld *world, const float *alone, Vec3 place, float color[3])
{
    const float up[3] = {0, 1, 0}, albedo = 0.7f / CHIARO_PI;
    Spot spot = spot_at(place.x, place.z);
    float values[3][3], weights[3], point[3], bounce[3];
    ChiaroBlockedFar mean = {.open = 1};
    double before = 0, after = 0;
    corner_values(alone, &spot, values);
    vec3_store(weights, spot.weight);
    vec3_store(point, place);
    memset(color, 0, 3 * sizeof *color);
    for (int k = 0; k < 3; k++) {
        ChiaroBlockedFar far;
        chiaro_world_blocked_far(world, spot.corner[k], up, &far);
        for (int c = 0; c < 3; c++) {
            before += (double)(weights[k] * values[k][c]);
            color[c] += weights[k] * (far.open * values[k][c] + albedo * far.bounce[c]);
            mean.hidden[c] += weights[k] * (far.hidden[3] * values[k][c] / albedo + far.hidden[c]);
        }
        for (int c = 0; c < 4; c++)
            mean.shine[c] += weights[k] * far.shine[c];
        mean.seen += weights[k] * far.seen;
    }
    float open = chiaro_world_blocked_near(world, point, up, &mean, bounce);
    for (int c = 0; c < 3; c++) {
        color[c] = fmaxf(0, open * fmaxf(0, color[c]) + albedo * bounce[c]);
        after += (double)color[c];
    }
    return after / before;
}

/* Grids that a small budget sends in pieces end in the same picture, and meanwhile no frame sends much. */
static void pieces_end_in_the_same_picture(Play *play, const float transform[16], const float *pixels)
{
    const ChiaroVulkanApi *api = play->stage.api;
    ChiaroVulkanStats stats = {.struct_size = sizeof stats};
    static float before[SIZE * SIZE * 4];
    uint64_t most[2] = {0, 0};
    float away[16];
    memcpy(before, pixels, sizeof before);
    moved_to(away, vec3(-1, 1.2f, 0.7f), 0.2f, 1);
    for (uint32_t sliced = 0; sliced < 2; sliced++) {
        play->stage.budget.units = sliced ? 12 : 0;
        for (uint32_t back = 0; back < 2; back++) {
            assert_int_equal(chiaro_object_move(play->world, 0, back ? transform : away), CHIARO_OK);
            do {
                render(&play->stage);
                assert_int_equal(api->stats(play->stage.chiaro, &stats), CHIARO_OK);
                most[sliced] = stats.upload_bytes > most[sliced] ? stats.upload_bytes : most[sliced];
            } while (!chiaro_world_settled(play->world));
            assert_true(memcmp(before, settled(play), sizeof before) == 0 || !back);
        }
    }
    printf("  %llu bytes in a frame at most, in pieces %llu\n", (unsigned long long)most[0],
           (unsigned long long)most[1]);
    assert_true(most[1] < most[0]);
}

/* Under the sky: the picture with the object is the picture without it, as the CPU says that it changes. */
static void the_floor_is_darkened_as_the_cpu_says(void **state, const char *name)
{
    (void)state;
    static float alone[SIZE * SIZE * 4];
    const float eye = 40;
    float white[3] = {1, 0.8f, 0.6f}, transform[16];
    const ChiaroSky sky = {1, 1, white};
    Shape shape = make_shape(name, 1);
    Play play = {.stage = open_stage((HostDesc){0}), .scene = floor_mesh()};
    MadeTransportDesc desc = {.mesh_steps = 2, .sample_steps = 3, .points = 1, .links = 20, .sky = true};
    create_context(&play.stage, NULL);
    set_component(&play.stage, CHIARO_COMPONENT_INDIRECT, false);
    load(&play.stage, &play.scene.scene, &desc);
    set_camera(&play.stage, vec3(0, eye, 0), vec3(0, -1, 0), vec3(0, 0, -1), 2 * atanf(3 / eye));
    play.world = make_world(4, CHIARO_CUBE_UNORM8, NULL);
    load_objects(&play, &shape.made.scene, &shape.object);
    assert_int_equal(play.stage.api->sky_set(play.stage.chiaro, &sky), CHIARO_OK);
    memcpy(alone, render(&play.stage), sizeof alone);
    moved_to(transform, vec3(0.3f, 0.8f, -0.2f), 0.5f, 1.2f);
    add_object(&play, &shape.object, transform);
    const float *pixels = settled(&play);
    double worst = 0, largest = 0, darkest = 1;
    for (uint32_t i = 0; i < SIZE * SIZE; i++) {
        Vec3 p = pixel_place(i);
        float color[3];
        if (hypotf(p.x - 0.3f, p.z + 0.2f) < 1.15f || fabsf(p.x) > 2.95f || fabsf(p.z) > 2.95f)
            continue; /* the object is in front */
        darkest = fmin(darkest, floor_color(play.world, alone, p, color));
        for (uint32_t c = 0; c < 3; c++) {
            worst = fmax(worst, fabs((double)(pixels[4 * i + c] - color[c])));
            largest = fmax(largest, (double)color[c]);
        }
    }
    printf("  %s: darkest %.2f of the sky is left, worst error %.1e of the largest\n", name, darkest, worst / largest);
    assert_true(largest > 0 && darkest < 0.95);
    assert_below("floor", 0, worst / largest, 1e-4);
    pieces_end_in_the_same_picture(&play, transform, pixels);
    close_play(&play);
    free_shape(&shape);
}

static void a_ball_darkens_the_floor_as_the_cpu_says(void **state)
{
    the_floor_is_darkened_as_the_cpu_says(state, "sphere");
}

static void a_box_darkens_the_floor_as_the_cpu_says(void **state)
{
    the_floor_is_darkened_as_the_cpu_says(state, "box");
}

/* ---- light of the static scene ------------------------------------------------------------------------------------ */

static void update_when(Stage *stage, uint64_t completed)
{
    must(stage, host_begin(&stage->host));
    ChiaroVulkanUpdate info = {.struct_size = sizeof info,
                               .command_buffer = stage->host.commands,
                               .frame = stage->host.frame,
                               .completed_frame = completed};
    assert_int_equal(stage->api->update(stage->chiaro, &info), CHIARO_OK);
    must(stage, host_submit(&stage->host));
}

/* A closed room that glows. Its light reaches the world when the host says that the frame has finished, not before; and
 * it is what the CPU computes. */
static void light_of_the_scene_comes_back_without_waiting(void **state)
{
    (void)state;
    Shape shape = make_shape("sphere", 0.6f);
    Play play = {.stage = open_stage((HostDesc){0}), .scene = mesh_begin()};
    ChiaroBakeDesc bake = {.struct_size = sizeof bake, .samples = 128, .rays = 64, .links = 16};
    ChiaroBlob blob;
    ChiaroTransport transport;
    ChiaroWorld *twin;
    uint32_t id, twin_id;
    float transform[16], light[3], expected[3];
    mesh_material(&play.scene, 0.5f, 1);
    mesh_box(&play.scene, vec3(-1, 0, -1), vec3(1, 2, 1));
    assert_int_equal(chiaro_bake(&play.scene.scene, &bake, &blob), CHIARO_OK);
    assert_int_equal(chiaro_transport_open(blob.data, blob.size, &transport, NULL), CHIARO_OK);
    create_context(&play.stage, NULL);
    must(&play.stage, host_begin(&play.stage.host));
    ChiaroVulkanLoad info = {.struct_size = sizeof info,
                             .transport = &transport,
                             .command_buffer = play.stage.host.commands,
                             .frame = play.stage.host.frame};
    assert_int_equal(play.stage.api->scene_load(play.stage.chiaro, &info), CHIARO_OK);
    must(&play.stage, host_submit(&play.stage.host));
    play.world = make_world(4, CHIARO_CUBE_UNORM8, &transport);
    load_objects(&play, &shape.made.scene, &shape.object);
    moved_to(transform, vec3(0.2f, 0.9f, -0.1f), 0, 1);
    id = add_object(&play, &shape.object, transform);
    for (int i = 0; i < 5; i++) {
        update_when(&play.stage, 2); /* loading has finished; no frame of light */
        assert_int_equal(chiaro_object_irradiance(play.world, id, 0, light), CHIARO_OK);
        assert_true(light[0] == 0);
    }
    for (int i = 0; i < 60; i++)
        update_when(&play.stage, play.stage.host.frame - 1);

    float *values = new_array(9 * ((size_t)transport.node_count + transport.sample_count + transport.receiver_count),
                              sizeof *values);
    float *direct = values + 3 * ((size_t)transport.node_count + transport.sample_count);
    float *irradiance = direct + 3 * (size_t)transport.node_count;
    chiaro_transport_update(&transport, NULL, 0, NULL, NULL, NULL, values, irradiance);
    chiaro_samples_light(&transport, NULL, 0, NULL, NULL, direct);
    chiaro_tree_sum(&transport, direct);
    twin = make_world(4, CHIARO_CUBE_UNORM8, &transport);
    ChiaroWorldLight given = {.struct_size = sizeof given, .direct = direct, .total = values, .stride = 3};
    assert_int_equal(chiaro_world_light(twin, &given), CHIARO_OK);
    assert_int_equal(chiaro_object_add(twin, &shape.object, transform, &twin_id), CHIARO_OK);
    while (chiaro_world_update(twin, 100, NULL) > 0)
        continue;
    for (uint32_t v = 0; v < shape.object.vertex_count; v++) {
        chiaro_object_irradiance(play.world, id, v, light);
        chiaro_object_irradiance(twin, twin_id, v, expected);
        assert_true(expected[0] > 0);
        for (int c = 0; c < 3; c++)
            assert_near("irradiance", v, (double)light[c], (double)expected[c], 1e-3 * (double)expected[c]);
    }
    chiaro_world_destroy(twin);
    free(values);
    close_play(&play);
    chiaro_blob_free(&blob);
    free_shape(&shape);
}

/* Renders the indirect component of a baked scene until all of it is settled. */
static const float *lit_picture(Play *play, float *picture)
{
    for (int i = 0; i < 40; i++)
        update_when(&play->stage, play->stage.host.frame - 1);
    memcpy(picture, settled(play), SIZE * SIZE * 4 * sizeof *picture);
    return picture;
}

/* A panel that glows over the floor: a ball under it throws a shadow where its line from the panel meets the floor, as deep
 * as the CPU says. */
static void a_ball_throws_a_shadow_in_light_that_is_no_lamps(void **state)
{
    (void)state;
    static float alone[SIZE * SIZE * 4], with[SIZE * SIZE * 4];
    const Vec3 panel = {0.9f, 2.6f, 0.4f}, ball = {0.45f, 1, 0.2f}, along = vec3_sub(ball, panel);
    const float eye = 40, up[3] = {0, 1, 0}, albedo = 0.7f / CHIARO_PI, half = 0.4f;
    Shape shape = make_shape("sphere", 0.5f);
    Play play = {.stage = open_stage((HostDesc){0}), .scene = floor_mesh()};
    ChiaroBakeDesc bake = {.struct_size = sizeof bake, .samples = 1024, .rays = 256, .receivers = 4000};
    ChiaroBlob blob;
    ChiaroTransport transport;
    float transform[16];
    mesh_material(&play.scene, 0.5f, 30);
    mesh_quad(&play.scene, vec3(panel.x - half, panel.y, panel.z - half), vec3(panel.x + half, panel.y, panel.z - half),
              vec3(panel.x + half, panel.y, panel.z + half), vec3(panel.x - half, panel.y, panel.z + half));
    assert_int_equal(chiaro_bake(&play.scene.scene, &bake, &blob), CHIARO_OK);
    assert_int_equal(chiaro_transport_open(blob.data, blob.size, &transport, NULL), CHIARO_OK);
    create_context(&play.stage, NULL);
    set_component(&play.stage, CHIARO_COMPONENT_INDIRECT, false);
    load_transport(&play.stage, &transport);
    set_camera(&play.stage, vec3(0, eye, 0), vec3(0, -1, 0), vec3(0, 0, -1), 2 * atanf(3 / eye));
    play.world = make_world(4, CHIARO_CUBE_UNORM8, &transport);
    load_objects(&play, &shape.made.scene, &shape.object);
    lit_picture(&play, alone);
    moved_to(transform, ball, 0, 1);
    add_object(&play, &shape.object, transform);
    lit_picture(&play, with);
    Vec3 foot = vec3_mad(ball, along, -ball.y / along.y), darkest = {0, 0, 0};
    double wrong = 0, change = 0, least = 1;
    for (uint32_t i = 0; i < SIZE * SIZE; i++) {
        Vec3 p = pixel_place(i);
        float point[3], bounce[3], before = alone[4 * i];
        if (hypotf(p.x - ball.x, p.z - ball.z) < 0.3f || fabsf(p.x) > 2.9f || fabsf(p.z) > 2.9f)
            continue; /* the ball is in front */
        vec3_store(point, p);
        float open = chiaro_world_blocked(play.world, point, up, bounce);
        double told = fmax(0, (double)(open * before + albedo * bounce[0])), shown = (double)with[4 * i];
        wrong += (shown - told) * (shown - told), change += (shown - (double)before) * (shown - (double)before);
        if (shown / (double)before < least)
            least = shown / (double)before, darkest = p;
    }
    float off = hypotf(darkest.x - foot.x, darkest.z - foot.z);
    printf("  %.2f of the light is left where it is darkest, %.2f m from where it should be; the CPU is %.3f away\n", least,
           (double)off, sqrt(wrong / change));
    assert_below("left", 0, least, 0.55);
    assert_below("place", 0, (double)off, 0.25);
    assert_below("as the CPU says", 0, sqrt(wrong / change), 0.1);
    close_play(&play);
    chiaro_blob_free(&blob);
    free_shape(&shape);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(constants_of_blockers_are_the_shaders),
        cmocka_unit_test(no_edge_of_a_picture_hides_what_crosses_it),
        cmocka_unit_test(objects_cast_the_shadows_of_things_that_stay),
        cmocka_unit_test(only_views_that_an_object_is_in_are_drawn_again),
        cmocka_unit_test(views_take_turns_where_they_are_limited),
        cmocka_unit_test(a_ball_darkens_the_floor_as_the_cpu_says),
        cmocka_unit_test(a_box_darkens_the_floor_as_the_cpu_says),
        cmocka_unit_test(light_of_the_scene_comes_back_without_waiting),
        cmocka_unit_test(a_ball_throws_a_shadow_in_light_that_is_no_lamps),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
