"""Inputs and outputs of a machine."""

from __future__ import annotations

from mcclient.calls import Caller
from mcclient.wire import unpack


class ChannelCalls:
    """What `mcclient.Machine` offers of them; their values are in `MachineStatus`."""

    _caller: Caller

    async def set_output(self, name: str, value: bool | float) -> float:
        """Set an output by its name; a digital one is on (True, 1) or off (False, 0).

        Returns:
            The value that it has from the next cycle on, in its unit.

        Raises:
            RequestRefused: MC445 no such output or value, MC446 a running program has set it, MC509 the
                emergency stop is latched.
        """
        return float(unpack(await self._caller.call("set_output", {"output": name, "value": value}))["value"])

    async def set_simulated_input(self, name: str, value: bool | float) -> float:
        """Set a simulated input by its name, as `set_output`.

        Raises:
            RequestRefused: MC445 no such input or value, MC446 the input is real.
        """
        reply = await self._caller.call("set_simulated_input", {"input": name, "value": value})
        return float(unpack(reply)["value"])
