/* What a scene is made of, one point at a time: checks, textures, surface colours, and the light that a lamp sends.
 * Every part of Chiaro (baker, reference, renderer) asks here, so that they agree. */
#include "log.h"
#include "samples.h"

#include <float.h>
#include <string.h>

/* ------------------------------------------------------------------------------------------------------------------
 * Checks
 */

/* Coordinates up to here leave room for squares and volumes in floats. */
#define MAX_COORDINATE 1e9f
#define MAX_TEXTURE_SIZE 32768u
#define MAX_SKY_SIZE 32768u

typedef struct Check {
    const ChiaroScene *scene;
    const ChiaroLog *log;
} Check;

static bool all_finite(const float *values, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        if (!isfinite(values[i]))
            return false;
    }
    return true;
}

static bool all_in(const float *values, size_t count, float low, float high)
{
    for (size_t i = 0; i < count; i++) {
        if (!(values[i] >= low && values[i] <= high)) /* refuses NaN as well */
            return false;
    }
    return true;
}

static bool is_unit(const float v[3])
{
    return all_finite(v, 3) && fabsf(vec3_length(vec3_load(v)) - 1) <= 0.01f;
}

/* Names the first fault and answers false. `what` and its number, then what is wrong with it. */
static bool refuse(const Check *check, const char *what, uint32_t number, const char *fault)
{
    chiaro_log_write(check->log, CHIARO_LOG_ERROR, CHIARO_LOG_SCENE_INVALID, "%s %u: %s", what, number, fault);
    return false;
}

static bool check_vertices(const Check *check)
{
    for (uint32_t i = 0; i < check->scene->vertex_count; i++) {
        const ChiaroVertex *v = &check->scene->vertices[i];
        if (!all_in(v->position, 3, -MAX_COORDINATE, MAX_COORDINATE))
            return refuse(check, "vertex", i, "position is not finite or too large");
        if (!is_unit(v->normal))
            return refuse(check, "vertex", i, "normal is not a unit vector");
        if (!all_finite(v->uv, 2) || !all_finite(v->emission_uv, 2))
            return refuse(check, "vertex", i, "texture coordinates are not finite");
        if (!all_in(v->color, 4, 0, FLT_MAX))
            return refuse(check, "vertex", i, "colour is negative or not finite");
    }
    return true;
}

static bool check_textures(const Check *check)
{
    for (uint32_t i = 0; i < check->scene->texture_count; i++) {
        const ChiaroTexture *t = &check->scene->textures[i];
        if (t->width < 1 || t->height < 1 || t->width > MAX_TEXTURE_SIZE || t->height > MAX_TEXTURE_SIZE)
            return refuse(check, "texture", i, "size is out of range");
        uint64_t bytes = (uint64_t)t->width * t->height * 4;
        if (bytes > check->scene->pixel_bytes || t->first_byte > check->scene->pixel_bytes - bytes)
            return refuse(check, "texture", i, "pixels lie outside the scene's pixels");
        if (t->wrap_u > CHIARO_WRAP_MIRROR || t->wrap_v > CHIARO_WRAP_MIRROR || t->nearest > 1)
            return refuse(check, "texture", i, "wrap or filter is unknown");
    }
    return true;
}

static bool check_materials(const Check *check)
{
    for (uint32_t i = 0; i < check->scene->material_count; i++) {
        const ChiaroMaterial *m = &check->scene->materials[i];
        if (!all_in(m->albedo, 3, 0, FLT_MAX))
            return refuse(check, "material", i, "albedo is negative or not finite");
        if (!all_in(m->emission, 3, 0, FLT_MAX))
            return refuse(check, "material", i, "emission is negative or not finite");
        if (!all_in(&m->alpha, 1, 0, 1) || !all_in(&m->alpha_cutoff, 1, 0, FLT_MAX))
            return refuse(check, "material", i, "alpha is out of range");
        if ((m->albedo_texture != CHIARO_NONE && m->albedo_texture >= check->scene->texture_count) ||
            (m->emission_texture != CHIARO_NONE && m->emission_texture >= check->scene->texture_count))
            return refuse(check, "material", i, "texture does not exist");
    }
    return true;
}

static bool same_place(const ChiaroScene *scene, uint32_t index, uint32_t other)
{
    const float *a = scene->vertices[scene->indices[index]].position;
    const float *b = scene->vertices[scene->indices[other]].position;
    return a[0] == b[0] && a[1] == b[1] && a[2] == b[2];
}

/* The other side has the same corners in the opposite order. */
static bool is_reverse(const ChiaroScene *scene, uint32_t first, uint32_t twin_first)
{
    for (uint32_t turn = 0; turn < 3; turn++) {
        bool same = true;
        for (uint32_t i = 0; i < 3; i++)
            same &= same_place(scene, first + i, twin_first + (turn + 3 - i) % 3);
        if (same)
            return true;
    }
    return false;
}

static bool check_twin(const Check *check, uint32_t number)
{
    const ChiaroScene *scene = check->scene;
    const ChiaroPart *part = &scene->parts[number];
    if (part->twin == CHIARO_NONE)
        return true;
    if (part->twin >= scene->part_count || part->twin == number || scene->parts[part->twin].twin != number ||
        scene->parts[part->twin].index_count != part->index_count)
        return refuse(check, "part", number, "twin does not match");
    for (uint32_t i = 0; i < part->index_count; i += 3) {
        if (!is_reverse(scene, part->first_index + i, scene->parts[part->twin].first_index + i))
            return refuse(check, "part", number, "twin is not its other side");
    }
    return true;
}

/* Light comes through from a side that is there; and if that were of another material, more could leave than came. */
static bool check_transmission(const Check *check, uint32_t number)
{
    const ChiaroPart *part = &check->scene->parts[number];
    bool through = vec3_max(chiaro_material_transmission(&check->scene->materials[part->material])) > 0;
    if (through && (part->twin == CHIARO_NONE || check->scene->parts[part->twin].material != part->material))
        return refuse(check, "part", number, "lets light through, but has no other side of the same material");
    return true;
}

static bool check_parts(const Check *check)
{
    const ChiaroScene *scene = check->scene;
    for (uint32_t i = 0; i < scene->index_count; i++) {
        if (scene->indices[i] >= scene->vertex_count)
            return refuse(check, "index", i, "vertex does not exist");
    }
    for (uint32_t i = 0; i < scene->part_count; i++) {
        const ChiaroPart *part = &scene->parts[i];
        if (part->first_index % 3 || part->index_count % 3 || part->index_count > scene->index_count ||
            part->first_index > scene->index_count - part->index_count)
            return refuse(check, "part", i, "triangles lie outside the scene's indices");
        if (part->material >= scene->material_count)
            return refuse(check, "part", i, "material does not exist");
    }
    for (uint32_t i = 0; i < scene->part_count; i++) {
        if (!check_twin(check, i) || !check_transmission(check, i))
            return false;
    }
    return true;
}

static bool check_lights_and_cameras(const Check *check)
{
    for (uint32_t i = 0; i < check->scene->light_count; i++) {
        if (chiaro_light_check(&check->scene->lights[i]) != CHIARO_OK)
            return refuse(check, "light", i, "a number is out of range");
    }
    for (uint32_t i = 0; i < check->scene->camera_count; i++) {
        const ChiaroCamera *c = &check->scene->cameras[i];
        if (!all_finite(c->eye, 3) || !is_unit(c->forward) || !is_unit(c->up) ||
            fabsf(vec3_dot(vec3_load(c->forward), vec3_load(c->up))) > 0.01f)
            return refuse(check, "camera", i, "eye, forward or up is out of range");
        if (!(c->yfov > 0 && c->yfov < CHIARO_PI) || !(c->znear > 0 && c->znear <= FLT_MAX) ||
            !(c->zfar == 0 || (c->zfar > c->znear && c->zfar <= FLT_MAX)))
            return refuse(check, "camera", i, "opening, znear or zfar is out of range");
        if (!memchr(c->name, 0, CHIARO_NAME_SIZE))
            return refuse(check, "camera", i, "name has no end");
    }
    return true;
}

static bool check_arrays(const Check *check)
{
    const ChiaroScene *s = check->scene;
    bool missing = (s->vertex_count && !s->vertices) || (s->index_count && !s->indices) ||
                   (s->part_count && !s->parts) || (s->material_count && !s->materials) ||
                   (s->texture_count && !s->textures) || (s->pixel_bytes && !s->pixels) ||
                   (s->light_count && !s->lights) || (s->camera_count && !s->cameras);
    uint64_t used = 0;
    for (uint32_t i = 0; !missing && i < s->part_count; i++)
        used += s->parts[i].index_count;
    const char *fault = missing                 ? "an array is missing"
                        : s->index_count % 3    ? "the number of indices is no multiple of 3"
                        : used == 0             ? "there are no triangles"
                        : used > s->index_count ? "parts overlap"
                                                : NULL;
    if (fault)
        chiaro_log_write(check->log, CHIARO_LOG_ERROR, CHIARO_LOG_SCENE_INVALID, "%s", fault);
    return !fault;
}

ChiaroResult chiaro_scene_check(const ChiaroScene *scene, const ChiaroLog *log)
{
    Check check = {scene, log};
    bool good = check_arrays(&check) && check_vertices(&check) && check_textures(&check) && check_materials(&check) &&
                check_parts(&check) && check_lights_and_cameras(&check);
    return good ? CHIARO_OK : CHIARO_ERROR_SCENE;
}

ChiaroResult chiaro_light_check(const ChiaroLight *light)
{
    bool placed = light->type == CHIARO_LIGHT_POINT || light->type == CHIARO_LIGHT_SPOT;
    bool directed = light->type == CHIARO_LIGHT_SPOT || light->type == CHIARO_LIGHT_SUN;
    bool good = (placed || directed) && all_in(light->intensity, 3, 0, FLT_MAX) &&
                (!placed || all_in(light->position, 3, -MAX_COORDINATE, MAX_COORDINATE)) &&
                (!placed || all_in(&light->range, 1, 0, FLT_MAX)) && (!directed || is_unit(light->direction));
    if (light->type == CHIARO_LIGHT_SPOT)
        good = good && all_in(&light->cos_inner, 1, -1, 1) && all_in(&light->cos_outer, 1, -1, light->cos_inner);
    return good ? CHIARO_OK : CHIARO_ERROR_ARGUMENT;
}

ChiaroResult chiaro_sky_check(const ChiaroSky *sky)
{
    bool sized = sky->width >= 1 && sky->height >= 1 && sky->width <= MAX_SKY_SIZE && sky->height <= MAX_SKY_SIZE;
    bool good = sized && sky->radiance && all_in(sky->radiance, (size_t)sky->width * sky->height * 3, 0, FLT_MAX);
    return good ? CHIARO_OK : CHIARO_ERROR_ARGUMENT;
}

/* ------------------------------------------------------------------------------------------------------------------
 * Textures and surfaces
 */

/* sRGB byte to linear light (IEC 61966-2-1). A table, since powf is slow and differs from library to library. */
static const float srgb_to_linear[256] = {
    0.0f, 0.000303526984f, 0.000607053967f, 0.000910580951f, 0.00121410793f, 0.00151763492f, 0.0018211619f,
    0.00212468888f, 0.00242821587f, 0.00273174285f, 0.00303526984f, 0.00334653576f, 0.00367650732f, 0.00402471702f,
    0.00439144204f, 0.00477695348f, 0.0051815167f, 0.00560539162f, 0.00604883302f, 0.00651209079f, 0.00699541019f,
    0.00749903204f, 0.00802319299f, 0.00856812562f, 0.0091340587f, 0.00972121732f, 0.010329823f, 0.010960094f,
    0.0116122452f, 0.0122864884f, 0.0129830323f, 0.013702083f, 0.0144438436f, 0.0152085144f, 0.0159962934f,
    0.0168073758f, 0.0176419545f, 0.0185002201f, 0.019382361f, 0.0202885631f, 0.0212190104f, 0.0221738848f,
    0.0231533662f, 0.0241576324f, 0.0251868596f, 0.0262412219f, 0.0273208916f, 0.0284260395f, 0.0295568344f,
    0.0307134437f, 0.0318960331f, 0.0331047666f, 0.0343398068f, 0.0356013149f, 0.0368894504f, 0.0382043716f,
    0.0395462353f, 0.0409151969f, 0.0423114106f, 0.0437350293f, 0.0451862044f, 0.0466650863f, 0.0481718242f,
    0.049706566f, 0.0512694584f, 0.052860647f, 0.0544802764f, 0.05612849f, 0.0578054302f, 0.0595112382f,
    0.0612460542f, 0.0630100177f, 0.0648032667f, 0.0666259386f, 0.0684781698f, 0.0703600957f, 0.0722718507f,
    0.0742135684f, 0.0761853815f, 0.0781874218f, 0.0802198203f, 0.0822827071f, 0.0843762115f, 0.086500462f,
    0.0886555863f, 0.0908417112f, 0.0930589628f, 0.0953074666f, 0.0975873471f, 0.0998987282f, 0.102241733f,
    0.104616484f, 0.107023103f, 0.109461711f, 0.111932428f, 0.114435374f, 0.116970668f, 0.119538428f, 0.122138772f,
    0.124771818f, 0.12743768f, 0.130136477f, 0.132868322f, 0.13563333f, 0.138431615f, 0.141263291f, 0.144128471f,
    0.147027266f, 0.14995979f, 0.152926152f, 0.155926464f, 0.158960835f, 0.162029376f, 0.165132195f, 0.1682694f,
    0.171441101f, 0.174647404f, 0.177888416f, 0.181164244f, 0.184474995f, 0.187820772f, 0.191201683f, 0.19461783f,
    0.19806932f, 0.201556254f, 0.205078736f, 0.20863687f, 0.212230757f, 0.2158605f, 0.2195262f, 0.223227957f,
    0.226965874f, 0.230740049f, 0.234550582f, 0.238397574f, 0.242281122f, 0.246201327f, 0.250158285f, 0.254152094f,
    0.258182853f, 0.262250658f, 0.266355605f, 0.270497791f, 0.274677312f, 0.278894263f, 0.28314874f, 0.287440838f,
    0.29177065f, 0.296138271f, 0.300543794f, 0.304987314f, 0.309468923f, 0.313988713f, 0.318546778f, 0.323143209f,
    0.327778098f, 0.332451536f, 0.337163615f, 0.341914425f, 0.346704056f, 0.3515326f, 0.356400144f, 0.36130678f,
    0.366252596f, 0.37123768f, 0.376262123f, 0.381326011f, 0.386429434f, 0.391572478f, 0.396755231f, 0.40197778f,
    0.407240212f, 0.412542613f, 0.417885071f, 0.42326767f, 0.428690497f, 0.434153636f, 0.439657174f, 0.445201195f,
    0.450785783f, 0.456411023f, 0.462077f, 0.467783796f, 0.473531496f, 0.479320183f, 0.48514994f, 0.49102085f,
    0.496932995f, 0.502886458f, 0.508881321f, 0.514917665f, 0.520995573f, 0.527115126f, 0.533276404f, 0.539479489f,
    0.545724461f, 0.552011402f, 0.55834039f, 0.564711506f, 0.571124829f, 0.57758044f, 0.584078418f, 0.590618841f,
    0.597201788f, 0.603827339f, 0.610495571f, 0.617206562f, 0.623960392f, 0.630757136f, 0.637596874f, 0.644479682f,
    0.651405637f, 0.658374817f, 0.665387298f, 0.672443157f, 0.67954247f, 0.686685312f, 0.693871761f, 0.701101892f,
    0.70837578f, 0.715693501f, 0.723055129f, 0.73046074f, 0.737910409f, 0.74540421f, 0.752942217f, 0.760524505f,
    0.768151147f, 0.775822218f, 0.783537792f, 0.79129794f, 0.799102738f, 0.806952258f, 0.814846572f, 0.822785754f,
    0.830769877f, 0.838799012f, 0.846873232f, 0.854992608f, 0.863157213f, 0.871367119f, 0.879622397f, 0.887923118f,
    0.896269353f, 0.904661174f, 0.913098652f, 0.921581856f, 0.930110858f, 0.938685728f, 0.947306537f, 0.955973353f,
    0.964686248f, 0.97344529f, 0.98225055f, 0.991102097f, 1.0f,
};

/* A coordinate brought into one period (mirror: two), where whole numbers of texels are exact. */
static float wrap_coordinate(float x, uint32_t wrap)
{
    if (wrap == CHIARO_WRAP_CLAMP)
        return chiaro_clamp(x, 0, 1);
    return wrap == CHIARO_WRAP_MIRROR ? x - 2 * floorf(x / 2) : x - floorf(x);
}

/* Texel number in [0, size) of one in [-1, 2 size]. */
static uint32_t wrap_texel(int64_t texel, uint32_t size, uint32_t wrap)
{
    int64_t n = size;
    if (wrap == CHIARO_WRAP_CLAMP)
        return (uint32_t)(texel < 0 ? 0 : texel >= n ? n - 1 : texel);
    int64_t period = wrap == CHIARO_WRAP_MIRROR ? 2 * n : n, within = (texel + period) % period;
    return (uint32_t)(within < n ? within : period - 1 - within);
}

static void add_texel(const uint8_t *pixels, uint32_t width, uint32_t x, uint32_t y, float weight, float rgba[4])
{
    const uint8_t *texel = pixels + ((size_t)y * width + x) * 4;
    for (uint32_t c = 0; c < 3; c++)
        rgba[c] += weight * srgb_to_linear[texel[c]];
    rgba[3] += weight * ((float)texel[3] / 255.0f);
}

void chiaro_texture_sample(const ChiaroScene *scene, uint32_t texture, const float uv[2], float rgba[4])
{
    const ChiaroTexture *t = &scene->textures[texture];
    const uint8_t *pixels = scene->pixels + t->first_byte;
    float offset = t->nearest ? 0 : 0.5f;
    float x = wrap_coordinate(uv[0], t->wrap_u) * (float)t->width - offset;
    float y = wrap_coordinate(uv[1], t->wrap_v) * (float)t->height - offset;
    int64_t column = (int64_t)floorf(x), row = (int64_t)floorf(y);
    uint32_t left = wrap_texel(column, t->width, t->wrap_u), top = wrap_texel(row, t->height, t->wrap_v);
    rgba[0] = rgba[1] = rgba[2] = rgba[3] = 0;
    if (t->nearest) {
        add_texel(pixels, t->width, left, top, 1, rgba);
        return;
    }
    uint32_t right = wrap_texel(column + 1, t->width, t->wrap_u), bottom = wrap_texel(row + 1, t->height, t->wrap_v);
    float s = x - floorf(x), r = y - floorf(y);
    add_texel(pixels, t->width, left, top, (1 - s) * (1 - r), rgba);
    add_texel(pixels, t->width, right, top, s * (1 - r), rgba);
    add_texel(pixels, t->width, left, bottom, (1 - s) * r, rgba);
    add_texel(pixels, t->width, right, bottom, s * r, rgba);
}

static float mix3(float a, float b, float c, float u, float v) { return (1 - u - v) * a + u * b + v * c; }

float chiaro_surface(const ChiaroScene *scene, uint32_t part, uint32_t triangle, float u, float v, float albedo[3],
                     float emission[3])
{
    const ChiaroMaterial *material = &scene->materials[scene->parts[part].material];
    const uint32_t *index = scene->indices + (size_t)triangle * 3;
    const ChiaroVertex *a = &scene->vertices[index[0]], *b = &scene->vertices[index[1]];
    const ChiaroVertex *c = &scene->vertices[index[2]];
    float color[4] = {1, 1, 1, 1}, glow[4] = {1, 1, 1, 1}, uv[2];
    if (material->albedo_texture != CHIARO_NONE) {
        for (uint32_t i = 0; i < 2; i++)
            uv[i] = mix3(a->uv[i], b->uv[i], c->uv[i], u, v);
        chiaro_texture_sample(scene, material->albedo_texture, uv, color);
    }
    if (material->emission_texture != CHIARO_NONE) {
        for (uint32_t i = 0; i < 2; i++)
            uv[i] = mix3(a->emission_uv[i], b->emission_uv[i], c->emission_uv[i], u, v);
        chiaro_texture_sample(scene, material->emission_texture, uv, glow);
    }
    for (uint32_t i = 0; i < 3; i++) {
        float tint = material->albedo[i] * color[i] * mix3(a->color[i], b->color[i], c->color[i], u, v);
        albedo[i] = chiaro_clamp(tint, 0, CHIARO_MAX_ALBEDO);
        emission[i] = material->emission[i] * glow[i];
    }
    return material->alpha * color[3] * mix3(a->color[3], b->color[3], c->color[3], u, v);
}

/* ------------------------------------------------------------------------------------------------------------------
 * Lamps
 */

/* Below a tenth of a nanometre the square law ends: infinity is of no use to anyone. */
#define MIN_SQUARED_DISTANCE 1e-20f

void chiaro_light_at(const ChiaroLight *light, const float point[3], float toward[3], float *distance, float rgb[3])
{
    if (light->type == CHIARO_LIGHT_SUN) {
        vec3_store(toward, vec3_scale(vec3_load(light->direction), -1));
        *distance = INFINITY;
        memcpy(rgb, light->intensity, 3 * sizeof(float));
        return;
    }
    Vec3 line = vec3_sub(vec3_load(light->position), vec3_load(point)), unit = vec3_normalize(line);
    float d = vec3_length(line), attenuation = 1 / chiaro_max(d * d, MIN_SQUARED_DISTANCE);
    /* Window and cone as the extension KHR_lights_punctual of glTF recommends them. */
    if (light->range > 0) {
        float q = d / light->range;
        attenuation *= chiaro_clamp(1 - q * q * q * q, 0, 1);
    }
    if (light->type == CHIARO_LIGHT_SPOT) {
        float scale = 1 / chiaro_max(light->cos_inner - light->cos_outer, 0.001f);
        float along = -vec3_dot(vec3_load(light->direction), unit);
        float cone = chiaro_clamp((along - light->cos_outer) * scale, 0, 1);
        attenuation *= cone * cone;
    }
    vec3_store(toward, unit);
    *distance = d;
    vec3_store(rgb, vec3_scale(vec3_load(light->intensity), attenuation));
}
