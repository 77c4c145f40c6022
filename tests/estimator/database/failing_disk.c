/* Preloaded into a process: from the n-th call on that changes the watched file, so many of them fail. See failing_disk.py. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include <sys/types.h>
#include <unistd.h>

static char watched[256];
static long calls, first, count;
static int error;

void disk_watch(const char *name) { calls = 0; snprintf(watched, sizeof watched, "%s", name); }
void disk_fail(long from, long many, int number) { first = from; count = many; error = number; }
long disk_calls(void) { return calls; }

static int fails(const char *path) {
  if (!watched[0] || !path || !strstr(path, watched)) return 0;
  calls++;
  if (calls < first || calls >= first + count) return 0;
  errno = error;
  return 1;
}
static int fails_fd(int fd) {
  char link[64], path[4096];
  if (!watched[0]) return 0;
  snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
  ssize_t n = readlink(link, path, sizeof path - 1);
  if (n < 0) return 0;
  path[n] = 0;
  return fails(path);
}
#define REAL(name) ((__typeof__(&name))dlsym(RTLD_NEXT, #name))
#define BY_FD(type, name, parameters, arguments) \
  type name parameters { return fails_fd(fd) ? (type)-1 : REAL(name) arguments; }

BY_FD(ssize_t, write, (int fd, const void *b, size_t n), (fd, b, n))
BY_FD(ssize_t, pwrite, (int fd, const void *b, size_t n, off_t at), (fd, b, n, at))
BY_FD(ssize_t, pwrite64, (int fd, const void *b, size_t n, off64_t at), (fd, b, n, at))
BY_FD(int, fsync, (int fd), (fd))
BY_FD(int, fdatasync, (int fd), (fd))
BY_FD(int, ftruncate, (int fd, off_t n), (fd, n))
BY_FD(int, ftruncate64, (int fd, off64_t n), (fd, n))

int unlink(const char *path) { return fails(path) ? -1 : REAL(unlink)(path); }

#define OPEN(name) \
  int name(const char *path, int flags, ...) { \
    va_list more; \
    va_start(more, flags); \
    mode_t mode = va_arg(more, mode_t); \
    va_end(more); \
    if ((flags & (O_WRONLY | O_RDWR | O_CREAT)) && fails(path)) return -1; \
    return REAL(name)(path, flags, mode); \
  }
OPEN(open)
OPEN(open64)
