"""Terminal output: text from names, notes or files cannot control the terminal."""

import os
from collections.abc import Iterable

from rich.console import Console, ConsoleOptions, ConsoleRenderable, RenderableType, RenderHook
from rich.segment import Segment

from inercal.basics.visible_text import visible_text

_FILE_WIDTH = 1000  # characters per line in a file or a pipe


def terminal(*, stderr: bool = False, highlight: bool = True) -> Console:
    """Return a console on standard output or error that prints text literally.

    Control characters are escaped, and "[red]" is not markup. Output to a file or a pipe is not
    wrapped.
    """
    console = Console(stderr=stderr, highlight=highlight, markup=False)
    if not console.is_terminal and "COLUMNS" not in os.environ:
        console.width = _FILE_WIDTH
    console.push_render_hook(_VisibleText())
    return console


class _VisibleText(RenderHook):
    def process_renderables(self, renderables: list[ConsoleRenderable]) -> list[ConsoleRenderable]:
        return [Visible(one) for one in renderables]


class Visible:
    """A renderable whose control characters are replaced by visible text.

    Parameters
    ----------
    inner : RenderableType
    """

    def __init__(self, inner: RenderableType):
        self._inner = inner

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterable[Segment]:
        for one in console.render(self._inner, options):
            yield one if one.control else Segment(visible_text(one.text, "\n"), one.style)
