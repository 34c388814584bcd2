"""Keys of [bench] that act by their defaults: a draft states them, so that a user sees them.

They often dominate U: half a degree of a face's tilt, a degree of a turn.
"""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, cast

from inercal.basics.errors import InputError
from inercal.pipeline.drafts.draft_entries import UNKNOWN, DraftKey

if TYPE_CHECKING:
    from inercal.benches.kinds import Kind

_UNITS = "°"  # of an error message about a default, which no user sees


def default_bench_keys(content: Mapping[str, Any], method_name: str) -> tuple[DraftKey, ...]:
    """Return the keys of [bench] that no entry states and whose default is not zero.

    Parameters
    ----------
    content : mapping
        Sections of the drafted run file.
    method_name : str
        Of the proposed method: a default that changes none of its results is left out.
    """
    from inercal.benches.kinds import KINDS
    from inercal.methods import method
    from inercal.physics.plan import Turn
    from inercal.physics.section_settings import PLANNING, BenchUsage

    bench = cast("dict[str, Any]", content.get("bench", {}))
    kind = KINDS[bench.get("kind", "hand")]
    chosen = method(method_name)
    steps = () if chosen.unknown_attitudes or Turn not in kind.steps else chosen.plan()
    use = BenchUsage(
        method=chosen.name,
        turns=any(isinstance(step, Turn) for step in steps),
        attitudes=not chosen.unknown_attitudes,
        gyros="w" in chosen.default_coefficients and "gyro" in content.get("sensor", {}),
        means=content["data"].get("kind") == "means",
        rest=chosen.follows_rest,
        angles=not chosen.without_angles,
    )
    known = {key: value for key, value in bench.items() if value != UNKNOWN}
    unused = kind.section.model_construct(**known).unused_keys(use)
    meanings = _meanings(kind)
    found: list[DraftKey] = []
    for key, info in kind.section.model_fields.items():
        if key in bench or key in unused or info.json_schema_extra == PLANNING:
            continue
        default = cast("object", info.default)
        value = list(cast("tuple[object, ...]", default)) if isinstance(default, tuple) else default
        if _acts(value):
            meaning = meanings.get(key, info.description or "")
            words = f"{meaning}: " if meaning else ""
            found.append(DraftKey("bench", key, value, f"{words}the default; state yours"))
    return tuple(found)


def _acts(value: object) -> bool:
    """Return whether a default is a quantity, or a list of them, that is not exactly zero."""
    from inercal.basics.units import parse_quantity

    texts = cast("list[object]", value) if isinstance(value, list) else [value]
    for text in texts:
        if not isinstance(text, str) or not text[:1].isdigit():
            continue
        like = text.split(" ± ")[-1].partition(" ")[2]
        try:
            read = parse_quantity(text, like or _UNITS)
        except InputError:
            continue
        if read.value or read.sd:
            return True
    return False


def _meanings(kind: "Kind[Any, Any]") -> dict[str, str]:
    """Return what each declared key of a kind of bench means."""
    from inercal.benches.key_declarations import declarations

    found: dict[str, str] = {}
    for name, one in declarations(kind.bench).items():
        words = one.parameters
        each = [words] if isinstance(words, str) else list(dict.fromkeys(words.values()))
        found[one.key or name] = " and ".join(each)
    return found
