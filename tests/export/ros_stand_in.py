"""A stand-in for the parts of ROS 2 that the exported package uses: rclpy, messages and launch.

It behaves as their documentation and sources say where a node could go wrong: fields of type
float64 only accept floats, covariances only nine of them, parameters keep the type of their
default, and a logger refuses a call whose filters change between calls (rcutils_logger.py of
ros2/rclpy).
"""

import inspect
from collections.abc import Callable
from dataclasses import dataclass, field
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np

NINE = 9


class Vector3:
    """geometry_msgs/Vector3."""

    def __init__(self, x: float = 0.0, y: float = 0.0, z: float = 0.0):
        self.x, self.y, self.z = x, y, z

    def __setattr__(self, name: str, value: Any) -> None:
        assert name in ("x", "y", "z")
        assert isinstance(value, float)
        super().__setattr__(name, value)


@dataclass
class Header:
    """std_msgs/Header."""

    stamp: Any = None
    frame_id: str = ""


class _WithCovariance:
    def __setattr__(self, name: str, value: Any) -> None:
        if name.endswith("_covariance"):
            assert len(value) == NINE
            assert all(isinstance(x, float) for x in value)
            value = np.array(value)
        super().__setattr__(name, value)


def _zeros() -> Any:
    return np.zeros(NINE)


@dataclass
class Imu(_WithCovariance):
    """sensor_msgs/Imu."""

    header: Header = field(default_factory=Header)
    orientation: Any = (0.0, 0.0, 0.0, 1.0)
    orientation_covariance: Any = field(default_factory=_zeros)
    angular_velocity: Vector3 = field(default_factory=Vector3)
    angular_velocity_covariance: Any = field(default_factory=_zeros)
    linear_acceleration: Vector3 = field(default_factory=Vector3)
    linear_acceleration_covariance: Any = field(default_factory=_zeros)


@dataclass
class MagneticField(_WithCovariance):
    """sensor_msgs/MagneticField."""

    header: Header = field(default_factory=Header)
    magnetic_field: Vector3 = field(default_factory=Vector3)
    magnetic_field_covariance: Any = field(default_factory=_zeros)


@dataclass
class Temperature:
    """sensor_msgs/Temperature."""

    temperature: float = 0.0
    variance: float = 0.0


@dataclass
class KeyValue:
    """diagnostic_msgs/KeyValue."""

    key: str = ""
    value: str = ""


@dataclass
class DiagnosticStatus:
    """diagnostic_msgs/DiagnosticStatus; a byte is bytes of length 1."""

    OK, WARN = b"\x00", b"\x01"
    level: bytes = b"\x00"
    name: str = ""
    message: str = ""
    hardware_id: str = ""
    values: list[KeyValue] = field(default_factory=list[KeyValue])


@dataclass
class DiagnosticArray:
    """diagnostic_msgs/DiagnosticArray."""

    header: Header = field(default_factory=Header)
    status: list[DiagnosticStatus] = field(default_factory=list[DiagnosticStatus])


@dataclass(frozen=True)
class Time:
    """A time or a duration of rclpy."""

    nanoseconds: int

    def __sub__(self, other: "Time") -> "Time":
        return Time(self.nanoseconds - other.nanoseconds)

    def to_msg(self) -> int:
        return self.nanoseconds


@dataclass
class Logger:
    """A logger whose messages are kept as (level, text)."""

    world: "World"
    lines: list[tuple[str, str]] = field(default_factory=list[tuple[str, str]])
    contexts: dict[Any, Any] = field(default_factory=dict[Any, Any])

    def _log(self, level: str, text: str, filters: dict[str, Any]) -> None:
        frame = inspect.stack()[2]
        place = (frame.filename, frame.lineno)
        assert set(filters) <= {"throttle_duration_sec", "skip_first", "once"}
        known, last = self.contexts.get(place, ((level, filters), None))
        assert known == (level, filters), "logging filter parameters cannot be changed"
        now = self.world.seconds
        quiet = filters.get("throttle_duration_sec", 0.0)
        if last is None or not (filters.get("once") or now < last + quiet):
            self.lines.append((level, text))
            last = now
        self.contexts[place] = (known, last)

    def warning(self, text: str, **filters: Any) -> None:
        self._log("warning", text, filters)

    def error(self, text: str, **filters: Any) -> None:
        self._log("error", text, filters)


@dataclass
class World:
    """What a node did and what it is given: parameters, time, subscriptions and publications."""

    parameters: dict[str, Any] = field(default_factory=dict[str, Any])
    seconds: float = 100.0
    descriptors: dict[str, Any] = field(default_factory=dict[str, Any])
    subscriptions: dict[str, tuple[type, Callable[[Any], None], Any]] = field(
        default_factory=dict[str, Any]
    )
    published: dict[str, list[Any]] = field(default_factory=dict[str, list[Any]])
    qualities: dict[str, Any] = field(default_factory=dict[str, Any])
    timers: list[tuple[float, Callable[[], None]]] = field(default_factory=list[Any])
    calls: list[str] = field(default_factory=list[str])
    node: Any = None

    def send(self, topic: str, message: Any) -> None:
        """Give a message to the subscription to a topic."""
        kind, callback, _ = self.subscriptions[topic]
        assert type(message) is kind
        callback(message)


SENSOR_DATA = SimpleNamespace(depth=5, reliability="best effort")
OVERRIDES = object()


def modules(world: World) -> dict[str, ModuleType]:
    """Return modules that act on a world, by name."""

    class Node:
        def __init__(self, name: str):
            self._name, self._logger = name, Logger(world)
            world.node = self

        def declare_parameter(self, name: str, default: Any, descriptor: Any) -> Any:
            value = world.parameters.get(name, default)
            assert type(value) is type(default)
            world.descriptors[name] = descriptor
            return SimpleNamespace(value=value)

        def create_subscription(
            self,
            msg_type: type,
            topic: str,
            callback: Any,
            qos_profile: Any,
            *,
            qos_overriding_options: Any,
        ) -> None:
            assert qos_overriding_options is OVERRIDES
            world.subscriptions[topic] = (msg_type, callback, qos_profile)

        def create_publisher(
            self,
            msg_type: type,
            topic: str,
            qos_profile: Any,
            *,
            qos_overriding_options: Any = None,
        ) -> Any:
            world.qualities[topic] = qos_profile
            kept = world.published.setdefault(topic, [])

            def publish(message: Any) -> None:
                assert type(message) is msg_type
                kept.append(message)

            return SimpleNamespace(publish=publish)

        def create_timer(self, period: float, callback: Any) -> None:
            world.timers.append((period, callback))

        def get_logger(self) -> Logger:
            return self._logger

        def get_name(self) -> str:
            return self._name

        def get_clock(self) -> Any:
            return SimpleNamespace(now=lambda: Time(round(world.seconds * 1e9)))

        def destroy_node(self) -> None:
            world.calls.append("destroy_node")

    def spin(node: Any) -> None:
        world.calls.append("spin")
        raise KeyboardInterrupt

    options = SimpleNamespace(with_default_policies=lambda: OVERRIDES)
    contents: dict[str, dict[str, Any]] = {
        "rclpy": {
            "init": lambda args=None: world.calls.append("init"),
            "spin": spin,
            "try_shutdown": lambda: world.calls.append("try_shutdown"),
        },
        "rclpy.executors": {"ExternalShutdownException": type("E", (Exception,), {})},
        "rclpy.node": {"Node": Node},
        "rclpy.qos": {
            "QoSProfile": lambda depth: SimpleNamespace(depth=depth, reliability="reliable"),
            "qos_profile_sensor_data": SENSOR_DATA,
        },
        "rclpy.qos_overriding_options": {"QoSOverridingOptions": options},
        "rcl_interfaces": {},
        "rcl_interfaces.msg": {
            "ParameterDescriptor": lambda description, read_only: (description, read_only)
        },
        "sensor_msgs": {},
        "sensor_msgs.msg": {
            "Imu": Imu,
            "MagneticField": MagneticField,
            "Temperature": Temperature,
        },
        "diagnostic_msgs": {},
        "diagnostic_msgs.msg": {
            "DiagnosticArray": DiagnosticArray,
            "DiagnosticStatus": DiagnosticStatus,
            "KeyValue": KeyValue,
        },
        "launch": {"LaunchDescription": lambda entities: entities},
        "launch.actions": {
            "DeclareLaunchArgument": lambda name, default_value: (name, default_value)
        },
        "launch.substitutions": {
            "LaunchConfiguration": lambda name: f"<{name}>",
            "PathJoinSubstitution": "/".join,
        },
        "launch_ros": {},
        "launch_ros.actions": {"Node": lambda **stated: stated},
        "launch_ros.substitutions": {"FindPackageShare": lambda package: f"share of {package}"},
    }
    made: dict[str, ModuleType] = {}
    for name, content in contents.items():
        made[name] = ModuleType(name)
        vars(made[name]).update(content)
        parent, _, last = name.rpartition(".")
        if parent:
            setattr(made[parent], last, made[name])
    return made
