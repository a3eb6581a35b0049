/* An emitting triangle is drawn as often as its area times its mean emission; a point on it evenly. Where the guess of
 * the mean misses a bright spot of a texture the picture gets noisier, not wrong: rays that find it by chance count
 * fully. */
#include "path.h"

#include <stdlib.h>

/* Points per edge of the lattice on which textured emission is averaged. */
#define LATTICE 6

static double power_of(const ChiaroScene *scene, uint32_t part, uint32_t triangle)
{
    const ChiaroMaterial *material = &scene->materials[scene->parts[part].material];
    if (!(vec3_max(vec3_load(material->emission)) > 0))
        return 0;
    int steps = material->emission_texture == CHIARO_NONE ? 1 : LATTICE, points = 0;
    double sum = 0;
    for (int i = 0; i < steps; i++) {
        for (int j = 0; i + j < steps; j++, points++) {
            float albedo[3], emission[3], scale = 1 / ((float)steps + 0.5f);
            float u = ((float)i + 0.5f) * scale, v = ((float)j + 0.5f) * scale;
            chiaro_surface(scene, part, triangle, u, v, albedo, emission);
            sum += vec3_luminance(vec3_load(emission));
        }
    }
    return path_triangle_area(scene, triangle) * sum / points;
}

/* Appends the emitting triangles of one part; without arrays it only counts. */
static void add_part(const ChiaroScene *scene, uint32_t part, Emitters *emitters)
{
    uint32_t first = scene->parts[part].first_index / 3, count = scene->parts[part].index_count / 3;
    for (uint32_t i = first; i < first + count; i++) {
        double power = power_of(scene, part, i);
        if (!(power > 0))
            continue;
        if (emitters->sums) {
            emitters->parts[emitters->count] = part, emitters->triangles[emitters->count] = i;
            emitters->sums[emitters->count + 1] = emitters->sums[emitters->count] + power;
        }
        emitters->count++;
    }
}

bool emitters_create(const ChiaroScene *scene, Emitters *emitters)
{
    *emitters = (Emitters){0};
    for (uint32_t i = 0; i < scene->part_count; i++)
        add_part(scene, i, emitters);
    if (emitters->count == 0)
        return true;
    size_t count = emitters->count;
    emitters->parts = malloc(count * sizeof(uint32_t));
    emitters->triangles = malloc(count * sizeof(uint32_t));
    emitters->sums = calloc(count + 1, sizeof(double));
    emitters->densities = calloc(scene->index_count / 3, sizeof(float));
    if (!emitters->parts || !emitters->triangles || !emitters->sums || !emitters->densities) {
        emitters_destroy(emitters);
        return false;
    }
    emitters->count = 0;
    for (uint32_t i = 0; i < scene->part_count; i++)
        add_part(scene, i, emitters);
    for (size_t i = 0; i < count; i++) {
        double share = (emitters->sums[i + 1] - emitters->sums[i]) / emitters->sums[count];
        uint32_t triangle = emitters->triangles[i];
        emitters->densities[triangle] = (float)(share / path_triangle_area(scene, triangle));
    }
    return true;
}

void emitters_destroy(Emitters *emitters)
{
    free(emitters->parts);
    free(emitters->triangles);
    free(emitters->sums);
    free(emitters->densities);
    *emitters = (Emitters){0};
}

EmitterPoint emitters_draw(const Emitters *emitters, float choice, Pair place)
{
    uint32_t low = 0, high = emitters->count;
    double wanted = choice * emitters->sums[high];
    while (high - low > 1) {
        uint32_t middle = (low + high) / 2;
        *(emitters->sums[middle] <= wanted ? &low : &high) = middle;
    }
    float root = sqrtf(place.u);
    uint32_t triangle = emitters->triangles[low];
    return (EmitterPoint){emitters->parts[low], triangle, root * (1 - place.v), root * place.v,
                          emitters->densities[triangle]};
}
