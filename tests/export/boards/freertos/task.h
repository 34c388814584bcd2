#ifndef TASK_H
#define TASK_H
#include "periods.h"
static inline void vTaskDelay(TickType_t ticks)
{
    (void)ticks;
    period_ended();
}
#endif
