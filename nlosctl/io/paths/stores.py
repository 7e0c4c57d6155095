"""Stores that URLs name: their filesystems, and their errors in one line."""

from __future__ import annotations

import errno
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from importlib import import_module
from typing import Any

from nlosctl.errors import MissingExtraError, NlosctlError, UsageError, did_you_mean, hide_secrets

__all__ = ["SHOWING_AT_CLOSE", "answering", "filesystem_of"]

SHOWING_AT_CLOSE = ("s3", "gcs", "abfs")

"""pyarrow's names of the stores in which a file appears complete when it is closed, and folders are parts of names."""

_PYARROW_SCHEMES = ("s3", "gs", "gcs", "hdfs", "viewfs", "abfs", "abfss")


@lru_cache(maxsize=64)
def filesystem_of(process: int, scheme: str, authority: str, query: str) -> tuple[Any, str]:
    """Return the filesystem of a bucket or host, and the path of its root; processes don't share connections."""
    from pyarrow.fs import FileSystem, FSSpecHandler, PyFileSystem

    root = f"{scheme}://{authority}"
    if scheme in _PYARROW_SCHEMES:
        region = os.environ.get("AWS_REGION") or os.environ.get("AWS_DEFAULT_REGION")
        if scheme == "s3" and region and "region=" not in query:  # otherwise the region is looked up
            query = f"{query}&region={region}" if query else f"?region={region}"
        filesystem, base = FileSystem.from_uri(root + query)
        return filesystem, str(base)
    try:
        fsspec: Any = import_module("fsspec")
    except ImportError:
        raise MissingExtraError(f"reading {scheme}:// URLs", "fsspec", "dask") from None
    known = {*_PYARROW_SCHEMES, "file", *fsspec.available_protocols()}
    if scheme not in known:
        raise UsageError(
            f"{root}: unknown scheme {scheme!r}{did_you_mean(scheme, sorted(known))}; known: s3, gs, hdfs, abfs, "
            f"file and those of fsspec"
        )
    filesystem, base = fsspec.core.url_to_fs(root)
    return PyFileSystem(FSSpecHandler(filesystem)), str(base)


@contextmanager
def answering(name: str) -> Iterator[None]:
    """Turn any error of a store or its library into an OSError of one line, without secrets of ``name``, its URL."""
    shown = hide_secrets(name)
    try:
        yield
    except (NlosctlError, FileExistsError):
        raise
    except FileNotFoundError as error:
        missing = FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), shown)
        raise missing from (error if shown == name else None)  # its text has the URL
    except Exception as error:
        if isinstance(error, OSError) and error.filename == shown:
            raise
        reason = " ".join((hide_secrets(str(error)).strip().splitlines() or [type(error).__name__])[0].split())
        raise OSError(errno.EIO, f"{reason}{_cure(reason)}", shown) from (error if shown == name else None)


def _cure(reason: str) -> str:
    if re.search(r"ACCESS_DENIED|credential|anonymous|forbidden|\b40[13]\b", reason, re.IGNORECASE):
        return "; check the credentials in the environment or the store's configuration file"
    if "requests" in reason and "aiohttp" in reason:
        return "; install it with: pip install aiohttp"
    if "libjvm" in reason or "libhdfs" in reason:
        return "; hdfs:// needs Java and Hadoop's client: set JAVA_HOME, HADOOP_HOME and CLASSPATH"
    if "resolving region" in reason or "NETWORK_CONNECTION" in reason:
        return "; check the name and the network; AWS_REGION and AWS_ENDPOINT_URL name another store"
    return ""
