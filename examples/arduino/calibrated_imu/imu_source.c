/* A stand-in for an IMU with 16-bit readings: replace both functions by those of your driver. */
#include "imu_source.h"

#include <stdint.h>

static uint32_t state;

static int16_t random_count(void)
{
    state = 1664525u * state + 1013904223u;
    return (int16_t)((int32_t)(state >> 16) - 32768);
}

int imu_begin(void)
{
    state = 1;
    return 0; /* start the bus, and check the identity of the sensor here */
}

int imu_read(struct imu_sample *sample)
{
    for (int i = 0; i < IMU_READINGS; ++i) {
        sample->reading[i] = random_count(); /* read a register here */
    }
    sample->celsius = 25.0f + random_count() / 2048.0f;
    return 1;
}
