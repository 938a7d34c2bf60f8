"""What holds for any master, however badly it behaves."""

from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st

from mcserver.can.cob import NMT, SYNC, Function
from mcserver.drive_sim.cia402_node import Cia402Node
from mcserver.drive_sim.power import FAULT_RESET, Options, PowerMachine, PowerState, Stop
from mcserver.drive_sim.servosila_node import ServosilaNode
from tests.drive_sim.bench import NODE, Bench
from tests.drive_sim.test_servosila import CODES

S = PowerState
# CiA 402-2, figure 2.
TRANSITIONS = {
    (S.SWITCH_ON_DISABLED, S.READY_TO_SWITCH_ON),
    (S.READY_TO_SWITCH_ON, S.SWITCHED_ON),
    (S.READY_TO_SWITCH_ON, S.SWITCH_ON_DISABLED),
    (S.SWITCHED_ON, S.OPERATION_ENABLED),
    (S.SWITCHED_ON, S.READY_TO_SWITCH_ON),
    (S.SWITCHED_ON, S.SWITCH_ON_DISABLED),
    (S.OPERATION_ENABLED, S.SWITCHED_ON),
    (S.OPERATION_ENABLED, S.READY_TO_SWITCH_ON),
    (S.OPERATION_ENABLED, S.SWITCH_ON_DISABLED),
    (S.OPERATION_ENABLED, S.QUICK_STOP_ACTIVE),
    (S.QUICK_STOP_ACTIVE, S.SWITCH_ON_DISABLED),
    (S.QUICK_STOP_ACTIVE, S.OPERATION_ENABLED),
}
controlwords = st.one_of(st.sampled_from([0, 2, 6, 7, 15, 0x80, 0x8F]), st.integers(0, 0xFFFF))


@settings(max_examples=300)
@given(
    st.lists(st.tuples(controlwords, st.booleans()), max_size=60),
    st.sampled_from([0, 1, 2, 5, 6]),
    st.integers(0, 1),
)
def test_only_the_standards_transitions_are_ever_made(
    commands: list[tuple[int, bool]], quick_stop: int, shutdown: int
) -> None:
    machine = PowerMachine(energize_s=0.01)
    machine.reset()
    options = Options(quick_stop, shutdown, shutdown, 2)
    for step, (controlword, stops) in enumerate(commands):
        before = machine.state
        machine.command(controlword, step * 0.005, options)
        assert machine.state is before or (before, machine.state) in TRANSITIONS
        if stops and machine.stopping is not Stop.NONE:
            before = machine.state
            machine.stopped()
            assert machine.state is before or (before, machine.state) in TRANSITIONS


@settings(max_examples=200)
@given(st.lists(controlwords, max_size=40))
def test_a_fault_is_acknowledged_by_a_rising_edge_and_by_nothing_else(commands: list[int]) -> None:
    machine = PowerMachine(energize_s=0.0)
    machine.reset()
    options = Options(2, 0, 1, 0)
    machine.fault(options)
    last = 0
    for controlword in commands:
        wanted = machine.command(controlword, 0.0, options)
        assert wanted == bool(controlword & ~last & FAULT_RESET)
        assert machine.state is PowerState.FAULT
        last = controlword


frames = st.lists(
    st.tuples(
        st.one_of(
            st.sampled_from(
                [
                    NMT,
                    SYNC,
                    Function.SDO_REQUEST + NODE,
                    Function.RPDO1 + NODE,
                    Function.RPDO2 + NODE,
                    Function.HEARTBEAT + 127,
                ]
            ),
            st.integers(0, 0x7FF),
        ),
        st.binary(max_size=8),
    ),
    max_size=60,
)


@settings(max_examples=100)
@given(frames)
def test_no_frame_breaks_a_node(received: list[tuple[int, bytes]]) -> None:
    bench = Bench().operate()
    for identifier, payload in received:
        bench.receive(identifier, payload)
        bench.wait(0.003)
    bench.receive(NMT, b"\x81\x00")
    bench.taken()
    bench.wait(0.1)
    assert (Function.HEARTBEAT + NODE, b"\x00") in bench.sent
    assert bench.read(0x1000, 0, "I") == 0x00020192


@settings(max_examples=100)
@given(st.lists(st.binary(max_size=8), max_size=40))
def test_no_command_breaks_a_servosila_drive(commands: list[bytes]) -> None:
    sent: list[int] = []
    node = ServosilaNode(NODE, lambda identifier, _payload: sent.append(identifier), CODES)
    node.switch_on(0.0)
    now = 0.0
    for payload in commands:
        now += 0.005
        node.poll(now)
        node.receive(Function.RPDO1 + NODE, payload, now)
    sent.clear()
    node.poll(now + 1.0)
    assert set(sent) == {Function.TPDO1 + NODE, Function.TPDO2 + NODE, Function.TPDO3 + NODE}


def test_a_node_that_was_not_switched_on_does_nothing() -> None:
    sent: list[int] = []
    node = Cia402Node(NODE, lambda identifier, _payload: sent.append(identifier))
    node.receive(SYNC, b"", 1.0)
    node.receive(Function.SDO_REQUEST + NODE, bytes(8), 1.0)
    node.poll(1.0)
    assert sent == []
