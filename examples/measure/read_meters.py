"""Ten readings of a voltmeter and one of a counter, here simulated by pyvisa-sim."""

from pathlib import Path
from statistics import fmean, stdev

from inercal.host.equipment import open_instrument

SIMULATED = f"backend={Path(__file__).with_name('meters.yaml')}@sim"  # omit with your instruments
VOLTMETER = f"visa:GPIB0::22::INSTR?setup=VOLT:DC:NPLC 100&{SIMULATED}"
COUNTER = f"visa:TCPIP0::10.0.0.5::INSTR?query=MEAS:FREQ?&unit=Hz&{SIMULATED}"

with open_instrument(VOLTMETER, timeout=10.0) as voltmeter:
    readings = [voltmeter.read() for _ in range(10)]
    values = [one.value for one in readings]
    print(
        f"{voltmeter.identity()}: {fmean(values):.9g} {readings[0].unit}, s = {stdev(values):.2g}"
    )

with open_instrument(COUNTER, timeout=10.0) as counter:
    value, unit = counter.read()
    print(f"{counter.identity()}: {value:.10g} {unit}")
