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

_MAX_BODY = 1 << 16  # bytes of a body
_BODY_TIMEOUT = 10.0  # s for one
CONTENT_SECURITY_POLICY = (
    "default-src 'self'; base-uri 'none'; form-action 'self'; frame-ancestors 'none'; "
    "object-src 'none'"
)
_TOKEN_PAGE = """<!doctype html><html lang="en"><meta charset="utf-8"><title>inercal</title>
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<h1>inercal</h1><p>{words}</p>
<form method="post" action="/token"><label>Token <input name="token" type="password" autofocus
autocomplete="current-password"></label> <button>Open the page</button></form></html>
"""


class AccessMiddleware:
    """Lets through to an application what may pass.

    Parameters
    ----------
    app : ASGI application
    access : Access
    refused : RefusalLog
    """

    def __init__(self, app: ASGIApp, access: Access, refused: RefusalLog):
        self._app, self._access, self._refusals = app, access, refused

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request, or refuse it."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        if scope["type"] == "websocket":
            await self._serve_websocket(scope, headers, receive, send)
            return

        async def closing(message: Message) -> None:
            if message["type"] == "http.response.start":
                _set_security_headers(MutableHeaders(scope=message))
            await send(message)

        wrong = self._refusal(scope, headers)
        body = b""
        if wrong is None and scope["method"] != "GET":
            try:
                body = await asyncio.wait_for(_read_body(headers, receive), _BODY_TIMEOUT)
            except _BodyTooLarge:
                wrong = 413, f"a body of more than {_MAX_BODY} bytes"
            except TimeoutError:
                wrong = 408, f"a body that does not come within {_BODY_TIMEOUT:g} s"
        if wrong is not None:
            status, words = wrong
            self._refusals(_client_host(scope), f"{scope['method']} {scope['path']}: {words}")
            await PlainTextResponse(f"{words}\n", status)(scope, receive, closing)
            return
        answer = self._token_response(scope, headers, body)
        app = self._app if answer is None else answer
        await app(scope, _replay_body(body, receive), closing)

    async def _serve_websocket(
        self, scope: Scope, headers: Headers, receive: Receive, send: Send
    ) -> None:
        words = None
        if not self._access.allows_host(headers):
            words = f"host {headers.get('host', '')!r}"
        elif not self._access.is_same_origin(headers):
            words = f"origin {headers.get('origin', '')!r}"
        elif not self._access.has_session(headers):
            words = "no token"
        if words is None:
            await self._app(scope, receive, send)
            return
        self._refusals(_client_host(scope), f"websocket {scope['path']}: {words}")
        await receive()
        await send({"type": "websocket.close"})

    def _refusal(self, scope: Scope, headers: Headers) -> tuple[int, str] | None:
        """Return status and words of what is refused whoever asks."""
        if not self._access.allows_host(headers):
            return 421, f"host {headers.get('host', '')!r}: this page has another name"
        if scope["method"] not in ("GET", "POST"):
            return 405, f"no {scope['method']} here"
        if scope["method"] == "POST" and not self._access.is_same_origin(headers):
            return 403, f"origin {headers.get('origin', '')!r}: not this page"
        if scope["path"] != "/" and self._access.is_cross_site(headers):
            return 403, "asked for by a page from elsewhere"
        return None

    def _token_response(self, scope: Scope, headers: Headers, body: bytes) -> Response | None:
        """Return the answer to who has not yet shown the token, or shows it; None for all else."""
        if not self._access.needs_token:
            return None
        given: str | None = None
        if scope["path"] == "/token" and scope["method"] == "POST":
            given = _form_field(body, "token")
        elif scope["path"] == "/":
            given = _form_field(scope["query_string"], "token")
        if given is None:
            if self._access.has_session(headers):
                return None
            self._refusals(_client_host(scope), f"{scope['method']} {scope['path']}: no token")
            return _token_form("This page needs the token that `inercal bench serve` has printed.")
        who = _client_host(scope)
        if not self._access.may_try_token(who):
            self._refusals(who, "too many wrong tokens")
            return _token_form("Too many wrong tokens; wait a minute.", 429)
        if not self._access.accepts_token(given, who):
            self._refusals(who, "a wrong token")
            return _token_form("That is not the token.")
        answer = RedirectResponse("/", 303)
        name = cookie_name(headers, SESSION)
        answer.set_cookie(name, self._access.session, httponly=True, samesite="strict")
        return answer


def set_viewer_cookie(headers: Mapping[str, str], answer: Response) -> None:
    """Have a browser say later on which one it is."""
    if cookie(headers, VIEWER) is None:
        value = secrets.token_urlsafe(16)
        name = cookie_name(headers, VIEWER)
        answer.set_cookie(name, value, httponly=True, samesite="strict")


class _BodyTooLarge(Exception):
    """A body that is longer than may be."""


async def _read_body(headers: Headers, receive: Receive) -> bytes:
    """Return the body; what it says of its length is believed only where that is too much."""
    said = headers.get("content-length", "0")
    if not said.isdecimal() or len(said) > 9 or int(said) > _MAX_BODY:
        raise _BodyTooLarge
    body, more = b"", True
    while more:
        message = await receive()
        if message["type"] == "http.disconnect":
            return body
        body += message.get("body", b"")
        more = message.get("more_body", False)
        if len(body) > _MAX_BODY:
            raise _BodyTooLarge
    return body


def _replay_body(body: bytes, receive: Receive) -> Receive:
    """Return what gives the body that was read, and then what else comes."""
    given = False

    async def take() -> Message:
        nonlocal given
        if given:
            return await receive()
        given = True
        return {"type": "http.request", "body": body, "more_body": False}

    return take


def _set_security_headers(headers: MutableHeaders) -> None:
    headers.setdefault("content-security-policy", CONTENT_SECURITY_POLICY)
    headers.setdefault("referrer-policy", "no-referrer")
    headers.setdefault("cache-control", "no-store")
    headers["x-content-type-options"] = "nosniff"
    headers["x-frame-options"] = "DENY"
    headers["cross-origin-resource-policy"] = "same-origin"
    headers["cross-origin-opener-policy"] = "same-origin"
    headers["connection"] = "close"  # nothing of one request stays for the next


def _token_form(words: str, status: int = 401) -> Response:
    # Without a referrer a browser would call the origin of this form "null".
    return HTMLResponse(
        _TOKEN_PAGE.format(words=escape(words)), status, {"referrer-policy": "same-origin"}
    )


def _form_field(query: bytes, name: str) -> str | None:
    try:
        fields = parse_qs(query.decode("utf-8", "replace"), max_num_fields=8)
    except ValueError:
        return ""
    return fields.get(name, [None])[0]


def _client_host(scope: Mapping[str, Any]) -> str:
    client = scope.get("client")
    return client[0] if client else "somebody"
