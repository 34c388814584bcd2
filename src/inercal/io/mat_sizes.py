"""How much the packed variables of a MATLAB file of version 7 hold once they are loaded.

A packed variable is one deflate stream of elements (MAT-File Format, MathWorks, chapter 1). Cells
and structs hold matrices as further elements of the same stream, so that one loop over elements
sees all of them, however deep they are. Nothing of what is unpacked is kept.
"""

import os
import struct
import zlib
from collections.abc import Iterator
from math import prod
from pathlib import Path
from typing import BinaryIO, Literal, NamedTuple

from inercal.errors import InputError

Order = Literal["little", "big"]

_TITLE = 128  # bytes
_COMPRESSED, _MATRIX = 15, 14  # types of elements
_CELL, _STRUCT, _OBJECT, _SPARSE, _LAST_NUMERIC = 1, 2, 3, 5, 15  # classes of matrices
_COMPLEX = 0x800  # flag
_ARRAY = 256  # bytes of memory that an array takes, however few values it has
# Bytes of memory that a byte can become: a matrix without values has eight. Deflate reaches 1032.
_MOST_LOADED = _ARRAY // 8
_MOST_PACKED = 1100 * _MOST_LOADED
_BLOCK, _PADDING = 1 << 20, 64  # bytes


class LoadedSize(NamedTuple):
    """How much memory a packed variable needs, bytes, and whether it holds further matrices."""

    size: int
    holds_others: bool


def loaded_sizes(path: Path, limit: int) -> Iterator[LoadedSize]:
    """Yield the sizes of the packed variables; counting stops where one exceeds the limit.

    A variable that cannot exceed the limit is not unpacked, and not counted.

    Raises
    ------
    InputError
        A variable is longer than it declares.
    """
    with path.open("rb") as file:
        if not file.read(_TITLE).startswith(b"MATLAB 5.0"):
            return
        file.seek(126)
        order: Order = "little" if file.read(2) == b"IM" else "big"
        while len(tag := file.read(8)) == 8:
            kind, size = _words(tag, order)
            end = file.tell() + size
            if kind == _COMPRESSED and size * _MOST_PACKED > limit:
                yield _loaded_size(_Unpacker(file, end), order, limit)
            file.seek(end, os.SEEK_SET)


def _words(data: bytes, order: Order) -> tuple[int, ...]:
    """Return unsigned integers of four bytes."""
    count = len(data) // 4
    return struct.unpack(f"{'<' if order == 'little' else '>'}{count}I", data[: 4 * count])


def _loaded_size(stream: "_Unpacker", order: Order, limit: int) -> LoadedSize:
    tag = stream.take(8)
    declared = _words(tag, order)[1] + 8 if len(tag) == 8 else 0
    if (declared + _PADDING) * _MOST_LOADED <= limit:
        stream.skip(declared + _PADDING)
        size, holds_others = stream.count, False
    else:
        size, holds_others = _size_of_matrices(stream, order, limit, declared)
    # What a variable declares may be too little: then the file is damaged, or made to seem so.
    if size <= limit and stream.count > declared:
        raise InputError("a packed variable is longer than it declares; write the file again")
    return LoadedSize(size, holds_others)


def _size_of_matrices(
    stream: "_Unpacker", order: Order, limit: int, declared: int
) -> tuple[int, bool]:
    """Return the size of the matrix whose tag was read, and whether it holds others."""
    size, holds_others, to_come = 0, False, 1  # matrices of which no head was read
    kind, length = _MATRIX, declared - 8
    while True:
        if kind == _MATRIX:
            to_come -= 1
            head = _matrix_head(stream, order) if length else _MatrixHead(0, 0)
            size += _ARRAY * (1 + head.others) + head.bytes
            holds_others |= head.others > 0
            to_come += head.others
        elif not kind >> 16:  # the data of a small element are in the tag
            stream.skip(length + -length % 8)
        size = max(size, stream.count)
        tag = stream.take(8)
        if len(tag) < 8 or size > limit or stream.count > declared:
            return size, holds_others
        kind, length = _words(tag, order)
        if kind == _MATRIX and not to_come:
            return size, holds_others  # nobody reads what follows


class _MatrixHead(NamedTuple):
    """How many bytes the values of a matrix need, and how many matrices follow as its contents."""

    bytes: int
    others: int


def _matrix_head(stream: "_Unpacker", order: Order) -> _MatrixHead:
    """Read what stands before the values of a matrix whose tag was read."""
    head = stream.take(16)
    flags = _words(head, order)[2] if len(head) == 16 else _LAST_NUMERIC + 1
    matrix_class = flags & 0xFF
    if matrix_class > _LAST_NUMERIC:  # functions and objects have no shape
        return _MatrixHead(0, 0)
    count = prod(_words(_data(stream, order), order))
    _data(stream, order)  # the name
    if matrix_class == _OBJECT:
        _data(stream, order)  # the name of the class
    if matrix_class in (_STRUCT, _OBJECT):
        letters = _words(_data(stream, order), order)
        names = len(_data(stream, order))
        return _MatrixHead(0, count * names // max(letters[0] if letters else 1, 1))
    if matrix_class == _CELL:
        return _MatrixHead(0, count)
    if matrix_class == _SPARSE:
        return _MatrixHead(0, 0)  # its shape is not what it has
    return _MatrixHead(8 * count * (2 if flags & _COMPLEX else 1), 0)


def _data(stream: "_Unpacker", order: Order) -> bytes:
    """Return the data of the next element, a short one."""
    tag = stream.take(8)
    if len(tag) < 8:
        return b""
    kind, length = _words(tag, order)
    if kind >> 16:
        return tag[4 : 4 + min(kind >> 16, 4)]
    data = stream.take(min(length, _BLOCK))
    stream.skip(length - len(data) + -length % 8)
    return data


class _Unpacker:
    """A deflate stream of a file that is read once, in order.

    Parameters
    ----------
    file : binary file
        At the stream.
    end : int
        Where the stream ends in the file.
    """

    def __init__(self, file: BinaryIO, end: int):
        self._file, self._end = file, end
        self._stream = zlib.decompressobj()
        self._block = b""
        self._at: int = 0  # of the block, passed
        self.count = 0  # bytes unpacked and passed

    def take(self, size: int) -> bytes:
        """Return the next bytes; fewer, or none, at the end."""
        result = b""
        while len(result) < size and self._fill():
            part = self._block[self._at : self._at + size - len(result)]
            self._at += len(part)
            result += part
        self.count += len(result)
        return result

    def skip(self, size: int) -> None:
        """Pass bytes over."""
        while size > 0 and self._fill():
            passed = min(size, len(self._block) - self._at)
            self._at += passed
            self.count += passed
            size -= passed

    def _fill(self) -> bool:
        """Unpack the next block where all of the last was passed; False at the end."""
        while self._at == len(self._block):
            if self._stream.eof:
                return False
            left = max(self._end - self._file.tell(), 0)
            packed = self._stream.unconsumed_tail or self._file.read(min(_BLOCK, left))
            if not packed:
                return False
            self._block, self._at = self._stream.decompress(packed, _BLOCK), 0
        return True
