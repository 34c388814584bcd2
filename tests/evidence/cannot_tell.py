"""The page of what no residual shows, from the visibilities."""


def write() -> None:
    """Write the page."""
