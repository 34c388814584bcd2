"""Allan deviations against allantools, a long stream's memory, and the fit of 10⁷ samples.

Where allantools is not installed, the peer is its algorithm in plain NumPy, one averaging time
after another, and is named so.
"""

import subprocess
import sys
from collections.abc import Callable, Iterator
from importlib.util import find_spec

import numpy as np
from numpy.typing import NDArray

from benchmarks import Row, best
from inercal.noise import deviations
from inercal.noise.selection import select_terms
from inercal.noise.spectrum import make_bins, piece_spectra

Values = NDArray[np.float64]
LONG, SHORT, TAUS = 10_000_000, 40_000, 57
STREAMED = (10_000_000, 100_000_000)
MEMORY = 200.0  # MB beyond the file
FIT = 2.0  # s
_STREAM = """
import resource, sys, time
import numpy as np
from inercal.noise import analyse_noise_stream
def pieces(n):
    rng = np.random.default_rng(1)
    for _ in range(0, n, 100_000):
        yield rng.standard_normal((100_000, 1))
analyse_noise_stream(pieces(300_000), 0.01, ["g"], ["rad/s"])
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
start = time.process_time()
analyse_noise_stream(pieces(int(sys.argv[1])), 0.01, ["g"], ["rad/s"])
spent = time.process_time() - start
print(spent, (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024)
"""


def plain_oadev(y: Values, factors: NDArray[np.int64]) -> Values:
    """Return the overlapping Allan deviation, one averaging time after another, as allantools."""
    x = np.concatenate([[0.0], np.cumsum(y)])
    found = []
    for m in factors:
        d = x[2 * m :] - 2 * x[m:-m] + x[: -2 * m]
        found.append(np.sqrt(0.5 * np.sum(d**2) / d.size) / m)
    return np.array(found)


def peer() -> tuple[str, Callable[[Values, NDArray[np.int64]], Values]]:
    """Return the peer's name and its function."""
    if find_spec("allantools") is None:
        return "allantools' algorithm in NumPy", plain_oadev
    import allantools

    def oadev(y: Values, factors: NDArray[np.int64]) -> Values:
        return np.asarray(allantools.oadev(y, 1.0, "freq", factors.astype(float))[1])

    return "allantools", oadev


def streamed(n: int) -> tuple[float, float]:
    """Return the processor's time, s, and the memory beyond a short stream, MB, of n samples."""
    done = subprocess.run(
        [sys.executable, "-c", _STREAM, str(n)], capture_output=True, text=True, check=True
    )
    spent, memory = map(float, done.stdout.split())
    return spent, memory


def rows() -> Iterator[Row]:
    """Compare the deviations, then the times."""
    name, theirs = peer()
    y = np.random.default_rng(1).standard_normal(LONG)
    for work, some, factors, reach in (
        (f"OADEV of 10⁷ samples, {TAUS} averaging times", y, _factors(LONG, TAUS), 15.0),
        ("OADEV of 4·10⁴ samples, all averaging times", y[:SHORT],
         np.arange(1, SHORT // 2 + 1), 10.0),
    ):  # fmt: skip
        ours = deviations(some, 1.0, factors=[int(m) for m in factors]).value
        few = factors[factors <= 1024]
        np.testing.assert_allclose(ours[: few.size], theirs(some, few), rtol=1e-6)
        own = best(
            lambda some=some, factors=factors: deviations(
                some, 1.0, factors=[int(m) for m in factors]
            ),
            2,
        )
        other = best(lambda some=some, factors=factors: theirs(some, factors), 1)
        yield Row(work, own, other, name, to_reach=reach)
    fit = best(lambda: select_terms(make_bins(piece_spectra(y, 0.01), 0.01)), 2)
    yield Row("terms of 10⁷ samples, chosen and fitted", fit, FIT, "limit")
    (few_s, _), (many_s, memory) = map(streamed, STREAMED)
    memory = max(memory, 0.1)  # none may be beyond
    yield Row("10⁸ samples in pieces: memory beyond a short stream", memory, MEMORY, "limit", "MB")
    times = 1.2 * STREAMED[1] / STREAMED[0] * few_s
    yield Row("10⁸ samples in pieces: time", many_s, times, "12 times 10⁷")


def _factors(n: int, count: int) -> NDArray[np.int64]:
    """Return `count` averaging factors, evenly on a logarithmic scale."""
    more = count
    while True:
        found = np.unique(np.geomspace(1, n // 3, more).astype(np.int64))
        if found.size >= count:
            return found[:count]
        more += 1
