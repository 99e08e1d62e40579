/* Times one contender: a shared library with `void race(const double *x, double *y)`.

   harness LIBRARY ROWS FEATURES OUTPUTS MODE PASSES
     ROWS      file of doubles, row by row
     MODE      values  writes the outputs of all rows as doubles to standard output
               warm    prints the median over PASSES of ns a call, all rows in a circle
               cold    prints the median over PASSES calls of ns a call, everything evicted before each
               count   calls each of the first PASSES rows once, for callgrind
*/
#define _GNU_SOURCE
#include <dlfcn.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <x86intrin.h>

typedef void call(const double *, double *);

#define EVICT (64u << 20)
#define BRANCHES 20000

/* Time that this process ran: others on the machine do not count. */
static double now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return t.tv_sec * 1e9 + t.tv_nsec;
}

static int compare(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static double median(double *values, int n)
{
    qsort(values, n, sizeof *values, compare);
    return values[n / 2];
}

/* The pages of the library leave the caches line by line; what it keeps on the heap goes with the walk below. */
static void flush_library(const char *path)
{
    char line[4096], access[8];
    char *real = realpath(path, NULL);
    FILE *maps = fopen("/proc/self/maps", "r");
    unsigned long from, to;
    while (fgets(line, sizeof line, maps))
        if (strstr(line, real) && sscanf(line, "%lx-%lx %7s", &from, &to, access) == 3 && access[0] == 'r')
            for (char *at = (char *)from; at < (char *)to; at += 64)
                _mm_clflush(at);
    fclose(maps);
    free(real);
}

static volatile uint32_t sink;

void evict(const char *path)
{
    static uint32_t *buffer, state = 1;
    if (!buffer) {
        buffer = malloc(EVICT);
        memset(buffer, 1, EVICT);
    }
    if (path)
        flush_library(path);
    for (size_t i = 0; i < EVICT / 4; i += 16)
        buffer[i]++;
    for (int i = 0; i < BRANCHES; i++) { /* what the branch predictor knew */
        state = state * 1664525u + 1013904223u;
        if (state & 0x10000)
            sink += i;
        if (state & 0x2000000)
            sink ^= state;
    }
    _mm_mfence();
}

static void nothing(const double *x, double *y)
{
    (void)x;
    (void)y;
}

static double ticks_per_ns(void)
{
    struct timespec t;
    double start, end;
    clock_gettime(CLOCK_MONOTONIC, &t);
    uint64_t first = __rdtsc();
    start = t.tv_sec * 1e9 + t.tv_nsec;
    do {
        clock_gettime(CLOCK_MONOTONIC, &t);
        end = t.tv_sec * 1e9 + t.tv_nsec;
    } while (end - start < 5e7);
    return (__rdtsc() - first) / (end - start);
}

static double one_call(call *race, const double *x, double *y)
{
    unsigned aux;
    _mm_lfence();
    uint64_t start = __rdtscp(&aux);
    _mm_lfence();
    race(x, y);
    uint64_t end = __rdtscp(&aux);
    _mm_lfence();
    return (double)(end - start);
}

int main(int argc, char **argv)
{
    if (argc != 7)
        return 2;
    int features = atoi(argv[3]), outputs = atoi(argv[4]), passes = atoi(argv[6]);
    void *library = dlopen(argv[1], RTLD_NOW | RTLD_LOCAL);
    if (!library) {
        fprintf(stderr, "%s\n", dlerror());
        return 1;
    }
    call *race = (call *)dlsym(library, "race");
    FILE *file = fopen(argv[2], "rb");
    fseek(file, 0, SEEK_END);
    int rows = (int)(ftell(file) / (features * sizeof(double)));
    rewind(file);
    double *x = malloc(sizeof(double) * rows * features), y[4096];
    if (!race || outputs > 4096 || fread(x, sizeof(double) * features, rows, file) != (size_t)rows)
        return 1;
    double *times = malloc(sizeof(double) * (passes + 1));
    if (!strcmp(argv[5], "values")) {
        for (int row = 0; row < rows; row++) {
            race(x + (size_t)row * features, y);
            fwrite(y, sizeof(double), outputs, stdout);
        }
    } else if (!strcmp(argv[5], "warm")) {
        int rounds = 1;
        for (;; rounds *= 2) { /* long enough for the clock */
            double start = now();
            for (int round = 0; round < rounds; round++)
                for (int row = 0; row < rows; row++)
                    race(x + (size_t)row * features, y);
            if (now() - start > 1e6)
                break;
        }
        for (int pass = 0; pass < passes; pass++) {
            double start = now();
            for (int round = 0; round < rounds; round++)
                for (int row = 0; row < rows; row++)
                    race(x + (size_t)row * features, y);
            times[pass] = (now() - start) / ((double)rounds * rows);
        }
        printf("%.3f\n", median(times, passes));
    } else if (!strcmp(argv[5], "cold")) {
        double scale = ticks_per_ns();
        race(x, y); /* what is made at the first call */
        for (int pass = 0; pass < passes; pass++)
            times[pass] = one_call(nothing, x, y);
        double overhead = median(times, passes);
        for (int pass = 0; pass < passes; pass++) {
            const double *row = x + (size_t)(pass % rows) * features;
            evict(argv[1]);
            times[pass] = one_call(race, row, y) - overhead;
        }
        printf("%.3f\n", median(times, passes) / scale);
    } else {
        race(x, y);
        for (int pass = 0; pass < passes; pass++)
            race(x + (size_t)(pass % rows) * features, y);
    }
    return 0;
}
