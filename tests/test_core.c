/* The core's arithmetic against closed forms, and its promises: what is dark stays dark, what is linear stays linear,
 * and nothing that a damaged file says is believed. The baker is not asked: transports are made by hand. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <stdio.h>
#include <string.h>

#include "../src/bake/bake.h"
#include "../src/core/cube.h"
#include "../src/core/samples.h"
#include "../src/core/tone.h"
#include "../src/core/transport.h"
#include "../src/core/random.h"
#include "chiaro_shared.h"
#include "common/check.h"
#include "common/geometry.h"
#include "common/made_transport.h"
#include "common/mesh.h"

/* ------------------------------------------------------------------------------------------------------------------
 * The light law of samples
 */

static void a_lamp_on_the_axis_gives_the_mean_over_the_patch_at_every_distance(void **state)
{
    (void)state;
    Vec3 up = vec3(0, 1, 0);
    for (int e = -6; e <= 6; e++) {
        float s = powf(10, (float)e / 3);
        for (int k = -12; k <= 12; k++) {
            /* Solid angle of a square of half edge a, from h over its middle: 4 atan(a^2 / (h sqrt(2 a^2 + h^2))). */
            double square = pi / 2 * (double)s * (double)s, h = (double)s * pow(2, k);
            double truth = 4 * atan(square / (h * sqrt(2 * square + h * h))) / (4 * square);
            /* At 12 s the far law takes over. */
            assert_near("square", k, (double)chiaro_point_form(up, s, up, (float)h), truth, 1e-4 * truth);
        }
    }
}

/* No light is lost or made between patches, however near the lamp. The ground is so large that it takes half of all. */
static void patches_side_by_side_take_what_the_lamp_sends(void **state)
{
    (void)state;
    const int tiles = 400;
    const float edge = 0.5f, s = edge / sqrtf(2 * (float)pi);
    for (int k = 0; k < 6; k++) {
        Vec3 lamp = {0.13f, 0.02f * powf(3, (float)k), -0.21f};
        double flux = 0;
        for (int i = -tiles; i <= tiles; i++) {
            for (int j = -tiles; j <= tiles; j++) {
                Vec3 way = vec3_sub(lamp, vec3((float)i * edge, 0, (float)j * edge));
                float d = vec3_length(way);
                flux += (double)(edge * edge * chiaro_point_form(vec3(0, 1, 0), s, vec3_scale(way, 1 / d), d));
            }
        }
        /* What passes beyond the ground's rim: about 2 pi h / R with R between the edge's and the corner's distance. */
        assert_near("height", (double)lamp.y, flux, 2 * pi, 1e-3 + 2 * pi * (double)lamp.y / (tiles * (double)edge));
    }
}

static void no_lamp_is_brighter_than_at_contact_and_none_lights_from_behind(void **state)
{
    (void)state;
    ChiaroRandom random = chiaro_random_seed(1, 1);
    for (int i = 0; i < 20000; i++) {
        Vec3 normal = random_direction(&random), toward = random_direction(&random);
        float s = powf(10, 4 * chiaro_random_float(&random) - 3), d = powf(10, 8 * chiaro_random_float(&random) - 5);
        float form = chiaro_point_form(normal, s, toward, d);
        if (vec3_dot(normal, toward) <= 0)
            assert_true(form == 0);
        assert_true(form >= 0);
        assert_below("form", (double)(d / s), (double)(form * s * s), 1 + 1e-5);
    }
    assert_near("contact", 0, (double)chiaro_point_form(vec3(0, 0, 1), 0.5f, vec3(0, 0, 1), 1e-6f), 4, 1e-4);
}

static void far_lamps_follow_the_square_and_the_cosine(void **state)
{
    (void)state;
    for (int degrees = 0; degrees < 90; degrees += 10) {
        double angle = degrees * pi / 180;
        Vec3 toward = vec3((float)sin(angle), (float)cos(angle), 0);
        double form = (double)chiaro_point_form(vec3(0, 1, 0), 0.01f, toward, 10);
        assert_near("degrees", degrees, form, cos(angle) / 100, 1e-5 * cos(angle) / 100 + 1e-8);
    }
}

/* ------------------------------------------------------------------------------------------------------------------
 * Cubes and the sky
 */

static void texels_of_a_cube_cover_the_sphere_once(void **state)
{
    (void)state;
    static const uint32_t edges[] = {1, 2, 4, 6, 8, CHIARO_SKY_EDGE, 64};
    for (size_t k = 0; k < sizeof edges / sizeof *edges; k++) {
        uint32_t edge = edges[k];
        double sum = 0;
        for (uint32_t t = 0; t < 6 * edge * edge; t++) {
            float angle;
            Vec3 direction = chiaro_cube_texel_direction(t, edge, &angle);
            sum += (double)angle;
            assert_near("length", t, (double)vec3_length(direction), 1, 1e-6);
            assert_int_equal(chiaro_cube_texel(direction, edge), t);
        }
        assert_near("sphere", edge, sum, 4 * pi, 2e-6);
    }
}

/* Corner, edge and centre of faces of 4 x 4 and 8 x 8 texels. */
static void solid_angles_are_those_of_the_corner_formula(void **state)
{
    (void)state;
    float angle;
    for (uint32_t face = 0; face < 6; face++) {
        chiaro_cube_texel_direction(face * 16, 4, &angle);
        assert_near("corner 4", face, (double)angle, 0.08145559, 1e-8);
        chiaro_cube_texel_direction(face * 16 + 1, 4, &angle);
        assert_near("edge 4", face, (double)angle, 0.12039263, 1e-8);
        chiaro_cube_texel_direction(face * 16 + 5, 4, &angle);
        assert_near("centre 4", face, (double)angle, 0.20135792, 2e-8);
        chiaro_cube_texel_direction(face * 64 + 63, 8, &angle);
        assert_near("corner 8", face, (double)angle, 0.01556861, 1e-8);
        chiaro_cube_texel_direction(face * 64 + 3 * 8 + 4, 8, &angle);
        assert_near("centre 8", face, (double)angle, 0.05885751, 1e-8);
    }
}

static void every_direction_has_a_texel_even_along_edges(void **state)
{
    (void)state;
    for (int x = -2; x <= 2; x++)
        for (int y = -2; y <= 2; y++)
            for (int z = -2; z <= 2; z++) {
                if (x == 0 && y == 0 && z == 0)
                    continue;
                uint32_t texel = chiaro_cube_texel(vec3((float)x, (float)y, (float)z), 4);
                float angle;
                Vec3 centre = chiaro_cube_texel_direction(texel, 4, &angle);
                Vec3 asked = vec3_normalize(vec3((float)x, (float)y, (float)z));
                assert_true(texel < 96);
                assert_true(vec3_dot(centre, asked) > 0.93f); /* half a diagonal of the largest texel */
            }
}

/* A transport of sky leaves alone, in the cube's order. */
typedef struct SkyLeaves {
    ChiaroTransport transport;
    float directions[4 * CHIARO_SKY_TEXELS], radiosity[3 * CHIARO_SKY_TEXELS];
} SkyLeaves;

static SkyLeaves *sky_leaves(void)
{
    SkyLeaves *leaves = new_array(1, sizeof *leaves);
    for (uint32_t t = 0; t < CHIARO_SKY_TEXELS; t++) {
        float *direction = leaves->directions + 4 * (size_t)t;
        vec3_store(direction, chiaro_cube_texel_direction(t, CHIARO_SKY_EDGE, &direction[3]));
    }
    leaves->transport.sky_count = CHIARO_SKY_TEXELS;
    leaves->transport.sky_directions = leaves->directions;
    return leaves;
}

static void a_uniform_sky_is_pi_times_its_radiance_on_every_leaf(void **state)
{
    (void)state;
    SkyLeaves *leaves = sky_leaves();
    const float rgb[3] = {0.25f, 1, 1000};
    ChiaroSky sky = {1, 1, rgb};
    chiaro_sky_light(&leaves->transport, &sky, leaves->radiosity);
    for (uint32_t i = 0; i < 3 * CHIARO_SKY_TEXELS; i++)
        assert_near("leaf", i, (double)leaves->radiosity[i], pi * (double)rgb[i % 3], 1e-6 * pi * (double)rgb[i % 3]);
    chiaro_sky_light(&leaves->transport, NULL, leaves->radiosity);
    for (uint32_t i = 0; i < 3 * CHIARO_SKY_TEXELS; i++)
        assert_true(leaves->radiosity[i] == 0);
    free(leaves);
}

static double leaves_energy(const SkyLeaves *leaves, uint32_t channel)
{
    double sum = 0;
    for (uint32_t t = 0; t < CHIARO_SKY_TEXELS; t++)
        sum += (double)leaves->radiosity[3 * t + channel] * (double)leaves->directions[4 * t + 3];
    return sum;
}

/* Radiosity times solid angle adds up to pi times the image's integral, and its first moment points the same way. */
static void an_image_keeps_its_energy_and_its_direction(void **state)
{
    (void)state;
    enum { W = 96, H = 48 };
    SkyLeaves *leaves = sky_leaves();
    float *image = new_array((size_t)W * H * 3, sizeof(float));
    double truth = 0, moment[3] = {0}, got[3] = {0};
    for (uint32_t j = 0; j < H; j++)
        for (uint32_t i = 0; i < W; i++) {
            double polar = pi * (j + 0.5) / H, azimuth = 2 * pi * ((i + 0.5) / W - 0.5);
            double d[3] = {sin(polar) * cos(azimuth), cos(polar), sin(polar) * sin(azimuth)};
            double value = 1.2 + d[0] + 0.5 * d[1] * d[2];
            for (uint32_t c = 0; c < 3; c++)
                image[((size_t)j * W + i) * 3 + c] = (float)value;
        }
    /* The integral of 1.2 + x + yz / 2 over the sphere, and of it times a direction: linear terms count a third. */
    truth = 4 * pi * 1.2, moment[0] = 4 * pi / 3;
    ChiaroSky sky = {W, H, image};
    chiaro_sky_light(&leaves->transport, &sky, leaves->radiosity);
    for (uint32_t c = 0; c < 3; c++)
        assert_near("energy", c, leaves_energy(leaves, c), pi * truth, 2e-3 * pi * truth);
    for (uint32_t t = 0; t < CHIARO_SKY_TEXELS; t++)
        for (uint32_t c = 0; c < 3; c++) {
            const float *direction = leaves->directions + 4 * (size_t)t;
            got[c] += (double)(leaves->radiosity[3 * t] * direction[3] * direction[c]);
        }
    for (uint32_t c = 0; c < 3; c++)
        assert_near("moment", c, got[c], pi * moment[c], 5e-3 * pi * moment[0]);
    free(image);
    free(leaves);
}

/* A sun of one texel of the image, anywhere, brings its flux: a leaf is the mean of its texel. */
static void a_small_sun_in_an_image_keeps_its_flux(void **state)
{
    (void)state;
    SkyLeaves *leaves = sky_leaves();
    ChiaroRandom random = chiaro_random_seed(3, 3);
    for (uint32_t h = 128; h <= 512; h *= 2) {
        uint32_t w = 2 * h;
        float *image = new_array((size_t)w * h * 3, sizeof(float));
        double worst = 0;
        for (int k = 0; k < 16; k++) {
            uint32_t i = chiaro_random_bits(&random) % w, j = h / 16 + chiaro_random_bits(&random) % (h / 8 * 7);
            double flux = 1e4 * sin(pi * (j + 0.5) / h) * (pi / h) * (2 * pi / w);
            ChiaroSky sky = {w, h, image};
            image[((size_t)j * w + i) * 3 + 1] = 1e4f;
            chiaro_sky_light(&leaves->transport, &sky, leaves->radiosity);
            image[((size_t)j * w + i) * 3 + 1] = 0;
            worst = fmax(worst, fabs(leaves_energy(leaves, 1) / (pi * flux) - 1));
            assert_true(leaves_energy(leaves, 0) == 0);
        }
        free(image);
        /* A leaf is read at 340 places: those along its rim are a twentieth of it. */
        assert_below("flux is wrong by, at rows", h, worst, 0.06);
    }
    free(leaves);
}

static void the_tone_curve_rises_and_ends_at_one(void **state)
{
    (void)state;
    float before = -1;
    for (int k = -40; k <= 40; k++) {
        float rgb[3] = {exp2f((float)k / 2), NAN, INFINITY}, out[3];
        chiaro_tone_map(rgb, 0, out);
        assert_true(out[0] >= before && out[0] >= 0 && out[0] <= 1);
        assert_true(out[1] == 0 && out[2] == 1);
        before = out[0];
    }
}

/* ------------------------------------------------------------------------------------------------------------------
 * Tree, gathers, the whole update
 */

typedef struct Room {
    Mesh mesh;
    ChiaroTransport transport;
    float *scratch, *values, *irradiance;
} Room;

static Room make_room(bool sky, uint32_t links)
{
    Room room = {.mesh = mesh_room(0.7f, 0)};
    MadeTransportDesc desc = {.mesh_steps = 3, .sample_steps = 4, .points = 3, .links = links, .sky = sky};
    room.transport = made_transport(&room.mesh.scene, &desc);
    const ChiaroTransport *t = &room.transport;
    room.scratch = new_array(3 * ((size_t)t->node_count + t->sample_count), sizeof(float));
    room.values = new_array(3 * (size_t)t->node_count, sizeof(float));
    room.irradiance = new_array(3 * (size_t)t->receiver_count, sizeof(float));
    return room;
}

static void free_room(Room *room)
{
    made_transport_free(&room->transport);
    mesh_end(&room->mesh);
    free(room->scratch);
    free(room->values);
    free(room->irradiance);
}

static void fill_values(Room *room, uint32_t count)
{
    ChiaroRandom random = chiaro_random_seed(5, 5);
    for (uint32_t i = 0; i < 3 * count; i++)
        room->values[i] = chiaro_random_float(&random) * 10;
}

static void a_node_is_the_weighted_mean_of_its_leaves(void **state)
{
    (void)state;
    Room room = make_room(true, 4);
    const ChiaroTransport *t = &room.transport;
    fill_values(&room, t->leaf_count);
    chiaro_tree_sum(t, room.values);
    for (uint32_t n = 0; n < t->node_count; n++) {
        for (uint32_t c = 0; c < 3; c++) {
            double sum = 0, weight = 0;
            for (uint32_t l = t->nodes[n].first; l < t->nodes[n].first + t->nodes[n].count; l++) {
                sum += (double)t->leaf_weights[l] * (double)room.values[3 * l + c];
                weight += (double)t->leaf_weights[l];
            }
            assert_near("node", n, (double)room.values[3 * n + c], sum / weight, 1e-5 * sum / weight);
        }
    }
    free_room(&room);
}

/* Every row by itself, in double precision. */
static void assert_gather(const char *what, const ChiaroLinks *links, const float *values, const float *irradiance)
{
    for (uint32_t b = 0; b < links->block_count; b++) {
        ChiaroBlock k = links->blocks[b];
        for (uint32_t r = 0; r < k.row_count; r++) {
            for (uint32_t c = 0; c < 3; c++) {
                double sum = 0, size = 0;
                for (uint32_t p = 0; p < k.rank; p++) {
                    for (uint32_t i = 0; i < k.node_count; i++) {
                        uint32_t plane = k.channels == 3 ? c * k.rank + p : p;
                        double term = (double)links->weights[k.first_share + p * k.row_count + r] *
                                      (double)links->weights[k.first_weight + plane * k.node_count + i] *
                                      (double)values[3 * links->nodes[k.first_node + i] + c];
                        sum += term, size += fabs(term);
                    }
                }
                assert_near(what, k.first_row + r, (double)irradiance[3 * (k.first_row + r) + c], fmax(0, sum),
                            1e-5 * size);
            }
        }
    }
}

static void gathers_sum_the_links_as_they_are_written(void **state)
{
    (void)state;
    Room room = make_room(true, 7);
    const ChiaroTransport *t = &room.transport;
    fill_values(&room, t->node_count);
    for (uint32_t k = 0; k < 3 * t->node_count; k += 2) /* so that some sums are below nothing */
        room.values[k] = -room.values[k];
    float *bounce = new_array(3 * (size_t)t->sample_count, sizeof(float));
    chiaro_links_gather(&t->sample_links, room.values, bounce);
    chiaro_links_gather(&t->receiver_links, room.values, room.irradiance);
    assert_gather("sample", &t->sample_links, room.values, bounce);
    assert_gather("receiver", &t->receiver_links, room.values, room.irradiance);
    free(bounce);
    free_room(&room);
}

static void update(Room *room, const ChiaroLight *lights, uint32_t count, const ChiaroSky *sky,
                   ChiaroVisibleFunc visible)
{
    chiaro_transport_update(&room->transport, lights, count, sky, visible, NULL, room->scratch, room->irradiance);
}

static void light_is_linear_and_off_is_black(void **state)
{
    (void)state;
    Room room = make_room(true, 8);
    size_t n = 3 * (size_t)room.transport.receiver_count;
    float *one = new_array(n, sizeof(float)), *other = new_array(n, sizeof(float)), *both = new_array(n, sizeof(float));
    const float blue[3] = {0.1f, 0.2f, 0.4f};
    ChiaroSky sky = {1, 1, blue};
    ChiaroLight lights[3] = {
        {.type = CHIARO_LIGHT_POINT, .position = {1, 1, 1}, .intensity = {3, 2, 1}},
        {.type = CHIARO_LIGHT_SPOT, .position = {2, 1.5f, 3}, .direction = {0, -1, 0}, .intensity = {0, 5, 9},
         .cos_inner = 0.9f, .cos_outer = 0.5f},
        {.type = CHIARO_LIGHT_SUN, .direction = {0.6f, -0.8f, 0}, .intensity = {1, 1, 1}}};
    update(&room, lights, 2, NULL, NULL);
    memcpy(one, room.irradiance, n * sizeof *one);
    update(&room, lights + 2, 1, &sky, NULL);
    memcpy(other, room.irradiance, n * sizeof *other);
    update(&room, lights, 3, &sky, NULL);
    memcpy(both, room.irradiance, n * sizeof *both);
    double size = 0;
    for (size_t i = 0; i < n; i++)
        size = fmax(size, fabs((double)both[i]));
    assert_true(size > 0.1);
    for (size_t i = 0; i < n; i++)
        assert_near("sum of lights", (double)i, (double)both[i], (double)one[i] + (double)other[i], 1e-5 * size);
    /* Times a power of two not even rounding differs. */
    for (uint32_t k = 0; k < 3; k++)
        for (uint32_t c = 0; c < 3; c++)
            lights[k].intensity[c] *= 1024;
    update(&room, lights, 2, NULL, NULL);
    for (size_t i = 0; i < n; i++)
        assert_true(room.irradiance[i] == 1024 * one[i]);
    /* The same memory again, all lights off, in every way that off can be said. */
    memset(lights[0].intensity, 0, sizeof lights[0].intensity);
    update(&room, lights, 1, NULL, NULL);
    for (size_t i = 0; i < n; i++)
        assert_true(room.irradiance[i] == 0);
    update(&room, NULL, 0, NULL, NULL);
    for (size_t i = 0; i < n; i++)
        assert_true(room.irradiance[i] == 0);
    free(one);
    free(other);
    free(both);
    free_room(&room);
}

static bool never(const ChiaroLight *light, const float point[3], const float normal[3], void *user)
{
    (void)light;
    (void)user;
    /* Asked about points of the box's walls, with the walls' normals. */
    bool on_wall = false;
    const float high[3] = {3, 2, 4};
    for (int c = 0; c < 3; c++)
        on_wall |= normal[c] != 0 && fabsf(point[c] - (normal[c] > 0 ? 0 : high[c])) < 1e-5f;
    assert_true(on_wall);
    return false;
}

static void the_shadow_test_has_the_last_word_and_is_asked_about_the_surface(void **state)
{
    (void)state;
    Room room = make_room(false, 8);
    ChiaroLight light = {.type = CHIARO_LIGHT_POINT, .position = {1, 1, 1}, .intensity = {3, 2, 1}};
    update(&room, &light, 1, NULL, never);
    for (uint32_t i = 0; i < 3 * room.transport.receiver_count; i++)
        assert_true(room.irradiance[i] == 0);
    free_room(&room);
}

/* ------------------------------------------------------------------------------------------------------------------
 * Blocks
 */

/* The block of a made transport, as the baker would write it. */
static ChiaroBlob write_block(const ChiaroTransport *t)
{
#define ARRAY(name) .name = (void *)(uintptr_t)t->name
#define LINKS(name) .name = {(void *)(uintptr_t)t->name.blocks, (void *)(uintptr_t)t->name.nodes, \
                             (void *)(uintptr_t)t->name.weights, t->name.block_count, t->name.node_count, \
                             t->name.weight_count}
    Baker baker = {.scene = &t->scene, .info = t->info, ARRAY(samples), ARRAY(points), ARRAY(leaf_weights),
                   ARRAY(sky_directions), ARRAY(nodes), LINKS(sample_links), ARRAY(receivers),
                   LINKS(receiver_links), ARRAY(vertices), ARRAY(vertex_receivers),
                   ARRAY(indices), ARRAY(parts), .sample_count = t->sample_count, .point_count = t->point_count,
                   .sky_count = t->sky_count, .leaf_count = t->leaf_count, .node_count = t->node_count,
                   .small_node_end = t->small_node_end,
                   .vertex_count = t->vertex_count, .index_count = t->index_count,
                   .receiver_count = t->receiver_count};
#undef LINKS
#undef ARRAY
    ChiaroBlob blob = {NULL, 0};
    assert_int_equal(chiaro_bake_write(&baker, &blob), CHIARO_OK);
    return blob;
}

static ChiaroBlob make_block(bool sky)
{
    Mesh mesh = mesh_begin();
    mesh_material(&mesh, 0.7f, 0);
    mesh_quad(&mesh, vec3(0, 0, 0), vec3(0, 0, 1), vec3(1, 0, 1), vec3(1, 0, 0));
    ChiaroLight lamp = {.type = CHIARO_LIGHT_POINT, .position = {0.5f, 1, 0.5f}, .intensity = {1, 1, 1}};
    mesh.scene.lights = &lamp, mesh.scene.light_count = 1;
    MadeTransportDesc desc = {.mesh_steps = 2, .sample_steps = 2, .points = 1, .links = 3, .sky = sky};
    ChiaroTransport transport = made_transport(&mesh.scene, &desc);
    ChiaroBlob blob = write_block(&transport);
    made_transport_free(&transport);
    mesh_end(&mesh);
    return blob;
}

/* Opens a copy of exactly that many bytes, so that a read beyond them is an error of memory. */
static ChiaroResult open_copy(const void *data, size_t size)
{
    ChiaroTransport transport;
    void *copy = malloc(size ? size : 1);
    assert_non_null(copy);
    memcpy(copy, data, size);
    ChiaroResult result = chiaro_transport_open(copy, size, &transport, NULL);
    free(copy);
    return result;
}

static void a_block_reads_back_as_it_was_written(void **state)
{
    (void)state;
    Room room = make_room(true, 5);
    const ChiaroTransport *t = &room.transport;
    ChiaroBlob blob = write_block(t);
    ChiaroTransport back;
    assert_int_equal(chiaro_transport_open(blob.data, blob.size, &back, NULL), CHIARO_OK);
    ChiaroFileArray before[CHIARO_FILE_ARRAYS], after[CHIARO_FILE_ARRAYS];
    ChiaroTransport copy = *t;
    chiaro_file_arrays(&copy, before);
    chiaro_file_arrays(&back, after);
    for (uint32_t k = 0; k < CHIARO_FILE_ARRAYS; k++) {
        assert_int_equal(after[k].count, before[k].count);
        assert_int_equal(((uintptr_t)*after[k].slot - (uintptr_t)blob.data) % CHIARO_FILE_ALIGNMENT, 0);
        if (before[k].count)
            assert_memory_equal(*after[k].slot, *before[k].slot, before[k].count * before[k].stride);
    }
    assert_memory_equal(&back.info, &t->info, sizeof t->info);
    assert_int_equal(back.small_node_end, t->small_node_end);
    chiaro_blob_free(&blob);
    free_room(&room);
}

static void a_flipped_bit_anywhere_is_found(void **state)
{
    (void)state;
    ChiaroBlob blob = make_block(true);
    unsigned char *bytes = blob.data;
    assert_int_equal(open_copy(bytes, blob.size), CHIARO_OK);
    size_t header = sizeof(ChiaroFileHeader), version = offsetof(ChiaroFileStart, version);
    for (size_t k = 0; k < 8 * header; k++) {
        bytes[k / 8] ^= (unsigned char)(1 << k % 8);
        ChiaroResult wanted = k / 8 >= version && k / 8 < version + 8 ? CHIARO_ERROR_VERSION : CHIARO_ERROR_DATA;
        assert_int_equal(open_copy(bytes, blob.size), wanted);
        bytes[k / 8] ^= (unsigned char)(1 << k % 8);
    }
    ChiaroRandom random = chiaro_random_seed(8, 8);
    for (int k = 0; k < 1500; k++) {
        size_t bit = header * 8 + (size_t)(chiaro_random_float(&random) * (float)(8 * (blob.size - header)));
        bytes[bit / 8] ^= (unsigned char)(1 << bit % 8);
        assert_int_equal(open_copy(bytes, blob.size), CHIARO_ERROR_DATA);
        bytes[bit / 8] ^= (unsigned char)(1 << bit % 8);
    }
    for (size_t k = 1; k <= 64; k++) { /* and the very end, which may be padding */
        bytes[blob.size - k] ^= 1;
        assert_int_equal(open_copy(bytes, blob.size), CHIARO_ERROR_DATA);
        bytes[blob.size - k] ^= 1;
    }
    assert_int_equal(open_copy(bytes, blob.size), CHIARO_OK);
    chiaro_blob_free(&blob);
}

static void a_block_cut_short_or_long_is_refused(void **state)
{
    (void)state;
    ChiaroBlob blob = make_block(false);
    for (size_t size = 0; size < blob.size; size += size < 1024 ? 1 : 61)
        assert_int_equal(open_copy(blob.data, size), CHIARO_ERROR_DATA);
    assert_int_equal(open_copy(blob.data, blob.size - 1), CHIARO_ERROR_DATA);
    char *longer = new_array(blob.size + 64, 1);
    memcpy(longer, blob.data, blob.size);
    assert_int_equal(open_copy(longer, blob.size + 64), CHIARO_ERROR_DATA);
    /* In the wrong place, or none at all. */
    ChiaroTransport transport;
    memmove(longer + 8, longer, blob.size);
    assert_int_equal(chiaro_transport_open(longer + 8, blob.size, &transport, NULL), CHIARO_ERROR_ARGUMENT);
    assert_int_equal(chiaro_transport_open(NULL, blob.size, &transport, NULL), CHIARO_ERROR_ARGUMENT);
    assert_int_equal(chiaro_transport_open(blob.data, blob.size, NULL, NULL), CHIARO_ERROR_ARGUMENT);
    free(longer);
    chiaro_blob_free(&blob);
}

typedef struct Heard {
    ChiaroLogItem item;
    uint32_t count;
    char text[256];
} Heard;

static void hear(ChiaroLogLevel level, ChiaroLogItem item, const char *message, void *user)
{
    Heard *heard = user;
    assert_int_equal(level, CHIARO_LOG_ERROR);
    heard->item = item, heard->count++;
    strncpy(heard->text, message, sizeof heard->text - 1);
}

static void seal(ChiaroBlob *blob)
{
    ChiaroFileHeader *header = blob->data;
    header->start.checksum = chiaro_file_checksum(blob->data, blob->size);
}

static void another_version_is_named_as_such(void **state)
{
    (void)state;
    ChiaroBlob blob = make_block(false);
    ChiaroFileHeader *header = blob.data;
    ChiaroTransport transport;
    Heard heard = {0};
    ChiaroLog log = {hear, &heard};
    header->start.version = 77;
    seal(&blob);
    assert_int_equal(chiaro_transport_open(blob.data, blob.size, &transport, &log), CHIARO_ERROR_VERSION);
    assert_int_equal(heard.item, CHIARO_LOG_VERSION_MISMATCH);
    assert_int_equal(heard.count, 1);
    assert_non_null(strstr(heard.text, "77"));
    assert_null(strchr(heard.text, '\n'));
    chiaro_blob_free(&blob);
}

static void an_origin_that_is_no_place_is_refused(void **state)
{
    (void)state;
    ChiaroBlob blob = make_block(false);
    ChiaroFileHeader *header = blob.data;
    double origin[3] = {7, 7, 7};
    header->origin[0] = -1e6, header->origin[1] = (double)NAN;
    assert_int_equal(chiaro_transport_origin(blob.data, blob.size, origin), CHIARO_ERROR_DATA); /* the checksum */
    seal(&blob);
    assert_int_equal(chiaro_transport_origin(blob.data, blob.size, origin), CHIARO_ERROR_DATA);
    assert_true(origin[0] == 7 && origin[1] == 7 && origin[2] == 7);
    assert_int_equal(open_copy(blob.data, blob.size), CHIARO_ERROR_DATA); /* who has opened one can ask for it */
    header->origin[1] = 0.5;
    seal(&blob);
    assert_int_equal(chiaro_transport_origin(blob.data, blob.size, origin), CHIARO_OK);
    assert_true(origin[0] == -1e6 && origin[1] == 0.5 && origin[2] == 0);
    assert_int_equal(open_copy(blob.data, blob.size), CHIARO_OK);
    assert_int_equal(chiaro_transport_origin(NULL, blob.size, origin), CHIARO_ERROR_ARGUMENT);
    assert_int_equal(chiaro_transport_origin(blob.data, blob.size, NULL), CHIARO_ERROR_ARGUMENT);
    assert_int_equal(chiaro_transport_origin(blob.data, 64, origin), CHIARO_ERROR_DATA);
    chiaro_blob_free(&blob);
}

#define MUTABLE(type, pointer) ((type *)(uintptr_t)(pointer))

/* A block that says something impossible under a checksum that is right. False: there are no more lies. */
static bool tell_lie(uint32_t number, ChiaroFileHeader *header, const ChiaroTransport *t)
{
    ChiaroNode *nodes = MUTABLE(ChiaroNode, t->nodes);
    ChiaroSample *samples = MUTABLE(ChiaroSample, t->samples);
    float *sky = MUTABLE(float, t->sky_directions);
    ChiaroBlock *blocks = MUTABLE(ChiaroBlock, t->sample_links.blocks);
    uint32_t inner = t->leaf_count, last = t->node_count - 1;
    switch (number) {
    case 0: nodes[inner].source_first = t->node_count; break;
    case 1: nodes[inner].source_count = 0; break;
    case 2: nodes[inner].source_count = UINT32_MAX; break;
    case 3: nodes[inner].source_first = inner; break; /* its own mean */
    case 4: nodes[last].source_first = last; break;
    case 5: nodes[last].first = t->leaf_count; break;
    case 6: nodes[last].count = UINT32_MAX; break;
    case 7: nodes[last].left = t->node_count; break;
    case 8: nodes[last].right = CHIARO_NONE; break;
    case 9: nodes[0].area = NAN; break;
    case 10: nodes[0].area = -1; break;
    case 11: nodes[0].area = INFINITY; break;
    case 12: samples[0].first_point = t->point_count; break;
    case 13: samples[1].point_count = UINT32_MAX; break;
    case 14: samples[0].albedo[1] = 1.5f; break;
    case 15: samples[0].albedo[2] = NAN; break;
    case 16: samples[0].emission[0] = -1; break;
    case 17: samples[0].emission[0] = INFINITY; break;
    case 18: MUTABLE(ChiaroPoint, t->points)[0].position[0] = NAN; break;
    case 19: MUTABLE(ChiaroPoint, t->points)[0].weight = INFINITY; break;
    case 20: MUTABLE(float, t->leaf_weights)[0] = NAN; break;
    case 21: sky[2] = NAN; break;
    case 22: memcpy(sky, sky + 4, 4 * sizeof *sky); break; /* two leaves for one texel, so none for another */
    case 23: MUTABLE(uint32_t, t->sample_links.nodes)[0] = t->node_count; break;
    case 24: MUTABLE(float, t->sample_links.weights)[0] = INFINITY; break;
    case 25: blocks[0].first_row = 1; break;
    case 26: blocks[1].row_count += 1; break;
    case 27: blocks[1].rank = CHIARO_BLOCK_RANK + 1; break;
    case 28: MUTABLE(uint32_t, t->receiver_links.nodes)[0] = UINT32_MAX; break;
    case 29: MUTABLE(float, t->receiver_links.weights)[0] = NAN; break;
    case 30: MUTABLE(uint32_t, t->vertex_receivers)[0] = t->receiver_count; break;
    case 31: MUTABLE(uint32_t, t->indices)[1] = t->vertex_count; break;
    case 32: MUTABLE(ChiaroVertex, t->vertices)[0].position[1] = INFINITY; break;
    case 33: MUTABLE(ChiaroPart, t->parts)[0].index_count += 3; break;
    case 34: MUTABLE(ChiaroPart, t->parts)[0].material = 1; break;
    case 35: MUTABLE(uint32_t, t->scene.indices)[0] = t->scene.vertex_count; break;
    case 36: MUTABLE(ChiaroLight, t->scene.lights)[0].type = 9; break;
    case 37: MUTABLE(ChiaroMaterial, t->scene.materials)[0].albedo_texture = 0; break;
    case 38: blocks[0].first_weight = t->sample_links.weight_count; break;
    case 39: blocks[2].channels = 2; break;
    case 40: header->counts[0] = UINT64_MAX; break;
    case 41: header->counts[23] = UINT64_MAX - 63; break; /* bytes of pixels */
    case 42: header->start.size += 64; break;
    case 43: blocks[0].first_share = UINT32_MAX; break;
    case 44: blocks[1].first_node = t->sample_links.node_count; break;
    case 45: header->counts[10] -= 1; break; /* blocks of the samples */
    default: return false;
    }
    return true;
}

static void lies_under_a_right_checksum_are_found_and_named_once(void **state)
{
    (void)state;
    char wrong[256] = "";
    for (uint32_t number = 0;; number++) {
        ChiaroBlob blob = make_block(true);
        ChiaroTransport transport;
        Heard heard = {0};
        ChiaroLog log = {hear, &heard};
        assert_int_equal(chiaro_transport_open(blob.data, blob.size, &transport, NULL), CHIARO_OK);
        bool told = tell_lie(number, blob.data, &transport);
        seal(&blob);
        if (told && (chiaro_transport_open(blob.data, blob.size, &transport, &log) != CHIARO_ERROR_DATA ||
                     heard.count != 1 || strchr(heard.text, '\n')))
            snprintf(wrong + strlen(wrong), sizeof wrong - strlen(wrong), " %u", number);
        chiaro_blob_free(&blob);
        if (!told)
            break;
    }
    if (wrong[0])
        fail_msg("believed, or not named by one line:%s", wrong);
}

/* What is accepted can be run: with the address sanitizer this finds what the checks let through. */
static void damage_under_a_right_checksum_does_no_harm(void **state)
{
    (void)state;
    ChiaroLight lamp = {.type = CHIARO_LIGHT_POINT, .position = {0.5f, 1, 0.5f}, .intensity = {1, 1, 1}};
    ChiaroRandom random = chiaro_random_seed(9, 9);
    uint32_t accepted = 0;
    ChiaroBlob blob = make_block(false);
    unsigned char *bytes = blob.data;
    size_t from = offsetof(ChiaroFileHeader, counts);
    for (int k = 0; k < 6000; k++) {
        /* A quarter of the flips go to the header's counts and settings. */
        size_t end = k % 4 ? blob.size : sizeof(ChiaroFileHeader);
        size_t bit = 8 * from + (size_t)(chiaro_random_float(&random) * (float)(8 * (end - from)));
        ChiaroTransport t;
        bytes[bit / 8] ^= (unsigned char)(1 << bit % 8);
        seal(&blob);
        unsigned char *copy = malloc(blob.size);
        assert_non_null(copy);
        memcpy(copy, bytes, blob.size);
        ChiaroResult result = chiaro_transport_open(copy, blob.size, &t, NULL);
        assert_true(result == CHIARO_OK || result == CHIARO_ERROR_DATA);
        if (result == CHIARO_OK) {
            float *scratch = new_array(3 * ((size_t)t.node_count + t.sample_count), sizeof(float));
            float *irradiance = new_array(3 * (size_t)t.receiver_count, sizeof(float));
            chiaro_transport_update(&t, &lamp, 1, NULL, NULL, NULL, scratch, irradiance);
            free(scratch);
            free(irradiance);
            accepted++;
        }
        free(copy);
        bytes[bit / 8] ^= (unsigned char)(1 << bit % 8);
    }
    assert_in_range(accepted, 1000, 5999);
    chiaro_blob_free(&blob);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_lamp_on_the_axis_gives_the_mean_over_the_patch_at_every_distance),
        cmocka_unit_test(patches_side_by_side_take_what_the_lamp_sends),
        cmocka_unit_test(no_lamp_is_brighter_than_at_contact_and_none_lights_from_behind),
        cmocka_unit_test(far_lamps_follow_the_square_and_the_cosine),
        cmocka_unit_test(texels_of_a_cube_cover_the_sphere_once),
        cmocka_unit_test(solid_angles_are_those_of_the_corner_formula),
        cmocka_unit_test(every_direction_has_a_texel_even_along_edges),
        cmocka_unit_test(a_uniform_sky_is_pi_times_its_radiance_on_every_leaf),
        cmocka_unit_test(an_image_keeps_its_energy_and_its_direction),
        cmocka_unit_test(a_small_sun_in_an_image_keeps_its_flux),
        cmocka_unit_test(the_tone_curve_rises_and_ends_at_one),
        cmocka_unit_test(a_node_is_the_weighted_mean_of_its_leaves),
        cmocka_unit_test(gathers_sum_the_links_as_they_are_written),
        cmocka_unit_test(light_is_linear_and_off_is_black),
        cmocka_unit_test(the_shadow_test_has_the_last_word_and_is_asked_about_the_surface),
        cmocka_unit_test(a_block_reads_back_as_it_was_written),
        cmocka_unit_test(a_flipped_bit_anywhere_is_found),
        cmocka_unit_test(a_block_cut_short_or_long_is_refused),
        cmocka_unit_test(another_version_is_named_as_such),
        cmocka_unit_test(an_origin_that_is_no_place_is_refused),
        cmocka_unit_test(lies_under_a_right_checksum_are_found_and_named_once),
        cmocka_unit_test(damage_under_a_right_checksum_does_no_harm),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
