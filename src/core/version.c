/* What the library says about itself: its version and the texts of results and log items. */
#include "chiaro/chiaro.h"

uint32_t chiaro_version(void) { return CHIARO_VERSION; }

const char *chiaro_result_text(ChiaroResult result)
{
    switch (result) {
    case CHIARO_OK: return "no error";
    case CHIARO_ERROR_ARGUMENT: return "an argument is out of range";
    case CHIARO_ERROR_MEMORY: return "out of memory";
    case CHIARO_ERROR_SCENE: return "the scene cannot be used";
    case CHIARO_ERROR_DATA: return "the baked data is damaged";
    case CHIARO_ERROR_VERSION: return "made for another version";
    case CHIARO_ERROR_INTERRUPTED: return "interrupted";
    case CHIARO_ERROR_DEVICE: return "the device refused";
    case CHIARO_ERROR_UNSUPPORTED: return "the device lacks a feature";
    }
    return "unknown result";
}

const char *chiaro_log_item_text(ChiaroLogItem item)
{
    switch (item) {
#define X(id, text) \
    case CHIARO_LOG_##id: return text;
        CHIARO_LOG_ITEMS(X)
#undef X
    case CHIARO_LOG_ITEM_COUNT: break;
    }
    return "unknown message";
}
