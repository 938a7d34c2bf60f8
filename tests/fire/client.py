"""A client in a process of its own: moves an axis by one program, and says as JSON what it was answered."""

from __future__ import annotations

import asyncio
import json
import sys

from mcclient import Machine, MotionError

HEAD = ["G1010 P0", "G91 G94 F12000"]
STEP_MM = 0.5


async def main(endpoint: str, machine: str, lines: int) -> dict[str, object]:
    said: dict[str, object] = {"state": "", "error": "", "program": "", "accepted": 0, "done": 0}
    try:
        async with Machine.connect(machine, endpoint, timeout_s=60.0) as reached:
            program = None
            try:
                async with reached.program(name="fire", axes=[0]) as program:
                    said["program"] = program.id
                    for first in range(0, lines, 20):
                        more = [f"G01 [0]{STEP_MM}"] * min(20, lines - first)
                        await program.send_lines([*(HEAD if first == 0 else []), *more])
                    result = await program.finish()
                    said["state"] = result.state
            finally:
                if program is not None:
                    said["accepted"], said["done"] = program.accepted_through, program.done_through
    except MotionError as error:
        said["error"] = f"{error.code}: {error}"
    return said


if __name__ == "__main__":
    print(json.dumps(asyncio.run(main(sys.argv[1], sys.argv[2], int(sys.argv[3])))), flush=True)
