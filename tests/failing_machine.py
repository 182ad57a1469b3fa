"""A machine that fails under a process: its disk, or its clock, by a library before the C library's calls.

Also for trying by hand, on Linux with a compiler of C:

    python tests/failing_machine.py /tmp
    LD_PRELOAD=/tmp/failing.so EIO_READ=runs.sqlite GOES_WELL=3 shefex-nav report DIR
"""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

needed = pytest.mark.skipif(
    sys.platform != "linux" or not shutil.which("cc"), reason="needs Linux and a compiler of C"
)
SOURCE = r"""
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

/* EIO_READ, EIO_WRITE, EIO_SYNC: part of the names of the files that a disk does not read, write, sync;
   GOES_WELL: calls before the first that fails, 0 if it is not set */
static int fails(int file, const char *kind)
{
    const char *which = getenv(kind), *good = getenv("GOES_WELL");
    char link[64], path[4096];
    static long calls;
    ssize_t length;
    if (!which) return 0;
    snprintf(link, sizeof link, "/proc/self/fd/%d", file);
    if ((length = readlink(link, path, sizeof path - 1)) < 0) return 0;
    path[length] = 0;
    if (!strstr(path, which) || calls++ < (good ? atol(good) : 0)) return 0;
    errno = EIO;
    return 1;
}

#define NEXT(name) static __typeof__(name) *next; if (!next) next = dlsym(RTLD_NEXT, #name)
ssize_t read(int f, void *to, size_t n) { NEXT(read); return fails(f, "EIO_READ") ? -1 : next(f, to, n); }
ssize_t pread(int f, void *to, size_t n, off_t at)
{ NEXT(pread); return fails(f, "EIO_READ") ? -1 : next(f, to, n, at); }
ssize_t pread64(int f, void *to, size_t n, off64_t at)
{ NEXT(pread64); return fails(f, "EIO_READ") ? -1 : next(f, to, n, at); }
ssize_t write(int f, const void *of, size_t n)
{ NEXT(write); return fails(f, "EIO_WRITE") ? -1 : next(f, of, n); }
ssize_t pwrite(int f, const void *of, size_t n, off_t at)
{ NEXT(pwrite); return fails(f, "EIO_WRITE") ? -1 : next(f, of, n, at); }
ssize_t pwrite64(int f, const void *of, size_t n, off64_t at)
{ NEXT(pwrite64); return fails(f, "EIO_WRITE") ? -1 : next(f, of, n, at); }
int fsync(int f) { NEXT(fsync); return fails(f, "EIO_SYNC") ? -1 : next(f); }
int fdatasync(int f) { NEXT(fdatasync); return fails(f, "EIO_SYNC") ? -1 : next(f); }

/* CLOCK_BACK: s by which the clock is set back a second after the first look at it */
static long back_s(void)
{
    static struct timespec begin;
    struct timespec now;
    const char *back = getenv("CLOCK_BACK");
    if (!back || clock_gettime(CLOCK_MONOTONIC, &now)) return 0;
    if (!begin.tv_sec) begin = now;
    return now.tv_sec - begin.tv_sec >= 1 ? atol(back) : 0;
}
int clock_gettime(clockid_t which, struct timespec *now)
{
    NEXT(clock_gettime);
    int failed = next(which, now);
    if (!failed && which == CLOCK_REALTIME) now->tv_sec -= back_s();
    return failed;
}
time_t time(time_t *to)
{
    struct timespec now;
    clock_gettime(CLOCK_REALTIME, &now);
    return to ? *to = now.tv_sec : now.tv_sec;
}
int gettimeofday(struct timeval *restrict to, void *restrict zone)
{
    NEXT(gettimeofday);
    int failed = next(to, zone);
    if (!failed) to->tv_sec -= back_s();
    return failed;
}
"""


def library(folder):
    """Make the library in a folder. -> path"""
    source, made = folder / "failing.c", folder / "failing.so"
    source.write_text(SOURCE)
    subprocess.run(["cc", "-shared", "-fPIC", "-O1", "-o", made, source, "-ldl"], check=True)
    return made


def environment(made, **settings):
    """Variables of a process on such a machine. made : of `library`, no blank in it;  settings : of SOURCE"""
    return {"LD_PRELOAD": str(made)} | {name: str(value) for name, value in settings.items()}


if __name__ == "__main__":
    print(library(Path(sys.argv[1])))
