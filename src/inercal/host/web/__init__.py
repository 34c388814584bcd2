"""The live page: lets an operator watch and control a run in a browser.

The run is a separate process (`worker`), which the server (`server`) starts and relays::

    table, IMU <-> worker -- JSON lines --> server -- websockets --> pages
                          <-- commands ---         <--------------

The run continues if a page is closed or the server is killed. Several viewers may watch, one
operates, and anyone may stop. A stop works as it does at a terminal: it sends a signal to the run's
process, and the watchdog also receives it. It is software and not a safety function.
"""
