"""Orders: methods of a machine's object Control, for the roles that every other door asks for.

OPC 40501-1 only watches. A machine takes orders where its machine file says so (``[machine] orders_from``),
which is asked for at each order: another start of its server may have another file.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from typing import NamedTuple

from asyncua import ua
from mcclient.errors import MotionError, NoAnswerInTime, NobodyAnswers
from mcclient.fleet import FleetLink

from mcserver.net.method_table import BY_NAME
from mcserver.net.roles import Role
from mcserver.opcua.nodes import MachineNodes

log = logging.getLogger(__name__)

INSTRUMENT = "opcua"
CONTROL = "Control"
STATUS = ua.StatusCodes
# of the wire: a message that is not of its form, no such program, a value beyond its bounds
REFUSALS = {"MC500": STATUS.BadInvalidArgument, "MC503": STATUS.BadNotFound, "MC511": STATUS.BadOutOfRange}


class Order(NamedTuple):
    """A method: its name, the wire's, and its one argument with the wire's name of it."""

    name: str
    method: str
    argument: str
    field: str
    kind: ua.VariantType


ORDERS = (
    Order("Start", "resume", "Job", "program", ua.VariantType.String),
    Order("Hold", "hold", "Job", "program", ua.VariantType.String),
    Order("SetFeedOverride", "override", "Percent", "percent", ua.VariantType.Double),
)


async def add_control(nodes: MachineNodes) -> dict[ua.NodeId, Order]:
    """Add a machine's object Control; return its methods."""
    own = nodes.model.own
    control = await nodes.node("").add_object(nodes.id_of(CONTROL), ua.QualifiedName(CONTROL, own))
    found = {}
    for order in ORDERS:
        argument = ua.Argument(
            Name=order.argument, DataType=ua.NodeId(order.kind.value), ValueRank=ua.ValueRank.Scalar
        )
        method = nodes.id_of(f"{CONTROL}.{order.name}")
        # the session of who calls carries it out, since it knows the user
        await control.add_method(method, ua.QualifiedName(order.name, own), None, [argument])
        found[method] = order
    return found


async def carry_out(
    link: FleetLink, machine: str, order: Order, who: str, role: Role, arguments: Sequence[ua.Variant]
) -> ua.StatusCode:
    """Send an order to a machine, and return what came of it."""
    status, reason = await _send(link, machine, order, role, arguments)
    log.info("%s of %s by %s (%s): %s", order.name, machine, who, role.value, reason or "done")
    return status


async def _send(
    link: FleetLink, machine: str, order: Order, role: Role, arguments: Sequence[ua.Variant]
) -> tuple[ua.StatusCode, str]:
    """Return the status and, where the order is not carried out, the reason."""
    if role not in BY_NAME[order.method].roles:
        return ua.StatusCode(STATUS.BadUserAccessDenied), "the role may not"
    if len(arguments) != 1:
        number = STATUS.BadTooManyArguments if arguments else STATUS.BadArgumentsMissing
        return ua.StatusCode(number), "it has one argument"
    (argument,) = arguments
    if argument.VariantType is not order.kind or argument.is_array:
        return ua.StatusCode(STATUS.BadInvalidArgument), f"{order.argument} is no {order.kind.name}"
    # no job is every job
    value = argument.Value if argument.Value != "" else None
    try:
        if INSTRUMENT not in (await link.info(machine)).orders_from:
            return ua.StatusCode(STATUS.BadNotExecutable), "its machine file takes no orders from here"
        await link.order(machine, order.method, **{order.field: value})
    except MotionError as error:
        return _status_of(error), f"{error.code}: {error.message}"
    return ua.StatusCode(), ""


def _status_of(error: MotionError) -> ua.StatusCode:
    if isinstance(error, NoAnswerInTime):
        # it may have been carried out
        return ua.StatusCode(STATUS.BadTimeout)
    if isinstance(error, NobodyAnswers):
        return ua.StatusCode(STATUS.BadNoCommunication)
    return ua.StatusCode(REFUSALS.get(error.code, STATUS.BadInvalidState))
