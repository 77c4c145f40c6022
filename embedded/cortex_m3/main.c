/* Calibrates the session of session.h on a Cortex-M3 and reports by semihosting: status, bits of k and bias, instructions of
 * gyro_turns_solve(), largest stack. For qemu-system-arm -M mps2-an385 -icount shift=4. SPDX-License-Identifier: MIT */
#include "../gyro_turns.h"
#include "session.h"

#include <string.h>

extern uint32_t data_load, data_begin, data_end, bss_begin, bss_end, stack_begin, stack_end;

#define SYST_CSR (*(volatile uint32_t *)0xE000E010)
#define SYST_RVR (*(volatile uint32_t *)0xE000E014)
#define SYST_CVR (*(volatile uint32_t *)0xE000E018)
#define PAINT 0xA5A5A5A5u

static volatile uint32_t wraps;

static int semihosting(int operation, const void *argument)
{
    register int r0 __asm__("r0") = operation;
    register const void *r1 __asm__("r1") = argument;
    __asm__ volatile("bkpt 0xAB" : "+r"(r0) : "r"(r1) : "memory");
    return r0;
}

static void say(uint32_t value)
{
    char text[10];
    for (int i = 0; i < 8; i++) text[i] = "0123456789abcdef"[(value >> (28 - 4 * i)) & 15];
    text[8] = ' ';
    text[9] = 0;
    semihosting(4, text);
}

static void say_float(float value)
{
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    say(bits);
}

static uint64_t ticks(void)
{
    uint32_t before, value;
    do {
        before = wraps;
        value = SYST_CVR;
    } while (before != wraps);
    return ((uint64_t)before << 24) + (0xFFFFFFu - value);
}

static gyro_turns c;

int main(void)
{
    const gyro_turns_settings settings = {SESSION_RATE_HZ, SESSION_SENSITIVITY, 0, SESSION_STILL_STD, 0, 0};
    gyro_turns_result result = {{0}, {0}, 0};
    SYST_RVR = 0xFFFFFF;
    SYST_CVR = 0;
    SYST_CSR = 7;
    gyro_turns_begin(&c, &settings);
    for (unsigned i = 0; i < sizeof session / sizeof session[0]; i++) gyro_turns_add(&c, session[i]);
    const uint64_t begun = ticks();
    const int status = gyro_turns_solve(&c, &result);
    const uint64_t took = ticks() - begun;
    say((uint32_t)status);
    for (int j = 0; j < 3; j++) say_float(result.k[j]);
    for (int j = 0; j < 3; j++) say_float(result.bias[j]);
    say((uint32_t)took);
    const uint32_t *deepest = &stack_begin;
    while (deepest < &stack_end && *deepest == PAINT) deepest++;
    say((uint32_t)((const char *)&stack_end - (const char *)deepest));
    semihosting(4, "\n");
    return 0;
}

void reset(void)
{
    memcpy(&data_begin, &data_load, (size_t)((char *)&data_end - (char *)&data_begin));
    memset(&bss_begin, 0, (size_t)((char *)&bss_end - (char *)&bss_begin));
    const uintptr_t here = (uintptr_t)__builtin_frame_address(0) - 64; /* the stack below is painted */
    for (volatile uint32_t *word = &stack_begin; (uintptr_t)word < here; word++) *word = PAINT;
    main();
    semihosting(0x18, (const void *)0x20026); /* application exit */
    for (;;) {}
}

void tick(void) { wraps++; }

__attribute__((section(".vectors"), used)) static const void *const vectors[16] = {
    &stack_end, (const void *)reset, [15] = (const void *)tick,
};
