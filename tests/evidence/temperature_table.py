"""The tables of docs/evidence/temperature.md: `python -m tests.evidence.temperature_table`."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tests.accuracy import ramps, soaks
from tests.evidence import temperature_ramps, temperature_soaks
from tests.evidence.stored_runs import write_page

HERE = Path(__file__).parents[2] / "docs" / "evidence"
SEED, TRIALS, RAMPS = 1, 400, 300
# Of the table of the method note: mg, ppm, mrad, µrad, K.
UNITS = {
    "k0": (1e-3 * soaks.G0, "mg"),
    "k0_dT": (1e-3 * soaks.G0, "mg/K"),
    "k0_dT2": (1e-3 * soaks.G0, "mg/K²"),
    "k0_dT3": (1e-3 * soaks.G0, "mg/K³"),
    "k1": (1e-6, "ppm"),
    "k1_dT": (1e-6, "ppm/K"),
    "k1_dT2": (1e-6, "ppm/K²"),
    "delta_o": (1e-3, "mrad"),
    "delta_p": (1e-3, "mrad"),
    "delta_o_dT": (1e-6, "µrad/K"),
    "delta_p_dT": (1e-6, "µrad/K"),
}
MG = 1e-3 * soaks.G0


@dataclass(frozen=True)
class Stored:
    """What is stored: numbers by name."""

    content: dict[str, Any]

    @classmethod
    def read(cls) -> "Stored":
        """Return the stored numbers."""
        return cls(json.loads((HERE / "temperature.json").read_text(encoding="utf-8")))


def measure(trials: int = TRIALS, runs: int = RAMPS) -> Stored:
    """Return the numbers anew."""
    found = temperature_soaks.fits(SEED, trials)
    made = temperature_soaks.table(found)
    chosen = temperature_soaks.orders_chosen(found)
    low: dict[str, float] = {}
    for orders in ((1, 0, 0), (2, 1, 0), (3, 1, 1)):
        estimate = temperature_soaks.fits(SEED, 40, orders).estimate
        low[", ".join(map(str, orders))] = float((estimate.chi2 / estimate.dof).mean())
    return Stored(
        {
            "seed": SEED,
            "soaks": {
                "trials": made.trials,
                "terms": {row.term: [row.rms, row.coverage] for row in made.rows},
                "nees": made.nees,
                "chi2/dof": made.ratio,
                "changes": made.changes,
                "covered": made.covered,
                "true orders": sum(one == temperature_soaks.TRUE_ORDERS for one in chosen),
                "orders too low": low,
            },
            "ramps": {
                name: temperature_ramps.row(name, profile, runs, SEED)._asdict()
                for name, profile in ramps.PROFILES.items()
            },
        }
    )


def page(stored: Stored) -> str:
    """Return the page."""
    own = stored.content["soaks"]
    runs = next(iter(stored.content["ramps"].values()))["runs"]
    lines = [
        "# Temperature: errors against what is stated",
        "",
        "Written by `python -m tests.evidence.temperature_table`; do not edit. The generators in",
        "tests/accuracy are independent of inercal. u is the stated standard uncertainty.",
        "",
        "## Soaks",
        "",
        f"{own['trials']} triads of MEMS accelerometers were measured in seven soaks from −40 to",
        "85 °C, on six faces in each soak. tests/accuracy/soaks.py states the sizes of the",
        "coefficients and errors. The coefficients refer to 25 °C.",
        "",
        "| coefficient | unit | rms of the error | within 2 u |",
        "|---|---|---|---|",
    ]
    for term, (rms, coverage) in own["terms"].items():
        size, unit = UNITS[term]
        lines.append(f"| `{term}` | {unit} | {rms / size:.3g} | {coverage:.3f} |")
    lines += [
        "",
        f"NEES is {own['nees']:.3f} per coefficient, and χ²/ν is {own['chi2/dof']:.3f}. AIC",
        f"chooses the true orders 3, 2, 1 for {own['true orders']} of {own['trials']} triads. If",
        "the orders are too low, χ²/ν is much larger: "
        + ", ".join(f"{ratio:.3g} ({orders})" for orders, ratio in own["orders too low"].items())
        + ".",
        "",
        "The next table is about the change of the bias from 25 °C to temperatures without a soak.",
        "",
        "| °C | rms of the error, mg | rms of u, mg |",
        "|---|---|---|",
    ]
    for celsius, rms, u in own["changes"]:
        lines.append(f"| {celsius:g} | {rms / MG:.3f} | {u / MG:.3f} |".replace("-", "−"))
    lines += [
        "",
        f"The error is within 2 u in {100 * own['covered']:.1f} % of all these changes.",
        "",
        "## Ramps at rest",
        "",
        f"Each profile has {runs} gyros and goes from −10 to 60 °C (self-heating: 15 to 57 °C).",
        "The temperature sensor lags by 20 s and has a noise of .01 K in each sample (1 Hz).",
        "The errors are those of b(T) − b(25 °C) from 0 to 50 °C, as far as the profile reaches.",
        "",
        "| profile | rms of the error, °/h | within 2 u | NEES / 3 | lag found, s |",
        "|---|---|---|---|---|",
    ]
    for name, row in stored.content["ramps"].items():
        lag = f"{row['lag']:.1f} ± {row['lag_scatter']:.1f}"
        lines.append(
            f"| {name} | {row['rms']:.2f} | {row['coverage']:.3f} | {row['nees']:.2f} | {lag} |"
        )
    lines += [
        "",
        "On a one-way ramp, the noise of the temperature sensor makes the estimated lag too small.",
        "The number behind ± is the scatter of the lag over the gyros. NEES is that of the three",
        "temperature terms.",
        "",
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    result = measure()
    text = json.dumps(result.content, indent=1, ensure_ascii=False)
    (HERE / "temperature.json").write_text(text + "\n", encoding="utf-8")
    write_page(HERE / "temperature.md", page(result))
