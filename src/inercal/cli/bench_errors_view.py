"""The errors of the bench of a run file in the terminal: value, standard deviation, meaning."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from inercal.runfile import Run

_EACH = {"position": "each position", "turn": "each turn", "dwell": "each dwell",
         "pass": "each pass", "mounting": "each mounting", "speed": "each speed"}  # fmt: skip

_OTHER_KEYS = {"g": "gravity", **dict.fromkeys(("earth_up", "earth1", "earth2"), "latitude")}


def bench_errors(run: "Run") -> list[dict[str, Any]]:
    """Return the errors of the bench that are not exactly known, SI, with the key that states each.

    Parameters
    ----------
    run : Run
    """
    key_of = _keys(run)
    return [
        {
            "name": one.name,
            "key": key_of.get(one.name, _OTHER_KEYS.get(one.name, "")),
            "value": one.value,
            "std": one.sd,
            "unit": one.unit,
            "of": _EACH.get(one.scope, ""),
            "meaning": one.meaning,
        }
        for one in run.bench.parameters
        if one.sd > 0
    ]


def _keys(run: "Run") -> Mapping[str, str]:
    """Return the key of [bench] of each parameter that a key declares."""
    from inercal.benches.key_declarations import declarations

    found: dict[str, str] = {}
    for field, one in declarations(type(run.bench)).items():
        names = (field,) if isinstance(one.parameters, str) else one.parameters
        found |= dict.fromkeys(names, one.key or field)
    return found


def print_bench_errors(errors: Sequence[Mapping[str, Any]]) -> None:
    """Print the errors of a bench in a table: value and standard deviation in a usual unit."""
    from inercal.basics.parameters import Parameter, display_unit
    from inercal.basics.units import format_value_and_uncertainty
    from inercal.cli.tables import add_row, make_table, number_columns
    from inercal.cli.terminal import terminal

    heads = (
        "error of the bench",
        "key",
        *number_columns(("value", "u (k = 1)")),
        "unit",
        "meaning",
    )
    table = make_table(*heads)
    for row in errors:
        shown = Parameter(row["name"], row["unit"], row["std"], "run", row["value"])
        unit, si = display_unit(shown)
        cells = format_value_and_uncertainty(row["value"] / si, row["std"] / si)
        meaning = ", ".join(text for text in (row["meaning"], row["of"]) if text)
        add_row(table, row["name"], row["key"], *cells, unit, meaning)
    terminal(highlight=False).print(table)
