"""PyKDL's inverse kinematics at each waypoint from the one before, by Debian's Python; JSON in and out."""

import json
import statistics
import sys
import time

try:
    import numpy as np
    import PyKDL
except ImportError:
    sys.exit(1)


def main():
    question = json.load(sys.stdin)
    chain = PyKDL.Chain()
    for number, (point, direction) in enumerate(zip(question["points"], question["directions"], strict=True)):
        joint = PyKDL.Joint(
            f"joint{number}", PyKDL.Vector(*point), PyKDL.Vector(*direction), PyKDL.Joint.RotAxis
        )
        chain.addSegment(PyKDL.Segment(joint))
    chain.addSegment(PyKDL.Segment(PyKDL.Joint(PyKDL.Joint.Fixed), _frame(question["tip"])))
    # rotations weigh nothing where only the point is followed
    weights = np.array([1.0, 1.0, 1.0] + [1.0 if question["oriented"] else 0.0] * 3)
    solver = PyKDL.ChainIkSolverPos_LMA(chain, weights, question["tolerance"], 100, 1e-15)
    targets = [_frame(target) for target in question["targets"]]
    size = len(question["points"])
    taken, found = [], []
    for _ in range(question["runs"]):
        joints = PyKDL.JntArray(size)
        for index, value in enumerate(question["start"]):
            joints[index] = value
        found = []
        begun = time.process_time()
        for target in targets:
            answer = PyKDL.JntArray(size)
            solver.CartToJnt(joints, target, answer)
            joints = answer
            found.append(answer)
        taken.append(time.process_time() - begun)
    rows = [[answer[index] for index in range(size)] for answer in found]
    json.dump({"seconds": statistics.median(taken), "joints": rows}, sys.stdout)


def _frame(numbers):
    return PyKDL.Frame(PyKDL.Rotation(*numbers[:9]), PyKDL.Vector(*numbers[9:]))


if __name__ == "__main__":
    main()
