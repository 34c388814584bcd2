"""What every request passes before the page sees it, and every answer on its way out.

Pure ASGI: host, origin, token; a body that is read up to a limit of size and time and no further;
headers that let a browser load nothing but the page's own.
"""

import asyncio
import secrets
from collections.abc import Mapping
from html import escape
from typing import Any
from urllib.parse import parse_qs

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import HTMLResponse, PlainTextResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from inercal.host.web.access import SESSION, VIEWER, Access, cookie, cookie_name
from inercal.host.web.refusal_log import RefusalLog

_MOST = 1 << 16  # bytes of a body
_PATIENCE = 10.0  # s for one
POLICY = (
    "default-src 'self'; base-uri 'none'; form-action 'self'; frame-ancestors 'none'; "
    "object-src 'none'"
)
_ASKS = """<!doctype html><html lang="en"><meta charset="utf-8"><title>inercal</title>
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<h1>inercal</h1><p>{words}</p>
<form method="post" action="/token"><label>Token <input name="token" type="password" autofocus
autocomplete="current-password"></label> <button>Open the page</button></form></html>
"""


class Gate:
    """Lets through to an application what may pass.

    Parameters
    ----------
    app : ASGI application
    access : Access
    refused : RefusalLog
    """

    def __init__(self, app: ASGIApp, access: Access, refused: RefusalLog):
        self._app, self._access, self._refused = app, access, refused

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request, or refuse it."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        if scope["type"] == "websocket":
            await self._socket(scope, headers, receive, send)
            return

        async def closing(message: Message) -> None:
            if message["type"] == "http.response.start":
                _guard(MutableHeaders(scope=message))
            await send(message)

        wrong = self._wrong(scope, headers)
        body = b""
        if wrong is None and scope["method"] != "GET":
            try:
                body = await asyncio.wait_for(_whole(headers, receive), _PATIENCE)
            except _TooLarge:
                wrong = 413, f"a body of more than {_MOST} bytes"
            except TimeoutError:
                wrong = 408, f"a body that does not come within {_PATIENCE:g} s"
        if wrong is not None:
            status, words = wrong
            self._refused(_who(scope), f"{scope['method']} {scope['path']}: {words}")
            await PlainTextResponse(f"{words}\n", status)(scope, receive, closing)
            return
        answer = self._at_the_door(scope, headers, body)
        app = self._app if answer is None else answer
        await app(scope, _again(body, receive), closing)

    async def _socket(self, scope: Scope, headers: Headers, receive: Receive, send: Send) -> None:
        words = None
        if not self._access.knows_host(headers):
            words = f"host {headers.get('host', '')!r}"
        elif not self._access.is_own(headers):
            words = f"origin {headers.get('origin', '')!r}"
        elif not self._access.is_known(headers):
            words = "no token"
        if words is None:
            await self._app(scope, receive, send)
            return
        self._refused(_who(scope), f"websocket {scope['path']}: {words}")
        await receive()
        await send({"type": "websocket.close"})

    def _wrong(self, scope: Scope, headers: Headers) -> tuple[int, str] | None:
        """Return status and words of what is refused whoever asks."""
        if not self._access.knows_host(headers):
            return 421, f"host {headers.get('host', '')!r}: this page has another name"
        if scope["method"] not in ("GET", "POST"):
            return 405, f"no {scope['method']} here"
        if scope["method"] == "POST" and not self._access.is_own(headers):
            return 403, f"origin {headers.get('origin', '')!r}: not this page"
        if scope["path"] != "/" and self._access.is_foreign(headers):
            return 403, "asked for by a page from elsewhere"
        return None

    def _at_the_door(self, scope: Scope, headers: Headers, body: bytes) -> Response | None:
        """Return the answer to who has not yet shown the token, or shows it; None for all else."""
        if not self._access.needs_token:
            return None
        given: str | None = None
        if scope["path"] == "/token" and scope["method"] == "POST":
            given = _field(body, "token")
        elif scope["path"] == "/":
            given = _field(scope["query_string"], "token")
        if given is None:
            if self._access.is_known(headers):
                return None
            self._refused(_who(scope), f"{scope['method']} {scope['path']}: no token")
            return _asking("This page needs the token that `inercal bench serve` has printed.")
        who = _who(scope)
        if not self._access.may_try(who):
            self._refused(who, "too many wrong tokens")
            return _asking("Too many wrong tokens; wait a minute.", 429)
        if not self._access.accepts(given, who):
            self._refused(who, "a wrong token")
            return _asking("That is not the token.")
        answer = RedirectResponse("/", 303)
        name = cookie_name(headers, SESSION)
        answer.set_cookie(name, self._access.session, httponly=True, samesite="strict")
        return answer


def viewer_cookie(headers: Mapping[str, str], answer: Response) -> None:
    """Have a browser say later on which one it is."""
    if cookie(headers, VIEWER) is None:
        value = secrets.token_urlsafe(16)
        name = cookie_name(headers, VIEWER)
        answer.set_cookie(name, value, httponly=True, samesite="strict")


class _TooLarge(Exception):
    """A body that is longer than may be."""


async def _whole(headers: Headers, receive: Receive) -> bytes:
    """Return the body; what it says of its length is believed only where that is too much."""
    said = headers.get("content-length", "0")
    if not said.isdecimal() or len(said) > 9 or int(said) > _MOST:
        raise _TooLarge
    body, more = b"", True
    while more:
        message = await receive()
        if message["type"] == "http.disconnect":
            return body
        body += message.get("body", b"")
        more = message.get("more_body", False)
        if len(body) > _MOST:
            raise _TooLarge
    return body


def _again(body: bytes, receive: Receive) -> Receive:
    """Return what gives the body that was read, and then what else comes."""
    given = False

    async def take() -> Message:
        nonlocal given
        if given:
            return await receive()
        given = True
        return {"type": "http.request", "body": body, "more_body": False}

    return take


def _guard(headers: MutableHeaders) -> None:
    headers.setdefault("content-security-policy", POLICY)
    headers.setdefault("referrer-policy", "no-referrer")
    headers.setdefault("cache-control", "no-store")
    headers["x-content-type-options"] = "nosniff"
    headers["x-frame-options"] = "DENY"
    headers["cross-origin-resource-policy"] = "same-origin"
    headers["cross-origin-opener-policy"] = "same-origin"
    headers["connection"] = "close"  # nothing of one request stays for the next


def _asking(words: str, status: int = 401) -> Response:
    # Without a referrer a browser would call the origin of this form "null".
    return HTMLResponse(
        _ASKS.format(words=escape(words)), status, {"referrer-policy": "same-origin"}
    )


def _field(query: bytes, name: str) -> str | None:
    try:
        fields = parse_qs(query.decode("utf-8", "replace"), max_num_fields=8)
    except ValueError:
        return ""
    return fields.get(name, [None])[0]


def _who(scope: Mapping[str, Any]) -> str:
    client = scope.get("client")
    return client[0] if client else "somebody"
