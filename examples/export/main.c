/* Corrects one reading by the header that `in_python.py` writes. */
#include "imu.h"

#include <stdio.h>

int main(void)
{
    const float reading[3] = {0.0123f, -0.0041f, 1.0132f}; /* g, as the sensor states them */
    float force[3];
    if (imu_self_test() != 0) {
        return 1;
    }
    imu_correct(reading, force);
    printf("%.4f %.4f %.4f m/s^2\n", (double)force[0], (double)force[1], (double)force[2]);
    return 0;
}
