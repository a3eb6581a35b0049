/* Exposure and the filmic curve, as the shader has them (article: the picture is for people). */
#include "tone.h"

#include <math.h>

#include "chiaro_shared.h"

void chiaro_tone_map(const float rgb[3], float exposure, float out[3])
{
    const float a = (float)CHIARO_TONE_A, b = (float)CHIARO_TONE_B, c = (float)CHIARO_TONE_C, d = (float)CHIARO_TONE_D,
                e = (float)CHIARO_TONE_E, factor = exp2f(exposure);
    for (int i = 0; i < 3; i++) {
        float x = rgb[i] * factor;
        /* Compares that NaN fails; the limit keeps the squares finite. */
        x = x > 0 ? x : 0;
        x = x < 1e4f ? x : 1e4f;
        float y = x * (a * x + b) / (x * (c * x + d) + e);
        out[i] = y < 1 ? y : 1;
    }
}
