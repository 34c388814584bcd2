"""Files that contain something other than their name says: each is called what it is."""

import bz2
import gzip
import io
import lzma
import zipfile
from pathlib import Path

import pytest
from tests.refusals import refused

from inercal.recordings.io.read import read_table

TABLE = b"t,x\n" + b"".join(b"%d,1\n" % k for k in range(50))


def zipped(name: str) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr(name, TABLE)
    return file.getvalue()


POINTER = b"version https://git-lfs.github.com/spec/v1\noid sha256:" + b"0" * 64 + b"\nsize 9\n"
CONTENT = {
    "Git LFS": POINTER,
    "HTML": b"\n <!DOCTYPE HTML><html><body>404</body></html>",
    "HTML page": b"\xef\xbb\xbf<html lang=en><title>Sign in</title></html>",
    "empty": b"",
    "gzip": gzip.compress(TABLE),
    "bzip2": bz2.compress(TABLE),
    "xz": lzma.compress(TABLE),
    "ZIP": zipped("session.csv"),
    "PDF": b"%PDF-1.7\n%\xe2\xe3\n",
    ".xls": b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(100),
}


@pytest.mark.parametrize("what", CONTENT)
@pytest.mark.parametrize("suffix", [".csv", ".npz", ".xlsx", ".h5", ".bag"])
def test_a_file_is_called_what_it_is(tmp_path: Path, what: str, suffix: str):
    path = tmp_path / f"log{suffix}"
    path.write_bytes(CONTENT[what])
    with refused(file=path.name, line=None) as caught:
        read_table(path)
    assert what in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("suffix", [".npz", ".xlsx", ".h5", ".bag"])
def test_text_under_another_ending_is_called_text(tmp_path: Path, suffix: str):
    path = tmp_path / f"log{suffix}"
    path.write_bytes(TABLE)
    with refused(file=path.name) as caught:
        read_table(path)
    assert "text" in str(caught.value)
