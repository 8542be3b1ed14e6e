"""Files of known models, from a server on this machine with good and bad manners, and from the disk."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from dataclasses import replace
from pathlib import Path

import pytest

from file_server import FileServer, cut_after, good, redirect, refuse, send, serve, whole
from lookonce.errors import DownloadError, LookonceError, OutputError
from lookonce.models.download import CACHE_VARIABLE, copy_file, download_file, is_cached, model_folder, part_bytes
from lookonce.models.registry import KnownModel

CONTENT = bytes(range(256)) * 4096  # 1 MiB
HALF = len(CONTENT) // 2
NAME = "net.weights"


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("no_proxy", "*")
    with serve() as running:
        yield running


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return tmp_path / "cache" / "net"


def refusal(call, *arguments, kind: type[LookonceError] = DownloadError) -> str:
    with pytest.raises(kind) as caught:
        call(*arguments)
    assert type(caught.value) is kind
    assert str(caught.value).isprintable()
    return str(caught.value)


def files_in(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir() if path.name != ".lock")


def leave_part(folder: Path, content: bytes) -> Path:
    folder.mkdir(parents=True)
    part = folder / f"{NAME}.part"
    part.write_bytes(content)
    return part


@pytest.mark.parametrize("algorithm", ["sha256", "sha1"])
def test_a_whole_download_is_checked_and_kept(server: FileServer, folder: Path, algorithm: str) -> None:
    told: list[int] = []
    file = server.known(NAME, CONTENT, algorithm)
    path = download_file(file, folder, lambda _, here: told.append(here))
    assert path == folder / NAME
    assert path.read_bytes() == CONTENT
    assert files_in(folder) == [NAME]
    assert told[0] == 0
    assert told[-1] == len(CONTENT)
    assert told == sorted(told)


def test_what_is_here_is_not_fetched_again(server: FileServer, folder: Path) -> None:
    file = server.known(NAME, CONTENT)
    download_file(file, folder)
    download_file(file, folder)
    assert server.ranges == [None]


def test_a_damaged_file_in_the_cache_is_fetched_again(server: FileServer, folder: Path) -> None:
    file = server.known(NAME, CONTENT)
    folder.mkdir(parents=True)
    (folder / NAME).write_bytes(CONTENT[:-1] + b"!")
    assert download_file(file, folder).read_bytes() == CONTENT


def test_a_cut_download_goes_on_where_it_ended(server: FileServer, folder: Path) -> None:
    file = server.known(NAME, CONTENT)
    server.answers = [cut_after(HALF)]
    message = refusal(download_file, file, folder)
    assert f"ended after {HALF} of {len(CONTENT)} bytes" in message
    assert "0.5 of 1.0 MB are kept" in message
    assert "the same command goes on" in message
    assert files_in(folder) == [f"{NAME}.part"]
    assert download_file(file, folder).read_bytes() == CONTENT
    assert server.ranges == [None, f"bytes={HALF}-"]
    assert files_in(folder) == [NAME]


def test_a_server_without_ranges_sends_the_whole_again(server: FileServer, folder: Path) -> None:
    file = server.known(NAME, CONTENT)
    leave_part(folder, b"x" * HALF)
    server.answers = [whole]
    assert download_file(file, folder).read_bytes() == CONTENT
    assert len(server.ranges) == 1


def test_a_part_of_another_version_is_dropped_and_fetched_anew(server: FileServer, folder: Path) -> None:
    """The server's file changed between the two tries: the first half is of the old one."""
    file = server.known(NAME, CONTENT)
    leave_part(folder, b"x" * HALF)
    assert download_file(file, folder).read_bytes() == CONTENT
    assert server.ranges == [f"bytes={HALF}-", None]


@pytest.mark.parametrize("extra", [0, 7], ids=["full", "too long"])
def test_a_part_that_is_wrong_at_its_full_length_is_fetched_anew(server: FileServer, folder: Path, extra: int) -> None:
    file = server.known(NAME, CONTENT)
    leave_part(folder, b"x" * (len(CONTENT) + extra))
    assert download_file(file, folder).read_bytes() == CONTENT
    assert server.ranges == [None]


def test_a_full_part_needs_no_server(server: FileServer, folder: Path) -> None:
    file = server.known(NAME, CONTENT)
    leave_part(folder, CONTENT)
    assert download_file(file, folder).read_bytes() == CONTENT
    assert server.ranges == []


def test_a_refused_range_is_asked_for_as_a_whole(server: FileServer, folder: Path) -> None:
    file = server.known(NAME, CONTENT)
    leave_part(folder, CONTENT[:HALF])
    server.answers = [refuse(416)]
    assert download_file(file, folder).read_bytes() == CONTENT
    assert server.ranges == [f"bytes={HALF}-", None]


def test_another_range_than_asked_for_is_refused(server: FileServer, folder: Path) -> None:
    file = server.known(NAME, CONTENT)
    leave_part(folder, CONTENT[:HALF])
    headers = {"Content-Range": f"bytes 0-9/{len(CONTENT)}", "Content-Length": "10"}
    server.answers = [lambda handler, content: send(handler, content[:10], headers, code=206)]
    assert "another range" in refusal(download_file, file, folder)
    assert download_file(file, folder).read_bytes() == CONTENT


def test_another_content_is_never_kept(server: FileServer, folder: Path) -> None:
    file = server.known(NAME, CONTENT)
    server.content[f"/{NAME}"] = CONTENT[:-1] + b"!"
    message = refusal(download_file, file, folder)
    assert f"expected {file.digest.value}" in message
    assert file.urls[0] in message
    assert "--from" in message
    assert files_in(folder) == []


@pytest.mark.parametrize("length", [10, len(CONTENT) + 1])
def test_another_size_is_refused_before_anything_is_written(server: FileServer, folder: Path, length: int) -> None:
    file = server.known(NAME, CONTENT)
    server.content[f"/{NAME}"] = bytes(length)
    assert f"has {length} bytes, registered are {len(CONTENT)}" in refusal(download_file, file, folder)
    assert files_in(folder) == []


def test_more_than_registered_is_never_written(server: FileServer, folder: Path) -> None:
    file = server.known(NAME, CONTENT)
    server.answers = [lambda handler, content: send(handler, content + content, {})]  # does not say how much
    assert "sends more than" in refusal(download_file, file, folder)
    assert files_in(folder) == []


def test_a_web_page_is_not_taken_for_the_file(server: FileServer, folder: Path) -> None:
    """What some servers answer, with 200 OK, when a file has moved."""
    file = server.known(NAME, CONTENT)
    server.answers = [lambda handler, content: send(handler, b"<html>", {"Content-Type": "text/html; charset=utf-8"})]
    assert "web page" in refusal(download_file, file, folder)
    assert files_in(folder) == []


@pytest.mark.parametrize("code", [403, 404, 500])
def test_what_is_not_allowed_is_said(server: FileServer, folder: Path, code: int) -> None:
    file = server.known(NAME, CONTENT)
    server.answers = [refuse(code)]
    message = refusal(download_file, file, folder)
    assert f"{file.urls[0]} answers {code}" in message
    assert "--from" in message


def test_the_next_address_is_tried_and_goes_on_with_the_part(server: FileServer, folder: Path) -> None:
    file = server.known(NAME, CONTENT)
    file = replace(file, urls=(f"{server.url}/gone", *file.urls, f"{server.url}/mirror"))
    server.content["/mirror"] = CONTENT
    server.answers = [refuse(404), cut_after(HALF)]
    assert download_file(file, folder).read_bytes() == CONTENT
    assert server.ranges == [None, None, f"bytes={HALF}-"]


def test_all_addresses_are_named_when_none_works(server: FileServer, folder: Path) -> None:
    file = replace(server.known(NAME, CONTENT), urls=(f"{server.url}/a", f"{server.url}/b"))
    message = refusal(download_file, file, folder)
    assert f"{server.url}/a answers 404" in message
    assert f"{server.url}/b answers 404" in message


def test_a_redirect_is_followed(server: FileServer, folder: Path) -> None:
    file = server.known(NAME, CONTENT)
    leave_part(folder, CONTENT[:HALF])
    server.answers = [redirect(f"{file.urls[0]}?signed")]
    server.content[f"/{NAME}?signed"] = CONTENT
    assert download_file(file, folder).read_bytes() == CONTENT
    assert server.ranges == [f"bytes={HALF}-"] * 2


@pytest.mark.parametrize("url", ["http://example.org/net.weights", "ftp://127.0.0.1/net.weights", "file:///etc/passwd"])
def test_a_redirect_to_anything_but_https_is_refused(server: FileServer, folder: Path, url: str) -> None:
    file = server.known(NAME, CONTENT)
    server.answers = [redirect(url)]
    message = refusal(download_file, file, folder)
    assert file.urls[0] in message
    assert files_in(folder) == []


def test_a_redirect_without_end_is_one_line(server: FileServer, folder: Path) -> None:
    file = server.known(NAME, CONTENT)
    server.answers = [redirect(file.urls[0])] * 30
    assert "302" in refusal(download_file, file, folder)


@pytest.mark.parametrize("url", ["http://example.org/a", "file:///etc/passwd", "ftp://127.0.0.1/a", "127.0.0.1/a"])
def test_only_https_is_asked(server: FileServer, folder: Path, url: str) -> None:
    file = replace(server.known(NAME, CONTENT), urls=(url,))
    assert f"{url} is not https" in refusal(download_file, file, folder)


def test_an_unreachable_server_is_one_line(folder: Path, server: FileServer) -> None:
    file = replace(server.known(NAME, CONTENT), urls=("http://127.0.0.1:9/net.weights",))
    assert "cannot be reached" in refusal(download_file, file, folder)


def test_a_server_that_falls_silent_is_given_up(server: FileServer, folder: Path, monkeypatch) -> None:
    monkeypatch.setattr("lookonce.models.download._TIMEOUT_S", 0.2)
    file = server.known(NAME, CONTENT)
    released = threading.Event()

    def stall(handler, content) -> None:
        cut_after(1000)(handler, content)
        released.wait(10)

    server.answers = [stall]
    message = refusal(download_file, file, folder)
    released.set()
    assert "timed out" in message
    assert (folder / f"{NAME}.part").stat().st_size == 1000


def test_ctrl_c_keeps_the_part(server: FileServer, folder: Path) -> None:
    def interrupt(_: object, here: int) -> None:
        if here >= HALF:
            raise KeyboardInterrupt

    file = server.known(NAME, CONTENT)
    with pytest.raises(KeyboardInterrupt):
        download_file(file, folder, interrupt)
    kept = (folder / f"{NAME}.part").read_bytes()
    assert HALF <= len(kept) < len(CONTENT)
    assert CONTENT.startswith(kept)
    assert download_file(file, folder).read_bytes() == CONTENT


def test_two_downloads_at_once_do_not_meet(server: FileServer, folder: Path) -> None:
    file = server.known(NAME, CONTENT)
    reached, go_on = threading.Event(), threading.Event()

    def wait(handler, content) -> None:
        reached.set()
        go_on.wait(10)
        good(handler, content)

    server.answers = [wait]
    first = threading.Thread(target=download_file, args=(file, folder))
    first.start()
    assert reached.wait(10)
    assert "another process" in refusal(download_file, file, folder)
    go_on.set()
    first.join()
    assert download_file(file, folder).read_bytes() == CONTENT
    assert server.ranges == [None]


LIMITED = """
import resource, sys
from pathlib import Path
from lookonce.errors import OutputError
from lookonce.models.download import download_file
from lookonce.models.registry import Digest, KnownFile
url, size, digest, folder, limit = sys.argv[1:]
resource.setrlimit(resource.RLIMIT_FSIZE, (int(limit), resource.RLIM_INFINITY))
file = KnownFile("net.weights", int(size), Digest("sha256", digest, "this test"), (url,))
try:
    print(download_file(file, Path(folder)))
except OutputError as error:
    print(error)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="there are no such limits")
def test_a_full_disk_is_said_and_the_part_is_gone_on_with(server: FileServer, folder: Path) -> None:
    file = server.known(NAME, CONTENT)
    arguments = [file.urls[0], str(len(CONTENT)), file.digest.value, str(folder), str(HALF)]
    command = [sys.executable, "-c", LIMITED, *arguments]
    result = subprocess.run(command, capture_output=True, text=True, timeout=60, env={**os.environ, "no_proxy": "*"})
    assert result.returncode == 0, result.stderr
    assert f"{NAME}.part: cannot write it" in result.stdout
    assert CACHE_VARIABLE in result.stdout
    assert files_in(folder) == [f"{NAME}.part"]
    assert download_file(file, folder).read_bytes() == CONTENT
    assert server.ranges[-1] != server.ranges[0]


def test_a_folder_that_cannot_be_made_is_said(server: FileServer, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    message = refusal(download_file, server.known(NAME, CONTENT), tmp_path / "file" / "net", kind=OutputError)
    assert CACHE_VARIABLE in message
    assert server.ranges == []


def test_a_cache_that_cannot_be_written_still_serves(server: FileServer, folder: Path, monkeypatch) -> None:
    file = server.known(NAME, CONTENT)
    folder.mkdir(parents=True)
    (folder / NAME).write_bytes(CONTENT)
    (folder / ".lock").mkdir()  # stands for a folder that belongs to somebody else, also to root
    assert download_file(file, folder).read_bytes() == CONTENT
    (folder / NAME).unlink()
    refusal(download_file, file, folder, kind=OutputError)


def test_a_given_file_is_checked_and_copied(server: FileServer, folder: Path, tmp_path: Path) -> None:
    file, other = server.known(NAME, CONTENT), server.known("net.cfg", b"[net]")
    leave_part(folder, CONTENT[:HALF])
    source = tmp_path / "downloaded (1).bin"
    source.write_bytes(CONTENT)
    assert copy_file(source, (other, file), folder) == folder / NAME
    assert copy_file(source, (other, file), folder) == folder / NAME
    assert (folder / NAME).read_bytes() == source.read_bytes() == CONTENT
    assert files_in(folder) == [NAME]
    assert server.ranges == []


def test_two_files_of_one_size_are_told_apart(server: FileServer, folder: Path, tmp_path: Path) -> None:
    files = server.known("a.cfg", b"[a]"), server.known("b.cfg", b"[b]")
    (tmp_path / "given").write_bytes(b"[b]")
    assert copy_file(tmp_path / "given", files, folder).name == "b.cfg"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        pytest.param(CONTENT[:-1] + b"!", "expected", id="content"),
        pytest.param(CONTENT[:-1], "none of the files looked for", id="size"),
        pytest.param(None, "cannot read it", id="missing"),
    ],
)
def test_a_given_file_that_is_another_one_is_refused(server, folder, tmp_path, content, message) -> None:
    source = tmp_path / "given"
    if content is not None:
        source.write_bytes(content)
    told = refusal(copy_file, source, (server.known(NAME, CONTENT),), folder)
    assert message in told
    assert str(source) in told
    assert not folder.exists()


def test_the_cache_is_the_users_or_the_one_that_is_named(server: FileServer, tmp_path: Path, monkeypatch) -> None:
    file = server.known(NAME, CONTENT)
    model = KnownModel("net", file, file, file, "none", (64,), "none", "https://example.org")
    monkeypatch.setenv(CACHE_VARIABLE, "")
    assert "lookonce" in model_folder(model).parts
    monkeypatch.setenv(CACHE_VARIABLE, "~/there")
    assert model_folder(model) == Path.home() / "there" / "models" / "net"
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path))
    assert model_folder(model) == tmp_path / "models" / "net"
    assert not is_cached(model)
    server.answers = [cut_after(HALF)]
    refusal(download_file, file, model_folder(model))
    assert part_bytes(replace(model, cfg=replace(file, name="a"), names=replace(file, name="b"))) == HALF
    download_file(file, model_folder(model))
    assert is_cached(model)
