"""What reading a file costs, whether it succeeds or not: `python -m tests.io.reading_cost FILE`.

It prints the memory of this process that reading takes beyond its libraries, the largest memory of
the processes that it starts, kB, their processor time, s, and the key and text of the error.
"""

import json
import os
import resource
import sys
from pathlib import Path

from inercal.basics.errors import InputError
from inercal.recordings.io.isolation import end_all
from inercal.recordings.io.read import detect_reader, read_table


def main() -> None:
    path = Path(sys.argv[1])
    detect_reader(path)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    key = text = rows = None
    try:
        rows = len(next(iter(read_table(path, sys.argv[2:] or None).columns.values())))
    except InputError as error:
        key, text = error.key, str(error)
    end_all()
    told = {
        "own": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before,
        "memory": resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss,
        "seconds": sum(os.times()[2:4]),
        "rows": rows,
        "key": key,
        "error": text,
    }
    print(json.dumps(told))


if __name__ == "__main__":
    main()
