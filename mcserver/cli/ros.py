"""``mcserver ros``: machines as nodes of ROS 2."""

from __future__ import annotations

import re
from typing import Annotated

import typer

from mcserver.cli.console import narration
from mcserver.cli.options import ConnectOption, ZenohConfigOption
from mcserver.cli.serving import require_packages, run_until_stopped
from mcserver.errors import ConfigurationError
from mcserver.ros.graph import MAX_DOMAIN
from mcserver.ros.servo_options import DEFAULTS, CommandType, ServoOptions, read_bounds

NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*")


def ros(
    connect: ConnectOption = None,
    zenoh: ZenohConfigOption = None,
    ros_connect: Annotated[
        list[str] | None,
        typer.Option(
            "--ros-connect", metavar="E", help="Zenoh endpoint of the nodes of ROS, if another one."
        ),
    ] = None,
    domain: Annotated[
        int, typer.Option("--domain", min=0, max=MAX_DOMAIN, envvar="ROS_DOMAIN_ID", help="Domain of ROS.")
    ] = 0,
    machine: Annotated[
        str | None,
        typer.Option("--machine", metavar="NAME", help="This one alone, its names in the root namespace."),
    ] = None,
    rate: Annotated[
        float, typer.Option("--rate", min=1.0, max=1000.0, help="Messages a second on joint_states.")
    ] = 100.0,
    controller: Annotated[
        str, typer.Option("--controller", metavar="NAME", help="What stands before the trajectory action.")
    ] = "joint_trajectory_controller",
    servo: Annotated[
        str, typer.Option("--servo", metavar="NAME", help="What stands before the topics of servo mode.")
    ] = DEFAULTS.name,
    command_in_type: Annotated[
        CommandType,
        typer.Option(
            "--command-in-type", help="Commands are shares of the scales from -1 to 1, or m/s and rad/s."
        ),
    ] = CommandType.UNITLESS,
    linear_scale: Annotated[
        float, typer.Option("--linear-scale", min=0.0, max=10.0, metavar="V", help="Of twists [m/s].")
    ] = DEFAULTS.linear,
    rotational_scale: Annotated[
        float, typer.Option("--rotational-scale", min=0.0, max=100.0, metavar="V", help="Of twists [rad/s].")
    ] = DEFAULTS.rotational,
    joint_scale: Annotated[
        float,
        typer.Option("--joint-scale", min=0.0, max=100.0, metavar="V", help="Of joints [rad/s or m/s]."),
    ] = DEFAULTS.joint,
    command_timeout: Annotated[
        float,
        typer.Option(
            "--command-timeout", min=0.02, max=5.0, metavar="S", help="Without a command so long, axes stop."
        ),
    ] = DEFAULTS.timeout_s,
    within: Annotated[
        list[str] | None,
        typer.Option(
            "--within", metavar="J=LOW:HIGH", help="Bounds of a joint in servo mode [rad or m]. Repeatable."
        ),
    ] = None,
    servo_tool: Annotated[
        int | None,
        typer.Option(
            "--servo-tool", metavar="N", help="Whose twists in the base's frame are; the first one."
        ),
    ] = None,
) -> None:
    """Show all machines as nodes of ROS 2 (Jazzy) to whoever speaks rmw_zenoh, until Ctrl-C."""
    require_packages("ros", "ros", ("rosbags", "mcclient"))
    from mcserver.ros.bridge import Bridge
    from mcserver.ros.machine_node import NodeOptions

    for name in (controller, servo):
        if not NAME.fullmatch(name):
            raise ConfigurationError(
                "MC083",
                f"{name!r} is no name of ROS",
                "letters, digits and _, no digit first; a slash between names",
            )
    try:
        bounds = dict(map(read_bounds, within or ()))
    except ValueError as error:
        raise typer.BadParameter("--within is such as joint_1=-0.5:0.5, low below high") from error
    meant = ServoOptions(
        servo,
        command_in_type,
        linear_scale,
        rotational_scale,
        joint_scale,
        command_timeout,
        servo_tool,
        bounds,
    )
    options = NodeOptions(
        tuple(connect or ()), zenoh, tuple(ros_connect or ()), domain, machine, rate, controller, meant
    )
    narration().print(f"ROS 2: domain {domain} (Ctrl-C ends)")
    run_until_stopped(Bridge(options, narration().print).run())
