/* Pictures on the CPU: drawn by one ray a pixel, and written. */
#include "picture.h"

#include "../../src/core/tone.h"

#include <stdlib.h>
#include <string.h>

static void shade(const ChiaroScene *scene, const ChiaroTransport *transport, const ChiaroHit *hit,
                  const float *irradiance, float pixel[4])
{
    float albedo[3], emission[3], weight[3] = {1 - hit->u - hit->v, hit->u, hit->v};
    chiaro_surface(scene, hit->part, hit->triangle, hit->u, hit->v, albedo, emission);
    for (uint32_t c = 0; c < 3; c++) {
        float sum = 0;
        for (uint32_t k = 0; k < 3; k++) {
            uint32_t receiver = transport->vertex_receivers[scene->indices[3 * hit->triangle + k]];
            sum += weight[k] * irradiance[3 * (size_t)receiver + c];
        }
        pixel[c] = albedo[c] / CHIARO_PI * sum;
    }
    pixel[3] = 1;
}

bool picture_hit(const ChiaroRays *rays, Vec3 origin, Vec3 direction, float end, ChiaroHit *hit)
{
    float from = 0;
    while (chiaro_rays_hit(rays, origin, direction, from, end, hit)) {
        if (hit->front)
            return true;
        from = hit->distance + chiaro_rays_epsilon(rays);
    }
    return false;
}

/* What a pixel shows. */
typedef void (*PixelFunc)(const ChiaroTransport *transport, const ChiaroScene *drawn, size_t pixel,
                          const ChiaroHit *hit, void *user);

/* Pixels that show a surface. False: out of memory. */
static bool each_pixel(const ChiaroTransport *transport, const PictureView *view, PixelFunc func, void *user)
{
    const ChiaroCamera *camera = view->camera;
    ChiaroScene drawn = transport->scene;
    ChiaroRays *rays;
    drawn.vertices = transport->vertices, drawn.vertex_count = transport->vertex_count;
    drawn.indices = transport->indices, drawn.index_count = transport->index_count;
    drawn.parts = transport->parts;
    if (chiaro_rays_create(&drawn, NULL, &rays) != CHIARO_OK)
        return false;
    Vec3 forward = vec3_load(camera->forward), up = vec3_load(camera->up), right = vec3_cross(forward, up);
    float half = tanf(camera->yfov / 2), aspect = (float)view->width / (float)view->height;
    for (uint32_t y = 0; y < view->height; y++) {
        for (uint32_t x = 0; x < view->width; x++) {
            float s = (2 * ((float)x + 0.5f) / (float)view->width - 1) * half * aspect;
            float t = (1 - 2 * ((float)y + 0.5f) / (float)view->height) * half;
            Vec3 direction = vec3_normalize(vec3_mad(vec3_mad(forward, right, s), up, t));
            ChiaroHit hit;
            if (picture_hit(rays, vec3_load(camera->eye), direction, INFINITY, &hit))
                func(transport, &drawn, (size_t)y * view->width + x, &hit, user);
        }
    }
    chiaro_rays_destroy(rays);
    return true;
}

typedef struct Drawing {
    const float *irradiance;
    float *pixels;
} Drawing;

static void draw_pixel(const ChiaroTransport *transport, const ChiaroScene *drawn, size_t pixel, const ChiaroHit *hit,
                       void *user)
{
    const Drawing *drawing = user;
    shade(drawn, transport, hit, drawing->irradiance, drawing->pixels + 4 * pixel);
}

bool picture_draw(const ChiaroTransport *transport, const PictureView *view, const float *irradiance,
                  ChiaroIoImage *picture)
{
    *picture = (ChiaroIoImage){view->width, view->height, 4,
                               calloc((size_t)view->width * view->height * 4, sizeof(float))};
    Drawing drawing = {irradiance, picture->pixels};
    if (picture->pixels && each_pixel(transport, view, draw_pixel, &drawing))
        return true;
    free(picture->pixels);
    return false;
}

static void see_pixel(const ChiaroTransport *transport, const ChiaroScene *drawn, size_t pixel, const ChiaroHit *hit,
                      void *user)
{
    bool *seen = user;
    (void)pixel;
    for (uint32_t k = 0; k < 3; k++)
        seen[transport->vertex_receivers[drawn->indices[3 * hit->triangle + k]]] = true;
}

bool picture_receivers(const ChiaroTransport *transport, const PictureView *view, bool *seen)
{
    return each_pixel(transport, view, see_pixel, seen);
}

static bool ends_with(const char *text, const char *end)
{
    size_t length = strlen(text), end_length = strlen(end);
    return length > end_length && strcmp(text + length - end_length, end) == 0;
}

bool picture_is_exr(const char *path)
{
    return ends_with(path, ".exr");
}

bool picture_is_png(const char *path)
{
    return ends_with(path, ".png");
}

bool picture_write(const char *path, ChiaroIoImage *picture, float exposure, ChiaroIoError *error)
{
    if (!picture_is_png(path))
        return chiaro_io_write_exr(path, picture, error);
    for (size_t i = 0, n = (size_t)picture->width * picture->height; i < n; i++) {
        float *pixel = picture->pixels + picture->channels * i;
        chiaro_tone_map(pixel, exposure, pixel);
        if (picture->channels == 4)
            pixel[3] = 1; /* the sky is part of the picture */
    }
    return chiaro_io_write_png(path, picture, error);
}
