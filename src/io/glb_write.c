/* A scene as binary glTF 2.0: two buffer views (indices; vertices, interleaved), one mesh per named node, one primitive
 * per part. Numbers are printed so that reading them gives the same bits. */
#include "io_error.h"

#include "../core/samples.h"

#include <stdlib.h>

/* Bytes that grow; once memory was short it stays `failed` and swallows what follows. */
typedef struct Bytes {
    char *data;
    size_t size, capacity;
    bool failed;
} Bytes;

static void add_bytes(Bytes *to, const void *data, size_t size)
{
    if (to->failed || size == 0)
        return;
    if (size > to->capacity - to->size) {
        size_t capacity = (to->size + size) * 2;
        char *moved = realloc(to->data, capacity);
        if (!moved) {
            to->failed = true;
            return;
        }
        to->data = moved;
        to->capacity = capacity;
    }
    memcpy(to->data + to->size, data, size);
    to->size += size;
}

static void __attribute__((format(printf, 2, 3))) add_text(Bytes *to, const char *format, ...)
{
    char text[512]; /* Every format below is far shorter. */
    va_list arguments;
    va_start(arguments, format);
    int length = vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    if (length < 0 || (size_t)length >= sizeof text)
        to->failed = true;
    else
        add_bytes(to, text, (size_t)length);
}

/* "[a,b,c]" */
static void add_floats(Bytes *to, const float *values, int count)
{
    for (int i = 0; i < count; i++)
        add_text(to, "%c%.9g", i ? ',' : '[', (double)values[i]);
    add_text(to, "]");
}

static void add_string(Bytes *to, const char *string)
{
    add_text(to, "\"");
    for (const char *c = string; *c; c++)
        if (*c == '"' || *c == '\\')
            add_text(to, "\\%c", *c);
        else if ((unsigned char)*c < 0x20)
            add_text(to, "\\u%04x", (unsigned)*c);
        else
            add_bytes(to, c, 1);
    add_text(to, "\"");
}

/* The lists of a glTF file while they grow; elements are separated as they come. */
typedef struct Document {
    const ChiaroScene *scene;
    Bytes accessors, meshes, nodes, materials, cameras, lights;
    Bytes extensions; /* of the material under way */
    Bytes indices, vertices;
    uint32_t accessor_count, mesh_count, node_count, material_count;
    uint32_t *material_index; /* Two for each of the scene's: one-sided, two-sided; CHIARO_NONE: not written yet. */
    bool colors, strengths, transmissions;
} Document;

static Bytes *begin_element(Bytes *list)
{
    if (list->size)
        add_text(list, ",");
    return list;
}

/* ------------------------------------------------------------------------------------------------------------------
 * Materials
 */

/* What of the albedo leaves on the other side: where that is not alike in all channels, the base colour is not the albedo. */
static void write_transmission(Document *document, const ChiaroMaterial *material, float base[3])
{
    Vec3 share = chiaro_material_transmission(material);
    float shares[3], color[3], most = vec3_max(share);
    vec3_store(shares, share);
    for (int c = 0; c < 3 && most > 0; c++) {
        color[c] = material->albedo[c] * (shares[c] / most);
        base[c] = most < 1 ? material->albedo[c] * ((1 - shares[c]) / (1 - most)) : material->albedo[c];
    }
    if (!(most > 0))
        return;
    add_text(&document->extensions, "%s\"KHR_materials_diffuse_transmission\":{\"diffuseTransmissionFactor\":%.9g,"
             "\"diffuseTransmissionColorFactor\":", document->extensions.size ? "," : "", (double)most);
    add_floats(&document->extensions, color, 3);
    add_text(&document->extensions, "}");
    document->transmissions = true;
}

static uint32_t write_material(Document *document, uint32_t index, bool two_sided)
{
    uint32_t *known = &document->material_index[index * 2 + two_sided];
    if (*known != CHIARO_NONE)
        return *known;
    const ChiaroMaterial *material = &document->scene->materials[index];
    Bytes *out = begin_element(&document->materials);
    float brightest = vec3_max(vec3_load(material->emission)), strength = brightest > 1 ? brightest : 1;
    float factor[4] = {material->albedo[0], material->albedo[1], material->albedo[2], material->alpha};
    document->extensions.size = 0;
    write_transmission(document, material, factor);
    add_text(out, "{\"name\":\"material_%u\",\"pbrMetallicRoughness\":{\"baseColorFactor\":", index);
    add_floats(out, factor, 4);
    add_text(out, ",\"metallicFactor\":0,\"roughnessFactor\":1}");
    if (brightest > 0) {
        const float emission[3] = {material->emission[0] / strength, material->emission[1] / strength,
                                   material->emission[2] / strength};
        add_text(out, ",\"emissiveFactor\":");
        add_floats(out, emission, 3);
    }
    if (strength > 1) {
        add_text(&document->extensions, "%s\"KHR_materials_emissive_strength\":{\"emissiveStrength\":%.9g}",
                 document->extensions.size ? "," : "", (double)strength);
        document->strengths = true;
    }
    if (document->extensions.size) {
        add_text(out, ",\"extensions\":{");
        add_bytes(out, document->extensions.data, document->extensions.size);
        add_text(out, "}");
        out->failed |= document->extensions.failed;
    }
    if (material->alpha_cutoff > 0)
        add_text(out, ",\"alphaMode\":\"MASK\",\"alphaCutoff\":%.9g", (double)material->alpha_cutoff);
    add_text(out, "%s}", two_sided ? ",\"doubleSided\":true" : "");
    return *known = document->material_count++;
}

/* ------------------------------------------------------------------------------------------------------------------
 * Geometry
 */

static void add_accessor(Document *document, int view, size_t offset, int component, uint32_t count, const char *type)
{
    add_text(begin_element(&document->accessors),
             "{\"bufferView\":%d,\"byteOffset\":%zu,\"componentType\":%d,\"count\":%u,\"type\":\"%s\"", view, offset,
             component, count, type);
    document->accessor_count++;
}

/* Writes the vertices [low, high] relative to the node's place, and what describes them. */
static void write_vertices(Document *document, uint32_t low, uint32_t high, Vec3 translation)
{
    enum { FLOAT = 5126 };
    size_t offset = document->vertices.size;
    float least[3] = {INFINITY, INFINITY, INFINITY}, most[3] = {-INFINITY, -INFINITY, -INFINITY};
    for (uint32_t i = low; i <= high; i++) {
        const ChiaroVertex *vertex = &document->scene->vertices[i];
        float place[3];
        vec3_store(place, vec3_sub(vec3_load(vertex->position), translation));
        for (int d = 0; d < 3; d++) {
            least[d] = fminf(least[d], place[d]);
            most[d] = fmaxf(most[d], place[d]);
        }
        add_bytes(&document->vertices, place, sizeof place);
        add_bytes(&document->vertices, vertex->normal, sizeof vertex->normal);
        if (document->colors)
            add_bytes(&document->vertices, vertex->color, sizeof vertex->color);
    }
    add_accessor(document, 1, offset, FLOAT, high - low + 1, "VEC3");
    add_text(&document->accessors, ",\"min\":");
    add_floats(&document->accessors, least, 3);
    add_text(&document->accessors, ",\"max\":");
    add_floats(&document->accessors, most, 3);
    add_text(&document->accessors, "}");
    add_accessor(document, 1, offset + 12, FLOAT, high - low + 1, "VEC3");
    add_text(&document->accessors, "}");
    if (document->colors) {
        add_accessor(document, 1, offset + 24, FLOAT, high - low + 1, "VEC4");
        add_text(&document->accessors, "}");
    }
}

static void write_primitive(Document *document, const ChiaroPart *part, Vec3 translation, bool first)
{
    enum { UNSIGNED_INT = 5125 };
    uint32_t low = UINT32_MAX, high = 0;
    const uint32_t *index = document->scene->indices + part->first_index;
    for (uint32_t i = 0; i < part->index_count; i++) {
        low = index[i] < low ? index[i] : low;
        high = index[i] > high ? index[i] : high;
    }
    uint32_t accessor = document->accessor_count;
    add_accessor(document, 0, document->indices.size, UNSIGNED_INT, part->index_count, "SCALAR");
    add_text(&document->accessors, "}");
    for (uint32_t i = 0; i < part->index_count; i++) {
        uint32_t relative = index[i] - low;
        add_bytes(&document->indices, &relative, sizeof relative);
    }
    write_vertices(document, low, high, translation);
    add_text(&document->meshes, "%s{\"attributes\":{\"POSITION\":%u,\"NORMAL\":%u", first ? "" : ",", accessor + 1,
             accessor + 2);
    if (document->colors)
        add_text(&document->meshes, ",\"COLOR_0\":%u", accessor + 3);
    add_text(&document->meshes, "},\"indices\":%u,\"material\":%u}", accessor,
             write_material(document, part->material, part->twin != CHIARO_NONE));
}

static void write_node(Document *document, const ChiaroIoNode *node)
{
    bool first = true;
    Bytes *out = begin_element(&document->nodes);
    add_text(out, "{\"name\":");
    add_string(out, node->name);
    if (vec3_length(vec3_load(node->translation)) > 0) {
        add_text(out, ",\"translation\":");
        add_floats(out, node->translation, 3);
    }
    for (uint32_t i = node->first_part; i < node->first_part + node->part_count; i++) {
        const ChiaroPart *part = &document->scene->parts[i];
        if (part->index_count == 0 || (part->twin != CHIARO_NONE && part->twin < i)) /* The other side is written. */
            continue;
        if (first)
            add_text(begin_element(&document->meshes), "{\"primitives\":[");
        write_primitive(document, part, vec3_load(node->translation), first);
        first = false;
    }
    if (!first) {
        add_text(&document->meshes, "]}");
        add_text(out, ",\"mesh\":%u", document->mesh_count++);
    }
    add_text(out, "}");
    document->node_count++;
}

/* ------------------------------------------------------------------------------------------------------------------
 * Lights and cameras: glTF turns them by their nodes, both look down their own -Z
 */

static void write_placed(Document *document, const char *name, Vec3 right, Vec3 up, Vec3 back, Vec3 place,
                         const char *what, uint32_t index)
{
    const float matrix[16] = {right.x, right.y, right.z, 0, up.x,    up.y,    up.z,    0,
                              back.x,  back.y,  back.z,  0, place.x, place.y, place.z, 1};
    Bytes *out = begin_element(&document->nodes);
    add_text(out, "{\"name\":");
    add_string(out, name);
    add_text(out, ",\"matrix\":");
    add_floats(out, matrix, 16);
    add_text(out, what, index);
    add_text(out, "}");
    document->node_count++;
}

static void write_light(Document *document, uint32_t index)
{
    static const char *const types[] = {"point", "spot", "directional"};
    const ChiaroLight *light = &document->scene->lights[index];
    char name[CHIARO_NAME_SIZE];
    float strongest = vec3_max(vec3_load(light->intensity)), color[3] = {1, 1, 1};
    Bytes *out = begin_element(&document->lights);
    for (int c = 0; c < 3 && strongest > 0; c++)
        color[c] = light->intensity[c] / strongest;
    snprintf(name, sizeof name, "light_%u", index);
    add_text(out, "{\"name\":\"%s\",\"type\":\"%s\",\"intensity\":%.9g,\"color\":", name, types[light->type],
             (double)strongest);
    add_floats(out, color, 3);
    if (light->range > 0 && light->type != CHIARO_LIGHT_SUN)
        add_text(out, ",\"range\":%.9g", (double)light->range);
    if (light->type == CHIARO_LIGHT_SPOT)
        add_text(out, ",\"spot\":{\"innerConeAngle\":%.9g,\"outerConeAngle\":%.9g}", acos((double)light->cos_inner),
                 acos((double)light->cos_outer));
    add_text(out, "}");
    Vec3 back = vec3(0, 0, 1), right = vec3(1, 0, 0), up = vec3(0, 1, 0);
    if (light->type != CHIARO_LIGHT_POINT) {
        back = vec3_scale(vec3_load(light->direction), -1);
        vec3_frame(back, &right, &up);
    }
    Vec3 place = light->type == CHIARO_LIGHT_SUN ? vec3(0, 0, 0) : vec3_load(light->position);
    write_placed(document, name, right, up, back, place, ",\"extensions\":{\"KHR_lights_punctual\":{\"light\":%u}}",
                 index);
}

static void write_camera(Document *document, uint32_t index)
{
    const ChiaroCamera *camera = &document->scene->cameras[index];
    Bytes *out = begin_element(&document->cameras);
    add_text(out, "{\"name\":");
    add_string(out, camera->name);
    add_text(out, ",\"type\":\"perspective\",\"perspective\":{\"yfov\":%.9g,\"znear\":%.9g", (double)camera->yfov,
             (double)camera->znear);
    if (camera->zfar > 0)
        add_text(out, ",\"zfar\":%.9g", (double)camera->zfar);
    add_text(out, "}}");
    Vec3 forward = vec3_load(camera->forward), up = vec3_load(camera->up);
    write_placed(document, camera->name, vec3_cross(forward, up), up, vec3_scale(forward, -1), vec3_load(camera->eye),
                 ",\"camera\":%u", index);
}

/* ------------------------------------------------------------------------------------------------------------------
 * The file
 */

/* Empty lists are not allowed in glTF. */
static void add_list(Bytes *json, const char *name, const Bytes *list)
{
    if (!list->size)
        return;
    add_text(json, ",\"%s\":[", name);
    add_bytes(json, list->data, list->size);
    add_text(json, "]");
    json->failed |= list->failed;
}

static void write_json(const Document *document, Bytes *json)
{
    const bool lights = document->lights.size > 0;
    const char *used[] = {document->strengths ? "KHR_materials_emissive_strength" : NULL,
                          document->transmissions ? "KHR_materials_diffuse_transmission" : NULL,
                          lights ? "KHR_lights_punctual" : NULL};
    uint32_t used_count = 0;
    size_t index_bytes = document->indices.size, vertex_bytes = document->vertices.size;
    add_text(json, "{\"asset\":{\"version\":\"2.0\",\"generator\":\"chiaro\"}");
    for (size_t i = 0; i < sizeof used / sizeof *used; i++)
        if (used[i])
            add_text(json, "%s\"%s\"", used_count++ ? "," : ",\"extensionsUsed\":[", used[i]);
    add_text(json, "%s,\"scene\":0,\"scenes\":[{\"nodes\":[", used_count ? "]" : "");
    for (uint32_t i = 0; i < document->node_count; i++)
        add_text(json, "%s%u", i ? "," : "", i);
    add_text(json, "]}]");
    add_list(json, "nodes", &document->nodes);
    add_list(json, "meshes", &document->meshes);
    add_list(json, "materials", &document->materials);
    add_list(json, "cameras", &document->cameras);
    if (lights) {
        add_text(json, ",\"extensions\":{\"KHR_lights_punctual\":{\"lights\":[");
        add_bytes(json, document->lights.data, document->lights.size);
        add_text(json, "]}}");
        json->failed |= document->lights.failed;
    }
    add_list(json, "accessors", &document->accessors);
    add_text(json,
             ",\"bufferViews\":[{\"buffer\":0,\"byteLength\":%zu,\"target\":34963},"
             "{\"buffer\":0,\"byteOffset\":%zu,\"byteLength\":%zu,\"byteStride\":%d,\"target\":34962}]",
             index_bytes, index_bytes, vertex_bytes, document->colors ? 40 : 24);
    add_text(json, ",\"buffers\":[{\"byteLength\":%zu}]}", index_bytes + vertex_bytes);
    while (json->size % 4 && !json->failed)
        add_text(json, " ");
}

static void write_glb(const Document *document, Bytes *glb)
{
    Bytes json = {0};
    write_json(document, &json);
    size_t binary = document->indices.size + document->vertices.size, total = 12 + 8 + json.size + 8 + binary;
    const uint32_t head[5] = {0x46546C67, 2, (uint32_t)total, (uint32_t)json.size, 0x4E4F534A}; /* glTF, JSON */
    const uint32_t chunk[2] = {(uint32_t)binary, 0x004E4942};                                 /* BIN */
    add_bytes(glb, head, sizeof head);
    add_bytes(glb, json.data, json.size);
    add_bytes(glb, chunk, sizeof chunk);
    add_bytes(glb, document->indices.data, document->indices.size);
    add_bytes(glb, document->vertices.data, document->vertices.size);
    glb->failed |= json.failed || document->indices.failed || document->vertices.failed || total > UINT32_MAX;
    free(json.data);
}

/* The first fault that the scene check finds. */
static void keep_message(ChiaroLogLevel level, ChiaroLogItem item, const char *message, void *user)
{
    char *text = user;
    (void)level, (void)item;
    if (!*text)
        snprintf(text, CHIARO_IO_MESSAGE_SIZE, "%s", message);
}

static bool check_input(const char *path, const ChiaroScene *scene, const ChiaroIoNode *nodes, uint32_t node_count,
                        ChiaroIoError *error)
{
    char message[CHIARO_IO_MESSAGE_SIZE] = "";
    const ChiaroLog log = {keep_message, message};
    if (chiaro_scene_check(scene, &log) != CHIARO_OK)
        return chiaro_io_fail(error, path, "cannot be written: %s", message);
    for (uint32_t i = 0; i < node_count; i++)
        if (nodes[i].first_part > scene->part_count || nodes[i].part_count > scene->part_count - nodes[i].first_part ||
            !isfinite(vec3_length(vec3_load(nodes[i].translation))))
            return chiaro_io_fail(error, path, "cannot be written: node %u is out of range", i);
    for (uint32_t i = 0; i < scene->material_count; i++)
        if (scene->materials[i].albedo_texture != CHIARO_NONE || scene->materials[i].emission_texture != CHIARO_NONE)
            return chiaro_io_fail(error, path, "cannot be written: material %u has a texture", i);
    return true;
}

bool chiaro_io_write_glb(const char *path, const ChiaroScene *scene, const ChiaroIoNode *nodes, uint32_t node_count,
                         ChiaroIoError *error)
{
    const ChiaroIoNode everything = {"scene", {0, 0, 0}, 0, scene->part_count};
    Document document = {.scene = scene};
    Bytes glb = {0};
    if (!nodes) {
        nodes = &everything;
        node_count = 1;
    }
    if (!check_input(path, scene, nodes, node_count, error))
        return false;
    size_t variants = (size_t)scene->material_count * 2;
    document.material_index = malloc((variants + 1) * sizeof *document.material_index);
    if (!document.material_index)
        return chiaro_io_fail(error, path, "out of memory");
    memset(document.material_index, 0xff, variants * sizeof *document.material_index); /* CHIARO_NONE */
    for (uint32_t i = 0; i < scene->vertex_count; i++)
        for (int c = 0; c < 4; c++)
            document.colors |= fabsf(scene->vertices[i].color[c] - 1) > 0;
    for (uint32_t i = 0; i < node_count; i++)
        write_node(&document, &nodes[i]);
    for (uint32_t i = 0; i < scene->light_count; i++)
        write_light(&document, i);
    for (uint32_t i = 0; i < scene->camera_count; i++)
        write_camera(&document, i);
    write_glb(&document, &glb);
    bool done = glb.failed ? chiaro_io_fail(error, path, "cannot be written: out of memory or beyond 4 GiB")
                           : chiaro_io_write_file(path, glb.data, glb.size, error);
    Bytes *const all[] = {&document.accessors, &document.meshes,  &document.nodes,   &document.materials,
                          &document.cameras,   &document.lights,  &document.indices, &document.vertices,
                          &document.extensions, &glb};
    for (size_t i = 0; i < sizeof all / sizeof *all; i++)
        free(all[i]->data);
    free(document.material_index);
    return done;
}
