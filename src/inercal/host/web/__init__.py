"""The live page: what an operator sees of a run, in a browser, and says to it.

The run is a process of its own (`worker`), which the server (`server`) starts and relays::

    table, IMU <-> worker -- JSON lines --> server -- websockets --> pages
                          <-- commands ---         <--------------

A page that is closed, or a server that is killed, leaves the run going. Several may look on, one
operates, anyone may stop. What follows the stop is as at a terminal: a signal to the run's process,
which the watchdog hears by itself. It is software and not a safety function.
"""
