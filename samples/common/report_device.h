/* The device of a report: a host without a window, and frames on it. */
#ifndef CHIARO_REPORT_DEVICE_H
#define CHIARO_REPORT_DEVICE_H

#include "device.h"
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
/* A context with a scene and the report's sky. */
ChiaroVulkan *report_load(ReportDevice *device, const ChiaroTransport *transport, bool gi_off);
void report_set_component(const ReportDevice *device, ChiaroVulkan *chiaro, ChiaroComponent component, bool gi_off);
/* Milliseconds of a frame; those that are not wanted may be NULL. */
typedef struct ReportFrame {
    double all, update, record; /* by the clock; by the device's clock; of update() on the CPU */
} ReportFrame;
ReportFrame report_frame(ReportDevice *device, ChiaroVulkan *chiaro, bool read);
/* What the last frame that was read shows: the host's pixels, until the next one. */
ChiaroIoImage report_pixels(const ReportDevice *device);

#endif
