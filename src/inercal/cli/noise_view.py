"""A noise analysis in the terminal."""

from inercal.noise.channel_noise import NoiseAnalysis
from inercal.noise.texts import channel_remarks, coefficient_cells, movement_text


def print_analysis(analysis: NoiseAnalysis) -> None:
    """Print the coefficients of all channels, then the remarks on each."""
    from rich.text import Text

    from inercal.cli.tables import add_row, make_table, number_columns
    from inercal.cli.terminal import terminal

    heads = ("channel", "term", *number_columns(("value", "U (k = 2)", "95 % interval")), "unit",
             "significant")  # fmt: skip
    title = f"{analysis.source or 'recording'}: noise of {analysis.duration:.4g} s"
    table = make_table(*heads, title=title)
    for channel in analysis.channels:
        table.add_section()
        for one in channel.coefficients:
            add_row(table, channel.channel, *coefficient_cells(one))
    console = terminal()
    if analysis.movement:
        text = movement_text(analysis.movement, analysis.source)
        console.print(Text(f"NOT AT REST: {text}", style="bold red"))
    console.print(table)
    for text in analysis.remarks:
        console.print(Text(text))
    for channel in analysis.channels:
        for text in channel_remarks(channel):
            console.print(Text(f"{channel.channel}: {text}"))
