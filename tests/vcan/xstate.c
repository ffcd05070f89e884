/*
 * Lets the user-mode kernel of Debian 12 run on processors whose registers are larger than it knows.
 *
 * That kernel saves 2696 bytes of a process's extended registers: all there were up to AVX-512. Where a processor has the
 * tile registers (AMX) as well, Linux takes back nothing but the whole, 11008 bytes, and the user-mode kernel panics at
 * its first process: "ptrace set fp regs failed, errno = 14". Loaded before it (LD_PRELOAD), this fills up what it writes
 * with what the process has.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <elf.h>
#include <stdarg.h>
#include <string.h>
#include <sys/ptrace.h>
#include <sys/types.h>
#include <sys/uio.h>

typedef long (*call)(int request, pid_t process, void *address, void *data);

static call real;

/* One is enough: the user-mode kernel has one processor, and asks from its one thread. */
static char whole[65536] __attribute__((aligned(64)));

__attribute__((constructor)) static void find(void) {
    *(void **)&real = dlsym(RTLD_NEXT, "ptrace");
}

long ptrace(enum __ptrace_request request, ...) {
    va_list rest;
    va_start(rest, request);
    pid_t process = va_arg(rest, pid_t);
    void *address = va_arg(rest, void *);
    void *data = va_arg(rest, void *);
    va_end(rest);

    if (request == PTRACE_SETREGSET && (unsigned long)address == NT_X86_XSTATE) {
        const struct iovec *given = data;
        struct iovec all = { whole, sizeof whole };
        if (real(PTRACE_GETREGSET, process, address, &all) == 0 && all.iov_len > given->iov_len) {
            memcpy(whole, given->iov_base, given->iov_len);
            return real(request, process, address, &all);
        }
    }
    return real((int)request, process, address, data);
}
