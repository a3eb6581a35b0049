/* Scene checks, textures, surface colours, lamps, the sky, and rays: one point at a time. */
#include "../src/offline/parallel.h"
#include "../src/offline/rays.h"
#include "common/mesh.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

static void remember(ChiaroLogLevel level, ChiaroLogItem item, const char *message, void *user)
{
    assert_int_equal(level, CHIARO_LOG_ERROR);
    assert_int_equal(item, CHIARO_LOG_SCENE_INVALID);
    assert_non_null(message);
    (*(int *)user)++;
}

static void assert_refused(const ChiaroScene *scene)
{
    int messages = 0;
    ChiaroLog log = {remember, &messages};
    assert_int_equal(chiaro_scene_check(scene, &log), CHIARO_ERROR_SCENE);
    assert_int_equal(messages, 1);
}

static Mesh small_mesh(void)
{
    Mesh mesh = mesh_begin();
    mesh_material(&mesh, 0.5f, 0);
    mesh_quad(&mesh, vec3(0, 0, 0), vec3(1, 0, 0), vec3(1, 1, 0), vec3(0, 1, 0));
    return mesh;
}

/* With its other side, of another material. */
static Mesh two_sided_mesh(void)
{
    Mesh mesh = small_mesh();
    mesh_material(&mesh, 0.2f, 0);
    mesh_triangle(&mesh, vec3(1, 1, 0), vec3(1, 0, 0), vec3(0, 0, 0));
    mesh_triangle(&mesh, vec3(0, 1, 0), vec3(1, 1, 0), vec3(0, 0, 0));
    mesh.parts[0].twin = 1, mesh.parts[1].twin = 0;
    return mesh;
}

/* Changes one number, expects one message, and puts it back. */
#define REFUSES(lvalue, bad)                                                                                           \
    do {                                                                                                               \
        __typeof__(lvalue) kept = (lvalue);                                                                            \
        (lvalue) = (bad);                                                                                              \
        assert_refused(&mesh.scene);                                                                                   \
        (lvalue) = kept;                                                                                               \
        assert_int_equal(chiaro_scene_check(&mesh.scene, NULL), CHIARO_OK);                                            \
    } while (0)

static void every_wrong_number_of_a_scene_is_refused_once(void **state)
{
    (void)state;
    Mesh mesh = small_mesh();
    assert_int_equal(chiaro_scene_check(&mesh.scene, NULL), CHIARO_OK);
    REFUSES(mesh.vertices[2].position[1], NAN);
    REFUSES(mesh.vertices[2].position[1], 1e30f);
    REFUSES(mesh.vertices[1].normal[2], 0.5f);
    REFUSES(mesh.vertices[1].normal[0], INFINITY);
    REFUSES(mesh.vertices[0].uv[0], NAN);
    REFUSES(mesh.vertices[0].color[3], -1);
    REFUSES(mesh.indices[4], 6);
    REFUSES(mesh.materials[0].albedo[0], -0.1f);
    REFUSES(mesh.materials[0].emission[2], INFINITY);
    REFUSES(mesh.materials[0].alpha, 2);
    REFUSES(mesh.materials[0].albedo_texture, 0);
    REFUSES(mesh.parts[0].material, 1);
    REFUSES(mesh.parts[0].first_index, 3);
    REFUSES(mesh.parts[0].index_count, 4);
    REFUSES(mesh.parts[0].index_count, UINT32_MAX - 2);
    REFUSES(mesh.parts[0].index_count, 0);
    REFUSES(mesh.parts[0].twin, 0);
    REFUSES(mesh.scene.index_count, 5);
    REFUSES(mesh.scene.vertices, NULL);
    mesh_end(&mesh);
}

static void textures_that_reach_beyond_the_pixels_are_refused(void **state)
{
    (void)state;
    Mesh mesh = small_mesh();
    uint8_t pixels[16] = {0};
    ChiaroTexture texture = {.width = 2, .height = 2};
    mesh.scene.textures = &texture, mesh.scene.texture_count = 1;
    mesh.scene.pixels = pixels, mesh.scene.pixel_bytes = sizeof pixels;
    mesh.materials[0].albedo_texture = 0;
    assert_int_equal(chiaro_scene_check(&mesh.scene, NULL), CHIARO_OK);
    REFUSES(texture.first_byte, 1);
    REFUSES(texture.first_byte, UINT64_MAX - 3);
    REFUSES(texture.width, 0);
    REFUSES(texture.height, 32769);
    REFUSES(texture.wrap_v, 3);
    mesh_end(&mesh);
}

static void a_twin_must_be_the_other_side(void **state)
{
    (void)state;
    Mesh mesh = two_sided_mesh();
    assert_int_equal(chiaro_scene_check(&mesh.scene, NULL), CHIARO_OK);
    REFUSES(mesh.vertices[6].position[0], 0.5f);
    REFUSES(mesh.parts[1].twin, CHIARO_NONE);
    REFUSES(mesh.indices[6], 7);
    mesh_end(&mesh);
}

static void lights_and_skies_are_checked(void **state)
{
    (void)state;
    ChiaroLight spot = {.type = CHIARO_LIGHT_SPOT, .direction = {0, -1, 0}, .intensity = {1, 2, 3}, .cos_inner = 0.9f,
                        .cos_outer = 0.5f}, bad;
    assert_int_equal(chiaro_light_check(&spot), CHIARO_OK);
    bad = spot, bad.intensity[1] = -1;
    assert_int_equal(chiaro_light_check(&bad), CHIARO_ERROR_ARGUMENT);
    bad = spot, bad.direction[1] = -2;
    assert_int_equal(chiaro_light_check(&bad), CHIARO_ERROR_ARGUMENT);
    bad = spot, bad.cos_outer = 0.95f;
    assert_int_equal(chiaro_light_check(&bad), CHIARO_ERROR_ARGUMENT);
    bad = spot, bad.range = NAN;
    assert_int_equal(chiaro_light_check(&bad), CHIARO_ERROR_ARGUMENT);
    bad = spot, bad.type = 3;
    assert_int_equal(chiaro_light_check(&bad), CHIARO_ERROR_ARGUMENT);

    float radiance[6] = {0, 1, 2, 3, 4, 5};
    ChiaroSky sky = {2, 1, radiance};
    assert_int_equal(chiaro_sky_check(&sky), CHIARO_OK);
    radiance[4] = INFINITY;
    assert_int_equal(chiaro_sky_check(&sky), CHIARO_ERROR_ARGUMENT);
    radiance[4] = 4, sky.width = 0;
    assert_int_equal(chiaro_sky_check(&sky), CHIARO_ERROR_ARGUMENT);
}

/* ------------------------------------------------------------------------------------------------------------------
 * Textures
 */

/* One row of two texels; red is what is looked at. */
static float red_at(uint32_t wrap, uint32_t nearest, float u)
{
    const uint8_t pixels[8] = {0, 0, 0, 0, 255, 128, 0, 255};
    ChiaroTexture texture = {.width = 2, .height = 1, .wrap_u = wrap, .wrap_v = wrap, .nearest = nearest};
    ChiaroScene scene = {.textures = &texture, .texture_count = 1, .pixels = pixels, .pixel_bytes = sizeof pixels};
    float uv[2] = {u, 0.3f}, rgba[4];
    chiaro_texture_sample(&scene, 0, uv, rgba);
    assert_float_equal(rgba[3], rgba[0], 1e-6f); /* linear light and alpha filter alike */
    return rgba[0];
}

static void textures_wrap_and_filter(void **state)
{
    (void)state;
    for (int k = -3; k <= 3; k++) { /* whole periods change nothing */
        float shift = (float)k;
        assert_float_equal(red_at(CHIARO_WRAP_REPEAT, 0, 0.25f + shift), 0, 1e-5f);
        assert_float_equal(red_at(CHIARO_WRAP_REPEAT, 0, 0.75f + shift), 1, 1e-5f);
        assert_float_equal(red_at(CHIARO_WRAP_REPEAT, 0, 0.5f + shift), 0.5f, 1e-5f);
        assert_float_equal(red_at(CHIARO_WRAP_REPEAT, 0, 0.0f + shift), 0.5f, 1e-5f);
        assert_float_equal(red_at(CHIARO_WRAP_REPEAT, 1, 0.49f + shift), 0, 0);
        assert_float_equal(red_at(CHIARO_WRAP_REPEAT, 1, 0.51f + shift), 1, 0);
        assert_float_equal(red_at(CHIARO_WRAP_MIRROR, 0, 0.9f + 2 * shift), 1, 1e-5f);
        assert_float_equal(red_at(CHIARO_WRAP_MIRROR, 0, 1.25f + 2 * shift), 1, 1e-5f);
        assert_float_equal(red_at(CHIARO_WRAP_MIRROR, 0, 1.75f + 2 * shift), 0, 1e-5f);
        assert_float_equal(red_at(CHIARO_WRAP_MIRROR, 0, 2 * shift), 0, 1e-5f);
    }
    assert_float_equal(red_at(CHIARO_WRAP_CLAMP, 0, -7), 0, 0);
    assert_float_equal(red_at(CHIARO_WRAP_CLAMP, 0, 9), 1, 0);
    const float far[4] = {1e30f, -1e30f, 16777217.0f, -1e-9f};
    for (int i = 0; i < 4; i++)
        for (uint32_t wrap = 0; wrap < 3; wrap++)
            assert_true(red_at(wrap, 0, far[i]) >= 0 && red_at(wrap, 1, far[i]) <= 1);
}

static void srgb_is_decoded_as_the_standard_says(void **state)
{
    (void)state;
    for (int i = 0; i < 256; i++) {
        const uint8_t pixels[4] = {(uint8_t)i, 0, 0, (uint8_t)i};
        ChiaroTexture texture = {.width = 1, .height = 1};
        ChiaroScene scene = {.textures = &texture, .texture_count = 1, .pixels = pixels, .pixel_bytes = 4};
        float uv[2] = {0.4f, 0.6f}, rgba[4];
        chiaro_texture_sample(&scene, 0, uv, rgba);
        double c = i / 255.0, linear = c <= 0.04045 ? c / 12.92 : pow((c + 0.055) / 1.055, 2.4);
        assert_float_equal(rgba[0], (float)linear, 1e-6f);
        assert_float_equal(rgba[3], (float)c, 1e-6f);
    }
}

static void a_surface_multiplies_material_texture_and_vertex_colour(void **state)
{
    (void)state;
    Mesh mesh = small_mesh();
    const uint8_t pixels[4] = {255, 255, 0, 128};
    ChiaroTexture texture = {.width = 1, .height = 1};
    mesh.scene.textures = &texture, mesh.scene.texture_count = 1;
    mesh.scene.pixels = pixels, mesh.scene.pixel_bytes = sizeof pixels;
    mesh.materials[0].albedo_texture = 0;
    mesh.materials[0].emission[0] = 3;
    for (int c = 0; c < 4; c++)
        mesh.vertices[0].color[c] = 0, mesh.vertices[1].color[c] = 4;
    float albedo[3], emission[3];
    float alpha = chiaro_surface(&mesh.scene, 0, 0, 0.25f, 0, albedo, emission);
    assert_float_equal(albedo[0], 0.5f, 1e-6f);
    assert_float_equal(albedo[2], 0, 0);
    assert_float_equal(emission[0], 3, 0);
    assert_float_equal(alpha, 128 / 255.0f, 1e-6f);
    chiaro_surface(&mesh.scene, 0, 0, 1, 0, albedo, emission);
    assert_float_equal(albedo[0], CHIARO_MAX_ALBEDO, 0);
    mesh_end(&mesh);
}

/* ------------------------------------------------------------------------------------------------------------------
 * Lamps and sky
 */

static void lamps_follow_their_laws(void **state)
{
    (void)state;
    float point[3] = {0, 0, 0}, toward[3], distance, rgb[3];
    ChiaroLight lamp = {.type = CHIARO_LIGHT_POINT, .position = {0, 2, 0}, .intensity = {8, 4, 2}};
    chiaro_light_at(&lamp, point, toward, &distance, rgb);
    assert_float_equal(rgb[0], 2, 1e-6f);
    assert_float_equal(toward[1], 1, 1e-6f);
    assert_float_equal(distance, 2, 1e-6f);
    lamp.range = 4;
    chiaro_light_at(&lamp, point, toward, &distance, rgb);
    assert_float_equal(rgb[0], 2 * (1 - 1 / 16.0f), 1e-6f);
    lamp.range = 1.9f;
    chiaro_light_at(&lamp, point, toward, &distance, rgb);
    assert_float_equal(rgb[0], 0, 0);
    lamp.range = 0, lamp.type = CHIARO_LIGHT_SPOT, lamp.cos_inner = 0.9f, lamp.cos_outer = 0.5f;
    vec3_store(lamp.direction, vec3(sqrtf(0.51f), -0.7f, 0)); /* half way between the cones: a quarter, by the square */
    chiaro_light_at(&lamp, point, toward, &distance, rgb);
    assert_float_equal(rgb[0], 0.5f, 1e-5f);
    lamp.type = CHIARO_LIGHT_SUN;
    chiaro_light_at(&lamp, point, toward, &distance, rgb);
    assert_true(isinf(distance) && rgb[1] == 4 && toward[0] == -lamp.direction[0]);
    /* On the lamp itself: no direction, but no NaN either. */
    lamp.type = CHIARO_LIGHT_POINT;
    chiaro_light_at(&lamp, lamp.position, toward, &distance, rgb);
    assert_true(isfinite(rgb[0]) && toward[1] == 0 && distance == 0);
}

static void the_sky_has_plus_y_in_row_0_and_u_by_azimuth(void **state)
{
    (void)state;
    float radiance[4 * 2 * 3] = {0};
    for (int i = 0; i < 8; i++)
        radiance[i * 3] = (float)i;
    ChiaroSky sky = {4, 2, radiance};
    float rgb[3], up[3] = {0, 1, 0};
    chiaro_sky_radiance(&sky, up, rgb);
    assert_true(rgb[0] >= 0 && rgb[0] <= 3);
    for (int column = 0; column < 4; column++) { /* at texel centres the value of the texel */
        for (int row = 0; row < 2; row++) {
            float azimuth = 2 * CHIARO_PI * (((float)column + 0.5f) / 4 - 0.5f);
            float zenith = CHIARO_PI * ((float)row + 0.5f) / 2;
            float across = 7 * sinf(zenith);
            float direction[3] = {across * cosf(azimuth), 7 * cosf(zenith), across * sinf(azimuth)};
            chiaro_sky_radiance(&sky, direction, rgb);
            assert_float_equal(rgb[0], (float)(row * 4 + column), 1e-4f);
        }
    }
    /* Seamless at u = 0 = 1. */
    float before[3] = {-1, 0.1f, 1e-6f}, behind[3] = {-1, 0.1f, -1e-6f}, other[3];
    chiaro_sky_radiance(&sky, before, rgb);
    chiaro_sky_radiance(&sky, behind, other);
    assert_float_equal(rgb[0], other[0], 1e-4f);
}

/* ------------------------------------------------------------------------------------------------------------------
 * Rays and threads
 */

static ChiaroRays *make_rays(const Mesh *mesh)
{
    ChiaroRays *rays;
    assert_int_equal(chiaro_rays_create(&mesh->scene, NULL, &rays), CHIARO_OK);
    return rays;
}

static void a_ray_meets_the_side_that_faces_it(void **state)
{
    (void)state;
    Mesh mesh = two_sided_mesh();
    ChiaroRays *rays = make_rays(&mesh);
    for (int side = -1; side <= 1; side += 2) {
        for (int i = 0; i < 100; i++) {
            float x = 0.013f + 0.0097f * (float)i, y = 0.991f - 0.0089f * (float)i, z = (float)side;
            ChiaroHit hit;
            assert_true(chiaro_rays_hit(rays, vec3(x, y, 2 * z), vec3(0, 0, -z), 0, INFINITY, &hit));
            assert_int_equal(hit.part, side > 0 ? 0 : 1);
            assert_true(hit.front && hit.normal.z == z && fabsf(hit.distance - 2) < 1e-5f);
            const uint32_t *index = mesh.indices + (size_t)hit.triangle * 3;
            assert_true(hit.triangle / 2 == hit.part);
            Vec3 p = vec3_scale(vec3_load(mesh.vertices[index[0]].position), 1 - hit.u - hit.v);
            p = vec3_mad(p, vec3_load(mesh.vertices[index[1]].position), hit.u);
            p = vec3_mad(p, vec3_load(mesh.vertices[index[2]].position), hit.v);
            assert_true(fabsf(p.x - x) < 1e-5f && fabsf(p.y - y) < 1e-5f);
        }
    }
    chiaro_rays_destroy(rays);
    mesh_end(&mesh);
}

static void the_back_of_one_side_is_opaque_and_says_so(void **state)
{
    (void)state;
    Mesh mesh = small_mesh();
    ChiaroRays *rays = make_rays(&mesh);
    ChiaroHit hit;
    assert_true(chiaro_rays_hit(rays, vec3(0.3f, 0.4f, -1), vec3(0, 0, 1), 0, INFINITY, &hit));
    assert_true(!hit.front && hit.normal.z == 1);
    assert_true(chiaro_rays_blocked(rays, vec3(0.3f, 0.4f, -1), vec3(0, 0, 1), 0, 2));
    assert_false(chiaro_rays_blocked(rays, vec3(0.3f, 0.4f, -1), vec3(0, 0, 1), 0, 0.9f));
    assert_false(chiaro_rays_hit(rays, vec3(2, 2, -1), vec3(0, 0, 1), 0, INFINITY, &hit));
    chiaro_rays_destroy(rays);
    mesh_end(&mesh);
}

static void holes_of_a_masked_material_are_seen_through(void **state)
{
    (void)state;
    Mesh mesh = small_mesh();
    const uint8_t pixels[8] = {255, 255, 255, 0, 255, 255, 255, 255}; /* the left half is a hole */
    ChiaroTexture texture = {.width = 2, .height = 1, .nearest = 1};
    mesh.scene.textures = &texture, mesh.scene.texture_count = 1;
    mesh.scene.pixels = pixels, mesh.scene.pixel_bytes = sizeof pixels;
    mesh.materials[0].albedo_texture = 0, mesh.materials[0].alpha_cutoff = 0.5f;
    for (uint32_t i = 0; i < mesh.scene.vertex_count; i++)
        memcpy(mesh.vertices[i].uv, mesh.vertices[i].position, sizeof mesh.vertices[i].uv);
    ChiaroRays *rays = make_rays(&mesh);
    for (int i = 0; i < 50; i++) {
        float x = 0.01f + 0.0199f * (float)i;
        ChiaroHit hit;
        bool solid = x > 0.5f;
        assert_int_equal(chiaro_rays_hit(rays, vec3(x, 0.37f, 1), vec3(0, 0, -1), 0, INFINITY, &hit), solid);
        assert_int_equal(chiaro_rays_blocked(rays, vec3(x, 0.37f, 1), vec3(0, 0, -1), 0, INFINITY), solid);
    }
    chiaro_rays_destroy(rays);
    mesh_end(&mesh);
}

static void lamps_are_seen_from_their_side_only(void **state)
{
    (void)state;
    Mesh mesh = mesh_begin();
    mesh_material(&mesh, 0.5f, 0);
    mesh_box(&mesh, vec3(0, 0, 0), vec3(1, 1, 1));
    ChiaroRays *rays = make_rays(&mesh);
    Vec3 floor = vec3(0.5f, 0, 0.5f), up = vec3(0, 1, 0);
    ChiaroLight lamp = {.type = CHIARO_LIGHT_POINT, .position = {0.5f, 0.5f, 0.5f}, .intensity = {1, 1, 1}};
    assert_true(chiaro_rays_light_visible(rays, &lamp, floor, up));
    lamp.position[1] = 1; /* on the ceiling that carries it */
    assert_true(chiaro_rays_light_visible(rays, &lamp, floor, up));
    lamp.position[1] = 1.01f;
    assert_false(chiaro_rays_light_visible(rays, &lamp, floor, up));
    lamp.position[1] = -0.5f;
    assert_false(chiaro_rays_light_visible(rays, &lamp, floor, up));
    ChiaroLight sun = {.type = CHIARO_LIGHT_SUN, .direction = {0, -1, 0}, .intensity = {1, 1, 1}};
    assert_false(chiaro_rays_light_visible(rays, &sun, floor, up));
    assert_true(chiaro_rays_light_visible(rays, &sun, vec3(0.5f, 2, 0.5f), up));
    chiaro_rays_destroy(rays);
    mesh_end(&mesh);
}

static void no_ray_slips_out_of_a_closed_sphere(void **state)
{
    (void)state;
    Mesh mesh = mesh_begin();
    mesh_material(&mesh, 0.5f, 0);
    mesh_sphere(&mesh, 1, 16, false);
    ChiaroRays *rays = make_rays(&mesh);
    for (uint32_t i = 0; i < mesh.scene.vertex_count; i++) {
        ChiaroHit hit; /* at corners and along edges, where slits would be */
        Vec3 at = vec3_load(mesh.vertices[i].position);
        Vec3 next = vec3_load(mesh.vertices[i / 3 * 3 + (i + 1) % 3].position);
        Vec3 middle = vec3_normalize(vec3_scale(vec3_add(at, next), 0.5f));
        assert_true(chiaro_rays_hit(rays, vec3(0, 0, 0), vec3_normalize(at), 0, INFINITY, &hit) && hit.front);
        assert_true(chiaro_rays_hit(rays, vec3(0, 0, 0), middle, 0, INFINITY, &hit) && hit.front);
    }
    chiaro_rays_destroy(rays);
    mesh_end(&mesh);
}

static void count_visits(uint32_t begin, uint32_t end, uint32_t thread, void *user)
{
    assert_true(thread < 3 && begin < end);
    for (uint32_t i = begin; i < end; i++)
        ((uint8_t *)user)[i]++;
}

static bool stop_at_half(float done, void *user)
{
    *(float *)user = done;
    return done < 0.5f;
}

static void a_parallel_loop_visits_everything_once(void **state)
{
    (void)state;
    uint8_t visits[1000] = {0};
    assert_true(chiaro_parallel_for(3, 1000, 7, count_visits, visits, NULL, NULL));
    for (int i = 0; i < 1000; i++)
        assert_int_equal(visits[i], 1);
    assert_true(chiaro_parallel_for(3, 0, 7, count_visits, visits, NULL, NULL));
    float done = 0;
    memset(visits, 0, sizeof visits);
    assert_false(chiaro_parallel_for(1, 1000, 10, count_visits, visits, stop_at_half, &done));
    assert_float_equal(done, 0.5f, 0.011f);
    assert_int_equal(visits[999], 0);
}

static void the_library_names_itself_and_its_messages(void **state)
{
    (void)state;
    assert_int_equal(chiaro_version(), CHIARO_VERSION);
    for (int i = 0; i <= CHIARO_ERROR_UNSUPPORTED + 1; i++)
        assert_true(strlen(chiaro_result_text((ChiaroResult)i)) > 0);
    for (int i = 0; i <= CHIARO_LOG_ITEM_COUNT; i++)
        assert_true(strlen(chiaro_log_item_text((ChiaroLogItem)i)) > 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_wrong_number_of_a_scene_is_refused_once),
        cmocka_unit_test(textures_that_reach_beyond_the_pixels_are_refused),
        cmocka_unit_test(a_twin_must_be_the_other_side),
        cmocka_unit_test(lights_and_skies_are_checked),
        cmocka_unit_test(textures_wrap_and_filter),
        cmocka_unit_test(srgb_is_decoded_as_the_standard_says),
        cmocka_unit_test(a_surface_multiplies_material_texture_and_vertex_colour),
        cmocka_unit_test(lamps_follow_their_laws),
        cmocka_unit_test(the_sky_has_plus_y_in_row_0_and_u_by_azimuth),
        cmocka_unit_test(a_ray_meets_the_side_that_faces_it),
        cmocka_unit_test(the_back_of_one_side_is_opaque_and_says_so),
        cmocka_unit_test(holes_of_a_masked_material_are_seen_through),
        cmocka_unit_test(lamps_are_seen_from_their_side_only),
        cmocka_unit_test(no_ray_slips_out_of_a_closed_sphere),
        cmocka_unit_test(a_parallel_loop_visits_everything_once),
        cmocka_unit_test(the_library_names_itself_and_its_messages),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
