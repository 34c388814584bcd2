"""Finds lines of text in a buffer."""

import numpy as np

from inercal.host.packets.binary_decoder import DecodedPackets, Raw
from inercal.host.packets.packet_format import TextLine

# A line that is longer is none of ours: 40 fields, of 64 characters at most, and what separates
# them. Its end is kept, and cannot be taken for a line, for it is longer than any.
_MAX_LINE = 4096


def find_lines(buffer: bytes, line: TextLine) -> DecodedPackets:
    """Return the lines of a buffer that look as the picture says and whose check is right.

    Parameters
    ----------
    buffer : bytes
        Begins where the buffer before was used up.
    line : TextLine
    """
    matches = line.pattern.findall(buffer)
    failed = 0
    if line.checks and matches:
        good = _valid_checks(line, matches)
        failed = len(matches) - int(good.sum())
        matches = [match for match, right in zip(matches, good.tolist(), strict=True) if right]
    columns = list(zip(*matches, strict=True)) or [()] * line.pattern.groups
    raw: Raw = {}
    for field in line.fields:
        texts = columns[field.at - 1]
        if field.type[-1] == "x":
            raw[field.role] = np.array([int(text, 16) for text in texts], np.int64)
        else:
            kind = np.int64 if field.type == "d" else np.float64
            raw[field.role] = np.array(texts, dtype=bytes).astype(kind)
    used = max(buffer.rfind(b"\n") + 1, len(buffer) - _MAX_LINE)
    taken = sum(map(len, columns[0])) + sum(map(len, columns[-1]))
    if line.checks:
        separator = 1
        taken += len(matches) * (separator + line.checks[0].kind.bits // 4)
    return DecodedPackets(raw, len(matches), taken, used, failed)


def _valid_checks(
    line: TextLine, matches: list[tuple[bytes, ...]]
) -> "np.ndarray[tuple[int], np.dtype[np.bool_]]":
    """Return which lines have the checks that their characters make."""
    (check,) = line.checks
    covered = np.frombuffer(b"".join(match[0] for match in matches), np.uint8)
    stop = np.cumsum([len(match[0]) for match in matches], dtype=np.int64)
    start = np.concatenate([[0], stop[:-1]]).astype(np.int64) + check.start
    stated = np.array([int(match[check.at - 1], 16) for match in matches], np.uint32)
    return check.kind.span_checks(covered, start, stop) == stated
