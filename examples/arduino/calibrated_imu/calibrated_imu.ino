/* Prints corrected samples of an IMU as CSV, in m/s^2, rad/s and T. */
#include "imu.h"
#include "imu_source.h"

static const unsigned long PERIOD_MS = 10;

static void stop(const char *reason)
{
    for (;;) {
        Serial.println(reason);
        delay(1000);
    }
}

void setup()
{
    Serial.begin(115200);
    if (imu_self_test() != 0) {
        stop("imu.h does not reproduce its check on this board");
    }
    if (imu_begin() != 0) {
        stop("the IMU does not answer");
    }
}

void loop()
{
    struct imu_sample sample;
    float motion[IMU_RESULTS];
    if (imu_read(&sample)) {
#if IMU_TAKES_TEMPERATURE
        imu_correct(sample.reading, sample.celsius, motion);
#else
        imu_correct(sample.reading, motion);
#endif
        for (int i = 0; i < IMU_RESULTS; ++i) {
            Serial.print(i == 0 ? "" : ",");
            Serial.print(motion[i], 6);
        }
        Serial.println("");
    }
    delay(PERIOD_MS);
}
