/* The sky dome (article: "this sky dome will greatly influence the look"): an equirectangular image of radiance. */
#include "vec.h"

#include "chiaro/chiaro.h"

void chiaro_sky_radiance(const ChiaroSky *sky, const float direction[3], float rgb[3])
{
    Vec3 d = vec3_load(direction);
    uint32_t width = sky->width, height = sky->height;
    /* Texel centres lie at whole numbers of x and y. acos would lose the poles: atan2 keeps them. */
    float x = (0.5f + atan2f(d.z, d.x) / (2 * CHIARO_PI)) * (float)width - 0.5f;
    float y = atan2f(sqrtf(d.x * d.x + d.z * d.z), d.y) / CHIARO_PI * (float)height - 0.5f;
    float x_floor = floorf(x), y_floor = floorf(y), s = x - x_floor, t = y - y_floor;
    /* Columns go round (x_floor is -1 .. width - 1, or width by rounding), rows end at the poles. */
    uint32_t left = (uint32_t)((int64_t)x_floor + width) % width, right = (left + 1) % width;
    int64_t row = (int64_t)y_floor;
    uint32_t top = row < 0 ? 0 : row >= height ? height - 1 : (uint32_t)row;
    uint32_t bottom = row + 1 >= height ? height - 1 : (uint32_t)(row + 1);
    const float *upper = sky->radiance + (size_t)top * width * 3, *lower = sky->radiance + (size_t)bottom * width * 3;
    for (uint32_t c = 0; c < 3; c++) {
        /* In this form equal texels give exactly their value. */
        float a = upper[left * 3 + c], b = lower[left * 3 + c];
        a += s * (upper[right * 3 + c] - a), b += s * (lower[right * 3 + c] - b);
        rgb[c] = a + t * (b - a);
    }
}
