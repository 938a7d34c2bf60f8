"""Families of tasks: one wording and one expectation, with numbers by chance."""

from __future__ import annotations

import math
from collections.abc import Callable
from importlib import resources
from random import Random

from mcbenchmark.tasks import Expectation, Leg, Place, Range, Task

CARTESIAN, ARM, DOG = "cartesian", "arm6", "robot-dog"


def machine_file(name: str) -> str:
    """Return the path of a machine file that comes with the package."""
    return str(resources.files("mcbenchmark").joinpath("machines", f"{name}.toml"))


def _task(
    category: str,
    machine: str,
    prompt: str,
    solution: str,
    expect: Expectation,
    start: Place | None = None,
) -> Task:
    spoil = (("G", "N1 G77 X1 G"),)
    return Task(category, category, machine, prompt, expect, solution, spoil, start=start or {})


def _speed(feed: float) -> Range:
    """Return the bounds of a speed that a prompt names [mm/s]."""
    return (0.97 * feed, 1.006 * feed)


def _place(random: Random, near: float = 15.0, far: float = 60.0) -> float:
    return random.choice([-1, 1]) * round(random.uniform(near, far), 1)


def _feed(random: Random) -> int:
    return random.choice([40, 50, 60, 80, 90, 100, 110, 120])


def _words(place: Place) -> str:
    return " ".join(f"{name}{value:g}" for name, value in place.items())


def line(random: Random) -> Task:
    feed = _feed(random)
    place = {name: _place(random) for name in random.choice(["XY", "XZ", "YZ", "XYZ"])}
    return _task(
        "line",
        CARTESIAN,
        f"Energize the axes and move in one straight line to {_words(place)} at {feed} mm/s.",
        f"G1010\nG94 F{60 * feed}\nG01 {_words(place)}\n",
        Expectation(path=(Leg(place, "line"),), speed=_speed(feed)),
    )


def polygon(random: Random) -> Task:
    feed = _feed(random)
    corners: list[Place] = []
    while len(corners) < random.choice([3, 4, 5]):
        corner = {"X": _place(random), "Y": _place(random)}
        before = corners[-1] if corners else {"X": 0.0, "Y": 0.0}
        if math.dist(corner.values(), before.values()) > 20.0:
            corners.append(corner)
    corners.append({"X": 0.0, "Y": 0.0})
    return _task(
        "polygon",
        CARTESIAN,
        f"Go from X0 Y0 in straight lines at {feed} mm/s to {', '.join(map(_words, corners))}, in this "
        f"order.",
        f"G1010\nG94 F{60 * feed}\nG01 " + "\n".join(map(_words, corners)) + "\n",
        Expectation(path=tuple(Leg(each, "line") for each in corners), speed=(0.9 * feed, 1.006 * feed)),
    )


def arc(random: Random) -> Task:
    feed, radius = _feed(random), random.randint(15, 40)
    way, turn = random.choice([(2, -90), (3, 90), (2, -180), (3, 180)])
    angle = math.radians(turn) + math.pi
    end = {
        "X": round(radius + radius * math.cos(angle), 6) + 0.0,
        "Y": round(radius * math.sin(angle), 6) + 0.0,
    }
    names = {2: "clockwise", 3: "counter-clockwise"}
    return _task(
        "arc",
        CARTESIAN,
        f"From X0 Y0 move {names[way]} along an arc of {abs(turn)} degrees about X{radius} Y0, at "
        f"{feed} mm/s.",
        f"G1010\nG94 F{60 * feed}\nG0{way} {_words(end)} I{radius} J0\n",
        Expectation(path=(Leg(end, "arc", {"X": radius, "Y": 0}, turn),), speed=_speed(feed)),
    )


def circle(random: Random) -> Task:
    feed, radius, turns = _feed(random), random.randint(6, 20), random.randint(1, 3)
    way, sign = random.choice([(2, -1), (3, 1)])
    names, rise = {2: "clockwise", 3: "counter-clockwise"}, random.choice([0, 0, 5, -4])
    height = f", while Z goes evenly from 0 to {rise}" if rise else ""
    end = {"X": 0.0, "Y": 0.0, **({"Z": rise} if rise else {})}
    return _task(
        "circle",
        CARTESIAN,
        f"From X0 Y0 make {turns} full turn{'s' * (turns > 1)} {names[way]} about X0 Y{radius}{height}, "
        f"at {feed} mm/s.",
        f"G1010\nG94 F{60 * feed}\nG0{way} {_words(end)} I0 J{radius} P{turns}\n",
        Expectation(
            path=(Leg(end, "arc", {"X": 0, "Y": radius}, sign * 360 * turns, tolerance=0.1),),
            speed=(0.95 * feed, 1.02 * feed),
        ),
    )


def timed(random: Random) -> Task:
    place = {
        str(axis): float(random.choice([-1, 1]) * random.randint(20, 120))
        for axis in random.sample(range(3, 8), 3)
    }
    seconds = random.choice([0.5, 0.6, 0.8, 1.0])
    words = " ".join(f"[{axis}]{value:g}" for axis, value in place.items())
    named = ", ".join(f"axis {axis} to {value:g}" for axis, value in place.items())
    leg = Leg(place, "line", tolerance=0.1, duration_s=(seconds - 0.01, seconds + 0.01))
    return _task(
        "timed",
        CARTESIAN,
        f"Turn {named} degrees, coordinated, in exactly {seconds:g} s.",
        f"G1010\nG93 F{60 / seconds:g}\nG01 {words}\n",
        Expectation(path=(leg,)),
    )


def dwell(random: Random) -> Task:
    feed, far, back, rest = (
        _feed(random),
        _place(random),
        _place(random),
        random.choice([0.3, 0.4, 0.5, 0.75]),
    )
    name = random.choice("XYZ")
    legs = (Leg({name: far}, "line", rest_s=(rest - 0.01, rest + 0.07)), Leg({name: back}, "line"))
    return _task(
        "dwell",
        CARTESIAN,
        f"Move {name} to {far:g} at {feed} mm/s, rest there for {rest:g} s, and go on to {name}{back:g} "
        f"at that speed.",
        f"G1010\nG94 F{60 * feed}\nG01 {name}{far:g}\nG04 P{rest:g}\nG01 {name}{back:g}\n",
        Expectation(path=legs, speed=(min(0.97, abs(far - back) / 20) * feed, 1.006 * feed)),
    )


def stops(random: Random) -> Task:
    feed, step, stop = _feed(random), random.randint(15, 25), random.randint(0, 1)
    name = random.choice("XYZ")
    places = [name + str(step * each) for each in (1, 2, 3)]
    legs = tuple(
        Leg({name: step * (at + 1)}, "line", stops=(at == stop) if at < 2 else None) for at in range(3)
    )
    lines = [("G09 G01 " if at == stop else "G01 ") + place for at, place in enumerate(places)]
    return _task(
        "stops",
        CARTESIAN,
        f"Move to {', '.join(places)} with three commands at {feed} mm/s. Come to an exact stop at "
        f"{places[stop]} only; "
        f"pass {places[1 - stop]} without a stop.",
        f"G1010\nG94 F{60 * feed}\n" + "\n".join(lines) + "\n",
        Expectation(path=legs, speed=_speed(feed)),
    )


def from_here(random: Random) -> Task:
    feed, start = _feed(random), {"X": float(random.randint(-90, 90)), "Y": float(random.randint(-90, 90))}
    steps = [(random.choice("XY"), _place(random, 15, 30)) for _ in range(3)]
    at, legs = dict(start), []
    for name, distance in steps:
        at = {**at, name: round(at[name] + distance, 3)}
        legs.append(Leg(at, "line"))
    words = ", then ".join(f"{name} by {distance:+g} mm" for name, distance in steps)
    return _task(
        "from-here",
        CARTESIAN,
        f"Wherever X and Y stand when the program starts: move {words}, each in a straight line at "
        f"{feed} mm/s.",
        f"G1010\nG91 G94 F{60 * feed}\nG01 "
        + "\n".join(f"{name}{distance:g}" for name, distance in steps)
        + "\n",
        Expectation(path=tuple(legs), speed=(0.9 * feed, 1.006 * feed)),
        start,
    )


def around(random: Random) -> Task:
    feed, left, width, high = (
        _feed(random),
        random.randint(15, 30),
        random.randint(8, 20),
        random.randint(8, 20),
    )
    right, end = left + width, left + width + random.randint(15, 30)
    over = high + 3
    return _task(
        "around",
        CARTESIAN,
        f"Go from X0 Z0 to X{end} Z0 at {feed} mm/s over a wall that stands from X{left} to X{right} "
        f"and reaches up to "
        f"Z{high}. X stays between 0 and {end}, Z between 0 and {high + 10}.",
        f"G1010\nG94 F{60 * feed}\nG01 Z{over}\nX{end}\nZ0\n",
        Expectation(
            path=(Leg({"X": end, "Z": 0}, detour=True),),
            avoid=({"X": (left, right), "Z": (-200, high)},),
            within={"X": (0, end), "Z": (0, high + 10)},
            speed=_speed(feed),
        ),
    )


def raster(random: Random) -> Task:
    feed, width, step, passes = (
        _feed(random),
        random.randint(25, 50),
        random.randint(15, 20),
        random.randint(3, 5),
    )
    legs, lines, at = [], [], 0.0
    for number in range(passes):
        at = width - at
        legs.append(Leg({"X": at, "Y": number * step}, "line"))
        lines.append(f"X{at:g}")
        if number + 1 < passes:
            legs.append(Leg({"X": at, "Y": (number + 1) * step}, "line"))
            lines.append(f"Y{(number + 1) * step}")
    rows = ", ".join(f"Y{number * step}" for number in range(passes))
    return _task(
        "raster",
        CARTESIAN,
        f"From X0 Y0 scan {passes} passes of {width} mm along X, at {rows}: alternate their direction "
        f"and step straight "
        f"along Y between them, all at {feed} mm/s.",
        f"G1010\nG94 F{60 * feed}\nG01 " + "\n".join(lines) + "\n",
        Expectation(path=tuple(legs), speed=(0.9 * feed, 1.006 * feed)),
    )


def inches(random: Random) -> Task:
    feed = random.choice([100, 120, 150, 200])
    place = {name: random.choice([-1, 1]) * random.choice([0.75, 1.0, 1.25, 1.5, 2.0]) for name in "XY"}
    far = {name: round(25.4 * value, 4) for name, value in place.items()}
    return _task(
        "inches",
        CARTESIAN,
        f"Write the program in inches: a straight line to {_words(place)} (inches) at {feed} inches per "
        f"minute.",
        f"G1010\nG20 G94 F{feed}\nG01 {_words(place)}\n",
        Expectation(path=(Leg(far, "line"),), uses=("G20",), speed=_speed(feed * 25.4 / 60)),
    )


def arm_line(random: Random) -> Task:
    feed, by = (
        random.choice([40, 60, 80]),
        [random.choice([-1, 1]) * random.randint(15, 30) for _ in range(3)],
    )
    place: Place = {"X": 460 + by[0], "Y": by[1], "Z": 675 - abs(by[2])}
    leg = Leg({f"T1.{name}": value for name, value in place.items()}, "line")
    return _task(
        "arm-line",
        ARM,
        "The tip of the arm (tool 1) is at X460 Y0 Z675 with A0 B0 C0. Move it in a straight line to "
        f"{_words(place)}, the orientation kept, at {feed} mm/s.",
        f"G1010\nG94 F{60 * feed}\nG01 T1 {_words(place)}\n",
        Expectation(path=(leg,), speed=(0.95 * feed, 1.01 * feed)),
    )


def arm_pick(random: Random) -> Task:
    feed, depth, rest = random.choice([60, 80, 100]), random.randint(18, 40), random.choice([0.3, 0.4, 0.5])
    beside = 460 + random.choice([-1, 1]) * random.randint(18, 30)
    above: Place = {"T1.X": beside, "T1.Z": 675}
    down: Place = {"T1.X": beside, "T1.Z": 675 - depth}
    legs = (Leg(above, "line"), Leg(down, "line", rest_s=(rest - 0.01, rest + 0.07)), Leg(above, "line"))
    return _task(
        "arm-pick",
        ARM,
        f"Pick something up with the arm (tool 1, tip at X460 Y0 Z675): straight to X{beside}, straight "
        f"down to "
        f"Z{675 - depth}, rest there for {rest:g} s, and straight up to Z675; {feed} mm/s, orientation "
        f"kept.",
        f"G1010\nG94 F{60 * feed}\nG01 T1 X{beside}\nZ{675 - depth}\nG04 P{rest:g}\nG01 Z675\n",
        Expectation(path=legs, speed=(0.9 * feed, 1.01 * feed)),
    )


def foot(random: Random) -> Task:
    tool, height, seconds = (
        random.choice([3, 6, 9, 12]),
        random.randint(15, 40),
        random.choice([0.4, 0.5, 0.6]),
    )
    leg = Leg({f"T{tool}.Y": -400 + height}, "line", duration_s=(seconds - 0.01, seconds + 0.01))
    return _task(
        "foot",
        DOG,
        f"The foot of tool {tool} stands at Y-400. Lift it straight up by {height} mm in {seconds:g} s; "
        f"its X and Z stay.",
        f"G1010\nG93 F{60 / seconds:g}\nG01 T{tool} Y{-400 + height}\n",
        Expectation(path=(leg,), end={f"T{each}.Y": -400 for each in (3, 6, 9, 12) if each != tool}),
    )


def drilling(random: Random) -> Task:
    feed, depth = random.choice([10, 15, 20]), random.randint(5, 9)
    origin = {"X": float(random.randint(-80, 20)), "Y": float(random.randint(-80, 20))}
    holes = [
        (float(random.randint(5, 25)), float(random.randint(-25, 25))) for _ in range(random.randint(2, 4))
    ]
    legs = []
    for x, y in holes:
        here = {"X": origin["X"] + x, "Y": origin["Y"] + y}
        legs += [Leg({**here, "Z": 40}), Leg({**here, "Z": 2}, "line", speed=(60, 5000))]
        legs += [
            Leg({**here, "Z": -depth}, "line", speed=_speed(feed)),
            Leg({**here, "Z": 40}, "line", speed=(60, 5000)),
        ]
    words = ", ".join(f"X{x:g} Y{y:g}" for x, y in holes)
    cycle = "\n".join(f"X{x:g} Y{y:g}" for x, y in holes[1:])
    return _task(
        "drilling",
        machine_file("mill"),
        f"Set the origin of G55 to X{origin['X']:g} Y{origin['Y']:g} Z0 of the machine, and drill in "
        f"G55 by the canned "
        f"cycle at {words}, in this order: R2, down to Z-{depth} at {feed} mm/s, between the holes at "
        f"Z40, where Z stands.",
        f"G10 L2 P2 X{origin['X']:g} Y{origin['Y']:g} Z0\nG55 G90 G94\n"
        f"G98 G81 X{holes[0][0]:g} Y{holes[0][1]:g} Z-{depth} R2 F{60 * feed}\n{cycle}\nG80\nM30\n",
        Expectation(path=tuple(legs), uses=("G81", "G55")),
        {"Z": 40},
    )


def contour(random: Random) -> Task:
    feed, side, tall = random.choice([20, 30, 40]), random.randint(15, 30), random.randint(15, 30)
    tool, length = random.choice([(1, 20.0), (2, 35.5), (3, 10.0)])
    depth = random.randint(2, 5)
    low = length - depth
    corners: list[Place] = [
        {"X": side, "Y": 0},
        {"X": side, "Y": tall},
        {"X": 0, "Y": tall},
        {"X": 0, "Y": 0},
    ]
    legs = [Leg({"X": 0, "Y": 0, "Z": low}, "line", speed=_speed(10))]
    legs += [Leg({**corner, "Z": low}, "line", speed=(0.9 * feed, 1.006 * feed)) for corner in corners]
    legs.append(Leg({"X": 0, "Y": 0, "Z": length + 20}, "line", speed=(60, 5000)))
    return _task(
        "contour",
        machine_file("mill"),
        f"With tool {tool} and its length (G43), at X0 Y0: plunge to Z-{depth} at 10 mm/s, mill the "
        f"rectangle by "
        f"{', '.join(map(_words, corners))} at {feed} mm/s, and retract to Z20 by a rapid move.",
        f"T{tool} M6\nG43 H{tool}\nG90 G94\nG01 Z-{depth} F600\n"
        + "\n".join([f"{_words(corners[0])} F{60 * feed}", *map(_words, corners[1:])])
        + "\nG00 Z20\nM30\n",
        Expectation(path=tuple(legs), uses=("G43",)),
        {"Z": length + 20},
    )


def clear_of_vise(random: Random) -> Task:
    feed, across = random.choice([40, 60, 80]), random.randint(-10, 10)
    clear = random.randint(3, 8)
    end = random.randint(230, 260)
    high = clear + 3
    return _task(
        "clear-of-vise",
        machine_file("mill"),
        f"Carry the spindle from X0 Y{across} Z0 to X{end} Y{across} Z0 at {feed} mm/s, over the vise, "
        f"whose top is at "
        f"Z0 from X130 to X170: all of the spindle stays at least {clear} mm clear of it, and Z below "
        f"60. The lowest "
        "point of the spindle is at Z of the program, its radius is 10 mm.",
        f"G90 G94 F{60 * feed}\nG01 Z{high}\nX{end}\nZ0\nM30\n",
        Expectation(
            path=(Leg({"X": end, "Z": 0}, detour=True),),
            within={"X": (0, end), "Z": (0, 60)},
            clear_mm=clear,
            speed=_speed(feed),
        ),
        {"Y": across},
    )


def handling(random: Random) -> Task:
    feed, angle = random.choice([60, 80, 100]), random.choice([-90, -60, -45, 45, 60, 90])
    first = {"X": _place(random, 40, 200), "Y": _place(random, 40, 200)}
    down = random.randint(15, 60)
    legs = (
        Leg({**first, "Z": 0, "C": angle}, speed=(60, 5000)),
        Leg({**first, "Z": -down, "C": angle}, "line", speed=_speed(feed)),
        Leg({**first, "Z": 0, "C": angle}, "line", speed=_speed(feed)),
    )
    return _task(
        "handling",
        machine_file("handling"),
        f"Bring the gripper by a rapid move to {_words(first)} with C{angle}, then straight down to "
        f"Z-{down} and straight up "
        f"again to Z0, both at {feed} mm/s.",
        f"G90 G94\nG00 {_words(first)} C{angle}\nG01 Z-{down} F{60 * feed}\nZ0\nM30\n",
        Expectation(path=legs, uses=("G00",)),
    )


def increments(random: Random) -> Task:
    feed, start = (
        random.choice([60, 80, 100]),
        {"X": float(random.randint(-90, 90)), "Z": float(random.randint(50, 90))},
    )
    along, down = _place(random, 20, 60), random.randint(15, 40)
    legs = (
        Leg({"X": start["X"], "Z": start["Z"] - down}, "line"),
        Leg({"X": round(start["X"] + along, 3), "Z": start["Z"] - down}, "line"),
        Leg({"X": round(start["X"] + along, 3), "Z": start["Z"]}, "line"),
    )
    return _task(
        "increments",
        machine_file("handling"),
        f"Wherever X and Z stand, and without G91: lower Z by {down} mm, then move X by {along:+g} mm, "
        f"then raise Z again "
        f"by {down} mm, in straight lines at {feed} mm/s.",
        f"G94 F{60 * feed}\nG01 W-{down}\nU{along:g}\nW{down}\nM30\n",
        Expectation(path=legs, lacks=("G91",), speed=(0.9 * feed, 1.006 * feed)),
        start,
    )


FAMILIES: tuple[Callable[[Random], Task], ...] = (
    line,
    polygon,
    arc,
    circle,
    timed,
    dwell,
    stops,
    from_here,
    around,
    raster,
    inches,
    arm_line,
    arm_pick,
    foot,
    drilling,
    contour,
    clear_of_vise,
    handling,
    increments,
)
