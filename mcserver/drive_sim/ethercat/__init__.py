"""Simulated CiA 402 drives on EtherCAT: slave controllers, mailboxes, and a line of them."""
