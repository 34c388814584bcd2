"""Keys of [data] that belong to the reader of a format, such as a topic.

Which reader a file has is known when it is read: here only what no section has is set apart. What
the reader does not know of it is refused there.
"""

from collections.abc import Mapping
from typing import Any

from inercal.data.data_section import DataSection
from inercal.errors import InputError
from inercal.io.readers import known_options, readers_with_option


def reader_options(
    data: Mapping[str, Any], section: type[DataSection]
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return a section [data] without the options of readers, and these.

    Raises
    ------
    InputError
        A reader that takes a key for its own which [data] has.
    """
    own = section.model_fields
    if all(key in own for key in data):
        return dict(data), {}  # without a look at the installed packages
    known = tuple(known_options())
    for key in known:
        if key in own:
            raise InputError(
                f"reader {' and '.join(readers_with_option(key))} has an option {key!r}, which "
                "[data] has itself: it must be renamed"
            )
    return (
        {key: value for key, value in data.items() if key not in known},
        {key: value for key, value in data.items() if key in known},
    )
