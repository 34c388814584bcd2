/* Ends the program after PERIODS periods. */
#ifndef PERIODS_H
#define PERIODS_H

#include <stdlib.h>

static inline void period_ended(void)
{
    static int count;
    if (++count == PERIODS) {
        exit(0);
    }
}

#endif
