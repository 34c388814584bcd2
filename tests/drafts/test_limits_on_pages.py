"""The limits that the pages about logs and drafts state are those of the code."""

from math import sin
from pathlib import Path

import pytest

from inercal.basics.units import ZERO_CELSIUS
from inercal.benches.rate_platform import section_finder
from inercal.noise import coefficients, pieces, recording_checks
from inercal.noise.deviations import _OVERLAP, FULL_OVERLAP
from inercal.pipeline.drafts import column_values, draft_entries, log_files
from inercal.recordings.io import audit, isolation, split_bags, time_stamps
from inercal.recordings.segments import dwells, section_means, stationary_states
from inercal.recordings.temperature import HIGHEST, LOWEST

PAGES = Path(__file__).parents[2] / "docs" / "how-to"
GB = 1e9
LIMITS = {
    "first-calibration": [
        f"fewer than {column_values.FEWEST_SAMPLES} rows",
        f"± {draft_entries.ANYWHERE.split(' ± ')[1]}",
    ],
    "logs": [log_files.MARKS_FILE, f"rec/{split_bags.METADATA}", "three quarters"],
    "recordings": [
        f"fewer than {time_stamps.SLOWEST_HZ:g} or more than "
        f"{time_stamps.FASTEST_HZ:,.0f} samples per second".replace(",", " "),
        f"at least {section_means.MIN_SAMPLES} samples",
        f"{isolation._BASE >> 20} MiB of memory plus {isolation._BYTES_PER_VALUE} bytes",
        f"up to {isolation._BYTES_PER_VALUE * isolation.MOST_VALUES / GB:g} GB",
        f"{isolation._SECONDS:g} s of processor time plus {isolation._SECONDS_PER_BYTE * 1e6:g} s",
        f"{audit._SMALLEST:g} K, or six times the usual change if that is larger, plus "
        f"{audit._FASTEST:g} K for each second",
        f"rested for less than {stationary_states._LEAST_REST:g} s",
        "fewer than three whole turns",
    ],
    "rates-and-poses": [f"at least {section_finder._SHORTEST:g} s at a constant rate",
                        f"{section_finder._STEADY:.0e} of the rate".replace("e-0", "e-")],
    "temperature": [
        f"A jump of {audit._SMALLEST:g} K at more than {audit._FASTEST:g} K/s",
        f"outside {LOWEST - ZERO_CELSIUS:.0f} to {HIGHEST - ZERO_CELSIUS:.0f} °C".replace("-", "−"),
    ],
    "noise": [
        f"at most {coefficients._GMWM_LONGEST:,} samples".replace(",", " "),
        f"more than {FULL_OVERLAP} samples",
        f"fewer than {pieces.FEWEST} samples",
        f"{sin(recording_checks.LARGEST_TURN):.2f} g over {recording_checks.WINDOW:g} s",
    ],
}  # fmt: skip


@pytest.mark.parametrize("page", LIMITS)
def test_a_page_states_the_limits_of_the_code(page: str):
    text = " ".join((PAGES / f"{page}.md").read_text(encoding="utf-8").split())
    assert [limit for limit in LIMITS[page] if limit not in text] == []


def test_limits_in_words_are_those_of_the_code():
    assert time_stamps._APART == 0.75  # three quarters
    assert audit._TYPICAL == 6  # six
    assert dwells.LEAST_TURNS == 3  # three
    assert _OVERLAP == 16  # sixteen
