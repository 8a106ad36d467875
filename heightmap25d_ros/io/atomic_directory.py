# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Writing directories and files in one step, so that no crash leaves half of them."""

from __future__ import annotations

import ctypes
import errno
import fcntl
import os
import re
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from heightmap25d_ros.errors import InputError

_RENAME_EXCHANGE = 2
_AT_FDCWD = -100


@contextmanager
def replacing(directory: Path) -> Iterator[Path]:
    """Hand out an empty directory that takes the place of another one when all went well.

    Whenever the process or the machine dies, the directory is either as before or complete:
    the new one is a hidden sibling ``.NAME.*.tmp``, synced before the two change names in one
    step. (A file system that cannot exchange directories, such as NFS, takes two renames;
    between them the old one is ``.NAME.*.old``.) Files in it that are not written anew stay.

    Raises
    ------
    InputError
        If the directory cannot be written, or holds other directories.
    """
    directory = directory.resolve()
    with _temporary(directory, directory.parent) as temporary:
        yield temporary
        _link_other_files(directory, temporary)
        for path in (*temporary.iterdir(), temporary):
            _sync(path)
        _put_in_place(temporary, directory)
        _sync(directory.parent)


@contextmanager
def adding(directory: Path) -> Iterator[Path]:
    """Hand out an empty directory whose files come into another one when all went well.

    Each of them is synced before it takes the place of an older one. A directory that was not
    there and into which nothing comes is not there afterwards.

    Raises
    ------
    InputError
        If the directory cannot be written.
    """
    directory = directory.resolve()
    is_new = not directory.exists()
    try:
        with _temporary(directory, directory) as temporary:
            yield temporary
            for path in temporary.iterdir():
                _sync(path)
            for path in temporary.iterdir():
                path.replace(directory / path.name)
            _sync(directory)
    except BaseException:
        if is_new:
            with suppress(OSError):
                directory.rmdir()
        raise


@contextmanager
def _temporary(directory: Path, place: Path) -> Iterator[Path]:
    """A new directory in a place, ``.NAME.*.tmp``; those that killed processes left are removed.

    It is locked as long as its process lives.
    """
    temporary = place / f".{directory.name}.{secrets.token_hex(4)}.tmp"
    try:
        temporary.mkdir(parents=True)
        lock = os.open(temporary, os.O_RDONLY)
        try:
            with suppress(OSError):  # a file system without locks
                fcntl.flock(lock, fcntl.LOCK_EX)
            _sweep(directory.name, place)
            yield temporary
        finally:
            os.close(lock)
    except OSError as error:
        raise InputError(f"{directory}: cannot be written: {error.strerror}") from None
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def _sweep(name: str, place: Path) -> None:
    """Remove the temporary directories of a name that no living process has locked."""
    pattern = re.compile(rf"\.{re.escape(name)}\.[0-9a-f]{{8}}\.tmp")
    for path in place.iterdir():
        if not pattern.fullmatch(path.name) or path.is_symlink() or not path.is_dir():
            continue
        with suppress(OSError):
            lock = os.open(path, os.O_RDONLY)
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                shutil.rmtree(path)
            finally:
                os.close(lock)


def _link_other_files(directory: Path, target: Path) -> None:
    """Let files that are not written anew be in both directories."""
    if not directory.exists():
        return
    for entry in directory.iterdir():
        if entry.is_dir() and not entry.is_symlink():
            raise InputError(f"{directory}: is not replaced, it holds a directory {entry.name!r}")
        if not (target / entry.name).exists():
            os.link(entry, target / entry.name, follow_symlinks=False)


def _sync(path: Path) -> None:
    if path.is_symlink():
        return
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _put_in_place(temporary: Path, directory: Path) -> None:
    """Give the new directory the old one's name, and the other way round if there is one."""
    if not directory.exists():
        temporary.rename(directory)
    elif not _exchange(temporary, directory):
        old = temporary.with_suffix(".old")
        directory.rename(old)
        temporary.rename(directory)
        old.rename(temporary)


def _exchange(first: Path, second: Path) -> bool:
    """Let two directories change names in one step; False where the file system cannot."""
    libc = ctypes.CDLL(None, use_errno=True)
    names = (_AT_FDCWD, os.fsencode(first), _AT_FDCWD, os.fsencode(second))
    if libc.renameat2(*names, _RENAME_EXCHANGE) == 0:
        return True
    code = ctypes.get_errno()
    if code in (errno.EINVAL, errno.ENOSYS):
        return False
    raise OSError(code, os.strerror(code))
