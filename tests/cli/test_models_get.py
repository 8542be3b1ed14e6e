"""`lookonce models get` and `known`: from a server on this machine to a model file that finds squares."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from file_server import FileServer, cut_after, serve
from lookonce.cli.app import app
from lookonce.errors import DownloadError, LookonceError, OutputError
from lookonce.model import describe_model
from lookonce.models.download import CACHE_VARIABLE
from lookonce.models.registry import KnownModel
from squares import write_darknet

FILES = ["coco.names", "squares.cfg", "squares.weights"]


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("no_proxy", "*")
    with serve() as running:
        yield running


@pytest.fixture
def given(tmp_path: Path) -> list[Path]:
    """The files of the detector of squares, in a folder of their own."""
    folder = tmp_path / "given"
    folder.mkdir()
    cfg, weights, names = write_darknet(folder)
    return [cfg, weights, names.rename(folder / "coco.names")]


@pytest.fixture(autouse=True)
def cache(server: FileServer, given: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where the only known model, that detector, will be kept."""
    cfg, weights, names = (server.known(path.name, path.read_bytes()) for path in given)
    model = KnownModel("squares", cfg, weights, names, "2 colours", (64, 128), "CC0", "https://example.org/license")
    monkeypatch.setattr("lookonce.models.registry._KNOWN", (model,))
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "cache"))
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.chdir(tmp_path)
    return tmp_path / "cache" / "models" / "squares"


def models(*arguments: object) -> Result:
    result = CliRunner().invoke(app, ["models", *map(str, arguments)])
    assert result.exit_code == 0, result.exception
    return result


def refusal(kind: type[LookonceError], *arguments: object) -> str:
    error = CliRunner().invoke(app, ["models", *map(str, arguments)]).exception
    assert type(error) is kind, error
    assert str(error).isprintable()
    return str(error)


def kept(cache: Path) -> list[str]:
    return sorted(path.name for path in cache.iterdir() if path.name != ".lock")


def test_get_ends_in_a_model_file(cache: Path, tmp_path: Path) -> None:
    result = models("get", "squares")
    assert kept(cache) == FILES
    about = describe_model(tmp_path / "squares.onnx")
    assert about.names == ("red", "other")
    assert about.license == "CC0"
    assert str(cache) in result.stdout
    assert "squares.onnx: 2 classes, input 64x64" in result.stdout


def test_get_takes_a_size_and_a_name_and_may_replace(tmp_path: Path) -> None:
    (tmp_path / "wide.onnx").write_text("an earlier one")
    models("get", "squares", "--size", "64x128", "-o", "wide.onnx", "--overwrite")
    assert describe_model(tmp_path / "wide.onnx").size == (64, 128)


def test_what_cannot_end_well_is_said_before_the_download(server: FileServer, tmp_path: Path) -> None:
    (tmp_path / "squares.onnx").write_text("an earlier one")
    assert "--overwrite" in refusal(OutputError, "get", "squares")
    assert "known are squares" in refusal(DownloadError, "get", "circles")
    result = CliRunner().invoke(app, ["models", "get", "squares", "-o", "new.onnx", "--size", "big"])
    assert "--size big" in str(result.exception)
    assert server.ranges == []


def test_get_without_a_model_file(cache: Path, tmp_path: Path) -> None:
    models("get", "squares", "--no-import")
    assert kept(cache) == FILES
    assert not (tmp_path / "squares.onnx").exists()


def test_without_the_extra_the_import_line_is_printed(cache: Path, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "lookonce.make.darknet.importer", None)
    result = models("get", "squares", "--size", 64)
    assert "pip install 'lookonce[train]'" in result.stdout
    line = result.stdout.splitlines()[-1].strip()
    expected = f"--names {cache / 'coco.names'} --license CC0 --size 64 -o squares.onnx"
    assert line == f"lookonce import {cache / 'squares.cfg'} {cache / 'squares.weights'} {expected}"
    assert not (tmp_path / "squares.onnx").exists()


def test_given_files_need_no_network(server: FileServer, given: list[Path], cache: Path) -> None:
    server.content.clear()
    models("get", "squares", "--no-import", *(part for path in given for part in ("--from", path)))
    assert server.ranges == []
    assert kept(cache) == FILES


def test_what_is_still_missing_is_named(server: FileServer, given: list[Path], cache: Path) -> None:
    message = refusal(DownloadError, "get", "squares", "--from", given[1])
    assert f"squares.cfg ({server.url}/squares.cfg)" in message
    assert "coco.names" in message
    assert kept(cache) == ["squares.weights"]
    assert server.ranges == []
    models("get", "squares", "--from", given[0], "--from", given[2], "--no-import")


def test_a_given_file_with_other_bytes_is_refused(given: list[Path], cache: Path) -> None:
    content = given[1].read_bytes()
    given[1].write_bytes(content[:-1] + b"!")
    message = refusal(DownloadError, "get", "squares", "--from", given[1])
    assert str(given[1]) in message
    assert not cache.exists()


def test_known_says_what_can_be_had_and_what_is_here(server: FileServer, cache: Path) -> None:
    result = models("known")
    for text in ("squares (0.0 MB, not here yet)", "64x64 (also 128)", "CC0", "sha256", "this test", server.url):
        assert text in result.stdout
    assert server.ranges == []
    models("get", "squares", "--no-import")
    assert f"in {cache}" in models("known").stdout


def test_models_still_takes_files_and_folders(tmp_path: Path, square_model: Path) -> None:
    assert "street.onnx" in models().stdout  # what ships is listed first
    (tmp_path / "get").write_bytes(square_model.read_bytes())
    for arguments in ([square_model], ["list", square_model], ["./get"], [square_model, square_model.parent]):
        assert "2: red, other" in models(*arguments).stdout


def test_a_cut_download_is_one_line_and_goes_on(server: FileServer, given: list[Path], cache: Path) -> None:
    server.answers = [*[cut_after(10_000)] * 2, cut_after(500)]  # cfg and names are shorter than that
    message = refusal(DownloadError, "get", "squares")
    assert "squares.weights" in message
    assert "the same command goes on" in message
    models("get", "squares", "--no-import")
    assert server.ranges[-1] == "bytes=500-"


INTERRUPTED = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
from lookonce.cli.app import main
from lookonce.models import registry
def known(name, size, digest):
    url = f"{sys.argv[1]}/{name}"
    return registry.KnownFile(name, int(size), registry.Digest("sha256", digest, "this test"), (url,))
files = [known(*text.split(",")) for text in sys.argv[2:]]
registry._KNOWN = (registry.KnownModel("squares", *files, "2", (64,), "CC0", "https://example.org"),)
sys.argv[1:] = ["models", "get", "squares"]
main()
"""


@pytest.mark.skipif(sys.platform == "win32", reason="a process there cannot be sent Ctrl-C alone")
def test_ctrl_c_keeps_what_is_here_and_says_so(server: FileServer, given: list[Path], cache: Path) -> None:
    reached, released = threading.Event(), threading.Event()

    def stall(handler, content) -> None:
        cut_after(500)(handler, content)
        reached.set()
        released.wait(30)

    files = [server.known(path.name, path.read_bytes()) for path in given]
    server.answers = [cut_after(10_000), cut_after(10_000), stall]
    arguments = [server.url, *(f"{file.name},{file.size_bytes},{file.digest.value}" for file in files)]
    command = [sys.executable, "-c", INTERRUPTED, *arguments]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        assert reached.wait(60)
        part = cache / "squares.weights.part"
        for _ in range(1000):
            if part.exists():
                break
            threading.Event().wait(0.01)
        threading.Event().wait(0.2)
        process.send_signal(signal.SIGINT)
        _, stderr = process.communicate(timeout=60)
    finally:
        released.set()
        process.kill()
        process.wait()
    assert process.returncode == 130, stderr
    assert "Traceback" not in stderr
    assert "'lookonce models get squares' goes on" in stderr
    assert part.read_bytes() == given[1].read_bytes()[:500]
    models("get", "squares", "--no-import")
    assert server.ranges[-1] == "bytes=500-"
