"""The live page: an operator can watch and control a run in a browser.

The run is a separate process (`worker`). The server (`server`) starts this process and relays its
messages::

    table, IMU <-> worker -- JSON lines --> server -- websockets --> pages
                          <-- commands ---         <--------------

The run continues if a page is closed or the server is killed. Several viewers may watch, one viewer
operates, and every viewer may stop the table. A stop works in the same way as at a terminal: a
signal is sent to the process of the run, and the watchdog also receives this signal. The stop is
software and not a safety function.
"""
