/* Memory that is refused once: the REFUSE-th large piece, from 0, that a program asks for, be it by whichever way. That it
   was refused is told by a file, REFUSED. For LD_PRELOAD, with the GNU C library. What libraries ask for before the program
   begins does not count: some do not take no for an answer then. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <unistd.h>

void *__libc_malloc(size_t size);
void *__libc_calloc(size_t count, size_t size);
void *__libc_realloc(void *memory, size_t size);
void *__libc_memalign(size_t alignment, size_t size);

enum { LARGE = 1 << 16 };

static atomic_long asked;
static int began;

static int refuses(size_t size)
{
    if (size < LARGE || !began)
        return 0;
    const char *which = getenv("REFUSE"), *told = getenv("REFUSED");
    if (!which || !told || atomic_fetch_add(&asked, 1) != atol(which))
        return 0;
    close(open(told, O_WRONLY | O_CREAT, 0600));
    errno = ENOMEM;
    return 1;
}

void *malloc(size_t size)
{
    return refuses(size) ? NULL : __libc_malloc(size);
}

void *calloc(size_t count, size_t size)
{
    size_t all;
    if (__builtin_mul_overflow(count, size, &all) || refuses(all))
        return NULL;
    return __libc_calloc(count, size);
}

void *realloc(void *memory, size_t size)
{
    return refuses(size) ? NULL : __libc_realloc(memory, size);
}

void *memalign(size_t alignment, size_t size)
{
    return refuses(size) ? NULL : __libc_memalign(alignment, size);
}

void *aligned_alloc(size_t alignment, size_t size)
{
    return memalign(alignment, size);
}

int posix_memalign(void **memory, size_t alignment, size_t size)
{
    void *given = memalign(alignment, size);
    if (!given)
        return ENOMEM;
    *memory = given;
    return 0;
}

void *mmap(void *at, size_t size, int protection, int flags, int file, off_t offset)
{
    if ((flags & MAP_ANONYMOUS) && refuses(size))
        return MAP_FAILED;
    return (void *)syscall(SYS_mmap, at, size, protection, flags, file, offset);
}

void *mmap64(void *at, size_t size, int protection, int flags, int file, off_t offset)
{
    return mmap(at, size, protection, flags, file, offset);
}

/* The program's own code begins here: libraries have been made ready before. */
int __libc_start_main(int (*program)(int, char **, char **), int count, char **arguments, void (*init)(void),
                      void (*fini)(void), void (*loader_fini)(void), void *stack)
{
    int (*start)(int (*)(int, char **, char **), int, char **, void (*)(void), void (*)(void), void (*)(void), void *);
    *(void **)&start = dlsym(RTLD_NEXT, "__libc_start_main");
    began = 1;
    return start(program, count, arguments, init, fini, loader_fini, stack);
}
