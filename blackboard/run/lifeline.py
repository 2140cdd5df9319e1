"""Ending a process together with the one that started it."""

import ctypes
import os
import signal
import sys


def follow(parent: int) -> None:
    """Let the kernel kill this process when `parent`, its parent process, ends, even by SIGKILL. Linux only, elsewhere nothing."""
    if not sys.platform.startswith("linux"):
        return
    pr_set_pdeathsig = 1
    ctypes.CDLL(None).prctl(pr_set_pdeathsig, signal.SIGKILL)
    if os.getppid() != parent:  # the parent died before the call, so the kernel will send no signal
        os._exit(0)
