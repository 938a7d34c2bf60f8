"""Drives on EtherCAT: the master (SOEM, by pysoem), its port for the cycle, and its supervision."""
