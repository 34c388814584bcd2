"""Find the name of the user who runs the program."""

import os
from getpass import getuser


def user_name() -> str:
    """Return the user's login name, or the user number if there is no name."""
    try:
        return getuser()
    except (ImportError, KeyError, OSError):  # there may be no name in a container
        return f"user {os.getuid()}" if hasattr(os, "getuid") else "unknown"
