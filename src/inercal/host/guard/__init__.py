"""The watchdog: it stops the table on request, and when the heartbeat of the host fails.

The watchdog is a separate process with its own connection to the table, so that it can stop the
table although the host is blocked or has ended. It reads a pipe to which only the host writes::

    .           heartbeat; after the first, a gap of `silence` s is a reason to stop
    s           stop now; so are the bytes 2 and 15, which signal handlers write
    q           release the table and end
    end of file the host has ended: stop now, and end when the table is at rest

It writes lines: `ready`, `stopping: WHY`, `at rest`, `killed: WHY`, `cannot: WHY`. Between
`stopping` and `at rest` it stops any axis that turns again; the host must not command the table.

It stops by `RotaryTable.stop`, which sends the command before it waits for any answer: all axes
decelerate and are held. It kills an axis that does not
decelerate as its limits allow; that axis coasts. It measures the deceleration by the clock of the
controller, where there is one. It does not stop a table at rest whose servos are all off, as that
would switch them on. Where the link is lost, it connects again and stops again, until the table is
at rest.

This is no safety function: that is the hardware interlock.
"""

from inercal.host.guard.guard_process import Guard

__all__ = ["Guard"]
