/* The device of a report. */
#include "report_device.h"

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
    report_must_host(device, host_target_create(&device->host, options->width, options->height));
    device->api = chiaro_vulkan_get_api(CHIARO_VULKAN_API_VERSION);
    device->draw = (ChiaroVulkanDraw){.struct_size = sizeof device->draw};
    host_camera(&scene->camera, options->width, options->height, false, device->draw.view, device->draw.projection);
    device->draw.viewport = (VkViewport){0, 0, (float)options->width, (float)options->height, 0, 1};
    device->draw.scissor = (VkRect2D){{0, 0}, {options->width, options->height}};
    snprintf(report->device, sizeof report->device, "%.120s, %.120s", device->host.device_name, device->host.driver);
}

void report_device_close(ReportDevice *device) { host_destroy(&device->host); }

void report_set_component(const ReportDevice *device, ChiaroVulkan *chiaro, ChiaroComponent component, bool gi_off)
{
    ChiaroVulkanSettings set = {.struct_size = sizeof set, .gi_off = gi_off, .component = component};
    report_must(device, device->api->settings_set(chiaro, &set));
}

ChiaroVulkan *report_load(ReportDevice *device, const ChiaroTransport *transport, bool gi_off)
{
    Host *host = &device->host;
    ChiaroVulkan *chiaro;
    ChiaroVulkanDesc desc = host_chiaro_desc(host);
    report_must(device, device->api->create(&desc, &chiaro));
    report_set_component(device, chiaro, CHIARO_COMPONENT_FULL, gi_off);
    report_must_host(device, host_begin(host));
    ChiaroVulkanLoad load = {.struct_size = sizeof load, .transport = transport, .command_buffer = host->commands,
                             .frame = host->frame};
    report_must(device, device->api->scene_load(chiaro, &load));
    report_must_host(device, host_submit(host));
    const ChiaroSky *sky = &device->report->sky;
    report_must(device, device->api->sky_set(chiaro, sky->radiance ? sky : NULL));
    return chiaro;
}

ReportFrame report_frame(ReportDevice *device, ChiaroVulkan *chiaro, bool read)
{
    Host *host = &device->host;
    ReportFrame frame;
    double begin = report_now();
    report_must_host(device, host_begin(host));
    ChiaroVulkanUpdate update = {.struct_size = sizeof update, .command_buffer = host->commands, .frame = host->frame,
                                 .completed_frame = host->frame - 1};
    host_timestamp(host, 0);
    double record = report_now();
    report_must(device, device->api->update(chiaro, &update));
    frame.record = 1e3 * (report_now() - record);
    host_timestamp(host, 1);
    host_begin_pass(host);
    device->draw.command_buffer = host->commands;
    report_must(device, device->api->draw(chiaro, &device->draw));
    host_end_pass(host);
    if (read)
        host_read_target(host);
    report_must_host(device, host_submit(host));
    frame.all = 1e3 * (report_now() - begin);
    frame.update = 1e3 * host_elapsed(host, 0, 1);
    return frame;
}

ChiaroIoImage report_pixels(const ReportDevice *device)
{
    return (ChiaroIoImage){device->host.width, device->host.height, 4, device->host.read_back.mapped};
}
