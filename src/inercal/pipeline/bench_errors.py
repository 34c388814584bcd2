"""What a run states of its bench's errors."""

from collections.abc import Mapping, Sequence

from inercal.benches import Bench, Centrifuge, DividingHead, Hand, Turntable
from inercal.parameters import Parameter
from inercal.plan import Hold, Index, Spin, Step, Turn
from inercal.sensors import Sensor


def stated(bench: Bench, steps: Sequence[Step], sensor: Sensor) -> Mapping[str, Parameter]:
    """Return the bench's parameters that act on these steps, by full name, as they were stated."""
    if isinstance(bench, Hand):
        rates = any(axis.measures == "w" for axis in sensor.axes)
        done = [step for step in steps if isinstance(step, Hold | Turn)]
        return bench.nuisances(done, rates=rates)
    if isinstance(bench, Centrifuge):
        spins = [step for step in steps if isinstance(step, Spin)]
        return bench.nuisances(spins, vectors=bench.indexing is not None)
    if isinstance(bench, DividingHead):
        indexed = [step for step in steps if isinstance(step, Index)]
        return bench.nuisances(indexed, sensor.channels)
    if isinstance(bench, Turntable):
        return bench.nuisances()
    return bench.nuisances([step for step in steps if isinstance(step, Spin)])
