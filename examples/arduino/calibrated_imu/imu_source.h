/* Your IMU: the sketch calls these two functions. Replace imu_source.c by your driver. */
#ifndef IMU_SOURCE_H
#define IMU_SOURCE_H

#include "imu.h" /* written by inercal export; it states the number of readings */

#ifdef __cplusplus
extern "C" {
#endif

struct imu_sample {
    float reading[IMU_READINGS]; /* as the sensor states them, in the order of the calibration */
    float celsius;               /* temperature of the sensor, degC */
};

/* Start the IMU. Return 0, or a number that says what failed. */
int imu_begin(void);

/* Read the next sample. Return 1, or 0 if there is no new sample yet. */
int imu_read(struct imu_sample *sample);

#ifdef __cplusplus
}
#endif

#endif
