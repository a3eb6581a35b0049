/* OpenEXR through its C library: reads whatever holds plain colour, writes 32-bit float ZIP. */
#include "exr_dwa.h"
#include "io_error.h"

#include <openexr.h>
#include <stdlib.h>

/* The library checks a header against these before it allocates anything. */
enum { MAX_SIDE = 65536, MAX_TILE = 8192 };
#define MAX_PIXELS (UINT64_C(1) << 28)

/* Faults come back as codes; the library must not print. */
static void stay_silent(exr_const_context_t context, exr_result_t code, const char *message)
{
    (void)context, (void)code, (void)message;
}

static exr_context_initializer_t context_settings(void *user)
{
    exr_context_initializer_t settings = EXR_DEFAULT_CONTEXT_INITIALIZER;
    settings.error_handler_fn = stay_silent;
    settings.user_data = user;
    settings.max_image_width = settings.max_image_height = MAX_SIDE;
    settings.max_tile_width = settings.max_tile_height = MAX_TILE;
    settings.zip_level = 4;
    /* Half a picture is a damaged picture. */
    settings.flags = EXR_CONTEXT_FLAG_DISABLE_CHUNK_RECONSTRUCTION;
    return settings;
}

/* ------------------------------------------------------------------------------------------------------------------
 * Reading
 */

static int64_t read_mapped(exr_const_context_t context, void *user, void *buffer, uint64_t size, uint64_t offset,
                           exr_stream_error_func_ptr_t report)
{
    const ChiaroIoFile *file = user;
    (void)context, (void)report;
    if (offset >= file->size)
        return 0;
    uint64_t rest = file->size - offset, count = size < rest ? size : rest;
    memcpy(buffer, (const char *)file->data + offset, (size_t)count);
    return (int64_t)count;
}

static int64_t mapped_size(exr_const_context_t context, void *user)
{
    (void)context;
    return (int64_t)((const ChiaroIoFile *)user)->size;
}

/* Which float of a pixel a channel goes to: R, G, B, A, or Y (grey, copied to all three later); -1: none of ours. */
static int channel_slot(const char *name)
{
    static const char names[] = "RGBA";
    const char *found = name[0] && !name[1] ? strchr(names, name[0]) : NULL;
    return found ? (int)(found - names) : strcmp(name, "Y") == 0 ? 0 : -1;
}

/* A part as the decoder needs it. */
typedef struct Part {
    exr_context_t context;
    exr_storage_t storage;
    exr_attr_box2i_t window;
    bool grey;
    /* Where channels are decoded to, one plane each: the library's short cut from four halves to interleaved floats
     * swaps them (3.1). */
    float *planes;
} Part;

/* Decodes one chunk to its place. `left` and `top` count from the window's corner. */
static exr_result_t decode_chunk(const Part *part, const exr_chunk_info_t *chunk, int left, int top,
                                 exr_decode_pipeline_t *decoder, bool *first, const ChiaroIoImage *image)
{
    exr_result_t result = *first ? exr_decoding_initialize(part->context, 0, chunk, decoder)
                                 : exr_decoding_update(part->context, 0, chunk, decoder);
    if (result != EXR_ERR_SUCCESS)
        return result;
    size_t plane = (size_t)image->width * image->height, pixel = (size_t)top * image->width + (size_t)left;
    for (int16_t c = 0; c < decoder->channel_count; c++) {
        exr_coding_channel_info_t *channel = &decoder->channels[c];
        int slot = channel_slot(channel->channel_name);
        bool luminance = strcmp(channel->channel_name, "Y") == 0;
        bool wanted = slot >= 0 && slot < (int)image->channels && (!luminance || part->grey);
        channel->decode_to_ptr = wanted ? (uint8_t *)(part->planes + (size_t)slot * plane + pixel) : NULL;
        channel->user_data_type = EXR_PIXEL_FLOAT;
        channel->user_bytes_per_element = sizeof(float);
        channel->user_pixel_stride = sizeof(float);
        channel->user_line_stride = (int32_t)(image->width * sizeof(float));
    }
    if (*first)
        result = exr_decoding_choose_default_routines(part->context, 0, decoder);
    *first = false;
    return result == EXR_ERR_SUCCESS ? exr_decoding_run(part->context, 0, decoder) : result;
}

static exr_result_t decode_lines(const Part *part, exr_decode_pipeline_t *decoder, bool *first,
                                 const ChiaroIoImage *image)
{
    int32_t step = 0;
    exr_chunk_info_t chunk;
    exr_result_t result = exr_get_scanlines_per_chunk(part->context, 0, &step);
    if (result == EXR_ERR_SUCCESS && step < 1)
        return EXR_ERR_FILE_BAD_HEADER;
    for (int64_t top = 0; top < image->height && result == EXR_ERR_SUCCESS; top += step) {
        result = exr_read_scanline_chunk_info(part->context, 0, part->window.min.y + (int)top, &chunk);
        if (result == EXR_ERR_SUCCESS)
            result = decode_chunk(part, &chunk, 0, (int)top, decoder, first, image);
    }
    return result;
}

/* Only the finest level. */
static exr_result_t decode_tiles(const Part *part, exr_decode_pipeline_t *decoder, bool *first,
                                 const ChiaroIoImage *image)
{
    int32_t tile_width = 0, tile_height = 0;
    exr_chunk_info_t chunk;
    exr_result_t result = exr_get_tile_sizes(part->context, 0, 0, 0, &tile_width, &tile_height);
    if (result == EXR_ERR_SUCCESS && (tile_width < 1 || tile_height < 1))
        return EXR_ERR_FILE_BAD_HEADER;
    for (int64_t top = 0; top < image->height && result == EXR_ERR_SUCCESS; top += tile_height)
        for (int64_t left = 0; left < image->width && result == EXR_ERR_SUCCESS; left += tile_width) {
            result = exr_read_tile_chunk_info(part->context, 0, (int)(left / tile_width), (int)(top / tile_height), 0,
                                              0, &chunk);
            if (result == EXR_ERR_SUCCESS)
                result = decode_chunk(part, &chunk, (int)left, (int)top, decoder, first, image);
        }
    return result;
}

/* Looks at the header; fills the part and the size of the image. NULL, or what speaks against the file. */
static const char *inspect(Part *part, ChiaroIoImage *image)
{
    int parts = 0;
    bool found[4] = {false}, grey = false;
    const exr_attr_chlist_t *channels = NULL;
    if (exr_get_count(part->context, &parts) != EXR_ERR_SUCCESS || parts != 1)
        return "has several parts; only one is supported";
    if (exr_get_storage(part->context, 0, &part->storage) != EXR_ERR_SUCCESS ||
        (part->storage != EXR_STORAGE_SCANLINE && part->storage != EXR_STORAGE_TILED))
        return "holds deep data, not an image";
    if (exr_get_channels(part->context, 0, &channels) != EXR_ERR_SUCCESS ||
        exr_get_data_window(part->context, 0, &part->window) != EXR_ERR_SUCCESS)
        return "has a damaged header";
    int64_t width = (int64_t)part->window.max.x - part->window.min.x + 1;
    int64_t height = (int64_t)part->window.max.y - part->window.min.y + 1;
    if (width < 1 || height < 1 || width > MAX_SIDE || height > MAX_SIDE ||
        (uint64_t)width * (uint64_t)height > MAX_PIXELS)
        return "has a size out of range";
    for (int c = 0; c < channels->num_channels; c++) {
        const exr_attr_chlist_entry_t *entry = &channels->entries[c];
        int slot = channel_slot(entry->name.str);
        if (slot < 0)
            continue;
        if (entry->x_sampling != 1 || entry->y_sampling != 1)
            return "has subsampled channels";
        if (strcmp(entry->name.str, "Y") == 0)
            grey = true;
        else
            found[slot] = true;
    }
    bool colour = found[0] && found[1] && found[2];
    if (!colour && !grey)
        return "has neither the channels R, G, B nor Y";
    part->grey = !colour;
    image->width = (uint32_t)width;
    image->height = (uint32_t)height;
    image->channels = found[3] ? 4 : 3;
    return NULL;
}

static void interleave(const Part *part, ChiaroIoImage *image)
{
    size_t count = (size_t)image->width * image->height;
    for (uint32_t c = 0; c < image->channels; c++) {
        const float *plane = part->planes + (part->grey && c < 3 ? 0 : c) * count;
        for (size_t i = 0; i < count; i++)
            image->pixels[i * image->channels + c] = plane[i];
    }
}

/* Everything behind the header. NULL, or the fault. */
static const char *read_pixels(const char *path, Part *part, ChiaroIoImage *image)
{
    exr_decode_pipeline_t decoder = EXR_DECODE_PIPELINE_INITIALIZER;
    bool first = true;
    size_t count = (size_t)image->width * image->height;
    image->pixels = malloc(count * image->channels * sizeof(float));
    part->planes = calloc(count, image->channels * sizeof(float));
    if (!image->pixels || !part->planes)
        return "out of memory";
    exr_result_t result =
        (part->storage == EXR_STORAGE_TILED ? decode_tiles : decode_lines)(part, &decoder, &first, image);
    if (!first)
        exr_decoding_destroy(part->context, &decoder);
    if (result == EXR_ERR_FEATURE_NOT_IMPLEMENTED)
        return chiaro_io_read_exr_dwa(path, part->window.min.x, part->window.min.y, image);
    if (result != EXR_ERR_SUCCESS)
        return exr_get_default_error_message(result);
    interleave(part, image);
    return NULL;
}

bool chiaro_io_read_exr(const char *path, ChiaroIoImage *image, ChiaroIoError *error)
{
    ChiaroIoFile file;
    Part part = {0};
    *image = (ChiaroIoImage){0};
    if (!chiaro_io_map(path, &file, error))
        return false;
    exr_context_initializer_t settings = context_settings(&file);
    settings.read_fn = read_mapped;
    settings.size_fn = mapped_size;
    const char *fault = "is not an OpenEXR file, or a damaged one";
    if (exr_start_read(&part.context, path, &settings) == EXR_ERR_SUCCESS) {
        fault = inspect(&part, image);
        if (!fault)
            fault = read_pixels(path, &part, image);
    }
    exr_finish(&part.context);
    chiaro_io_unmap(&file);
    free(part.planes);
    if (fault) {
        free(image->pixels);
        *image = (ChiaroIoImage){0};
        return chiaro_io_fail(error, path, "%s", fault);
    }
    return true;
}

/* ------------------------------------------------------------------------------------------------------------------
 * Writing: into memory first, so that the file appears whole or not at all
 */

typedef struct Memory {
    unsigned char *data;
    size_t size, capacity;
} Memory;

static int64_t write_memory(exr_const_context_t context, void *user, const void *buffer, uint64_t size,
                            uint64_t offset, exr_stream_error_func_ptr_t report)
{
    Memory *memory = user;
    (void)context, (void)report;
    if (size > SIZE_MAX / 4 || offset > SIZE_MAX / 4)
        return -1;
    size_t end = (size_t)(offset + size);
    if (end > memory->capacity) {
        size_t capacity = end > memory->capacity * 2 ? end : memory->capacity * 2;
        unsigned char *data = realloc(memory->data, capacity);
        if (!data)
            return -1;
        memset(data + memory->capacity, 0, capacity - memory->capacity);
        memory->data = data;
        memory->capacity = capacity;
    }
    memcpy(memory->data + offset, buffer, (size_t)size);
    if (end > memory->size)
        memory->size = end;
    return (int64_t)size;
}

static exr_result_t write_header(exr_context_t context, const ChiaroIoImage *image)
{
    static const char *const names[] = {"A", "B", "G", "R"}; /* The format wants them sorted. */
    int part = 0;
    exr_result_t result = exr_add_part(context, "image", EXR_STORAGE_SCANLINE, &part);
    if (result == EXR_ERR_SUCCESS)
        result = exr_initialize_required_attr_simple(context, part, (int32_t)image->width, (int32_t)image->height,
                                                     EXR_COMPRESSION_ZIP);
    for (size_t c = image->channels == 4 ? 0 : 1; c < 4 && result == EXR_ERR_SUCCESS; c++)
        result = exr_add_channel(context, part, names[c], EXR_PIXEL_FLOAT, EXR_PERCEPTUALLY_LOGARITHMIC, 1, 1);
    return result == EXR_ERR_SUCCESS ? exr_write_header(context) : result;
}

static exr_result_t encode_lines(exr_context_t context, const ChiaroIoImage *image, exr_encode_pipeline_t *encoder,
                                 bool *first)
{
    int32_t step = 0;
    exr_chunk_info_t chunk;
    exr_result_t result = exr_get_scanlines_per_chunk(context, 0, &step);
    for (int64_t top = 0; top < image->height && result == EXR_ERR_SUCCESS; top += step) {
        result = exr_write_scanline_chunk_info(context, 0, (int)top, &chunk);
        if (result == EXR_ERR_SUCCESS)
            result = *first ? exr_encoding_initialize(context, 0, &chunk, encoder)
                            : exr_encoding_update(context, 0, &chunk, encoder);
        if (result != EXR_ERR_SUCCESS)
            break;
        const float *line = image->pixels + (size_t)top * image->width * image->channels;
        for (int16_t c = 0; c < encoder->channel_count; c++) {
            exr_coding_channel_info_t *channel = &encoder->channels[c];
            channel->encode_from_ptr = (const uint8_t *)(line + channel_slot(channel->channel_name));
            channel->user_data_type = EXR_PIXEL_FLOAT;
            channel->user_bytes_per_element = sizeof(float);
            channel->user_pixel_stride = (int32_t)(image->channels * sizeof(float));
            channel->user_line_stride = (int32_t)(image->width * image->channels * sizeof(float));
        }
        if (*first)
            result = exr_encoding_choose_default_routines(context, 0, encoder);
        *first = false;
        if (result == EXR_ERR_SUCCESS)
            result = exr_encoding_run(context, 0, encoder);
    }
    return result;
}

bool chiaro_io_write_exr(const char *path, const ChiaroIoImage *image, ChiaroIoError *error)
{
    Memory memory = {0};
    exr_context_t context = NULL;
    exr_encode_pipeline_t encoder = EXR_ENCODE_PIPELINE_INITIALIZER;
    bool first = true;
    if (image->width < 1 || image->height < 1 || image->width > MAX_SIDE || image->height > MAX_SIDE ||
        (uint64_t)image->width * image->height > MAX_PIXELS || (image->channels != 3 && image->channels != 4))
        return chiaro_io_fail(error, path, "cannot be written: an image of %u x %u with %u channels", image->width,
                              image->height, image->channels);
    exr_context_initializer_t settings = context_settings(&memory);
    settings.write_fn = write_memory;
    exr_result_t result = exr_start_write(&context, path, EXR_WRITE_FILE_DIRECTLY, &settings);
    if (result == EXR_ERR_SUCCESS) {
        result = write_header(context, image);
        if (result == EXR_ERR_SUCCESS)
            result = encode_lines(context, image, &encoder, &first);
        if (!first)
            exr_encoding_destroy(context, &encoder);
        exr_result_t finish = exr_finish(&context); /* Writes the table of chunks. */
        if (result == EXR_ERR_SUCCESS)
            result = finish;
    }
    bool done = result == EXR_ERR_SUCCESS
                    ? chiaro_io_write_file(path, memory.data, memory.size, error)
                    : chiaro_io_fail(error, path, "cannot be written: %s", exr_get_default_error_message(result));
    free(memory.data);
    return done;
}
