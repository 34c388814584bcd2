"""Who may have the page: by token, host and origin; decided on what a request says, no more.

A page of another site in the same browser can send requests here, and so can one whose name was
made to lead here (DNS rebinding): the first says its own origin, the second another host.
"""

import hmac
import secrets
from base64 import urlsafe_b64encode
from collections import deque
from collections.abc import Mapping
from ipaddress import ip_address
from time import monotonic

from starlette.requests import cookie_parser
from starlette.responses import Response

from inercal.basics.errors import InputError

SESSION, VIEWER = "inercal-session", "inercal-viewer"
_MIN_TOKEN_LENGTH = 12  # characters of a token
_MAX_TRIES, _TRY_WINDOW = 10, 60.0  # wrong tokens of one address, s
_MAX_ADDRESSES = 1000


def is_loopback(host: str) -> bool:
    """Tell whether a host can be reached from this machine alone."""
    if host == "localhost":
        return True
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return False


class Access:
    """Decides who may have the page.

    Parameters
    ----------
    hosts : set of str
        What the page is called, with the port, where no token is needed.
    token : str or None
        That a browser must have shown once.

    Raises
    ------
    InputError
        A token that is soon guessed.
    """

    def __init__(self, hosts: frozenset[str], token: str | None):
        if token is not None and len(token) < _MIN_TOKEN_LENGTH:
            raise InputError(
                f"the token has {len(token)} characters; give at least {_MIN_TOKEN_LENGTH}, or no "
                "token",
                key="token",
            )
        self.session = secrets.token_urlsafe(32)
        self._viewer_key = secrets.token_bytes(32)
        self._hosts, self._token = hosts, token
        self.needs_token = token is not None
        self._failed_tries: dict[str, deque[float]] = {}

    def allows_host(self, headers: Mapping[str, str]) -> bool:
        """Tell whether the page is called so."""
        return self.needs_token or headers.get("host", "").lower() in self._hosts

    @staticmethod
    def is_same_origin(headers: Mapping[str, str]) -> bool:
        """Tell whether a request comes from this page itself."""
        host, origin = headers.get("host", "").lower(), headers.get("origin", "").lower()
        return bool(host) and origin in (f"http://{host}", f"https://{host}")

    @staticmethod
    def is_cross_site(headers: Mapping[str, str]) -> bool:
        """Tell whether a browser says that the request is of a page from elsewhere."""
        return headers.get("sec-fetch-site", "none") not in ("same-origin", "none")

    def has_session(self, headers: Mapping[str, str]) -> bool:
        """Tell whether a browser has shown the token before, or need not."""
        shown = cookie(headers, SESSION)
        return not self.needs_token or (
            shown is not None and _equal_in_constant_time(shown, self.session)
        )

    def viewer(self, headers: Mapping[str, str]) -> str | None:
        """Return which browser asks, by the cookie that this server has issued; None without one.

        A cookie of another's making, such as one that somebody else has chosen to be taken for the
        operator, counts as none.
        """
        shown = cookie(headers, VIEWER) or ""
        number, _, _ = shown.partition(".")
        genuine = _equal_in_constant_time(shown, self._viewer_cookie(number))
        return shown if genuine else None

    def issue_viewer(self, headers: Mapping[str, str], answer: Response) -> str:
        """Have a browser say later on which one it is, and return that."""
        value = self._viewer_cookie(secrets.token_urlsafe(16))
        name = cookie_name(headers, VIEWER)
        answer.set_cookie(name, value, httponly=True, samesite="strict")
        return value

    def _viewer_cookie(self, number: str) -> str:
        code = hmac.digest(self._viewer_key, number.encode(errors="replace"), "sha256")
        return f"{number}.{urlsafe_b64encode(code).decode().rstrip('=')}"

    def may_try_token(self, who: str) -> bool:
        """Tell whether an address has not shown too many wrong tokens lately."""
        tries = self._failed_tries.get(who)
        while tries and monotonic() - tries[0] > _TRY_WINDOW:
            tries.popleft()
        return tries is None or len(tries) < _MAX_TRIES

    def accepts_token(self, token: str, who: str) -> bool:
        """Tell whether that is the token, in a time that says nothing of it."""
        if self._token is None or _equal_in_constant_time(token, self._token):
            return True
        if who not in self._failed_tries and len(self._failed_tries) >= _MAX_ADDRESSES:
            del self._failed_tries[next(iter(self._failed_tries))]
        self._failed_tries.setdefault(who, deque(maxlen=_MAX_TRIES)).append(monotonic())
        return False


def cookie_name(headers: Mapping[str, str], name: str) -> str:
    """Return what a cookie is called where this page is: all ports of a host share theirs."""
    port = headers.get("host", "").rpartition(":")[2]
    return f"{name}-{port}" if port.isascii() and port.isdecimal() else name


def cookie(headers: Mapping[str, str], name: str) -> str | None:
    """Return a cookie; None where there is none of that name."""
    return cookie_parser(headers.get("cookie", "")).get(cookie_name(headers, name))


def _equal_in_constant_time(one: str, other: str) -> bool:
    return hmac.compare_digest(one.encode(errors="replace"), other.encode(errors="replace"))
