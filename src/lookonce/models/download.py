"""Files of known models: fetched over HTTPS or copied from elsewhere, checked, and kept in the user's cache folder.

Whatever lies in the cache under its own name has been checked against size and digest of the registry. Until then it
is ``NAME.part``, which a later call goes on with: since the digest of the whole is known, neither an ETag nor a date is
asked of the server. Were the file another one meanwhile, the digest says so and the part is dropped.
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import sys
import urllib.request
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from http.client import HTTPException, HTTPMessage, HTTPResponse
from importlib.metadata import version
from pathlib import Path
from typing import IO, BinaryIO
from urllib.error import HTTPError, URLError
from urllib.parse import urlsplit

import platformdirs

from lookonce.errors import DownloadError, OutputError
from lookonce.models.registry import KnownFile, KnownModel

__all__ = ["CACHE_VARIABLE", "Progress", "copy_file", "download_file", "is_cached", "model_folder", "part_bytes"]

Progress = Callable[[KnownFile, int], None]  # so many bytes of a file are here

CACHE_VARIABLE = "LOOKONCE_CACHE"
_TIMEOUT_S = 30.0  # for each answer of the server, not for the whole
_CHUNK_BYTES = 1 << 18
_RANGE_NOT_SATISFIABLE = 416
_PARTIAL_CONTENT = 206
_THIS_MACHINE = {"localhost", "127.0.0.1", "::1"}


def model_folder(model: KnownModel) -> Path:
    """Where the files of a known model are kept: the user's cache folder, or the one that LOOKONCE_CACHE names."""
    chosen = os.environ.get(CACHE_VARIABLE, "")
    cache = Path(chosen).expanduser() if chosen else platformdirs.user_cache_path("lookonce", appauthor=False)
    return cache / "models" / model.name


def is_cached(model: KnownModel) -> bool:
    """Whether all files of a known model are in the cache."""
    paths = [(model_folder(model) / file.name, file) for file in model.files]
    return all(path.is_file() and path.stat().st_size == file.size_bytes for path, file in paths)


def part_bytes(model: KnownModel) -> int:
    """How much an earlier download left that a later one goes on with."""
    parts = [_part(model_folder(model), file) for file in model.files]
    return sum(part.stat().st_size for part in parts if part.is_file())


def download_file(file: KnownFile, folder: Path, progress: Progress | None = None) -> Path:
    """The checked file in a folder of the cache; what is missing of it is fetched.

    Args:
        file: which one.
        folder: where to keep it; made where it is missing.
        progress: told how much is here, again and again.

    Raises:
        DownloadError: no address gave the registered file, or another process is fetching it.
        OutputError: the folder or the disk does not take it.
    """
    target, part = folder / file.name, _part(folder, file)
    if _is_here(target, file):  # also in a folder that cannot be written
        return target
    failures = []
    with _alone_in(folder):
        if _is_here(target, file):  # another process was faster
            return target
        for url in file.urls:
            try:
                _fetch(url, file, part, progress or _ignore)
            except DownloadError as error:
                failures.append(str(error))
                continue
            _move(part, target)
            return target
        here = part.stat().st_size if part.exists() else 0
    raise DownloadError(f"{file.name}: {'; '.join(failures)}; {_remedy(file, here)}")


def copy_file(source: Path, files: Sequence[KnownFile], folder: Path) -> Path:
    """A file from elsewhere, copied into a folder of the cache if it is one of ``files``; its own name does not matter.

    Raises:
        DownloadError: it is none of them, or cannot be read.
        OutputError: the folder or the disk does not take it.
    """
    try:
        size_bytes = source.stat().st_size
    except OSError as exc:
        raise DownloadError(f"{source}: cannot read it ({exc.strerror}); check the path") from exc
    alike = [file for file in files if file.size_bytes == size_bytes]
    if not alike:
        expected = ", ".join(f"{file.name} has {file.size_bytes}" for file in files)
        raise DownloadError(f"{source}: {size_bytes} bytes, none of the files looked for ({expected}); get it anew")
    faults = [_fault(source, file) for file in alike]
    if all(faults):
        raise DownloadError(f"{source}: {faults[0]}; get it anew")
    file = alike[faults.index("")]
    target, copy = folder / file.name, folder / f"{file.name}.copy"
    if _is_here(target, file):
        return target
    with _alone_in(folder):
        try:
            shutil.copyfile(source, copy)
        except OSError as exc:
            copy.unlink(missing_ok=True)
            raise _cannot_write(copy, exc) from exc
        if fault := _fault(copy, file):
            copy.unlink()
            raise DownloadError(f"{source}: changed while it was copied: {fault}; try again")
        _move(copy, target)
        _part(folder, file).unlink(missing_ok=True)
    return target


def _fetch(url: str, file: KnownFile, part: Path, progress: Progress) -> None:
    """Bring the part to its full length and check it; a part that turns out wrong is dropped, and fetched anew once."""
    while True:
        goes_on = _fetch_rest(url, file, part, progress)
        fault = _fault(part, file)
        if not fault:
            return
        part.unlink()
        if not goes_on:
            raise DownloadError(f"{url} gave another file than the registered one: {fault}")


def _fetch_rest(url: str, file: KnownFile, part: Path, progress: Progress) -> bool:
    """Add what is missing to the part; whether there was something of it before."""
    here = part.stat().st_size if part.exists() else 0
    if here >= file.size_bytes:
        return True
    if not _is_safe(url):
        raise DownloadError(f"{url} is not https")
    headers = {"User-Agent": f"lookonce/{version('lookonce')}", "Accept-Encoding": "identity"}
    if here:
        headers["Range"] = f"bytes={here}-"
    request = urllib.request.Request(url, headers=headers)
    response = _open(request)
    if response is None:  # the server has no such range
        part.unlink()
        return _fetch_rest(url, file, part, progress)
    with response:
        start = _checked_start(response, url, file, part)
        try:
            with open(part, "r+b" if here else "wb") as out:
                out.seek(start)
                out.truncate()
                end = _receive(response, url, file, out, progress)
        except OSError as exc:
            raise _cannot_write(part, exc) from exc
        if end == file.size_bytes and _read(response, url, 1):
            part.unlink()
            raise DownloadError(f"{url} sends more than the registered {file.size_bytes} bytes")
    if end < file.size_bytes:
        raise DownloadError(f"{url} ended after {end} of {file.size_bytes} bytes")
    return start > 0


def _receive(response: HTTPResponse, url: str, file: KnownFile, out: BinaryIO, progress: Progress) -> int:
    """Write what comes, never more than the registered size; where in the file that ended."""
    position = out.tell()
    progress(file, position)
    while position < file.size_bytes:
        data = _read(response, url, min(_CHUNK_BYTES, file.size_bytes - position))
        if not data:
            break
        out.write(data)
        position += len(data)
        progress(file, position)
    return position


def _read(response: HTTPResponse, url: str, count: int) -> bytes:
    """Up to so many bytes, as soon as there are any."""
    try:
        return response.read1(count)
    except (OSError, HTTPException) as exc:
        raise DownloadError(f"{url} was cut off ({exc or type(exc).__name__})") from exc


def _checked_start(response: HTTPResponse, url: str, file: KnownFile, part: Path) -> int:
    """The position in the file where the answer begins, refusing answers about something else.

    A server that knows no ranges sends the whole file.
    """
    if response.headers.get_content_type() == "text/html":
        raise DownloadError(f"{url} gives a web page instead of the file")
    if response.status == _PARTIAL_CONTENT:
        here = part.stat().st_size
        span = re.fullmatch(r"bytes (\d+)-\d+/(\d+|\*)", response.headers.get("Content-Range", ""))
        if span is None or int(span[1]) != here:
            part.unlink()
            raise DownloadError(f"{url} answers with another range than the one asked for; the next try starts anew")
        start, total = here, span[2]
    else:
        start, total = 0, response.headers.get("Content-Length", "*")
    if total != "*" and total != str(file.size_bytes):
        raise DownloadError(f"{url} has {total} bytes, registered are {file.size_bytes}")
    return start


class _SafeRedirects(urllib.request.HTTPRedirectHandler):
    """Goes on to other addresses only where the way there is encrypted too."""

    def redirect_request(
        self, req: urllib.request.Request, fp: IO[bytes], code: int, msg: str, headers: HTTPMessage, newurl: str
    ) -> urllib.request.Request | None:
        if not _is_safe(newurl) or (req.type == "https" and urlsplit(newurl).scheme != "https"):
            fp.close()
            raise DownloadError(f"{req.full_url} leads on to {newurl}, which is not https")
        return super().redirect_request(req, fp, code, msg, headers, newurl)


def _is_safe(url: str) -> bool:
    """Whether nobody on the way can read along: https, or a server on this machine."""
    parts = urlsplit(url)
    return parts.scheme == "https" or (parts.scheme == "http" and parts.hostname in _THIS_MACHINE)


def _open(request: urllib.request.Request) -> HTTPResponse | None:
    """The server's answer, or None where it has no such range."""
    url = request.full_url
    try:
        response = urllib.request.build_opener(_SafeRedirects()).open(request, timeout=_TIMEOUT_S)
    except HTTPError as exc:
        exc.close()
        if exc.code == _RANGE_NOT_SATISFIABLE and request.has_header("Range"):
            return None
        raise DownloadError(f"{url} answers {exc.code} {' '.join(str(exc.reason).split())}") from exc
    except URLError as exc:
        raise DownloadError(f"{url} cannot be reached ({exc.reason})") from exc
    except (OSError, HTTPException) as exc:
        raise DownloadError(f"{url} cannot be reached ({exc or type(exc).__name__})") from exc
    assert isinstance(response, HTTPResponse)
    return response


def _is_here(target: Path, file: KnownFile) -> bool:
    return target.exists() and not _fault(target, file)


def _fault(path: Path, file: KnownFile) -> str:
    """What is wrong with a file's content; empty where it is the registered one."""
    try:
        with open(path, "rb") as content:
            size_bytes = os.fstat(content.fileno()).st_size
            if size_bytes != file.size_bytes:
                return f"{size_bytes} bytes, expected {file.size_bytes}"
            value = hashlib.file_digest(content, file.digest.algorithm).hexdigest()
    except OSError as exc:
        raise DownloadError(f"{path}: cannot read it ({exc.strerror})") from exc
    if value != file.digest.value:
        return f"{file.digest.algorithm} {value}, expected {file.digest.value}"
    return ""


@contextmanager
def _alone_in(folder: Path) -> Iterator[None]:
    """Keep other processes out of a folder of the cache; however this one ends, the system lifts the lock."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = open(folder / ".lock", "wb")
    except OSError as exc:
        raise _cannot_write(folder, exc) from exc
    with lock:
        try:
            if sys.platform == "win32":
                import msvcrt

                msvcrt.locking(lock.fileno(), msvcrt.LK_NBLCK, 1)
            else:
                import fcntl

                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except (BlockingIOError, PermissionError) as exc:
            raise DownloadError(f"{folder}: another process is fetching this model; wait for it to end") from exc
        except OSError as exc:
            raise _cannot_write(folder, exc) from exc
        yield


def _move(source: Path, target: Path) -> None:
    """Give a checked file its name, whole or not at all."""
    try:
        with open(source, "rb+") as file:
            os.fsync(file.fileno())
        source.replace(target)
    except OSError as exc:
        raise _cannot_write(target, exc) from exc


def _cannot_write(path: Path, error: OSError) -> OutputError:
    return OutputError(
        f"{path}: cannot write it ({error.strerror}); make room, or name another folder in {CACHE_VARIABLE}"
    )


def _remedy(file: KnownFile, here: int) -> str:
    if here:
        return f"{here / 1e6:.1f} of {file.size_bytes / 1e6:.1f} MB are kept, and the same command goes on with them"
    return "try again later, or get the file elsewhere and give it with --from"


def _part(folder: Path, file: KnownFile) -> Path:
    return folder / f"{file.name}.part"


def _ignore(file: KnownFile, here: int) -> None:
    """No progress is shown."""
