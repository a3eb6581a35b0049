/* glTF in: a file becomes flat arrays, in world space what stays, in a space of its own each object. This, the shim
 * around tinygltf (gltf_access.cpp) and the reader of animations (gltf_animation.cpp) are the only C++ of the project, so
 * that nothing else has to be.
 *
 * What a file means for diffuse light: metal is a rough reflector of its base colour, alpha MASK cuts holes, alpha
 * BLEND counts as opaque (light through glass is not diffuse), skins and morphs rest in bind pose. */
#include "gltf_animation.h"
#include "gltf_transform.h"
#include "io_error.h"

#include <algorithm>
#include <cfloat>
#include <cmath>
#include <cstring>
#include <memory>
#include <new>

namespace {

using namespace chiaro_gltf;

const size_t max_indices = size_t{3} << 27; /* Of the scene. */
const double max_coordinate = 1e9;          /* As chiaro_scene_check() has it. */
const float no_material_albedo = 0.7f;
const char texture_transform[] = "KHR_texture_transform";

/* ------------------------------------------------------------------------------------------------------------------
 * The importer
 */

struct Mesh {
    std::vector<ChiaroVertex> vertices;
    std::vector<uint32_t> indices;
    std::vector<ChiaroPart> parts;
};

/* What ChiaroIoScene::memory points to. */
struct Storage {
    Mesh still;
    std::vector<Mesh> moving; /* One for each of `objects`. */
    std::vector<ChiaroIoObject> objects;
    std::vector<ChiaroIoJoint> joints;
    std::vector<ChiaroIoChannel> channels;
    FloatArrays arrays;
    std::vector<ChiaroMaterial> materials;
    std::vector<ChiaroTexture> textures;
    std::vector<uint8_t> pixels;
    std::vector<ChiaroLight> lights;
    std::vector<ChiaroCamera> cameras;
};

/* Where a texture's coordinates come from: u' = a u + b v + c and so on. */
struct Mapping {
    int set = 0;
    double a = 1, b = 0, c = 0, d = 0, e = 1, f = 0;
};

/* A material and what the vertices of its primitives must carry for it. */
struct Surface {
    uint32_t index = CHIARO_NONE;
    bool two_sided = false;
    Mapping albedo, emission;
};

/* A primitive's attributes, as the file has them. */
struct Attributes {
    Elements<float> position, normal, color, albedo_uv, emission_uv;
    std::vector<uint32_t> corners; /* In threes. */
};

class Importer {
public:
    Importer(const tinygltf::Model &source, const std::vector<std::string> &dynamic, Storage &target)
        : model(source), out(target), names(dynamic), name_used(dynamic.size())
    {
        surfaces.resize(model.materials.size());
        texture_index.resize(model.textures.size(), CHIARO_NONE);
        image_pixels.resize(model.images.size(), {0, 0, 0});
    }

    /* Returns where the origin of all that it makes lies in the file's world. */
    Vector run()
    {
        Bounds bounds;
        walk(Transform(), [&](const tinygltf::Node &node, const Transform &, Visit *visit) {
            if (node.mesh != -1)
                bound_mesh(node, visit->world, &bounds);
        });
        const Vector at = bounds.near_origin();
        channels_of = read_animations(model, &out.arrays);
        walk(Transform{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}, at * -1},
             [&](const tinygltf::Node &node, const Transform &before, Visit *visit) {
                 begin_object(node, before, visit);
                 take_node(node, *visit);
             });
        for (size_t i = 0; i < names.size(); i++)
            if (!name_used[i])
                fail("has no node named '%s'", names[i].c_str());
        drop_empty_objects();
        if (out.still.indices.empty())
            fail(degenerate              ? "all its triangles are without area"
                 : out.objects.empty() ? "holds no triangles"
                                       : "holds nothing that stays in its place");
        return at;
    }

    uint32_t clamped = 0, degenerate = 0;

private:
    struct Pixels {
        uint32_t width, height;
        uint64_t first_byte;
    };

    /* A node on the way down: transforms are those of its parent at first, then its own. */
    struct Visit {
        int node = -1;
        Transform world, below_joint, joint_world; /* At rest; since the nearest joint; of that joint. */
        uint32_t joint = CHIARO_NONE, object = CHIARO_NONE;
        Transform into; /* From the world at rest to the object's space. */
        bool flat = false; /* There is no way back from the joint. */
    };

    /* All nodes of the scene, parents first: take(node, its transform since the nearest joint above, visit). */
    template <typename Take> void walk(const Transform &root_transform, Take take) const
    {
        std::vector<bool> seen(model.nodes.size());
        std::vector<Visit> stack;
        for (int root : roots()) {
            stack.emplace_back();
            stack.back().node = root;
            stack.back().world = stack.back().below_joint = root_transform;
        }
        std::reverse(stack.begin(), stack.end());
        while (!stack.empty()) {
            Visit visit = stack.back();
            stack.pop_back();
            const tinygltf::Node &node = element(model.nodes, visit.node, "node");
            if (seen[size_t(visit.node)])
                fail("node %d has two parents or is its own ancestor", visit.node);
            seen[size_t(visit.node)] = true;
            Transform local = local_transform(node, visit.node), before = visit.below_joint;
            visit.world = visit.world * local;
            visit.below_joint = before * local;
            if (!finite(visit.world.x) || !finite(visit.world.y) || !finite(visit.world.z) ||
                !finite(visit.world.origin))
                fail("node %d has a transform that is not finite", visit.node);
            take(node, before, &visit);
            for (size_t i = node.children.size(); i > 0; i--) {
                stack.push_back(visit);
                stack.back().node = node.children[i - 1];
            }
        }
    }

    /* By what the file says of its positions: it may be wrong, then the scene lies where it lies. */
    void bound_mesh(const tinygltf::Node &node, const Transform &world, Bounds *bounds) const
    {
        for (const tinygltf::Primitive &primitive : element(model.meshes, node.mesh, "mesh").primitives) {
            auto position = primitive.attributes.find("POSITION");
            if (position == primitive.attributes.end())
                continue;
            const tinygltf::Accessor &accessor = element(model.accessors, position->second, "accessor");
            const std::vector<double> &low = accessor.minValues, &high = accessor.maxValues;
            for (int corner = 0; corner < 8 && low.size() == 3 && high.size() == 3; corner++)
                bounds->grow(world.point({(corner & 1 ? high : low)[0], (corner & 2 ? high : low)[1],
                                          (corner & 4 ? high : low)[2]}));
        }
    }

    const tinygltf::Model &model;
    Storage &out;
    const std::vector<std::string> &names; /* Of nodes that are objects although nothing moves them. */
    std::vector<bool> name_used;
    std::vector<std::vector<ChiaroIoChannel>> channels_of; /* By node. */
    Mesh *mesh_out = nullptr; /* Where triangles go now. */
    std::vector<Surface> surfaces;       /* By glTF material; index CHIARO_NONE: not met yet. */
    std::vector<uint32_t> texture_index; /* By glTF texture. */
    std::vector<Pixels> image_pixels;    /* By glTF image; width 0: not decoded yet. */
    Surface plain;                       /* For primitives without material. */

    /* The default scene, or the first; without scenes every node that is nobody's child. */
    std::vector<int> roots() const
    {
        if (!model.scenes.empty() || model.defaultScene >= 0)
            return element(model.scenes, model.defaultScene >= 0 ? model.defaultScene : 0, "scene").nodes;
        std::vector<bool> child(model.nodes.size());
        for (const tinygltf::Node &node : model.nodes)
            for (int c : node.children) {
                element(model.nodes, c, "node");
                child[size_t(c)] = true;
            }
        std::vector<int> list;
        for (size_t i = 0; i < child.size(); i++)
            if (!child[i])
                list.push_back(int(i));
        if (list.empty() && !model.nodes.empty())
            fail("every node is the child of another");
        return list;
    }

    /* ---- objects ---- */

    bool is_named(const tinygltf::Node &node)
    {
        bool named = false;
        for (size_t i = 0; i < names.size(); i++) {
            const std::string &name = names[i];
            bool star = !name.empty() && name.back() == '*';
            bool match = name == "all"  ? node.mesh != -1
                         : star         ? node.name.compare(0, name.size() - 1, name, 0, name.size() - 1) == 0
                                        : node.name == name;
            if (match)
                named = name_used[i] = true;
        }
        return named;
    }

    /* A node that moves by itself is a joint, and begins an object; so does one that is named. */
    void begin_object(const tinygltf::Node &node, const Transform &before, Visit *visit)
    {
        const std::vector<ChiaroIoChannel> &channels = channels_of[size_t(visit->node)];
        if (!channels.empty()) {
            Local rest = local_parts(node, visit->node);
            ChiaroIoJoint joint = {visit->joint, uint32_t(out.channels.size()), uint32_t(channels.size()),
                                   to_plain(before), {}, {}, {}};
            std::copy(rest.translation, rest.translation + 3, joint.translation);
            std::copy(rest.rotation, rest.rotation + 4, joint.rotation);
            std::copy(rest.scale, rest.scale + 3, joint.scale);
            visit->joint = uint32_t(out.joints.size());
            visit->below_joint = Transform();
            visit->joint_world = visit->world;
            visit->flat = !(std::fabs(visit->world.determinant()) > DBL_MIN);
            for (ChiaroIoChannel channel : channels) {
                channel.joint = visit->joint;
                out.channels.push_back(channel);
            }
            out.joints.push_back(joint);
        }
        bool named = is_named(node);
        if (!named && channels.empty())
            return;
        /* The object's space keeps the axes and the size that it has at rest, so that most transforms are rigid. */
        Transform place{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}, visit->world.origin};
        ChiaroIoObject object = {};
        copy_name(object.name, node.name.empty() ? "node " + std::to_string(visit->node) : node.name);
        object.joint = visit->joint;
        bool rides = visit->joint != CHIARO_NONE && !visit->flat;
        object.after = to_plain(rides ? visit->joint_world.inverse() * place : place);
        visit->into = place.inverse();
        visit->object = uint32_t(out.objects.size());
        out.objects.push_back(object);
        out.moving.emplace_back();
    }

    void drop_empty_objects()
    {
        size_t kept = 0;
        for (size_t i = 0; i < out.objects.size(); i++) {
            if (out.moving[i].indices.empty())
                continue;
            std::swap(out.moving[kept], out.moving[i]);
            out.objects[kept++] = out.objects[i];
        }
        out.objects.resize(kept);
        out.moving.resize(kept);
    }

    void take_node(const tinygltf::Node &node, const Visit &visit)
    {
        int index = visit.node;
        const Transform &world = visit.world;
        if (node.mesh != -1) {
            bool moves = visit.object != CHIARO_NONE;
            if (moves && visit.flat)
                fail("node %d moves, and has no volume at rest", index);
            const tinygltf::Mesh &mesh = element(model.meshes, node.mesh, "mesh");
            mesh_out = moves ? &out.moving[visit.object] : &out.still;
            for (const tinygltf::Primitive &primitive : mesh.primitives)
                take_primitive(primitive, node.mesh, moves ? visit.into * world : world);
        }
        if (node.camera != -1)
            take_camera(node, index, world);
        auto extension = node.extensions.find("KHR_lights_punctual");
        if (extension != node.extensions.end() && extension->second.Has("light"))
            take_light(extension->second.Get("light"), index, world);
    }

    /* ---- lights and cameras ---- */

    void take_light(const tinygltf::Value &value, int node, const Transform &world)
    {
        double number = value.IsNumber() ? value.GetNumberAsDouble() : -1;
        const tinygltf::Light &source =
            element(model.lights, number >= 0 && number <= INT32_MAX ? int(number) : -1, "light");
        ChiaroLight light = {};
        double color[3] = {1, 1, 1};
        if (source.type == "point")
            light.type = CHIARO_LIGHT_POINT;
        else if (source.type == "spot")
            light.type = CHIARO_LIGHT_SPOT;
        else if (source.type == "directional")
            light.type = CHIARO_LIGHT_SUN;
        else
            fail("the light of node %d has the unknown type '%s'", node, source.type.c_str());
        if (!source.color.empty() && source.color.size() != 3)
            fail("the light of node %d has a colour of %zu numbers", node, source.color.size());
        std::copy(source.color.begin(), source.color.end(), color);
        for (int c = 0; c < 3; c++) {
            double intensity = color[c] * source.intensity;
            if (!(color[c] >= 0 && source.intensity >= 0 && intensity <= double(FLT_MAX)))
                fail("the light of node %d has an intensity out of range", node);
            light.intensity[c] = float(intensity);
        }
        store_point(light.position, world.origin, "light", node);
        light.direction[1] = -1;
        if (light.type != CHIARO_LIGHT_POINT && !store_unit(light.direction, world.z * -1))
            fail("the light of node %d has no direction", node);
        if (light.type != CHIARO_LIGHT_SUN) {
            if (!(source.range >= 0 && source.range <= double(FLT_MAX)))
                fail("the light of node %d has a range out of range", node);
            light.range = float(source.range);
        }
        if (light.type == CHIARO_LIGHT_SPOT) {
            double inner = source.spot.innerConeAngle, outer = source.spot.outerConeAngle;
            if (!(inner >= 0 && inner <= outer && outer <= 1.5708))
                fail("the light of node %d has a cone out of range", node);
            light.cos_inner = float(std::cos(inner));
            light.cos_outer = std::max(float(std::cos(outer)), 0.0f);
        }
        out.lights.push_back(light);
    }

    void take_camera(const tinygltf::Node &node, int index, const Transform &world)
    {
        const tinygltf::Camera &source = element(model.cameras, node.camera, "camera");
        ChiaroCamera camera = {};
        if (source.type != "perspective") /* Parallel views are not drawn. */
            return;
        const tinygltf::PerspectiveCamera &lens = source.perspective;
        if (!(lens.yfov > 0 && lens.yfov < 3.1415 && lens.znear > 0 && lens.znear <= double(FLT_MAX)) ||
            !(lens.zfar == 0 || (lens.zfar > lens.znear && lens.zfar <= double(FLT_MAX))))
            fail("camera %d has an opening, znear or zfar out of range", node.camera);
        store_point(camera.eye, world.origin, "camera", index);
        Vector back = world.z, up = world.y;
        bool turned = store_unit(camera.forward, back * -1);
        if (turned) /* A scaled or sheared node may have tilted it. */
            turned = store_unit(camera.up, up - back * (dot(up, back) / dot(back, back)));
        if (!turned)
            fail("the camera of node %d has no direction", index);
        camera.yfov = float(lens.yfov);
        camera.znear = std::max(float(lens.znear), FLT_MIN);
        camera.zfar = float(lens.zfar);
        copy_name(camera.name, source.name.empty() ? node.name : source.name);
        out.cameras.push_back(camera);
    }

    /* As much as fits, without half a UTF-8 character at the end. */
    static void copy_name(char *to, const std::string &name)
    {
        size_t size = std::min(name.size(), size_t{CHIARO_NAME_SIZE - 1});
        if (size < name.size())
            while (size > 0 && (static_cast<unsigned char>(name[size]) & 0xC0) == 0x80)
                size--;
        memcpy(to, name.c_str(), size);
        to[size] = 0;
    }

    static void store_point(float *to, Vector p, const char *what, int node)
    {
        if (!(std::fabs(p.x) <= max_coordinate && std::fabs(p.y) <= max_coordinate && std::fabs(p.z) <= max_coordinate))
            fail("the %s of node %d has a position out of range", what, node);
        to[0] = float(p.x);
        to[1] = float(p.y);
        to[2] = float(p.z);
    }

    /* ---- materials ---- */

    const Surface &take_material(int index)
    {
        if (index == -1) {
            if (plain.index == CHIARO_NONE) {
                ChiaroMaterial material = empty_material();
                std::fill(material.albedo, material.albedo + 3, no_material_albedo);
                plain.index = add_material(material);
            }
            return plain;
        }
        const tinygltf::Material &source = element(model.materials, index, "material");
        Surface &surface = surfaces[size_t(index)];
        if (surface.index != CHIARO_NONE)
            return surface;
        ChiaroMaterial material = empty_material();
        bool over = take_albedo(source, index, &material, &surface);
        bool through = take_transmission(source, index, &material, &over);
        clamped += over;
        take_emission(source, index, &material, &surface);
        if (source.alphaMode == "MASK") {
            if (!(source.alphaCutoff >= 0 && source.alphaCutoff <= double(FLT_MAX)))
                fail("material %d has an alpha cutoff out of range", index);
            material.alpha_cutoff = float(source.alphaCutoff);
        }
        surface.two_sided = source.doubleSided || through;
        surface.index = add_material(material);
        return surface;
    }

    static ChiaroMaterial empty_material()
    {
        ChiaroMaterial material = {};
        material.alpha = 1;
        material.albedo_texture = material.emission_texture = CHIARO_NONE;
        return material;
    }

    uint32_t add_material(const ChiaroMaterial &material)
    {
        out.materials.push_back(material);
        return uint32_t(out.materials.size() - 1);
    }

    /* True if the albedo was clamped. */
    bool take_albedo(const tinygltf::Material &source, int index, ChiaroMaterial *material, Surface *surface)
    {
        const tinygltf::PbrMetallicRoughness &pbr = source.pbrMetallicRoughness;
        bool over = false;
        if (pbr.baseColorFactor.size() != 4)
            fail("material %d has a base colour of %zu numbers", index, pbr.baseColorFactor.size());
        for (size_t c = 0; c < 4; c++)
            if (!(pbr.baseColorFactor[c] >= 0 && pbr.baseColorFactor[c] <= double(FLT_MAX)))
                fail("material %d has a base colour out of range", index);
        for (size_t c = 0; c < 3; c++) {
            over |= float(pbr.baseColorFactor[c]) > CHIARO_MAX_ALBEDO;
            material->albedo[c] = std::min(float(pbr.baseColorFactor[c]), CHIARO_MAX_ALBEDO);
        }
        material->alpha = std::min(float(pbr.baseColorFactor[3]), 1.0f);
        material->albedo_texture = take_texture(pbr.baseColorTexture, index, &surface->albedo);
        return over;
    }

    /* What a transmission says of a channel: a part of 1; without the extension none. */
    static double part_of(const tinygltf::Material &source, const char *extension, const char *name, int item,
                          double otherwise, int material)
    {
        auto found = source.extensions.find(extension);
        double part = found == source.extensions.end() ? 0 : member(found->second, extension, name, item, otherwise);
        if (!(part >= 0 && part <= 1))
            fail("material %d has a %s out of range", material, name);
        return part;
    }

    /* True if light comes through: then the surface has another side, whatever the file says of seeing it. What comes
     * through in a straight line (KHR_materials_transmission) is taken to be scattered; textures of transmission are not
     * read, and that of the base colour tints both ways. */
    bool take_transmission(const tinygltf::Material &source, int index, ChiaroMaterial *material, bool *over)
    {
        static const char straight[] = "KHR_materials_transmission", diffuse[] = "KHR_materials_diffuse_transmission";
        bool any = false;
        for (int c = 0; c < 3; c++) {
            double all = double(material->albedo[c]);
            double glass = part_of(source, straight, "transmissionFactor", -1, 0, index);
            double leaf = part_of(source, diffuse, "diffuseTransmissionFactor", -1, 0, index);
            double tint = part_of(source, diffuse, "diffuseTransmissionColorFactor", c, 1, index);
            double through = all * glass + leaf * tint, given = all * (1 - glass) * (1 - leaf);
            if (!(glass + leaf > 0))
                continue;
            all = given + through;
            material->transmission[c] = all > 0 ? uint8_t(std::lround(255 * through / all)) : 0;
            material->albedo[c] = std::min(float(all), CHIARO_MAX_ALBEDO);
            *over |= float(all) > CHIARO_MAX_ALBEDO;
            any |= material->transmission[c] > 0;
        }
        return any;
    }

    void take_emission(const tinygltf::Material &source, int index, ChiaroMaterial *material, Surface *surface)
    {
        double strength = 1, brightest = 0;
        auto extension = source.extensions.find("KHR_materials_emissive_strength");
        if (extension != source.extensions.end() && extension->second.Has("emissiveStrength"))
            strength = extension->second.Get("emissiveStrength").GetNumberAsDouble();
        if (!source.emissiveFactor.empty() && source.emissiveFactor.size() != 3)
            fail("material %d has an emission of %zu numbers", index, source.emissiveFactor.size());
        for (size_t c = 0; c < source.emissiveFactor.size(); c++) {
            double emission = source.emissiveFactor[c] * strength;
            if (!(emission >= 0 && emission <= double(FLT_MAX)))
                fail("material %d has an emission out of range", index);
            material->emission[c] = float(emission);
            brightest = std::max(brightest, emission);
        }
        if (brightest > 0) /* What does not shine needs no texture. */
            material->emission_texture = take_texture(source.emissiveTexture, index, &surface->emission);
    }

    static double member(const tinygltf::Value &object, const char *extension, const char *name, int item,
                         double otherwise)
    {
        if (!object.Has(name))
            return otherwise;
        const tinygltf::Value *value = &object.Get(name);
        if (item >= 0) {
            if (!value->IsArray() || size_t(item) >= value->ArrayLen())
                fail("%s has a damaged %s", extension, name);
            value = &value->Get(item);
        }
        if (!value->IsNumber() || !std::isfinite(value->GetNumberAsDouble()))
            fail("%s has a damaged %s", extension, name);
        return value->GetNumberAsDouble();
    }

    uint32_t take_texture(const tinygltf::TextureInfo &info, int material, Mapping *mapping)
    {
        if (info.index == -1)
            return CHIARO_NONE;
        const tinygltf::Texture &texture = element(model.textures, info.index, "texture");
        double set = info.texCoord;
        auto extension = info.extensions.find(texture_transform);
        if (extension != info.extensions.end()) {
            const tinygltf::Value &t = extension->second;
            double angle = member(t, texture_transform, "rotation", -1, 0), sine = std::sin(angle), cosine = std::cos(angle);
            double scale_u = member(t, texture_transform, "scale", 0, 1);
            double scale_v = member(t, texture_transform, "scale", 1, 1);
            /* Counter-clockwise as one sees the image, where v points down. The shader in the extension's text turns
             * the other way; its worked example and its test model turn this way. */
            *mapping = {0, cosine * scale_u, sine * scale_v, member(t, texture_transform, "offset", 0, 0),
                        -sine * scale_u, cosine * scale_v, member(t, texture_transform, "offset", 1, 0)};
            set = member(t, texture_transform, "texCoord", -1, set);
        }
        if (!(set >= 0 && set <= 1000))
            fail("material %d uses a set of texture coordinates out of range", material);
        mapping->set = int(set);
        uint32_t &known = texture_index[size_t(info.index)];
        if (known == CHIARO_NONE)
            known = add_texture(texture, info.index);
        return known;
    }

    uint32_t add_texture(const tinygltf::Texture &source, int index)
    {
        ChiaroTexture texture = {};
        if (source.source == -1)
            fail("texture %d has no image that can be read", index);
        element(model.images, source.source, "image");
        if (source.sampler != -1) {
            const tinygltf::Sampler &sampler = element(model.samplers, source.sampler, "sampler");
            texture.wrap_u = wrap(sampler.wrapS, source.sampler);
            texture.wrap_v = wrap(sampler.wrapT, source.sampler);
            texture.nearest = sampler.magFilter == TINYGLTF_TEXTURE_FILTER_NEAREST;
        }
        Pixels &pixels = image_pixels[size_t(source.source)];
        if (pixels.width == 0)
            pixels = decode_image(source.source);
        texture.width = pixels.width;
        texture.height = pixels.height;
        texture.first_byte = pixels.first_byte;
        out.textures.push_back(texture);
        return uint32_t(out.textures.size() - 1);
    }

    static uint32_t wrap(int mode, int sampler)
    {
        switch (mode) {
        case TINYGLTF_TEXTURE_WRAP_REPEAT:
            return CHIARO_WRAP_REPEAT;
        case TINYGLTF_TEXTURE_WRAP_CLAMP_TO_EDGE:
            return CHIARO_WRAP_CLAMP;
        case TINYGLTF_TEXTURE_WRAP_MIRRORED_REPEAT:
            return CHIARO_WRAP_MIRROR;
        default:
            fail("sampler %d has the unknown wrap mode %d", sampler, mode);
        }
    }

    Pixels decode_image(int index)
    {
        const tinygltf::Image &source = model.images[size_t(index)];
        Span bytes = source.bufferView >= 0 ? view_bytes(model, source.bufferView)
                                            : Span{source.image.data(), source.image.size()};
        if (bytes.size == 0 || bytes.size > INT32_MAX)
            fail("image %d%s%s has no data", index, source.uri.empty() ? "" : " ", source.uri.c_str());
        tinygltf::Image decoded;
        std::string error, warning;
        if (!tinygltf::LoadImageData(&decoded, index, &error, &warning, 0, 0, bytes.data, int(bytes.size), nullptr))
            fail("image %d%s%s is in a format that cannot be read, or damaged", index, source.uri.empty() ? "" : " ",
                 source.uri.c_str());
        size_t count = size_t(decoded.width) * size_t(decoded.height) * 4;
        bool wide = decoded.bits == 16;
        if (decoded.width > 32768 || decoded.height > 32768 || decoded.component != 4 ||
            decoded.image.size() != count * (wide ? 2 : 1))
            fail("image %d has a size out of range", index);
        Pixels pixels = {uint32_t(decoded.width), uint32_t(decoded.height), out.pixels.size()};
        if (wide)
            for (size_t i = 0; i < count; i++) {
                uint16_t value;
                memcpy(&value, &decoded.image[i * 2], sizeof value);
                out.pixels.push_back(uint8_t((value + 128) / 257));
            }
        else
            out.pixels.insert(out.pixels.end(), decoded.image.begin(), decoded.image.end());
        return pixels;
    }

    /* ---- geometry ---- */

    void take_primitive(const tinygltf::Primitive &primitive, int mesh, const Transform &world)
    {
        if (primitive.mode < TINYGLTF_MODE_POINTS || primitive.mode > TINYGLTF_MODE_TRIANGLE_FAN)
            fail("mesh %d has a primitive of the unknown mode %d", mesh, primitive.mode);
        if (primitive.mode < TINYGLTF_MODE_TRIANGLES || !primitive.attributes.count("POSITION"))
            return; /* Points and lines have no surface. */
        Surface surface = take_material(primitive.material);
        Attributes attributes = read_attributes(primitive, mesh, surface);
        uint32_t first = uint32_t(mesh_out->indices.size());
        add_triangles(attributes, surface, world, mesh);
        uint32_t count = uint32_t(mesh_out->indices.size()) - first;
        if (count == 0)
            return;
        uint32_t number = uint32_t(mesh_out->parts.size());
        mesh_out->parts.push_back({first, count, surface.index, surface.two_sided ? number + 1 : CHIARO_NONE});
        if (surface.two_sided)
            add_other_side(number);
    }

    Elements<float> read_attribute(const tinygltf::Primitive &primitive, const std::string &name, size_t least,
                                   size_t most, size_t count, int mesh) const
    {
        auto found = primitive.attributes.find(name);
        if (found == primitive.attributes.end())
            return {};
        /* Colours of whole numbers are always fractions of the largest. */
        Elements<float> elements = read_accessor<float>(model, found->second, name == "COLOR_0");
        if (elements.width < least || elements.width > most)
            fail("mesh %d has a %s of %zu components", mesh, name.c_str(), elements.width);
        if (count && elements.count != count)
            fail("mesh %d has %zu elements of %s for %zu vertices", mesh, elements.count, name.c_str(), count);
        for (float value : elements.values)
            if (!std::isfinite(value))
                fail("mesh %d has a %s that is not finite", mesh, name.c_str());
        return elements;
    }

    static std::string uv_name(const Mapping &mapping) { return "TEXCOORD_" + std::to_string(mapping.set); }

    Attributes read_attributes(const tinygltf::Primitive &primitive, int mesh, const Surface &surface) const
    {
        Attributes a;
        const ChiaroMaterial &material = out.materials[surface.index];
        a.position = read_attribute(primitive, "POSITION", 3, 3, 0, mesh);
        size_t count = a.position.count;
        if (count == 0)
            return a;
        a.normal = read_attribute(primitive, "NORMAL", 3, 3, count, mesh);
        a.color = read_attribute(primitive, "COLOR_0", 3, 4, count, mesh);
        if (material.albedo_texture != CHIARO_NONE)
            a.albedo_uv = read_attribute(primitive, uv_name(surface.albedo), 2, 2, count, mesh);
        if (material.emission_texture != CHIARO_NONE)
            a.emission_uv = read_attribute(primitive, uv_name(surface.emission), 2, 2, count, mesh);
        a.corners = triangulate(primitive.mode, read_corners(primitive, mesh, count));
        return a;
    }

    std::vector<uint32_t> read_corners(const tinygltf::Primitive &primitive, int mesh, size_t count) const
    {
        std::vector<uint32_t> corners;
        if (primitive.indices == -1) {
            corners.resize(count);
            for (size_t i = 0; i < count; i++)
                corners[i] = uint32_t(i);
            return corners;
        }
        const tinygltf::Accessor &accessor = element(model.accessors, primitive.indices, "accessor");
        if (!is_unsigned(accessor.componentType) || accessor.type != TINYGLTF_TYPE_SCALAR || accessor.normalized)
            fail("mesh %d has indices that are no unsigned integers", mesh);
        corners = read_accessor<uint32_t>(model, primitive.indices).values;
        for (uint32_t corner : corners)
            if (corner >= count)
                fail("mesh %d has the vertex index %u, beyond its %zu vertices", mesh, corner, count);
        return corners;
    }

    /* Strips and fans as glTF 2.0 section 3.7.2.1 takes them apart. */
    static std::vector<uint32_t> triangulate(int mode, std::vector<uint32_t> corners)
    {
        size_t count = corners.size();
        if (mode == TINYGLTF_MODE_TRIANGLES) {
            corners.resize(count - count % 3);
            return corners;
        }
        std::vector<uint32_t> list;
        for (size_t i = 0; i + 2 < count; i++)
            if (mode == TINYGLTF_MODE_TRIANGLE_STRIP)
                list.insert(list.end(), {corners[i], corners[i + 1 + i % 2], corners[i + 2 - i % 2]});
            else
                list.insert(list.end(), {corners[i + 1], corners[i + 2], corners[0]});
        return list;
    }

    void add_triangles(const Attributes &a, const Surface &surface, const Transform &world, int mesh)
    {
        std::vector<ChiaroVertex> vertices = place_vertices(a, surface, world, mesh);
        std::vector<uint32_t> number(vertices.size(), CHIARO_NONE); /* Of a vertex in the scene, once it is used. */
        bool mirrored = world.determinant() < 0;
        for (size_t i = 0; i < a.corners.size(); i += 3) {
            uint32_t corner[3] = {a.corners[i], a.corners[i + 1], a.corners[i + 2]};
            if (mirrored) /* glTF: the winding turns round with the sign of the determinant. */
                std::swap(corner[1], corner[2]);
            float normal[3];
            if (!face_normal(vertices, corner, normal)) {
                degenerate++;
                continue;
            }
            if (mesh_out->indices.size() + 6 > max_indices || mesh_out->vertices.size() + 6 > max_indices)
                fail("has more than %zu triangles", max_indices / 3);
            for (uint32_t c : corner) {
                ChiaroVertex vertex = vertices[c];
                if (a.normal.count && number[c] != CHIARO_NONE) {
                    mesh_out->indices.push_back(number[c]);
                    continue;
                }
                /* Flat where the file gives no normal, or one of no length. */
                if (std::fabs(vertex.normal[0]) + std::fabs(vertex.normal[1]) + std::fabs(vertex.normal[2]) == 0)
                    std::copy(normal, normal + 3, vertex.normal);
                number[c] = uint32_t(mesh_out->vertices.size());
                mesh_out->indices.push_back(number[c]);
                mesh_out->vertices.push_back(vertex);
            }
        }
    }

    /* False for a triangle without area, as far as its float positions can tell. */
    static bool face_normal(const std::vector<ChiaroVertex> &vertices, const uint32_t corner[3], float normal[3])
    {
        Vector a = load_vector(vertices[corner[0]].position), b = load_vector(vertices[corner[1]].position),
               c = load_vector(vertices[corner[2]].position);
        Vector n = cross(b - a, c - a);
        double longest = std::max({dot(b - a, b - a), dot(c - a, c - a), dot(c - b, c - b)});
        return length(n) > 1e-12 * longest && store_unit(normal, n);
    }

    std::vector<ChiaroVertex> place_vertices(const Attributes &a, const Surface &surface, const Transform &world,
                                             int mesh) const
    {
        std::vector<ChiaroVertex> vertices(a.position.count);
        for (size_t i = 0; i < vertices.size(); i++) {
            ChiaroVertex &vertex = vertices[i];
            Vector p = world.point(load_vector(&a.position.values[i * 3]));
            if (!(std::fabs(p.x) <= max_coordinate && std::fabs(p.y) <= max_coordinate &&
                  std::fabs(p.z) <= max_coordinate))
                fail("mesh %d has a vertex too far away", mesh);
            vertex.position[0] = float(p.x);
            vertex.position[1] = float(p.y);
            vertex.position[2] = float(p.z);
            if (a.normal.count)
                store_unit(vertex.normal, world.normal(load_vector(&a.normal.values[i * 3])));
            std::fill(vertex.color, vertex.color + 4, 1.0f);
            for (size_t c = 0; c < a.color.width; c++)
                vertex.color[c] = std::min(std::max(a.color.values[i * a.color.width + c], 0.0f), 1.0f);
            map_uv(a.albedo_uv, i, surface.albedo, mesh, vertex.uv);
            map_uv(a.emission_uv, i, surface.emission, mesh, vertex.emission_uv);
        }
        return vertices;
    }

    static void map_uv(const Elements<float> &uv, size_t i, const Mapping &m, int mesh, float to[2])
    {
        double u = uv.count ? double(uv.values[i * 2]) : 0, v = uv.count ? double(uv.values[i * 2 + 1]) : 0;
        to[0] = float(m.a * u + m.b * v + m.c);
        to[1] = float(m.d * u + m.e * v + m.f);
        if (!std::isfinite(to[0]) || !std::isfinite(to[1]))
            fail("mesh %d has texture coordinates out of range", mesh);
    }

    /* The same triangles seen from behind. */
    void add_other_side(uint32_t front)
    {
        const ChiaroPart part = mesh_out->parts[front];
        uint32_t first = uint32_t(mesh_out->indices.size());
        if (mesh_out->indices.size() + part.index_count > max_indices)
            fail("has more than %zu triangles", max_indices / 3);
        /* The part's vertices are its own, and lie together. */
        auto range = std::minmax_element(mesh_out->indices.begin() + part.first_index, mesh_out->indices.end());
        uint32_t low = *range.first, high = *range.second, shift = uint32_t(mesh_out->vertices.size()) - low;
        for (uint32_t i = low; i <= high; i++) {
            ChiaroVertex vertex = mesh_out->vertices[i];
            for (float &n : vertex.normal)
                n = -n;
            mesh_out->vertices.push_back(vertex);
        }
        for (uint32_t i = 0; i < part.index_count; i += 3)
            for (uint32_t c : {0u, 2u, 1u})
                mesh_out->indices.push_back(mesh_out->indices[part.first_index + i + c] + shift);
        mesh_out->parts.push_back({first, part.index_count, part.material, front});
    }
};

/* ------------------------------------------------------------------------------------------------------------------
 * The way out
 */

void keep_message(ChiaroLogLevel, ChiaroLogItem, const char *message, void *user)
{
    *static_cast<std::string *>(user) = message;
}

/* Points the plain arrays at what the storage holds: `mesh`, and what all meshes share. */
ChiaroScene view_of(const Storage &storage, const Mesh &mesh)
{
    ChiaroScene scene = {};
    scene.vertices = mesh.vertices.data();
    scene.indices = mesh.indices.data();
    scene.parts = mesh.parts.data();
    scene.materials = storage.materials.data();
    scene.textures = storage.textures.data();
    scene.pixels = storage.pixels.data();
    scene.pixel_bytes = storage.pixels.size();
    scene.vertex_count = uint32_t(mesh.vertices.size());
    scene.index_count = uint32_t(mesh.indices.size());
    scene.part_count = uint32_t(mesh.parts.size());
    scene.material_count = uint32_t(storage.materials.size());
    scene.texture_count = uint32_t(storage.textures.size());
    return scene;
}

void check(const ChiaroScene &scene)
{
    std::string message;
    const ChiaroLog log = {keep_message, &message};
    if (chiaro_scene_check(&scene, &log) != CHIARO_OK)
        fail("%s", message.c_str());
}

/* Keeps a mapping for as long as it is in use, whatever is thrown. */
struct Mapped {
    ChiaroIoFile file;
    ~Mapped() { chiaro_io_unmap(&file); }
};

void import(const char *path, const ChiaroIoFile &file, const std::vector<std::string> &dynamic, ChiaroIoScene *scene)
{
    tinygltf::Model model;
    auto storage = std::make_unique<Storage>();
    parse(path, file, &model);
    Importer importer(model, dynamic, *storage);
    const Vector origin = importer.run();
    ChiaroScene flat = view_of(*storage, storage->still);
    flat.lights = storage->lights.data();
    flat.light_count = uint32_t(storage->lights.size());
    flat.cameras = storage->cameras.data();
    flat.camera_count = uint32_t(storage->cameras.size());
    check(flat);
    for (size_t i = 0; i < storage->objects.size(); i++) {
        storage->objects[i].scene = view_of(*storage, storage->moving[i]);
        check(storage->objects[i].scene);
    }
    *scene = {flat,
              storage->objects.data(),
              storage->joints.data(),
              storage->channels.data(),
              uint32_t(storage->objects.size()),
              uint32_t(storage->joints.size()),
              uint32_t(storage->channels.size()),
              {origin.x, origin.y, origin.z},
              importer.clamped,
              importer.degenerate,
              nullptr};
    scene->memory = storage.release();
}

} // namespace

extern "C" bool chiaro_io_read_gltf_dynamic(const char *path, const char *const *names, uint32_t name_count,
                                            ChiaroIoScene *scene, ChiaroIoError *error)
{
    *scene = {};
    try {
        Mapped mapped;
        if (!chiaro_io_map(path, &mapped.file, error))
            return false;
        import(path, mapped.file, std::vector<std::string>(names, names + name_count), scene);
        return true;
    } catch (const Fault &fault) {
        return chiaro_io_fail(error, path, "%s", fault.text.c_str());
    } catch (const std::bad_alloc &) {
        return chiaro_io_fail(error, path, "out of memory");
    } catch (const std::exception &fault) {
        return chiaro_io_fail(error, path, "cannot be read as glTF: %s", fault.what());
    }
}

extern "C" bool chiaro_io_read_gltf(const char *path, ChiaroIoScene *scene, ChiaroIoError *error)
{
    return chiaro_io_read_gltf_dynamic(path, nullptr, 0, scene, error);
}

extern "C" void chiaro_io_free_scene(ChiaroIoScene *scene)
{
    delete static_cast<Storage *>(scene->memory);
    *scene = {};
}
