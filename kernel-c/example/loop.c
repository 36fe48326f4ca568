/* A real-time loop around the kernel: plays frames from a file, one a cycle, on a robot that follows perfectly.
 *
 *     loop FRAMES
 *
 * Where this program has its robot, a real one has its link: what tick says is sent, what the robot answers becomes the next
 * cycle's sensors. Ends with 0 when all frames are played and the arm is at rest, and says what it put out as one hash.
 */
#define _GNU_SOURCE

#include "../screed_kernel.h"

#include <errno.h>
#include <inttypes.h>
#include <sched.h>
#include <stdalign.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <time.h>

#define PERIOD_NS 2000000L /* as configured in the frames */
#define CYCLES_MAX 30000L  /* a minute: something is wrong by then */
#define FRAMES_MAX (1 << 20)

/* The kernel lives here: nothing is allocated once the loop runs. */
static alignas(16) unsigned char memory[1 << 20];
static uint8_t frames[FRAMES_MAX];

static uint64_t hash = UINT64_C(0xcbf29ce484222325); /* FNV-1a */

static void hash_bytes(const void *data, size_t len)
{
    const uint8_t *bytes = data;
    for (size_t i = 0; i < len; i++) {
        hash = (hash ^ bytes[i]) * UINT64_C(0x100000001b3);
    }
}

static uint64_t ns_of(const struct timespec *time)
{
    return (uint64_t)time->tv_sec * UINT64_C(1000000000) + (uint64_t)time->tv_nsec;
}

static int64_t ns_since(const struct timespec *from, const struct timespec *to)
{
    return (int64_t)(to->tv_sec - from->tv_sec) * 1000000000 + (to->tv_nsec - from->tv_nsec);
}

/* Waits for the next slot of the grid. A slot that has passed already stays lost; returns how many. */
static long wait_for_slot(struct timespec *slot)
{
    long lost = -1;
    struct timespec now;
    do {
        slot->tv_nsec += PERIOD_NS;
        if (slot->tv_nsec >= 1000000000L) {
            slot->tv_nsec -= 1000000000L;
            slot->tv_sec++;
        }
        lost++;
        clock_gettime(CLOCK_MONOTONIC, &now);
    } while (ns_since(slot, &now) >= 0);
    while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, slot, NULL) == EINTR) {
    }
    return lost;
}

static void be_real_time(void)
{
    const struct sched_param param = {.sched_priority = 50};
    if (mlockall(MCL_CURRENT | MCL_FUTURE) != 0 || sched_setscheduler(0, SCHED_FIFO, &param) != 0) {
        printf("NON-RT: memory is not locked or SCHED_FIFO is refused (%s)\n", strerror(errno));
    }
}

static void print_cycle(const screed_command *command, uint64_t tick)
{
    printf("tick %5" PRIu64 "  mode %u  seq %5" PRIu32 "  rate %.2f ", tick, command->mode, command->seq, command->rate);
    for (int j = 0; j < SCREED_JOINTS; j++) {
        printf(" %9.6f", command->joints[j]);
    }
    printf("\n");
}

/* The frame that begins at `at`, its zero byte included; 0 when there is none. */
static size_t frame_length(size_t at, size_t len)
{
    const uint8_t *end = at < len ? memchr(frames + at, 0, len - at) : NULL;
    return end == NULL ? 0 : (size_t)(end - (frames + at)) + 1;
}

static int play(screed_kernel *kernel, size_t len)
{
    screed_sensors sensors = {.actual = {0.1, -0.7, 0.9, -0.4, 0.6, 0.2}, .ready = 1};
    screed_command command;
    screed_status status;
    uint8_t answers[1024];
    size_t at = 0, left = 0;
    long lost = 0;
    struct timespec slot, now;

    clock_gettime(CLOCK_MONOTONIC, &slot);
    for (long cycle = 0; cycle < CYCLES_MAX; cycle++) {
        lost += wait_for_slot(&slot);
        if (left == 0) {
            left = frame_length(at, len);
        }
        const size_t taken = screed_kernel_receive(kernel, frames + at, left);
        at += taken;
        left -= taken;
        clock_gettime(CLOCK_MONOTONIC, &now);
        if (!screed_kernel_tick(kernel, ns_of(&now), &sensors, &command) || !screed_kernel_status(kernel, &status)) {
            return 1;
        }
        if (command.known) {
            memcpy(sensors.actual, command.joints, sizeof sensors.actual); /* the robot */
        }
        hash_bytes(command.joints, sizeof command.joints);
        hash_bytes(&command.flow, sizeof command.flow);
        /* A host would get these bytes. They tell of late ticks, and so are not the same in every run. */
        screed_kernel_poll_transmit(kernel, answers, sizeof answers);
        if (cycle % 250 == 0) {
            print_cycle(&command, status.tick);
        }
        if (command.mode == SCREED_FAULTED) {
            printf("stopped by fault %u\n", command.fault);
            return 1;
        }
        if (at == len && command.mode == SCREED_HOLDING && status.consumed > 0 && status.consumed == status.end_seq) {
            print_cycle(&command, status.tick);
            printf("slots lost: %ld\n", lost);
            printf("setpoints %" PRIu32 " cycles %ld hash %016" PRIx64 "\n", status.consumed, cycle + 1, hash);
            return 0;
        }
    }
    printf("not at rest after %ld cycles: mode %u, consumed %" PRIu32 " of %" PRIu32 "\n", CYCLES_MAX, command.mode,
           status.consumed, status.end_seq);
    return 1;
}

int main(int argc, char **argv)
{
    FILE *file = argc == 2 ? fopen(argv[1], "rb") : NULL;
    if (file == NULL) {
        fprintf(stderr, "usage: loop FRAMES (a file that can be read)\n");
        return 2;
    }
    const size_t len = fread(frames, 1, sizeof frames, file);
    fclose(file);
    if (len == 0 || len == sizeof frames || frames[len - 1] != 0) {
        fprintf(stderr, "%s holds no frames, or more than %d bytes of them\n", argv[1], FRAMES_MAX - 1);
        return 2;
    }
    screed_kernel *kernel = screed_kernel_init(memory, sizeof memory);
    if (kernel == NULL) {
        fprintf(stderr, "the kernel needs %zu bytes\n", screed_kernel_size());
        return 1;
    }
    be_real_time();
    return play(kernel, len);
}
