"""Machines, a simple analytic kinematics and short ways to run lines, for the tests of the dialect."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from mckinematics.errors import JointLimit, Unreachable
from mckinematics.pose import JointPath, Pose, ToolPath, Triple

from mcserver.errors import Diagnostic, ProgramRejected
from mcserver.gcode.program_check import check_program
from mcserver.gcode.semantics.interpreter import Interpreter
from mcserver.machine.machine_file import Machine, load_machine, parse_machine
from mcserver.motion.canonical import Canonical, FeedGroup, MotionLine
from mcserver.motion.geometry.curves import ArcCurve, LineCurve
from mcserver.units import DEGREE, MM

CARTESIAN = load_machine("cartesian")


def machine_of(axes: str, tools: str = "", motion: str = "") -> Machine:
    """A machine from a short form: axes such as ``0:linear 3:rotary:-90:90`` with optional limits."""
    text = ['[machine]\nname = "test"\n', motion]
    for axis in axes.split():
        index, kind, *limits = axis.split(":")
        text.append(
            f'[[axis]]\nindex = {index}\ntype = "{kind}"\nmax_velocity = 1000.0\nmax_acceleration = 10000.0'
        )
        if limits:
            text.append(f"min_position = {float(limits[0])}\nmax_position = {float(limits[1])}")
    if tools:
        text.append('[kinematics]\nurdf = "none.urdf"')
        for tool in tools.split():
            number, chain, *rest = tool.split(":")
            orientation = "true" if rest else "false"
            euler = rest[0] if rest else "ZYX"
            text.append(
                f'[[tool]]\nnumber = {number}\nframe = "f"\naxes = [{chain}]\n'
                f'orientation = {orientation}\neuler = "{euler}"'
            )
    return parse_machine("\n".join(text))


class Gantries:
    """A tool's point is where its first three joints stand; with six joints A B C are the other three.

    Joint positions are metres and radians. Points farther than ``reach`` from the origin are out of reach.
    """

    def __init__(self, machine: Machine, *, reach: float = math.inf) -> None:
        self._tools = {tool.number: tool for tool in machine.tools}
        self._reach = reach
        self.solved: list[tuple[int, ToolPath, dict[int, float]]] = []

    @property
    def tools(self) -> tuple[int, ...]:
        return tuple(sorted(self._tools))

    @property
    def dynamics(self) -> None:
        return None

    def axes(self, tool: int) -> tuple[int, ...]:
        return self._tools[tool].axes

    def has_orientation(self, tool: int) -> bool:
        return self._tools[tool].orientation

    def pose(self, tool: int, joints: Mapping[int, float]) -> Pose:
        values = [joints[axis] for axis in self.axes(tool)]
        angles: Triple = (values[3], values[4], values[5]) if self.has_orientation(tool) else (0.0, 0.0, 0.0)
        return Pose((values[0], values[1], values[2]), angles)

    def rotation_angle(self, tool: int, start: Triple, end: Triple) -> float:  # noqa: ARG002
        return max(abs(b - a) for a, b in zip(start, end, strict=True))

    def jacobians(self, tool: int, joints: np.ndarray) -> np.ndarray:
        return np.tile(np.eye(len(self.axes(tool))), (len(joints), 1, 1))

    def solve_pose(self, tool: int, pose: Pose, joints: Mapping[int, float]) -> tuple[float, ...]:  # noqa: ARG002
        self._refuse(tool, np.array([pose.position]))
        return pose.position + (pose.angles if self.has_orientation(tool) else ())

    def solve_path(self, tool: int, path: ToolPath, joints: Mapping[int, float]) -> JointPath:
        self.solved.append((tool, path, dict(joints)))
        knots = np.linspace(0.0, 1.0, 65)
        points = path.position(knots)
        self._refuse(tool, points)
        slopes = path.derivative(knots)
        if path.start_angles is not None:
            assert path.end_angles is not None
            start, end = np.array(path.start_angles), np.array(path.end_angles)
            points = np.hstack([points, start + knots[:, None] * (end - start)])
            slopes = np.hstack([slopes, np.broadcast_to(end - start, (len(knots), 3))])
        h = knots[1] - knots[0]
        rise = (points[1:] - points[:-1]) / h
        c2 = (3 * rise - 2 * slopes[:-1] - slopes[1:]) / h
        c3 = (slopes[:-1] + slopes[1:] - 2 * rise) / h**2
        return JointPath(self.axes(tool), knots, np.stack([c3, c2, slopes[:-1], points[:-1]]))

    def _refuse(self, tool: int, points: np.ndarray) -> None:
        distance = float(np.linalg.norm(points, axis=1).max())
        if distance > self._reach:
            raise Unreachable(
                "the point is out of reach", "come nearer", tool=tool, residual=distance - self._reach, s=1.0
            )
        if points[:, 2].min() < -10.0:
            raise JointLimit("a joint would pass its limit", "go up", tool=tool, axis=self.axes(tool)[2])


class Program:
    """An interpreter with short ways to feed and read it."""

    def __init__(
        self, machine: Machine = CARTESIAN, kinematics: Gantries | None = None, **options: object
    ) -> None:
        self.interpreter = Interpreter(machine, kinematics=kinematics, **options)  # type: ignore[arg-type]
        self.line = 0

    def run(self, *lines: str) -> list[Canonical]:
        """Values of all the lines."""
        values: list[Canonical] = []
        for text in lines:
            self.line += 1
            values += self.interpreter.interpret_text(text, self.line)
        return values

    def motion(self, text: str) -> MotionLine:
        """The one motion line that a line gives."""
        (value,) = self.run(text)
        assert isinstance(value, MotionLine)
        return value

    def feed(self, text: str) -> FeedGroup:
        """The one feed group that a line gives."""
        (group,) = self.motion(text).groups
        assert isinstance(group, FeedGroup)
        return group

    def arc(self, text: str) -> ArcCurve:
        """The one arc that a line gives."""
        (curve,) = self.feed(text).curves
        assert isinstance(curve, ArcCurve)
        return curve

    def straight(self, text: str) -> LineCurve:
        """The one straight line that a line gives."""
        (curve,) = self.feed(text).curves
        assert isinstance(curve, LineCurve)
        return curve

    def faults(self, text: str) -> tuple[Diagnostic, ...]:
        """Faults of a line, none if it is accepted."""
        try:
            self.interpreter.interpret_text(text, self.line + 1)
        except ProgramRejected as rejected:
            return rejected.diagnostics
        return ()

    def codes(self, text: str) -> list[str]:
        """Codes of a line's faults."""
        return [fault.code for fault in self.faults(text)]

    def mm(self, axis: int) -> float:
        """CommandedState end of a linear axis [mm], rounded to a nanometre."""
        return round(self.interpreter.positions[axis] / MM, 6)

    def deg(self, axis: int) -> float:
        """CommandedState end of a rotary axis [deg], rounded."""
        return round(self.interpreter.positions[axis] / DEGREE, 6)


def feeding(*lines: str, machine: Machine = CARTESIAN) -> Program:
    """A program with 6000 mm/min in force, after some lines."""
    program = Program(machine)
    program.run("F6000", *lines)
    return program


def check(
    *lines: str, machine: Machine = CARTESIAN, kinematics: Gantries | None = None
) -> list[tuple[int, str]]:
    """(line, code) of every fault of a program."""
    return [(fault.line, fault.code) for fault in check_program("\n".join(lines), machine, kinematics)]
