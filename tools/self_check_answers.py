"""Store what `inercal self-check` must find: ``python -m tools.self_check_answers``.

Do this only where a change of a method is meant to change its results, and say so in the changelog.
"""

import json
from pathlib import Path
from tempfile import TemporaryDirectory

import inercal.pipeline.self_check as known

ANSWERS = Path(known.__file__).parent / "answers.json"


def answers() -> dict[str, object]:
    """Compute the answers of all cases."""
    cases: dict[str, object] = {}
    with TemporaryDirectory() as name:
        folder = known.copy_cases(Path(name) / "cases")
        for method in known.CASES:
            calibration, grade, _ = known.compute(method, folder)
            cases[method] = {
                "grade": grade,
                "names": list(calibration.sensor.coefficients),
                "values": [float(f"{one:.12g}") for one in calibration.values],
                "u": [float(f"{one:.6g}") for one in calibration.std],
            }
            print(method, len(calibration.values), grade, flush=True)
    return {"versions": known.versions(), "cases": cases}


if __name__ == "__main__":
    ANSWERS.write_text(json.dumps(answers(), separators=(",", ":")) + "\n", encoding="utf-8")
