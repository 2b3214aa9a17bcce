/* Loaded before the C library: counts the calls that change or open files below one folder, and refuses one.
 *
 * The counts are in a file that all processes map, so that calls of child processes count too.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <unistd.h>

struct plan {
  long calls;        /* so far */
  long refused;      /* the call to refuse, counted from 1; 0: none */
  int error;         /* its errno */
  char folder[1024]; /* ends with a slash */
  char what[1024];   /* the call that was refused, and its file */
};
static struct plan *plan;

int use_plan(const char *path) {
  int file = syscall(SYS_openat, AT_FDCWD, path, O_RDWR);
  void *found = mmap(NULL, sizeof(struct plan), PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
  syscall(SYS_close, file);
  if (found == MAP_FAILED) return -1;
  plan = found;
  return 0;
}

__attribute__((constructor)) static void begin(void) {
  const char *path = getenv("STRANDCAST_REFUSED_CALLS");
  if (path) use_plan(path);
}

/* Return whether this call fails, with errno set. A full disk stays full; other faults pass. */
static int fails(const char *call, const char *path, int writing) {
  if (!path || strncmp(path, plan->folder, strlen(plan->folder))) return 0;
  long number = __atomic_add_fetch(&plan->calls, 1, __ATOMIC_SEQ_CST);
  if (!plan->refused || number < plan->refused) return 0;
  int full = plan->error == ENOSPC || plan->error == EDQUOT;
  if (number > plan->refused && !(full && writing)) return 0;
  if (number == plan->refused) snprintf(plan->what, sizeof plan->what, "%s %s", call, path);
  errno = full && !writing ? EIO : plan->error;
  return 1;
}

static int fails_at(const char *call, const char *path, int writing) {
  char whole[PATH_MAX];
  if (!plan) return 0;
  if (path && path[0] != '/') {
    char here[PATH_MAX];
    if (!getcwd(here, sizeof here)) return 0;
    snprintf(whole, sizeof whole, "%.2000s/%.2000s", here, path);
    path = whole;
  }
  return fails(call, path, writing);
}

static int fails_on(const char *call, int file) {
  char link[64], path[PATH_MAX];
  if (!plan) return 0;
  snprintf(link, sizeof link, "/proc/self/fd/%d", file);
  long length = syscall(SYS_readlinkat, AT_FDCWD, link, path, sizeof path - 1);
  if (length < 0) return 0;
  path[length] = 0;
  return fails(call, path, (fcntl(file, F_GETFL) & O_ACCMODE) != O_RDONLY);
}

#define REAL(name) ((__typeof__(name) *)dlsym(RTLD_NEXT, #name))

#define OPEN(name)                                                              \
  int name(const char *path, int flags, ...) {                                  \
    va_list rest;                                                               \
    va_start(rest, flags);                                                      \
    mode_t mode = flags & (O_CREAT | O_TMPFILE) ? va_arg(rest, mode_t) : 0;     \
    va_end(rest);                                                               \
    if (fails_at("open", path, (flags & O_ACCMODE) != O_RDONLY)) return -1;     \
    return REAL(name)(path, flags, mode);                                       \
  }
OPEN(open)
OPEN(open64)

#define OPENAT(name)                                                            \
  int name(int folder, const char *path, int flags, ...) {                      \
    va_list rest;                                                               \
    va_start(rest, flags);                                                      \
    mode_t mode = flags & (O_CREAT | O_TMPFILE) ? va_arg(rest, mode_t) : 0;     \
    va_end(rest);                                                               \
    if (fails_at("open", path, (flags & O_ACCMODE) != O_RDONLY)) return -1;     \
    return REAL(name)(folder, path, flags, mode);                               \
  }
OPENAT(openat)
OPENAT(openat64)

#define FOPEN(name)                                                             \
  FILE *name(const char *path, const char *mode) {                              \
    if (fails_at("open", path, mode[0] != 'r')) return NULL;                    \
    return REAL(name)(path, mode);                                              \
  }
FOPEN(fopen)
FOPEN(fopen64)

ssize_t write(int file, const void *data, size_t size) {
  return fails_on("write", file) ? -1 : REAL(write)(file, data, size);
}
ssize_t writev(int file, const struct iovec *parts, int count) {
  return fails_on("write", file) ? -1 : REAL(writev)(file, parts, count);
}
ssize_t pwrite(int file, const void *data, size_t size, off_t at) {
  return fails_on("write", file) ? -1 : REAL(pwrite)(file, data, size, at);
}
ssize_t pwrite64(int file, const void *data, size_t size, off64_t at) {
  return fails_on("write", file) ? -1 : REAL(pwrite64)(file, data, size, at);
}
int fsync(int file) { return fails_on("fsync", file) ? -1 : REAL(fsync)(file); }
int fdatasync(int file) { return fails_on("fsync", file) ? -1 : REAL(fdatasync)(file); }

int rename(const char *from, const char *to) {
  return fails_at("rename", to, 1) ? -1 : REAL(rename)(from, to);
}
int renameat(int from_folder, const char *from, int to_folder, const char *to) {
  return fails_at("rename", to, 1) ? -1 : REAL(renameat)(from_folder, from, to_folder, to);
}

/* As on network file systems: the file is closed, but what was written to it may be lost. */
int close(int file) {
  int failed = fails_on("close", file), error = errno;
  int ended = REAL(close)(file);
  if (!failed) return ended;
  errno = error;
  return -1;
}
