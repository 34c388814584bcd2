/* Prints what the driver of the example returns, with all digits. */
#include "imu_source.h"

#include <stdio.h>

int main(void)
{
    struct imu_sample sample;
    if (imu_begin() != 0) {
        return 1;
    }
    for (int k = 0; k < PERIODS && imu_read(&sample); ++k) {
        for (int i = 0; i < IMU_READINGS; ++i) {
            printf("%.9g,", (double)sample.reading[i]);
        }
        printf("%.9g\n", (double)sample.celsius);
    }
    return 0;
}
