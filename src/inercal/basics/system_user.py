"""The name of the user who runs the program."""

import os
from getpass import getuser


def user_name() -> str:
    """Return the name of the system's user, or the number of one without a name."""
    try:
        return getuser()
    except (ImportError, KeyError, OSError):  # as in containers
        return f"user {os.getuid()}" if hasattr(os, "getuid") else "unknown"
