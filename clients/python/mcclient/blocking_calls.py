# Made by `python -m mcserver.contract.sdk clients`: change the server's messages instead.
"""Every remote method of a machine, for callers that wait."""

from __future__ import annotations

from mcclient.blocking import Blocking, T, waited
from mcclient.machine_calls import MachineCalls


class BlockingCalls(Blocking[T]):
    """As `mcclient.machine_calls.MachineCalls`."""

    ask_info = waited(MachineCalls.ask_info)
    status = waited(MachineCalls.status)
    programs = waited(MachineCalls.programs)
    past_events = waited(MachineCalls.past_events)
    open_program = waited(MachineCalls.open_program)
    continuation = waited(MachineCalls.continuation)
    open_continuation = waited(MachineCalls.open_continuation)
    leave = waited(MachineCalls.leave)
    submit_lines = waited(MachineCalls.submit_lines)
    close_program = waited(MachineCalls.close_program)
    hold = waited(MachineCalls.hold)
    resume = waited(MachineCalls.resume)
    step = waited(MachineCalls.step)
    abort = waited(MachineCalls.abort)
    override = waited(MachineCalls.override)
    jog = waited(MachineCalls.jog)
    jog_tool = waited(MachineCalls.jog_tool)
    machine_file = waited(MachineCalls.machine_file)
    write_machine_file = waited(MachineCalls.write_machine_file)
    open_servo = waited(MachineCalls.open_servo)
    servo_armed = waited(MachineCalls.servo_armed)
    home = waited(MachineCalls.home)
    reference = waited(MachineCalls.reference)
    reset = waited(MachineCalls.reset)
    tables = waited(MachineCalls.tables)
    set_table_row = waited(MachineCalls.set_table_row)
    set_output = waited(MachineCalls.set_output)
    set_simulated_input = waited(MachineCalls.set_simulated_input)
    call_estop = waited(MachineCalls.call_estop)
    check = waited(MachineCalls.check)
    simulate = waited(MachineCalls.simulate)
    put_text_part = waited(MachineCalls.put_text_part)
    request_run = waited(MachineCalls.request_run)
    run_requests = waited(MachineCalls.run_requests)
    run_approvals = waited(MachineCalls.run_approvals)
    run_preview = waited(MachineCalls.run_preview)
    arm = waited(MachineCalls.arm)
    reject = waited(MachineCalls.reject)
    withdraw = waited(MachineCalls.withdraw)
    run_armed = waited(MachineCalls.run_armed)
    record_start = waited(MachineCalls.record_start)
    record_stop = waited(MachineCalls.record_stop)
    record_save = waited(MachineCalls.record_save)
    recordings = waited(MachineCalls.recordings)
    recording_read = waited(MachineCalls.recording_read)
    model = waited(MachineCalls.model)
    model_mesh = waited(MachineCalls.model_mesh)
    drives = waited(MachineCalls.drives)
    drives_scan = waited(MachineCalls.drives_scan)
    sdo_read = waited(MachineCalls.sdo_read)
    sdo_write = waited(MachineCalls.sdo_write)
