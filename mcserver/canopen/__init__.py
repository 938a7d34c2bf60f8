"""The service path of CANopen drives: dictionaries, boot-up, supervision and SDO, beside the cycle.

Only `mcserver.canopen.service` and what it imports need the packages of the ``can`` extra; a machine
without drives on a bus imports none of it.
"""
