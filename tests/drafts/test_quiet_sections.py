"""Quiet sections of a recording, which `init` finds without a run file."""

import numpy as np

from inercal.pipeline.drafts.quiet_sections import find_quiet_sections

RATE = 100


def test_a_long_rest_on_a_table_does_not_hide_rests_by_hand():
    rng = np.random.default_rng(4)
    seconds = [(40, 0.001), *[(1, 1.0), (4, 0.02)] * 12]  # table, then turns and rests by hand
    scatter = np.repeat([size for _, size in seconds], [RATE * length for length, _ in seconds])
    data = scatter[:, None] * rng.normal(size=(scatter.size, 6))
    spans = find_quiet_sections(data, RATE // 2)
    assert len(spans) == 13
    assert np.array_equal(np.unique(scatter[spans.mean(axis=1).astype(int)]), [0.001, 0.02])
