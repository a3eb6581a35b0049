/* Whole files: mapped for reading, replaced atomically for writing, so that no reader ever sees half a file. */
#include "io_error.h"

#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

bool chiaro_io_map(const char *path, ChiaroIoFile *file, ChiaroIoError *error)
{
    struct stat status;
    /* O_NONBLOCK: opening a pipe that nobody writes to must not hang. */
    int descriptor = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK);
    *file = (ChiaroIoFile){0};
    if (descriptor < 0)
        return chiaro_io_fail(error, path, "cannot be opened: %s", strerror(errno));
    if (fstat(descriptor, &status) != 0 || !S_ISREG(status.st_mode)) {
        close(descriptor);
        return chiaro_io_fail(error, path, "is not a regular file");
    }
    if (status.st_size <= 0) {
        close(descriptor);
        return chiaro_io_fail(error, path, "is empty");
    }
    void *data = mmap(NULL, (size_t)status.st_size, PROT_READ, MAP_PRIVATE, descriptor, 0);
    int fault = errno;
    close(descriptor);
    if (data == MAP_FAILED)
        return chiaro_io_fail(error, path, "cannot be mapped: %s", strerror(fault));
    *file = (ChiaroIoFile){data, (size_t)status.st_size};
    return true;
}

void chiaro_io_unmap(ChiaroIoFile *file)
{
    if (file->data)
        munmap((void *)(uintptr_t)file->data, file->size);
    *file = (ChiaroIoFile){0};
}

/* Creates a file beside `path` that did not exist; its mode follows the umask, as mkstemp's would not. */
static int create_beside(const char *path, char *name, size_t name_size)
{
    for (unsigned attempt = 0; attempt < 1000; attempt++) {
        int length = snprintf(name, name_size, "%s.%ld-%u.tmp", path, (long)getpid(), attempt);
        if (length < 0 || (size_t)length >= name_size) {
            errno = ENAMETOOLONG;
            return -1;
        }
        int descriptor = open(name, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
        if (descriptor >= 0 || errno != EEXIST)
            return descriptor;
    }
    return -1;
}

static bool write_all(int descriptor, const unsigned char *data, size_t size)
{
    while (size > 0) {
        ssize_t written = write(descriptor, data, size);
        if (written < 0 && errno == EINTR)
            continue;
        if (written <= 0)
            return false;
        data += written;
        size -= (size_t)written;
    }
    return true;
}

bool chiaro_io_write_file(const char *path, const void *data, size_t size, ChiaroIoError *error)
{
    struct stat status;
    /* Renaming onto a device, say /dev/null, would replace the device by a file. */
    if (stat(path, &status) == 0 && !S_ISREG(status.st_mode))
        return chiaro_io_fail(error, path, "cannot be written: it exists and is not a regular file");
    size_t name_size = strlen(path) + 64;
    char *name = malloc(name_size);
    if (!name)
        return chiaro_io_fail(error, path, "out of memory");
    int descriptor = create_beside(path, name, name_size);
    bool created = descriptor >= 0, done = created && write_all(descriptor, data, size);
    int fault = errno;
    if (created && close(descriptor) != 0 && done) {
        done = false;
        fault = errno;
    }
    if (done && rename(name, path) != 0) {
        done = false;
        fault = errno;
    }
    if (created && !done)
        unlink(name);
    free(name);
    return done || chiaro_io_fail(error, path, "cannot be written: %s", strerror(fault));
}
