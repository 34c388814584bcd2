"""Objects over a pipe between two processes; their arrays are sent as they lie in memory.

A message is the length of its head, the head (the length of the pickled object and the sizes of
its arrays), the object pickled without its arrays, and the arrays (PEP 574).
"""

import pickle
import struct
from io import RawIOBase
from typing import Any

import numpy as np

_LENGTH = struct.Struct("<Q")


def send(pipe: RawIOBase, content: object) -> None:
    """Write an object.

    Raises
    ------
    OSError
        Nobody reads any more.
    """
    buffers: list[pickle.PickleBuffer] = []
    pickled = pickle.dumps(content, 5, buffer_callback=buffers.append)
    arrays = [one.raw() for one in buffers]
    head = pickle.dumps((len(pickled), [one.nbytes for one in arrays]))
    for part in (_LENGTH.pack(len(head)) + head + pickled, *arrays):
        view = memoryview(part)
        while view:
            view = view[pipe.write(view) or 0 :]


def receive(pipe: RawIOBase) -> Any:
    """Return the next object.

    Raises
    ------
    EOFError
        The pipe has ended.
    """
    (length,) = _LENGTH.unpack(_read(pipe, _LENGTH.size))
    size, sizes = pickle.loads(_read(pipe, length))
    pickled = _read(pipe, size)
    return pickle.loads(pickled, buffers=[_read(pipe, one) for one in sizes])


def _read(pipe: RawIOBase, size: int) -> memoryview:
    content = np.empty(size, np.uint8).data  # not cleared before, as other buffers are
    done = 0
    while done < size:
        got = pipe.readinto(content[done:])
        if not got:
            raise EOFError
        done += got
    return content
