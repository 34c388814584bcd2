"""The page's own files, compressed once when the server starts."""

import gzip
from importlib.resources.abc import Traversable

from starlette.requests import Request
from starlette.responses import Response

_MEDIA_TYPES = {
    "html": "text/html; charset=utf-8",
    "js": "text/javascript; charset=utf-8",
    "css": "text/css; charset=utf-8",
    "svg": "image/svg+xml",
}
_MISSING_PAGE = b"<!doctype html><title>inercal</title><p>The page's own files are not installed."


class StaticFile:
    """A static file of the page; a compressed copy saves 30 s over a link with 4 kB/s."""

    def __init__(self, content: bytes, media_type: str):
        self._content, self._media_type = content, media_type
        self._compressed = gzip.compress(content, mtime=0)

    def response(self, request: Request) -> Response:
        """Return the file in the encoding that the browser accepts."""
        headers = {"vary": "accept-encoding"}
        if "gzip" not in request.headers.get("accept-encoding", ""):
            return Response(self._content, media_type=self._media_type, headers=headers)
        headers["content-encoding"] = "gzip"
        return Response(self._compressed, media_type=self._media_type, headers=headers)


def static_files(folder: Traversable, prefix: str = "") -> list[tuple[str, StaticFile]]:
    """Return the static files, by the names in requests."""
    found: list[tuple[str, StaticFile]] = []
    if not folder.is_dir():
        return found
    for one in folder.iterdir():
        if one.is_dir():
            found += static_files(one, f"{prefix}{one.name}/")
        elif (kind := _MEDIA_TYPES.get(one.name.rpartition(".")[2])) is not None:
            found.append((f"{prefix}{one.name}", StaticFile(one.read_bytes(), kind)))
    return found


MISSING_PAGE = StaticFile(_MISSING_PAGE, _MEDIA_TYPES["html"])
