/* A stand-in for the Arduino core: Serial writes to stdout, and time ends after some periods. */
#ifndef ARDUINO_H
#define ARDUINO_H

#include "periods.h"

#include <cstdio>

struct SerialPort {
    void begin(unsigned long) {}
    void print(const char *text) { std::fputs(text, stdout); }
    void print(double value, int digits = 2) { std::printf("%.*f", digits, value); }
    void println(const char *text) { std::puts(text); }
};

extern SerialPort Serial;

inline void delay(unsigned long) { period_ended(); }

void setup();
void loop();

#endif
