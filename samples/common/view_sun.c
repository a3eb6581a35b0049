/* Where the sun stands, and what the air leaves of it. */
#include "view_sun.h"

#include "../../src/core/vec.h"

/* Optical depth of clear air straight up at 630, 540 and 460 nm (Hansen and Travis, Space Science Reviews 16, 1974:
 * .008569 / l^4 (1 + .0113 / l^2 + .00013 / l^4) for l in micrometres), and some haze. */
static const float depth[3] = {0.056f + 0.05f, 0.105f + 0.05f, 0.202f + 0.05f};

/* Masses of air along the way down: Kasten and Young's formula, Applied Optics 28, 1989. */
static float air_mass(float sine)
{
    float degrees = asinf(fminf(1, sine)) * 180 / CHIARO_PI;
    return 1 / (sine + 0.50572f * powf(degrees + 6.07995f, -1.6364f));
}

ChiaroLight view_sun(const ChiaroLight *noon, float hour)
{
    ChiaroLight sun = *noon;
    Vec3 highest = vec3_scale(vec3_load(noon->direction), -1), west = vec3(-highest.z, 0, highest.x);
    west = vec3_length(west) > 1e-3f ? vec3_normalize(west) : vec3(1, 0, 0);
    float turn = (hour - 12) * CHIARO_PI / 12;
    Vec3 toward = vec3_normalize(vec3_mad(vec3_scale(highest, cosf(turn)), west, sinf(turn)));
    vec3_store(sun.direction, vec3_scale(toward, -1));
    for (uint32_t c = 0; c < 3; c++) {
        float mass = toward.y > 0 && highest.y > 0 ? air_mass(toward.y) - air_mass(highest.y) : 0;
        sun.intensity[c] *= toward.y > 0 ? expf(-depth[c] * mass) : 0;
    }
    return sun;
}
