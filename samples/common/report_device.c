/* The device of a report. */
#include "report_device.h"

/* Objects are settled when so many updates in a row changed nothing: read-back and shadows take a few. */
enum { SETTLED_FRAMES = 12, MOST_SETTLE_FRAMES = 2000 };

void report_must_host(const ReportDevice *device, bool good)
{
    if (!good)
        options_fail(&device->report->options, CHIARO_EXIT_DEVICE, "%s", device->host.error);
}

void report_must(const ReportDevice *device, ChiaroResult result)
{
    if (result != CHIARO_OK)
        options_fail(&device->report->options, CHIARO_EXIT_DEVICE, "%s: %s", device->input, chiaro_result_text(result));
}

void report_device_open(Report *report, const ReportScene *scene, ReportDevice *device)
{
    const SceneOptions *options = &report->options;
    HostDesc desc = {.device = report->device_name};
    *device = (ReportDevice){.report = report, .input = scene->input};
    report_must_host(device, host_create(&device->host, &desc));
    device->api = chiaro_vulkan_get_api(CHIARO_VULKAN_API_VERSION);
    report_resize(device, scene, options->width, options->height);
    snprintf(report->device, sizeof report->device, "%.120s, %.120s", device->host.device_name, device->host.driver);
}

void report_resize(ReportDevice *device, const ReportScene *scene, uint32_t width, uint32_t height)
{
    ChiaroVulkanDraw *draw = &device->draw;
    report_must_host(device, host_target_create(&device->host, width, height));
    *draw = (ChiaroVulkanDraw){.struct_size = sizeof *draw};
    host_camera(&scene->camera, width, height, false, draw->view, draw->projection);
    draw->viewport = (VkViewport){0, 0, (float)width, (float)height, 0, 1};
    draw->scissor = (VkRect2D){{0, 0}, {width, height}};
}

void report_device_close(ReportDevice *device) { host_destroy(&device->host); }

/* The host numbers frames; here each context has its own. */
static void begin_frame(ReportDevice *device, ReportContext *context)
{
    device->host.frame = context->frame;
    report_must_host(device, host_begin(&device->host));
    context->frame = device->host.frame;
}

void report_set(const ReportDevice *device, const ReportContext *context, ChiaroComponent component, bool gi_off,
                uint32_t without)
{
    ChiaroVulkanSettings set = {.struct_size = sizeof set, .gi_off = gi_off, .component = component, .without = without};
    report_must(device, device->api->settings_set(context->chiaro, &set));
}

void report_light(const ReportDevice *device, const ReportContext *context, const ChiaroLight *lights, uint32_t count)
{
    report_must(device, device->api->lights_set(context->chiaro, lights, count));
}

ReportContext report_load(ReportDevice *device, const ChiaroTransport *transport, bool gi_off, bool sliced)
{
    Host *host = &device->host;
    ReportContext context = {NULL, 0};
    ChiaroVulkanDesc desc = host_chiaro_desc(host);
    desc.sliced = sliced;
    report_must(device, device->api->create(&desc, &context.chiaro));
    report_set(device, &context, CHIARO_COMPONENT_FULL, gi_off, 0);
    begin_frame(device, &context);
    ChiaroVulkanLoad load = {.struct_size = sizeof load, .transport = transport, .command_buffer = host->commands,
                             .frame = host->frame};
    report_must(device, device->api->scene_load(context.chiaro, &load));
    report_must_host(device, host_submit(host));
    const ChiaroSky *sky = &device->report->sky;
    report_must(device, device->api->sky_set(context.chiaro, sky->radiance ? sky : NULL));
    return context;
}

void report_show(ReportDevice *device, ReportContext *context, Moving *moving)
{
    Host *host = &device->host;
    begin_frame(device, context);
    report_must(device, moving_load(moving, device->api, context->chiaro, host->commands, host->frame));
    report_must_host(device, host_submit(host));
}

void report_unload(ReportDevice *device, ReportContext *context)
{
    device->api->destroy(context->chiaro);
    context->chiaro = NULL;
}

ChiaroVulkanStats report_stats(const ReportDevice *device, const ReportContext *context)
{
    ChiaroVulkanStats stats = {.struct_size = sizeof stats};
    report_must(device, device->api->stats(context->chiaro, &stats));
    return stats;
}

ChiaroVulkanObjectStats report_object_stats(const ReportDevice *device, const ReportContext *context)
{
    ChiaroVulkanObjectStats stats = {.struct_size = sizeof stats};
    report_must(device, device->api->object_stats(context->chiaro, &stats));
    return stats;
}

static void record_update(ReportDevice *device, ReportContext *context, const ReportBudget *budget)
{
    Host *host = &device->host;
    ChiaroVulkanUpdate update = {.struct_size = sizeof update, .command_buffer = host->commands, .frame = host->frame,
                                 .completed_frame = host->frame - 1};
    if (budget)
        update.gpu_units = budget->gpu_units, update.budget.units = budget->units;
    report_must(device, device->api->update(context->chiaro, &update));
}

ReportFrame report_frame(ReportDevice *device, ReportContext *context, const ReportBudget *budget, bool read)
{
    Host *host = &device->host;
    ReportFrame frame;
    double begin = report_now();
    begin_frame(device, context);
    host_timestamp(host, 0);
    double record = report_core_time();
    record_update(device, context, budget);
    frame.record = 1e3 * (report_core_time() - record);
    host_timestamp(host, 1);
    host_begin_pass(host);
    device->draw.command_buffer = host->commands;
    report_must(device, device->api->draw(context->chiaro, &device->draw));
    host_end_pass(host);
    if (read)
        host_read_target(host);
    report_must_host(device, host_submit(host));
    frame.all = 1e3 * (report_now() - begin);
    frame.update = 1e3 * host_elapsed(host, 0, 1);
    return frame;
}

void report_settle(ReportDevice *device, ReportContext *context)
{
    const ReportBudget enough = {.units = UINT32_MAX}; /* for a round a frame */
    uint32_t still = 0;
    for (uint32_t frame = 0; frame < MOST_SETTLE_FRAMES && still < SETTLED_FRAMES; frame++) {
        begin_frame(device, context);
        record_update(device, context, &enough);
        report_must_host(device, host_submit(&device->host));
        ChiaroVulkanObjectStats stats = report_object_stats(device, context);
        still = stats.shown == 0 ? SETTLED_FRAMES : stats.cubes + stats.fading > 0 ? 0 : still + 1;
    }
    report_frame(device, context, NULL, true);
}

ChiaroIoImage report_pixels(const ReportDevice *device)
{
    return (ChiaroIoImage){device->host.width, device->host.height, 4, device->host.read_back.mapped};
}
