#ifndef FREERTOS_H
#define FREERTOS_H
typedef unsigned int TickType_t;
#define pdMS_TO_TICKS(ms) ((TickType_t)(ms) / 10u)
#endif
