/* Key lights: the brightest spot that a cube sees, and what a blocker hides of it, against closed forms. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <math.h>

#include "../src/core/random.h"
#include "../src/core/world.h"
#include "chiaro_shared.h"
#include "common/check.h"

enum { RAYS = 1536 };

/* A spot of light on a sphere of this radius about the centre. */
typedef struct Disc {
    Vec3 direction;
    float half, distance, radiance; /* half angle */
} Disc;

/* Even rays to all sides, through surroundings of radiance 1 at 10 m. */
static void look_around(const Disc *discs, uint32_t count, KeyRay rays[RAYS])
{
    for (uint32_t k = 0; k < RAYS; k++) {
        float y = 1 - (2 * (float)k + 1) / RAYS, r = sqrtf(1 - y * y), turn = 2.39996323f * (float)k, shown = 1, far = 10;
        Vec3 direction = {r * cosf(turn), y, r * sinf(turn)};
        for (uint32_t d = 0; d < count; d++) {
            if (vec3_dot(direction, discs[d].direction) > cosf(discs[d].half))
                shown = discs[d].radiance, far = discs[d].distance;
        }
        rays[k] = (KeyRay){direction, vec3(shown, shown, 2 * shown), 4 * CHIARO_PI / RAYS, far};
    }
}

/* Its place and size, and the light that is more than twice the mean of all around. */
static void a_bright_spot_is_found_where_it_is(void **state)
{
    ChiaroRandom random = chiaro_random_seed(3, 1);
    (void)state;
    for (uint32_t k = 0; k < 20; k++) {
        static KeyRay rays[RAYS];
        float z = 2 * chiaro_random_float(&random) - 1, turn = 6 * chiaro_random_float(&random), r = sqrtf(1 - z * z);
        Disc disc = {vec3(r * cosf(turn), r * sinf(turn), z), 0.15f + 0.2f * chiaro_random_float(&random),
                     2 + 3 * chiaro_random_float(&random), 100};
        const Vec3 center = {1, -2, 3};
        look_around(&disc, 1, rays);
        KeyLight key = chiaro_key_find(rays, RAYS, center);
        Vec3 off = vec3_sub(vec3_sub(key.place, center), vec3_scale(disc.direction, disc.distance));
        double share = (1 - cos((double)disc.half)) / 2, mean = 1 + share * 99;
        double square = (double)(disc.distance * disc.distance), sine = sin((double)disc.half);
        double expected = 4 * pi * share * (100 - 2 * mean) * square;
        assert_below("place", k, (double)vec3_length(off), 0.05 * (double)disc.distance);
        assert_near("radius", k, (double)key.radius, sine * (double)disc.distance, 0.1 * sine * (double)disc.distance);
        assert_near("red", k, (double)key.intensity.x, expected, 0.15 * expected);
        assert_near("blue", k, (double)key.intensity.z, 2 * expected, 0.3 * expected);
    }
}

static void of_spots_that_are_alike_there_is_none(void **state)
{
    static KeyRay rays[RAYS];
    Disc discs[2] = {{{0, 1, 0}, 0.25f, 4, 100}, {{1, 0, 0}, 0.25f, 4, 100}};
    (void)state;
    look_around(discs, 0, rays);
    assert_true(vec3_max(chiaro_key_find(rays, RAYS, vec3(0, 0, 0)).intensity) <= 0);
    assert_true(vec3_max(chiaro_key_find(rays, 0, vec3(0, 0, 0)).intensity) <= 0);
    look_around(discs, 1, rays);
    float alone = chiaro_key_find(rays, RAYS, vec3(0, 0, 0)).intensity.x;
    look_around(discs, 2, rays);
    assert_below("two", 0, (double)chiaro_key_find(rays, RAYS, vec3(0, 0, 0)).intensity.x, 0.1 * (double)alone);
    /* The dimmer one takes from the brighter: there is no step where they change places. */
    discs[1].radiance = 52;
    look_around(discs, 2, rays);
    KeyLight key = chiaro_key_find(rays, RAYS, vec3(0, 0, 0));
    assert_near("direction", 0, (double)key.place.y, 4, 0.2);
    assert_true(key.intensity.x > 0.35f * alone && key.intensity.x < 0.65f * alone);
}

/* Area that two circles have in common. */
static double lens(double a, double b, double apart)
{
    double least = fmin(a, b);
    if (apart <= fabs(a - b))
        return pi * least * least;
    if (apart >= a + b)
        return 0;
    double x = (apart * apart + a * a - b * b) / (2 * apart), u = acos(x / a), v = acos((apart - x) / b);
    return a * a * (u - sin(u) * cos(u)) + b * b * (v - sin(v) * cos(v));
}

/* A ball between a floor and a spot above it: the edge of its shadow goes over softly, near enough as that of two discs. */
static void a_blocker_hides_what_it_covers(void **state)
{
    const Vec3 up = {0, 1, 0};
    (void)state;
    for (uint32_t k = 0; k < 3; k++) {
        const float radius = 0.1f + 0.1f * (float)k;
        ChiaroWorldBlocker ball = {.center = {0, 1, 0}, .radius = radius, .key = {0, 4, 0}, .key_radius = 0.6f,
                                   .key_intensity = {16, 8, 0}};
        for (int step = -40; step <= 40; step++) {
            float x = 0.025f * (float)step;
            Vec3 way = {-x, 1, 0}, toward = {-x, 4, 0};
            float distance = vec3_length(toward), sine = radius / vec3_length(way);
            float form = sine * sine * vec3_normalize(way).y;
            Vec3 hidden = chiaro_key_hidden(&ball, up, way, form);
            double whole = 16 * 4 / pow((double)distance, 3), size = 0.6 / (double)distance;
            double apart = (double)vec3_length(vec3_sub(vec3_normalize(way), vec3_normalize(toward)));
            double covered = lens((double)sine, size, apart) / (pi * size * size);
            assert_near("hidden", (uint32_t)(step + 40), (double)hidden.x / whole, covered, 0.12);
            assert_near("green", (uint32_t)(step + 40), (double)hidden.y, (double)hidden.x / 2, 1e-6);
        }
        /* What lies in front of a blocker, or below the receiver's horizon, it does not hide. */
        ball.key[1] = 0.5f;
        assert_true(chiaro_key_hidden(&ball, up, vec3(0, 1, 0), radius * radius).x <= 0);
        ball.key[1] = 4;
        assert_true(chiaro_key_hidden(&ball, vec3(0, -1, 0), vec3(0, 1, 0), 0).x <= 0);
    }
}

/* Blockers end at walls, whose depth is that of the texel that a place lies in. */
static void walls_end_what_blockers_do(void **state)
{
    ChiaroRandom random = chiaro_random_seed(8, 2);
    ChiaroWorldBlocker blocker = {.middle = {1, 2, 3}, .range = 0};
    float far[3] = {100, 0, 0};
    (void)state;
    assert_true(chiaro_blocker_seen(&blocker, far) >= 1); /* there are no walls */
    blocker.range = 2;
    for (uint32_t t = 0; t < CHIARO_BLOCKER_DEPTHS; t++)
        blocker.depths[t] = (uint8_t)(20 + chiaro_random_bits(&random) % 236);
    for (uint32_t k = 0; k < 1000; k++) {
        float d[3], point[3];
        for (int c = 0; c < 3; c++)
            d[c] = 2 * chiaro_random_float(&random) - 1;
        vec3_store(d, vec3_normalize(vec3_load(d)));
        float depth = 2 * (float)blocker.depths[chiaro_cube_texel(vec3_load(d), CHIARO_DEPTH_EDGE)] / 255;
        for (uint32_t step = 0; step < 3; step++) {
            static const float parts[] = {1.1f, 1.3f, 1.5f};
            vec3_store(point, vec3_mad(vec3_load(blocker.middle), vec3_load(d), parts[step] * depth));
            assert_near("seen", k, (double)chiaro_blocker_seen(&blocker, point), step == 0 ? 1 : step == 1 ? 0.5 : 0, 1e-3);
        }
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_bright_spot_is_found_where_it_is),
        cmocka_unit_test(of_spots_that_are_alike_there_is_none),
        cmocka_unit_test(a_blocker_hides_what_it_covers),
        cmocka_unit_test(walls_end_what_blockers_do),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
