/* The kernel of Screed for C: setpoint ring, path clock, guard and modes of a UR10e, one tick at a time.
 *
 * Link with the static library that `.ci/c_example` builds, and with a C library's memcpy, memmove, memset and memcmp. The
 * kernel has no clock, no heap, no thread and no input or output of its own: time and bytes are arguments. No function waits, loops
 * without bound, or fails but by its answer. A kernel may be used by one thread at a time.
 *
 * Units are SI: rad, m³/s, s. Frames of bytes are described in docs/frames.md.
 */
#ifndef SCREED_KERNEL_H
#define SCREED_KERNEL_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Joints of the arm. */
#define SCREED_JOINTS 6

/* Setpoints that the ring holds. */
#define SCREED_RING 4096

/* Modes. */
#define SCREED_UNREADY 0  /* not configured, or the robot's position is not known: send nothing */
#define SCREED_HOLDING 1  /* at rest */
#define SCREED_MOVING 2   /* plays the ring */
#define SCREED_STOPPING 3 /* comes to rest on the path */
#define SCREED_FAULTED 4  /* at rest after a fault; only re-arming leads on */

/* Faults. */
#define SCREED_FAULT_NONE 0
#define SCREED_FAULT_FOLLOWING 1 /* the robot does not follow its setpoints */
#define SCREED_FAULT_SENSOR 2    /* a measured or estimated position is not a number */
#define SCREED_FAULT_NOT_READY 3 /* the robot no longer takes setpoints */
#define SCREED_FAULT_OUTPUT 4    /* a setpoint broke a limit at the last gate */
#define SCREED_FAULT_EXTRUDER 5  /* the extruder failed */
#define SCREED_FAULT_DEVIATION 6 /* the estimate is far from the targets */
#define SCREED_FAULT_CORRECTION 7 /* a correction breaks its limits */
#define SCREED_FAULT_SATURATED 8 /* the loop would have to move the tool too far or too fast */
#define SCREED_FAULT_UNREACHABLE 9 /* the path cannot be reached from where the base is */
#define SCREED_FAULT_BASE 10     /* the base has moved too far */
#define SCREED_FAULT_DRIVE 11    /* a drive's lag is beyond its bounds */
#define SCREED_FAULT_LEAD 12     /* what is sent cannot lead the path as it should */
#define SCREED_FAULT_TRACKER 13  /* the tracker has been lost for too long */
#define SCREED_FAULT_OVERRUN 14  /* the loop came late again and again */
#define SCREED_FAULT_LINK 15     /* the link to the robot failed */

/* A kernel; its memory is the caller's. */
typedef struct screed_kernel screed_kernel;

/* What is known at one cycle. */
typedef struct {
    double actual[SCREED_JOINTS];     /* actual joint positions as the robot says them (rad) */
    double estimate[SCREED_JOINTS];   /* joint positions by an estimator (rad); only if has_estimate is not 0 */
    double correction[SCREED_JOINTS]; /* joint offsets to add to the path (rad); only if has_correction is not 0 */
    uint8_t ready;                    /* not 0: the robot takes setpoints now, and all else works that has to */
    uint8_t has_estimate;             /* 0: there is no estimator */
    uint8_t has_correction;           /* 0: corrections under way are taken out, within their limits */
} screed_sensors;

/* What is to happen at this cycle. */
typedef struct {
    double joints[SCREED_JOINTS];     /* joint targets (rad); only if known is not 0 */
    double correction[SCREED_JOINTS]; /* the correction in the targets (rad) */
    double flow;                      /* extrusion rate (m³/s) */
    double rate;                      /* path clock rate, 0 to 1 */
    uint32_t seq;    /* the setpoint that the targets stand for, or were interpolated behind; 0 before the first */
    uint8_t known;   /* 0: the robot's position is not known, send it nothing */
    uint8_t deposit; /* not 0: material is being laid */
    uint8_t mode;    /* SCREED_UNREADY ... */
    uint8_t fault;   /* SCREED_FAULT_NONE ... */
} screed_command;

/* Where the kernel stands. */
typedef struct {
    uint64_t tick;          /* ticks since the beginning */
    uint64_t fault_tick;    /* tick of the present fault; 0 without */
    uint64_t time_lost_ns;  /* time lost by late ticks: the path clock advances one period a tick */
    double rate;            /* path clock rate, 0 to 1 */
    uint32_t epoch;         /* counts configurations, dropped rings, holds and resumes; a resume must name it */
    uint32_t consumed;      /* setpoint consumed last; what follows it can be replaced */
    uint32_t end_seq;       /* last setpoint held */
    uint32_t credits;       /* setpoints that the ring can take */
    uint32_t fault_number;  /* number of the present fault, which re-arming must name; 0 without */
    uint32_t frames_broken; /* frames dropped as broken since the beginning */
    uint32_t frames_unknown; /* whole frames whose message is not known here: from a host of a later version */
    uint32_t ticks_late;    /* ticks that began more than half a period late */
    uint8_t mode;           /* SCREED_UNREADY ... */
    uint8_t fault;          /* SCREED_FAULT_NONE ... */
} screed_status;

/* Bytes of memory that a kernel needs, and the power of two that their address must be a multiple of. */
size_t screed_kernel_size(void);
size_t screed_kernel_align(void);

/* Makes a kernel in `size` bytes at `memory`: unconfigured, with an empty ring. NULL when the memory is missing, too small or not
 * aligned. Nothing has to be undone: the memory may be used for something else whenever the kernel is no longer needed.
 * This call alone needs a stack as large as the kernel: make it before the loop. */
screed_kernel *screed_kernel_init(void *memory, size_t size);

/* Takes bytes from the host and obeys every frame that ends in them. Returns how many were taken: at most
 * screed_kernel_receive_max() between two ticks; what is over waits with the caller. */
size_t screed_kernel_receive(screed_kernel *kernel, const uint8_t *bytes, size_t len);
size_t screed_kernel_receive_max(void);

/* One cycle, begun at `now_ns` on a monotonic clock. Writes what is to happen to `command`. Returns 1, or 0 (and does nothing) when
 * an argument is NULL. */
int screed_kernel_tick(screed_kernel *kernel, uint64_t now_ns, const screed_sensors *sensors, screed_command *command);

/* Copies answers for the host to `out`. Returns how many bytes, at most `len`. */
size_t screed_kernel_poll_transmit(screed_kernel *kernel, uint8_t *out, size_t len);

/* Where the kernel stands. Returns 1, or 0 (and does nothing) when an argument is NULL. */
int screed_kernel_status(const screed_kernel *kernel, screed_status *status);

/* Another host speaks from here on: forgets a half-received frame. */
void screed_kernel_host_changed(screed_kernel *kernel);

/* The link to the robot is gone: where it is, is no longer known, and the ring is dropped. */
void screed_kernel_robot_lost(screed_kernel *kernel);

/* The extruder failed: stops on the path as for a fault of the kernel's own. While the kernel is unready nothing happens: keep
 * `ready` of the sensors 0 for as long as the extruder does not work. */
void screed_kernel_extruder_failed(screed_kernel *kernel);

/* Comes to rest, then screed_kernel_may_quit() is not 0. */
void screed_kernel_quit(screed_kernel *kernel);
int screed_kernel_may_quit(const screed_kernel *kernel);

/* The flange in the base frame for these joint positions (rad): a row-major 3 by 4 matrix, rotation and translation (m).
 * Returns 1, or 0 (and does nothing) when an argument is NULL. */
int screed_forward(const double joints[SCREED_JOINTS], double base_from_flange[12]);

#ifdef __cplusplus
}
#endif

#endif
