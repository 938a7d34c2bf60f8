"""The service path of CANopen drives: dictionaries, boot-up, supervision and SDO, beside the cycle.

A machine without drives on a bus imports none of the packages for them.
"""
