/* glTF in and out: what a file means and what is refused. Files are made here, byte by byte. */
#include "../src/io/io.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include <cmocka.h>

#include "common/geometry.h"
#include "common/glb.h"
#include "common/made_scene.h"
#include "common/out.h"

/* ------------------------------------------------------------------------------------------------------------------
 * Writing what is no scene of ours
 */

static void every_kind_of_light_survives_writing(void **state)
{
    const float h = sqrtf(0.5f);
    const ChiaroLight lights[3] = {
        {.type = CHIARO_LIGHT_POINT, .position = {1, 2, 3}, .direction = {0, -1, 0}, .intensity = {4, 2, 1}},
        {.type = CHIARO_LIGHT_SPOT, .position = {-1, 2, 3}, .direction = {h, -h, 0}, .intensity = {9, 9, 3},
         .range = 7, .cos_inner = 0.9f, .cos_outer = 0.5f},
        {.type = CHIARO_LIGHT_SUN, .direction = {0, -h, -h}, .intensity = {3, 2, 1}}};
    ChiaroIoScene read;
    ChiaroIoError error;
    (void)state;
    TestScene made = make_scene("furnace", (SceneRequest){0});
    made.scene.lights = lights;
    made.scene.light_count = 3;
    assert_true(chiaro_io_write_glb(OUT "lights.glb", &made.scene, NULL, 0, &error));
    assert_true(chiaro_io_read_gltf(OUT "lights.glb", &read, &error));
    assert_int_equal(read.scene.light_count, 3);
    for (int i = 0; i < 3; i++) {
        const ChiaroLight *a = &lights[i], *b = &read.scene.lights[i];
        assert_int_equal(a->type, b->type);
        assert_vector(b->intensity, a->intensity[0], a->intensity[1], a->intensity[2]);
        assert_vector(b->direction, a->direction[0], a->direction[1], a->direction[2]);
        if (i < 2)
            assert_vector(b->position, a->position[0], a->position[1], a->position[2]);
        assert_true(fabsf(a->range - b->range) < 1e-6f && fabsf(a->cos_inner - b->cos_inner) < 1e-6f &&
                    fabsf(a->cos_outer - b->cos_outer) < 1e-6f);
    }
    chiaro_io_free_scene(&read);
    scenes_free(&made);
}

static void a_scene_that_is_wrong_is_not_written(void **state)
{
    ChiaroIoError error;
    (void)state;
    TestScene made = make_scene("furnace", (SceneRequest){0});
    ChiaroScene scene = made.scene;
    scene.vertex_count = 3;
    remove(OUT "wrong.glb");
    assert_false(chiaro_io_write_glb(OUT "wrong.glb", &scene, NULL, 0, &error));
    assert_non_null(strstr(error.message, "wrong.glb"));
    ChiaroIoNode node = {.name = "x", .first_part = 1, .part_count = UINT32_MAX};
    assert_false(chiaro_io_write_glb(OUT "wrong.glb", &made.scene, &node, 1, &error));
    assert_null(fopen(OUT "wrong.glb", "rb"));
    scenes_free(&made);
}

/* ------------------------------------------------------------------------------------------------------------------
 * What a file means
 */

static void a_bare_triangle_is_grey_and_flat(void **state)
{
    (void)state;
    Binary binary = triangle_binary();
    ChiaroIoScene s = must_read("bare", START VIEWS ACCESSORS MESH NODES BUFFER, &binary);
    assert_int_equal(s.scene.index_count, 3);
    assert_vector(s.scene.vertices[0].normal, 0, 0, 1);
    assert_vector(s.scene.materials[0].albedo, 0.7f, 0.7f, 0.7f);
    assert_vector(s.scene.vertices[0].color, 1, 1, 1);
    assert_int_equal(s.scene.parts[0].twin, CHIARO_NONE);
    chiaro_io_free_scene(&s);
}

static void nodes_multiply_down_the_tree(void **state)
{
    (void)state;
    Binary binary = triangle_binary();
    /* Translation, a quarter turn about y, scale; under a matrix that moves by (10, 0, 0). */
    ChiaroIoScene s = must_read("tree",
                                START VIEWS ACCESSORS MESH
                                "'nodes':[{'matrix':[1,0,0,0,0,1,0,0,0,0,1,0,10,0,0,1],'children':[1]},"
                                "{'mesh':0,'translation':[0,5,0],'rotation':[0,0.70710678,0,0.70710678],"
                                "'scale':[2,3,4]}]," BUFFER,
                                &binary);
    assert_vector(s.scene.vertices[0].position, 10, 5, 0);
    assert_vector(s.scene.vertices[1].position, 10, 5, -2);
    assert_vector(s.scene.vertices[2].position, 10, 8, 0);
    assert_vector(s.scene.vertices[0].normal, 1, 0, 0);
    chiaro_io_free_scene(&s);
}

static void mirrored_nodes_keep_their_fronts_in_front(void **state)
{
    static const float normals[9] = {0, 0, 1, 0, 0, 1, 0, 0, 1};
    (void)state;
    Binary binary = triangle_binary();
    put(&binary, normals, sizeof normals);
    ChiaroIoScene s = must_read("mirror",
                                START "'bufferViews':[{'buffer':0,'byteLength':72}],"
                                "'accessors':[{'bufferView':0,'componentType':5126,'count':3,'type':'VEC3'},"
                                "{'bufferView':0,'byteOffset':36,'componentType':5126,'count':3,'type':'VEC3'}],"
                                "'meshes':[{'primitives':[{'attributes':{'POSITION':0,'NORMAL':1}}]}],"
                                "'nodes':[{'mesh':0,'scale':[-1,1,1],'children':[1,2]},"
                                "{'mesh':0,'scale':[-1,2,1]},{'mesh':0,'scale':[1,1,-1]}]," BUFFER,
                                &binary);
    assert_int_equal(s.scene.index_count, 9);
    for (uint32_t i = 0; i < 9; i += 3) {
        /* x mirrored: still looks to +z. Twice mirrored: too. x and z: to -z. */
        float z = i < 6 ? 1 : -1;
        Vec3 normal = face_normal(&s.scene, i);
        assert_place(normal, 0, 0, z);
        assert_vector(s.scene.vertices[s.scene.indices[i]].normal, 0, 0, z);
    }
    chiaro_io_free_scene(&s);
}

static void strips_and_fans_become_triangles(void **state)
{
    static const float strip[12] = {0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 0}, fan[12] = {0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0};
    (void)state;
    Binary binary = {.size = 0};
    put(&binary, strip, sizeof strip);
    put(&binary, fan, sizeof fan);
    ChiaroIoScene s = must_read("strip",
                                START "'bufferViews':[{'buffer':0,'byteLength':96}],"
                                "'accessors':[{'bufferView':0,'componentType':5126,'count':4,'type':'VEC3'},"
                                "{'bufferView':0,'byteOffset':48,'componentType':5126,'count':4,'type':'VEC3'}],"
                                "'meshes':[{'primitives':[{'attributes':{'POSITION':0},'mode':5},"
                                "{'attributes':{'POSITION':1},'mode':6},{'attributes':{'POSITION':1},'mode':1},"
                                "{'attributes':{'POSITION':0},'mode':0}]}]," NODES BUFFER,
                                &binary);
    assert_int_equal(s.scene.part_count, 2);
    assert_int_equal(s.scene.index_count, 12);
    for (uint32_t i = 0; i < 12; i += 3) {
        Vec3 normal = face_normal(&s.scene, i);
        assert_place(normal, 0, 0, 1);
    }
    chiaro_io_free_scene(&s);
}

static void indices_and_attributes_may_have_any_type(void **state)
{
    static const uint8_t bytes[4] = {2, 1, 0}, colors[12] = {255, 0, 51, 255, 255, 255, 0, 0, 0, 0, 0, 0};
    static const uint16_t shorts[4] = {0, 1, 2};
    static const uint32_t words[3] = {0, 1, 2};
    /* Quantised positions: normalised bytes with a stride of 4, and plain shorts. */
    static const int8_t small[12] = {0, 0, 0, 0, 127, 0, 0, 0, 0, -128, 0, 0};
    static const int16_t plain[12] = {0, 0, 0, 0, 300, 0, 0, 0, 0, -300, 0, 0};
    static const int8_t normals[12] = {0, 0, -127, 0, 0, 0, -127, 0, 0, 0, -127, 0};
    (void)state;
    Binary binary = triangle_binary();
    assert_int_equal(put(&binary, bytes, 3), 36);
    assert_int_equal(put(&binary, shorts, 6), 40);
    assert_int_equal(put(&binary, words, 12), 48);
    assert_int_equal(put(&binary, colors, 12), 60);
    assert_int_equal(put(&binary, small, 12), 72);
    assert_int_equal(put(&binary, plain, 24), 84);
    assert_int_equal(put(&binary, normals, 12), 108);
    ChiaroIoScene s = must_read(
        "types",
        START "'extensionsRequired':['KHR_mesh_quantization'],"
        "'bufferViews':[{'buffer':0,'byteLength':60},{'buffer':0,'byteOffset':60,'byteLength':24,'byteStride':4},"
        "{'buffer':0,'byteOffset':84,'byteLength':24,'byteStride':8},"
        "{'buffer':0,'byteOffset':108,'byteLength':12,'byteStride':4}],"
        "'accessors':[{'bufferView':0,'componentType':5126,'count':3,'type':'VEC3'},"
        "{'bufferView':0,'byteOffset':36,'componentType':5121,'count':3,'type':'SCALAR'},"
        "{'bufferView':0,'byteOffset':40,'componentType':5123,'count':3,'type':'SCALAR'},"
        "{'bufferView':0,'byteOffset':48,'componentType':5125,'count':3,'type':'SCALAR'},"
        "{'bufferView':1,'componentType':5121,'normalized':true,'count':3,'type':'VEC3'},"
        "{'bufferView':1,'byteOffset':12,'componentType':5120,'normalized':true,'count':3,'type':'VEC3'},"
        "{'bufferView':2,'componentType':5122,'count':3,'type':'VEC3'},"
        "{'bufferView':3,'componentType':5120,'normalized':true,'count':3,'type':'VEC3'}],"
        "'meshes':[{'primitives':[{'attributes':{'POSITION':0,'COLOR_0':4},'indices':1},"
        "{'attributes':{'POSITION':5,'NORMAL':7},'indices':2},{'attributes':{'POSITION':6},'indices':3}]}]," NODES
            BUFFER,
        &binary);
    const ChiaroScene *scene = &s.scene;
    assert_int_equal(scene->index_count, 9);
    Vec3 normal = face_normal(scene, 0);
    assert_place(normal, 0, 0, -1);
    assert_vector(scene->vertices[scene->indices[2]].color, 1, 0, 0.2f);
    assert_true(fabsf(scene->vertices[scene->indices[2]].color[3] - 1) < 1e-6f);
    Vec3 right = corner(scene, 4), down = corner(scene, 5), far = corner(scene, 7);
    assert_place(right, 1, 0, 0);
    assert_place(down, 0, -1, 0);
    assert_place(far, 300, 0, 0);
    assert_vector(scene->vertices[scene->indices[3]].normal, 0, 0, -1);
    chiaro_io_free_scene(&s);
}

static void sparse_accessors_overwrite_what_is_below(void **state)
{
    static const uint16_t where[2] = {0, 2};
    static const float what[6] = {0, 0, 5, 0, 2, 5}, ones[6] = {1, 0, 0, 0, 1, 0};
    static const uint16_t last[2] = {1, 2};
    (void)state;
    Binary binary = triangle_binary();
    put(&binary, where, sizeof where);
    put(&binary, what, sizeof what);
    put(&binary, last, sizeof last);
    put(&binary, ones, sizeof ones);
    /* The second accessor has no view of its own: zeros below. */
    ChiaroIoScene s = must_read(
        "sparse",
        START "'bufferViews':[{'buffer':0,'byteLength':36},{'buffer':0,'byteOffset':36,'byteLength':4},"
        "{'buffer':0,'byteOffset':40,'byteLength':24},{'buffer':0,'byteOffset':64,'byteLength':28}],"
        "'accessors':[{'bufferView':0,'componentType':5126,'count':3,'type':'VEC3','sparse':{'count':2,"
        "'indices':{'bufferView':1,'componentType':5123},'values':{'bufferView':2}}},"
        "{'componentType':5126,'count':3,'type':'VEC3','sparse':{'count':2,"
        "'indices':{'bufferView':3,'componentType':5123},'values':{'bufferView':3,'byteOffset':4}}}],"
        "'meshes':[{'primitives':[{'attributes':{'POSITION':0}},{'attributes':{'POSITION':1}}]}]," NODES BUFFER,
        &binary);
    assert_int_equal(s.scene.index_count, 6);
    assert_vector(s.scene.vertices[0].position, 0, 0, 5);
    assert_vector(s.scene.vertices[1].position, 1, 0, 0);
    assert_vector(s.scene.vertices[2].position, 0, 2, 5);
    assert_vector(s.scene.vertices[3].position, 0, 0, 0);
    assert_vector(s.scene.vertices[4].position, 1, 0, 0);
    assert_vector(s.scene.vertices[5].position, 0, 1, 0);
    chiaro_io_free_scene(&s);
}

static void materials_mean_diffuse_light(void **state)
{
    (void)state;
    Binary binary = triangle_binary();
    ChiaroIoScene s = must_read(
        "materials",
        START VIEWS ACCESSORS "'materials':[{},"
        "{'pbrMetallicRoughness':{'baseColorFactor':[0.5,0.25,0.125,0.5],'metallicFactor':1},'alphaMode':'MASK',"
        "'alphaCutoff':0.25},"
        "{'emissiveFactor':[1,0.5,0],'extensions':{'KHR_materials_emissive_strength':{'emissiveStrength':8}},"
        "'alphaMode':'BLEND','pbrMetallicRoughness':{'baseColorFactor':[0.5,0.5,0.5,0.1]}}],"
        "'meshes':[{'primitives':[{'attributes':{'POSITION':0},'material':0},{'attributes':{'POSITION':0},"
        "'material':1},{'attributes':{'POSITION':0},'material':2},{'attributes':{'POSITION':0}}]}]," NODES BUFFER,
        &binary);
    const ChiaroMaterial *m = s.scene.materials;
    assert_int_equal(s.scene.material_count, 4);
    assert_int_equal(s.clamped_materials, 1);
    assert_vector(m[0].albedo, CHIARO_MAX_ALBEDO, CHIARO_MAX_ALBEDO, CHIARO_MAX_ALBEDO);
    assert_vector(m[1].albedo, 0.5f, 0.25f, 0.125f);
    assert_true(fabsf(m[1].alpha - 0.5f) < 1e-6f && fabsf(m[1].alpha_cutoff - 0.25f) < 1e-6f);
    assert_vector(m[2].emission, 8, 4, 0);
    assert_true(fabsf(m[2].alpha_cutoff) < 1e-6f);
    assert_vector(m[3].albedo, 0.7f, 0.7f, 0.7f);
    chiaro_io_free_scene(&s);
}

static void two_sided_surfaces_are_twins(void **state)
{
    ChiaroIoError error;
    ChiaroIoScene again;
    (void)state;
    Binary binary = triangle_binary();
    ChiaroIoScene s = must_read("twins",
                                START VIEWS ACCESSORS "'materials':[{'doubleSided':true}],"
                                "'meshes':[{'primitives':[{'attributes':{'POSITION':0},'material':0},"
                                "{'attributes':{'POSITION':0},'material':0}]}]," NODES BUFFER,
                                &binary);
    assert_int_equal(s.scene.part_count, 4);
    for (uint32_t i = 0; i < 4; i++) {
        float z = i % 2 ? -1 : 1;
        Vec3 normal = face_normal(&s.scene, s.scene.parts[i].first_index);
        assert_int_equal(s.scene.parts[i].twin, i ^ 1);
        assert_place(normal, 0, 0, z);
        assert_vector(s.scene.vertices[s.scene.indices[s.scene.parts[i].first_index]].normal, 0, 0, z);
    }
    /* Writing keeps one of the two and says that it has two sides. */
    assert_true(chiaro_io_write_glb(OUT "twins-again.glb", &s.scene, NULL, 0, &error));
    assert_true(chiaro_io_read_gltf(OUT "twins-again.glb", &again, &error));
    assert_int_equal(again.scene.part_count, 4);
    chiaro_io_free_scene(&again);
    chiaro_io_free_scene(&s);
}

static void assert_through(const ChiaroMaterial *material, uint8_t r, uint8_t g, uint8_t b)
{
    const uint8_t *t = material->transmission;
    if (t[0] != r || t[1] != g || t[2] != b || t[3] != 0)
        fail_msg("transmission %u %u %u %u instead of %u %u %u 0", t[0], t[1], t[2], t[3], r, g, b);
}

/* What a surface scatters in all is its albedo; it has two sides whatever the file says; more than came does not leave. */
static void what_lets_light_through_has_two_sides_and_shares_out_its_albedo(void **state)
{
    (void)state;
    ChiaroIoError error;
    ChiaroIoScene again;
    Binary binary = triangle_binary();
    ChiaroIoScene s = must_read(
        "transmission",
        START VIEWS ACCESSORS "'extensionsRequired':['KHR_materials_transmission','KHR_materials_diffuse_transmission'],"
        "'materials':[{'pbrMetallicRoughness':{'baseColorFactor':[0.8,0.4,0,1]},"
        "'extensions':{'KHR_materials_transmission':{'transmissionFactor':0.6}}},"
        "{'pbrMetallicRoughness':{'baseColorFactor':[0.4,0.4,0.4,1]},'extensions':{'KHR_materials_diffuse_transmission':"
        "{'diffuseTransmissionFactor':0.5,'diffuseTransmissionColorFactor':[0.6,0.8,0]}}},"
        "{'extensions':{'KHR_materials_diffuse_transmission':{'diffuseTransmissionFactor':0.5}}},"
        "{'doubleSided':true,'extensions':{'KHR_materials_diffuse_transmission':{}}}],"
        "'meshes':[{'primitives':[{'attributes':{'POSITION':0},'material':0},{'attributes':{'POSITION':0},"
        "'material':1},{'attributes':{'POSITION':0},'material':2},{'attributes':{'POSITION':0},'material':3}]}],"
        NODES BUFFER,
        &binary);
    const ChiaroMaterial *m = s.scene.materials;
    assert_int_equal(s.scene.part_count, 8);
    assert_int_equal(s.clamped_materials, 2);
    assert_vector(m[0].albedo, 0.8f, 0.4f, 0);
    assert_through(&m[0], 153, 153, 0);
    assert_vector(m[1].albedo, 0.5f, 0.6f, 0.2f);
    assert_through(&m[1], 153, 170, 0);
    assert_vector(m[2].albedo, CHIARO_MAX_ALBEDO, CHIARO_MAX_ALBEDO, CHIARO_MAX_ALBEDO);
    assert_through(&m[2], 128, 128, 128);
    assert_through(&m[3], 0, 0, 0);
    assert_int_equal(chiaro_scene_check(&s.scene, NULL), CHIARO_OK);
    assert_true(chiaro_io_write_glb(OUT "transmission-again.glb", &s.scene, NULL, 0, &error));
    assert_true(chiaro_io_read_gltf(OUT "transmission-again.glb", &again, &error));
    assert_int_equal(again.scene.part_count, 8);
    for (uint32_t i = 0; i < 3; i++) {
        assert_vector(again.scene.materials[i].albedo, m[i].albedo[0], m[i].albedo[1], m[i].albedo[2]);
        assert_through(&again.scene.materials[i], m[i].transmission[0], m[i].transmission[1], m[i].transmission[2]);
    }
    chiaro_io_free_scene(&again);
    chiaro_io_free_scene(&s);
    must_refuse("transmission-beyond",
                START VIEWS ACCESSORS "'materials':[{'extensions':{'KHR_materials_transmission':{'transmissionFactor':1.5}}}],"
                "'meshes':[{'primitives':[{'attributes':{'POSITION':0},'material':0}]}]," NODES BUFFER,
                &binary, "material 0 has a transmissionFactor out of range");
    must_refuse("transmission-damaged",
                START VIEWS ACCESSORS "'materials':[{'extensions':{'KHR_materials_diffuse_transmission':"
                "{'diffuseTransmissionFactor':1,'diffuseTransmissionColorFactor':[1,1]}}}],"
                "'meshes':[{'primitives':[{'attributes':{'POSITION':0},'material':0}]}]," NODES BUFFER,
                &binary, "KHR_materials_diffuse_transmission has a damaged diffuseTransmissionColorFactor");
}

/* A picture of 2 x 1 pixels as a file in memory, behind the triangle and its texture coordinates. */
static Binary textured_binary(uint32_t *png_offset, uint32_t *png_size)
{
    static const float uv[6] = {0, 0, 1, 0, 0, 1}, other_uv[6] = {0.5f, 0.5f, 1, 1, 0, 0};
    float pixels[8] = {1, 0, 0, 1, 0, 0, 1, 0};
    ChiaroIoError error;
    ChiaroIoFile file;
    Binary binary = triangle_binary();
    put(&binary, uv, sizeof uv);
    put(&binary, other_uv, sizeof other_uv);
    assert_true(chiaro_io_write_png(OUT "texture.png", &(ChiaroIoImage){2, 1, 4, pixels}, &error));
    assert_true(chiaro_io_map(OUT "texture.png", &file, &error));
    *png_size = (uint32_t)file.size;
    *png_offset = put(&binary, file.data, file.size);
    chiaro_io_unmap(&file);
    return binary;
}

static void textures_come_with_their_transforms(void **state)
{
    uint32_t offset, size;
    char json[4096];
    (void)state;
    Binary binary = textured_binary(&offset, &size);
    snprintf(json, sizeof json,
             START "'bufferViews':[{'buffer':0,'byteLength':84},{'buffer':0,'byteOffset':%u,'byteLength':%u}],"
             "'accessors':[{'bufferView':0,'componentType':5126,'count':3,'type':'VEC3'},"
             "{'bufferView':0,'byteOffset':36,'componentType':5126,'count':3,'type':'VEC2'},"
             "{'bufferView':0,'byteOffset':60,'componentType':5126,'count':3,'type':'VEC2'}],"
             "'images':[{'bufferView':1,'mimeType':'image/png'},{'uri':'missing.png'}],"
             "'samplers':[{'wrapS':33071,'wrapT':33648,'magFilter':9728}],"
             "'textures':[{'source':0,'sampler':0},{'source':0},{'source':1}],"
             "'materials':[{'pbrMetallicRoughness':{'baseColorTexture':{'index':0,'extensions':{"
             "'KHR_texture_transform':{'offset':[0,1],'rotation':1.57079632679,'scale':[0.5,0.5]}}}},"
             "'emissiveFactor':[1,1,1],'emissiveTexture':{'index':1,'texCoord':0,'extensions':{"
             "'KHR_texture_transform':{'texCoord':1}}},'normalTexture':{'index':2}}],"
             "'meshes':[{'primitives':[{'attributes':{'POSITION':0,'TEXCOORD_0':1,'TEXCOORD_1':2},"
             "'material':0}]}]," NODES "'buffers':[{'byteLength':%%u}]}",
             offset, size);
    ChiaroIoScene s = must_read("textures", json, &binary);
    const ChiaroScene *scene = &s.scene;
    static const uint8_t expected[8] = {255, 0, 0, 255, 0, 0, 255, 0};
    assert_int_equal(scene->texture_count, 2);
    assert_int_equal(scene->pixel_bytes, 8); /* One image, used twice. */
    assert_memory_equal(scene->pixels, expected, 8);
    assert_int_equal(scene->textures[0].wrap_u, CHIARO_WRAP_CLAMP);
    assert_int_equal(scene->textures[0].wrap_v, CHIARO_WRAP_MIRROR);
    assert_int_equal(scene->textures[0].nearest, 1);
    assert_int_equal(scene->textures[1].wrap_u, CHIARO_WRAP_REPEAT);
    assert_int_equal(scene->textures[1].nearest, 0);
    /* The extension's own example: the lower left quarter of the image. */
    static const float uv[6] = {0, 1, 0, 0.5f, 0.5f, 1};
    static const float emission_uv[6] = {0.5f, 0.5f, 1, 1, 0, 0};
    for (uint32_t i = 0; i < 3; i++)
        for (uint32_t c = 0; c < 2; c++) {
            assert_true(fabsf(scene->vertices[i].uv[c] - uv[i * 2 + c]) < 1e-5f);
            assert_true(fabsf(scene->vertices[i].emission_uv[c] - emission_uv[i * 2 + c]) < 1e-6f);
        }
    chiaro_io_free_scene(&s);
}

static void lights_follow_their_nodes(void **state)
{
    (void)state;
    Binary binary = triangle_binary();
    ChiaroIoScene s = must_read(
        "lit",
        "{'asset':{'version':'2.0'},'scenes':[{'nodes':[0,1]}]," VIEWS ACCESSORS MESH
        "'extensions':{'KHR_lights_punctual':{'lights':[{'type':'point','intensity':6,'color':[1,0.5,0]},"
        "{'type':'spot','range':12,'spot':{'innerConeAngle':0.5,'outerConeAngle':1}},"
        "{'type':'directional','intensity':2}]}},"
        "'nodes':[{'mesh':0},{'translation':[1,2,3],'scale':[2,2,2],'rotation':[-0.70710678,0,0,0.70710678],"
        "'extensions':{'KHR_lights_punctual':{'light':0}},'children':[2,3]},"
        "{'translation':[0,1,0],'extensions':{'KHR_lights_punctual':{'light':1}}},"
        "{'extensions':{'KHR_lights_punctual':{'light':2}}}]," BUFFER,
        &binary);
    const ChiaroLight *light = s.scene.lights;
    assert_int_equal(s.scene.light_count, 3);
    assert_int_equal(light[0].type, CHIARO_LIGHT_POINT);
    assert_vector(light[0].position, 1, 2, 3);
    assert_vector(light[0].intensity, 6, 3, 0);
    assert_int_equal(light[1].type, CHIARO_LIGHT_SPOT);
    assert_vector(light[1].position, 1, 2, 1); /* A quarter turn about -x takes +y to -z; the scale doubles it. */
    assert_vector(light[1].direction, 0, -1, 0);
    assert_true(fabsf(light[1].range - 12) < 1e-6f && fabsf(light[1].cos_inner - cosf(0.5f)) < 1e-6f &&
                fabsf(light[1].cos_outer - cosf(1)) < 1e-6f);
    assert_int_equal(light[2].type, CHIARO_LIGHT_SUN);
    assert_vector(light[2].direction, 0, -1, 0);
    assert_vector(light[2].intensity, 2, 2, 2);
    chiaro_io_free_scene(&s);
}

static void cameras_follow_their_nodes_and_keep_their_names(void **state)
{
    (void)state;
    Binary binary = triangle_binary();
    ChiaroIoScene s = must_read(
        "cameras",
        "{'asset':{'version':'2.0'}," VIEWS ACCESSORS MESH
        "'cameras':[{'type':'perspective','perspective':{'yfov':0.8,'znear':0.1,'zfar':50}},"
        "{'type':'orthographic','orthographic':{'xmag':1,'ymag':1,'zfar':9,'znear':1}},"
        "{'type':'perspective','name':'0123456789012345678901234567890\xC3\xA9z',"
        "'perspective':{'yfov':1,'znear':1}},{'type':'perspective','perspective':{'yfov':1,'znear':1}}],"
        "'nodes':[{'mesh':0},{'name':'eye','camera':0,'translation':[0,0,5],'scale':[1,1,3]},{'camera':1},"
        "{'camera':2,'rotation':[0,1,0,0]},{'camera':3}]," BUFFER,
        &binary);
    const ChiaroCamera *camera = s.scene.cameras;
    assert_int_equal(s.scene.camera_count, 3);
    assert_string_equal(camera[0].name, "eye");
    assert_vector(camera[0].eye, 0, 0, 5);
    assert_vector(camera[0].forward, 0, 0, -1);
    assert_vector(camera[0].up, 0, 1, 0);
    assert_true(fabsf(camera[0].yfov - 0.8f) < 1e-6f && fabsf(camera[0].zfar - 50) < 1e-6f);
    assert_string_equal(camera[1].name, "0123456789012345678901234567890");
    assert_vector(camera[1].forward, 0, 0, 1);
    assert_string_equal(camera[2].name, "");
    chiaro_io_free_scene(&s);
}

static void triangles_without_area_are_counted_and_left_out(void **state)
{
    static const float points[18] = {0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 0, 1, 1, 1, 2, 2, 2};
    (void)state;
    Binary binary = {.size = 0};
    put(&binary, points, sizeof points);
    ChiaroIoScene s = must_read("flat",
                                START "'bufferViews':[{'buffer':0,'byteLength':72}],"
                                "'accessors':[{'bufferView':0,'componentType':5126,'count':6,'type':'VEC3'}]," MESH
                                NODES BUFFER,
                                &binary);
    assert_int_equal(s.scene.index_count, 3);
    assert_int_equal(s.degenerate_triangles, 1);
    chiaro_io_free_scene(&s);
}

static void the_default_scene_alone_counts(void **state)
{
    (void)state;
    Binary binary = triangle_binary();
    ChiaroIoScene s = must_read("scenes",
                                "{'asset':{'version':'2.0'},'scene':1,'scenes':[{'nodes':[0]},{'nodes':[1]}]," VIEWS
                                ACCESSORS MESH "'nodes':[{'mesh':0},{'mesh':0,'translation':[0,0,7]}]," BUFFER,
                                &binary);
    assert_int_equal(s.scene.index_count, 3);
    assert_vector(s.scene.vertices[0].position, 0, 0, 7);
    chiaro_io_free_scene(&s);
}

/* ------------------------------------------------------------------------------------------------------------------
 * What is refused
 */

static void faults_are_named_in_one_line(void **state)
{
    static const struct {
        const char *name, *json, *expected;
    } faults[] = {
        {"no-accessor", START VIEWS ACCESSORS "'meshes':[{'primitives':[{'attributes':{'POSITION':7}}]}]," NODES BUFFER,
         "accessor 7"},
        {"no-view",
         START VIEWS "'accessors':[{'bufferView':3,'componentType':5126,'count':3,'type':'VEC3'}]," MESH NODES BUFFER,
         "buffer view 3"},
        {"no-buffer", START "'bufferViews':[{'buffer':2,'byteLength':36}]," ACCESSORS MESH NODES BUFFER, "buffer 2"},
        {"long-view", START "'bufferViews':[{'buffer':0,'byteLength':99}]," ACCESSORS MESH NODES BUFFER,
         "buffer view 0 reaches past"},
        {"far-view", START "'bufferViews':[{'buffer':0,'byteOffset':4294967290,'byteLength':36}]," ACCESSORS MESH NODES
         BUFFER, "buffer view 0 reaches past"},
        {"long-accessor",
         START VIEWS "'accessors':[{'bufferView':0,'componentType':5126,'count':4,'type':'VEC3'}]," MESH NODES BUFFER,
         "accessor 0 reaches past"},
        {"huge-accessor",
         START VIEWS "'accessors':[{'bufferView':0,'componentType':5126,'count':99999999999,'type':'VEC3'}]," MESH NODES
         BUFFER, "accessor 0 has too many"},
        {"odd-type",
         START VIEWS "'accessors':[{'bufferView':0,'componentType':5124,'count':3,'type':'VEC3'}]," MESH NODES BUFFER,
         "component type 5124"},
        {"flat-position",
         START VIEWS "'accessors':[{'bufferView':0,'componentType':5126,'count':3,'type':'VEC2'}]," MESH NODES BUFFER,
         "POSITION of 2 components"},
        {"no-mesh", START VIEWS ACCESSORS MESH "'nodes':[{'mesh':1}]," BUFFER, "mesh 1"},
        {"no-node", "{'asset':{'version':'2.0'},'scenes':[{'nodes':[5]}]," VIEWS ACCESSORS MESH NODES BUFFER, "node 5"},
        {"no-child", START VIEWS ACCESSORS MESH "'nodes':[{'mesh':0,'children':[4]}]," BUFFER, "node 4"},
        {"no-scene", "{'asset':{'version':'2.0'},'scene':3,'scenes':[{'nodes':[0]}]," VIEWS ACCESSORS MESH NODES BUFFER,
         "scene 3"},
        {"no-camera", START VIEWS ACCESSORS MESH "'nodes':[{'mesh':0,'camera':1}]," BUFFER, "camera 1"},
        {"no-light", START VIEWS ACCESSORS MESH
         "'nodes':[{'mesh':0,'extensions':{'KHR_lights_punctual':{'light':1}}}]," BUFFER, "light 1"},
        {"no-material", START VIEWS ACCESSORS
         "'meshes':[{'primitives':[{'attributes':{'POSITION':0},'material':2}]}]," NODES BUFFER, "material 2"},
        {"no-texture", START VIEWS ACCESSORS
         "'materials':[{'pbrMetallicRoughness':{'baseColorTexture':{'index':9}}}],"
         "'meshes':[{'primitives':[{'attributes':{'POSITION':0},'material':0}]}]," NODES BUFFER, "texture 9"},
        {"no-image", START VIEWS ACCESSORS "'textures':[{'source':4}],"
         "'materials':[{'pbrMetallicRoughness':{'baseColorTexture':{'index':0}}}],"
         "'meshes':[{'primitives':[{'attributes':{'POSITION':0},'material':0}]}]," NODES BUFFER, "image 4"},
        {"lost-image", START VIEWS ACCESSORS "'images':[{'uri':'nowhere.png'}],'textures':[{'source':0}],"
         "'materials':[{'pbrMetallicRoughness':{'baseColorTexture':{'index':0}}}],"
         "'meshes':[{'primitives':[{'attributes':{'POSITION':0},'material':0}]}]," NODES BUFFER, "nowhere.png"},
        {"bad-image", START "'bufferViews':[{'buffer':0,'byteLength':36},{'buffer':0,'byteOffset':30,'byteLength':99}],"
         ACCESSORS "'images':[{'bufferView':1,'mimeType':'image/png'}],'textures':[{'source':0}],"
         "'materials':[{'pbrMetallicRoughness':{'baseColorTexture':{'index':0}}}],"
         "'meshes':[{'primitives':[{'attributes':{'POSITION':0},'material':0}]}]," NODES BUFFER, "buffer view 1"},
        {"empty", START VIEWS ACCESSORS MESH "'nodes':[{}]," BUFFER, "no triangles"},
        {"points", START VIEWS ACCESSORS "'meshes':[{'primitives':[{'attributes':{'POSITION':0},'mode':0}]}]," NODES
         BUFFER, "no triangles"},
        {"nothing", START VIEWS ACCESSORS MESH "'nodes':[{'mesh':0,'scale':[0,0,0]}]," BUFFER, "without area"},
        {"cycle", START VIEWS ACCESSORS MESH "'nodes':[{'mesh':0,'children':[1]},{'children':[0]}]," BUFFER,
         "own ancestor"},
        {"all-children", "{'asset':{'version':'2.0'}," VIEWS ACCESSORS MESH
         "'nodes':[{'mesh':0,'children':[1]},{'children':[0]}]," BUFFER, "child of another"},
        {"infinite", START VIEWS ACCESSORS MESH "'nodes':[{'mesh':0,'scale':[1e308,1,1],'children':[1]},"
         "{'mesh':0,'scale':[1e308,1,1]}]," BUFFER, ""},
        {"no-rotation", START VIEWS ACCESSORS MESH "'nodes':[{'mesh':0,'rotation':[0,0,0,0]}]," BUFFER,
         "transform that is not finite"},
        {"short-matrix", START VIEWS ACCESSORS MESH "'nodes':[{'mesh':0,'matrix':[1,2,3]}]," BUFFER, "matrix"},
        {"unknown-extension", "{'asset':{'version':'2.0'},'extensionsRequired':['EXT_of_tomorrow']," VIEWS ACCESSORS
         MESH NODES BUFFER, "EXT_of_tomorrow"},
        {"old", "{'asset':{'version':'1.0'}," VIEWS ACCESSORS MESH NODES BUFFER, "version '1.0'"},
        {"dark-light", START VIEWS ACCESSORS MESH "'extensions':{'KHR_lights_punctual':{'lights':[{'type':'point',"
         "'intensity':-1}]}},'nodes':[{'mesh':0,'extensions':{'KHR_lights_punctual':{'light':0}}}]," BUFFER,
         "intensity"},
        {"blind-camera", START VIEWS ACCESSORS MESH "'cameras':[{'type':'perspective','perspective':{'yfov':0,"
         "'znear':1}}],'nodes':[{'mesh':0,'camera':0}]," BUFFER, "camera 0"},
        {"no-json", "{'asset':{'version':'2.0'}, %u", ""},
    };
    (void)state;
    Binary binary = triangle_binary();
    for (size_t i = 0; i < sizeof faults / sizeof *faults; i++)
        must_refuse(faults[i].name, faults[i].json, &binary, faults[i].expected);
}

static void numbers_in_the_binary_are_checked_too(void **state)
{
    static const uint16_t beyond[4] = {0, 1, 3};
    static const char indexed[] = START "'bufferViews':[{'buffer':0,'byteLength':44}],"
        "'accessors':[{'bufferView':0,'componentType':5126,'count':3,'type':'VEC3'},"
        "{'bufferView':0,'byteOffset':36,'componentType':5123,'count':3,'type':'SCALAR'}],"
        "'meshes':[{'primitives':[{'attributes':{'POSITION':0},'indices':1}]}]," NODES BUFFER;
    (void)state;
    Binary binary = triangle_binary();
    put(&binary, beyond, sizeof beyond);
    must_refuse("beyond", indexed, &binary, "vertex index 3");
    const float wrong[2] = {NAN, INFINITY};
    for (int i = 0; i < 2; i++) {
        Binary damaged = triangle_binary();
        memcpy(damaged.bytes + 16, &wrong[i], sizeof wrong[i]);
        must_refuse("not-a-number", START VIEWS ACCESSORS MESH NODES BUFFER, &damaged, "POSITION that is not finite");
    }
}

static void files_cut_short_are_refused_at_every_length(void **state)
{
    ChiaroIoFile file;
    ChiaroIoError error;
    ChiaroIoScene scene;
    (void)state;
    TestScene made = make_scene("furnace", (SceneRequest){0});
    assert_true(chiaro_io_write_glb(OUT "whole.glb", &made.scene, made.nodes, made.node_count, &error));
    scenes_free(&made);
    assert_true(chiaro_io_map(OUT "whole.glb", &file, &error));
    for (size_t size = 1; size < file.size; size += 7) {
        assert_true(chiaro_io_write_file(OUT "cut.glb", file.data, size, &error));
        assert_false(chiaro_io_read_gltf(OUT "cut.glb", &scene, &error));
        assert_non_null(strstr(error.message, "cut.glb"));
    }
    chiaro_io_unmap(&file);
    assert_false(chiaro_io_read_gltf(OUT "no-such-file.glb", &scene, &error));
    assert_non_null(strstr(error.message, "no-such-file.glb"));
    assert_false(chiaro_io_read_gltf(OUT, &scene, &error));
}

static void json_nested_without_end_is_refused(void **state)
{
    ChiaroIoScene scene;
    ChiaroIoError error;
    size_t size = 200000;
    (void)state;
    char *text = malloc(size);
    assert_non_null(text);
    memset(text, '[', size);
    memcpy(text, "{\"extras\":", 10);
    assert_true(chiaro_io_write_file(OUT "deep.gltf", text, size, &error));
    assert_false(chiaro_io_read_gltf(OUT "deep.gltf", &scene, &error));
    assert_non_null(strstr(error.message, "nested"));
    free(text);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_kind_of_light_survives_writing),
        cmocka_unit_test(a_scene_that_is_wrong_is_not_written),
        cmocka_unit_test(a_bare_triangle_is_grey_and_flat),
        cmocka_unit_test(nodes_multiply_down_the_tree),
        cmocka_unit_test(mirrored_nodes_keep_their_fronts_in_front),
        cmocka_unit_test(strips_and_fans_become_triangles),
        cmocka_unit_test(indices_and_attributes_may_have_any_type),
        cmocka_unit_test(sparse_accessors_overwrite_what_is_below),
        cmocka_unit_test(materials_mean_diffuse_light),
        cmocka_unit_test(two_sided_surfaces_are_twins),
        cmocka_unit_test(what_lets_light_through_has_two_sides_and_shares_out_its_albedo),
        cmocka_unit_test(textures_come_with_their_transforms),
        cmocka_unit_test(lights_follow_their_nodes),
        cmocka_unit_test(cameras_follow_their_nodes_and_keep_their_names),
        cmocka_unit_test(triangles_without_area_are_counted_and_left_out),
        cmocka_unit_test(the_default_scene_alone_counts),
        cmocka_unit_test(faults_are_named_in_one_line),
        cmocka_unit_test(numbers_in_the_binary_are_checked_too),
        cmocka_unit_test(files_cut_short_are_refused_at_every_length),
        cmocka_unit_test(json_nested_without_end_is_refused),
    };
    return cmocka_run_group_tests(tests, make_folder, NULL);
}
