"""What every process is made of.

The service protocol, the loop and the clock; and what all services share: intake (open, count, refuse), roster (who is there), roll
call (has everything of a tick arrived), team clock (by whose clock a process goes), rounds (when a phase of a tick is over).
"""
