/* What the README claims, each with a key that stands behind it there in brackets, and what is measured of it here.
 * Nothing is written down but the claim itself: what cannot be measured where a report is made has no figure.
 *
 * Claims about any scene (lamps that hang elsewhere, an update with nothing to do) are measured with each scene of the
 * report, by report_lamps.c and report_scene.c; those about the house here. */
#include "report.h"

#include "crowd.h"

#include <elf.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

/* `slack`: so much more, as a part, is still what is claimed. */
const ReportClaim report_claims[REPORT_CLAIMS] = {
    [CLAIM_PLUGIN] = {"plugin", "248 KiB", "KiB that a host loads", 248, 0.02},
    [CLAIM_LINES_DRAW] = {"lines-draw", "about 45 lines", "lines", 45, 0.05},
    [CLAIM_LINES_LIGHT] = {"lines-light", "about 55 lines", "lines", 55, 0.05},
    [CLAIM_DARK] = {"dark", "light off is exactly black again", "largest irradiance with all lights off", 0, 0},
    [CLAIM_IDLE] = {"idle", "If nothing changed, it records nothing", "dispatches, tasks and bytes", 0, 0},
    [CLAIM_AGE] = {"age", "nothing is older than w ceil(n / k) frames + latency", "of that bound", 1, 0},
    [CLAIM_CROWD] = {"crowd", "in a crowd of a thousand, light is about 10 % wrong", "%, relRMSE", 10, 0.1},
    [CLAIM_FAR] = {"far", "vertices 1e6 m from the origin have steps of 6 cm", "cm", 6, 0.05},
    [CLAIM_WHITE] = {"white", "albedo above 0.99 is taken as 0.99", "by the light of a box of 0.9999", 0.99, 1e-3},
    [CLAIM_SUN] = {"sun", "at most some 12 degrees about its centre", "degrees: the widest that is taken", 12, 0.1},
    [CLAIM_LAMPS] = {"lamps", "a lamp near a wall", "%, median relRMSE, the worst scene here", (double)NAN, 0},
};

bool report_claim_holds(const ReportClaim *claim, double measured)
{
    return measured <= claim->claimed * (1 + claim->slack);
}

/* ---- the house ---------------------------------------------------------------------------------------------------- */

/* What a host maps: up to the end of the last segment. What else the file holds is for debuggers. */
static double loaded_kib(const ChiaroIoFile *file)
{
    const unsigned char *bytes = file->data;
    Elf64_Ehdr head;
    uint64_t end = 0;
    if (file->size < sizeof head || memcmp(bytes, ELFMAG, SELFMAG) != 0 || bytes[EI_CLASS] != ELFCLASS64)
        return (double)NAN;
    memcpy(&head, bytes, sizeof head);
    if (head.e_phoff > file->size || head.e_phnum > (file->size - head.e_phoff) / sizeof(Elf64_Phdr))
        return (double)NAN;
    for (uint32_t k = 0; k < head.e_phnum; k++) {
        Elf64_Phdr segment;
        memcpy(&segment, bytes + head.e_phoff + k * sizeof segment, sizeof segment);
        if (segment.p_type == PT_LOAD && segment.p_offset + segment.p_filesz > end)
            end = segment.p_offset + segment.p_filesz;
    }
    return (double)end / 1024;
}

/* The plugin beside this program, where it was built or installed. */
static double measure_plugin(void)
{
    static const char *const places[] = {"../chiaro_plugin.so", "../lib/chiaro_plugin.so"};
    char own[REPORT_PATH / 2], path[REPORT_PATH];
    ssize_t length = readlink("/proc/self/exe", own, sizeof own - 1);
    ChiaroIoFile file;
    ChiaroIoError error;
    if (length <= 0)
        return (double)NAN;
    own[length] = 0;
    char *slash = strrchr(own, '/');
    for (size_t k = 0; slash && k < sizeof places / sizeof *places; k++) {
        snprintf(path, sizeof path, "%.*s/%s", (int)(slash - own), own, places[k]);
        if (!chiaro_io_map(path, &file, &error))
            continue;
        double kib = loaded_kib(&file);
        chiaro_io_unmap(&file);
        return kib;
    }
    return (double)NAN;
}

/* Lines of a sample that Chiaro asks for: between CHIARO and CHIARO: end, or marked by themselves; not comments, nor what
 * is empty. In the folder of the sources; elsewhere there are no samples. */
static double measure_lines(const char *path)
{
    char text[256];
    bool inside = false, comment = false;
    double count = 0;
    FILE *file = fopen(path, "r");
    if (!file)
        return (double)NAN;
    while (fgets(text, sizeof text, file)) {
        const char *line = text + strspn(text, " "), *mark = strstr(line, "/* CHIARO");
        bool whole = comment || strncmp(line, "/*", 2) == 0;
        if (whole)
            comment = !strstr(line, "*/");
        else
            count += (inside && *line != '\n') || mark;
        if (mark == line)
            inside = !strstr(line, "CHIARO: end");
    }
    fclose(file);
    return count;
}

/* ---- light -------------------------------------------------------------------------------------------------------- */

enum { SMALL_BAKE = 256, SMALL_RAYS = 256 };

/* Mean irradiance of a small bake, and the largest. */
static void light_small(const Report *report, const ChiaroScene *scene, const ChiaroLight *lights, uint32_t count,
                        double *mean, double *largest)
{
    const ChiaroBakeDesc desc = {.struct_size = sizeof desc, .samples = SMALL_BAKE, .receivers = SMALL_BAKE,
                                 .rays = SMALL_RAYS};
    ChiaroBlob blob;
    ChiaroTransport t;
    if (chiaro_bake(scene, &desc, &blob) != CHIARO_OK ||
        chiaro_transport_open(blob.data, blob.size, &t, NULL) != CHIARO_OK)
        options_fail(&report->options, CHIARO_EXIT_INPUT, "a small scene cannot be baked");
    float *scratch = report_alloc(report, 3 * ((size_t)t.node_count + t.sample_count), sizeof *scratch);
    float *irradiance = report_alloc(report, 3 * (size_t)t.receiver_count, sizeof *irradiance);
    chiaro_transport_update(&t, lights, count, NULL, NULL, NULL, scratch, irradiance);
    *mean = *largest = 0;
    for (size_t i = 0; i < 3 * (size_t)t.receiver_count; i++) {
        *mean += (double)irradiance[i] / (3.0 * t.receiver_count);
        *largest = fmax(*largest, fabs((double)irradiance[i]));
    }
    free(scratch);
    free(irradiance);
    chiaro_blob_free(&blob);
}

static TestScene make_scene(const Report *report, const char *name)
{
    const SceneRequest request = {0};
    TestScene made;
    const char *fault;
    if (!scenes_make(name, &request, &made, &fault))
        options_fail(&report->options, CHIARO_EXIT_INPUT, "%s", fault);
    return made;
}

static double measure_dark(const Report *report)
{
    TestScene made = make_scene(report, "cornell");
    double mean, lit, dark;
    light_small(report, &made.scene, made.scene.lights, made.scene.light_count, &mean, &lit);
    light_small(report, &made.scene, NULL, 0, &mean, &dark);
    scenes_free(&made);
    return lit > 0 ? dark : (double)NAN;
}

/* A closed box of one albedo whose walls send out pi is lit by pi / (1 - albedo). */
static double measure_white(const Report *report)
{
    TestScene made = make_scene(report, "furnace");
    ChiaroMaterial material = made.scene.materials[0];
    ChiaroScene box = made.scene;
    double mean, largest;
    for (uint32_t c = 0; c < 3; c++)
        material.albedo[c] = 0.9999f;
    box.materials = &material, box.material_count = 1;
    light_small(report, &box, NULL, 0, &mean, &largest);
    scenes_free(&made);
    return 1 - (double)CHIARO_PI / mean;
}

/* The step of a float there. */
static double measure_far(void) { return 100 * (double)(nextafterf(1e6f, INFINITY) - 1e6f); }

/* ---- the sun of a sky --------------------------------------------------------------------------------------------- */

enum { SKY_WIDTH = 512, SKY_HEIGHT = 256, WIDEST = 30 };

/* The angular radius, in degrees, of the light that an even disc at 40 degrees over the horizon becomes, which gives
 * twice what the rest of the sky does; 0: it becomes none. */
static double taken(float *radiance, double degrees)
{
    const ChiaroSky sky = {SKY_WIDTH, SKY_HEIGHT, radiance};
    const double unit = (double)CHIARO_PI / 180, high = 40 * unit;
    double cosine = cos(degrees * unit), sine = sin(degrees * unit);
    ChiaroLight sun;
    float radius;
    for (uint32_t y = 0; y < SKY_HEIGHT; y++) {
        double polar = (double)CHIARO_PI * (y + 0.5) / SKY_HEIGHT;
        for (uint32_t x = 0; x < SKY_WIDTH; x++) {
            double turn = 2 * (double)CHIARO_PI * (x + 0.5) / SKY_WIDTH;
            double toward = cos(polar) * sin(high) + sin(polar) * cos(turn) * cos(high);
            for (uint32_t c = 0; c < 3; c++)
                radiance[3 * (y * SKY_WIDTH + x) + c] = toward > cosine ? (float)(2 / (sine * sine)) : 1;
        }
    }
    return chiaro_sky_split(&sky, &sun, &radius, NULL) ? (double)radius / unit : 0;
}

static double measure_sun(const Report *report)
{
    float *radiance = report_alloc(report, (size_t)SKY_WIDTH * SKY_HEIGHT * 3, sizeof *radiance);
    double widest = 0;
    for (int degrees = 1; degrees <= WIDEST; degrees++)
        widest = fmax(widest, taken(radiance, degrees));
    free(radiance);
    return widest > 0 ? widest : (double)NAN;
}

/* ---- a crowd ------------------------------------------------------------------------------------------------------ */

enum { ROUNDS = 24, PATHS = 2048, QUICK_PATHS = 512, AGE_FRAMES = 120, AGE_UNITS = 2000 };

/* All of them move, under a budget that is too small for that. */
static double measure_age(const Report *report, const Crowd *crowd)
{
    const ChiaroWorldDesc desc = {0};
    ChiaroWorld *world = crowd_world(&report->options, crowd, &desc);
    ChiaroKernelStats stats = {.struct_size = sizeof stats};
    uint32_t *painted = report_alloc(report, CROWD_OBJECTS, sizeof *painted);
    for (uint32_t frame = 0; frame < AGE_FRAMES; frame++) {
        float turn = 0.1f * (float)frame;
        for (uint32_t i = 0; i < CROWD_OBJECTS; i++)
            crowd_move(world, crowd, i, vec3_scale(vec3(cosf(turn + (float)i), 0, sinf(turn + (float)i)),
                                                   0.1f * crowd->object.radius));
        chiaro_world_run(world, (ChiaroBudget){.units = AGE_UNITS}, 0, painted, CROWD_OBJECTS);
    }
    ChiaroResult result = chiaro_kernel_stats(chiaro_world_kernel(world), &stats);
    chiaro_world_destroy(world);
    free(painted);
    /* Without a bound nothing waited, and nothing was put to the test. */
    return result == CHIARO_OK && stats.bound > 0 ? fmax(stats.age, stats.oldest) / stats.bound : (double)NAN;
}

static double measure_crowd(const Report *report, const Crowd *crowd)
{
    const ChiaroWorldDesc desc = {0};
    ChiaroWorld *world = crowd_world(&report->options, crowd, &desc);
    for (uint32_t round = 0; round < ROUNDS; round++)
        chiaro_world_update(world, CROWD_OBJECTS, NULL);
    double error = crowd_error(&report->options, crowd, world);
    chiaro_world_destroy(world);
    return 100 * error;
}

void report_measure_claims(Report *report)
{
    ReportStep step;
    double *measured = report->measured;
    report_begin(report, "what the README claims", &step);
    measured[CLAIM_PLUGIN] = measure_plugin();
    measured[CLAIM_LINES_DRAW] = measure_lines("samples/embed_draw.c");
    measured[CLAIM_LINES_LIGHT] = measure_lines("samples/embed_light.c");
    measured[CLAIM_FAR] = measure_far();
    measured[CLAIM_DARK] = measure_dark(report);
    measured[CLAIM_WHITE] = measure_white(report);
    measured[CLAIM_SUN] = measure_sun(report);
    report_continue(&step, 0.3);
    Crowd *crowd = report_alloc(report, 1, sizeof *crowd);
    crowd_open(&report->options, report->quick ? QUICK_PATHS : PATHS, crowd);
    report_continue(&step, 0.8);
    measured[CLAIM_CROWD] = measure_crowd(report, crowd);
    measured[CLAIM_AGE] = measure_age(report, crowd);
    crowd_close(crowd);
    free(crowd);
    report_end(&step);
}
