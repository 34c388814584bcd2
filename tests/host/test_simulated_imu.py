"""The simulated IMU: what it feels and reads, its packets and its port, and faults on demand."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from time import monotonic

import numpy as np
import pytest
from tests.refusals import refused

from inercal.basics.units import Measured
from inercal.benches import Turntable
from inercal.benches.turntable.attitude import motion
from inercal.host.link import LinkLost, SerialLink, TcpLink, open_link
from inercal.host.packets import PRESETS, Decoder, encode, read_layout
from inercal.host.packets.encode import PacketPacker
from inercal.host.sim import imu_model as kernel
from inercal.host.sim.imu_model import SensorResponse, SimulatedImu, draw_bias_drift
from inercal.host.sim.mimu import PacketSender, SimulatorPort, TcpPort, TerminalPort, packet_rate
from inercal.host.sim.motion_link import MotionBlock
from inercal.host.sim.simulated_errors import draw_errors, noise_generator
from inercal.physics.motion import Motion
from inercal.physics.sensors import Noise, imu
from inercal.physics.sensors.coefficient_tables import TABLES
from inercal.runfile import Run, read

PERIOD = 1 / 2000
MIMU = Path(__file__).parents[2] / "examples" / "turntable" / "mimu.toml"
BENCH = Turntable(
    gravity=Measured(9.8, 1e-3),
    latitude=0.7,
    azimuth=Measured(0.3, 0.1),
    lean=0.01,
    square=0.02,
    lever=(Measured(0.1, 0.01), Measured(-0.2, 0.01), Measured(0.05, 0.01)),
)


def _counted(data: bytes) -> list[int]:
    counter = Decoder(read_layout("fixed")).feed(data).counter
    assert counter is not None
    return counter.tolist()


@pytest.fixture(scope="module")
def run() -> Run:
    return read(MIMU)


def _part(until: float, angle: Callable[[np.ndarray], np.ndarray], first: int = 0) -> MotionBlock:
    """Return the cycles from `first` to `until` of axes that turn as `angle` says, (n, 3)."""
    cycles = np.arange(first, int(until / PERIOD + 1e-6) + 1)
    now, before = angle(cycles * PERIOD), angle((cycles - 1) * PERIOD)
    rate = (now - before) / PERIOD
    if first == 0:
        rate[0] = 0.0
    return MotionBlock(until, PERIOD, first, np.stack([now, rate, 0 * now], axis=-1))


def _turning(time: np.ndarray) -> np.ndarray:
    return np.stack([0.4 * time**2, -0.3 + 0.5 * time, np.sin(2 * time)], axis=-1)


@pytest.mark.parametrize("axes", ["z", "xy", "zxy", "yzx"])
def test_what_is_felt_is_that_of_the_bench(run: Run, axes: str):
    rng = np.random.default_rng(1)
    bench = replace(BENCH, axes=axes)
    drawn = draw_errors(replace(run, bench=bench), seed=2)
    moved = rng.normal(size=(20, len(axes), 3))
    q = {name: np.asarray(value) for name, value in drawn.values.items()}
    angles, rates, accelerations = (moved[..., j] for j in range(3))
    exact = motion(bench, angles, rates, accelerations, q)
    felt = drawn.sensed_motion()(moved, "")
    np.testing.assert_allclose(felt[:, :3], exact.f, rtol=0, atol=1e-12 * 9.8)
    np.testing.assert_allclose(felt[:, 3:6], exact.w, rtol=0, atol=1e-12)
    np.testing.assert_allclose(felt[:, 6:], exact.dw, rtol=0, atol=1e-11)


def test_readings_are_those_of_the_sensor_whatever_its_terms():
    rng = np.random.default_rng(3)
    names = {"f": [c.name for c in TABLES["f"]], "w": [c.name for c in TABLES["w"]]}
    sensor = imu()
    sensor = sensor.with_coefficients(
        *(f"{axis.name}.{name}" for axis in sensor.axes for name in names[axis.measures])
    )
    c = rng.normal(size=len(sensor.coefficients)) * 1e-2 * sensor.unit_scale
    felt = rng.normal(size=(30, 9)) * np.repeat([9.8, 1.0, 1.0], 3)
    exact = sensor.forward(Motion(felt[:, :3], felt[:, 3:6], felt[:, 6:], 7.0), c)
    made = SensorResponse(sensor, c)(felt, temperature_offset=7.0)
    np.testing.assert_allclose(made, exact, rtol=1e-12, atol=1e-12 * 9.8)


def test_a_sensor_whose_axes_are_turned_themselves_is_refused():
    with refused(key="form", names=("tilted",)):
        SensorResponse(replace(imu(), form="tilted"), np.empty(0))


def test_between_cycles_the_angle_is_smooth_and_the_rate_its_derivative():
    ring = np.zeros((kernel.RING_SIZE, 3, 2))
    kernel.store_motion(ring, 0, _part(1.0, _turning).motion)
    time = 0.3 + np.arange(4000) * PERIOD / 20
    out = np.empty((time.size, 3, 3))
    kernel.interpolate_motion(ring, PERIOD, time, out)
    np.testing.assert_allclose(out[..., 0], _turning(time), rtol=0, atol=1e-8)
    exact = np.stack([0.8 * time, 0 * time + 0.5, 2 * np.cos(2 * time)], axis=-1)
    np.testing.assert_allclose(out[..., 1], exact, rtol=0, atol=1e-6)
    # The rate's integral is the angle: no gyro drifts against the table.
    integral = np.cumsum((out[1:, :, 1] + out[:-1, :, 1]) / 2 * np.diff(time)[:, None], axis=0)
    np.testing.assert_allclose(integral, out[1:, :, 0] - out[0, :, 0], rtol=0, atol=1e-10)


def _still(run: Run, **bench: object) -> Run:
    """Return the run on a bench without deviations but those given, with a sensor without noise."""
    exact = Turntable(gravity=Measured(9.8, 0.0), latitude=0.7)
    sensor = replace(run.sensor, axes=tuple(replace(a, noise=Noise()) for a in run.sensor.axes))
    return replace(run, bench=replace(exact, **bench), sensor=sensor, truth={})


def _imu(run: Run, seed: int = 0, rate_hz: float = 200.0) -> SimulatedImu:
    return SimulatedImu(run, draw_errors(run, seed), rate_hz, 5.0)


def test_readings_are_the_same_in_whatever_parts_the_motion_comes(run: Run):
    made = []
    for size in (0.02, 0.5, 0.0137):
        device = _imu(run, seed=4)
        ends = np.append(np.arange(size, 6.0, size), 6.0)
        first, rows = 0, []
        for end in ends.tolist():
            part = _part(end, _turning, first)
            first += len(part.motion)
            rows.append(device.read_block(part))
        made.append(np.concatenate(rows))
    assert made[0].shape == (1200, 6)
    for other in made[1:]:
        np.testing.assert_array_equal(made[0], other)


def test_a_reading_is_of_as_long_before_it_is_sent_as_it_is_late(run: Run):
    run = _still(run)
    made = _imu(run).read_block(_part(1.0, _turning))
    late = draw_errors(run, 0).latencies(PERIOD)[0]
    times = np.arange(1, 201) / 200 - late
    turned = np.stack([0.8 * times, 0 * times + 0.5, 2 * np.cos(2 * times)], axis=-1)
    q = {name: np.asarray(value) for name, value in draw_errors(run, 0).values.items()}
    assert isinstance(run.bench, Turntable)
    exact = motion(run.bench, _turning(times), turned, 0 * turned, q)
    np.testing.assert_allclose(made[10:, 3:], exact.w[10:], rtol=0, atol=1e-6)
    np.testing.assert_allclose(made[10:, :3], exact.f[10:], rtol=0, atol=1e-6)


@pytest.mark.parametrize("latency", [0.005, -0.005, 0.0])
def test_the_readback_comes_later_than_the_readings_by_the_latency(run: Run, latency: float):
    drawn = draw_errors(_still(run, latency=Measured(latency, 0.0)), 0)
    imu_late, table_late = drawn.latencies(PERIOD)
    assert table_late - imu_late == pytest.approx(latency, abs=1e-15)
    assert min(imu_late, table_late) >= 0
    assert {axis.delay for axis in drawn.axes(PERIOD)} == {table_late}


def test_an_imus_clock_that_is_slow_makes_fewer_readings(run: Run):
    run = _still(run, clock=1e-2)
    chi = draw_errors(run, 1).values["clock"]
    assert chi != 0
    made = _imu(run, seed=1).read_block(_part(10.0, _turning))
    assert len(made) == int(10.0 * (1 - chi) * 200)


def test_the_noise_is_that_of_the_sensor_and_of_the_seed(run: Run):
    truth = replace(run, truth={})
    still = lambda time: np.zeros((time.size, 3))  # noqa: E731
    one, same, other = (_imu(truth, seed).read_block(_part(4.0, still)) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one, same)
    assert not np.array_equal(one, other)
    for k, axis in enumerate(run.sensor.axes):
        assert np.std(one[:, k]) == pytest.approx(axis.noise.white * 200**0.5, rel=0.15)


def test_noise_goes_on_where_what_was_drawn_ends(run: Run):
    device = SimulatedImu(run, draw_errors(run, 0), 200.0, 1.0)
    still = _part(3.5, lambda time: np.zeros((time.size, 3)))
    made = device.read_block(still)
    assert made.shape == (700, 6)
    assert len(np.unique(made[:, 0])) == 700


def test_readings_end_at_the_full_scale(run: Run):
    fast = _part(1.0, lambda time: np.stack([10 * time, 0 * time, 0 * time], axis=-1))
    made = _imu(run).read_block(fast)
    assert np.max(np.abs(made[:, 5])) == pytest.approx(np.radians(150))


def test_a_sensor_that_is_no_imu_is_refused(run: Run):
    gyros = replace(run, sensor=run.sensor.select_axes("w"), truth={})
    with refused(key="[sensor]", file=run.path, names=("gx", "gy", "gz")):
        _imu(gyros)


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("first", [0, 65533, 3_000_000])
def test_packets_are_the_bytes_that_encode_makes(preset: str, first: int):
    layout = read_layout(preset)
    rate = layout.rate_hz or 200.0
    scale = np.repeat([30.0, 5.0], 3)  # some beyond what the packets hold
    readings = np.random.default_rng(5).normal(size=(9, 6)) * scale * 10
    numbers = np.arange(first, first + 9)
    seconds = numbers % round(rate) == 0
    both = preset == "xsens"
    whole = encode(
        layout,
        readings,
        numbers * int(layout.step),
        (numbers + 1) / rate,
        np.where(seconds | (not both), 293.15, np.nan),
    )
    assert b"".join(PacketPacker(layout, rate)(first, readings)) == whole


def test_a_time_that_wraps_starts_again_as_encodes_does():
    layout = read_layout("novatel")
    first = 604_800 * 125 - 4
    readings = np.zeros((8, 6))
    time = (np.arange(first, first + 8) + 1) / 125
    assert b"".join(PacketPacker(layout, 125.0)(first, readings)) == encode(
        layout, readings, time=time
    )
    layout = read_layout("xsens")
    first = round(2**32 * 1e-4 * 200) - 4
    numbers = np.arange(first, first + 8)
    warm = np.where(numbers % 200 == 0, 293.15, np.nan)
    whole = encode(layout, readings, numbers, (numbers + 1) / 200, warm)
    assert b"".join(PacketPacker(layout, 200.0)(first, readings)) == whole


class MessageHistory:
    """A port that keeps what is sent."""

    address = "kept"

    def __init__(self):
        self.data = b""

    def write(self, data: bytes) -> int:
        self.data += data
        return len(data)

    def close(self) -> None: ...


def _sent(*words: str, n: int = 4000, seed: int = 6) -> tuple[PacketSender, bytes]:
    port = MessageHistory()
    sender = PacketSender(PacketPacker(read_layout("fixed"), 200.0), lambda: port, seed)
    for told in words:
        sender.set_fault(told)
    for first in range(0, n, 4):
        sender.send(first, np.ones((4, 6)))
    assert sender.sent == len(port.data)
    return sender, port.data


def test_lost_packets_are_a_share_and_the_counter_says_so():
    _, data = _sent("fault loss 0.1")
    counted = _counted(data)
    assert len(counted) == pytest.approx(3600, abs=4 * (4000 * 0.09) ** 0.5)
    assert counted[-1] >= 3980
    assert _sent("fault loss 0.1")[1] == data
    assert _sent("fault loss 0.1", seed=7)[1] != data


def test_errors_change_a_share_of_bytes():
    clean, data = (np.frombuffer(_sent(*w)[1], np.uint8) for w in ((), ("fault errors 0.01",)))
    changed = np.count_nonzero(clean != data)
    assert changed == pytest.approx(clean.size * 0.01, abs=4 * (clean.size * 0.01) ** 0.5)


def test_a_silent_imu_counts_on():
    port = MessageHistory()
    sender = PacketSender(PacketPacker(read_layout("fixed"), 200.0), lambda: port, 0)
    sender.set_fault("fault silent on")
    sender.send(0, np.ones((4, 6)))
    assert (sender.sent, port.data) == (0, b"")
    sender.set_fault("fault silent off")
    sender.send(4, np.ones((4, 6)))
    assert _counted(port.data) == [4, 5, 6, 7]


@pytest.mark.parametrize("words", ["fault", "fault loss 2", "fault errors x", "silent on", "burn"])
def test_words_that_are_no_fault_are_refused_with_those_that_are(words: str):
    with refused(key="fault", names=(words,)):
        _sent(words)


def _plugged(kind: str, folder: Path) -> Callable[[], SimulatorPort]:
    made = [0]

    def plug() -> SimulatorPort:
        if kind == "terminal":
            return TerminalPort(folder / "imu")
        port = TcpPort(made[0])
        made[0] = port.port
        return port

    return plug


@pytest.mark.parametrize("kind", ["terminal", "tcp"])
def test_a_host_gets_every_byte_also_after_it_was_plugged_anew(kind: str, tmp_path: Path):
    sender = PacketSender(PacketPacker(read_layout("fixed"), 200.0), _plugged(kind, tmp_path), 0)
    for first in (0, 100):
        with open_link(sender.address) as link:
            before = sender.sent
            sender.send(first, np.ones((4, 6)))
            came = b""
            while len(came) < sender.sent - before and (piece := link.read(4096, 5.0)):
                came += piece
            assert _counted(came) == list(range(first, first + 4))
            sender.set_fault("fault unplug")
            with pytest.raises(LinkLost):
                link.read(4096, 5.0)
        sender.send(50, np.ones((4, 6)))
        with pytest.raises(LinkLost):
            open_link(sender.address)
        sender.set_fault("fault replug")
    sender.close()
    assert sender.sent == 2 * 4 * 36


@pytest.mark.slow
def test_a_port_that_nobody_reads_overruns_and_holds_nobody_up(tmp_path: Path):
    port = TerminalPort(tmp_path / "imu")
    lot = bytes(1 << 20)
    with SerialLink(str(tmp_path / "imu")) as link:
        sent = port.write(lot)
        assert sent < len(lot)
        before = monotonic()
        for _ in range(100):
            sent += port.write(lot)
        assert monotonic() - before < 25.0  # in which it was waited for a reader but once
        came = 0
        while piece := link.read(1 << 16, 0.2):
            came += len(piece)
        assert came == sent
        assert port.write(b"again") == 5
        came = b""
        while len(came) < 5:
            came += link.read(10, 5.0)
        assert came == b"again"
    port.close()


def test_a_host_of_tcp_that_connects_before_bytes_are_made_gets_them():
    port = TcpPort()
    assert port.write(b"nobody") == 0
    with TcpLink("127.0.0.1", port.port) as link:
        assert port.write(b"somebody") == 8
        assert link.read(100, 5.0) == b"somebody"
    port.close()


def test_the_rate_is_that_of_the_packets_or_refused(run: Run):
    assert packet_rate(run, read_layout("fixed"), None) == run.rate_hz
    assert packet_rate(run, read_layout("fixed"), 400.0) == 400.0
    assert packet_rate(run, read_layout("vn100"), None) == 200.0
    with refused(key="rate", names=("vn100",)):
        packet_rate(run, read_layout("vn100"), 100.0)
    with refused(key="[data] rate", file=run.path):
        packet_rate(replace(run, rate_hz=None), read_layout("fixed"), None)


@pytest.mark.slow
def test_the_bench_is_drawn_alike_from_a_seed(run: Run):
    assert draw_errors(run, 5).values == draw_errors(run, 5).values
    assert isinstance(run.bench, Turntable)
    many = np.array([draw_errors(run, seed).values["lean_x"] for seed in range(400)])
    assert np.std(many) == pytest.approx(run.bench.lean, rel=0.12)


def test_white_noise_drift_and_readback_are_drawn_apart():
    """Drift in phase with the white noise made accelerometers' errors 1.3 times those stated."""
    keys = [("white",), ("drift", 0), ("drift", 1), *(("readback", k, 0) for k in range(3))]
    drawn = [noise_generator(5, what, *key).standard_normal(4096) for what, *key in keys]
    drawn.append(np.random.default_rng(5).standard_normal(4096))  # of the bench
    apart = np.corrcoef(drawn) - np.eye(len(drawn))
    assert np.abs(apart).max() < 5 / np.sqrt(4096)


def test_drift_is_not_in_phase_with_the_white_noise():
    run = read(MIMU)
    drawn, rate, count = draw_errors(run, 5), 200.0, 1 << 15
    made = SimulatedImu(run, drawn, rate, count / rate)
    noise = made._next_noise(np.arange(count))
    drift = draw_bias_drift(run.sensor, 5, len(made._noise), rate)[:count]
    white = noise - drift
    # What changes from sample to sample: drift of long times has no degrees of freedom.
    for one, other in zip(np.diff(white, axis=0).T, np.diff(drift, axis=0).T, strict=True):
        assert abs(np.corrcoef(one, other)[0, 1]) < 6 / np.sqrt(count)
