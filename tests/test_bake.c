/* Whole bakes of small scenes: what comes out at run time, against closed forms and against the baker's promises. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <stdio.h>
#include <string.h>

#include "chiaro_shared.h"
#include "common/bake.h"
#include "common/clock.h"

static ChiaroBakeDesc small_bake(void)
{
    return (ChiaroBakeDesc){.struct_size = sizeof(ChiaroBakeDesc), .samples = 256, .rays = 512, .receivers = 120,
                            .threads = 2, .seed = 1};
}

static void paint(Mesh *mesh, float red, float green, float blue)
{
    float *albedo = mesh->materials[mesh->scene.material_count - 1].albedo;
    albedo[0] = red, albedo[1] = green, albedo[2] = blue;
}

/* Irradiance at the drawn vertices, as the mean over the area of the drawn triangles. */
static double mean_irradiance(const Bake *bake, uint32_t channel, double *area)
{
    const ChiaroTransport *t = &bake->transport;
    double sum = 0, whole = 0;
    for (uint32_t i = 0; i < t->index_count; i += 3) {
        double corners = 0;
        Vec3 place[3];
        for (uint32_t k = 0; k < 3; k++) {
            uint32_t v = t->indices[i + k];
            place[k] = vec3_load(t->vertices[v].position);
            corners += (double)bake->irradiance[3 * t->vertex_receivers[v] + channel] / 3;
        }
        Vec3 cross = vec3_cross(vec3_sub(place[1], place[0]), vec3_sub(place[2], place[0]));
        sum += corners * (double)vec3_length(cross) / 2, whole += (double)vec3_length(cross) / 2;
    }
    *area = whole;
    return sum / whole;
}

/* Root of the mean square of what the receivers are off by, relative. */
static double spread_about(const Bake *bake, uint32_t channel, double truth)
{
    double sum = 0;
    for (uint32_t r = 0; r < bake->transport.receiver_count; r++) {
        double off = (double)bake->irradiance[3 * r + channel] / truth - 1;
        sum += off * off / bake->transport.receiver_count;
    }
    return sqrt(sum);
}

/* ------------------------------------------------------------------------------------------------------------------
 * All bounces
 */

/* Walls that emit radiance 1 are as bright as pi / (1 - rho), everywhere. */
static void a_furnace_is_even_at_every_albedo(void **state)
{
    (void)state;
    const float albedos[] = {0.5f, 0.9f, 0.99f};
    for (int i = 0; i < 3; i++) {
        Mesh mesh = mesh_room(albedos[i], 1);
        ChiaroBakeDesc desc = small_bake();
        Bake bake = open_bake(&mesh, &desc);
        must_light_up(&bake, NULL, 0, NULL);
        double truth = pi / (1 - (double)albedos[i]);
        for (uint32_t r = 0; r < 3 * bake.transport.receiver_count; r++)
            assert_near("albedo", (double)albedos[i], (double)bake.irradiance[r], truth, 0.01 * truth);
        close_bake(&bake);
    }
}

static void a_coloured_furnace_keeps_its_channels_apart(void **state)
{
    (void)state;
    const double albedo[3] = {0.9, 0.5, 0.05}, emission[3] = {1, 0.25, 3};
    Mesh mesh = mesh_room(0.5f, 0);
    paint(&mesh, 0.9f, 0.5f, 0.05f);
    for (int c = 0; c < 3; c++)
        mesh.materials[0].emission[c] = (float)emission[c];
    ChiaroBakeDesc desc = small_bake();
    Bake bake = open_bake(&mesh, &desc);
    must_light_up(&bake, NULL, 0, NULL);
    for (uint32_t r = 0; r < 3 * bake.transport.receiver_count; r++) {
        double truth = pi * emission[r % 3] / (1 - albedo[r % 3]);
        assert_near("channel", r % 3, (double)bake.irradiance[r], truth, 0.01 * truth);
    }
    close_bake(&bake);
}

/* All light of a lamp strikes the walls, so rho / (1 - rho) of it comes again: over the area that mean is exact in any
 * closed shape of one albedo. */
static void a_lamp_in_a_closed_box_gives_the_mean_of_an_integrating_sphere(void **state)
{
    (void)state;
    const double albedo[3] = {0.9, 0.5, 0.2};
    Mesh mesh = mesh_room(0.5f, 0);
    paint(&mesh, 0.9f, 0.5f, 0.2f);
    ChiaroBakeDesc desc = small_bake();
    desc.samples = 1024, desc.receivers = 500;
    Bake bake = open_bake(&mesh, &desc);
    const ChiaroLight lamps[] = {lamp_at(1.5f, 1, 2, 1), lamp_at(0.6f, 1.5f, 3, 1), lamp_at(2, 0.4f, 1, 1)};
    for (uint32_t l = 0; l < 3; l++) {
        must_light_up(&bake, &lamps[l], 1, NULL);
        for (uint32_t c = 0; c < 3; c++) {
            double area, mean = mean_irradiance(&bake, c, &area), truth = 4 * pi / 52 * albedo[c] / (1 - albedo[c]);
            assert_near("area", l, area, 52, 1e-3);
            assert_near("albedo", albedo[c], mean, truth, 0.02 * truth);
        }
    }
    close_bake(&bake);
}

/* Two albedos, exact: the walls of a sphere see all of it alike, so irradiance is even: the mean of what is sent. */
static void a_sphere_of_two_albedos_is_lit_evenly(void **state)
{
    (void)state;
    const double upper[3] = {0.9, 0.6, 0.1}, lower[3] = {0.3, 0.6, 0.9};
    Mesh mesh = mesh_begin(), bowl = mesh_begin();
    mesh_material(&bowl, 0, 0);
    mesh_sphere(&bowl, 1, 24, true);
    for (int half = 0; half < 2; half++) {
        mesh_material(&mesh, 0, 0);
        paint(&mesh, half ? 0.9f : 0.3f, 0.6f, half ? 0.1f : 0.9f);
        for (uint32_t i = 0; i < bowl.scene.index_count; i += 3) {
            Vec3 v[3];
            for (uint32_t k = 0; k < 3; k++) {
                v[k] = vec3_load(bowl.vertices[i + k].position);
                if (half)
                    v[k].y = -v[k].y;
            }
            mesh_triangle(&mesh, v[0], half ? v[2] : v[1], half ? v[1] : v[2]);
        }
    }
    mesh_end(&bowl);
    ChiaroBakeDesc desc = small_bake();
    desc.receivers = 300;
    Bake bake = open_bake(&mesh, &desc);
    /* A lamp in the middle: E = 1 straight, then E = mean(rho) (1 + E). */
    ChiaroLight lamp = lamp_at(0, 0, 0, 1);
    must_light_up(&bake, &lamp, 1, NULL);
    for (uint32_t c = 0; c < 3; c++) {
        double rho = (upper[c] + lower[c]) / 2, area, mean = mean_irradiance(&bake, c, &area);
        double truth = 4 * pi / area * rho / (1 - rho); /* facets have a little less area than a sphere */
        assert_near("mean of channel", c, mean, truth, 0.01 * truth);
        /* Corners of facets lean by up to 5 degrees, so they see up to 4 % more of one half than of the other. */
        assert_below("spread of channel", c, spread_about(&bake, c, truth), 0.04);
    }
    close_bake(&bake);
}

/* rho pi L V / (1 - rho (1 - V)), V = 1/2, is what the bowl sends: irradiance is that without the first rho. */
static void a_bowl_under_a_uniform_sky(void **state)
{
    (void)state;
    const double albedo[3] = {0.2, 0.8, 0.99};
    const float one[3] = {1, 1, 1};
    ChiaroSky sky = {1, 1, one};
    Mesh mesh = mesh_begin();
    mesh_material(&mesh, 0, 0);
    paint(&mesh, 0.2f, 0.8f, 0.99f);
    mesh_sphere(&mesh, 2, 24, true);
    ChiaroBakeDesc desc = small_bake();
    desc.receivers = 200;
    Bake bake = open_bake(&mesh, &desc);
    assert_int_equal(bake.transport.info.sky_seen, 1);
    must_light_up(&bake, NULL, 0, &sky);
    for (uint32_t c = 0; c < 3; c++) {
        double truth = pi * 0.5 / (1 - albedo[c] * 0.5), area;
        assert_near("mean", albedo[c], mean_irradiance(&bake, c, &area), truth, 0.01 * truth);
        assert_below("spread", albedo[c], spread_about(&bake, c, truth), 0.05);
        for (uint32_t r = 0; r < bake.transport.receiver_count; r++) {
            const ChiaroReceiver *receiver = &bake.transport.receivers[r];
            double open = (double)receiver->sky;
            /* A facet leans by up to 5 degrees: its corners see 4 % more or less. */
            assert_near("sky", r, open, 0.5, 0.065);
            assert_near("cavity", albedo[c], (double)receiver->cavity[c], open / (1 - albedo[c] * (1 - open)), 1e-3);
            assert_near("bent", r, (double)vec3_length(vec3_load(receiver->bent)), 1, 1e-4);
            assert_true(receiver->bent[1] > 0);
        }
    }
    close_bake(&bake);
}

/* One place alone under a sky that is as bright as the cosine of the zenith: 2/3 [(pi - b) cos b + sin b]. */
static void tilted_planes_under_a_cosine_sky(void **state)
{
    (void)state;
    enum { W = 64, H = 256 };
    float *image = new_array((size_t)W * H * 3, sizeof(float));
    for (uint32_t j = 0; j < H; j++)
        for (uint32_t i = 0; i < 3 * W; i++)
            image[(size_t)j * 3 * W + i] = fmaxf(0, (float)cos(pi * (j + 0.5) / H));
    ChiaroSky sky = {W, H, image};
    const double tilts[] = {0, 30, 60, 90};
    for (int k = 0; k < 4; k++) {
        double b = tilts[k] * pi / 180, truth = 2 / 3.0 * ((pi - b) * cos(b) + sin(b));
        Vec3 normal = vec3((float)sin(b), (float)cos(b), 0), t, s;
        vec3_frame(normal, &t, &s);
        Mesh mesh = mesh_begin();
        mesh_material(&mesh, 0.5f, 0);
        mesh_triangle(&mesh, vec3_sub(vec3_scale(t, -1), s), vec3_sub(t, s), s);
        ChiaroBakeDesc desc = small_bake();
        desc.links = 128, desc.rays = 2048;
        Bake bake = open_bake(&mesh, &desc);
        must_light_up(&bake, NULL, 0, &sky);
        for (uint32_t r = 0; r < 3 * bake.transport.receiver_count; r++)
            assert_near("tilt", tilts[k], (double)bake.irradiance[r], truth, 0.02 * truth);
        close_bake(&bake);
    }
    free(image);
}

/* ------------------------------------------------------------------------------------------------------------------
 * Rows
 */

/* A yard: floor and three walls that face in; nothing is seen from behind from inside it. */
static Mesh yard(float albedo)
{
    Mesh mesh = mesh_begin();
    mesh_material(&mesh, albedo, 0);
    mesh_quad(&mesh, vec3(0, 0, 3), vec3(3, 0, 3), vec3(3, 0, 0), vec3(0, 0, 0));
    mesh_quad(&mesh, vec3(0, 0, 0), vec3(3, 0, 0), vec3(3, 2, 0), vec3(0, 2, 0));
    mesh_quad(&mesh, vec3(0, 0, 3), vec3(0, 0, 0), vec3(0, 2, 0), vec3(0, 2, 3));
    mesh_quad(&mesh, vec3(3, 0, 0), vec3(3, 0, 3), vec3(3, 2, 3), vec3(3, 2, 0));
    return mesh;
}

/* A uniform sky over black walls: every receiver gets what its rays found, however few links there are. */
static void links_keep_the_energy_of_a_uniform_sky(void **state)
{
    (void)state;
    const uint32_t links[3] = {4, 16, 64};
    const float one[3] = {1, 1, 1};
    ChiaroSky sky = {1, 1, one};
    for (int k = 0; k < 3; k++) {
        Mesh mesh = yard(0);
        ChiaroBakeDesc desc = small_bake();
        desc.links = links[k];
        Bake bake = open_bake(&mesh, &desc);
        must_light_up(&bake, NULL, 0, &sky);
        for (uint32_t r = 0; r < bake.transport.receiver_count; r++) {
            double truth = (double)CHIARO_PI * (double)bake.transport.receivers[r].sky;
            assert_near("receiver", r, (double)bake.irradiance[3 * r], truth, 1e-3 * (double)CHIARO_PI);
        }
        close_bake(&bake);
    }
}

static void baked_light_is_linear_and_goes_out(void **state)
{
    (void)state;
    Mesh mesh = mesh_room(0.7f, 0);
    ChiaroBakeDesc desc = small_bake();
    Bake bake = open_bake(&mesh, &desc);
    size_t n = 3 * (size_t)bake.transport.receiver_count;
    float *a = new_array(n, sizeof *a), *b = new_array(n, sizeof *b);
    ChiaroLight lamps[2] = {lamp_at(1, 1, 1, 2), lamp_at(2, 0.5f, 3, 3)};
    must_light_up(&bake, &lamps[0], 1, NULL);
    memcpy(a, bake.irradiance, n * sizeof *a);
    must_light_up(&bake, &lamps[1], 1, NULL);
    memcpy(b, bake.irradiance, n * sizeof *b);
    must_light_up(&bake, lamps, 2, NULL);
    for (size_t i = 0; i < n; i++) {
        double sum = (double)a[i] + (double)b[i];
        assert_near("sum", (double)i, (double)bake.irradiance[i], sum, 1e-5 * sum);
    }
    for (int c = 0; c < 3; c++)
        lamps[0].intensity[c] *= 4096;
    must_light_up(&bake, &lamps[0], 1, NULL);
    for (size_t i = 0; i < n; i++)
        assert_true(bake.irradiance[i] == 4096 * a[i]);
    must_light_up(&bake, NULL, 0, NULL);
    for (size_t i = 0; i < n; i++)
        assert_true(bake.irradiance[i] == 0);
    free(a);
    free(b);
    close_bake(&bake);
}

/* ------------------------------------------------------------------------------------------------------------------
 * Determinism, progress, arguments
 */

/* Something with several parts, an emitter, colours and open sky. */
static Mesh pavilion(void)
{
    Mesh mesh = mesh_begin();
    mesh_material(&mesh, 0.6f, 0);
    paint(&mesh, 0.8f, 0.5f, 0.3f);
    mesh_quad(&mesh, vec3(0, 0, 3), vec3(3, 0, 3), vec3(3, 0, 0), vec3(0, 0, 0));
    mesh_material(&mesh, 0.7f, 0);
    mesh_quad(&mesh, vec3(0, 0, 0), vec3(3, 0, 0), vec3(3, 2, 0), vec3(0, 2, 0));
    mesh_quad(&mesh, vec3(0, 0, 3), vec3(0, 0, 0), vec3(0, 2, 0), vec3(0, 2, 3));
    mesh_material(&mesh, 0.2f, 4);
    mesh_quad(&mesh, vec3(1, 2, 1), vec3(2, 2, 1), vec3(2, 2, 2), vec3(1, 2, 2)); /* faces down */
    return mesh;
}

static void the_bytes_do_not_depend_on_threads_but_on_the_seed(void **state)
{
    (void)state;
    Mesh mesh = pavilion();
    ChiaroBakeDesc desc = small_bake();
    desc.rays = 256;
    ChiaroBlob blobs[5];
    for (uint32_t k = 0; k < 5; k++) {
        desc.threads = k < 3 ? k + 1 : 2;
        desc.seed = k < 4 ? 1 : 2;
        assert_int_equal(chiaro_bake(&mesh.scene, &desc, &blobs[k]), CHIARO_OK);
    }
    for (uint32_t k = 1; k < 4; k++) {
        assert_int_equal(blobs[k].size, blobs[0].size);
        assert_memory_equal(blobs[k].data, blobs[0].data, blobs[0].size);
    }
    assert_true(blobs[4].size != blobs[0].size || memcmp(blobs[4].data, blobs[0].data, blobs[0].size) != 0);
    for (uint32_t k = 0; k < 5; k++)
        chiaro_blob_free(&blobs[k]);
    mesh_end(&mesh);
}

typedef struct Watch {
    uint32_t calls, stop_at;
    bool stopped;
    float last;
    double when; /* it was told to stop */
} Watch;

static bool watch(const char *stage, float done, void *user)
{
    Watch *w = user;
    assert_non_null(stage);
    assert_false(w->stopped); /* who was told to stop does not ask again */
    assert_true(done >= w->last && done <= 1);
    w->last = done;
    if (++w->calls != w->stop_at)
        return true;
    w->stopped = true;
    w->when = clock_now();
    return false;
}

static void progress_rises_to_its_end_and_can_stop_a_bake_anywhere(void **state)
{
    (void)state;
    Mesh mesh = pavilion();
    ChiaroBakeDesc desc = small_bake();
    desc.rays = 256, desc.threads = 1;
    Watch whole = {0};
    desc.progress = watch, desc.progress_user = &whole;
    ChiaroBlob blob;
    assert_int_equal(chiaro_bake(&mesh.scene, &desc, &blob), CHIARO_OK);
    chiaro_blob_free(&blob);
    assert_near("end", 0, (double)whole.last, 1, 1e-6);
    assert_true(whole.calls >= 20);
    for (uint32_t k = 0; k < 8; k++) {
        /* With two threads this one is called about half as often. */
        desc.threads = 1 + k % 2;
        Watch w = {.stop_at = 1 + whole.calls * k / (desc.threads == 1 ? 7 : 20)};
        desc.progress_user = &w;
        blob = (ChiaroBlob){&mesh, 77};
        assert_int_equal(chiaro_bake(&mesh.scene, &desc, &blob), CHIARO_ERROR_INTERRUPTED);
        double waited = clock_now() - w.when;
        assert_true(w.stopped);
        assert_true(blob.data == &mesh && blob.size == 77);
        assert_below("seconds until it stopped, at call", w.stop_at, waited, 2);
    }
    mesh_end(&mesh);
}

static void wrong_descriptions_are_refused(void **state)
{
    (void)state;
    Mesh mesh = mesh_room(0.5f, 0), empty = mesh_begin();
    ChiaroBlob blob = {&mesh, 77};
    ChiaroBakeDesc good = small_bake();
    const struct {
        size_t field;
        uint32_t value;
    } wrong[] = {{offsetof(ChiaroBakeDesc, struct_size), 0},
                 {offsetof(ChiaroBakeDesc, struct_size), sizeof(ChiaroBakeDesc) - 8},
                 {offsetof(ChiaroBakeDesc, links), CHIARO_MAX_LINKS + 1},
                 {offsetof(ChiaroBakeDesc, links), UINT32_MAX},
                 {offsetof(ChiaroBakeDesc, samples), CHIARO_MIN_SAMPLES - 1},
                 {offsetof(ChiaroBakeDesc, samples), CHIARO_MAX_SAMPLES + 1},
                 {offsetof(ChiaroBakeDesc, rays), CHIARO_MAX_RAYS + 1},
                 {offsetof(ChiaroBakeDesc, rays), 15},
                 {offsetof(ChiaroBakeDesc, threads), UINT32_MAX},
                 {offsetof(ChiaroBakeDesc, receivers), UINT32_MAX}};
    char accepted[256] = "";
    for (size_t k = 0; k < sizeof wrong / sizeof *wrong; k++) {
        ChiaroBakeDesc desc = good;
        memcpy((char *)&desc + wrong[k].field, &wrong[k].value, sizeof wrong[k].value);
        if (chiaro_bake(&mesh.scene, &desc, &blob) != CHIARO_ERROR_ARGUMENT)
            snprintf(accepted + strlen(accepted), sizeof accepted - strlen(accepted), " %zu", k);
    }
    if (accepted[0])
        fail_msg("accepted:%s", accepted);
    assert_int_equal(chiaro_bake(NULL, &good, &blob), CHIARO_ERROR_ARGUMENT);
    assert_int_equal(chiaro_bake(&mesh.scene, &good, NULL), CHIARO_ERROR_ARGUMENT);
    assert_int_equal(chiaro_bake(&empty.scene, &good, &blob), CHIARO_ERROR_SCENE);
    mesh.vertices[5].position[1] = NAN;
    assert_int_equal(chiaro_bake(&mesh.scene, &good, &blob), CHIARO_ERROR_SCENE);
    assert_true(blob.data == &mesh && blob.size == 77);
    chiaro_blob_free(NULL);
    mesh_end(&mesh);
}

/* ------------------------------------------------------------------------------------------------------------------
 * Strange scenes
 */

static void triangles_without_area_are_counted_and_change_nothing(void **state)
{
    (void)state;
    Mesh mesh = mesh_room(0.5f, 1);
    Vec3 p = vec3(1, 1, 1), q = vec3(2, 1, 1);
    for (uint32_t k = 0; k < 3; k++) { /* a point, a line, a line of three points; their normals are anything */
        mesh_triangle(&mesh, p, k ? q : p, k == 2 ? vec3(1.5f, 1, 1) : p);
        for (uint32_t i = 0; i < 3; i++)
            vec3_store(mesh.vertices[mesh.scene.vertex_count - 1 - i].normal, vec3(0, 1, 0));
    }
    ChiaroBakeDesc desc = small_bake();
    Bake bake = open_bake(&mesh, &desc);
    assert_int_equal(bake.transport.info.degenerate_triangles, 3);
    must_light_up(&bake, NULL, 0, NULL);
    double area;
    assert_near("mean", 0, mean_irradiance(&bake, 0, &area), 2 * pi, 0.01 * 2 * pi);
    close_bake(&bake);
}

static void a_face_given_twice_is_no_harm(void **state)
{
    (void)state;
    Mesh mesh = mesh_begin();
    mesh_material(&mesh, 0.5f, 1);
    mesh_box(&mesh, vec3(0, 0, 0), vec3(3, 2, 4));
    mesh_box(&mesh, vec3(0, 0, 0), vec3(3, 2, 4));
    ChiaroBakeDesc desc = small_bake();
    Bake bake = open_bake(&mesh, &desc);
    must_light_up(&bake, NULL, 0, NULL);
    for (uint32_t r = 0; r < 3 * bake.transport.receiver_count; r++)
        assert_near("receiver", r / 3, (double)bake.irradiance[r], 2 * pi, 0.01 * 2 * pi);
    close_bake(&bake);
}

static void one_triangle_receives_nothing_but_sky(void **state)
{
    (void)state;
    const float one[3] = {1, 2, 3};
    ChiaroSky sky = {1, 1, one};
    Mesh mesh = mesh_begin();
    mesh_material(&mesh, 0.5f, 2);
    mesh_triangle(&mesh, vec3(0, 0, 0), vec3(0, 0, 1), vec3(1, 0, 0));
    ChiaroBakeDesc desc = small_bake();
    Bake bake = open_bake(&mesh, &desc);
    ChiaroLight lamp = lamp_at(0.2f, 0.5f, 0.2f, 10);
    must_light_up(&bake, &lamp, 1, NULL);
    for (uint32_t i = 0; i < 3 * bake.transport.receiver_count; i++)
        assert_true(bake.irradiance[i] == 0);
    must_light_up(&bake, &lamp, 1, &sky);
    for (uint32_t i = 0; i < 3 * bake.transport.receiver_count; i++)
        assert_near("sky", i, (double)bake.irradiance[i], pi * (double)one[i % 3], 1e-3 * pi * (double)one[i % 3]);
    close_bake(&bake);
}

static void black_walls_send_nothing_back(void **state)
{
    (void)state;
    Mesh mesh = mesh_room(0, 0);
    ChiaroBakeDesc desc = small_bake();
    Bake bake = open_bake(&mesh, &desc);
    ChiaroLight lamp = lamp_at(1, 1, 1, 1e6f);
    must_light_up(&bake, &lamp, 1, NULL);
    for (uint32_t i = 0; i < 3 * bake.transport.receiver_count; i++)
        assert_true(bake.irradiance[i] == 0);
    close_bake(&bake);
}

static void albedo_above_the_limit_is_clamped_and_counted(void **state)
{
    (void)state;
    Mesh mesh = mesh_room(1, 1);
    ChiaroBakeDesc desc = small_bake();
    desc.clamped_materials = 3; /* by the importer; one more is found here */
    Bake bake = open_bake(&mesh, &desc);
    assert_int_equal(bake.transport.info.clamped_materials, 4);
    must_light_up(&bake, NULL, 0, NULL);
    for (uint32_t r = 0; r < 3 * bake.transport.receiver_count; r++)
        assert_near("receiver", r / 3, (double)bake.irradiance[r], 100 * pi, pi);
    close_bake(&bake);
}

/* Light of a lamp in a room with a block, the lamp's intensity scaled with the room's surface. */
static Bake light_scaled(float scale)
{
    Mesh mesh = mesh_begin();
    mesh_material(&mesh, 0.7f, 0);
    mesh_box(&mesh, vec3(0, 0, 0), vec3(3 * scale, 2 * scale, 4 * scale));
    mesh_material(&mesh, 0.4f, 0);
    float l = scale, h = 1.5f * scale;
    mesh_quad(&mesh, vec3(l, l, h), vec3(h, l, h), vec3(h, l, l), vec3(l, l, l)); /* a shelf that faces up */
    ChiaroBakeDesc desc = small_bake();
    desc.samples = 1024, desc.links = 128, desc.rays = 4096; /* patches, blocks and rays may fall otherwise */
    Bake bake = open_bake(&mesh, &desc);
    ChiaroLight lamp = lamp_at(1.2f * scale, 1.2f * scale, 3 * scale, scale * scale);
    must_light_up(&bake, &lamp, 1, NULL);
    return bake;
}

/* Powers of two leave every rounding as it was: the same to the last digits. Others change roundings, so another bake
 * comes out, as from another seed: alike, but not the same. */
static void the_size_of_a_scene_does_not_matter(void **state)
{
    (void)state;
    static const struct {
        float scale;
        double wrong;
    } cases[] = {{0.0009765625f, 1e-4}, {1024, 1e-4}, {1e-3f, 0.03}, {1e3f, 0.03}};
    Bake unit = light_scaled(1);
    for (size_t k = 0; k < sizeof cases / sizeof *cases; k++) {
        float scale = cases[k].scale;
        Bake bake = light_scaled(scale);
        double area, mean = mean_irradiance(&unit, 1, &area);
        assert_near("mean, scale", (double)scale, mean_irradiance(&bake, 1, &area), mean, 0.01 * mean);
        assert_int_equal(bake.transport.sample_count, unit.transport.sample_count);
        uint32_t matched = 0;
        double wrong = 0, size = 0;
        for (uint32_t r = 0; r < bake.transport.receiver_count; r++)
            for (uint32_t u = 0; u < unit.transport.receiver_count; u++) {
                const ChiaroReceiver *x = &bake.transport.receivers[r], *y = &unit.transport.receivers[u];
                Vec3 apart = vec3_sub(vec3_scale(vec3_load(x->position), 1 / scale), vec3_load(y->position));
                if (vec3_length(apart) > 1e-4f || vec3_dot(vec3_load(x->normal), vec3_load(y->normal)) < 0.99f)
                    continue;
                double a = (double)bake.irradiance[3 * r], b = (double)unit.irradiance[3 * u];
                wrong += (a - b) * (a - b), size += b * b;
                matched++;
                break;
            }
        assert_true(matched > unit.transport.receiver_count * 9 / 10);
        assert_below("corresponding receivers, scale", (double)scale, sqrt(wrong / size), cases[k].wrong);
        close_bake(&bake);
    }
    close_bake(&unit);
}

/* A black block stands askew on a wide floor, so that its foot cuts the floor's patches anyhow. The sun shines on the floor
 * before it, of which a place at the foot of that face sees half its hemisphere: half of what the floor sends. The block
 * sends nothing back. */
static void the_foot_of_a_block_sees_the_floor_before_it(void **state)
{
    (void)state;
    const float turn = 0.3f, half = 1, height = 1.5f, albedo = 0.6f;
    const Vec3 front = {sinf(turn), 0, cosf(turn)}, side = {cosf(turn), 0, -sinf(turn)}, up = {0, height, 0};
    Mesh mesh = mesh_begin();
    mesh_material(&mesh, albedo, 0);
    mesh_quad(&mesh, vec3(-20, 0, 20), vec3(20, 0, 20), vec3(20, 0, -20), vec3(-20, 0, -20));
    mesh_material(&mesh, 0, 0);
    Vec3 foot[4];
    for (int k = 0; k < 4; k++) /* left and right of the front, right and left of the back */
        foot[k] = vec3_add(vec3_scale(front, k < 2 ? half : -half), vec3_scale(side, k == 1 || k == 2 ? half : -half));
    for (int k = 0; k < 4; k++) {
        Vec3 a = foot[k], b = foot[(k + 1) % 4];
        mesh_quad(&mesh, a, b, vec3_add(b, up), vec3_add(a, up));
    }
    mesh_quad(&mesh, vec3_add(foot[0], up), vec3_add(foot[1], up), vec3_add(foot[2], up), vec3_add(foot[3], up));
    ChiaroBakeDesc desc = small_bake();
    desc.samples = 4096, desc.receivers = 20000, desc.links = 128; /* what links lose is not the matter here */
    Bake bake = open_bake(&mesh, &desc);
    ChiaroLight sun = {.type = CHIARO_LIGHT_SUN, .intensity = {1, 1, 1}};
    Vec3 down = vec3_normalize(vec3_add(vec3_scale(front, -1), vec3(0, -1, 0)));
    vec3_store(sun.direction, down);
    must_light_up(&bake, &sun, 1, NULL);
    double truth = 0.5 * (double)albedo * -(double)down.y;
    uint32_t found = 0;
    for (uint32_t r = 0; r < bake.transport.receiver_count; r++) {
        const ChiaroReceiver *receiver = &bake.transport.receivers[r];
        bool inner = fabsf(vec3_dot(vec3_load(receiver->position), side)) < 0.9f * half;
        if (vec3_dot(vec3_load(receiver->normal), front) < 0.99f || receiver->position[1] > 0.02f || !inner)
            continue;
        assert_near("at the foot, receiver", r, (double)bake.irradiance[3 * r], truth, 0.05 * truth);
        found++;
    }
    assert_true(found >= 8);
    close_bake(&bake);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_furnace_is_even_at_every_albedo),
        cmocka_unit_test(a_coloured_furnace_keeps_its_channels_apart),
        cmocka_unit_test(a_lamp_in_a_closed_box_gives_the_mean_of_an_integrating_sphere),
        cmocka_unit_test(a_sphere_of_two_albedos_is_lit_evenly),
        cmocka_unit_test(a_bowl_under_a_uniform_sky),
        cmocka_unit_test(tilted_planes_under_a_cosine_sky),
        cmocka_unit_test(links_keep_the_energy_of_a_uniform_sky),
        cmocka_unit_test(baked_light_is_linear_and_goes_out),
        cmocka_unit_test(the_bytes_do_not_depend_on_threads_but_on_the_seed),
        cmocka_unit_test(progress_rises_to_its_end_and_can_stop_a_bake_anywhere),
        cmocka_unit_test(wrong_descriptions_are_refused),
        cmocka_unit_test(triangles_without_area_are_counted_and_change_nothing),
        cmocka_unit_test(a_face_given_twice_is_no_harm),
        cmocka_unit_test(one_triangle_receives_nothing_but_sky),
        cmocka_unit_test(black_walls_send_nothing_back),
        cmocka_unit_test(the_foot_of_a_block_sees_the_floor_before_it),
        cmocka_unit_test(albedo_above_the_limit_is_clamped_and_counted),
        cmocka_unit_test(the_size_of_a_scene_does_not_matter),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
