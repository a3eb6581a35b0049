/* The picture is for people: exposure and a filmic curve. */
#ifndef CHIARO_TONE_H
#define CHIARO_TONE_H

/* Linear radiance to display-linear 0 .. 1; `exposure` in stops. Twin of chiaro_tone in chiaro.glsl. NaN gives black. */
void chiaro_tone_map(const float rgb[3], float exposure, float out[3]);

#endif
