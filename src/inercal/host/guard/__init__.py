"""Stops the table when it is told to, and when the host no longer says that it lives.

A process of its own with its own connection, so that neither the host's lock of the interpreter nor
its end keeps the table from stopping. It reads a pipe that the host alone writes to::

    .           the host lives; from the first on, none for `silence` s is a reason to stop
    s           stop now; so are the bytes 2 and 15, which signals write without the interpreter
    q           let go of the table and end
    the end     the host is gone: stop now, and end when the table is at rest

and says in lines `ready`, `stopping: WHY`, `at rest`, `killed: WHY`, `cannot: WHY`. Between
`stopping` and `at rest` whatever turns is stopped again: nothing may be commanded meanwhile.

To stop is `RotaryTable.stop`: all axes decelerate and are held. One that does not slow down as its
limits allow is killed, and coasts. Judged is by the controller's clock where it tells one. A table
whose servos are all off, at rest, is left so: to stop it would switch them on. Where the link is
lost it is made anew and the table stopped again, until it is at rest.

No safety function: that is the hardware interlock.
"""

from inercal.host.guard.guard_process import Guard

__all__ = ["Guard"]
