/* Vulkan functions, by the host's GetProcAddr into the context's own table: the library links no loader. */
#include "context.h"

bool chiaro_functions_load(ChiaroVulkan *context)
{
    PFN_vkGetInstanceProcAddr instance_proc = context->desc.get_instance_proc_addr;
    VkInstance instance = context->desc.instance;
    VulkanFunctions *vk = &context->vk;
    bool complete = true;
    PFN_vkGetDeviceProcAddr device_proc = (PFN_vkGetDeviceProcAddr)instance_proc(instance, "vkGetDeviceProcAddr");
    if (!device_proc)
        return false;
#define X(name) complete &= (vk->name = (PFN_vk##name)device_proc(context->desc.device, "vk" #name)) != NULL;
    CHIARO_DEVICE_FUNCTIONS(X)
#undef X
#define X(name) complete &= (vk->name = (PFN_vk##name)instance_proc(instance, "vk" #name)) != NULL;
    X(GetPhysicalDeviceFormatProperties)
    X(GetPhysicalDeviceMemoryProperties)
    X(GetPhysicalDeviceProperties)
#undef X
    return complete;
}
