"""A slow function that is called once for all who wait for it."""

import asyncio
from collections.abc import Callable
from typing import Generic, TypeVar

Result = TypeVar("Result")


class SharedCall(Generic[Result]):
    """Calls a function in a thread; its result goes to all who asked before the call began.

    Parameters
    ----------
    function : callable
    lock : asyncio.Lock
        Held during a call.
    """

    def __init__(self, function: Callable[[], Result], lock: asyncio.Lock):
        self._function, self._lock = function, lock
        self._next: asyncio.Task[Result] | None = None

    async def __call__(self) -> Result:
        """Return the result of a call that begins after this."""
        if self._next is None:
            self._next = asyncio.create_task(self._call())
        # Who gives up ends the wait, but not the call: the others still wait for it.
        return await asyncio.shield(self._next)

    async def _call(self) -> Result:
        async with self._lock:
            self._next = None
            return await asyncio.to_thread(self._function)
