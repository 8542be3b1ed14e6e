"""A web server on this machine whose files, and whose manners, a test chooses."""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

from lookonce.models.registry import Digest, KnownFile

Answer = Callable[[BaseHTTPRequestHandler, bytes], None]


@dataclass
class FileServer:
    """What is served, and what was asked for.

    Attributes:
        url: where it listens.
        content: the file behind each path.
        answers: what answers in place of a good server: the first request takes the first one, and so on.
        ranges: the Range header of each request.
    """

    url: str
    content: dict[str, bytes] = field(default_factory=dict)
    answers: list[Answer] = field(default_factory=list)
    ranges: list[str | None] = field(default_factory=list)

    def known(self, name: str, content: bytes, algorithm: str = "sha256") -> KnownFile:
        """Serve a file, and register it."""
        self.content[f"/{name}"] = content
        digest = Digest(algorithm, hashlib.new(algorithm, content).hexdigest(), "this test")
        return KnownFile(name, len(content), digest, (f"{self.url}/{name}",))


def whole(handler: BaseHTTPRequestHandler, content: bytes) -> None:
    """A server that knows no ranges."""
    send(handler, content, {"Content-Length": str(len(content))})


def good(handler: BaseHTTPRequestHandler, content: bytes) -> None:
    asked = handler.headers["Range"]
    if asked is None:
        return whole(handler, content)
    start = int(asked.removeprefix("bytes=").removesuffix("-"))
    if start >= len(content):
        return send(handler, b"", {"Content-Length": "0"}, code=416)
    rest = content[start:]
    span = f"bytes {start}-{len(content) - 1}/{len(content)}"
    return send(handler, rest, {"Content-Length": str(len(rest)), "Content-Range": span}, code=206)


def cut_after(count: int) -> Answer:
    """A connection that ends too early."""

    def answer(handler: BaseHTTPRequestHandler, content: bytes) -> None:
        send(handler, content[:count], {"Content-Length": str(len(content))})

    return answer


def refuse(code: int) -> Answer:
    return lambda handler, content: send(handler, b"no", {"Content-Length": "2"}, code=code)


def redirect(url: str) -> Answer:
    return lambda handler, content: send(handler, b"", {"Location": url, "Content-Length": "0"}, code=302)


def send(handler: BaseHTTPRequestHandler, body: bytes, headers: dict[str, str], code: int = 200) -> None:
    handler.send_response(code)
    for name, value in headers.items():
        handler.send_header(name, value)
    handler.end_headers()
    handler.wfile.write(body)


@contextmanager
def serve() -> Iterator[FileServer]:
    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            server.ranges.append(self.headers["Range"])
            content = server.content.get(self.path)
            answer = server.answers.pop(0) if server.answers else good if content is not None else refuse(404)
            answer(self, content or b"")

        def log_message(self, format: str, *args: object) -> None:
            pass

    listener = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    server = FileServer(f"http://127.0.0.1:{listener.server_port}")
    thread = threading.Thread(target=listener.serve_forever, kwargs={"poll_interval": 0.01})
    thread.start()
    try:
        yield server
    finally:
        listener.shutdown()
        listener.server_close()
        thread.join()
