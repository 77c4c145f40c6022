/* Calibrates counts from standard input: "rate_hz sensitivity still_std", then "x y z" a line. Prints status, k, bias (rad/s), where
 * rest and turns were found, and the packet for the boot and sequence given as arguments. SPDX-License-Identifier: MIT */
#include "gyro_turns.h"

#include <stdio.h>
#include <stdlib.h>

int main(int n, char **given)
{
    static gyro_turns c;
    gyro_turns_settings settings = {0};
    gyro_turns_result r = {{0}, {0}, 0};
    int x, y, z;
    if (scanf("%f %f %f", &settings.rate_hz, &settings.sensitivity, &settings.still_std) != 3) return 2;
    gyro_turns_begin(&c, &settings);
    while (scanf("%d %d %d", &x, &y, &z) == 3) {
        const int16_t counts[3] = {(int16_t)x, (int16_t)y, (int16_t)z};
        gyro_turns_add(&c, counts);
    }
    const int status = gyro_turns_solve(&c, &r);
    printf("%d %.9g %.9g %.9g %.9g %.9g %.9g %d %lu %d ", status, r.k[0], r.k[1], r.k[2], r.bias[0], r.bias[1], r.bias[2],
           r.iterations, (unsigned long)c.rested, c.turns);
    uint8_t packet[GYRO_TURNS_PACKET];
    if (n == 3) gyro_turns_packet(&r, strtoull(given[1], NULL, 0), (uint32_t)strtoul(given[2], NULL, 0), packet);
    for (int i = 0; n == 3 && i < GYRO_TURNS_PACKET; i++) printf("%02x", packet[i]);
    return 0;
}
