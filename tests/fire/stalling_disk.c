/* A disk that stalls: preloaded, it keeps writes and syncs of a write-ahead log waiting while the file named by
 * STALLED_WHILE is there, as a busy or failing disk does. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/types.h>
#include <unistd.h>

static void stall(int file)
{
    const char *while_there = getenv("STALLED_WHILE");
    char link[64], path[4096];
    if (while_there == NULL)
        return;
    snprintf(link, sizeof link, "/proc/self/fd/%d", file);
    ssize_t length = readlink(link, path, sizeof path - 1);
    if (length < 4)
        return;
    path[length] = '\0';
    if (strcmp(path + length - 4, "-wal") != 0)
        return;
    while (access(while_there, F_OK) == 0)
        usleep(5000);
}

int fdatasync(int file)
{
    int (*real)(int) = (int (*)(int))dlsym(RTLD_NEXT, "fdatasync");
    stall(file);
    return real(file);
}

ssize_t pwrite64(int file, const void *bytes, size_t count, off64_t at)
{
    ssize_t (*real)(int, const void *, size_t, off64_t) =
        (ssize_t(*)(int, const void *, size_t, off64_t))dlsym(RTLD_NEXT, "pwrite64");
    stall(file);
    return real(file, bytes, count, at);
}

ssize_t pwrite(int file, const void *bytes, size_t count, off_t at)
{
    ssize_t (*real)(int, const void *, size_t, off_t) =
        (ssize_t(*)(int, const void *, size_t, off_t))dlsym(RTLD_NEXT, "pwrite");
    stall(file);
    return real(file, bytes, count, at);
}
