"""Decides who may use the page, from the token, host and origin in the request.

A page of another site in the same browser can send requests to this server. So can a page whose
host name was made to resolve to this server (DNS rebinding). The first can be recognised by its
origin, and the second by its host.

Every request passes through `AccessMiddleware` before the page receives it, and so does every
answer. The middleware is pure ASGI. It first checks host, origin and token, and only then reads the
body, with limits on size and time. A script shows the read-only token in the Authorization header.
A request with this header can only read, whatever cookies it has. The middleware adds headers that
permit a browser to load only the page's own files.
"""

import hmac
import secrets
from base64 import urlsafe_b64encode
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from html import escape
from ipaddress import ip_address
from time import monotonic
from typing import Any
from urllib.parse import parse_qs

from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import cookie_parser
from starlette.responses import HTMLResponse, PlainTextResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from inercal.basics.errors import InputError
from inercal.host.web.json_objects import BodyReader, RefusalLog, RequestRefused

SESSION, VIEWER = "inercal-session", "inercal-viewer"
_MIN_TOKEN_LENGTH = 12  # smallest number of characters of a token
_MAX_TRIES, _TRY_WINDOW = 10, 60.0  # wrong tokens from one address, in s
_MAX_ADDRESSES = 1000


def is_loopback(host: str) -> bool:
    """Return whether a host can only be reached from this machine."""
    if host == "localhost":
        return True
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return False


class Access:
    """Decides who may use the page.

    Parameters
    ----------
    hosts : set of str
        Host names of the page, with the port, at which no token is needed.
    token : str or None
        Token that a browser must show once.
    read_token : str or None
        Token with which scripts read; it never permits a command.

    Raises
    ------
    InputError
        A token is too easy to guess, or both are the same.
    """

    def __init__(self, hosts: frozenset[str], token: str | None, read_token: str | None = None):
        for name, one in (("token", token), ("read-only token", read_token)):
            if one is not None and len(one) < _MIN_TOKEN_LENGTH:
                raise InputError(
                    f"the {name} has {len(one)} characters; give at least {_MIN_TOKEN_LENGTH}, "
                    f"or no {name}",
                    key=name,
                )
        if token is not None and token == read_token:
            raise InputError(
                "the read-only token and the token of the page are the same; give two tokens",
                key="read-only token",
            )
        self.session = secrets.token_urlsafe(32)
        self._viewer_key = secrets.token_bytes(32)
        self._hosts, self._token, self._read_token = hosts, token, read_token
        self.needs_token = token is not None
        self._failed_tries: dict[str, deque[float]] = {}

    def allows_host(self, headers: Mapping[str, str]) -> bool:
        """Return whether a request is addressed to one of the page's hosts."""
        return self.needs_token or headers.get("host", "").lower() in self._hosts

    @staticmethod
    def is_same_origin(headers: Mapping[str, str]) -> bool:
        """Return whether a request comes from this page."""
        host, origin = headers.get("host", "").lower(), headers.get("origin", "").lower()
        return bool(host) and origin in (f"http://{host}", f"https://{host}")

    @staticmethod
    def is_cross_site(headers: Mapping[str, str]) -> bool:
        """Return whether a request comes from a page of another site, according to the browser."""
        return headers.get("sec-fetch-site", "none") not in ("same-origin", "none")

    def has_session(self, headers: Mapping[str, str]) -> bool:
        """Return whether a browser has already shown the token or does not need a token."""
        shown = cookie(headers, SESSION)
        return not self.needs_token or (
            shown is not None and _equal_in_constant_time(shown, self.session)
        )

    def viewer(self, headers: Mapping[str, str]) -> str | None:
        """Return the cookie by which this server identifies a browser; None if there is none.

        Cookies from other sources are not accepted, because somebody could choose a cookie to be
        mistaken for the operator.
        """
        shown = cookie(headers, VIEWER) or ""
        number, _, _ = shown.partition(".")
        genuine = _equal_in_constant_time(shown, self._viewer_cookie(number))
        return shown if genuine else None

    def issue_viewer(self, headers: Mapping[str, str], answer: Response) -> str:
        """Issue a cookie that identifies a browser in later requests, and return its value."""
        value = self._viewer_cookie(secrets.token_urlsafe(16))
        name = cookie_name(headers, VIEWER)
        answer.set_cookie(name, value, httponly=True, samesite="strict")
        return value

    def _viewer_cookie(self, number: str) -> str:
        code = hmac.digest(self._viewer_key, number.encode(errors="replace"), "sha256")
        return f"{number}.{urlsafe_b64encode(code).decode().rstrip('=')}"

    def may_try_token(self, who: str) -> bool:
        """Return whether an address may try a token; False after too many wrong tokens."""
        tries = self._failed_tries.get(who)
        while tries and monotonic() - tries[0] > _TRY_WINDOW:
            tries.popleft()
        return tries is None or len(tries) < _MAX_TRIES

    def accepts_token(self, token: str, who: str) -> bool:
        """Return whether a token is correct; the time that this takes reveals nothing about it."""
        return self._token is None or self._is_right(token, self._token, who)

    def accepts_read_token(self, token: str, who: str) -> bool:
        """Return whether a read-only token is correct, as `accepts_token` does."""
        return self._read_token is not None and self._is_right(token, self._read_token, who)

    def _is_right(self, token: str, expected: str, who: str) -> bool:
        if _equal_in_constant_time(token, expected):
            return True
        if who not in self._failed_tries and len(self._failed_tries) >= _MAX_ADDRESSES:
            del self._failed_tries[next(iter(self._failed_tries))]
        self._failed_tries.setdefault(who, deque(maxlen=_MAX_TRIES)).append(monotonic())
        return False


def bearer_token(headers: Mapping[str, str]) -> str | None:
    """Return the token in the Authorization header (RFC 6750); None if there is none."""
    scheme, _, token = headers.get("authorization", "").partition(" ")
    return token.strip() if scheme.lower() == "bearer" else None


def cookie_name(headers: Mapping[str, str], name: str) -> str:
    """Return the name of a cookie with the port, because all ports of a host share cookies."""
    port = headers.get("host", "").rpartition(":")[2]
    return f"{name}-{port}" if port.isascii() and port.isdecimal() else name


def cookie(headers: Mapping[str, str], name: str) -> str | None:
    """Return the value of a cookie; None if there is no cookie with this name."""
    return cookie_parser(headers.get("cookie", "")).get(cookie_name(headers, name))


def _equal_in_constant_time(one: str, other: str) -> bool:
    return hmac.compare_digest(one.encode(errors="replace"), other.encode(errors="replace"))


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


_READ_ONLY = "a read-only token permits only the GET requests in /api/openapi.json"


@dataclass(eq=False)
class AccessMiddleware:
    """Middleware that passes only permitted requests to an application.

    Parameters
    ----------
    app : ASGI application
    access : Access
    refused : RefusalLog
    is_readable : callable
        Function that returns whether a read-only token permits a request, from its scope.
    """

    app: ASGIApp
    access: Access
    refused: RefusalLog
    is_readable: Callable[[Scope], bool]
    _bodies: BodyReader = field(default_factory=BodyReader)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request, or refuse it."""
        if scope["type"] == "lifespan":
            await self.app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        if scope["type"] == "websocket":
            await self._serve_websocket(scope, headers, receive, send)
            return

        async def closing(message: Message) -> None:
            if message["type"] == "http.response.start":
                _set_security_headers(MutableHeaders(scope=message))
            await send(message)

        app = self.app
        try:
            self._require_allowed(scope, headers)
            answer, body = self._token_refusal(scope, headers), b""
            if answer is None and scope["method"] != "GET":
                body = await self._bodies.read(client_host(scope), headers, receive)
            app = answer or self._token_answer(scope, body) or app
        except RequestRefused as refused:
            words = f"{scope['method']} {scope['path']}: {refused.words}"
            self.refused(client_host(scope), words)
            schemes = {"www-authenticate": "Bearer"} if refused.status == 401 else None
            app = PlainTextResponse(f"{refused.words}\n", refused.status, schemes)
            body = b""
        await app(scope, _replay_body(body, receive), closing)

    async def _serve_websocket(
        self, scope: Scope, headers: Headers, receive: Receive, send: Send
    ) -> None:
        words = None
        if not self.access.allows_host(headers):
            words = f"host {headers.get('host', '')!r}"
        elif bearer_token(headers) is not None:
            words = _READ_ONLY
        elif not self.access.is_same_origin(headers):
            words = f"origin {headers.get('origin', '')!r}"
        elif not self.access.has_session(headers):
            words = "no token"
        if words is None:
            await self.app(scope, receive, send)
            return
        self.refused(client_host(scope), f"websocket {scope['path']}: {words}")
        await receive()
        await send({"type": "websocket.close"})

    def _require_allowed(self, scope: Scope, headers: Headers) -> None:
        """Raise an error for requests that are never permitted, whoever sends them."""
        if not self.access.allows_host(headers):
            raise RequestRefused(
                421, f"host {headers.get('host', '')!r}: this page has another host name"
            )
        if scope["method"] not in ("GET", "POST"):
            raise RequestRefused(405, f"{scope['method']} is not allowed here")
        if scope["method"] == "POST" and not self.access.is_same_origin(headers):
            own = f"http://{headers.get('host', '')}"
            raise RequestRefused(
                403,
                f"origin {headers.get('origin', '')!r} is not this page's; a command needs the "
                f"header Origin with the address of the page, such as {own!r}",
            )
        if scope["path"] != "/" and self.access.is_cross_site(headers):
            raise RequestRefused(403, "the request came from another site's page")

    def _token_refusal(self, scope: Scope, headers: Headers) -> Response | None:
        """Return the answer to a client without a token or with too many tries; otherwise None."""
        who = client_host(scope)
        if (token := bearer_token(headers)) is not None:
            # A script with an old token must not lock out the browser on the same machine.
            self._require_read_only(scope, token, f"script at {who}")
            return None
        if self._shows_token(scope):
            if self.access.may_try_token(who):
                return None
            self.refused(who, "too many wrong tokens")
            return _token_form("Too many wrong tokens; wait a minute.", 429)
        if self.access.has_session(headers):
            return None
        self.refused(who, f"{scope['method']} {scope['path']}: no token")
        return _token_form("This page needs the token that `inercal bench serve` has printed.")

    def _require_read_only(self, scope: Scope, token: str, who: str) -> None:
        """Raise an error unless a script has shown the read-only token and only reads."""
        if not self.access.may_try_token(who):
            raise RequestRefused(429, "too many wrong tokens; wait a minute")
        if not self.access.accepts_read_token(token, who):
            raise RequestRefused(401, "this read-only token is wrong")
        if not self.is_readable(scope):
            raise RequestRefused(403, _READ_ONLY)

    def _shows_token(self, scope: Scope) -> bool:
        """Return whether a request contains a token, whether correct or wrong."""
        if not self.access.needs_token:
            return False
        if scope["method"] == "POST":
            return scope["path"] == "/token"
        return scope["path"] == "/" and _token_field(scope["query_string"]) is not None

    def _token_answer(self, scope: Scope, body: bytes) -> Response | None:
        """Return the answer to a request that contains a token; otherwise None."""
        if not self._shows_token(scope):
            return None
        given = _token_field(body if scope["method"] == "POST" else scope["query_string"])
        who = client_host(scope)
        if given is None or not self.access.accepts_token(given, who):
            self.refused(who, "a wrong token")
            return _token_form("This token is wrong.")
        answer = RedirectResponse("/", 303)
        name = cookie_name(Headers(scope=scope), SESSION)
        answer.set_cookie(name, self.access.session, httponly=True, samesite="strict")
        return answer


def _replay_body(body: bytes, receive: Receive) -> Receive:
    """Return a function that first returns the body that was read, and then receives as before."""
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
    headers["connection"] = "close"  # because a request must not affect the next


def _token_form(words: str, status: int = 401) -> Response:
    # Without a referrer, a browser would state the origin of this form as "null".
    return HTMLResponse(
        _TOKEN_PAGE.format(words=escape(words)), status, {"referrer-policy": "same-origin"}
    )


def _token_field(query: bytes) -> str | None:
    try:
        fields = parse_qs(query.decode("utf-8", "replace"), max_num_fields=8)
    except ValueError:
        return ""
    return fields.get("token", [None])[0]


def client_host(scope: Mapping[str, Any]) -> str:
    """Return the address of the client."""
    client = scope.get("client")
    return client[0] if client else "somebody"
