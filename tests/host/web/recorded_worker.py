"""A run's process that says what a file holds, line by line: the end only after a line `end`."""

import os
import signal
import sys
from pathlib import Path


def main() -> None:
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    sys.stdin.buffer.readline()
    lines = Path(sys.argv[1]).read_bytes().splitlines(keepends=True)
    os.write(1, b"".join(lines[:-1]))
    while (line := sys.stdin.buffer.readline()) and line.strip() not in (b"end", b"abort"):
        pass
    os.write(1, lines[-1])


if __name__ == "__main__":
    main()
