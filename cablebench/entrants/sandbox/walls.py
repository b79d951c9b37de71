"""Walls around the process of a stranger's file, asked of the kernel: limits, Landlock, a filter of system calls.

This file imports nothing of the project and nothing that starts threads: a process puts the walls around itself before
it imports anything else (`entrants/sandbox/boot.py`), as Landlock holds for the calling thread and for those that
it starts later. Each function raises OSError where the kernel does not do what was asked.

Landlock: https://docs.kernel.org/userspace-api/landlock.html; seccomp: https://docs.kernel.org/userspace-api/seccomp_filter.html.
"""

import ctypes
import errno
import os
import platform
import struct
import sys
from collections.abc import Iterable, Mapping
from contextlib import suppress

with suppress(ImportError):  # Windows has none, and no walls either (`kinds.choose`)
    import resource

_READ = 1 << 0 | 1 << 2 | 1 << 3  # execute (as a loader maps a library), read a file, read a folder
_OF_FILES = 1 << 0 | 1 << 2
_RIGHTS = {1: 13, 2: 14, 3: 15, 5: 16}
"""Landlock's rights on files by the version (ABI) that brought them: their number."""

_CREATE_RULESET, _ADD_RULE, _RESTRICT_SELF, _SECCOMP = 444, 445, 446, 317
_SET_NO_NEW_PRIVS, _CAPBSET_DROP = 38, 24

_NEVER = {
    "processes and threads": (56, 57, 58, 59, 322),
    "other processes": (101, 310, 311, 312, 424, 434, 438, 440, 200, 109, 112),
    "sockets": (41, 42, 43, 49, 50, 53, 288),
    "files": (
        85, 82, 83, 84, 86, 87, 88, 90, 91, 92, 93, 94, 76, 77, 132, 133, 188, 189, 190, 197, 198, 199, 235, 258, 259,
        260, 261, 263, 264, 265, 266, 268, 280, 285, 303, 304, 316, 319, 447, 452,
    ),
    "memory shared with others": (29, 30, 31, 64, 65, 66, 68, 69, 70, 71, 240, 241),
    "limits and priorities": (160, 141, 142, 144, 203, 251, 314),
    "the machine": (
        135, 153, 154, 155, 161, 163, 164, 165, 166, 167, 168, 169, 170, 171, 172, 173, 174, 175, 176, 179, 227, 246,
        248, 249, 250, 272, 298, 308, 313, 320, 321, 323, 428, 429, 430, 431, 432, 433, 442,
    ),
}  # fmt: skip
"""Calls of Linux on x86-64 that are refused (EPERM), by number: fork, execve, ptrace, socket, unlink."""

_ABSENT = (435, 437, 425, 426, 427)
"""Calls that are answered with ENOSYS, so that the C library takes the older one: clone3, openat2, io_uring."""

_OWN_PROCESS_ONLY = (62, 234, 129, 297)
"""kill, tgkill and the like: to the process itself they are allowed."""

_WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC
_ALLOW, _REFUSE, _KILL = 0x7FFF0000, 0x00050000, 0x80000000
_X86_64 = 0xC000003E


def limit(limits: Mapping[str, int]) -> None:
    """Set limits by their names in `resource` (without RLIMIT_), soft and hard; what is lower already stays."""
    for name, value in limits.items():
        kind = getattr(resource, f"RLIMIT_{name}", None)
        if kind is None:
            continue
        hard = resource.getrlimit(kind)[1]
        least = value if hard == resource.RLIM_INFINITY else min(value, hard)
        resource.setrlimit(kind, (least, least))


def give_up_privileges() -> None:
    """No capabilities, and none by any program: also a process of root is then an ordinary one (Linux)."""
    libc = ctypes.CDLL(None, use_errno=True)
    for number in range(64):
        libc.prctl(_CAPBSET_DROP, number, 0, 0, 0)
    header, none = struct.pack("=Ii", 0x20080522, 0), bytes(24)
    libc.capset(header, none)
    _checked(libc.prctl(_SET_NO_NEW_PRIVS, 1, 0, 0, 0), "no new privileges")


def landlock_version() -> int:
    """Version (ABI) of Landlock in this kernel; 0 where there is none."""
    if sys.platform != "linux":
        return 0
    return max(int(ctypes.CDLL(None, use_errno=True).syscall(_CREATE_RULESET, None, 0, 1)), 0)


def may_filter_calls() -> bool:
    """Whether the filter of system calls can be used: Linux on x86-64, whose numbers this file has."""
    if sys.platform != "linux" or platform.machine() != "x86_64" or sys.maxsize < 2**32:
        return False
    action = struct.pack("=I", _REFUSE)
    return bool(ctypes.CDLL(None, use_errno=True).syscall(_SECCOMP, 2, 0, action) == 0)


def only_read(paths: Iterable[str]) -> None:
    """From now on only these files and folders can be read; none can be written, TCP and signals stay within (Linux).

    What of it the kernel knows: files from Landlock 1, TCP from 4, signals and abstract sockets from 6.
    """
    libc = ctypes.CDLL(None, use_errno=True)
    version = landlock_version()
    handled = (1 << max(n for since, n in _RIGHTS.items() if since <= version)) - 1
    attributes = struct.pack("=QQQ", handled, 0b11, 0b11)[: 24 if version >= 6 else 16 if version >= 4 else 8]
    rules = _checked(libc.syscall(_CREATE_RULESET, attributes, len(attributes), 0), "Landlock's rules")
    for path in paths:
        try:
            place = os.open(path, os.O_PATH | os.O_CLOEXEC)
        except OSError:
            continue  # not on this machine
        rights = _READ if os.path.isdir(path) else _OF_FILES
        _checked(libc.syscall(_ADD_RULE, rules, 1, struct.pack("=Qi", rights, place), 0), f"Landlock's rule of {path}")
        os.close(place)
    _checked(libc.prctl(_SET_NO_NEW_PRIVS, 1, 0, 0, 0), "no new privileges")
    _checked(libc.syscall(_RESTRICT_SELF, rules, 0), "Landlock")
    os.close(rules)


def filter_calls() -> None:
    """From now on no thread of this process starts another one or a process, opens a socket or a file to write."""
    program = b"".join(_program(os.getpid()))
    buffer = ctypes.create_string_buffer(program)
    head = struct.pack("=HxxxxxxQ", len(program) // 8, ctypes.addressof(buffer))
    libc = ctypes.CDLL(None, use_errno=True)
    _checked(libc.prctl(_SET_NO_NEW_PRIVS, 1, 0, 0, 0), "no new privileges")
    _checked(libc.syscall(_SECCOMP, 1, 1, head), "the filter of system calls")  # 1: for all threads


def _program(pid: int) -> Iterable[bytes]:
    """The filter, instruction by instruction (classic BPF over struct seccomp_data)."""
    refused, denied, absent = (_REFUSE | code for code in (errno.EPERM, errno.EACCES, errno.ENOSYS))
    yield from (_load(4), _if_equal(_X86_64, 1, 0), _return(_KILL))
    yield from (_load(0), _op(0x35, 0x40000000, 0, 1), _return(refused))  # >=: the x32 numbers
    for numbers, answer in ((sum(_NEVER.values(), ()), refused), (_ABSENT, absent)):
        for number in numbers:
            yield from (_if_equal(number, 0, 1), _return(answer))
    for number in _OWN_PROCESS_ONLY:
        yield from (_if_equal(number, 0, 4), _load(16), _if_equal(pid, 0, 1), _return(_ALLOW), _return(refused))
    for number, flags in ((2, 24), (257, 32)):  # open and openat
        yield from (_if_equal(number, 0, 4), _load(flags), _op(0x45, _WRITING, 0, 1), _return(denied), _return(_ALLOW))
    yield from (_if_equal(302, 0, 6), _load(32), _if_equal(0, 0, 3), _load(36), _if_equal(0, 0, 1))  # prlimit64
    yield from (_return(_ALLOW), _return(refused))
    yield from (_if_equal(16, 0, 5), _load(24), _if_equal(0x5412, 1, 0), _if_equal(0x541C, 0, 1))  # ioctl: typing
    yield from (_return(refused), _return(_ALLOW), _return(_ALLOW))


def _op(code: int, value: int, jump_true: int, jump_false: int) -> bytes:
    return struct.pack("=HBBI", code, jump_true, jump_false, value)


def _load(offset: int) -> bytes:
    return _op(0x20, offset, 0, 0)


def _if_equal(value: int, jump_true: int, jump_false: int) -> bytes:
    return _op(0x15, value, jump_true, jump_false)


def _return(value: int) -> bytes:
    return _op(0x06, value, 0, 0)


def _checked(answer: int, what: str) -> int:
    if answer < 0:
        code = ctypes.get_errno()
        raise OSError(code, f"{what}: {os.strerror(code)}")
    return answer
