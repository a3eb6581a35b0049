/* The device of a report: a host without a window, and frames on it. */
#ifndef CHIARO_REPORT_DEVICE_H
#define CHIARO_REPORT_DEVICE_H

#include "device.h"
#include "moving.h"
#include "report.h"

struct ReportDevice {
    const Report *report;
    const char *input; /* the scene, for messages */
    Host host;
    const ChiaroVulkanApi *api;
    ChiaroVulkanDraw draw;
};

/* All of them end the program with one line if they fail. */
void report_device_open(Report *report, const ReportScene *scene, ReportDevice *device);
void report_device_close(ReportDevice *device);
void report_must_host(const ReportDevice *device, bool good);
void report_must(const ReportDevice *device, ChiaroResult result);
/* Pictures are so large from now on. */
void report_resize(ReportDevice *device, const ReportScene *scene, uint32_t width, uint32_t height);
/* A context that has the device to itself: with frames of its own, whatever others draw between them. */
typedef struct ReportContext {
    ChiaroVulkan *chiaro;
    uint64_t frame; /* the last one */
} ReportContext;
/* A context with a scene and the report's sky. */
ReportContext report_load(ReportDevice *device, const ChiaroTransport *transport, bool gi_off, bool sliced);
/* Shows objects in it. */
void report_show(ReportDevice *device, ReportContext *context, Moving *moving);
void report_unload(ReportDevice *device, ReportContext *context);
/* What is shown; `without`: bits of ChiaroVulkanWithout. */
void report_set(const ReportDevice *device, const ReportContext *context, ChiaroComponent component, bool gi_off,
                uint32_t without);
void report_light(const ReportDevice *device, const ReportContext *context, const ChiaroLight *lights, uint32_t count);
ChiaroVulkanStats report_stats(const ReportDevice *device, const ReportContext *context);
ChiaroVulkanObjectStats report_object_stats(const ReportDevice *device, const ReportContext *context);
/* Milliseconds of a frame; those that are not wanted may be NULL. */
typedef struct ReportFrame {
    double all, update, record; /* by the clock; by the device's clock; of update() on the CPU */
} ReportFrame;
/* What a frame may cost; NULL, or zero: the defaults. */
typedef struct ReportBudget {
    uint32_t gpu_units, units; /* of ChiaroVulkanUpdate, and of its budget */
} ReportBudget;
ReportFrame report_frame(ReportDevice *device, ReportContext *context, const ReportBudget *budget, bool read);
/* Updates until objects do not change any more, and at least one; then a frame, which is read. */
void report_settle(ReportDevice *device, ReportContext *context);
/* What the last frame that was read shows: the host's pixels, until the next one. */
ChiaroIoImage report_pixels(const ReportDevice *device);

#endif
