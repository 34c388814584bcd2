"""A calibration written for C and for PX4, and parameters of a board read and compared with it."""

from pathlib import Path

import inercal
from inercal.calibration.comparison import compare

examples = Path(__file__).parent.parent
calibration = inercal.calibrate(examples / "six_position" / "run.toml").calibration

for target, options in (("c", {}), ("px4", {"acc_id": 1310988})):
    made = inercal.export_calibration(calibration, target, options=options, name="imu")
    Path(f"imu{made.target.suffix}").write_text(made.text, encoding="utf-8")
    for one in made.losses:
        print(f"{target} does not hold {one.word}: {one.effect_text()}")
    print(f"{target}: error at most {made.costs[0].largest:.2g} m/s²")

# PX4's own calibration of the same board, by six positions in the hand.
board = inercal.import_calibration(examples / "export" / "board.params", "px4", like=calibration)
compared = compare(calibration, board)
for name, difference, error in zip(
    compared.names, compared.difference, compared.normalised_errors, strict=True
):
    print(f"{name} of PX4 minus that of inercal: {difference:+.4f} (SI), E_n {error:+.1f}")
