"""Read ROS 2 bags that were split into several files, which `metadata.yaml` lists in order.

The recorder writes this file into the folder of the bag. It begins with
`rosbag2_bagfile_information`, and its list `relative_file_paths` names the parts.
"""

import re
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from hashlib import sha256
from pathlib import Path, PurePosixPath
from typing import Any

from inercal.basics.errors import InputError
from inercal.recordings.io.column_table import file_head, file_sha256

METADATA = "metadata.yaml"
"""Name of the file that describes a bag."""
METADATA_START = b"rosbag2_bagfile_information"
_LIST = re.compile(r"^\s*relative_file_paths:[ \t]*\n((?:\s*- .+\n?)+)", re.MULTILINE)
_MOST_BYTES = 1 << 20


def bag_parts(path: Path) -> tuple[Path, ...]:
    """Return the files of a bag that its `metadata.yaml` lists.

    Raises
    ------
    InputError
        The file lists no parts, or a part is missing.
    """
    text = file_head(path, _MOST_BYTES).decode("utf-8", "replace").replace("\r\n", "\n")
    listed = _LIST.search(text)
    lines = [] if listed is None else listed[1].splitlines()
    names = [line.strip().removeprefix("-").strip().strip("'\"") for line in lines]
    # Older recorders also write the name of the folder.
    parts = tuple(path.parent / PurePosixPath(name).name for name in names if name)
    if not parts:
        raise InputError(
            f"{path.name} lists no files of a bag: name a file of the bag itself", file=path
        )
    missing = next((part for part in parts if not part.is_file()), None)
    if missing is not None:
        raise InputError(
            f"{path.name} lists {missing.name}, which is missing: put all files of the bag into "
            "its folder, or name one of them",
            file=path,
            names=(missing.name,),
        )
    return parts


def bag_size(path: Path) -> int:
    """Return the number of bytes of a bag, with all parts if the file lists them."""
    if file_head(path, len(METADATA_START)) != METADATA_START:
        return path.stat().st_size
    return sum(part.stat().st_size for part in bag_parts(path))


def bag_sha256(parts: Sequence[Path]) -> str:
    """Return a digest of the parts of a bag."""
    return sha256(
        "".join(f"{part.name} {file_sha256(part)}\n" for part in parts).encode()
    ).hexdigest()


class SplitBag:
    """The parts of a bag, which are read one after the other like a single file.

    Parameters
    ----------
    readers : sequence
        Open readers of the parts, in their order.
    """

    def __init__(self, readers: Sequence[Any]):
        self._readers = readers
        self.connections = [one for reader in readers for one in reader.connections]

    def messages(self, connections: Sequence[Any]) -> Iterator[Any]:
        """Yield connection, time in ns and bytes of each message."""
        for reader in self._readers:
            own = [one for one in reader.connections if any(one is other for other in connections)]
            if own:
                yield from reader.messages(own)

    def close(self) -> None:
        """Close all parts."""
        with ExitStack() as stack:
            for reader in self._readers:
                stack.callback(reader.close)
