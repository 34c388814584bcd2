/* Prints corrected samples of an IMU as CSV, in m/s^2, rad/s and T. */
#include <stdio.h>

#include "freertos/FreeRTOS.h"
#include "freertos/task.h"

#include "imu.h"
#include "imu_source.h"

#define PERIOD_MS 10

static void print_corrected(const struct imu_sample *sample)
{
    float motion[IMU_RESULTS];
#if IMU_TAKES_TEMPERATURE
    imu_correct(sample->reading, sample->celsius, motion);
#else
    imu_correct(sample->reading, motion);
#endif
    for (int i = 0; i < IMU_RESULTS; ++i) {
        printf("%s%.6f", i == 0 ? "" : ",", (double)motion[i]);
    }
    printf("\n");
}

void app_main(void)
{
    if (imu_self_test() != 0) {
        printf("imu.h does not reproduce its check on this board\n");
        return;
    }
    if (imu_begin() != 0) {
        printf("the IMU does not answer\n");
        return;
    }
    for (;;) {
        struct imu_sample sample;
        if (imu_read(&sample)) {
            print_corrected(&sample);
        }
        vTaskDelay(pdMS_TO_TICKS(PERIOD_MS));
    }
}
