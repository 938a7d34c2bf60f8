"""The dialect's codes, for completion."""

from __future__ import annotations

CODES = {
    "G00": "rapid: every axis at its own limits",
    "G01": "straight line",
    "G02": "arc or helix, clockwise",
    "G03": "arc or helix, counter-clockwise",
    "G04": "dwell, P in seconds",
    "G09": "exact stop for the next motion",
    "G17": "arcs in XY",
    "G18": "arcs in ZX",
    "G19": "arcs in YZ",
    "G20": "inches",
    "G21": "millimetres",
    "G61": "exact stop mode",
    "G64": "path mode: no stop between lines",
    "G90": "absolute coordinates",
    "G91": "incremental coordinates",
    "G93": "inverse time: F in moves per minute",
    "G94": "feed: F in mm, inches or degrees per minute",
    "G1000": "reset a drive's fault, P axis",
    "G1001": "off: take the energy away, P axis",
    "G1002": "stop, P axis",
    "G1010": "capture: energize, P axis",
    "G1011": "release, P axis",
    "G1020": "positioning, each axis by itself",
    "G1030": "motor speed in RPM",
    "G1040": "torque in Nm",
    "G1050": "no tool",
    "M00": "pause until resumed",
    "M01": "pause until resumed",
    "M02": "end of the program",
    "M30": "end of the program",
}

COMMANDS = {
    ":status": "the machine's state",
    ":hold": "feed hold",
    ":resume": "end a hold, M00 or M01",
    ":abort": "stop and drop the lines that wait",
    ":override": "feed override in percent, such as :override 50",
    ":help": "these commands",
    ":quit": "leave once the motion has ended",
}
