/* See gyro_turns.h. Equation numbers are those of the paper. SPDX-License-Identifier: MIT */
#include "gyro_turns.h"

#include <math.h>
#include <string.h>

#define TWO_PI 6.28318531f
#define MARGIN_WINDOWS 3 /* rest taken into a turn at each end: a hand begins and ends gently */
#define TOLERANCE 1e-5f  /* of Algorithm 1 */
#define ITERATIONS 50
#define LEAST_K 0.7f
#define MOST_K 1.4f

typedef struct {
    float s[3][3]; /* equations (6) to (10), times the duration: the turn is |s d| for a factor d on the rates */
} integral;

/* Equations (4) to (10): the attitude is integrated with k, as a unit quaternion. */
static void integrate(const gyro_turns *c, int turn, const float k[3], const float bias[3], integral *out)
{
    const float dt = 1.0f / c->set.rate_hz;
    float w = 1, x = 0, y = 0, z = 0;
    memset(out, 0, sizeof *out);
    for (uint16_t i = c->begin[turn]; i < c->end[turn]; i++) {
        float v[3]; /* the angle turned in this sample, about each axis of the device */
        for (int j = 0; j < 3; j++) v[j] = k[j] * ((float)c->samples[i][j] * c->set.sensitivity - bias[j]) * dt;
        const float a2 = v[0] * v[0] + v[1] * v[1] + v[2] * v[2];
        const float s = 0.5f - a2 * (1.0f / 48.0f - a2 * (1.0f / 3840.0f)); /* sin(a/2)/a */
        const float r = 1.0f - a2 * (0.125f - a2 * (1.0f / 384.0f));        /* cos(a/2) */
        const float p = s * v[0], q = s * v[1], t = s * v[2];
        const float w1 = w * r - x * p - y * q - z * t, x1 = w * p + x * r + y * t - z * q;
        const float y1 = w * q - x * t + y * r + z * p, z1 = w * t + x * q - y * p + z * r;
        const float scale = 1.5f - 0.5f * (w1 * w1 + x1 * x1 + y1 * y1 + z1 * z1); /* back to length 1 */
        w = w1 * scale, x = x1 * scale, y = y1 * scale, z = z1 * scale;
        const float C[3][3] = {
            {1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)},
            {2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)},
            {2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)},
        };
        for (int m = 0; m < 3; m++)
            for (int j = 0; j < 3; j++) out->s[m][j] += C[m][j] * v[j];
    }
}

static float turned(const integral *S, const float d[3], float direction[3])
{
    for (int m = 0; m < 3; m++) direction[m] = S->s[m][0] * d[0] + S->s[m][1] * d[1] + S->s[m][2] * d[2];
    const float angle =
        sqrtf(direction[0] * direction[0] + direction[1] * direction[1] + direction[2] * direction[2]);
    for (int m = 0; m < 3; m++) direction[m] /= angle > 0 ? angle : 1;
    return angle;
}

static int main_axis(const float v[3])
{
    const float x = fabsf(v[0]), y = fabsf(v[1]), z = fabsf(v[2]);
    return x >= y && x >= z ? 0 : y >= z ? 1 : 2;
}

/* x of A x = b by Cramer's rule; 0 when A is singular. */
static int solve3(const float A[3][3], const float b[3], float x[3])
{
    float minor[3][3];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            const int i1 = (i + 1) % 3, i2 = (i + 2) % 3, j1 = (j + 1) % 3, j2 = (j + 2) % 3;
            minor[i][j] = A[i1][j1] * A[i2][j2] - A[i1][j2] * A[i2][j1];
        }
    const float det = A[0][0] * minor[0][0] + A[0][1] * minor[0][1] + A[0][2] * minor[0][2];
    if (!(fabsf(det) > 1e-3f)) return 0; /* the rows are about 2 pi long and nearly square to each other */
    for (int j = 0; j < 3; j++) x[j] = (minor[0][j] * b[0] + minor[1][j] * b[1] + minor[2][j] * b[2]) / det;
    return 1;
}

/* Equation (11): factors d with |S d| = 360 degrees for the three turns, by Newton's method. */
static int close_turns(const integral S[3], float d[3])
{
    d[0] = d[1] = d[2] = 1;
    for (int step = 0; step < 20; step++) {
        float slope[3][3], missing[3], change[3];
        for (int turn = 0; turn < 3; turn++) {
            float u[3];
            missing[turn] = TWO_PI - turned(&S[turn], d, u);
            for (int j = 0; j < 3; j++)
                slope[turn][j] = u[0] * S[turn].s[0][j] + u[1] * S[turn].s[1][j] + u[2] * S[turn].s[2][j];
        }
        if (!solve3((const float(*)[3])slope, missing, change)) return 0;
        float largest = 0;
        for (int j = 0; j < 3; j++) {
            d[j] += change[j];
            largest = fmaxf(largest, fabsf(change[j]));
        }
        if (!(largest < 1)) return 0;
        if (largest < 1e-6f) return 1;
    }
    return 1;
}

/* Equation (2): the mean reading of the first rest; whole counts apart, so that float32 loses nothing. */
static void rest_bias(const gyro_turns *c, float bias[3])
{
    const int32_t n = (int32_t)c->rested;
    for (int j = 0; j < 3; j++)
        bias[j] = ((float)(c->rest[j] / n) + (float)(c->rest[j] % n) / (float)n) * c->set.sensitivity;
}

gyro_turns_status gyro_turns_begin(gyro_turns *c, const gyro_turns_settings *settings)
{
    memset(c, 0, sizeof *c);
    c->set = *settings;
    if (c->set.full_scale <= 0) c->set.full_scale = 32440;
    if (!(c->set.still_std > 0)) c->set.still_std = 0.01f;
    if (!(c->set.still_tolerance > 0)) c->set.still_tolerance = 0.026f;
    if (!(c->set.rest_s > 0)) c->set.rest_s = 2;
    if (!(c->set.rate_hz >= 20 && c->set.rate_hz <= 1000 && c->set.sensitivity > 0 && c->set.sensitivity < 1))
        return c->status = GYRO_TURNS_BAD_SETTING;
    c->window = (uint16_t)(c->set.rate_hz / 8 + 0.5f);
    return c->status;
}

static int window_is_still(const gyro_turns *c)
{
    const float n = (float)c->window, s = c->set.sensitivity;
    for (int j = 0; j < 3; j++) {
        const float mean = (float)c->sum[j] / n;
        /* n times the sum of squares about the mean, exact in integers */
        const int64_t about = c->square[j] * c->window - (int64_t)c->sum[j] * c->sum[j];
        if (sqrtf((float)about) / n * s > c->set.still_std) return 0;
        if (c->rested > 0 && fabsf(mean - (float)c->rest[j] / (float)c->rested) * s > c->set.still_tolerance) return 0;
    }
    return 1;
}

/* The bias is that of the rest just before the first turn. */
static void first_rest_anew(gyro_turns *c)
{
    c->rested = (uint32_t)(c->used - c->window - c->after);
    for (int j = 0; j < 3; j++) {
        c->rest[j] = 0;
        c->held[j] = c->sum[j];
        for (int i = c->after; i < c->used - c->window; i++) c->rest[j] += c->samples[i][j];
    }
}

/* A rest after a movement is long enough: was the movement a turn? */
static gyro_turns_status judge(gyro_turns *c)
{
    static const float one[3] = {1, 1, 1};
    float bias[3], direction[3];
    integral S;
    rest_bias(c, bias);
    c->moving = 0;
    c->end[c->turns] = (uint16_t)(c->after + MARGIN_WINDOWS * c->window);
    integrate(c, c->turns, one, bias, &S);
    const float angle = turned(&S, one, direction);
    if (angle < TWO_PI / 1.5f) { /* not a turn, whatever k is */
        if (c->turns == 0) first_rest_anew(c);
        c->used = c->begin[c->turns];
        return GYRO_TURNS_WAIT_TURN;
    }
    for (uint16_t i = c->begin[c->turns]; i < c->end[c->turns]; i++)
        for (int j = 0; j < 3; j++)
            if (c->samples[i][j] >= c->set.full_scale || c->samples[i][j] <= -c->set.full_scale) return GYRO_TURNS_CLIPPED;
    if (angle > TWO_PI * 1.5f) return GYRO_TURNS_NOT_ONE_TURN;
    const uint8_t axis = (uint8_t)(1u << main_axis(direction));
    if (c->axes & axis) return GYRO_TURNS_SAME_AXIS;
    c->axes |= axis;
    c->used = c->begin[c->turns + 1] = c->end[c->turns];
    c->turns++;
    return c->turns == 3 ? GYRO_TURNS_READY : GYRO_TURNS_WAIT_TURN;
}

/* The samples of the present window are in `samples` already, the latest of them. */
static gyro_turns_status take_window(gyro_turns *c)
{
    const uint16_t start = c->begin[c->turns], needed = (uint16_t)(c->set.rest_s * c->set.rate_hz / (float)c->window + 0.5f);
    const int resting = window_is_still(c);
    if (resting) c->still++;
    if (c->turns == 0 && !c->moving) { /* the first rest; its last window may hold the begin of a movement */
        if (resting) {
            for (int j = 0; j < 3; j++) c->rest[j] += c->held[j], c->held[j] = c->sum[j];
            if (c->still > 1) c->rested += c->window;
        } else if (c->still < needed) { /* too short: begin again */
            memset(c->rest, 0, sizeof c->rest);
            memset(c->held, 0, sizeof c->held);
            c->rested = 0;
            c->still = 0;
            c->used = start;
            return GYRO_TURNS_WAIT_REST;
        }
    }
    if (!resting) {
        memset(c->held, 0, sizeof c->held);
        c->still = 0;
        c->moving = 1;
        return GYRO_TURNS_TURNING;
    }
    if (c->moving) {
        if (c->still == 1) c->after = (uint16_t)(c->used - c->window);
        return c->still >= needed ? judge(c) : GYRO_TURNS_TURNING;
    }
    const uint16_t most = (uint16_t)(MARGIN_WINDOWS * c->window);
    if (c->used - start > most) { /* of a rest only the latest is kept, as the margin of the next turn */
        memmove(c->samples[start], c->samples[c->used - most], most * sizeof c->samples[0]);
        c->used = (uint16_t)(start + most);
    }
    return c->still >= needed || c->turns > 0 ? GYRO_TURNS_WAIT_TURN : GYRO_TURNS_WAIT_REST;
}

gyro_turns_status gyro_turns_add(gyro_turns *c, const int16_t counts[3])
{
    if (c->status < 0 || c->status == GYRO_TURNS_READY) return c->status;
    if (c->used >= GYRO_TURNS_SAMPLES) return c->status = GYRO_TURNS_TOO_LONG;
    for (int j = 0; j < 3; j++) {
        c->samples[c->used][j] = counts[j];
        c->sum[j] += counts[j];
        c->square[j] += (int32_t)counts[j] * counts[j];
    }
    c->used++;
    if (++c->filled < c->window) return c->status;
    c->status = take_window(c);
    c->filled = 0;
    memset(c->sum, 0, sizeof c->sum);
    memset(c->square, 0, sizeof c->square);
    return c->status;
}

gyro_turns_status gyro_turns_solve(const gyro_turns *c, gyro_turns_result *result)
{
    if (c->status < 0) return c->status;
    if (c->rested == 0) return GYRO_TURNS_NO_REST;
    if (c->turns < 3) return GYRO_TURNS_MISSING_TURN;
    gyro_turns_result found = {{1, 1, 1}, {0, 0, 0}, 0};
    rest_bias(c, found.bias);
    while (found.iterations++ < ITERATIONS) { /* Algorithm 1 */
        integral S[3];
        float d[3], moved = 0;
        for (int turn = 0; turn < 3; turn++) integrate(c, turn, found.k, found.bias, &S[turn]);
        if (!close_turns(S, d)) return GYRO_TURNS_NOT_CONVERGED;
        for (int j = 0; j < 3; j++) {
            const float next = found.k[j] * d[j];
            moved += (next - found.k[j]) * (next - found.k[j]);
            found.k[j] = next;
        }
        if (!(moved < 100)) return GYRO_TURNS_NOT_CONVERGED;
        if (sqrtf(moved) > TOLERANCE) continue;
        for (int j = 0; j < 3; j++)
            if (!(found.k[j] >= LEAST_K && found.k[j] <= MOST_K)) return GYRO_TURNS_IMPLAUSIBLE;
        *result = found;
        return GYRO_TURNS_OK;
    }
    return GYRO_TURNS_NOT_CONVERGED;
}

static uint8_t *put32(uint8_t *at, uint32_t value)
{
    for (int i = 0; i < 4; i++) *at++ = (uint8_t)(value >> 8 * i);
    return at;
}

void gyro_turns_packet(const gyro_turns_result *result, uint64_t boot, uint32_t sequence, uint8_t out[GYRO_TURNS_PACKET])
{
    uint8_t plain[GYRO_TURNS_PACKET - 2] = {0x03}, *code = out++;
    uint8_t *at = put32(put32(put32(plain + 1, (uint32_t)boot), (uint32_t)(boot >> 32)), sequence);
    for (int j = 0; j < 6; j++) {
        uint32_t bits;
        memcpy(&bits, j < 3 ? &result->k[j] : &result->bias[j - 3], sizeof bits);
        at = put32(at, bits);
    }
    uint32_t crc = ~(uint32_t)0; /* CRC-32, as in zlib */
    for (const uint8_t *byte = plain; byte < at; byte++) {
        crc ^= *byte;
        for (int bit = 0; bit < 8; bit++) crc = crc >> 1 ^ (crc & 1 ? 0xEDB88320u : 0);
    }
    at = put32(at, ~crc);
    for (const uint8_t *byte = plain; byte < at; byte++) { /* COBS */
        if (*byte) *out++ = *byte;
        else *code = (uint8_t)(out - code), code = out++;
    }
    *code = (uint8_t)(out - code);
    *out = 0;
}
