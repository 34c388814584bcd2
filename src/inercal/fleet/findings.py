"""Express the conclusions from the statistics of a fleet as sentences and as a JSON object."""

from collections.abc import Sequence
from math import inf, isfinite, isnan

from inercal.basics.units import format_count
from inercal.fleet import statistics

_NAMED = 8  # largest number of names listed for a finding


def summary_lines(found: statistics.FleetStatistics) -> tuple[str, list[str]]:
    """Return a one-line summary of the statistics, and lines about results that need attention."""
    population = found.population
    count = format_count(len(population.ids), "sensor")
    if found.yields:
        first = found.yields[0]
        count = format_count(first.sensors, "sensor")
        without = f"; {first.unjudged} without a usable result" * bool(first.unjudged)
        summary = f"{100 * first.share:.4g} % of {count} pass ({rule_text(first)}{without})"
    else:
        summary = count
    return summary, _findings(found)


def _findings(found: statistics.FleetStatistics) -> list[str]:
    texts = found.population.status.attention_lines()
    if found.population.outdated:
        outdated = format_count(found.population.outdated, "result is", "results are")
        texts.append(f"{outdated} outdated; calibrate the line again")
    if found.outliers:
        outliers = format_count(len(found.outliers), "outlier")
        named = ", ".join(one.id for one in found.outliers[:_NAMED])
        more = f" and {len(found.outliers) - _NAMED} more" * (len(found.outliers) > _NAMED)
        chance = f"{found.outliers_by_chance:g} would be expected by chance"
        texts.append(f"{outliers} ({chance}): {named}{more}")
    drifting = [one for one in found.contrasts if one.significant]
    if drifting:
        names = dict.fromkeys(f"{one.coefficient} ({one.of})" for one in drifting)
        listed = ", ".join(list(names)[:_NAMED])
        trends = format_count(
            len(drifting),
            "trend or difference between stations is",
            "trends or differences between stations are",
        )
        texts.append(f"{trends} significant: {listed}")
    beyond = [one for one in found.charts if one.beyond]
    if beyond:
        listed = ", ".join(
            f"{one.station or 'all stations'} ({one.beyond})" for one in beyond[:_NAMED]
        )
        texts.append(f"χ²/ν is beyond its control limits at {listed}")
    hidden = [one.name for one in found.coefficients if isnan(one.summary.truth_sd)]
    if hidden:
        texts.append(
            "these coefficients scatter less than their uncertainties explain, so either u is "
            f"stated too large or it hides the true scatter: {', '.join(hidden)}"
        )
    poor = [one.name for one in found.coefficients if one.observed and one.observed.high < 1]
    if poor:
        texts.append(f"Cpk is below 1 for {', '.join(poor)}")
    return texts


def rule_text(one: statistics.RuleYield) -> str:
    """Describe a decision rule."""
    return "simple" if one.rule.name == "simple" else f"guarded, w = {one.rule.factor:g} U"


def statistics_object(found: statistics.FleetStatistics) -> dict[str, object]:
    """Return the statistics as a JSON object, in SI units."""
    population = found.population
    return {
        "sensors": len(population.ids),
        "left_out": population.left_out,
        "outdated": population.outdated,
        "unreliable": dict(population.status.unreliable),
        "same_recording": [list(names) for names in population.status.same_recording],
        **population.status.named_sensors(),
        "coefficients": [_coefficient_object(one) for one in found.coefficients],
        "lots": _group_objects(found.lots, population.names),
        "stations": _group_objects(found.stations, population.names),
        "outliers": [vars(one) for one in found.outliers],
        "outliers_searched": found.outliers_searched,
        "outliers_by_chance": found.outliers_by_chance,
        "trends": [vars(one) for one in found.contrasts if one.of in statistics.TRENDS],
        "station_differences": [
            vars(one) for one in found.contrasts if one.of not in statistics.TRENDS
        ],
        "yield": [
            {
                "rule": one.rule.name,
                "factor": one.rule.factor,
                "share": one.share,
                **one.counts,
                "without a usable result": one.unjudged,
            }
            for one in found.yields
        ],
        "control_charts": {
            "centre": found.centre,
            "stations": [
                {
                    "station": one.station,
                    "runs": one.runs,
                    "points": len(one.ratio),
                    "beyond": one.beyond,
                    "mean": float(one.ratio.mean()),
                }
                for one in found.charts
            ],
        },
    }


def _coefficient_object(one: statistics.CoefficientStatistics) -> dict[str, object]:
    parts, limits = one.components, one.limits or (-inf, inf)
    return {
        "name": one.name,
        **vars(one.summary),
        "quantiles": dict(zip(map(str, statistics.QUANTILES), one.quantiles, strict=True)),
        "components": {
            "mean": parts.mean,
            "mean_std": parts.std,
            "within": vars(parts.within),
            "lots": None if parts.lots is None else vars(parts.lots),
        },
        "limits": [limit if isfinite(limit) else None for limit in limits],
        "cpk": None if one.observed is None else one.observed._asdict(),
        "cpk_truth": None if one.truth is None else one.truth._asdict(),
    }


def _group_objects(
    groups: Sequence[statistics.GroupStatistics], names: Sequence[str]
) -> list[dict[str, object]]:
    return [
        {
            "name": group.name,
            "coefficients": {
                name: vars(one) for name, one in zip(names, group.summaries, strict=True)
            },
        }
        for group in groups
    ]
