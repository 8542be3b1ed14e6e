"""Cameras and URLs, with servers on this machine only."""

from __future__ import annotations

import functools
import http.server
import socket
import sys
import threading
import time
from contextlib import contextmanager

import pytest

from lookonce.errors import ConfigError, VideoError
from lookonce.video import open_video
from video.clips import numbers_in, write_clip


@contextmanager
def files_served(folder):
    class Quiet(http.server.SimpleHTTPRequestHandler):
        def log_message(self, *args):
            pass

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Quiet, directory=folder)) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.05,))
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()
        thread.join()


@contextmanager
def bytes_served(data):
    """A TCP server that sends ``data`` to whoever connects; None = says nothing until the end."""
    done = threading.Event()

    def serve(listener):
        connection, _ = listener.accept()
        with connection:
            if data is None:
                done.wait(30)
            else:
                connection.sendall(data)

    with socket.create_server(("127.0.0.1", 0)) as listener:
        thread = threading.Thread(target=serve, args=(listener,))
        thread.start()
        yield listener.getsockname()[1]
        done.set()
        thread.join()


def free_port():
    with socket.create_server(("127.0.0.1", 0)) as listener:
        return listener.getsockname()[1]


def test_file_on_a_server_is_read_like_a_file(tmp_path):
    write_clip(tmp_path / "clip.mp4", 20, options={"movflags": "faststart"})
    with files_served(tmp_path) as address:
        source = open_video(f"{address}/clip.mp4", start_s=1.0)
        assert [f.index for f in source] == list(range(10, 20))
        assert (source.name, source.is_live, source.frame_count) == ("clip", False, 10)
        with pytest.raises(VideoError, match=r"none\.mp4.*404"):
            open_video(f"{address}/none.mp4")


def test_stream_is_live_and_cannot_start_later(tmp_path):
    data = write_clip(tmp_path / "clip.ts", 20).read_bytes()
    with bytes_served(data) as port:
        with open_video(f"tcp://127.0.0.1:{port}", max_frames=10) as source:
            assert (source.is_live, source.frame_count) == (True, None)
            assert numbers_in(source) == list(range(10))
            with pytest.raises(ValueError, match="once"):
                iter(source)
    with bytes_served(data) as port, pytest.raises(ConfigError, match="live"):
        open_video(f"tcp://127.0.0.1:{port}", start_s=1.0)


@pytest.mark.parametrize("scheme", ["http", "https", "rtsp", "rtmp", "tcp"])
def test_refused_connection_is_named_without_the_password(scheme):
    url = f"{scheme}://admin:secret@127.0.0.1:{free_port()}/cam"
    with pytest.raises(VideoError) as caught:
        open_video(url)
    message = str(caught.value)
    assert f"{scheme}://admin:***@127.0.0.1" in message
    assert "secret" not in message
    assert "\n" not in message


def test_unknown_kind_of_url_is_refused():
    with pytest.raises(VideoError, match="ftp:// cannot be read"):
        open_video("ftp://example.org/clip.mp4")


def test_playlist_from_a_server_cannot_read_local_files(tmp_path):
    clip = write_clip(tmp_path / "clip.ts", 3)
    (tmp_path / "list.m3u8").write_text(
        f"#EXTM3U\n#EXT-X-TARGETDURATION:5\n#EXTINF:5,\nfile://{clip}\n#EXT-X-ENDLIST\n"
    )
    with files_served(tmp_path) as address, pytest.raises(VideoError):
        open_video(f"{address}/list.m3u8")


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["http", "rtsp", "tcp"])
def test_server_that_never_answers_fails_within_ten_seconds(scheme):
    with bytes_served(None) as port:
        begun = time.monotonic()
        with pytest.raises(VideoError, match="no answer in time"):
            open_video(f"{scheme}://127.0.0.1:{port}/cam")
        assert time.monotonic() - begun < 10


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="cameras are named like this on Linux only")
@pytest.mark.parametrize("source", [97, "97", "/dev/video97"])
def test_missing_camera_is_named(source):
    with pytest.raises(VideoError, match=r"no camera /dev/video97; .*found"):
        open_video(source)


def test_number_of_a_camera_that_is_a_file_means_the_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_clip(tmp_path / "clip.mp4", 3).rename(tmp_path / "97")
    assert numbers_in(open_video("97")) == [0, 1, 2]
