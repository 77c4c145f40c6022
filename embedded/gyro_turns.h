/* Gyroscope calibration from three full turns by hand: Algorithm 1 of
 * L. Wang et al., "In-field gyroscope autocalibration with iterative attitude estimation", Mechatronics 102 (2024) 103232.
 *
 * The device rests, turns once by 360 degrees about each of its axes (any order, either direction), and rests after each turn.
 * Feed every sample to gyro_turns_add(); it finds rests and turns while streaming. Then gyro_turns_solve() gives
 *
 *     rate = k * (counts * sensitivity - bias)      per axis, rad/s
 *
 * C99, float32, no allocation, no global state. SPDX-License-Identifier: MIT */
#ifndef GYRO_TURNS_H
#define GYRO_TURNS_H

#include <stdint.h>

/* Samples of all three turns together: 23 s at 104 Hz, 6 bytes each. */
#ifndef GYRO_TURNS_SAMPLES
#define GYRO_TURNS_SAMPLES 2400
#endif

typedef enum {
    GYRO_TURNS_WAIT_REST = 0, /* hold the device still */
    GYRO_TURNS_WAIT_TURN = 1, /* resting, ready for the next turn */
    GYRO_TURNS_TURNING = 2,
    GYRO_TURNS_READY = 3, /* three turns are there: call gyro_turns_solve() */
    GYRO_TURNS_OK = 4,    /* the result is valid */
    /* Errors. All but the first two last until gyro_turns_begin(). */
    GYRO_TURNS_NO_REST = -1,       /* solve: no rest was long enough */
    GYRO_TURNS_MISSING_TURN = -2,  /* solve: fewer than three turns */
    GYRO_TURNS_CLIPPED = -3,       /* a reading of a turn reached the full scale: turn more slowly */
    GYRO_TURNS_TOO_LONG = -4,      /* the turns do not fit into the buffer: turn faster */
    GYRO_TURNS_SAME_AXIS = -5,     /* two turns about the same axis */
    GYRO_TURNS_NOT_ONE_TURN = -6,  /* a movement of more than one and a half turns */
    GYRO_TURNS_NOT_CONVERGED = -7, /* no scale factors close the turns */
    GYRO_TURNS_IMPLAUSIBLE = -8,   /* a scale factor outside 0.7 to 1.4: a turn was not 360 degrees, or a setting is wrong */
    GYRO_TURNS_BAD_SETTING = -9    /* rate or sensitivity is not a positive number */
} gyro_turns_status;

typedef struct {
    float rate_hz;         /* output data rate, 20 to 1000 */
    float sensitivity;     /* rad/s of one count, from the data sheet */
    int16_t full_scale;    /* counts from which a reading is clipped, for example 32440; 0: 32440 */
    float still_std;       /* rad/s: a window (1/8 s) with less standard deviation is still; 0: 0.01 (0.6 degrees/s) */
    float still_tolerance; /* rad/s: largest distance of a still window from the first rest; 0: 0.026 (1.5 degrees/s) */
    float rest_s;          /* shortest rest, s; 0: 2 */
} gyro_turns_settings;

typedef struct {
    float k[3];    /* scale factors, x y z */
    float bias[3]; /* rad/s: the reading at zero rate */
    int iterations;
} gyro_turns_result;

/* Bytes of the result as a packet of truerate's native serial protocol. */
#define GYRO_TURNS_PACKET 43

/* Working memory; its fields are private. */
typedef struct {
    gyro_turns_settings set;
    gyro_turns_status status;
    int16_t samples[GYRO_TURNS_SAMPLES][3];
    uint16_t begin[4]; /* of each turn in samples; turn i ends at end[i] */
    uint16_t end[3];
    uint16_t used;    /* samples in use */
    uint16_t window;  /* samples of a window */
    uint16_t filled;  /* of the present window */
    uint16_t still;   /* still windows in a row */
    uint16_t after;   /* where the rest after the present turn begins, in samples */
    uint8_t turns;    /* turns taken */
    uint8_t axes;     /* bit i: a turn about axis i was taken */
    uint8_t moving;   /* a movement is under way */
    int32_t sum[3];   /* counts of the present window */
    int64_t square[3];
    int32_t held[3];  /* the latest still window of the first rest, added when another one follows */
    int32_t rest[3];  /* counts of the first rest */
    uint32_t rested;  /* its samples */
} gyro_turns;

/* Start a calibration. */
gyro_turns_status gyro_turns_begin(gyro_turns *c, const gyro_turns_settings *settings);

/* Take one sample, counts x y z, at the output data rate. Returns what the device does now, or an error. */
gyro_turns_status gyro_turns_add(gyro_turns *c, const int16_t counts[3]);

/* Compute the result; GYRO_TURNS_OK, or an error, and then *result is unchanged. */
gyro_turns_status gyro_turns_solve(const gyro_turns *c, gyro_turns_result *result);

/* Write the result as a packet, ready to send: boot as in HELLO, sequence of the last sample. Send it with each HELLO. */
void gyro_turns_packet(const gyro_turns_result *result, uint64_t boot, uint32_t sequence, uint8_t out[GYRO_TURNS_PACKET]);

#endif
